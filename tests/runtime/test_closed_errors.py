"""Bounds of rounding errors of closed mechanisms: the same equations solved at 200 digits, exact states, refusals."""

from __future__ import annotations

from typing import Any

import mpmath
import numpy as np
import pytest

from eomgen.codegen.kernels.equations import derive
from eomgen.codegen.program.ir import Program, evaluate
from eomgen.description.load import load_robot
from eomgen.errors import ArrayError, LoopError
from eomgen.robot.model import Model, build_model
from eomgen.robot.value import Robot
from eomgen.runtime import Kernel
from eomgen.runtime.derivatives.equations_of_motion import moved_rows
from tests.support.builds import Build
from tests.support.random_robots import random_robot, with_random_loops
from tests.support.soak import soaked

pytestmark = pytest.mark.quick

OWN = (
    "forward_dynamics",
    "constraint_forces",
    "inverse_dynamics",
    "reactions",
    "loop_reactions",
    "constraint",
    "cut_poses",
)
EXTENDED = ("constrained_residual", "tree_reactions", "closing_reactions", "loop_wrenches", "constraint")
DIGITS = 200
Numbers = dict[str, Any]


def built_closed(build: Build, robot: Robot, dtype: str = "float64") -> Kernel:
    extended = [f"{name}_extended" for name in EXTENDED]
    loops = OWN if robot.loops else [name for name in OWN if name not in ("loop_reactions", "cut_poses")]
    return build(
        robot, *loops, "constraint_jacobian", "constraint_jacobian_around", *extended, "mass_matrix", dtype=dtype
    )


def state_of(kernel: Kernel, robot: Robot, seed: int) -> Numbers:
    """Draw an assembled state near home, which moves, and drives."""
    rng = np.random.default_rng(seed)
    home = np.array([robot.home.get(name, 0.0) for name in kernel.coordinates])
    q = kernel.assemble((home + 0.1 * rng.uniform(-1.0, 1.0, kernel.n)).astype(kernel.dtype))
    v = kernel.project_velocity(q, rng.uniform(-1.0, 1.0, kernel.n).astype(kernel.dtype))
    return {"q": q, "v": v, "u": rng.uniform(-1.0, 1.0, kernel.n).astype(kernel.dtype)}


class Exact:
    """Programs of a robot at 200 digits."""

    def __init__(self, kernel: Kernel, model: Model, numbers: Numbers) -> None:
        self.kernel, self.model, self.known = kernel, model, dict[str, Program]()
        self.inputs: Numbers = {name: [mpmath.mpf(float(x)) for x in array] for name, array in numbers.items()}
        self.inputs["p"] = [mpmath.mpf(float(np.asarray(x, kernel.dtype))) for x in kernel.parameters.values()]

    def run(self, name: str, **arrays: Any) -> list[Any]:
        if name not in self.known:
            self.known[name] = derive(self.model, name, str(self.kernel.dtype))
        calls = {"max": lambda x, y: y if x < y else x, "sqrt": mpmath.sqrt}
        inputs = {**self.inputs, **{key: [mpmath.mpf(float(x)) for x in array] for key, array in arrays.items()}}
        out = evaluate(self.known[name], inputs, lambda x: (mpmath.sin(x), mpmath.cos(x)), calls)
        return [out["out", i] for i in range(len(out))]

    def affine(self, size: int, rows: list[int], equations: Any) -> list[Any]:
        """Solve affine equations of so many unknowns, of which some rows count."""
        zero = equations([0.0] * size)
        columns = [[x - y for x, y in zip(equations(np.eye(size)[j]), zero, strict=True)] for j in range(size)]
        K = mpmath.matrix([[columns[j][i] for j in range(size)] for i in range(len(zero))])
        kept = [i for i in range(size) if i in rows]
        inner = mpmath.matrix([[K[i, j] for j in kept] for i in kept])
        solved = mpmath.lu_solve(inner, mpmath.matrix([-zero[i] for i in kept]))
        whole = [mpmath.mpf(0)] * size
        for place, i in enumerate(kept):
            whole[i] = solved[place]
        return whole


