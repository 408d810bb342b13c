"""Facts about a kernel beside its C, which the package keeps as JSON and its NumPy face reads.

Names and shapes, what each kernel reads and writes, measured curves, entries of M and C that survive, operations.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from eomgen._version import __version__
from eomgen.robot.laws import least_of
from eomgen.robot.model import Model
from eomgen.robot.value import MOTOR

from ..joint.zeros import zero_map
from ..kernels.equations import Equations
from ..kernels.signatures import KERNELS, shapes
from ..solve.factorised import solve_operations


def metadata(equations: Equations, dtype: str) -> dict[str, Any]:
    """What the Python face of a kernel knows of it."""
    model = equations.model
    return {
        "generator": f"eomgen {__version__}",
        "name": model.name,
        "dtype": dtype,
        "coordinates": model.coordinates,
        "joints": [body.joint for body in model.bodies],
        "links": model.links,
        "frames": model.frames,
        "driven": model.driven,
        "prescribed": [model.coordinates[i] for i in model.prescribed],
        **_motor_metadata(model),
        "parameters": dict(model.parameters),
        "least": {name: least for name in model.parameters if (least := least_of(name)) is not None},
        "hoisted": len(equations.setup.outputs),
        "shapes": {key: list(shape) for key, shape in shapes(model).items()},
        "kernels": {
            name: {"reads": KERNELS[name].reads, "writes": KERNELS[name].writes}
            for name in KERNELS
            if name in equations.kernels
        },
        "knots": knots(model),
        "operations": operations(equations),
        **_loop_metadata(model),
        **({"springs": [spring.name for spring in model.robot.springs]} if model.robot.springs else {}),
        "survivors": survivors(model) if "christoffel" in equations.kernels else {},
    }


def knots(model: Model) -> dict[str, list[float]]:
    """Deviations of every measured curve, by its coordinate; of a transmission's by the motor's."""
    given = {f"{joint.name}.{name}": c for joint in model.robot.joints for name, c in joint.coordinates.items()}
    given |= {f"{joint.name}.{MOTOR}": joint.motor.transmission for joint in model.robot.joints if joint.motor}
    return {name: [deviation for deviation, _ in c.curve] for name, c in given.items() if c.curve is not None}


def _motor_metadata(model: Model) -> dict[str, Any]:
    """Which coordinate every motor drives, and the description's ratio, where there are motors."""
    motors = {}
    for index, principal in model.motors.items():
        name = model.coordinates[index]
        motor = model.robot.joint(name.rpartition(".")[0]).motor
        assert motor is not None
        motors[name] = [model.coordinates[principal], motor.ratio]
    return {"motors": motors} if motors else {}


def _loop_metadata(model: Model) -> dict[str, Any]:
    """The loops' types and the components of their constraint, where there are loops."""
    loops = {loop.name: loop.type for loop in model.robot.loops}
    return {"loops": loops, "constraints": model.constraints} if loops else {}


def survivors(model: Model) -> dict[str, list[str]]:
    """What does not vanish identically: bits as hexadecimal digits, the first entry in the highest bit.

    A text per coordinate s: of M_sv the bits of all v, of C_s,vw those of all v <= w, row by row.
    """
    zeros = zero_map(model)
    v, w = np.triu_indices(model.size)
    rows = {
        "mass_matrix": zeros.mass_matrix.mask,
        "christoffel": zeros.christoffel.mask[:, v, w],
    }
    return {name: [np.packbits(row).tobytes().hex() for row in array] for name, array in rows.items()}


def operations(equations: Equations) -> dict[str, dict[str, int]]:
    """Multiplications, additions, divisions and sine-cosine pairs of every kernel's C, and of the parameters' setup."""
    counts = {name: equations.programs[name].count() for name in equations.programs}
    if "christoffel" in equations.loops:
        counts["christoffel"] = {key: equations.model.size * n for key, n in counts["coriolis_matrix"].items()}
    if "forward_dynamics_jacobian" in equations.loops:
        parts = (counts["forward_dynamics"], counts["residual_jacobian"], solve_operations(equations.model))
        counts["forward_dynamics_jacobian"] = {key: sum(part[key] for part in parts) for key in parts[0]}
    if "rollout" in equations.loops:
        counts["rollout"] = counts["implicit_step"]  # of one linearly implicit step
    public = {name: counts[name] for name in KERNELS if name in counts and name in equations.kernels}
    return {**public, "parameters": equations.setup.count()}
