"""Robots as immutable values, and the model that equations are derived for.

Uses forms; methods that are short for functions of higher layers use bending, description and export.
"""

from typing import TYPE_CHECKING

from ..lazily import lazy_names

if TYPE_CHECKING:
    from .bounds import Limits as Limits
    from .elements import Bushing as Bushing
    from .elements import LinkElement as LinkElement
    from .elements.joint_damping import JointDamping as JointDamping
    from .elements.joint_stiffness import JointStiffness as JointStiffness
    from .elements.journal import Radial as Radial
    from .elements.journal import SlidingFriction as SlidingFriction
    from .geometry import IDENTITY as IDENTITY
    from .geometry import ZERO as ZERO
    from .geometry import Matrix as Matrix
    from .geometry import Vector as Vector
    from .geometry import rotation_from_rpy as rotation_from_rpy
    from .geometry import snap as snap
    from .model import Model as Model
    from .model import build_model as build_model
    from .record import record_of as record_of
    from .record import robot_hash as robot_hash
    from .record import robot_of as robot_of
    from .value import ANGULAR as ANGULAR
    from .value import BASE as BASE
    from .value import COORDINATES as COORDINATES
    from .value import INERTIA_KEYS as INERTIA_KEYS
    from .value import LINEAR as LINEAR
    from .value import MOTOR as MOTOR
    from .value import PRINCIPAL as PRINCIPAL
    from .value import Beam as Beam
    from .value import Coordinate as Coordinate
    from .value import Coupling as Coupling
    from .value import Curve as Curve
    from .value import Frame as Frame
    from .value import Friction as Friction
    from .value import Joint as Joint
    from .value import Link as Link
    from .value import Loop as Loop
    from .value import Motor as Motor
    from .value import Placement as Placement
    from .value import Robot as Robot
    from .value import Sensor as Sensor
    from .value import Spring as Spring
else:
    __getattr__, __dir__, __all__ = lazy_names(__name__)
