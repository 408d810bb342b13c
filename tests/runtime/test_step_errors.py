"""Bounds of errors: of linearly implicit steps, against 60 digits, and of solutions, against what is worst."""

from __future__ import annotations

from functools import partial
from typing import Any

import mpmath
import numpy as np
import pytest

from eomgen.codegen.kernels.equations import derive
from eomgen.codegen.program.ir import Program, evaluate
from eomgen.codegen.program.operations import CALLS
from eomgen.description.load import load_robot
from eomgen.errors import ArrayError, InputError, UnknownNameError
from eomgen.robot.model import build_model
from eomgen.robot.value import Robot
from eomgen.runtime import Kernel
from eomgen.runtime.derivatives import implicit_steps
from eomgen.runtime.derivatives.assemblies import assembled_errors
from eomgen.runtime.derivatives.equations_of_motion import linear_errors
from eomgen.runtime.derivatives.extended import Extended
from eomgen.runtime.derivatives.solution_errors import enclosed_inverse, matrix_of
from eomgen.runtime.raw import Array
from tests.codegen.program.test_running_errors import HIGH
from tests.runtime.test_closed_errors import built_closed, state_of
from tests.support.bending_mixtures import PARTS, mixture
from tests.support.builds import Build
from tests.support.figures import Figures
from tests.support.soak import soaked

pytestmark = pytest.mark.quick

DTYPES = ("float64", "float32")
TREES = tuple(part for part in PARTS if part != "loops")
STEP = "implicit_step"
CONSTANTS = 1e-12  # products of constants are rounded while programs are written, in other orders


def stepping(build: Build, robot: Robot, dtype: str = "float64") -> Kernel:
    return build(robot, "rollout", "step_residual_extended", dtype=dtype)


def arrays(kernel: Kernel, seed: int, count: tuple[int, ...] = ()) -> dict[str, Any]:
    rng = np.random.default_rng(seed)
    return {
        x: (rng.uniform(-1.0, 1.0, (*count, kernel.n)) * size).astype(kernel.dtype)
        for x, size in (("q", 0.1), ("v", 1.0), ("u", 1.0))
    }


class Exact:
    """A step at 60 digits: its equations solved, and the eliminated program that integrations run."""

    def __init__(self, kernel: Kernel, robot: Robot) -> None:
        model, self.kernel = build_model(robot), kernel
        self.equations, self.eliminated = (derive(model, name, str(kernel.dtype)) for name in ("step_residual", STEP))
        self.parameters = [mpmath.mpf(float(np.asarray(x, kernel.dtype))) for x in kernel.parameters.values()]

    def run(self, program: Program, inputs: dict[str, Any]) -> list[Any]:
        calls = {op: partial(HIGH[op]) for op in CALLS}
        inputs = {**inputs, "p": self.parameters}
        out = evaluate(program, inputs, lambda y: (mpmath.sin(y), mpmath.cos(y)), calls)
        return [out["out", i] for i in range(sum(key[0] == "out" for key in out))]

    def end(self, x: dict[str, Any], dt: float) -> tuple[list[Any], list[Any]]:
        """Return q and v at the end of a step, which the eliminated program has, too."""
        n, step = self.kernel.n, mpmath.mpf(float(self.kernel.dtype.type(dt)))
        inputs = {name: [mpmath.mpf(float(y)) for y in array] for name, array in x.items()}
        still = [mpmath.mpf(0)] * n

        def left(v: list[Any]) -> list[Any]:
            return self.run(self.equations, {**inputs, "step_length": [step], "end_q": still, "end_v": v})[:n]

        zero = left(still)
        columns = [left([mpmath.mpf(i == j) for i in range(n)]) for j in range(n)]
        K = mpmath.matrix([[columns[j][i] - zero[i] for j in range(n)] for i in range(n)])
        v = list(mpmath.lu_solve(K, mpmath.matrix([-number for number in zero])))
        accelerations = self.run(self.eliminated, {**inputs, "added": still, "dt": [step, step * step]})
        size = max(map(abs, v))
        for rate, begin, a in zip(v, inputs["v"], accelerations, strict=False):
            assert abs(begin + step * a - rate) <= CONSTANTS * size
        return [at + step * rate for at, rate in zip(inputs["q"], v, strict=True)], v


def check(kernel: Kernel, robot: Robot, seed: int) -> float:
    """Check bounds in steps of two lengths; return the larger median by the size of states, in units of rounding.

    Some are large where rounding may change a case of a law.
    """
    worst = 0.0
    with mpmath.workdps(60):
        exact = Exact(kernel, robot)
        for dt in (1e-4, 1e-2):
            x = arrays(kernel, seed)
            found = kernel.with_errors(STEP, (x["q"], x["v"], x["u"], dt))
            q, v = kernel.rollout(x["q"], x["v"], x["u"], dt, 1, method="implicit")
            assert np.array_equal(found.value, [q[1], v[1]])
            assert found.proved
            for value, bound, right in zip(found.value, found.bound, exact.end(x, dt), strict=True):
                for number, most, true in zip(value, bound, right, strict=True):
                    assert abs(mpmath.mpf(float(number)) - true) <= mpmath.mpf(float(most))
                share = float(np.median(bound) / max(np.abs(value).max(), 1e-2) / np.finfo(kernel.dtype).eps)
                worst = max(worst, share)
    return worst


