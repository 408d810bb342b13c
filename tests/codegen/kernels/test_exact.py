"""Every program of a robot beside the recursion as it stands in the theory, without any rounding: they are equal.

A program is regrouped, folded, shared, pruned and factored; the recursion of the same robot here is none of that: all
its numbers take part, zeros too, and no value stands for two.  Both are compared modulo a prime at a random point
(``tests/oracles/exact_field.py``).  What frames' choice turns by an angle that is no rational number is left out of
this; it is compared in floating point elsewhere.
"""

from __future__ import annotations

import random
from collections.abc import Iterable, Mapping, Sequence
from fractions import Fraction
from functools import cache
from itertools import pairwise
from typing import Any

import pytest

import eomgen
from eomgen.codegen.kernels.derived import MOTION
from eomgen.codegen.kernels.equations import Equations, derive_equations
from eomgen.codegen.kernels.signatures import SIGNATURES, available
from eomgen.codegen.kernels.writers import VARIANTS, WRITERS
from eomgen.codegen.program.ir import Program
from eomgen.description.builtin import builtin_robots
from eomgen.robot.model import Model, build_model
from eomgen.robot.value import Robot
from tests.oracles.exact_field import PRIME, Orthogonal, Residue, over_rationals, recursion, residue, values
from tests.support.bending_robots import bent
from tests.support.random_robots import random_robot, seeds

QUICK = {
    "one_link": ("residual", "forward_dynamics", "energy"),
    "ur5": ("mass_matrix",),
    "worn_arm": ("generalized_force",),
}
DIFFERENTIATED = ("inverse_dynamics", "mass_matrix", "energy", "forward_dynamics", "residual")
POINTS = 40  # that are tried where equality needs roots, which half of all residues have
SHORT = {"dt", "times", "pair_times"}  # of whole steps: small and greater than 0


class Point(dict[str, Any]):
    """Random inputs of programs, each array as large as it is read; run-time parameters are the robot's."""

    def __init__(self, model: Model, seed: int = 0, rates: Mapping[str, str] | None = None) -> None:
        super().__init__()
        self.seed, self.rates = seed, rates or {}
        self["p"] = [residue(x) for x in model.parameters.values()] + [residue(0.0)] * len(model.turning)

    def __missing__(self, array: str) -> Sequence[Residue]:
        self[array] = _Entries(self, array)
        return self[array]  # type: ignore[no-any-return]


class _Entries(Sequence[Residue]):
    """An array of random numbers that is as long as somebody reads it."""

    def __init__(self, point: Point, array: str) -> None:
        self.point, self.array = point, array

    def __getitem__(self, index: Any) -> Any:
        x = self.number(self.array, index)
        rate = self.point.rates.get(self.array)
        return Residue(x.residue, x.size, self.number(rate, index).residue) if rate else x

    def __len__(self) -> int:
        raise AssertionError("as long as somebody reads it")

    def number(self, array: str, index: int) -> Residue:
        sign, most = (1, 97) if array in SHORT else (-1, 1009)
        draw = random.Random(f"{self.point.seed} {array} {index}")
        return residue(Fraction(draw.randint(1, most - 1) * draw.choice((1, sign)), 10 * most if sign > 0 else most))


def _setup(equations: Equations, point: Point) -> Point:
    """Compute what depends on parameters alone, too."""
    hoisted = values(equations.setup, point)
    point["h"] = [hoisted["h", i] for i in range(len(hoisted))]
    return point


def _kernels(model: Model) -> list[str]:
    kinds = ("program", "frames")
    return [
        name for name in available(model) if SIGNATURES[name].kind in kinds and (name in WRITERS or name in VARIANTS)
    ]


def _outputs(found: Mapping[tuple[str, int], Residue]) -> dict[int, int]:
    return {place: x.residue for (array, place), x in found.items() if array == "out"}


def _check(robot: Robot, kernels: Iterable[str] = ()) -> None:
    """Compare programs of a robot with the recursion."""
    model, orthogonal = build_model(robot), Orthogonal()
    with over_rationals(orthogonal):
        equations = derive_equations(model, tuple(kernels) or tuple(_kernels(model)))
    for name, program in equations.programs.items():
        if name in WRITERS or name in VARIANTS:
            plain = recursion(model, name, orthogonal)
            assert len(plain.instructions) >= len(program.instructions), name
            points = (_setup(equations, Point(model, seed)) for seed in range(POINTS))
            agreeing = (_outputs(values(program, point)) == _outputs(values(plain, point)) for point in points)
            assert any(agreeing), f"{robot.name}: {name}"


@cache
def _builtin(name: str) -> Robot:
    return eomgen.load_robot(name)


@pytest.mark.parametrize("name", QUICK)
def test_programs_equal_the_recursion(name: str) -> None:
    _check(_builtin(name), QUICK[name])


@pytest.mark.soak
@pytest.mark.parametrize("name", builtin_robots())
def test_all_programs_of_all_robots_equal_the_recursion(name: str) -> None:
    _check(_builtin(name))


@pytest.mark.parametrize("seed", seeds(700, 1, 30))
def test_programs_of_random_robots_equal_the_recursion(seed: int) -> None:
    _check(random_robot(seed), ("mass_matrix", "forward_dynamics"))


@pytest.mark.parametrize("seed", seeds(740, 0, 8))
def test_programs_of_robots_that_bend_equal_the_recursion(seed: int) -> None:
    _check(bent(random_robot(seed), seed).robot)


