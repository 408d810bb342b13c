"""A thousand random robots, each known by its number, with everything that a check of one of them needs.

Serial and trees, 1 to 36 coordinates, 0 to 6 of them in a joint, links that weigh something in every direction.  Each
is compiled once, in a form that its number chooses; the generator's other forms run as programs on NumPy arrays.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

import eomgen
from eomgen.codegen.kernels import equations
from eomgen.codegen.kernels.derivation import Derivation
from eomgen.codegen.kernels.writers import WRITERS
from eomgen.codegen.program.ir import Program, evaluate, finish
from eomgen.codegen.program.passes import run_passes
from eomgen.robot.model import Model, build_model
from eomgen.robot.parameter_names import parameters
from eomgen.robot.value import Robot
from tests.support.other_numbers import changed
from tests.support.random_robots import Array, random_robot, random_state

ROBOTS, STATES = 1000, 100
MOST = 36  # coordinates of a robot
ALWAYS = ("mass_matrix", "inverse_dynamics", "reactions", "forward_dynamics", "kinematics")
FORMS = {  # what a robot's number chooses in turn: a form, and the kernels that are compiled besides
    "folded, christoffel": ("coriolis_matrix", "christoffel"),
    "parameters": (),
    "folded, jacobians": ("residual_jacobian", "forward_dynamics_jacobian"),
    "folded": (),
    "parameters, jacobians": ("residual_jacobian",),
    "folded, energy": ("energy", "bias_force"),
    "parameters, residual": ("residual", "generalized_force"),
    "fused": (),
}


def sincos(x: Array) -> tuple[Array, Array]:
    return np.sin(x), np.cos(x)


def many_robot(number: int) -> Robot:
    """Robot of that number: every size up to 36 coordinates among each thousand, small ones most often."""
    rng = np.random.default_rng([2026, number])
    size = min(MOST, 1 + int(rng.exponential(4.5)))
    if number % 27 == 0:
        size = 1 + number // 27 % MOST
    elif number % 200 == 100:
        size = MOST
    rigid = rng.random() < 0.3
    joints = size if rigid else int(rng.integers(-(-size // 6), size + 1))
    counts = np.ones(size, dtype=int) if rigid else np.zeros(joints, dtype=int)
    while counts.sum() < size:
        counts[rng.choice(np.flatnonzero(counts < 6))] += 1
    return random_robot(
        rng, counts=tuple(counts.tolist()), tree=bool(rng.random() < 0.5), rigid=rigid, rods=False,
        types=("revolute", "prismatic", "fixed", "free"), name=f"many{number}",
    )  # fmt: skip


def tunable(robot: Robot) -> Robot:
    """Every number of links and joints a run-time parameter, but offsets: these make coordinates of all angles."""
    names = [".".join(item.path) for item in parameters(robot) if item.is_set]
    return replace(robot, tunable=tuple(name for name in names if not name.startswith("frames.")))


def derived(model: Model, kernel: str, regrouped: bool) -> Program:
    """The kernel's program in the description's frames, or in those that cost least."""
    derivation = Derivation(model, regrouped=regrouped)
    return run_passes(finish(derivation.graph, kernel, WRITERS[kernel](derivation)))


def run(program: Program, model: Model, arrays: Mapping[str, Array], p: Sequence[float] | None = None) -> Array:
    """The program's outputs, (..., outputs), of inputs (..., n) of any kind of number."""
    given = {name: list(np.moveaxis(array, -1, 0)) for name, array in arrays.items()}
    found = evaluate(program, {**given, "p": list(model.parameters.values()) if p is None else list(p)}, sincos)
    shape = next(iter(arrays.values())).shape[:-1]
    outputs = [found["out", i] for i in range(sum(name == "out" for name, _ in found))]
    return np.stack([np.broadcast_to(value, shape) for value in outputs], axis=-1)


