"""Functions and steps of CasADi against kernels, rollouts, CasADi's own integrators and models in its symbols."""

from __future__ import annotations

import importlib
import itertools
import pickle
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen.adapters.casadi import _external, function, kernels_for_step, step
from eomgen.adapters.external import render_step
from eomgen.adapters.mappings import DifferentiableFunction, kernels_for
from eomgen.codegen.package.compile import find_compiler
from eomgen.control.discrete_steps import DiscreteStep
from eomgen.errors import BuildError, InputError, UnknownNameError
from eomgen.pipeline import cache
from eomgen.robot.model import build_model
from eomgen.robot.value import Robot
from eomgen.runtime.levels import BASE
from tests.support.adapter_samples import BENDING, built_for, functions_of, sample, states
from tests.support.bristles import bent, bristle_arm, servo_arm
from tests.support.builds import Build
from tests.support.figures import Figures
from tests.support.optional import needs
from tests.support.random_robots import Array, random_robot, random_state, seeds
from tests.support.refusals import refused
from tests.support.soak import soaked

casadi = needs("casadi")
FLAGS = ("-O0", "-Werror")


def by_columns(block: Array, function: DifferentiableFunction, shape: tuple[int, ...]) -> Array:
    """A derivative (output shape, input shape) as CasADi has it: a column per number, both by columns."""
    rows, columns = ((*s, 1)[:2] for s in (function.output, shape))
    four = block.reshape(*rows, *columns).transpose(1, 0, 3, 2)
    return np.asarray(four.reshape(int(np.prod(rows)), int(np.prod(columns))))


@pytest.mark.parametrize("seed", [*seeds(4100, 1, 60), pytest.param(BENDING, marks=pytest.mark.soak)])
def test_values_and_jacobians_are_the_kernels(seed: int, built: Build, figures: Figures) -> None:
    """All functions, compiled without a warning; sparse where something vanishes identically."""
    robot = sample(seed)
    kernel = built_for(robot, built)
    for there in functions_of(robot, kernel):
        made = function(kernel, there.name, there.frame, cut=True, flags=FLAGS)
        jacobian = made.jacobian()
        for state in range(2):
            given = states(robot, kernel, seed + state)
            arrays = [given[name] for name in there.reads]
            value = np.array(made(*arrays))
            assert value.shape == (*there.output, 1)[:2]
            figures.at_most(
                "value", float(np.abs(value.reshape(there.output) - there.value(*arrays)).max(initial=0.0)), 1e-14
            )
            found = jacobian(*arrays, 0)
            blocks = found if isinstance(found, tuple) else (found,)
            for block, expected, shape in zip(blocks, there.derivatives(*arrays), there.inputs, strict=True):
                wanted = by_columns(expected, there, shape)
                error = float(np.abs(np.array(block) - wanted).max(initial=0.0))
                figures.at_most("jacobian", error / max(float(np.abs(wanted).max(initial=0.0)), 1.0), 1e-13)
        figures.count("functions")


@pytest.mark.soak
def test_closed_mechanisms(built: Build) -> None:
    """Accelerations, drives and forces of the constraint with their Jacobians, beside closed states, too."""
    robot = eomgen.load_robot("four_bar")
    names = ("forward_dynamics", "inverse_dynamics", "constraint_forces", "constraint_jacobian")
    kernel = built(robot, *kernels_for(*names, closed=True))
    given = [np.array(build_model(robot).home) + 1e-3, np.array([1.0, -0.4, 0.3]), np.array([2.0, -1.0, 0.5])]
    for name in names:
        there, made = DifferentiableFunction(kernel, name), function(kernel, name, flags=FLAGS)
        arrays = given[: len(there.reads)]
        np.testing.assert_allclose(
            np.array(made(*arrays)).reshape(there.output), there.value(*arrays), rtol=1e-13, atol=1e-13
        )
        found = made.jacobian()(*arrays, 0)
        blocks = found if isinstance(found, tuple) else (found,)
        for block, expected, shape in zip(blocks, there.derivatives(*arrays), there.inputs, strict=True):
            np.testing.assert_allclose(np.array(block), by_columns(expected, there, shape), rtol=1e-11, atol=1e-11)


