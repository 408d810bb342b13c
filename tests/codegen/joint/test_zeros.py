"""The zero map: the counts of the paper's hardest robot, and numbers that show it neither misses nor invents a zero."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

import eomgen
from eomgen.cli import entry as cli
from eomgen.codegen.joint import zeros
from eomgen.codegen.joint.zero_listing import ZeroReport, zero_report
from eomgen.codegen.joint.zeros import ZeroMap, zero_map
from eomgen.codegen.kernels.constraint_rows import vanishing_rows
from eomgen.robot.model import Model, build_model
from eomgen.robot.value import Coordinate, Coupling
from tests.oracles.unpruned import brute_force
from tests.support.bristled import bristled_arm
from tests.support.random_motors import geared_robot
from tests.support.random_robots import Array, random_robot, random_state
from tests.support.small_robots import chain, generic
from tests.support.soak import soaked

pytestmark = pytest.mark.quick


def check(model: Model, seed: int, tolerance: float = 1e-13) -> ZeroMap:
    """The masks equal the pattern of numbers over several states, and the count that of different numbers."""
    found = zero_map(model)
    rng = np.random.default_rng(seed)
    greatest_M, greatest_C = np.zeros((model.size,) * 2), np.zeros((model.size,) * 3)
    for _ in range(3):
        M, C = brute_force(model, rng.uniform(0.2, 1.2, model.size))
        greatest_M = np.maximum(greatest_M, np.abs(M) / np.abs(M).max())
        greatest_C = np.maximum(greatest_C, np.abs(C) / max(np.abs(C).max(), np.abs(M).max()))
    assert np.array_equal(greatest_M > tolerance, found.mass_matrix.mask)
    assert np.array_equal(greatest_C > tolerance, found.christoffel.mask)
    assert different_sizes(C) == found.independent
    return found


def test_counts_of_six_joints_with_six_coordinates() -> None:
    """The last paragraph of the errata's section on counts: every number of it comes from a structural rule."""
    found = zero_map(build_model(chain(6)))
    dropped = dict(found.christoffel.zeros)
    left = found.christoffel.total
    assert left == 23_976
    left -= dropped[zeros.LEMMA_7]
    assert left == 17_820
    left -= dropped[zeros.SHARPER]
    assert left == 11_016
    left -= dropped[zeros.GYRO] + dropped[zeros.COAXIAL]
    assert (dropped[zeros.GYRO], dropped[zeros.COAXIAL]) == (306, 108)
    assert left == found.christoffel.survivors == 10_602
    assert found.by_antisymmetry == 7_203
    assert found.independent == 7_203 - 165
    assert dropped[zeros.TREE] == 0
    assert dict(found.mass_matrix.zeros) == {zeros.TREE: 0, zeros.ORTHOGONAL: 18, zeros.COAXIAL: 6}
    assert (found.mass_matrix.total, found.mass_matrix.survivors) == (666, 642)


def test_counts_of_six_joints_are_those_of_numbers() -> None:
    """10,602 entries are not zero and 7,038 differ in size, for generic placements and inertias."""
    found = check(build_model(chain(6)), 1)
    assert (found.christoffel.survivors, found.independent) == (10_602, 7_038)


def different_sizes(C: Array) -> int:
    """How many different absolute values there are among the entries v <= w that are not zero."""
    upper = np.triu(np.ones(C.shape[1:], dtype=bool))
    sizes = np.sort(np.abs(C[:, upper]).ravel())
    sizes = sizes[sizes > 1e-13 * max(sizes[-1], 1.0)]
    return int((np.diff(sizes, prepend=-1.0) > 1e-11 * sizes[-1:]).sum()) if len(sizes) else 0


def test_antisymmetry_holds_in_numbers() -> None:
    model = build_model(chain(2))
    _, C = brute_force(model, np.random.default_rng(3).uniform(0.2, 1.2, model.size))
    for i in range(model.size):
        for k in range(model.size):
            for j in range(min(i, k) + 1):
                assert C[i, j, k] == pytest.approx(-C[k, i, j], abs=1e-13)


@pytest.mark.parametrize("seed", soaked(range(60), range(20)))
def test_map_equals_the_pattern_of_numbers(seed: int) -> None:
    """Any subset of coordinates, chains and trees: no zero is missed and none is claimed that is not there."""
    rng = np.random.default_rng(seed)
    robot = random_robot(rng, joints=(1, 4), tree=seed % 2 == 1, armature=False)
    check(build_model(generic(robot, rng)), seed)


