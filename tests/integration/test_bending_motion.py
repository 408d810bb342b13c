"""Links that bend in motion: energy, all methods, batches, gradients and derivatives of compiled kernels."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen import Kernel
from eomgen.robot.value import Coordinate, Joint, Link, Robot
from eomgen.state.springs import stiffness_matrix
from tests.support.bending_links import nested
from tests.support.bending_robots import Bending, bent
from tests.support.random_robots import Array, random_placement, random_rotation

COUPLED = ((300.0, 240.0), (240.0, 900.0))  # K of both links, J


def arm() -> Bending:
    """Two links that bend, one behind the other on revolute joints, with nodes; K couples modes, nothing dissipates."""
    rng = np.random.default_rng(11)
    links, joints, parent = [], [], "base"
    for name in ("upper", "fore"):
        J = random_rotation(rng) @ np.diag(rng.uniform(0.2, 0.4, 3))
        tensor = np.trace(J @ J.T) * np.eye(3) - J @ J.T
        inertia: Any = [tensor[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
        links.append(Link(name, 3.0, (0.3, 0.05, 0.1), nested(np.array(inertia))))
        placement = random_placement(rng)
        joints.append(Joint(f"to_{name}", parent, name, "revolute", placement, coordinates={"gamma": Coordinate()}))
        parent = name
    bending = bent(Robot("bending_arm", (1.0, -2.0, -9.0), tuple(links), tuple(joints)), 3, (2,), second=True)
    still = [
        replace(x, modes=replace(x.modes, D=((0.0, 0.0), (0.0, 0.0)), K=COUPLED))
        for x in bending.plain.links
        if x.modes is not None
    ]
    return replace(bending, plain=replace(bending.plain, links=tuple(still)))


@pytest.fixture(scope="module")
def kernel() -> Kernel:
    return eomgen.build(arm().robot, flags=("-O1",))


def start(kernel: Kernel) -> tuple[Array, Array]:
    rng = np.random.default_rng(2)
    modal = np.array(["mode" in name for name in kernel.coordinates])
    q, v = rng.uniform(-1.0, 1.0, (2, kernel.n))
    return np.where(modal, 0.02 * q, q), np.where(modal, 0.2 * v, v)


def test_energy_is_kept(kernel: Kernel) -> None:
    """Over 10 s, to 1e-9 of the kinetic energy that there is on the way."""
    q, v = start(kernel)
    motion = kernel.rollout(q, v, duration=10.0, samples=200, rtol=1e-11, method="tsit5")
    energies = kernel.energy(motion[0], motion[1])
    kinetic, total = energies[:, 0], energies.sum(axis=1)
    assert np.ptp(motion[0][:, 0]) > 0.3  # rad, so that it moves
    assert np.abs(total - total[0]).max() < 1e-9 * kinetic.max()


def test_all_methods_find_the_same_motion(kernel: Kernel) -> None:
    q, v = start(kernel)
    options: dict[str, Any] = {"duration": 0.5, "samples": 10}
    reference = kernel.rollout(q, v, method="tsit5", rtol=1e-11, **options)[0]
    for method, rtol, off in (("rosenbrock", 1e-8, 1e-6), ("radau", 1e-10, 1e-8)):
        found = kernel.rollout(q, v, method=method, rtol=rtol, **options)[0]
        assert np.abs(found - reference).max() < off, method
    ends = {
        (method, steps): np.abs(
            kernel.rollout(q, v, method=method, dt=0.5 / steps, steps=steps)[0][-1] - reference[-1]
        ).max()
        for method, steps in (("rk4", 500), ("rk4", 1000), ("implicit", 4000), ("implicit", 8000))
    }
    assert ends["rk4", 1000] < 1e-6
    assert ends["rk4", 500] / ends["rk4", 1000] == pytest.approx(16.0, rel=0.2)
    assert ends["implicit", 4000] / ends["implicit", 8000] == pytest.approx(2.0, rel=0.1)


def test_a_diagonal_beside_constants_goes_down_as_long_as_no_motion_gives_energy(kernel: Kernel) -> None:
    """300 and 900 beside 240: the matrix that is scaled to 1 has the eigenvalue 1 - 240 / sqrt(270,000) = 0.538."""
    name = "links.upper.modes.1.stiffness"
    with pytest.raises(eomgen.InputError, match=rf"{name}.*138\.5"):
        kernel.with_parameters({name: 138.0})
    assert stiffness_matrix(kernel.with_parameters({name: 139.0}))[1, 1] == 139.0


def test_stiffness_of_analyses_is_that_of_forces(kernel: Kernel) -> None:
    """Slopes of the springs' forces by differences, in a state in which no link weighs on them."""
    K, q = stiffness_matrix(kernel), np.zeros(kernel.n)
    h, found = 1e-3, []
    for e in np.eye(kernel.n):
        ahead, behind = (kernel.generalized_force(q + s * h * e, q) for s in (1, -1))
        weights = [kernel.gravity(q + s * h * e) for s in (1, -1)]
        found.append(-(ahead - behind + weights[0] - weights[1]) / (2.0 * h))
    modal = np.array(["mode" in name for name in kernel.coordinates])
    assert np.array_equal(K[np.ix_(modal, modal)], np.kron(np.eye(2), np.array(COUPLED)))
    assert np.abs(np.array(found) - K).max() < 1e-9 * K.max()


