"""Results with bounds of their rounding errors: the bits of the methods, errors within bounds, and what is refused.

Of trees; tests of closed mechanisms are in test_closed_errors.py.
"""

from __future__ import annotations

from typing import Any

import mpmath
import numpy as np
import pytest

from eomgen.codegen.kernels.equations import derive
from eomgen.codegen.program.ir import evaluate
from eomgen.description.load import load_robot
from eomgen.errors import ArrayError, InputError, UnknownNameError
from eomgen.robot.model import build_model
from eomgen.runtime import Kernel
from eomgen.runtime.derivatives import equations_of_motion
from tests.support.builds import Build
from tests.support.refusals import refused

pytestmark = pytest.mark.quick

KERNELS = ("inverse_dynamics", "mass_matrix", "forward_dynamics", "energy", "kinematics")
FUNCTIONS: dict[str, str] = {"inverse_dynamics": "qva", "mass_matrix": "q", "energy": "qv"}
OF_FRAMES = ("frame_pose", "frame_jacobian")


def with_bounds(build: Build, name: str, dtype: str = "float64") -> Kernel:
    bounded = [f"{x}{end}" for x in (*FUNCTIONS, *OF_FRAMES) for end in ("_with_errors", "_extended")]
    return build(load_robot(name), *KERNELS, "residual", "residual_extended", *bounded, dtype=dtype)


def arrays(kernel: Kernel, seed: int = 0, count: tuple[int, ...] = ()) -> dict[str, Any]:
    rng = np.random.default_rng(seed)
    return {x: rng.uniform(-1.5, 1.5, (*count, kernel.n)).astype(kernel.dtype) for x in "qvau"}


def accelerations(kernel: Kernel, state: dict[str, Any]) -> list[Any]:
    """Return accelerations of one state at 60 digits, of M a + h = u with the constants that this program has."""
    program = derive(build_model(load_robot(kernel.name)), "residual")
    inputs = {x: [mpmath.mpf(float(y)) for y in state[x]] for x in "qvu"}
    inputs["p"] = [mpmath.mpf(x) for x in kernel.parameters.values()]
    calls = {"max": lambda x, y: y if x < y else x}

    def left(a: Any) -> list[Any]:
        whole = {**inputs, "a": [mpmath.mpf(float(x)) for x in a]}
        out = evaluate(program, whole, lambda x: (mpmath.sin(x), mpmath.cos(x)), calls)
        return [out["out", i] for i in range(len(out))]

    zero = left(np.zeros(kernel.n))
    columns = [[x - y for x, y in zip(left(row), zero, strict=True)] for row in np.eye(kernel.n)]
    return list(mpmath.lu_solve(mpmath.matrix(columns).T, mpmath.matrix([-x for x in zero])))


def check(kernel: Kernel) -> None:
    for count in ((), (5,), (2, 3)):
        x = arrays(kernel, count=count)
        for name, reads in FUNCTIONS.items():
            args = tuple(x[label] for label in reads)
            value, bound = kernel.with_errors(name, args)
            expected = getattr(kernel, name)(*args)
            assert np.array_equal(value, expected)
            assert bound.shape == expected.shape
            assert bound.dtype == kernel.dtype
            assert ((bound >= 0.0) & (bound <= 1e3 * np.finfo(kernel.dtype).eps * np.abs(expected).max())).all()
            tight = kernel.with_errors(name, args, tight=True)
            assert np.array_equal(tight.value, expected)
            assert (tight.bound <= bound * (1.0 + 1e-6)).all(), "the error itself is within its running bound"
            assert tight.proved.all()
        for name in OF_FRAMES:
            value, bound = kernel.with_errors(name, (x["q"], kernel.frames[-1]))
            assert bound.shape == value.shape
            method = getattr(kernel, name)(x["q"], kernel.frames[-1])
            if name == "frame_jacobian":  # its C puts columns together in another order
                assert (np.abs(value - method) <= 4.0 * np.maximum(bound, np.finfo(kernel.dtype).eps)).all()
            else:
                assert np.array_equal(value, method)
    a, bound = kernel.with_errors("forward_dynamics", tuple(x[label] for label in "qvu"))
    assert np.array_equal(a, kernel.forward_dynamics(x["q"], x["v"], x["u"]))
    assert a.shape == bound.shape
    alone = {label: y[1, 2] for label, y in x.items()}
    with mpmath.workdps(60):
        for i, right in enumerate(accelerations(kernel, alone)):
            error = abs(right - mpmath.mpf(float(a[1, 2, i])))
            assert error <= float(bound[1, 2, i]) <= 1e4 * np.finfo(kernel.dtype).eps * np.abs(a[1, 2]).max()


def test_results_have_the_bits_of_the_methods(built: Build) -> None:
    check(with_bounds(built, "one_link"))


@pytest.mark.soak
@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_results_of_an_arm_have_the_bits_of_the_methods(built: Build, dtype: str) -> None:
    check(with_bounds(built, "ur5", dtype))