def test_internal_states_have_no_rows() -> None:
    """M and C are those of the coordinates alone."""
    robot = bristled_arm()
    joints = [replace(x, coordinates={name: Coordinate() for name in x.coordinates}) for x in robot.joints]
    found, alone = (zero_map(build_model(x)) for x in (robot, replace(robot, joints=tuple(joints))))
    assert found.mass_matrix.mask.shape == (4, 4)
    assert np.array_equal(found.mass_matrix.mask, alone.mass_matrix.mask)
    assert np.array_equal(found.christoffel.mask, alone.christoffel.mask)


@pytest.mark.parametrize("leaders", [{"joint1.alpha": 2.0}, {"joint1.y": 0.5, "joint2.gamma": -1.5}])
def test_what_leaders_move_is_the_pattern_of_sums(leaders: dict[str, float]) -> None:
    """With followers M is S^T M S, and C likewise: an entry survives where one of the tree's own does that it sums."""
    robot = replace(chain(2), couplings=(Coupling("belt", "joint2.x", leaders),))
    model = build_model(robot)
    names, n = model.tree.coordinates, model.size
    S = np.array([[float(x == y) for y in model.coordinates] for x in names])
    S[names.index("joint2.x"), [model.coordinates.index(x) for x in leaders]] = list(leaders.values())
    M, C = brute_force(model.tree, np.random.default_rng(5).uniform(0.2, 1.2, len(names)))
    whole, found, moves = zero_map(model.tree), zero_map(model), S != 0.0
    assert np.abs((S.T @ M @ S)[~found.mass_matrix.mask]).max() < 1e-12
    assert np.abs(np.einsum("is,jv,kw,ijk->svw", S, S, S, C)[~found.christoffel.mask]).max() < 1e-12
    sums = np.einsum("is,jv,ij->sv", moves, moves, whole.mass_matrix.mask)
    assert np.array_equal(sums, found.mass_matrix.mask)
    sums = np.einsum("is,jv,kw,ijk->svw", moves, moves, moves, whole.christoffel.mask)
    assert np.array_equal(sums, found.christoffel.mask)
    upper = np.triu(np.ones((n, n), dtype=bool))
    for tally, entries in ((found.mass_matrix, upper), (found.christoffel, np.broadcast_to(upper, (n, n, n)))):
        assert tally.total == entries.sum()
        assert tally.survivors == (tally.mask & entries).sum()
        for place, (_, count) in enumerate(tally.zeros):
            assert count == (entries & (tally.reason == place)).sum()
        assert np.array_equal(tally.reason == -1, tally.mask)
    i, j, k = np.indices((n, n, n))
    pairs = found.christoffel.mask & (j <= np.minimum(i, k))  # C_i,jk = -C_k,ji
    assert found.independent == found.by_antisymmetry == found.christoffel.survivors - pairs.sum() // 2
    assert isinstance(found.independent, int)


def test_special_geometry_never_contradicts_the_map() -> None:
    """Right angles and thin rods make more zeros, never fewer."""
    for seed in range(20):
        robot = random_robot(seed, joints=(2, 4), tree=seed % 2 == 1, armature=False)
        model = build_model(robot)
        found = zero_map(model)
        M, C = brute_force(model, random_state(robot, seed).q)
        assert np.abs(M[~found.mass_matrix.mask]).max(initial=0.0) < 1e-12
        assert np.abs(C[~found.christoffel.mask]).max(initial=0.0) < 1e-12


def test_many_coordinates() -> None:
    assert zero_map(build_model(chain(8))).christoffel.total == 48 * 48 * 49 // 2


def test_report() -> None:
    found = zero_map(build_model(chain(6)))
    text = "\n".join(found.lines())
    for number in ("23,976", "6,156", "6,804", "306", "108", "10,602", "7,203", "7,038", "666", "642"):
        assert number in text
    assert "lemma (7)" in text
    assert zeros.TREE not in text  # a reason without zeros
    plain = json.loads(json.dumps(found.as_dict()))
    assert plain["christoffel"]["independent_by_antisymmetry"] == 7_203
    assert plain["christoffel"]["independent"] == 7_038
    assert plain["mass_matrix"] == {
        "total": 666,
        "zeros": [
            {"reason": zeros.TREE, "count": 0},
            {"reason": zeros.ORTHOGONAL, "count": 18},
            {"reason": zeros.COAXIAL, "count": 6},
        ],
        "survivors": 642,
    }