def test_a_lost_term_is_found() -> None:
    """Leave out one summand or factor after the other: some number of the program is another each time."""
    model, orthogonal = build_model(_builtin("ur5")), Orthogonal()
    with over_rationals(orthogonal):
        equations = derive_equations(model, ("mass_matrix",))
    point = _setup(equations, Point(model))
    expected = _outputs(values(recursion(model, "mass_matrix", orthogonal), point))
    program = equations.programs["mass_matrix"]
    tried = 0
    for index, instruction in enumerate(program.instructions):
        if instruction.op in ("add", "sub", "mul"):
            lost = program.instructions[instruction.args[0]]
            changed = [*program.instructions[:index], lost, *program.instructions[index + 1 :]]
            other = Program(program.name, tuple(changed), program.outputs)
            assert _outputs(values(other, point)) != expected, f"{index}: {instruction}"
            tried += 1
    assert tried > 100


def _rates(found: Mapping[tuple[str, int], Residue]) -> dict[int, int]:
    return {place: x.rate for (array, place), x in found.items() if array == "out"}


def _derivatives(robot: Robot, kernel: str) -> None:
    """Compare derivatives of a kernel with formal ones of the recursion: tangents, adjoints, Hessians, jets."""
    model, orthogonal = build_model(robot), Orthogonal()
    kinds = ("tangent", "adjoint", "hessian", "jet1", "jet2", "jet3")
    names = [f"{kernel}_{kind}" for kind in kinds if f"{kernel}_{kind}" in available(model)]
    with over_rationals(orthogonal):
        programs = derive_equations(model, tuple(names))
    plain = recursion(model, kernel, orthogonal)
    reads = SIGNATURES[kernel].reads

    def run(name: str, rates: Mapping[str, str]) -> dict[tuple[str, int], Residue]:
        return values(programs.programs[name], _setup(programs, Point(model, rates=rates)))

    directions = {array: f"d{array}" for array in reads}
    slopes = _rates(values(plain, Point(model, rates=directions)))
    assert _outputs(run(f"{kernel}_tangent", {})) == slopes
    adjoint = run(f"{kernel}_adjoint", directions)
    point = Point(model)
    weights = SIGNATURES[f"{kernel}_adjoint"].reads[-1]
    along = [(array, i) for array in reads for i in range(model.size)]
    assert _dot(_outputs(adjoint).values(), (point[f"d{array}"][i].residue for array, i in along)) == _dot(
        slopes.values(), (point[weights][place].residue for place in slopes)
    )
    if f"{kernel}_hessian" in names:
        hessian, size = _outputs(run(f"{kernel}_hessian", {})), len(along)
        rows = [[hessian[i * size + j] for j in range(size)] for i in range(size)]
        direction = [point[f"d{array}"][i].residue for array, i in along]
        assert [_dot(row, direction) for row in rows] == [*_rates(adjoint).values()]
    in_time = dict(pairwise(MOTION)) | {"u": "u1", "u1": "u2", "u2": "u3"}
    last, count = values(plain, Point(model, rates=in_time)), len(slopes)
    for order in (1, 2, 3):
        jet = run(f"{kernel}_jet{order}", in_time)
        highest = [_outputs(jet)[order * count + i] for i in range(count)]
        assert highest == [*_rates(last).values()][-count:], f"{kernel}, order {order}"
        last = jet


def _dot(one: Iterable[int], other: Iterable[int]) -> int:
    return sum(x * y for x, y in zip(one, other, strict=True)) % PRIME


@pytest.mark.parametrize("kernel", ["inverse_dynamics", "energy"])
def test_derivatives_equal_those_of_the_recursion(kernel: str) -> None:
    _derivatives(_builtin("one_link"), kernel)


@pytest.mark.soak
@pytest.mark.parametrize("kernel", DIFFERENTIATED)
@pytest.mark.parametrize("name", ["one_link", "ur5", "worn_arm", "shaken_arm", "geared_arm", "flexible_arm"])
def test_derivatives_of_robots_equal_those_of_the_recursion(name: str, kernel: str) -> None:
    _derivatives(_builtin(name), kernel)


@pytest.mark.parametrize("name", ["one_link", pytest.param("ur5", marks=pytest.mark.soak)])
@pytest.mark.parametrize("kernel", ["residual_jacobian", "forward_dynamics_jacobian"])
def test_jacobians_equal_those_of_the_recursion(name: str, kernel: str) -> None:
    """They are compared along a direction: J d is the formal derivative of the recursion."""
    model, orthogonal = build_model(_builtin(name)), Orthogonal()
    with over_rationals(orthogonal):
        equations = derive_equations(model, (kernel,))
    of = "residual" if kernel == "residual_jacobian" else "forward_dynamics"
    reads, n = SIGNATURES[kernel].reads, model.size
    plain = recursion(model, of, orthogonal)
    point = _setup(equations, Point(model, rates={array: f"d{array}" for array in reads}))
    slopes = _rates(values(plain, point))
    found = _outputs(values(equations.programs[kernel], _setup(equations, Point(model))))
    direction = {array: [point[f"d{array}"][i].residue for i in range(n)] for array in reads}
    for i in range(n):
        row = (
            _dot((found[(block * n + i) * n + j] for j in range(n)), direction[array])
            for block, array in enumerate(reads)
        )
        assert sum(row) % PRIME == slopes[i], f"{kernel}, row {i}"