def test_what_is_refused(built: Build) -> None:
    kernel = with_bounds(built, "one_link")
    x = arrays(kernel)
    q, v, a, u = (x[label] for label in "qvau")
    bound = kernel.with_errors("inverse_dynamics", (q, v, a), most=1e-9)[1]
    kernel.with_errors("inverse_dynamics", (q, v, a), most=bound)
    with pytest.raises(ArrayError, match=r"inverse_dynamics: rounding moves the result in state .* by up to .* most"):
        kernel.with_errors("inverse_dynamics", (q, v, a), most=bound / 2.0)
    with pytest.raises(ArrayError, match="forward_dynamics: rounding moves the result"):
        kernel.with_errors("forward_dynamics", (q, v, u), most=0.0)
    with pytest.raises(ArrayError, match=r"most: got -1.0; allowed: 0 and more"):
        kernel.with_errors("inverse_dynamics", (q, v, a), most=-1.0)
    with pytest.raises(ArrayError, match=r"most: got shape \(7,\); allowed: one that goes with the result, \(2,\)"):
        kernel.with_errors("inverse_dynamics", (q, v, a), most=np.ones(7))
    with pytest.raises(InputError, match=r"inverse_dynamics: got 1 arguments; allowed: \(q, v, a\)"):
        kernel.with_errors("inverse_dynamics", (q,))
    with pytest.raises(UnknownNameError, match="one_link has no bounds of rounding errors of 'reaction'"):
        kernel.with_errors("reaction", (q, v, a))
    refused(UnknownNameError, "frame: 'tip9' is unknown", kernel.with_errors, "frame_pose", (q, "tip9"))


@pytest.mark.parametrize("scale", [1.0, 1.0 + 1e-6, 1.0 - 1e-12])
def test_a_wrong_answer_of_the_solver_is_within_its_bound(built: Build, scale: float) -> None:
    """Bounds are of what an answer leaves of the equations, whatever spoilt it: they grow with the fault."""
    kernel = with_bounds(built, "one_link")
    x = arrays(kernel)
    run, args = kernel.calls.run, tuple(x[label] for label in "qvu")

    def faulty(name: str, *rest: Any, **more: Any) -> Any:
        return run(name, *rest, **more) * (scale if name == "forward_dynamics" else 1.0)

    right = kernel.forward_dynamics(*args)
    kernel.calls.run = faulty  # type: ignore[method-assign]
    value, bound = kernel.with_errors("forward_dynamics", args)
    error = np.abs(value - right)
    assert (error <= bound + 1e-14 * np.abs(right)).all()
    assert (bound <= 1.001 * error + 1e-14 * np.abs(right).max()).all()


def test_equations_that_rounding_may_make_singular(built: Build, monkeypatch: pytest.MonkeyPatch) -> None:
    """Errors of M as large as M make a bound an estimate, and one that is not proved is no use to who asks for most."""
    kernel = with_bounds(built, "one_link")
    x = arrays(kernel, count=(2,))
    exact = equations_of_motion.matrix_of

    def wide(*args: Any) -> Any:
        value, error = exact(*args)
        error[1] = np.abs(value[1])
        return value, error

    args = tuple(x[label] for label in "qvu")
    assert kernel.with_errors("forward_dynamics", args, most=1e-9).proved.all()
    monkeypatch.setattr(equations_of_motion, "matrix_of", wide)
    found = kernel.with_errors("forward_dynamics", args)
    assert found.proved.tolist() == [True, False]
    assert np.isfinite(found.bound).all()
    with pytest.raises(ArrayError, match=r"forward_dynamics: what rounding moves .* in state 1 is an estimate"):
        kernel.with_errors("forward_dynamics", args, most=1e-9)


def test_checks_by_errors(built: Build) -> None:
    kernel = with_bounds(built, "one_link")
    x = arrays(kernel, count=(3,))
    checked = kernel.with_checks("errors", most=1e-12)
    assert np.array_equal(
        checked.inverse_dynamics(x["q"], x["v"], x["a"]), kernel.inverse_dynamics(x["q"], x["v"], x["a"])
    )
    assert np.array_equal(checked.frame_pose(x["q"], kernel.frames[-1]), kernel.frame_pose(x["q"], kernel.frames[-1]))
    assert np.isfinite(checked.forward_dynamics(x["q"], x["v"], x["u"])).all()
    assert "energy" in dir(checked)
    assert not hasattr(checked, "rollout")
    strict = kernel.with_checks("errors", most={"energy": [1e-30, 1.0], "mass_matrix": 1.0})
    strict.mass_matrix(x["q"])
    with pytest.raises(ArrayError, match=r"energy: rounding moves .* in state \(0, 0\) by up to .* most, 1e-30"):
        strict.energy(x["q"], x["v"])
    with pytest.raises(InputError, match="most: has no number for inverse_dynamics; has: energy, mass_matrix"):
        strict.inverse_dynamics(x["q"], x["v"], x["a"])
    with pytest.raises(ArrayError, match=r"forward_dynamics: rounding moves .* in state 0 by up to .* allowed: 1e-22"):
        kernel.with_checks("errors", most=1e-22).forward_dynamics(x["q"], x["v"], x["u"])
    with pytest.raises(InputError, match="mass_matrix: out has no bounds of rounding errors"):
        checked.mass_matrix(x["q"], out=np.empty((3, 2, 2)))
    with pytest.raises(AttributeError, match="rollout: no method of CheckedKernel with bounds"):
        checked.rollout(x["q"], x["v"])
    for wanted, most, message in (
        ("errors", None, r"checks: 'errors' with most=None; allowed: True or False without most, \"errors\" with it"),
        (True, 1.0, "checks: true with most=1.0"),
        ("errors", -1.0, "most: -1.0; allowed: a share from 0 on"),
        ("errors", {"rollout": 1.0}, "most: 'rollout' has no bounds of rounding errors"),
    ):
        with pytest.raises(InputError, match=message):
            kernel.with_checks(wanted, most=most)  # type: ignore[call-overload]
    with pytest.raises(InputError, match=r"checks: 'errors' is neither True nor False; .*with_checks"):
        kernel.checks = "errors"  # type: ignore[assignment]