def test_forward_and_reverse_modes(built: Build) -> None:
    """Inside an expression, with a matrix in the middle: jtimes both ways, against its derivatives by hand."""
    robot = sample(4100)
    kernel = built_for(robot, built)
    s = random_state(robot, 3)
    mass = function(kernel, "mass_matrix", flags=FLAGS)
    inverse = function(kernel, "inverse_dynamics", flags=FLAGS)
    assert mass.sparsity_out(0).nnz() < kernel.n**2  # a joint that slides beside one that turns, say
    q, v, w = (casadi.MX.sym(name, kernel.n) for name in "qvw")
    whole = mass(2 * q) @ v + inverse(q, v, v)
    forward = casadi.Function("forward", [q, v, w], [casadi.jtimes(whole, q, w)])
    reverse = casadi.Function("reverse", [q, v, w], [casadi.jtimes(whole, q, w, True)])
    by_mass = DifferentiableFunction(kernel, "mass_matrix").derivatives(2 * s.q)[0]
    by_inverse = DifferentiableFunction(kernel, "inverse_dynamics").derivatives(s.q, s.v, s.v)[0]
    J = 2 * np.einsum("svw,v->sw", by_mass, s.v) + by_inverse
    assert np.allclose(np.array(forward(s.q, s.v, s.a))[:, 0], J @ s.a, rtol=1e-12, atol=1e-12)
    assert np.allclose(np.array(reverse(s.q, s.v, s.a))[:, 0], J.T @ s.a, rtol=1e-12, atol=1e-12)


@pytest.mark.soak
@pytest.mark.parametrize("seed", [*seeds(4100, 1, 20), BENDING])
def test_hessians_are_the_kernels(seed: int, built: Build, figures: Figures) -> None:
    """Of expressions with all functions: casadi.hessian against the kernel's derivatives by hand."""
    robot = sample(seed)
    kernel = built_for(robot, built)
    given = states(robot, kernel, seed)
    for there in functions_of(robot, kernel):
        made = function(kernel, there.name, there.frame, cut=True, flags=FLAGS)
        figures.at_most("hessian", error_of_hessian(there, made, [given[name] for name in there.reads], seed), 1e-11)
        figures.count("functions")


@pytest.mark.parametrize("name", ["one_link", "four_bar"])
@pytest.mark.soak
def test_hessians_of_mechanisms(name: str, built: Build) -> None:
    """Of open and closed ones, beside closed states, too."""
    robot, asked = eomgen.load_robot(name), ["inverse_dynamics", "forward_dynamics", "energy", "frame_pose", "residual"]
    asked += ["constraint", "constraint_forces"] if robot.loops else []
    kernel = built(robot, *kernels_for(*asked, closed=bool(robot.loops)))
    rng = np.random.default_rng(8)
    q = np.array(build_model(robot).home) + 1e-3
    for function_name in asked:
        there = DifferentiableFunction(kernel, function_name, "tcp" if function_name == "frame_pose" else None)
        made = function(kernel, function_name, there.frame, flags=FLAGS)
        arrays = [q, *(rng.uniform(-1.0, 1.0, kernel.n) for _ in there.reads[1:])]
        assert error_of_hessian(there, made, arrays, 1) < 1e-11, function_name


def error_of_hessian(there: DifferentiableFunction, made: casadi.Function, arrays: list[Array], seed: int) -> float:
    """The error of a weighted sum's Hessian, plus that of its square, by all arguments, relative to the greatest."""
    weights = np.random.default_rng(seed).uniform(-1.0, 1.0, there.output)
    z = casadi.MX.sym("z", sum(array.size for array in arrays))
    ends = np.cumsum([0, *(array.size for array in arrays)])
    parts = [
        casadi.reshape(z[int(ends[i]) : int(ends[i + 1])], *(*shape, 1)[1::-1]).T
        for i, shape in enumerate(there.inputs)
    ]
    total = casadi.sum1(casadi.sum2(casadi.DM(weights) * made(*parts)))
    found = casadi.Function("second", [z], [casadi.hessian(total + total**2, z)[0]])
    gradient = np.tensordot(weights, there.jacobian(*arrays), axes=weights.ndim)
    value = float(np.sum(weights * there.value(*arrays)))
    expected = (1.0 + 2.0 * value) * there.hessian(arrays, weights) + 2.0 * np.outer(gradient, gradient)
    size = max(float(np.abs(expected).max()), 1.0)
    return float(np.abs(np.array(found(np.concatenate([x.ravel() for x in arrays]))) - expected).max()) / size


