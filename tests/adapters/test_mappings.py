"""What adapters offer: exact derivatives of all functions, on NumPy arrays, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

import eomgen
from eomgen.adapters.mappings import FUNCTIONS, DifferentiableFunction, kernels_for
from eomgen.errors import InputError, UnknownNameError
from eomgen.pipeline.mechanisms import mechanism_kernels
from eomgen.robot.model import build_model
from tests.oracles.complex_step import complex_jacobian
from tests.support.adapter_samples import (
    BENDING,
    built_for,
    differences,
    functions_of,
    sample,
    second_differences,
    states,
)
from tests.support.builds import Build
from tests.support.figures import Figures
from tests.support.random_robots import random_robot, seeds
from tests.support.refusals import refused
from tests.support.soak import WHOLE

pytestmark = pytest.mark.quick


@pytest.mark.parametrize("seed", [4100, *seeds(4101, 0, 59), pytest.param(BENDING, marks=pytest.mark.soak)])
def test_derivatives_are_those_of_complex_steps(seed: int, built: Build, figures: Figures) -> None:
    """Of all functions by all arguments; of frames, whose programs are parts, those of central differences."""
    robot = sample(seed)
    kernel = built_for(robot, built)
    given = states(robot, kernel, seed)
    for function in functions_of(robot, kernel):
        arrays = {name: given[name] for name in function.reads}
        for at, (label, block) in enumerate(zip(arrays, function.derivatives(*arrays.values()), strict=True)):
            assert block.shape == (*function.output, *arrays[label].shape)
            if function.frame is None:
                expected = complex_jacobian(robot, function.name, arrays, label).reshape(block.shape)
                kind, limit = "complex step", 1e-11
                if function.name == "forward_dynamics":
                    condition = float(np.linalg.cond(kernel.mass_matrix(given["q"])))
                    limit = max(limit, 100.0 * float(np.finfo(float).eps) * condition)
            else:
                expected = differences(function, list(arrays.values()), at)
                kind, limit = "difference", 1e-7
            size = max(float(np.abs(expected).max()), 1.0)  # of the terms that cancel
            error = float(np.abs(block - expected).max()) / size
            figures.at_most(f"{kind} of {function.name} by {label}", error, limit)
        figures.count("functions")


@pytest.mark.parametrize("seed", [*seeds(4100, 1, 30), pytest.param(BENDING, marks=pytest.mark.soak)])
def test_second_derivatives_are_those_of_the_first(seed: int, built: Build, figures: Figures) -> None:
    """Of all functions against central differences of the exact Jacobian, and of weighted results; zeros are zeros."""
    robot = sample(seed)
    kernel = built_for(robot, built)
    given, rng = states(robot, kernel, seed), np.random.default_rng(seed)
    for function in functions_of(robot, kernel):
        arrays = [given[name] for name in function.reads]
        second, weights = function.second_derivatives(*arrays), rng.uniform(-1.0, 1.0, function.output)
        expected = second_differences(function, arrays)
        size = max(float(np.abs(expected).max()), float(np.abs(function.jacobian(*arrays)).max()), 1.0)
        figures.at_most(f"second of {function.name}", float(np.abs(second - expected).max()) / size, 2e-7)
        hessian = function.hessian(arrays, weights)
        weighted = np.tensordot(weights, second, axes=weights.ndim)
        figures.at_most("weighted", float(np.abs(hessian - weighted).max()) / size, 1e-12)
        gradient = np.concatenate([x.ravel() for x in function.gradient(arrays, weights)])
        along = np.tensordot(weights, function.jacobian(*arrays), axes=weights.ndim)
        figures.at_most("gradient", float(np.abs(gradient - along).max()) / size, 1e-11)
        ends = np.cumsum([0, *(array.size for array in arrays)])
        for at in range(len(arrays)):
            for by in range(len(arrays)):
                mask = function.second_pattern(at, by).reshape(arrays[at].size, arrays[by].size)
                assert not np.any(second[..., ends[at] : ends[at + 1], ends[by] : ends[by + 1]][..., ~mask])
        figures.count("functions")


@pytest.mark.parametrize("seed", seeds(4100, 1, 3))
def test_patterns_hold_what_is_not_zero(seed: int, built: Build) -> None:
    """Zeros of the pattern are zeros of every state, and something else stays."""
    robot = sample(seed)
    kernel = built_for(robot, built)
    sparse = 0
    for function in functions_of(robot, kernel):
        mask, masks = function.patterns()
        for state in range(3):
            given = states(robot, kernel, seed + state)
            arrays = [given[name] for name in function.reads]
            assert not np.any(function.value(*arrays)[~mask])
            for pattern, block in zip(masks, function.derivatives(*arrays), strict=True):
                assert pattern.shape == block.shape
                assert not np.any(block[~pattern])
                sparse += int((~pattern).any())
    assert sparse > 0


def test_batches(built: Build) -> None:
    """A state of a batch is that state; one state beside a batch stands for all of it."""
    robot = sample(4100)
    kernel = built_for(robot, built)
    many = [states(robot, kernel, seed) for seed in range(5)]
    for function in functions_of(robot, kernel):
        arrays = [np.array([given[name] for given in many]) for name in function.reads]
        blocks = function.derivatives(*arrays)
        for i in range(5):
            for block, alone in zip(blocks, function.derivatives(*(x[i] for x in arrays)), strict=True):
                assert np.allclose(block[i], alone, rtol=1e-11, atol=1e-11)
        if len(arrays) > 1:
            for block, alone in zip(function.derivatives(arrays[0], *(x[0] for x in arrays[1:])), blocks, strict=True):
                assert block.shape == alone.shape
                assert np.allclose(block[0], alone[0], rtol=1e-11, atol=1e-11)


def test_parameters_are_those_of_then(built: Build) -> None:
    robot = eomgen.load_robot("one_link")
    kernel = built(robot, *kernels_for("inverse_dynamics"))
    q = np.array([0.01, 0.3])
    function = DifferentiableFunction(kernel, "inverse_dynamics")
    before = kernel.inverse_dynamics(q, 0 * q, 0 * q)
    kernel.parameters["joints.joint1.x.stiffness"] = 1.0
    assert np.array_equal(function.value(q, 0 * q, 0 * q), before)
    assert not np.array_equal(kernel.inverse_dynamics(q, 0 * q, 0 * q), before)


def test_refusals(built: Build) -> None:
    robot = random_robot(4300, joints=(1, 2))
    kernel = built(robot, *kernels_for("frame_pose", "generalized_force"))
    refused(UnknownNameError, r"function: 'sums' is unknown; allowed: residual", DifferentiableFunction, kernel, "sums")
    with pytest.raises(UnknownNameError, match=r"built without mass_matrix, christoffel; allowed: kernels=\('mass"):
        DifferentiableFunction(kernel, "mass_matrix")
    with pytest.raises(InputError, match=r"frame: frame_pose got None; allowed: one of tcp"):
        DifferentiableFunction(kernel, "frame_pose")
    with pytest.raises(InputError, match=r"frame: generalized_force got 'tcp'; allowed: none"):
        DifferentiableFunction(kernel, "generalized_force", "tcp")
    with pytest.raises(UnknownNameError, match="'tpc' is unknown; did you mean 'tcp'"):
        DifferentiableFunction(kernel, "frame_pose", "tpc")
    refused(InputError, r"order: 3 is no order of derivatives here; allowed: 1, 2", kernels_for, "energy", order=3)
    with pytest.raises(UnknownNameError, match=r"built without frame_pose_adjoint, frame_pose_hessian; allowed"):
        DifferentiableFunction(built(robot, *kernels_for("frame_pose", order=1)), "frame_pose", "tcp").require_second()


@pytest.mark.soak
def test_accelerations_with_loops(built: Build) -> None:
    """Closed as they are, also beside closed states, where optimisers look; open on demand."""
    robot, names = eomgen.load_robot("four_bar"), ("forward_dynamics", "constraint_forces", "constraint_jacobian")
    kernel = built(robot, *kernels_for(*names, closed=True), *kernels_for(*names, cut=True), "forward_dynamics")
    q, v, u = np.array(build_model(robot).home), np.zeros(3), np.array([2.0, -1.0, 0.5])
    closed, tree = (DifferentiableFunction(kernel, "forward_dynamics", cut=cut) for cut in (False, True))
    np.testing.assert_allclose(closed.value(q, v, u), kernel.forward_dynamics(q, v, u), rtol=1e-13)
    np.testing.assert_allclose(tree.value(q, v, u), kernel.forward_dynamics(q, v, u, cut=True), rtol=1e-13)
    arrays = [q + 1e-3, np.array([1.0, -0.4, 0.3]), u]
    for name in names:
        function = DifferentiableFunction(kernel, name)
        arguments = arrays[: len(function.reads)]
        assert function.value(*arguments).shape == function.output
        for at, block in enumerate(function.derivatives(*arguments)):
            expected = differences(function, arguments, at)
            np.testing.assert_allclose(block, expected, atol=1e-7 * max(np.abs(expected).max(), 1.0))
    without = built(robot, "forward_dynamics")
    with pytest.raises(UnknownNameError, match="built without constrained_dynamics, constrained_dynamics_tangent"):
        DifferentiableFunction(without, "forward_dynamics")
    assert set(kernels_for("constraint", order=1)) == set(FUNCTIONS["constraint"].kernels)


@pytest.mark.soak
@pytest.mark.parametrize("name", ["four_bar", *(["gough"] if WHOLE else [])])
def test_drives_with_loops(name: str, built: Build) -> None:
    """Drives of the kernel on a motion, with derivatives there and beside it."""
    robot = eomgen.load_robot(name)
    asked = ("inverse_dynamics", "constraint_forces")
    kernel = built(robot, *kernels_for(*asked, closed=True), "inverse_dynamics", *mechanism_kernels(robot))
    rng, q = np.random.default_rng(3), kernel.assemble(np.array(build_model(robot).home))
    v = kernel.project_velocity(q, rng.uniform(-1.0, 1.0, kernel.n))
    J, a = kernel.functions.constraint_jacobian(q), rng.uniform(-1.0, 1.0, kernel.n)
    a -= np.linalg.pinv(J) @ (J @ a + kernel.functions.constraint_bias(q, v))
    drives = DifferentiableFunction(kernel, "inverse_dynamics")
    assert drives.reads == ("q", "v", "a")
    np.testing.assert_array_equal(drives.value(q, v, a), kernel.inverse_dynamics(q, v, a))
    for function in (DifferentiableFunction(kernel, x) for x in asked):
        for state in ([q, v, a], [q + 1e-3, v, a]):
            for at, block in enumerate(function.derivatives(*state)):
                expected = differences(function, state, at)
                np.testing.assert_allclose(block, expected, atol=1e-8 * max(np.abs(expected).max(), 1.0))
    idle = [x not in robot.driven for x in kernel.coordinates]
    assert not any(block[idle].any() for block in drives.derivatives(q, v, a))
