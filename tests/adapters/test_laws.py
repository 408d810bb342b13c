"""Adapters of robots whose forces are matrices, or that have internal states."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from eomgen.adapters import casadi as for_casadi
from eomgen.adapters import jax as for_jax
from eomgen.adapters.mappings import DifferentiableFunction, kernels_for
from eomgen.codegen.forces.bushings import Bushings
from eomgen.codegen.forces.element import ForceElement
from eomgen.codegen.forces.internal_states.coordinate_laws import InternalStateLaws
from eomgen.codegen.forces.joint_damping import JointDampers
from eomgen.codegen.forces.joint_stiffness import JointStiffnesses
from eomgen.description.load import robot_from_toml
from eomgen.kernel.complete import Kernel
from eomgen.runtime.raw import Array
from tests.support.adapter_samples import differences, second_differences
from tests.support.bristles import bent, bristle_arm, bristle_linkage
from tests.support.builds import Build
from tests.support.every_element import robot_with
from tests.support.optional import needs

pytestmark = pytest.mark.usefixtures("doubles")
casadi, jax, jnp = needs("casadi"), needs("jax"), needs("jax.numpy")

NAMES = ("forward_dynamics", "generalized_force", "energy", "mass_matrix", "residual", "inverse_dynamics")
FAMILIES = (InternalStateLaws, JointStiffnesses, JointDampers, Bushings)


def states(kernel: Kernel, seed: int) -> dict[str, Array]:
    rng = np.random.default_rng(seed)
    return {name: rng.uniform(-0.3, 0.3, kernel.raw.shapes[name]) for name in "qvzau" if name in kernel.raw.shapes}


def rates_of(kernel: Kernel, arrays: list[Array]) -> Array:
    """Accelerations, then derivatives of internal states."""
    q, v, *z, u = arrays
    a = kernel.forward_dynamics(q, v, u, *z)
    return np.r_[a, kernel.internal_state_derivatives(q, v, *z, u)] if z else a


@pytest.mark.soak
@pytest.mark.parametrize("family", FAMILIES)
def test_functions_have_the_kernels_numbers_and_exact_derivatives(family: type[ForceElement], built: Build) -> None:
    """In Python, in CasADi and in JAX; the friction of bristles by z, too."""
    robot = robot_from_toml(robot_with(family))
    kernel = built(robot, *kernels_for(*NAMES))
    assert bool(kernel.internal_states) == (family is InternalStateLaws)
    given = states(kernel, 3)
    for name in NAMES:
        there = DifferentiableFunction(kernel, name)
        arrays = [given[label] for label in there.reads]
        blocks, value = there.derivatives(*arrays), there.value(*arrays)
        for at, block in enumerate(blocks):
            expected = differences(there, arrays, at)
            np.testing.assert_allclose(block, expected, rtol=0.0, atol=1e-7 * max(1.0, np.abs(expected).max()))
        second, expected = there.second_derivatives(*arrays), second_differences(there, arrays)
        np.testing.assert_allclose(second, expected, rtol=0.0, atol=1e-6 * max(1.0, np.abs(expected).max()))
        made = for_casadi.function(kernel, name, flags=("-O0", "-Werror"))
        np.testing.assert_allclose(np.array(made(*arrays)).reshape(there.output), value, rtol=1e-14, atol=1e-14)
        found = made.jacobian()(*arrays, 0)
        for block, wanted in zip(found if isinstance(found, tuple) else (found,), blocks, strict=True):
            whole = np.moveaxis(wanted, 0, 1) if value.ndim == 2 else wanted  # by columns
            np.testing.assert_allclose(np.array(block), whole.reshape(value.size, -1), rtol=1e-12, atol=1e-12)
        traced = for_jax.function(kernel, name)
        np.testing.assert_array_equal(jax.jit(traced)(*arrays), value)
        slopes = jax.jacfwd(traced, argnums=tuple(range(len(arrays))))(*arrays)
        for block, wanted in zip(slopes, blocks, strict=True):
            np.testing.assert_allclose(block, wanted, rtol=1e-12, atol=1e-12)


@pytest.mark.soak
@pytest.mark.parametrize("family", FAMILIES)
def test_what_jax_compiles_itself_has_the_kernels_numbers(family: type[ForceElement], built: Build) -> None:
    """Derivatives by parameters too: of an entry of a matrix, of the stiffness of bristles."""
    robot = robot_from_toml(robot_with(family))
    kernel = built(robot, "forward_dynamics")
    native, x = for_jax.native(robot, ("forward_dynamics",)), states(kernel, 4)
    arrays = [array for label, array in x.items() if label != "a"]
    found = jax.jit(native.forward_dynamics)(*arrays)
    np.testing.assert_allclose(found, rates_of(kernel, arrays), rtol=1e-11, atol=1e-11)
    key = {
        JointStiffnesses: "joints.neck.stiffness.x.beta",
        JointDampers: "joints.wrist.damping.z.alpha",
        Bushings: "bushings.block.stiffness.x.beta",
        InternalStateLaws: "joints.knuckle.beta.friction.bristle_stiffness",
    }[family]
    size, ends = float(kernel.parameters[key]), []
    slope = jax.jacfwd(lambda x: native.forward_dynamics(*arrays, p={key: x}))(size)
    for sign in (1.0, -1.0):
        ends.append(rates_of(kernel.replaced(parameters={key: size * (1.0 + sign * 1e-5)}), arrays))
    expected = (ends[0] - ends[1]) / (2e-5 * size)
    assert np.abs(expected).max() > 1e-3
    np.testing.assert_allclose(slope, expected, rtol=1e-6, atol=1e-6 * np.abs(expected).max())


@pytest.mark.soak
@pytest.mark.parametrize("method", ["rk4", "rosenbrock"])
def test_rollouts_with_states_have_gradients(method: str, built: Build) -> None:
    """By what bristles are bent by at the beginning, too."""
    gradient = {"rk4": "explicit_gradient", "rosenbrock": "rosenbrock_gradient"}[method]
    kernel = built(bristle_arm(), "rollout", "adaptive_rollout", gradient)
    options: dict[str, Any] = {"dt": 1e-4, "steps": 40} if method == "rk4" else {"duration": 4e-3, "rtol": 1e-10}
    q, v, u, z = bent(kernel)
    made = for_jax.rollout(kernel, method=method, **options)
    motion = kernel.rollout(q, v, u, z=z, method=method, **options)
    for found, wanted in zip(made(q, v, z, u), (*motion, motion.z), strict=True):
        np.testing.assert_array_equal(found, wanted)
    weights = np.random.default_rng(5).uniform(-1.0, 1.0, v.size + z.size)

    def end(x: Any) -> Any:
        _, *rates = made(q, x[: v.size], x[v.size :], u)
        return jnp.sum(weights * jnp.concatenate([x[-1] for x in rates]))

    x = np.r_[v, z]
    slope = np.asarray(jax.grad(end)(x))
    steps = np.r_[np.full(q.size, 1e-6), np.full(z.size, 1e-9)]
    for unit in np.diag(steps):
        difference = float(end(x + unit) - end(x - unit)) / (2.0 * unit.sum())
        assert slope @ unit / unit.sum() == pytest.approx(difference, rel=1e-4, abs=1e-5)
    assert np.abs(slope[q.size :]).min() > 1e-3
    both = jax.vmap(made, in_axes=(None, None, 0, None))(q, v, np.stack([z, -z]), u)
    np.testing.assert_array_equal(both[2][0], motion.z)


def test_mechanisms_with_states(built: Build) -> None:
    """Accelerations of the closed mechanism and rates of its states, with their derivatives."""
    names = ("forward_dynamics", "constraint")
    kernel = built(bristle_linkage(), *kernels_for(*names, closed=True, order=1), "forward_dynamics")
    q, _, u, z = bent(kernel)
    q = kernel.home[: q.size]
    arrays = [q, 0.0 * q, z, u]
    there, made = (
        DifferentiableFunction(kernel, "forward_dynamics"),
        for_casadi.function(kernel, "forward_dynamics", order=1, flags=("-O0", "-Werror")),
    )
    assert there.reads == ("q", "v", "z", "u")
    value = there.value(*arrays)
    np.testing.assert_allclose(value[q.size :], kernel.internal_state_derivatives(*arrays), rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(np.array(made(*arrays))[:, 0], value, rtol=1e-12, atol=1e-12)
    blocks = there.derivatives(*arrays)
    found = made.jacobian()(*arrays, 0)
    for block, wanted in zip(found, blocks, strict=True):
        np.testing.assert_allclose(np.array(block), wanted, rtol=1e-9, atol=1e-9)
    assert np.abs(blocks[2]).max() > 1.0  # by z
    constraint = for_casadi.function(kernel, "constraint", order=1, flags=("-O0", "-Werror"))
    assert np.abs(np.array(constraint(q))).max() < 1e-9
    assert casadi.DM(constraint.jacobian()(q, 0)).shape == (constraint.size_out(0)[0], kernel.n)