def is_held(kernel: Kernel, q: Any) -> bool:
    """Say whether drives hold all coordinates: no motion of the others is left to the constraints alone."""
    J = kernel.constraint_jacobian(q)
    free = np.setdiff1d(np.arange(kernel.n), kernel.raw.libraries.meta["driven"])
    return bool(np.linalg.matrix_rank(J[:, free], 1e-9) == len(free))


def check(kernel: Kernel, robot: Robot, seed: int = 0) -> dict[str, float]:
    """Check bounds of all solutions in a state; return the largest bounds by the size of results."""
    n, m = kernel.n, len(kernel.constraints)
    x = state_of(kernel, robot, seed)
    eps, shares = float(np.finfo(kernel.dtype).eps), dict[str, float]()
    found = {
        name: kernel.with_errors(name, (x["q"], x["v"], x["u"])) for name in ("forward_dynamics", "constraint_forces")
    }
    x["a"] = found["forward_dynamics"].value
    names = ("inverse_dynamics", "reactions", *(("loop_reactions",) if kernel.loops else ()))
    held = is_held(kernel, x["q"])
    if held:
        found |= {name: kernel.with_errors(name, (x["q"], x["v"], x["a"])) for name in names}
    else:
        for name in names:
            with pytest.raises(LoopError, match="cannot make this motion"):
                kernel.with_errors(name, (x["q"], x["v"], x["a"]))
    rows = [*range(n), *(n + r for r in moved_rows(kernel.calls, x["q"], list(range(n))))]
    with mpmath.workdps(DIGITS):
        exact = Exact(kernel, build_model(robot), x)
        solution = exact.affine(n + m, rows, lambda y: exact.run("constrained_residual", a=y[:n], multipliers=y[n:]))
        right = {"forward_dynamics": solution[:n], "constraint_forces": solution[n:]}
        meta = kernel.raw.libraries.meta
        driven = np.isin(np.arange(n), meta["driven"])

        def driving(y: Any) -> list[Any]:
            none = 0.0 * np.array(y)
            first = exact.run("constrained_residual", u=-np.where(driven, y[:n], 0.0), multipliers=y[n:])[:n]
            moved, still = (exact.run("constrained_residual", a=z, multipliers=none[n:])[n:] for z in (y[:n], none[:n]))
            return [*first, *(one - other for one, other in zip(moved, still, strict=True))]

        if held:
            drives = exact.affine(n + m, rows, driving)
            right["inverse_dynamics"] = [-drives[i] if driven[i] else mpmath.mpf(0) for i in range(n)]
            exact.inputs["multipliers"] = drives[n:]
            right["reactions"] = [
                s + t for s, t in zip(exact.run("tree_reactions"), exact.run("closing_reactions"), strict=True)
            ]
            if kernel.loops:
                right["loop_reactions"] = exact.run("loop_wrenches")
        for name, (value, bound) in found.items():
            assert found[name].proved.all(), name
            for number, most, true in zip(value.ravel(), bound.ravel(), right[name], strict=True):
                assert abs(mpmath.mpf(float(number)) - true) <= mpmath.mpf(float(most)), name
            shares[name] = float(bound.max() / max(np.abs(value).max(), 1e-3))
            assert shares[name] <= 1e4 * eps, name
    return shares


def test_solutions_of_a_four_bar(built: Build) -> None:
    kernel = built_closed(built, robot := load_robot("four_bar"))
    check(kernel, robot)
    x = state_of(kernel, robot, 1)
    many = {name: np.stack([array] * 3) for name, array in x.items()}
    alone, batch = (kernel.with_errors("forward_dynamics", tuple(y[z] for z in "qvu")) for y in (x, many))
    assert batch.proved.shape == (3,)
    assert np.allclose(batch.bound, alone.bound, rtol=0.5, atol=1e-15)
    with pytest.raises(ArrayError, match="constraint_forces: rounding moves the result in state 0 by up to"):
        kernel.with_errors("constraint_forces", (x["q"], x["v"], x["u"]), most=0.0)
    with pytest.raises(LoopError, match="forward_dynamics: four_bar: loop joint4 is open"):
        kernel.with_errors("forward_dynamics", (x["q"] + 0.1, x["v"], x["u"]))
    assembled(kernel, robot)