def test_reasons_stand_where_entries_vanish() -> None:
    """Every entry that does not survive has the reason under which it is counted; motors have their own."""
    robot = geared_robot(3, (2, 2))
    for model in (build_model(chain(2)), build_model(random_robot(5, joints=(4, 4), tree=True)), build_model(robot)):
        found = zero_map(model)
        for tally in (found.mass_matrix, found.christoffel):
            upper = np.broadcast_to(np.triu(np.ones((model.size,) * 2, dtype=bool)), tally.mask.shape)
            assert np.array_equal(tally.reason == -1, tally.mask)
            assert np.array_equal(tally.reason, np.swapaxes(tally.reason, -1, -2))
            for place, (_, count) in enumerate(tally.zeros):
                assert (tally.reason[upper] == place).sum() == count
            assert tally.total == upper.sum()
            assert tally.survivors == tally.mask[upper].sum()
    motors, n = len(model.motors), model.size
    assert found.mass_matrix.zeros[0] == (zeros.ROTOR, sum(n - 1 - i for i in range(motors)))
    assert found.christoffel.zeros[0] == (zeros.ROTOR, n * n * (n + 1) // 2 - (n - motors) ** 2 * (n - motors + 1) // 2)
    for motor in model.motors:
        assert found.mass_matrix.mask[motor].sum() == found.mass_matrix.mask[motor, motor] == 1
        assert not found.christoffel.mask[motor].any()
        assert not found.christoffel.mask[:, motor].any()


def expanded(report: ZeroReport, model: Model) -> tuple[dict[tuple[int, ...], str], dict[tuple[int, ...], str]]:
    """Reason of every zero by index, from the plain values; each is named once."""
    index = {name: i for i, name in enumerate(model.coordinates)}
    found = []
    for part in ("mass_matrix", "christoffel"):
        reasons: dict[tuple[int, ...], str] = {}
        for group in json.loads(json.dumps(report.as_dict()))[part]:
            for joints in group["joints"]:
                for zero in group["zeros"]:
                    for entry in zero["entries"]:
                        key = tuple(index[f"{j}.{c}"] for j, c in zip(joints, entry, strict=True))
                        assert key not in reasons
                        reasons[key] = zero["reason"]
        found.append(reasons)
    return found[0], found[1]


@pytest.mark.parametrize("seed", range(12))
def test_the_report_lists_exactly_the_zeros_of_numbers(seed: int) -> None:
    rng = np.random.default_rng(seed)
    robot = generic(random_robot(rng, joints=(1, 4), tree=seed % 2 == 1, armature=False), rng)
    model = build_model(robot)
    mass, christoffel = expanded(zero_report(model), model)
    M, C = brute_force(model, rng.uniform(0.2, 1.2, model.size))
    n = model.size
    upper = [(v, w) for v in range(n) for w in range(v, n)]
    assert set(mass) == {key for key in upper if abs(M[key]) < 1e-13 * np.abs(M).max()}
    size = max(np.abs(C).max(), np.abs(M).max())
    assert set(christoffel) == {(s, *key) for s in range(n) for key in upper if abs(C[(s, *key)]) < 1e-13 * size}


def test_reasons_are_those_that_are_counted() -> None:
    model = build_model(chain(6))
    zeros = zero_map(model)
    for found, tally in zip(expanded(zero_report(model), model), (zeros.mass_matrix, zeros.christoffel), strict=True):
        assert Counter(found.values()) == Counter({reason: count for reason, count in tally.zeros if count})


def test_it_is_readable_for_36_coordinates(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["info", "puma560_elastic", "--zeros"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) < 45
    assert max(map(len, lines)) <= 120
    text = "\n".join(lines)
    for words in ("lemma (7)", "sharper lemma", "coaxial", "orthogonal: xy xz yz", "joints 1,1,1 2,2,2"):
        assert words in text
    assert cli.main(["info", "one_link", "--zeros", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["mass_matrix"] == []


@pytest.mark.parametrize(
    ("name", "kinds"), [("four_bar", ("joint4.z", "joint4.alpha", "joint4.beta")), ("bennett", ()), ("one_link", ())]
)
def test_rows_of_loops_that_vanish(name: str, kinds: tuple[str, ...]) -> None:
    """Those of a planar loop that lead out of its plane; of a spatial one none."""
    model = build_model(eomgen.load_robot(name))
    rows = vanishing_rows(model)
    assert tuple(row for row, _ in rows) == kinds
    report = zero_report(model, rows)
    assert [entry["row"] for entry in report.as_dict().get("constraints", [])] == list(kinds)  # type: ignore[attr-defined]
    text = " ".join(report.lines())
    assert ("moves in a plane" in text) == bool(kinds)
    assert all(kind in text for kind in kinds)