def test_frequencies_are_those_of_whole_matrices(kernel: Kernel) -> None:
    """Without weight, joints held: of M and K of the modes of both links."""
    weightless = kernel.with_parameters({f"gravity.{axis}": 0.0 for axis in "xyz"})
    found = eomgen.analysis.modes(arm().robot, kernel=weightless).frequencies
    modal = np.array(["mode" in name for name in kernel.coordinates])
    M = kernel.mass_matrix(np.zeros(kernel.n))[np.ix_(modal, modal)]
    squares = np.linalg.eigvals(np.linalg.solve(M, np.kron(np.eye(2), np.array(COUPLED))))
    assert found == pytest.approx(np.sqrt(np.sort(squares)) / (2.0 * np.pi), rel=1e-9)


def test_states_of_a_batch_are_those_alone(kernel: Kernel) -> None:
    rng = np.random.default_rng(5)
    q, v, u = 0.3 * rng.normal(size=(3, 9, kernel.n))
    for name, arguments in (("forward_dynamics", (q, v, u)), ("mass_matrix", (q,)), ("energy", (q, v))):
        together = getattr(kernel, name)(*arguments)
        for i in range(len(q)):
            assert np.array_equal(together[i], getattr(kernel, name)(*(x[i] for x in arguments)))


def test_derivatives_of_compiled_kernels(kernel: Kernel) -> None:
    """Products with Jacobians, forwards and backwards, are those of whole ones, and these those of differences."""
    rng = np.random.default_rng(6)
    q, v, u = 0.3 * rng.normal(size=(3, kernel.n))
    blocks = kernel.forward_dynamics_jacobian(q, v, u)
    rates, weights = rng.normal(size=(3, kernel.n)), rng.normal(size=kernel.n)
    along = sum(block @ rate for block, rate in zip(blocks, rates, strict=True))
    size = np.abs(along).max()
    assert np.abs(kernel.jvp("forward_dynamics", (q, v, u), tuple(rates)) - along).max() < 1e-11 * size
    for found, block in zip(kernel.vjp("forward_dynamics", (q, v, u), weights), blocks, strict=True):
        assert np.abs(found - weights @ block).max() < 1e-11 * max(1.0, np.abs(weights @ block).max())
    h = 1e-6
    ahead, behind = (
        kernel.forward_dynamics(q + s * h * rates[0], v + s * h * rates[1], u + s * h * rates[2]) for s in (1, -1)
    )
    assert np.abs((ahead - behind) / (2.0 * h) - along).max() < 1e-6 * size


@pytest.mark.soak
def test_gradients_of_a_motion(kernel: Kernel) -> None:
    q, v = start(kernel)
    target = np.zeros(kernel.n)

    def loss(_times: Any, q: Array, v: Array) -> tuple[float, Array, Array]:
        return 0.5 * float(((q[-1] - target) ** 2).sum()), _last(q, q[-1] - target), 0.0 * v

    for method, options in (("rk4", {"dt": 1e-3, "steps": 100}), ("implicit", {"dt": 1e-3, "steps": 100})):
        _, gradient = kernel.rollout_gradient(q, v, loss=loss, method=method, **options)  # type: ignore[arg-type]
        for label, at in (("q", q), ("v", v)):
            for k in (0, 1, kernel.n - 1):
                h, ends = 1e-6, []
                for sign in (1.0, -1.0):
                    moved = {"q": q, "v": v, label: at + sign * h * np.eye(kernel.n)[k]}
                    motion = kernel.rollout(moved["q"], moved["v"], method=method, **options)  # type: ignore[arg-type]
                    ends.append(loss(None, motion[0], motion[1])[0])
                assert gradient[label][k] == pytest.approx((ends[0] - ends[1]) / (2.0 * h), rel=1e-5, abs=1e-7)


def _last(like: Array, row: Array) -> Array:
    found = np.zeros_like(like)
    found[-1] = row
    return found
