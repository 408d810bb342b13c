"""Robots with everything that forces can be, and states of them, for the adapters' tests."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

import eomgen
from eomgen.adapters.mappings import FUNCTIONS, DifferentiableFunction, kernels_for
from eomgen.codegen.kernels.derived import FRAMED
from eomgen.robot.value import Robot
from tests.oracles.force_laws import KINDS as LAWS
from tests.oracles.force_laws import with_laws
from tests.support.bending_robots import bent
from tests.support.random_motors import geared_robot, motor_state
from tests.support.random_robots import Array, State, random_robot, random_state, with_random_loops
from tests.support.random_springs import with_springs

KINDS = ("plain", "laws", "motors", "springs", "loops")
BENDING = 4199  # a seed for a robot whose link bends, by two modes that are coupled
TYPES = ("revolute", "prismatic", "fixed", "free")


def sample(seed: int) -> Robot:
    """A random robot; its forces, motors or loops are chosen by the seed."""
    if seed == BENDING:
        return bent(random_robot(1, (1, 1)), 1, (2,), second=True).robot
    kind = KINDS[seed % len(KINDS)]
    if kind == "motors":
        return geared_robot(seed, (1, 3), kinds=LAWS, prescribed=0.3)
    robot = random_robot(
        seed, joints=(2, 2), tree=seed % 2 == 0, types=TYPES, rods=False
    )  # a rod about its axis: no inverse
    if kind == "loops":
        return with_random_loops(robot, seed, ("spherical", "revolute"))
    return {"plain": lambda r, _: r, "laws": with_laws, "springs": with_springs}[kind](robot, seed)


def states(robot: Robot, kernel: eomgen.Kernel, seed: int) -> dict[str, Array]:
    """A random state and wrenches by the names of arrays."""
    if robot.modal_coordinates:
        rng = np.random.default_rng([seed, 9])
        s = State(*rng.uniform(-0.3, 0.3, (4, kernel.n)))
    else:
        s = (motor_state if kernel.motors else random_state)(robot, seed)
    wrench = np.random.default_rng(seed).uniform(-2.0, 2.0, (len(kernel.links), 6))
    return {"q": s.q, "v": s.v, "z": s.z, "a": s.a, "u": s.u, "wrench": wrench}


def built_for(robot: Robot, built: Callable[..., eomgen.Kernel]) -> eomgen.Kernel:
    """With all that the adapters can use."""
    return built(robot, *kernels_for(*names_of(robot), cut=bool(robot.loops)))


def names_of(robot: Robot) -> list[str]:
    """Of what there is for open loops, too: no forces of a constraint that no state may meet."""
    return [
        name for name in FUNCTIONS if name != "constraint_forces" and (not name.startswith("constraint") or robot.loops)
    ]


def functions_of(robot: Robot, kernel: eomgen.Kernel) -> Iterator[DifferentiableFunction]:
    """All of them, those of frames for the tool."""
    for name in names_of(robot):
        yield DifferentiableFunction(kernel, name, "tcp" if name in FRAMED else None, cut=True)


def differences(function: DifferentiableFunction, arrays: list[Array], at: int, step: float = 1e-5) -> Array:
    """Central differences by one argument: (output shape, its shape)."""
    columns = []
    for place in np.ndindex(arrays[at].shape):
        ends = []
        for sign in (1.0, -1.0):
            moved = [array.copy() for array in arrays]
            moved[at][place] += sign * step
            ends.append(function.value(*moved))
        columns.append((ends[0] - ends[1]) / (2.0 * step))
    return np.moveaxis(np.array(columns), 0, -1).reshape(*function.output, *arrays[at].shape)


def second_differences(function: DifferentiableFunction, arrays: list[Array], step: float = 1e-5) -> Array:
    """Central differences of the Jacobian by all numbers of the arguments: (output shape, numbers, numbers)."""
    flat, ends = np.concatenate([x.ravel() for x in arrays]), np.cumsum([x.size for x in arrays])[:-1]
    columns = []
    for unit in np.eye(flat.size):
        there, before = (
            function.jacobian(*(x.reshape(y.shape) for x, y in zip(np.split(moved, ends), arrays, strict=True)))
            for moved in (flat + step * unit, flat - step * unit)
        )
        columns.append((there - before) / (2.0 * step))
    return np.stack(columns, axis=-1)
