"""Bounds of rounding errors of a kernel's results in given states."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from eomgen.codegen.kernels.equations import derive_equations
from eomgen.codegen.kernels.signatures import KERNELS, shapes
from eomgen.description import RobotLike, as_robot
from eomgen.precision.adjoints import bound_outputs
from eomgen.precision.programs import with_setup
from eomgen.precision.values import program_intervals
from eomgen.robot.model import build_model

Array = np.ndarray[Any, Any]


def bounds_at(robot: RobotLike, kernel: str, dtype: str, arrays: Sequence[Array]) -> tuple[Array, Array]:
    """Return the largest bounds of these states, of a result's shape: each operation rounded, and products fused.

    Args:
        robot, kernel, dtype: as of ``rounding_bound``.
        arrays: that the kernel reads, in its order, (states, ...).
    """
    equations = derive_equations(build_model(as_robot(robot)), (kernel,), dtype)
    program = with_setup(equations.programs[kernel], equations.setup)
    count = len(arrays[0])
    inputs = {name: x.reshape(count, -1).T for name, x in zip(KERNELS[kernel].reads, arrays, strict=True)}
    inputs["p"] = np.array([[np.dtype(dtype).type(x)] * count for x in equations.model.parameters.values()])
    points = {name: [(row.astype(np.float64),) * 2 for row in rows] for name, rows in inputs.items()}
    found = program_intervals(program, dtype, points)
    places = {place: index for (_, place), index in program.outputs.items()}
    assert all(found.obstacles[index] < 0 for index in places.values())
    shape = shapes(equations.model)[KERNELS[kernel].writes]
    plain, fused = np.zeros(math.prod(shape)), np.zeros(math.prod(shape))
    bounds = bound_outputs(found, list(places.values()))
    plain[list(places)], fused[list(places)] = bounds.plain, bounds.fused
    return plain.reshape(shape), fused.reshape(shape)
