"""Constants of links that bend, against sums over particles."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from eomgen.bending.constants import body_of, constants_of_masses, modal_damping

pytestmark = pytest.mark.quick

Array = NDArray[np.float64]


def random_bodies(seed: int, count: int = 5, modes: int = 3) -> dict[str, Array]:
    """Small bodies of eight particles each, and how they move: arguments of ``constants_of_masses``, and particles."""
    rng = np.random.default_rng(seed)
    offsets = rng.normal(size=(count, 8, 3))
    weights = rng.uniform(0.1, 1.0, size=(count, 8))
    offsets -= np.einsum("np,npi->ni", weights, offsets)[:, None] / weights.sum(axis=1)[:, None, None]
    psi = rng.normal(size=(count, 3, modes, modes))
    return {
        "masses": weights.sum(axis=1),
        "places": rng.normal(size=(count, 3)),
        "moments": np.einsum("np,npi,npj->nij", weights, offsets, offsets),
        "translations": rng.normal(size=(count, 3, modes)),
        "rotations": rng.normal(size=(count, 3, modes)),
        "second": psi + psi.transpose(0, 1, 3, 2),
        "offsets": offsets,
        "weights": weights,
    }


def test_masses_at_nodes_are_sums_over_particles() -> None:
    data = random_bodies(1)
    offsets, weights = data.pop("offsets"), data.pop("weights")
    found = constants_of_masses(**data)
    m = found.count
    H00, H0, P, Q = np.zeros((4, 4)), np.zeros((m, 4, 3)), np.zeros((m, m, 3, 3)), np.zeros((m, m, 4, 3))
    for n in range(len(weights)):
        for d, mass in zip(offsets[n], weights[n], strict=True):
            rho = np.append(data["places"][n] + d, 1.0)
            phi = [data["translations"][n, :, k] + np.cross(data["rotations"][n, :, k], d) for k in range(m)]
            H00 += mass * np.outer(rho, rho)
            for k in range(m):
                H0[k] += mass * np.outer(rho, phi[k])
                for j in range(m):
                    P[k, j] += mass * np.outer(phi[k], phi[j])
                    Q[k, j] += mass * np.outer(rho, data["second"][n, :, k, j])
    assert pytest.approx(H00, rel=1e-12, abs=1e-12) == found.H00
    assert pytest.approx(H0, rel=1e-12, abs=1e-12) == found.H0
    assert pytest.approx(P, rel=1e-12, abs=1e-12) == found.P
    # the particles of a body have the second order of its centre
    assert found.Q[:, :, 3] == pytest.approx(Q[:, :, 3], rel=1e-12, abs=1e-12)
    assert pytest.approx(Q, rel=1e-12, abs=1e-12) == found.Q
    assert found.masses == pytest.approx(np.einsum("klii->kl", P), rel=1e-12)
    assert constants_of_masses(**{**data, "second": None}).Q is None


def test_the_body_of_a_pseudo_inertia() -> None:
    """A rod along x about its middle, off the origin: Steiner's theorem."""
    com, mass, length = np.array([0.5, -0.2, 0.3]), 2.0, 1.2
    H = np.zeros((4, 4))
    H[:3, :3] = mass * np.outer(com, com)
    H[0, 0] += mass * length**2 / 12
    H[:3, 3] = H[3, :3] = mass * com
    H[3, 3] = mass
    found, center, inertia = body_of(H)
    assert found == mass
    assert center == pytest.approx(com)
    assert inertia == pytest.approx((0.0, 0.24, 0.24, 0.0, 0.0, 0.0), abs=1e-15)


def test_damping_of_matrices_is_that_of_their_modes() -> None:
    rng = np.random.default_rng(3)
    M, K = (x @ x.T + 0.5 * np.eye(4) for x in rng.normal(size=(2, 4, 4)))
    D = modal_damping(M, K, 0.03)
    values, X = np.linalg.eig(np.linalg.solve(M, K))
    X = X / np.sqrt(np.einsum("ik,ij,jk->k", X, M, X))
    assert pytest.approx(np.diag(0.06 * np.sqrt(values)), abs=1e-12) == X.T @ D @ X
    plain = modal_damping(np.diag([1.0, 4.0]), np.diag([9.0, 16.0]), 0.5)
    assert plain.tolist() == [[3.0, 0.0], [0.0, 8.0]]
