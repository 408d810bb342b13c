"""The zero map of links that bend: numbers that show that it invents no zero, and of links alone misses none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from eomgen.codegen.joint import zeros
from eomgen.codegen.joint.zero_listing import zero_report
from eomgen.codegen.joint.zeros import ZeroMap, zero_map
from eomgen.robot.model import build_model
from tests.codegen.joint.test_zeros import different_sizes
from tests.support.bending_robots import Bending, bent, with_mode_follower
from tests.support.random_robots import Array, random_robot, seeds
from tests.support.small_robots import generic

pytestmark = pytest.mark.quick


def draw(seed: int, *, second: bool) -> Bending:
    rng = np.random.default_rng(seed)
    robot = random_robot(rng, joints=(1, 3), max_coordinates=3, tree=seed % 2 == 1, armature=False)
    return bent(generic(robot, rng), seed, second=second, generic=True)


def numbers(bending: Bending, seed: int) -> tuple[ZeroMap, Array, Array, Array]:
    """The map, the greatest entries of M and C over some states, and the last C."""
    oracle, rng = bending.oracle(), np.random.default_rng(seed)
    greatest_M, greatest_C = np.zeros((oracle.size,) * 2), np.zeros((oracle.size,) * 3)
    for _ in range(3):
        q = rng.uniform(0.2, 1.2, oracle.size)
        M, C = oracle.mass_matrix(q), oracle.christoffel(q)
        greatest_M = np.maximum(greatest_M, np.abs(M) / np.abs(M).max())
        greatest_C = np.maximum(greatest_C, np.abs(C) / max(np.abs(C).max(), np.abs(M).max()))
    return zero_map(build_model(bending.robot)), greatest_M, greatest_C, C


@pytest.mark.parametrize("second", [False, True], ids=["linear", "second order"])
@pytest.mark.parametrize("seed", seeds(0, 4, 24))
def test_map_of_links_alone_equals_the_pattern_of_numbers(seed: int, second: bool) -> None:
    """Joints stand on the frames of links: nothing follows modes, and each zero of M and C is in the map."""
    bending = draw(seed, second=second)
    links = tuple(
        replace(x, modes=None if x.modes is None else replace(x.modes, nodes=())) for x in bending.plain.links
    )
    alone = Bending(replace(bending.plain, links=links), bending.clouds, {}, {})
    found, M, C, last = numbers(alone, seed)
    assert np.array_equal(found.mass_matrix.mask, M > 1e-13)
    assert np.array_equal(found.christoffel.mask, C > 1e-13)
    assert found.independent == different_sizes(last)
    counts = dict(found.christoffel.zeros)
    assert counts[zeros.MODAL_MASS if second else zeros.MODES] > 0


@pytest.mark.parametrize("seed", seeds(50, 8, 40))
def test_no_zero_is_invented_where_nodes_follow_modes(seed: int) -> None:
    bending = draw(seed, second=seed % 4 < 2)
    if seed % 3 == 2:
        bending = with_mode_follower(bending, seed)
    found, M, C, _ = numbers(bending, seed)
    assert M[~found.mass_matrix.mask].max(initial=0.0) < 1e-13
    assert C[~found.christoffel.mask].max(initial=0.0) < 1e-13
    assert found.christoffel.survivors < found.christoffel.total


def test_zeros_of_modes_are_listed_by_name() -> None:
    """Blocks of a link's modes stand beside those of the joint that carries it."""
    links = draw(3, second=False).plain.links
    alone = tuple(replace(x, modes=None if x.modes is None else replace(x.modes, nodes=())) for x in links)
    model = build_model(replace(draw(3, second=False).plain, links=alone))
    report = zero_report(model)
    text = "\n".join(report.lines())
    assert "g gamma, m1 mode1;" in text
    assert f"{zeros.MODES}: *:m1m1" in text.replace("\n      ", " ")
    listed = [
        entry
        for group in report.christoffel
        for reason, entries in group.zeros
        for entry in entries
        if reason == zeros.MODES
        for _ in group.joints
    ]
    assert len(listed) == dict(zero_map(model).christoffel.zeros)[zeros.MODES]