def assembled(kernel: Kernel, robot: Robot) -> None:
    """Newton's method at 200 digits from an assembled state ends within its bound, with other coordinates the same."""
    held = [kernel.coordinates[0]]
    guess = state_of(kernel, robot, 2)["q"]
    q, bound = found = kernel.with_errors("assemble", (guess, held))
    assert found.proved
    assert bound.max() < 1e4 * np.finfo(kernel.dtype).eps
    assert bound[0] == 0.0
    rows = moved_rows(kernel.calls, q, list(range(kernel.n)))
    with mpmath.workdps(DIGITS):
        exact = Exact(kernel, build_model(robot), {"q": q})
        dependent = [i for i in range(kernel.n) if bound[i] > 0.0]
        for _ in range(8):
            g = exact.run("constraint")
            J = exact.run("constraint_jacobian")
            inner = mpmath.matrix([[J[r * kernel.n + i] for i in dependent] for r in rows])
            step = mpmath.lu_solve(inner, mpmath.matrix([-g[r] for r in rows]))
            for place, i in enumerate(dependent):
                exact.inputs["q"][i] += step[place]
        assert max(abs(exact.run("constraint")[r]) for r in rows) < mpmath.mpf(10) ** -150
        for number, most, true in zip(q, bound, exact.inputs["q"], strict=True):
            assert abs(mpmath.mpf(float(number)) - true) <= mpmath.mpf(float(most))


@pytest.mark.soak
@pytest.mark.parametrize("dtype", ["float64", "float32"])
@pytest.mark.parametrize("name", ["four_bar", "andrews", "gough"])
def test_solutions_of_mechanisms(built: Build, name: str, dtype: str) -> None:
    kernel = built_closed(built, robot := load_robot(name), dtype)
    check(kernel, robot)


@pytest.mark.soak
@pytest.mark.parametrize("seed", soaked(range(12), []))
def test_solutions_of_random_mechanisms(built: Build, seed: int) -> None:
    robot = with_random_loops(random_robot(seed, joints=(2, 4), tree=True), seed, ("spherical", "revolute"))
    kernel = built_closed(built, robot)
    try:
        x = state_of(kernel, robot, seed)
    except LoopError:
        pytest.skip("it does not close near home")
    found = kernel.with_errors("forward_dynamics", (x["q"], x["v"], x["u"]))
    assert np.isfinite(found.bound).all()
    if found.proved:
        check(kernel, robot, seed)


@pytest.mark.soak
def test_redundant_constraints_have_estimates(built: Build) -> None:
    """Bennett's linkage moves though it has as many constraints as freedoms: in exact numbers it may not."""
    kernel = built_closed(built, robot := load_robot("bennett"))
    x = state_of(kernel, robot, 0)
    found = kernel.with_errors("forward_dynamics", (x["q"], x["v"], x["u"]))
    assert not found.proved
    assert 0.0 < found.bound.max() < 1e-10
    with pytest.raises(ArrayError, match="forward_dynamics: what rounding moves the result by is an estimate"):
        kernel.with_errors("forward_dynamics", (x["q"], x["v"], x["u"]), most=1.0)


@pytest.mark.parametrize("flags", soaked(["-DEOMGEN_VECTOR=0", "-DEOMGEN_VECTOR=16", "-mavx", "-mavx512f"], ["-mavx"]))
def test_the_first_failure_of_a_batch(built: Build, flags: str) -> None:
    """Whatever the width of vectors: that of the first state, though a later one of the same vector fails earlier."""
    kernel = built(load_robot("four_bar"), "forward_dynamics", "constraint_forces", "cut_poses", flags=(flags, "-O0"))
    q = np.zeros((8, 3))
    q[:] = kernel.assemble([0.4, 1.0, -1.0])
    q[2] += 0.1
    q[3] = np.nan
    zero = np.zeros((8, 3))
    for name in ("forward_dynamics", "constraint_forces"):
        function, out = kernel.raw.functions[name], np.empty((8, *kernel.raw.shapes[kernel.raw.functions[name].writes]))
        failed = kernel.calls.call(function, [q, zero, zero], [3, 3, 3], (), 8, out)
        state, reason = divmod(failed, kernel.raw.statuses)
        assert state == 2
        assert reason >= kernel.n, "it is open"
