"""Blocks of M and C by name, against traces on floats, Pinocchio and the map of zeros."""

from __future__ import annotations

import subprocess
import sys
from itertools import product
from pathlib import Path

import numpy as np
import pytest

import eomgen
from eomgen.codegen.joint.zeros import zero_map
from eomgen.errors import UnknownNameError
from eomgen.pipeline.stages import Options
from eomgen.robot.model import build_model
from eomgen.runtime.levels import BASE
from tests.oracles.pinocchio_models import PinocchioOracle
from tests.oracles.unpruned import brute_force
from tests.support.builds import Build
from tests.support.generic_robots import chain, generic
from tests.support.random_robots import random_robot, random_state
from tests.support.soak import soaked

pytestmark = pytest.mark.quick

KERNELS = ("mass_matrix", "christoffel")


@pytest.mark.soak
@pytest.mark.parametrize("seed", soaked(range(6), (0, 1)))
def test_blocks_of_random_robots(seed: int, built: Build) -> None:
    """Every block equals the traces of eqs. (11) and (12) on floats; absent are those that the geometry cannot help."""
    rng = np.random.default_rng(seed)
    robot = generic(random_robot(rng, joints=(2, 4), tree=seed % 2 == 1, armature=False), rng)
    kernel, model = built(robot, *KERNELS), build_model(robot)
    q = rng.uniform(0.2, 1.2, kernel.n)
    M, C = brute_force(model, q)
    blocks = kernel.blocks(q)
    where = {body.joint: list(body.indices) for body in model.bodies}
    for key in product(where, repeat=2):
        expected = M[np.ix_(*(where[name] for name in key))]
        assert (key in blocks.mass) == bool(np.abs(expected).max() > 1e-12)
        assert np.abs(blocks.mass.get(key, np.zeros_like(expected)) - expected).max() < 1e-12
    for key in product(where, repeat=3):
        expected = C[np.ix_(*(where[name] for name in key))]
        assert (key in blocks.christoffel) == bool(np.abs(expected).max() > 1e-12)
        assert np.abs(blocks.christoffel.get(key, np.zeros_like(expected)) - expected).max() < 1e-12
    for s, v in product(range(kernel.n), repeat=2):
        names = kernel.coordinates[s], kernel.coordinates[v]
        assert blocks.mass.get(names, 0.0) == pytest.approx(M[s, v], abs=1e-12)
        assert (names in blocks.mass) == zero_map(model).mass_matrix.mask[s, v]


def test_sum_over_the_papers_matrices_is_the_inertial_force_of_pinocchio(built: Build) -> None:
    """Eq. (10) term by term, with the kinds of coordinates as in the paper."""
    kinds = ("x", "y", "z", "alpha", "beta", "gamma")
    for seed in range(4):
        robot = random_robot(seed, joints=(2, 3), tree=seed == 2, armature=False)
        state, kernel, oracle = random_state(robot, seed), built(robot, *KERNELS), PinocchioOracle(robot)
        expected = oracle.mass_matrix(state.q) @ state.a + oracle.bias_force(state.q, state.v)
        blocks = kernel.blocks(state.q)

        def of(kind: str, values: np.ndarray, kernel: eomgen.Kernel = kernel) -> np.ndarray:
            by_name = dict(zip(kernel.coordinates, values, strict=True))
            return np.array([by_name.get(f"{joint}.{kind}", 0.0) for joint in kernel.joints])

        for i, s in enumerate(kernel.coordinates):
            total = sum(blocks.row(s, kind) @ of(kind, state.a) for kind in kinds)
            for v, w in product(kinds, repeat=2):
                total += of(v, state.v) @ blocks.matrix(s, v, w) @ of(w, state.v)
            assert total == pytest.approx(expected[i], abs=1e-10 * np.abs(expected).max())


def test_the_papers_robot(built: Build) -> None:
    """The coefficients under eqs. (17) and (18), m = l = 1; two states at once."""
    gamma = np.array([0.3, -1.1])
    blocks = built(eomgen.load_robot("one_link"), *KERNELS).blocks(np.stack([np.zeros(2), gamma], axis=1))
    assert np.allclose(blocks.mass["joint1.x", "joint1.gamma"], -np.sin(gamma) / 2)
    assert np.allclose(blocks.mass["joint1.gamma", "joint1.gamma"], 1 / 3)
    assert np.allclose(blocks.christoffel["joint1.x", "joint1.gamma", "joint1.gamma"], -np.cos(gamma) / 2)
    assert blocks.mass["joint1", "joint1"].shape == (2, 2, 2)
    assert blocks.mass["joint1.x", "joint1"].shape == (2, 2)
    assert blocks.row("joint1.x", "gamma").shape == (2, 1)
    assert np.allclose(blocks.matrix("joint1.x", "gamma", "gamma")[:, 0, 0], -np.cos(gamma) / 2)
    assert ("joint1.x", "joint1.x", "joint1.gamma") not in blocks.christoffel
    assert list(blocks.mass) == [("joint1", "joint1")]
    assert len(blocks.christoffel) == 1


@pytest.mark.soak
def test_36_coordinates_have_as_many_entries_as_the_map_says(built: Build) -> None:
    robot = chain(6)
    kernel = built(robot, *KERNELS)
    blocks = kernel.blocks(np.random.default_rng(0).uniform(0.2, 1.2, kernel.n))
    upper = np.triu(np.ones((36, 36), dtype=bool))
    assert int((blocks.christoffel.mask & upper).sum()) == 10_602
    assert np.array_equal(np.abs(blocks.christoffel.whole) > 1e-13, blocks.christoffel.mask)


def test_what_is_asked_wrongly_is_said(built: Build) -> None:
    blocks = built(chain(2), *KERNELS).blocks(np.zeros(12))
    for ask, words in (
        (lambda: blocks.mass["joint1", "jiont2"], ("jiont2", "joint2")),
        (lambda: blocks.mass.get(("joint1", "jiont2")), ("jiont2",)),
        (lambda: blocks.mass["joint1.x", "joint1.y"], ("vanishes identically", "joint1.x, joint1.y")),
        (lambda: blocks.mass["joint1"], ("tuple of 2",)),  # type: ignore[index]
        (lambda: blocks.row("joint1.x", "delta"), ("delta", "gamma")),
        (lambda: blocks.row("joint1", "x"), ("joint1", "coordinates")),
        (lambda: blocks.matrix("joint9.x", "x", "x"), ("joint9.x",)),
    ):
        with pytest.raises(UnknownNameError) as raised:
            ask()
        assert all(word in str(raised.value) for word in words)
    with pytest.raises(UnknownNameError, match="without the kernel christoffel"):
        built(chain(2), "mass_matrix").blocks(np.zeros(12))


@pytest.mark.soak
def test_a_generated_package_has_them_too(tmp_path: Path) -> None:
    eomgen.generate(eomgen.load_robot("one_link"), tmp_path, Options(flags=("-O0",), level=BASE))
    code = (
        "import sys, one_link; b = one_link.blocks([0.0, 0.3]); assert 'eomgen' not in sys.modules;"
        "one_link.parameters['gravity.y'] = -1.0; one_link.rollout([0.0, 0.0], [0.0, 0.0], [0.0, 0.0], 1e-3, 2);"
        "print(float(b.mass['joint1.x', 'joint1.x']), sorted(b.christoffel))"
    )
    found = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True)
    assert found.stdout == "1.0 [('joint1', 'joint1', 'joint1')]\n", found.stderr