@pytest.mark.soak
def test_on_threads(built: Build) -> None:
    """Calls share nothing: each of many states has the kernel's result, derivatives too."""
    robot = random_robot(4420, joints=(3, 3))
    kernel = built(robot, *kernels_for("forward_dynamics"))
    made = function(kernel, "forward_dynamics", flags=FLAGS)
    rng = np.random.default_rng(1)
    q, v, u = rng.uniform(-1.0, 1.0, (3, 200, kernel.n))
    found = np.array(made.map(200, "thread", 4)(q.T, v.T, u.T)).T
    assert np.allclose(found, kernel.forward_dynamics(q, v, u), rtol=1e-12, atol=1e-12)
    by_q = np.array(made.jacobian().map(200, "thread", 4)(q.T, v.T, u.T, np.zeros((kernel.n, 200)))[0])
    expected = kernel.forward_dynamics_jacobian(q, v, u)[0]
    assert np.allclose(by_q.reshape(kernel.n, 200, kernel.n).transpose(1, 0, 2), expected, rtol=1e-11, atol=1e-11)


def test_without_eomgen(built: Build, tmp_path: Path) -> None:
    """A copy of the library, functions that are saved or pickled, and generated code work in another process."""
    kernel = built(eomgen.load_robot("one_link"), *kernels_for("inverse_dynamics"))
    made = function(kernel, "inverse_dynamics", called="torques", flags=FLAGS)
    shutil.copy(made.library, tmp_path / "copy.so")
    q = casadi.MX.sym("q", 2)
    around = casadi.Function("around", [q], [made(q, q, q), casadi.hessian(casadi.sumsqr(made(q, q, q)), q)[0]])
    around.save(str(tmp_path / "saved"))
    (tmp_path / "pickled").write_bytes(pickle.dumps(around))
    code = casadi.CodeGenerator("around")
    code.add(around)
    (tmp_path / "around.c").write_text(code.dump(), encoding="ascii")
    compiler = (*find_compiler().command, "-shared", "-fPIC", "around.c", str(made.library), "-o", "around.so", "-lm")
    subprocess.run(compiler, cwd=tmp_path, check=True)
    program = """
import pickle, sys, casadi
x, here = [0.1, 0.2], sys.argv[1]
of = [casadi.external("torques", f"{here}/copy.so")(x, x, x)]
with open(f"{here}/pickled", "rb") as file:
    others = [pickle.load(file), casadi.Function.load(f"{here}/saved"), casadi.external("around", f"{here}/around.so")]
for other in others:
    of += other(x)
assert "eomgen" not in sys.modules
print(*[number for value in of for number in value.full().ravel().tolist()])
"""
    done = subprocess.run([sys.executable, "-c", program, tmp_path], capture_output=True, text=True, check=True)
    expected = np.concatenate([value.full().ravel() for value in around([0.1, 0.2])])
    found = np.array([float(word) for word in done.stdout.split()])
    assert np.array_equal(expected[:2], kernel.inverse_dynamics([0.1, 0.2], [0.1, 0.2], [0.1, 0.2]))
    assert np.array_equal(found[:2], expected[:2])
    np.testing.assert_allclose(found[2:].reshape(3, -1), [expected] * 3, rtol=1e-14)