@pytest.mark.parametrize(("name", "dtype"), [("one_link", "float64"), ("worn_arm", "float32")])
def test_states_after_steps_are_within_bounds(built: Build, name: str, dtype: str) -> None:
    robot = load_robot(name)
    assert 0.0 < check(stepping(built, robot, dtype), robot, 0) < 1e3


@pytest.mark.soak
@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("name", ["geared_arm", "shaken_arm", "flexible_arm", "ur5", "puma560_elastic"])
def test_states_of_arms_after_steps_are_within_bounds(built: Build, name: str, dtype: str, figures: Figures) -> None:
    robot = load_robot(name)
    figures.at_most("bound by the state, roundings", check(stepping(built, robot, dtype), robot, 0), 1e3)


@pytest.mark.parametrize("seed", soaked(range(20), (0,)))
def test_states_of_random_trees_after_steps_are_within_bounds(built: Build, seed: int, figures: Figures) -> None:
    robot = mixture(seed, TREES[seed % 2 :: 2] if seed % 3 else TREES, modes=(1, 2)).robot
    if build_model(robot).turning:
        pytest.skip("joints with 3-DOF rotation")
    kernel = stepping(built, robot, DTYPES[seed % 2])
    figures.at_most("bound by the state, roundings", check(kernel, robot, seed), 1e10)


