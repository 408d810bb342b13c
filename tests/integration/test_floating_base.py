"""Robots on floating bases against Pinocchio's free flyer, at the poles of the base's angles and over them."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from numpy.typing import NDArray

from eomgen.description.load import robot_from_urdf
from eomgen.errors import EomgenWarning
from eomgen.integration import integrate
from eomgen.runtime.kernel import Kernel
from tests.description.test_floating import HEAVY
from tests.oracles.flyers import Flyer
from tests.support.builds import Build
from tests.support.description_samples import example_urdfs

pytestmark = pytest.mark.quick

Array = NDArray[np.float64]
BASE = "floating_base"
TURN = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])  # Q of theory's "Near +-pi/2"
KERNELS = ("forward_dynamics", "mass_matrix", "inverse_dynamics", "residual_jacobian", "energy", "rollout")
ROBOTS = ["small", pytest.param("talos_reduced", marks=pytest.mark.soak)]  # 8 coordinates and 38


def text_of(name: str) -> str:
    """A URDF whose root has a mass: two hinges, or a humanoid."""
    if name == "small":
        return HEAVY
    (path,) = (path for path in example_urdfs() if path.stem == name)
    return path.read_text(encoding="utf-8")


def kernel_of(name: str, built: Build) -> Kernel:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", EomgenWarning)
        robot = robot_from_urdf(text_of(name), floating_base=True, inertia="warn")
    kernel = built(robot, *KERNELS)
    assert list(kernel.raw.turning) == [BASE]
    assert kernel.coordinates[:6] == tuple(f"{BASE}.{x}" for x in ("x", "y", "z", "alpha", "beta", "gamma"))
    return kernel


def random_states(n: int, seed: int) -> tuple[Array, Array, Array]:
    """q and v of 12 states, and the drives of the joints."""
    rng = np.random.default_rng(seed)
    q, v = rng.uniform(-1.0, 1.0, (2, 12, n))
    return q, v, rng.uniform(-5.0, 5.0, (12, n - 6))


def worst(flyer: Flyer, kernel: Kernel, q: Array, v: Array, drives: Array) -> float:
    """Largest difference of accelerations, of the largest of a state."""
    a = kernel.forward_dynamics(q, v, np.concatenate([np.zeros((len(q), 6)), drives], axis=1))
    found = np.array([flyer.slopes(*state) for state in zip(q, v, a, strict=True)])
    expected = np.array(
        [
            flyer.accelerations(flyer.configuration(x), flyer.rates(x, y), u)
            for x, y, u in zip(q, v, drives, strict=True)
        ]
    )
    return float((np.abs(found - expected).max(axis=1) / np.abs(expected).max(axis=1)).max())


@pytest.mark.parametrize("name", ROBOTS)
def test_accelerations(name: str, built: Build) -> None:
    """In described angles, and in those that integrations take beside the poles, at which the described ones are."""
    kernel, text = kernel_of(name, built), text_of(name)
    q, v, drives = random_states(kernel.n, 6)
    assert worst(Flyer(text), kernel, q, v, drives) < 1e-10
    q[:6, 3:5] = 0.0  # sin(beta) is cos(alpha) cos(beta) of the other angles
    q[6:, 3:5] = [np.pi, 0.0] + 1e-7 * q[6:, 3:5]
    flyer = Flyer(text, TURN)
    poles = [flyer.described(x)[0, 2] for x in q]
    np.testing.assert_allclose(poles, np.repeat([1.0, -1.0], 6), atol=1e-12)
    assert worst(flyer, kernel.with_turned({BASE}), q, v, drives) < 1e-10


@pytest.mark.parametrize("name", ROBOTS)
def test_a_fall_over_the_pole(name: str, built: Build) -> None:
    """The base tumbles while joints swing: rollouts and integrations end where the free flyer does."""
    kernel, flyer = kernel_of(name, built), Flyer(text_of(name))
    rng = np.random.default_rng(8)
    q, v = np.zeros((2, kernel.n))
    q[3:6], v[3:6] = [0.2, 1.2, -0.3], [0.1, 5.0, 0.2]
    q[6:], v[6:] = rng.uniform(-0.3, 0.3, (2, kernel.n - 6))
    dt, steps = 2e-4, 1000
    rolled = kernel.rollout(q, v, np.zeros(kernel.n), dt, steps)
    found = integrate(kernel, q, v, dt * steps, method="DOP853", rtol=1e-10, output_step=dt)
    assert q[4] < 0.5 * np.pi
    assert np.abs(np.cos(found.q[:, 4])).min() < 0.1
    x, w = flyer.motion(flyer.configuration(q), flyer.rates(q, v), np.zeros(kernel.n - 6), dt, steps)
    for ends in (rolled, (found.q, found.v)):
        q, v = ends[0][-1], ends[1][-1]
        assert flyer.apart(flyer.configuration(q), x) < 1e-8
        assert np.abs(flyer.rates(q, v) - w).max() < 1e-7 * np.abs(w).max()
    quaternion = found.quaternion(BASE)
    assert np.abs(np.diff(quaternion, axis=0)).max() < dt * np.abs(w).max()
    turned = quaternion[-1, [1, 2, 3, 0]]
    assert min(np.abs(turned - sign * x[3:7]).max() for sign in (1.0, -1.0)) < 1e-8
