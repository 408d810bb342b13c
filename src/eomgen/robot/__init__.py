"""A robot as an immutable value: its parts, its rules, and the model that equations are derived for.

Uses forms; it knows neither files nor kernels.
"""

from .bounds import Limits
from .elements import Bushing, LinkElement
from .elements.joint_damping import JointDamping
from .elements.journal import Radial, SlidingFriction
from .geometry import IDENTITY, ZERO, Matrix, Vector, rotation_from_rpy, snap
from .model import Model, build_model
from .record import record_of, robot_hash, robot_of
from .value import (
    ANGULAR,
    BASE,
    COORDINATES,
    INERTIA_KEYS,
    LINEAR,
    MOTOR,
    PRINCIPAL,
    Coordinate,
    Coupling,
    Curve,
    Frame,
    Friction,
    Joint,
    Link,
    Loop,
    Motor,
    Placement,
    Robot,
    Spring,
)

__all__ = [
    "ANGULAR",
    "BASE",
    "COORDINATES",
    "IDENTITY",
    "INERTIA_KEYS",
    "LINEAR",
    "MOTOR",
    "PRINCIPAL",
    "ZERO",
    "Bushing",
    "Coordinate",
    "Coupling",
    "Curve",
    "Frame",
    "Friction",
    "Joint",
    "JointDamping",
    "Limits",
    "Link",
    "LinkElement",
    "Loop",
    "Matrix",
    "Model",
    "Motor",
    "Placement",
    "Radial",
    "Robot",
    "SlidingFriction",
    "Spring",
    "Vector",
    "build_model",
    "record_of",
    "robot_hash",
    "robot_of",
    "rotation_from_rpy",
    "snap",
]