def test_from_a_generated_package(built: Build, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its kernel knows where its C is; a kernel whose C is gone says so."""
    robot = eomgen.load_robot("one_link")
    options = eomgen.pipeline.Options(kernels_for("frame_pose"), flags=("-O0",), levels=(BASE,))
    package = eomgen.generate(robot, tmp_path, options)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.delitem(sys.modules, package.name, raising=False)  # another test's package of this name
    kernel = importlib.import_module(package.name).kernel
    del sys.modules[package.name]
    made = function(kernel, "frame_pose", "tcp", flags=FLAGS)
    assert made.name() == "eom_one_link_frame_pose_tcp"
    assert np.array_equal(np.array(made([0.1, 0.2])), kernel.frame_pose([0.1, 0.2], "tcp"))
    assert kernel.raw.source("h") == (package / "one_link.h").read_text(encoding="ascii")
    (package / "one_link.c").unlink()
    with pytest.raises(Exception, match=r"one_link\.c is not in the kernel's package any more; build the kernel again"):
        function(kernel, "frame_pose", "tcp")


def test_of_a_kernel_with_rollouts(built: Build) -> None:
    """Whose header includes that of the C library."""
    kernel = built(eomgen.load_robot("one_link"), *kernels_for("inverse_dynamics"), "rollout")
    state = ([0.1, 0.2], [0.3, 0.4], [0.5, 0.6])
    made = function(kernel, "inverse_dynamics", flags=FLAGS)
    assert np.array_equal(np.array(made(*state))[:, 0], kernel.inverse_dynamics(*state))


def test_after_the_cache_was_cleared(empty_cache: Path) -> None:
    """What is loaded stays; what needs the C says that it is gone."""
    kernel = eomgen.build(eomgen.load_robot("one_link"), kernels=kernels_for("inverse_dynamics"), flags=("-O0",))
    made, state = function(kernel, "inverse_dynamics", flags=FLAGS), ([0.1, 0.2], [0.3, 0.4], [0.5, 0.6])
    kinds = sorted(kind for kind, _, _ in cache.contents())
    assert kinds == ["derivations", "externals", "objects", "packages", "sources"]
    cache.clear()
    assert np.array_equal(np.array(made(*state))[:, 0], kernel.inverse_dynamics(*state))
    assert made.jacobian()(*state, 0)[2].shape == (2, 2)
    refused(BuildError, r"one_link\.c|one_link\.h", function, kernel, "inverse_dynamics", called="again")


def test_parameters_are_those_of_then(built: Build) -> None:
    kernel = built(eomgen.load_robot("one_link"), *kernels_for("inverse_dynamics"))
    made = [function(kernel, "inverse_dynamics", flags=FLAGS)]
    state = ([0.1, 0.2], [0.3, 0.4], [0.5, 0.6])
    before = kernel.inverse_dynamics(*state)
    kernel.parameters["joints.joint1.x.stiffness"] = 7.0
    made.append(function(kernel, "inverse_dynamics", flags=FLAGS))
    assert np.array_equal(np.array(made[0](*state))[:, 0], before)
    assert np.array_equal(np.array(made[1](*state))[:, 0], kernel.inverse_dynamics(*state))


def test_what_fails(built: Build, monkeypatch: pytest.MonkeyPatch) -> None:
    robot = random_robot(976, joints=(1, 1), types=("free",), armature=False)
    kernel = built(robot, *kernels_for("forward_dynamics", "inverse_dynamics"))
    s, singular = random_state(robot, 1), random_state(robot, 1).q.copy()
    singular[kernel.coordinates.index("joint1.beta")] = np.pi / 2
    made = function(kernel, "forward_dynamics", flags=FLAGS)
    assert np.isfinite(np.array(made(s.q, s.v, s.u))).all()
    for failing in (lambda: made(singular, s.v, s.u), lambda: made.jacobian()(singular, s.v, s.u, 0)):
        refused(RuntimeError, r"[Ee]valuation failed", failing)
    refused(RuntimeError, r"(?i)mismatch", made, s.q[1:], s.v, s.u)
    inverse = function(kernel, "inverse_dynamics", flags=FLAGS)
    assert np.isnan(np.array(inverse(s.q * np.nan, s.v, s.a))).any()
    x = casadi.MX.sym("x", kernel.n)
    problem = {"x": x, "f": casadi.sumsqr(inverse(x, s.v, s.a))}
    quiet = {"print_time": False, "ipopt.print_level": 0, "ipopt.sb": "yes"}
    casadi.nlpsol("exact", "ipopt", problem, quiet)
    first = function(kernel, "inverse_dynamics", order=1, called="first", flags=FLAGS)
    problem = {"x": x, "f": casadi.sumsqr(first(x, s.v, s.a))}
    with pytest.raises(RuntimeError, match=r"(?i)jac"):  # no second derivatives: not by chance, either
        casadi.nlpsol("exact", "ipopt", problem, quiet)
    casadi.nlpsol("approximate", "ipopt", problem, {**quiet, "ipopt.hessian_approximation": "limited-memory"})
    only_first = built(robot, *kernels_for("inverse_dynamics", order=1))
    with pytest.raises(UnknownNameError, match="built without inverse_dynamics_adjoint, inverse_dynamics_hessian"):
        function(only_first, "inverse_dynamics")
    for called in ("a__b", "_a", "1a", "random_robot_mine"):
        refused(InputError, rf"called: '{called}' is no name", function, kernel, "inverse_dynamics", called=called)
    single = built(robot, *kernels_for("inverse_dynamics"), dtype="float32")
    refused(InputError, "kernel of float32; allowed for CasADi: float64", function, single, "inverse_dynamics")
    missing = cache.Entry("externals", "0" * 64, {})
    refused(BuildError, r"missing\.so does not load; set EOMGEN_CACHE_DIR", _external, casadi, missing, "missing", {})
    monkeypatch.setitem(sys.modules, "casadi", None)
    refused(InputError, r'pip install "eomgen\[casadi\]"', function, kernel, "inverse_dynamics")


def test_the_optimum_is_that_of_a_formulation_in_symbols(built: Build) -> None:
    """Least effort of the rod, implicit midpoint: the kernel and limited memory against CasADi's own symbols."""
    kernel = built(eomgen.load_robot("one_link"), *kernels_for("forward_dynamics"))
    kernel.parameters["joints.joint1.x.stiffness"] = 60.0
    made = function(kernel, "forward_dynamics", flags=FLAGS)
    y, w = casadi.MX.sym("y", 4), casadi.MX.sym("w")
    by_kernel = casadi.Function("by_kernel", [y, w], [casadi.vertcat(y[2:], made(y[:2], y[2:], casadi.vertcat(0, w)))])
    exact = _swing(_rod_in_symbols(), "exact")
    assert np.allclose(_swing(by_kernel, "limited-memory"), exact, rtol=0.0, atol=1e-5 * np.abs(exact).max())


def _rod_in_symbols() -> casadi.Function:
    """The rod's (v, a) of (q, v) and its drive."""
    x, u = casadi.SX.sym("x", 4), casadi.SX.sym("u")
    s, c = casadi.sin(x[1]), casadi.cos(x[1])
    mass = casadi.vertcat(casadi.horzcat(1, -s / 2), casadi.horzcat(-s / 2, 1 / 3))
    right = casadi.vertcat(c * x[3] ** 2 / 2 - 60 * x[0], u - 9.81 * c / 2)
    return casadi.Function("rod", [x, u], [casadi.vertcat(x[2:], casadi.solve(mass, right))])


def _swing(given: casadi.Function, hessian: str, steps: int = 15, *, by_steps: bool = False) -> Array:
    """Drives (steps,) that lift the rod from hanging to rest at 0.5 rad with the least sum of squares.

    ``given`` makes a step, or is the rate in the middle of one of 0.8 s / steps.
    """
    opti, f = casadi.Opti(), given.map(steps)
    x, u = opti.variable(4, steps + 1), opti.variable(1, steps)
    end = f(x[:, :-1], u) if by_steps else x[:, :-1] + 0.8 / steps * f((x[:, 1:] + x[:, :-1]) / 2, u)
    opti.minimize(casadi.sumsqr(u))
    opti.subject_to(casadi.vec(x[:, 1:] - end) == 0)
    opti.subject_to(x[:, 0] == casadi.DM([0, -np.pi / 2, 0, 0]))
    opti.subject_to(x[:, -1] == casadi.DM([0, 0.5, 0, 0]))
    opti.set_initial(x[1, :], np.linspace(-np.pi / 2, 0.5, steps + 1)[None, :])
    opti.solver("ipopt", {**QUIET, "ipopt.hessian_approximation": hessian})
    return np.asarray(opti.solve().value(u))


QUIET: dict[str, Any] = {
    "print_time": False,
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    "ipopt.tol": 1e-9,
    "ipopt.max_iter": 500,
}


def jacobian_of(made: casadi.Function, *arrays: Array) -> Array:
    """Derivatives of a step by all that it takes, (states, numbers)."""
    blocks = made.jacobian()(*arrays, 0)
    return np.hstack([np.array(block) for block in (blocks if isinstance(blocks, tuple) else (blocks,))])


def gradient_of(made: casadi.Function, weights: Array, *arrays: Array) -> Array:
    """The weighted state's derivatives in reverse mode, (numbers,)."""
    blocks = made.reverse(1)(*arrays, 0, weights)
    return np.concatenate([np.array(block).ravel() for block in blocks])


def by_rollout(kernel: eomgen.Kernel, made: dict[str, Any], x: Array, u: Array) -> tuple[Array, Array]:
    """The state behind a step of fixed length and its derivatives, as a rollout has them."""
    n, m, drives = kernel.n, len(kernel.internal_states), list(made["drives"])
    places = [kernel.coordinates.index(name) for name in drives]
    unit, forces = np.eye(2 * n + m + len(drives)), np.zeros(n)
    forces[places] = u
    along = {"q": unit[:, :n], "v": unit[:, n : 2 * n], "u": np.zeros((len(unit), n))}
    along["u"][:, places] = unit[:, 2 * n + m :]
    states = {"z": x[2 * n :]} if m else {}
    ends, rates = kernel.rollout_sensitivity(
        x[:n],
        x[n : 2 * n],
        forces,
        made["dt"] / made["substeps"],
        made["substeps"],
        along=along | ({"z": unit[:, 2 * n : 2 * n + m]} if m else {}),
        parameters=made["parameters"],
        method=made["method"],
        **states,
    )
    return np.concatenate([x[-1] for x in ends]), np.hstack([x[-1] for x in rates]).T


def error_of_step(kernel: eomgen.Kernel, made: dict[str, Any], x: Array, u: Array) -> tuple[float, float, float]:
    """Errors of the state, of its derivatives and of a gradient, relative to the greatest number of each."""
    found = step(kernel, **made, flags=FLAGS)
    p = np.array([kernel.parameters[name] for name in made["parameters"]])
    arrays = (x, u, p) if p.size else (x, u)
    value, by = np.array(found(*arrays)).ravel(), jacobian_of(found, *arrays)
    state, rates = by_rollout(kernel, made, x, u)
    weights = np.random.default_rng(3).uniform(-1.0, 1.0, x.size)
    gradient, size = gradient_of(found, weights, *arrays), max(float(np.abs(rates).max()), 1.0)
    return (
        float(np.abs(value - state).max()),
        float(np.abs(by - rates).max()) / size,
        float(np.abs(gradient - weights @ rates).max()) / size,
    )


@pytest.mark.parametrize("method", ["rk4", pytest.param("implicit", marks=pytest.mark.soak)])
def test_a_step_is_that_of_a_rollout(method: str, built: Build) -> None:
    """Of both methods of fixed steps: to the bit, with parameters, and the gradient to round-off."""
    kernel = built(eomgen.load_robot("one_link"), *kernels_for_step(method))
    x, u = np.array([1e-3, 0.3, -0.01, 0.7]), np.array([1.3])
    made = {"dt": 4e-3, "substeps": 2, "drives": ("joint1.gamma",), "parameters": ("joints.joint1.x.stiffness",)}
    state, by, gradient = error_of_step(kernel, {**made, "method": method}, x, u)
    assert state == 0.0
    assert by < 1e-15
    assert gradient < 1e-14
    if method == "rk4":  # without parameters by Jacobians of accelerations
        assert "forward_dynamics_jacobian(" in render_step(DiscreteStep(kernel, "rk4", 4e-3), "alone")
        state, by, _ = error_of_step(kernel, {**made, "method": method, "parameters": ()}, x, u)
        assert state == 0.0
        assert by < 1e-14


@pytest.mark.parametrize("make", soaked((bristle_arm, servo_arm), (servo_arm,)))
@pytest.mark.parametrize("method", soaked(("rk4", "implicit"), ("rk4",)))
def test_steps_with_internal_states(make: Callable[[], Robot], method: str, built: Build) -> None:
    """States stand behind q and v; with parameters, too."""
    kernel = built(make(), *kernels_for_step(method))
    q, v, u, z = bent(kernel)
    x, u = np.concatenate([q, v, z]), u[:1]
    for parameters in ((), ("joints.j2.x.stiffness",)):
        made = {"method": method, "dt": 1e-4, "substeps": 2, "drives": ("j1.gamma",), "parameters": parameters}
        state, by, gradient = error_of_step(kernel, made, x, u)
        assert state < 1e-12
        assert by < 1e-11
        assert gradient < 1e-11


@pytest.mark.soak
@pytest.mark.parametrize("seed", seeds(4300, 5, 40))
def test_random_robots(seed: int, built: Build, figures: Figures) -> None:
    """Trees with laws, motors and springs, all numbers of u and some parameters."""
    robot = replace(sample(seed), loops=())  # random ones do not close
    names = (*kernels_for_step("rk4"), *kernels_for_step("implicit"))
    kernel = built(robot, *names)
    given = states(robot, kernel, seed)
    drives = [x for x in kernel.coordinates if x not in kernel.calls.prescribed]
    u = given["u"][[kernel.coordinates.index(name) for name in drives]]
    x = np.concatenate([given["q"], given["v"], given["z"]])
    for method in ("rk4", "implicit"):
        made: dict[str, Any] = {"method": method, "dt": 2e-4, "substeps": 2, "drives": drives}
        made["parameters"] = tuple(kernel.parameters)[-2:] if seed % 2 else ()
        errors = error_of_step(kernel, made, x, u)
        for label, error in zip(("state", "jacobian", "gradient"), errors, strict=True):
            figures.at_most(f"{label} of {method}", error, 1e-11)
        figures.count("steps")


@pytest.mark.soak
@pytest.mark.parametrize("name", ["one_link", "four_bar"])
@pytest.mark.parametrize(("method", "order"), [("rk4", 4), ("tsit5", 5), ("implicit", 1), ("rosenbrock", 4)])
def test_every_method(name: str, method: str, order: int, built: Build) -> None:
    """Errors fall by the method's order; derivatives are those of differences, and gradients those of Jacobians."""
    robot = eomgen.load_robot(name)
    kernel = built(
        robot, *kernels_for_step(method, closed=bool(robot.loops)), *(["constraint_jacobian"] if robot.loops else [])
    )
    kernel.parameters.update({key: 200.0 for key in kernel.parameters if key.endswith("x.stiffness")})
    x = np.concatenate([build_model(robot).home, np.zeros(kernel.n)])
    u = np.array([3.0])
    ends = [np.array(step(kernel, method, dt=0.2, substeps=k, flags=FLAGS)(x, u)).ravel() for k in (8, 16, 32, 1024)]
    errors = [float(np.abs(end - ends[-1]).max()) for end in ends[:-1]]
    assert all(a / b > 1.7**order or b < 1e-8 for a, b in itertools.pairwise(errors)), errors
    parameters = tuple(kernel.parameters)[-1:]
    made = step(kernel, method, dt=2e-2, substeps=3, parameters=parameters, flags=FLAGS)
    arrays = (x, u, np.array([kernel.parameters[key] for key in parameters]))
    by, numbers = jacobian_of(made, *arrays), np.concatenate(arrays)
    ends_of = np.cumsum([a.size for a in arrays])[:-1]
    for direction in _directions(kernel, x, numbers):
        h = 1e-5 * direction
        sides = [np.array(made(*np.split(numbers + sign * h, ends_of))).ravel() for sign in (1.0, -1.0)]
        rate, difference = by @ direction, (sides[0] - sides[1]) / 2e-5
        assert np.abs(rate - difference).max() < 1e-6 * max(1.0, np.abs(rate).max()), direction
    weights = np.linspace(-1.0, 1.0, x.size)
    assert np.allclose(gradient_of(made, weights, *arrays), weights @ by, rtol=1e-10, atol=1e-10 * np.abs(by).max())


def _directions(kernel: eomgen.Kernel, x: Array, numbers: Array) -> Array:
    """Along which a motion may begin: of a mechanism those that keep it closed; and a unit of each number behind x."""
    n, every = kernel.n, np.diag(np.maximum(1.0, np.abs(numbers)))
    if not kernel.constraints:
        return every
    free = np.linalg.svd(kernel.functions.constraint_jacobian(x[:n]))[2][-1]
    of_state = np.zeros((2, numbers.size))
    of_state[0, :n] = of_state[1, n : 2 * n] = free
    return np.vstack([of_state, every[2 * n :]])


@pytest.mark.soak
def test_beside_integrators_of_casadi(built: Build) -> None:
    """Its Runge-Kutta method takes the same steps, with the same derivatives; CVODES is within its tolerance."""
    kernel = built(eomgen.load_robot("one_link"), *kernels_for_step("rk4"), *kernels_for("forward_dynamics"))
    kernel.parameters["joints.joint1.x.stiffness"] = 60.0
    rate = function(kernel, "forward_dynamics", flags=FLAGS)
    x, u = casadi.MX.sym("x", 4), casadi.MX.sym("u", 2)
    system = {"x": x, "p": u, "ode": casadi.vertcat(x[2:], rate(x[:2], x[2:], u))}
    made = step(kernel, "rk4", dt=0.1, substeps=5, drives=kernel.coordinates, flags=FLAGS)
    here, force = np.array([0.01, 0.3, 0.2, -0.4]), np.array([0.5, 1.0])
    found = np.array(made(here, force)).ravel()
    same = casadi.integrator("same", "rk", system, 0.0, 0.1, {"number_of_finite_elements": 5})
    other = casadi.integrator("other", "cvodes", system, 0.0, 0.1, {"reltol": 1e-11, "abstol": 1e-11})
    by = casadi.Function("by", [x, u], [casadi.horzcat(*(casadi.jacobian(same(x0=x, p=u)["xf"], y) for y in (x, u)))])
    assert np.allclose(np.array(same(x0=here, p=force)["xf"]).ravel(), found, rtol=0.0, atol=1e-14)
    assert np.allclose(np.array(by(here, force)), jacobian_of(made, here, force), rtol=0.0, atol=1e-13)
    assert np.allclose(np.array(other(x0=here, p=force)["xf"]).ravel(), found, rtol=0.0, atol=1e-4)


@pytest.mark.soak
def test_the_optimum_is_that_of_a_model_in_symbols(built: Build) -> None:
    """Least effort of the rod, multiple shooting: steps in C against the same method in CasADi's own symbols."""
    kernel = built(eomgen.load_robot("one_link"), *kernels_for_step("rk4"))
    kernel.parameters["joints.joint1.x.stiffness"] = 60.0
    x, u, h, rate = casadi.SX.sym("x", 4), casadi.SX.sym("u"), 0.8 / 15, _rod_in_symbols()
    k1 = rate(x, u)
    k2 = rate(x + h / 2 * k1, u)
    k3 = rate(x + h / 2 * k2, u)
    k4 = rate(x + h * k3, u)
    by_symbols = casadi.Function("by_symbols", [x, u], [x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)])
    exact = _swing(by_symbols, "exact", by_steps=True)
    made = step(kernel, "rk4", dt=h, flags=FLAGS)
    assert np.allclose(_swing(made, "limited-memory", by_steps=True), exact, rtol=0.0, atol=1e-5 * np.abs(exact).max())