@pytest.mark.parametrize("fault", [1e-6, 1e-12])
def test_a_wrong_step_is_within_its_bound(built: Build, fault: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """Bounds are of what a state leaves of the equations, whatever spoilt it: they grow with the fault."""
    kernel = stepping(built, load_robot("one_link"))
    x, right = arrays(kernel, 1, (3,)), implicit_steps.rollout
    args = (x["q"], x["v"], x["u"], 1e-3)
    value = kernel.with_errors(STEP, args).value
    for place in (0, 1):

        def faulty(*given: Any, place: int = place) -> Any:
            moved = [array.copy() for array in right(*given)]
            moved[place][:, 1] += fault
            return tuple(moved)

        monkeypatch.setattr(implicit_steps, "rollout", faulty)
        found = kernel.with_errors(STEP, args)
        off = np.abs(found.value - value)
        assert (off[:, place] > 0.5 * fault).all()
        assert (found.bound >= off * (1.0 - 1e-3)).all()
        assert found.bound.max() < 1.01 * fault + 1e-15


def test_steps_of_batches_and_what_is_refused(built: Build) -> None:
    kernel = stepping(built, load_robot("one_link"))
    x = arrays(kernel, 2, (70,))
    found = kernel.with_errors(STEP, (x["q"], x["v"], np.zeros(2), 1e-3))
    assert found.value.shape == found.bound.shape == (70, 2, 2)
    assert found.proved.all()
    assert kernel.bounded_methods() == (STEP,)
    alone = kernel.with_errors(STEP, (x["q"][69], x["v"][69], np.zeros(2), 1e-3))
    assert np.array_equal(alone.value, found.value[69])
    assert np.array_equal(alone.bound, found.bound[69])
    with pytest.raises(ArrayError, match=r"implicit_step: rounding moves the result in state \(0, 0, 0\)"):
        kernel.with_errors(STEP, (x["q"], x["v"], x["u"], 1e-3), most=0.0)
    with pytest.raises(InputError, match=r"implicit_step: got 3 arguments; allowed: \(q, v, u, dt\)"):
        kernel.with_errors(STEP, (x["q"], x["v"], x["u"]))
    with pytest.raises(InputError, match="dt"):
        kernel.with_errors(STEP, (x["q"], x["v"], x["u"], -1.0))
    without = built(load_robot("one_link"), "rollout", "mass_matrix")
    with pytest.raises(UnknownNameError, match="one_link has no bounds of rounding errors of 'implicit_step'"):
        without.with_errors(STEP, (x["q"], x["v"], x["u"], 1e-3))


def extended(value: Array, bound: Array | float = 0.0) -> Extended:
    return Extended(value, np.zeros_like(value), np.broadcast_to(np.asarray(bound, float), value.shape))


def drawn(seed: int, count: int, size: int, scales: float) -> tuple[Array, Array]:
    """Draw matrices (N, m, m) whose rows and columns have sizes of many powers of ten, and solutions of unit size."""
    rng = np.random.default_rng(seed)
    rows, columns = (10.0 ** rng.uniform(-scales, scales, (count, size)) for _ in range(2))
    K = rng.normal(size=(count, size, size)) + 2.0 * np.eye(size)
    return K * rows[:, :, None] * columns[:, None, :], rng.normal(size=(count, size)) / columns


@pytest.mark.parametrize("scales", [0.0, 4.0])
@pytest.mark.parametrize(("of_matrix", "of_rest"), [(1e-3, 0.0), (0.0, 1e-6), (1e-4, 1e-4), (0.0, 0.0)])
def test_solutions_of_the_worst_equations_are_within_bounds(of_matrix: float, of_rest: float, scales: float) -> None:
    """K is known within of_matrix of its entries, what is left within of_rest of the right sides."""
    reached = 0.0
    for seed in range(20):
        rng, size = np.random.default_rng([seed, 1]), 2 + seed % 5
        K, x = drawn(seed, 8, size, scales)
        error = of_matrix * np.abs(K)
        matrix = enclosed_inverse(K, error)
        assert matrix.proved.all() or of_matrix > 0.0
        true = K + error * rng.choice([-1.0, 1.0], K.shape)
        spoilt = x * (1.0 + 1e-2 * rng.normal(size=x.shape))
        left = np.einsum("nij,nj->ni", true, spoilt - x)
        within = of_rest * np.abs(np.einsum("nij,nj->ni", np.abs(K), np.abs(x)))
        found = matrix.errors(extended(left - within * rng.choice([-1.0, 1.0], left.shape), within))
        ratio = np.abs(spoilt - x) / found.bound
        assert (ratio[found.proved] <= 1.0 + 1e-9).all()
        reached = max(reached, float(ratio[found.proved].max(initial=0.0)))
    assert reached > 0.7, "some come near their bounds"


def test_what_the_error_of_a_matrix_makes_counts() -> None:
    """With K = 1 known within e, an answer x = 1 + d of K x = b that leaves (1 - e) d may be off by d."""
    for e in (0.3, 0.9, 0.999):
        matrix = enclosed_inverse(np.ones((1, 1, 1)), np.full((1, 1, 1), e))
        found = matrix.errors(extended(np.array([[(1.0 - e) * 0.25]])))
        assert found.proved.all()
        assert 0.25 <= found.bound[0, 0] <= 0.25 * (1.0 + 1e-9)
    assert not enclosed_inverse(np.ones((1, 1, 1)), np.ones((1, 1, 1))).proved.any()


def test_singular_equations_are_not_proved() -> None:
    value = np.array([[[1.0, 2.0], [2.0, 4.0]], [[1.0, 2.0], [2.0, 4.0 + 1e-3]], [[np.nan, 0.0], [0.0, 1.0]]])
    assert enclosed_inverse(value, np.zeros_like(value)).proved.tolist() == [False, True, False]
    assert enclosed_inverse(value, np.full_like(value, 1e-3)).proved.tolist() == [False, False, False]


def test_matrices_of_affine_equations() -> None:
    K, x = drawn(0, 3, 4, 2.0)
    right = np.einsum("nij,nj->ni", K, x)
    within = 1e-9

    def equations(points: Array) -> Extended:
        return extended(np.einsum("nij,npj->npi", K, points) - right[:, None], within)

    value, error = matrix_of(equations, 3, 4, np.dtype("float64"))
    size = np.abs(K).max() + np.abs(right).max()
    assert np.abs(value - K).max() <= 4.0 * np.finfo(float).eps * size
    assert (error >= 2.0 * within).all(), "of the equations at a unit vector, and at zero"
    assert (error <= 2.0 * within * (1.0 + 1e-6) + 1e-15 * np.abs(K)).all()


def test_what_errors_of_unknowns_make_of_functions() -> None:
    """The worst signs of errors, and of errors of the functions' coefficients, reach the bound."""
    rng = np.random.default_rng(0)
    columns, zero, errors = rng.normal(size=(2, 3, 5)), rng.normal(size=(2, 1, 5)), rng.uniform(0.1, 1.0, (2, 3))
    bound = linear_errors(extended(columns, 1e-3), extended(zero, 2e-3), errors)
    worst = np.einsum("nkr,nk->nr", np.abs(columns - zero) + 3e-3, errors)
    assert (bound >= worst).all()
    assert (bound <= worst * (1.0 + 1e-9)).all()


@pytest.mark.parametrize("off", [1e-6, 1e-10, 1e-13])
def test_states_that_are_not_quite_assembled(built: Build, off: float) -> None:
    """The distance of a state whose dependent coordinates were moved is within its bound, which is not far from it."""
    kernel = built_closed(built, robot := load_robot("four_bar"))
    q, free = state_of(kernel, robot, 3)["q"], np.array([False, True, True])
    near = assembled_errors(kernel.calls, q[None], free)
    assert near.proved.all()
    for moved in (np.array([0.0, off, 0.0]), np.array([0.0, -off, off])):
        found = assembled_errors(kernel.calls, (q + moved)[None], free)
        assert found.proved.all()
        assert found.bound[0, 0] == 0.0
        assert (found.bound[0] >= np.abs(moved) - near.bound[0] - 1e-16).all()
        assert found.bound.max() <= 1.1 * off + 2.0 * near.bound.max() + 1e-14
