"""Beside a change point: accelerations that are as good as the constraint's condition allows, or a refusal.

The references are dense solutions in 50 digits at the same states (``tests.oracles.dense_solve``).
"""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import partial

import numpy as np
import pytest

import eomgen
from eomgen.codegen.c.contexts import PIVOT_LIMITS
from eomgen.codegen.kernels.constraint_rows import general_rank
from eomgen.codegen.kernels.equations import derive
from eomgen.codegen.program.ir import evaluate, first_values
from eomgen.errors import SingularError
from eomgen.robot.model import build_model
from tests.oracles.dense_solve import DenseSolve
from tests.support.change_points import ChangePoint, four_bar, rod_on_balls, spherical_bar, three_cranks, two_bars
from tests.support.random_robots import Array
from tests.support.soak import soaked

RIGHT = 1e-9  # of the largest acceleration
ALWAYS = 1e-4  # rad, as near as a state is answered where a dense solution in double precision is right
EPS = float(np.finfo(np.float32).eps)
KINDS: dict[str, Callable[[int], ChangePoint]] = {
    "four bars": four_bar,
    "four bars that stand": partial(four_bar, stands=True),
    "parallelogram": partial(four_bar, parallel=True),
    "three cranks": three_cranks,
}
SPATIAL: dict[str, Callable[[int], ChangePoint]] = {
    "spherical": spherical_bar,
    "spherical that stand": partial(spherical_bar, stands=True),
    "rod on balls": rod_on_balls,
    "two in a row": two_bars,
    "two, one regular": partial(two_bars, regular=True),
}
FIRST = int(os.environ.get("EOMGEN_FIRST_SEED", "2"))  # of the soak: other mechanisms with other ones
DISTANCES = [10.0**-k for k in (1, 2, 3, 3.5, 4, 4.5, 5, 5.5, 6, 6.5, 7, 7.5, 8)]
State = tuple[Array, Array, Array]


class Found:
    """What the program of constrained_dynamics makes of a mechanism's states, in the numbers of a dtype."""

    def __init__(self, case: ChangePoint, dtype: str = "float64") -> None:
        self.case, self.dtype, self.model = case, np.dtype(dtype), build_model(case.robot)
        self.program = derive(self.model, "constrained_dynamics", dtype)
        self.dense = DenseSolve(case.robot, case.rank)

    def state(self, distance: float, rng: np.random.Generator) -> State:
        """A closed state at a distance (rad) from the change point: q, v and u, (n,) each."""
        at = self.case.at(distance)
        q = np.array([float(at[name]) for name in self.model.coordinates]).astype(self.dtype)
        v = self.dense.rates(q, rng.uniform(-2.0, 2.0, q.size)).astype(self.dtype)
        return q, v, rng.uniform(-5.0, 5.0, q.size).astype(self.dtype)

    def accelerations(self, state: State) -> Array | None:
        """Accelerations, (n,); None where they are refused."""
        number = self.dtype.type
        inputs = {name: [number(x) for x in values] for name, values in zip("qvu", state, strict=True)}
        inputs["p"] = [number(x) for x in [*self.model.parameters.values(), *(0.0 for _ in self.model.turning)]]
        with np.errstate(all="ignore"):
            found = evaluate(self.program, inputs, lambda x: (np.sin(x), np.cos(x)))
        n, limit = self.model.size, PIVOT_LIMITS[self.dtype.name]
        if not all(found["pivot", 2 * i] > limit * found["pivot", 2 * i + 1] for i in range(n)):
            return None
        return np.array([float(found["out", i]) for i in range(n)])


def error(found: Array, exact: Array) -> float:
    return float(np.abs(found - exact).max() / np.abs(exact).max())


def check_beside(kind: str, seed: int) -> None:
    """Compare answers at all distances with the dense solution: right or refused, and not refused far away."""
    found, rng = Found({**KINDS, **SPATIAL}[kind](seed)), np.random.default_rng(seed)
    for distance in DISTANCES:
        state = found.state(distance, rng)
        exact, a = found.dense.exact(*state), found.accelerations(state)
        if a is None:
            assert distance < 0.99 * ALWAYS or error(found.dense.plain(*state), exact) > RIGHT, distance
        else:
            assert error(a, exact) <= RIGHT, distance


@pytest.mark.parametrize("kind", soaked(KINDS, ("four bars", "three cranks")))
def test_beside_a_change_point(kind: str) -> None:
    for seed in range(2):
        check_beside(kind, seed)


@pytest.mark.parametrize("kind", soaked(SPATIAL, ("spherical", "rod on balls")))
def test_beside_a_change_point_in_space(kind: str) -> None:
    check_beside(kind, 0)


@pytest.mark.parametrize(
    ("make", "seed", "place"), [(four_bar, 1012, 5), (partial(four_bar, parallel=True), 47, 6), (spherical_bar, 19, 4)]
)
def test_where_the_directions_of_constraint_forces_are_uncertain(
    make: Callable[[int], ChangePoint], seed: int, place: int
) -> None:
    """Large multipliers that hardly push: accelerations that are wrong by more than 1e-9 were answered."""
    found, rng = Found(make(seed)), np.random.default_rng(seed)
    state = [found.state(distance, rng) for distance in DISTANCES[: place + 1]][-1]
    a = found.accelerations(state)
    assert a is None or error(a, found.dense.exact(*state)) <= RIGHT


