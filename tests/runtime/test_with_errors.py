"""Results with bounds of their rounding errors: the bits of the methods, errors within bounds, and what is refused."""

from __future__ import annotations

from typing import Any

import mpmath
import numpy as np
import pytest

import eomgen
from eomgen.codegen.kernels.equations import derive
from eomgen.codegen.program.ir import evaluate
from eomgen.description.load import load_robot
from eomgen.errors import ArrayError, InputError, UnknownNameError
from eomgen.robot.model import build_model
from eomgen.runtime import Kernel
from tests.support.builds import Build

KERNELS = ("inverse_dynamics", "mass_matrix", "forward_dynamics", "energy", "kinematics")
FUNCTIONS: dict[str, str] = {"inverse_dynamics": "qva", "mass_matrix": "q", "energy": "qv"}
OF_FRAMES = ("frame_pose", "frame_jacobian")


def with_bounds(build: Build, name: str, dtype: str = "float64") -> Kernel:
    bounded = (*FUNCTIONS, *OF_FRAMES)
    return build(load_robot(name), *KERNELS, *(f"{x}_with_errors" for x in bounded), dtype=dtype)


def arrays(kernel: Kernel, seed: int = 0, count: tuple[int, ...] = ()) -> dict[str, Any]:
    rng = np.random.default_rng(seed)
    return {x: rng.uniform(-1.5, 1.5, (*count, kernel.n)).astype(kernel.dtype) for x in "qvau"}


def accelerations(kernel: Kernel, state: dict[str, Any]) -> list[Any]:
    """Return accelerations of one state at 60 digits, of the programs of M and of M a + h."""
    model, calls = build_model(load_robot(kernel.name)), {"max": lambda x, y: y if x < y else x}
    inputs = {x: [mpmath.mpf(float(y)) for y in state[x]] for x in "qv"}
    inputs |= {"a": [mpmath.mpf(0)] * kernel.n, "p": [mpmath.mpf(x) for x in kernel.parameters.values()]}

    def run(name: str) -> list[Any]:
        out = evaluate(derive(model, name), inputs, lambda x: (mpmath.sin(x), mpmath.cos(x)), calls)
        return [out["out", i] for i in range(len(out))]

    left = [mpmath.mpf(float(u)) - h for u, h in zip(state["u"], run("inverse_dynamics"), strict=True)]
    M = mpmath.matrix(kernel.n, kernel.n)
    for place, x in enumerate(run("mass_matrix")):
        M[place // kernel.n, place % kernel.n] = x
    return list(mpmath.lu_solve(M, mpmath.matrix(left)))


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
        for name in OF_FRAMES:
            value, bound = kernel.with_errors(name, (x["q"], kernel.frames[-1]))
            assert bound.shape == value.shape
            method = getattr(kernel, name)(x["q"], kernel.frames[-1])
            if name == "frame_jacobian":  # its C puts columns together in another order
                assert (np.abs(value - method) <= 4.0 * bound).all()
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
    with pytest.raises(UnknownNameError, match="frame: 'tip9' is unknown"):
        kernel.with_errors("frame_pose", (q, "tip9"))


def test_loops_have_no_bounds_of_accelerations(built: Build) -> None:
    kernel = built(load_robot("four_bar"), "forward_dynamics", "inverse_dynamics", "tree_inverse_dynamics_with_errors")
    x = np.zeros(kernel.n)
    with pytest.raises(InputError, match=r"forward_dynamics of four_bar, which has loops .* has no bounds of rounding"):
        kernel.with_errors("forward_dynamics", (x, x, x))
    value, _ = kernel.with_errors("tree_inverse_dynamics", (x, x, x))
    assert np.array_equal(value, kernel.inverse_dynamics(x, x, x, cut=True))
    with pytest.raises(UnknownNameError, match="four_bar has no bounds of rounding errors of 'inverse_dynamics'"):
        kernel.with_errors("inverse_dynamics", (x, x, x))
    with pytest.raises(InputError, match="kernels: 'inverse_dynamics_with_errors' is for robots without rigid"):
        built(load_robot("four_bar"), "inverse_dynamics_with_errors")


def test_a_mass_matrix_that_rounding_may_make_singular(built: Build) -> None:
    """Errors of M as large as M are no bound."""
    kernel = with_bounds(built, "one_link")
    x = arrays(kernel)
    bounded = kernel._bounded_in_c

    def wide(name: str, function: str, args: Any) -> Any:
        value, bound = bounded(name, function, args)
        return value, (np.abs(value) if name == "mass_matrix" else bound)

    kernel._bounded_in_c = wide  # type: ignore[method-assign]
    with pytest.raises(eomgen.errors.SingularError, match="rounding errors may make the mass matrix singular"):
        kernel.with_errors("forward_dynamics", (x["q"], x["v"], x["u"]))