@pytest.mark.soak
def test_steps_on_threads(built: Build) -> None:
    """Calls share nothing: each of many states has its own end, and its own derivatives."""
    kernel = built(eomgen.load_robot("one_link"), *kernels_for_step("rosenbrock"))
    made = step(kernel, "rosenbrock", dt=1e-2, flags=FLAGS)
    rng = np.random.default_rng(1)
    x, u = rng.uniform(-1.0, 1.0, (4, 100)), rng.uniform(-1.0, 1.0, (1, 100))
    alone = np.hstack([np.array(made(x[:, i], u[:, i])) for i in range(100)])
    assert np.array_equal(np.array(made.map(100, "thread", 4)(x, u)), alone)
    blocks = made.jacobian().map(100, "thread", 4)(x, u, np.zeros((4, 100)))
    by = np.hstack([np.array(b).reshape(4, 100, -1).transpose(1, 0, 2).reshape(400, -1) for b in blocks])
    assert np.array_equal(by, np.vstack([jacobian_of(made, x[:, i], u[:, i]) for i in range(100)]))


def test_what_a_step_refuses(built: Build) -> None:
    kernel = built(eomgen.load_robot("one_link"), *kernels_for_step("rk4"))
    wrong: list[tuple[dict[str, Any], str]] = [
        ({"method": "euler"}, r"method: 'euler' has no derivatives; allowed: rk4, tsit5, implicit, rosenbrock"),
        ({"dt": 0.0}, r"dt: 0\.0 is no length of a step"),
        ({"dt": "1"}, r"dt: '1' is no length"),
        ({"dt": float("nan")}, r"dt: nan is no length"),
        ({"substeps": 0}, r"substeps: 0; allowed: a whole number from 1"),
        ({"substeps": 1.5}, r"substeps: 1\.5; allowed"),
        ({"drives": "joint1.x"}, r"drives: 'joint1\.x' is one name"),
        ({"drives": ("joint1.x", "joint1.x")}, r"drives: 'joint1\.x' stands there twice"),
        ({"called": "one_link_step"}, r"called: 'one_link_step' is no name"),
    ]
    for wanted, message in wrong:
        refused(InputError, message, step, kernel, **{"dt": 1e-3, **wanted})
    unknown: list[tuple[dict[str, Any], str]] = [
        ({"drives": ("joint2.x",)}, r"drives: 'joint2\.x' is unknown; allowed: 'joint1\.x'"),
        ({"parameters": ("mass",)}, r"parameters: 'mass' is unknown; allowed: 'gravity\.x'"),
        ({"method": "rosenbrock"}, r"built without adaptive_rollout, rosenbrock_gradient, rosenbrock_sensitivity"),
    ]
    for wanted, message in unknown:
        refused(UnknownNameError, message, step, kernel, **{"dt": 1e-3, **wanted})


@pytest.mark.soak
def test_kernels_that_steps_refuse(built: Build) -> None:
    """Joints of three rotations, which change charts, and single precision."""
    robot = random_robot(1045, joints=(1, 1), types=("free",), armature=False, forces=False)
    kernel = built(robot, *kernels_for_step("rk4"))
    refused(InputError, r"step: .* have 3-DOF rotation; allowed: robots without such joints", step, kernel, dt=1e-3)
    single = built(eomgen.load_robot("one_link"), *kernels_for_step("rk4"), dtype="float32")
    refused(InputError, "kernel of float32; allowed for CasADi: float64", step, single, dt=1e-3)