@dataclass(frozen=True)
class Subject:
    """A robot with its compiled kernel, and STATES random states, (STATES, n) each."""

    robot: Robot
    kernel: eomgen.Kernel
    q: Array
    v: Array
    a: Array
    u: Array
    form: str

    @cached_property
    def model(self) -> Model:
        return build_model(self.robot)

    @cached_property
    def kept(self) -> Model:
        """The model with every number a run-time parameter."""
        return build_model(tunable(self.robot))

    @cached_property
    def _programs(self) -> dict[str, Program]:
        return {}

    def program(self, kernel: str) -> Program:
        """The folded program, derived once."""
        if kernel not in self._programs:
            self._programs[kernel] = equations.derive(self.model, kernel)
        return self._programs[kernel]

    def run(self, kernel: str, **arrays: Array) -> Array:
        """The folded program on arrays (..., n) by their names."""
        return run(self.program(kernel), self.model, arrays)

    @cached_property
    def M(self) -> Array:
        return self.kernel.mass_matrix(self.q)

    @cached_property
    def drives(self) -> Array:
        return self.kernel.inverse_dynamics(self.q, self.v, self.a)

    @cached_property
    def forces(self) -> Array:
        """Greatest sum of the absolute terms of inverse dynamics in each state, (states,).

        Round-off goes with these: with few coordinates the terms may cancel to almost nothing.
        """
        given = [c for joint in self.robot.joints for c in joint.coordinates.values()]
        stiffness, damping = (np.array([getattr(c, key) or 0.0 for c in given]) for key in ("stiffness", "damping"))
        springs, dampers = np.abs(stiffness * self.q), np.abs(damping * self.v)
        still = 0.0 * self.v
        weights = np.abs(self.kernel.inverse_dynamics(self.q, still, still)) + springs
        bias = np.abs(self.run("bias_force", q=self.q, v=self.v))
        return size_of(times(np.abs(self.M), np.abs(self.a)) + bias + weights + springs + dampers)

    def part(self, count: int) -> Subject:
        """The first states alone."""
        first = {name: getattr(self, name)[:count] for name in "qvau"}
        return replace(self, **first)  # type: ignore[arg-type]


def subject(number: int, build: Callable[..., eomgen.Kernel], states: int = STATES) -> Subject:
    """The robot compiled in the form of its number.

    With parameters it is compiled with other numbers than its own, which are then assigned.
    """
    robot, form = many_robot(number), list(FORMS)[number % len(FORMS)]
    rng = np.random.default_rng([2027, number])
    drawn = [random_state(robot, rng) for _ in range(states)]
    q, v, a, u = (np.array([getattr(state, name) for state in drawn]) for name in "qvau")
    kernels = ALWAYS + FORMS[form]
    if "parameters" in form:
        source = tunable(robot)
        own = build_model(source).parameters
        other = {name: value * 0.75 + 0.3 for name, value in own.items()}
        kernel = build(replace(changed(source, other), tunable=source.tunable), *kernels)
        kernel.parameters.update(own)
    elif form == "fused":  # where nothing is optimised, nothing is fused
        kernel = build(robot, *kernels, native=True, flags=("-O1",))
    else:
        kernel = build(robot, *kernels)
    return Subject(robot, kernel, q, v, a, u, form)


def size_of(values: Array) -> Array:
    """Greatest absolute value of each state, (states,)."""
    return np.asarray(np.abs(values).reshape(len(values), -1).max(axis=1, initial=0.0))


def differences(found: Array, expected: Array, size: Array | None = None) -> float:
    """Greatest deviation of a state, relative to the max-norm of what is expected there, or to ``size``."""
    if size is None:
        size = size_of(expected)
    return float((size_of(np.asarray(found) - expected) / np.maximum(size, 1e-300)).max())


def times(matrix: Array, vector: Array) -> Array:
    return np.asarray(np.einsum("...ij,...j->...i", matrix, vector))


@contextmanager
def named(what: str) -> Iterator[None]:
    """Says of a failed check which robot it was."""
    try:
        yield
    except Exception as error:
        raise AssertionError(f"{what}: {error}") from error