@pytest.mark.soak
@pytest.mark.parametrize("seed", range(FIRST, FIRST + 10))
@pytest.mark.parametrize("kind", SPATIAL)
def test_many_in_space(kind: str, seed: int) -> None:
    check_beside(kind, seed)


@pytest.mark.soak
@pytest.mark.parametrize("seed", range(FIRST, FIRST + 58))
@pytest.mark.parametrize("kind", KINDS)
def test_many_beside_their_change_points(kind: str, seed: int) -> None:
    check_beside(kind, seed)


@pytest.mark.parametrize("kind", soaked(KINDS, ("four bars", "three cranks")))
def test_in_single_precision(kind: str) -> None:
    """Right to round-off by the least singular value, of which the distance is a part, or refused."""
    for seed in range(2):
        found, rng = Found(KINDS[kind](seed), "float32"), np.random.default_rng(seed)
        answered = 0
        for distance in (0.3, 0.1, 0.03, 0.01, 3e-3, 1e-3, 1e-4, 1e-5, 1e-6):
            state = found.state(distance, rng)
            a = found.accelerations(state)
            if a is not None:
                answered += distance >= 0.03
                assert error(a, found.dense.exact(*state)) <= 1000.0 * EPS / min(distance, 0.1), distance
        assert answered == 3


@pytest.mark.parametrize("home", [0.0, 0.9])
def test_cranks_of_which_one_is_redundant(home: float) -> None:
    """Wherever home is they are known to be redundant, answered away from the change point, and not wrong beside it."""
    case = three_cranks(5, home)
    assert general_rank(build_model(case.robot)) == 3
    found, rng = Found(case), np.random.default_rng(1)
    for angle in (0.3, 1.0, 2.0):
        state = found.state(angle, rng)
        a = found.accelerations(state)
        assert a is not None
        assert error(a, found.dense.exact(*state)) <= 1e-11
    for angle in (1e-6, 1e-8, 0.0):
        assert found.accelerations(found.state(angle, rng)) is None


@pytest.mark.soak
def test_what_is_regular_costs_no_more() -> None:
    """At most 5 % of the products of the first solution say whether it is good enough."""
    before = {"four_bar": 123, "bennett": 553, "andrews": 522, "delta": 4953}  # with nothing measured
    for name, products in before.items():
        model = build_model(eomgen.load_robot(name))
        program = derive(model, "constrained_dynamics")
        assert not all(first_values(program))
        assert program.count()["mul"] <= 1.05 * products, name


@pytest.mark.parametrize(
    ("kind", "dtype"),
    [("four bars that stand", "float64"), pytest.param("three cranks", "float32", marks=pytest.mark.soak)],
)
def test_a_state_has_the_same_bits_in_any_company(kind: str, dtype: str) -> None:
    """States that are refined and others share a vector; one that is refused is named."""
    found, rng = Found(KINDS[kind](0), dtype), np.random.default_rng(0)
    kernels = ("forward_dynamics", "constraint_forces", "constraint_jacobian", "mass_matrix")
    kernel = eomgen.build(found.case.robot, kernels=kernels, dtype=dtype, flags=("-O1", "-Werror"))
    near = (1e-2, 1e-4, 1e-5) if dtype == "float64" else (0.02, 0.01)
    states = [found.state(x, rng) for pair in zip((0.4, 0.5, 0.6), near, strict=False) for x in pair]
    q, v, u = (np.stack(x) for x in zip(*states, strict=True))
    for call in (kernel.forward_dynamics, kernel.constraint_forces):
        many = call(q, v, u)
        assert all(many[i].tobytes() == call(q[i], v[i], u[i]).tobytes() for i in range(len(q)))
    bad = found.state(1e-7 if dtype == "float64" else 1e-5, rng)
    q, v, u = (np.stack([*x, y]) for x, y in zip((q, v, u), bad, strict=True))
    with pytest.raises(
        SingularError, match=rf"is at a singular pose, or within round-off of one.* in state {len(q) - 1}"
    ):
        kernel.forward_dynamics(q, v, u)


@pytest.mark.soak
def test_derivatives_beside_a_change_point() -> None:
    """Derivatives by the drives, in which accelerations are linear, are those of dense solutions."""
    found, rng = Found(KINDS["parallelogram"](0)), np.random.default_rng(0)
    kernel = eomgen.build(found.case.robot, kernels=("forward_dynamics_jacobian",), flags=("-O1",))
    for distance in (0.3, 1e-2, 1e-3, 1e-4):
        q, v, u = found.state(distance, rng)
        rest = found.dense.exact(q, v, u)
        exact = np.stack([found.dense.exact(q, v, u + row) - rest for row in np.eye(q.size)], axis=-1)
        assert error(kernel.forward_dynamics_jacobian(q, v, u)[2], exact) <= RIGHT, distance
