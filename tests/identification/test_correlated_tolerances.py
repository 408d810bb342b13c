"""Correlated tolerances: covariances against hand formulas and samples of the exact model by NumPy, refusals."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from eomgen.cli import entry as cli
from eomgen.errors import DescriptionError, InputError
from eomgen.identification import ToleranceResult, load_tolerance, tolerance
from eomgen.identification.tolerances.correlations import groups_of, read_correlations, root_of
from eomgen.identification.tolerances.table import Table, Tolerance
from eomgen.pictures.measured.kinds import page_of
from eomgen.robot.value import Coordinate, Robot
from tests.support.measured_poses import chain
from tests.support.soak import soaked

pytestmark = pytest.mark.usefixtures("unoptimised")

Array = NDArray[np.float64]

PLANE = {"frames.tcp.x": {"deviation": 3e-4}, "base.x": {"deviation": 4e-4}}
COUNT = 40_000


def arm(seed: int) -> Robot:
    robot = chain(seed, "RPR")
    return replace(robot, joints=tuple(replace(joint, limits=(-0.5, 0.5)) for joint in robot.joints))


def pair(coefficient: float, first: str = "frames.tcp.x", second: str = "base.x") -> list[dict[str, Any]]:
    return [{"names": [first, second], "coefficient": coefficient}]


def random_table(rng: np.random.Generator) -> tuple[dict[str, Any], list[str], Array]:
    """A table with normal parameters, correlated at random in a random order, and bounded ones; names and matrix."""
    names = [f"joints.joint{j}.offset.{c}" for j in (1, 2, 3) for c in ("x", "y", "z", "alpha", "beta", "gamma")]
    chosen = rng.permutation([*names, "frames.tcp.x", "frames.tcp.beta", "base.y"])[:10].tolist()
    root = rng.normal(size=(6, 4))  # of rank 4: the edge of what can be
    block = root @ root.T
    matrix = block / np.sqrt(np.outer(np.diagonal(block), np.diagonal(block)))
    matrix = np.clip(0.5 * (matrix + matrix.T), -1.0, 1.0)
    np.fill_diagonal(matrix, 1.0)
    table: dict[str, Any] = {name: {"deviation": 1e-5 * (1.0 + rng.random())} for name in chosen[:8]}
    table |= {name: {"bound": 2e-5 * rng.random()} for name in chosen[8:]}
    return {**table, "correlations": [{"names": chosen[:6], "matrix": matrix.tolist()}]}, chosen[:6], matrix


def covariance_of(found: ToleranceResult, names: list[str], matrix: Array) -> Array:
    """C of the parameters, (K, K), by the formula: r_ij s_i s_j."""
    whole = np.diag(found.deviations**2)
    for i, first in enumerate(names):
        for j, second in enumerate(names):
            a, b = found.names.index(first), found.names.index(second)
            whole[a, b] = matrix[i, j] * found.deviations[a] * found.deviations[b]
    return whole


# Covariances


@pytest.mark.parametrize("coefficient", [-1.0, -0.5, 0.0, 0.6, 1.0])
def test_two_along_one_line(coefficient: float) -> None:
    """s^2 = a^2 + b^2 + 2 r a b of frame and base along one axis of an arm at home; all of it is along that line."""
    robot = chain(4, "R")
    placed = replace(robot, frames=tuple(replace(f, placement=type(f.placement)()) for f in robot.frames))
    found = tolerance(placed, {**PLANE, "correlations": pair(coefficient)})
    u, v = (found.sensitivities[0, :3, found.names.index(name)] for name in ("frames.tcp.x", "base.x"))
    cosine = float(u @ v)
    trace = 9e-8 + 16e-8 + 2.0 * coefficient * 12e-8 * cosine
    assert np.trace(found.covariance[0, :3, :3]) == pytest.approx(trace, rel=1e-9)
    common = coefficient * 12e-8 * cosine
    assert found.share("frames.tcp.x") == pytest.approx((9e-8 + common) / trace)
    assert found.share("base.x") == pytest.approx((16e-8 + common) / trace)


def test_one_line_by_hand() -> None:
    """Two along z of one link: 3 and 4 tenths of a millimetre make 5, 7, 1 of them, and regions of a normal number."""
    for coefficient, expected in ((0.0, 5e-4), (1.0, 7e-4), (-1.0, 1e-4), (0.6, np.sqrt(39.4e-8))):
        table = {"base.z": {"deviation": 3e-4}, "joints.*.placement.z": {"deviation": 4e-4}}
        found = tolerance("one_link", {**table, "correlations": pair(coefficient, "base.z", "joints.*.placement.z")})
        assert found.standard_deviations[0, :3].max() == pytest.approx(expected, rel=1e-12)
        for region in (found.radius, found.direction):
            assert region["position"][0] == pytest.approx(1.959963984540054 * expected, rel=1e-9)
        assert found.farthest["position"][0] == pytest.approx(3.0 * 7e-4)  # the box, whatever is correlated
        a, b = (9e-8 + coefficient * 12e-8) / expected**2, (16e-8 + coefficient * 12e-8) / expected**2
        shares = [found.share(name) for name in found.names]
        assert sorted(shares) == pytest.approx(sorted([a, b]), rel=1e-9)
        assert any("2 of 2 tolerances are correlated" in note for note in found.notes) == (coefficient != 0.0)


def test_what_is_compensated_altogether_has_no_shares() -> None:
    table = {"base.z": {"deviation": 3e-4}, "joints.*.placement.z": {"deviation": 3e-4}}
    found = tolerance("one_link", {**table, "correlations": pair(-1.0, "base.z", "joints.*.placement.z")})
    assert found.radius["position"][0] < 1e-15
    assert found.shares["position"].tolist() == [0.0, 0.0]
    assert np.abs(found.sample(100)[:, :3]).max() < 1e-15


@pytest.mark.parametrize("seed", soaked(range(3), (0,)))
def test_covariances_and_regions_are_those_of_samples(seed: int) -> None:
    """Of random arms by the exact model, with deviations that NumPy draws, and with those of ``sample``."""
    rng = np.random.default_rng(seed)
    table, names, matrix = random_table(rng)
    found = tolerance(arm(seed), table, random=2, seed=seed)
    C = covariance_of(found, names, matrix)
    np.testing.assert_allclose(
        found.covariance, found.sensitivities @ C @ found.sensitivities.transpose(0, 2, 1), rtol=1e-9, atol=1e-22
    )
    assert sum(found.shares["position"]) == pytest.approx(1.0)
    is_even = np.array([given.bound is not None for given in found.tolerances])
    y = rng.multivariate_normal(np.zeros(len(C)), C, COUNT).T
    y[is_even] = found.bounds[is_even, np.newaxis] * rng.uniform(-1.0, 1.0, (int(is_even.sum()), COUNT))
    for pose in range(2):
        for drawn in (found.exact.motions(y, np.full(COUNT, pose)), found.sample(COUNT, pose=pose, seed=seed)):
            near = np.cov(drawn.T) / np.outer(*2 * (found.standard_deviations[pose],))
            whole = found.covariance[pose] / np.outer(*2 * (found.standard_deviations[pose],))
            np.testing.assert_allclose(near, whole, atol=6.0 / np.sqrt(COUNT / 2))  # six standard deviations
            for part, at in (("position", slice(0, 3)), ("orientation", slice(3, 6))):
                along = np.linalg.eigh(found.covariance[pose, at, at])[1][:, -1]
                for sizes, region in (
                    (np.linalg.norm(drawn[:, at], axis=1), found.radius),
                    (np.abs(drawn[:, at] @ along), found.direction),
                ):
                    assert (sizes <= region[part][pose]).mean() == pytest.approx(0.95, abs=0.008)
    apart = tolerance(arm(seed), {**table, "correlations": []}, poses=found.q)
    np.testing.assert_array_equal(found.worst, apart.worst)
    assert not np.allclose(found.covariance, apart.covariance, rtol=0.05, atol=0.0)


def test_a_stiffness_is_correlated_with_another() -> None:
    """Stiffnesses that are off together, under a load: the motion of the tool with both of them off."""
    stiff = Coordinate(stiffness=4e5)
    robot = chain(4, "RRR").with_coordinates({"joint1": {"alpha": stiff}, "joint2": {"beta": stiff}})
    table = {"joints.*.*.stiffness": {"deviation": 0.02, "relative": True}}
    both = [{"names": ["joints.*.*.stiffness"], "coefficient": 1.0}]
    load = [0.0, 0.0, -500.0, 0.0, 0.0, 0.0]
    found = tolerance(robot, {**table, "correlations": both}, wrench=load)
    together = found.exact.motions(np.array([[80.0], [80.0]]), np.zeros(1, dtype=np.intp))[0] * 100.0
    np.testing.assert_allclose(found.standard_deviations[0], np.abs(together), rtol=1e-3)


def test_patterns_go_behind_names_in_any_order() -> None:
    table = {f"base.{c}": {"deviation": 1e-4} for c in "xyz"}
    entries = [{"names": ["base.*"], "coefficient": 0.3}, {"names": ["base.z", "base.x"], "coefficient": -0.2}]
    expected = np.array([[1.0, 0.3, -0.2], [0.3, 1.0, 0.3], [-0.2, 0.3, 1.0]])
    for given in (entries, entries[::-1]):
        found = tolerance("one_link", {**table, "correlations": given})
        np.testing.assert_array_equal(found.correlation, expected)
    assert found.correlated == (("base.x", "base.y", "base.z"),)


def test_groups_and_roots() -> None:
    """Roots of random matrices of any rank, in scattered groups; what is independent stays to the bit."""
    rng = np.random.default_rng(7)
    for rank in (1, 2, 4):
        R = np.eye(9)
        for group in ([7, 1, 4], [2, 8]):
            v = rng.normal(size=(len(group), rank))
            v /= np.linalg.norm(v, axis=1)[:, np.newaxis]
            R[np.ix_(group, group)] = v @ v.T
        np.fill_diagonal(R, 1.0)
        assert [group.tolist() for group in groups_of(R)] == [[1, 4, 7], [2, 8]]
        L = root_of(R)
        np.testing.assert_allclose(L @ L.T, R, atol=1e-14)
        np.testing.assert_array_equal(L[[0, 3, 5, 6]], np.eye(9)[[0, 3, 5, 6]])
    assert groups_of(np.eye(3)) == []


# Refusals


QUANTITIES = "base.x.deviation = 1e-4\nbase.y.deviation = 1e-4\nbase.z.deviation = 1e-4\nframes.tcp.x.bound = 1e-4\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("correlations = 3", r"t\.toml:5:\d+: correlations: 3; allowed: tables \[\[correlations\]\] with names"),
        ("[correlations]\nnames = []", "a table; allowed: tables"),
        ("correlations = [1]", r"correlations\[0\]: 1; allowed: a table with names and coefficient or matrix"),
        ("names = ['base.x', 'base.y']", r"t\.toml:5:\d+: correlations\[0\]: has neither coefficient nor matrix"),
        ("names = ['base.x']\ncoefficient = 0.1\nmatrix = [[1]]", "has coefficient and matrix; allowed: one of"),
        ("names = ['base.x', 'base.y']\ncoeficient = 0.1", r"\.coeficient: is unknown; did you mean 'coefficient'"),
        ("coefficient = 0.1", r"correlations\[0\]\.names: .*; allowed: an array of up to 400 names"),
        ("names = 'base.x'\ncoefficient = 0.1", r"names: 'base.x'; allowed: an array"),
        ("names = ['base.x', 3]\ncoefficient = 0.1", r"names: \['base\.x', 3\]; allowed: an array"),
        ("names = ['base.x']\ncoefficient = 0.1", "'base.x' is alone; allowed: at least two parameters"),
        ("names = ['base.x', 'base.*']\ncoefficient = 0.1", "'base.x' is there twice; allowed: once"),
        ("names = ['base.x', 'base.w']\ncoefficient = 0.1", "the table has no 'base.w'; did you mean 'base"),
        ("names = ['base.x', 'base.alpha']\ncoefficient = 0.1", "the table has no 'base.alpha'"),
        ("names = ['base.x', '*.x']\ncoefficient = 0.1", "'base.x' is there twice"),
        (
            "names = ['base.x', 'frames.*.x']\ncoefficient = 0.1",
            "'frames.tcp.x' is uniformly distributed within a bound; allowed: para",
        ),
        (
            "names = ['base.*']\ncoefficient = 1.1",
            r"t\.toml:7:\d+: .*coefficient: 1\.1; allowed: a number from",
        ),
        ("names = ['base.*']\ncoefficient = nan", "coefficient: nan; allowed: a number"),
        ("names = ['base.*']\ncoefficient = inf", "coefficient: inf; allowed: a number"),
        ("names = ['base.*']\ncoefficient = true", "coefficient: true; allowed: a number"),
        ("names = ['base.*']\nmatrix = [[1]]", r"has a name with '\*' beside a matrix"),
        ("names = ['base.x', 'base.y']\nmatrix = [[1, 0]]", "allowed: 2 rows of 2 numbers"),
        ("names = ['base.x', 'base.y']\nmatrix = [[1, 0], [0, 'a']]", r"row 1, column 1: 'a'; allowed: a number"),
        ("names = ['base.x', 'base.y']\nmatrix = [[1, 0], [0, 0.9]]", r"row 1, column 1: 0\.9; allowed: 1 on"),
        (
            "names = ['base.x', 'base.y']\nmatrix = [[1, 0.1], [0.2, 1]]",
            r"row 0, column 1: 0\.1, but 0\.2 the other way; allowed: symmetric",
        ),
        (
            "names = ['base.*']\ncoefficient = -0.6",
            r"correlations: the matrix of 'base\.[xyz]', 'base\.[xyz]', 'base\.[xyz]' has the eigenvalue -0\.2: ",
        ),
        (
            "names = ['base.x', 'base.y']\ncoefficient = 0.1\n[[correlations]]\nnames = ['base.y', 'base.x']\n"
            "coefficient = 0.1",
            r"correlations\[1\]\.names: 'base\.y', 'base\.x' are correlated twice; allowed: once",
        ),
    ],
)
def test_refusals(text: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "t.toml"
    head = "" if "correlations =" in text or text.startswith("[") else "[[correlations]]\n"
    path.write_text(QUANTITIES + head + text)
    with pytest.raises(DescriptionError, match=message):
        tolerance(arm(4), path)


WRONG = (
    *(np.ones(3), np.array([True]), "x", 10**400, np.nan, 1e300, object(), [], {}, 2, {"a": 1}, np.array(["a"]), None),
    *([[1], [1, 2]], 1j, b"x", {1: 2}, np.eye(3), np.full((2, 2), np.nan), ["\x1b", "\n"], [None], [[]], [["base.x"]]),
)


@pytest.mark.parametrize("place", ["all", "entry", "key", "names", "coefficient", "matrix", "element"])
def test_anything_given_is_refused_by_its_place(place: str) -> None:
    """Arrays, texts and huge numbers in the place of what belongs there, in a mapping: the table's error, printable."""
    given: dict[str, Any] = {"names": ["base.x", "base.y"]}
    for value in WRONG:
        entries: Any = {
            "all": value,
            "entry": [value],
            "key": [{str(value): 1.0}],
            "names": [{"names": value, "coefficient": 0.1}],
            "coefficient": [{**given, "coefficient": value}],
            "matrix": [{**given, "matrix": value}],
            "element": [{**given, "matrix": [[1.0, value], [value, 1.0]]}],
        }[place]
        if place == "all" and isinstance(value, list) and not value:
            continue  # none
        with pytest.raises(DescriptionError, match=r"tolerances: '?correlations.*; allowed: ") as caught:
            read_correlations(Table((Tolerance("base.x", 1.0), Tolerance("base.y", 1.0)), correlations=entries))
        assert str(caught.value).isascii()
        assert str(caught.value).isprintable()


def test_only_the_names_behind_a_negative_eigenvalue_are_said() -> None:
    table = {f"base.{c}": {"deviation": 1e-4} for c in ("x", "y", "z", "alpha")}
    entries = [
        {"names": ["base.x", "base.y"], "coefficient": 0.9},
        {"names": ["base.y", "base.z"], "coefficient": 0.9},
        {"names": ["base.x", "base.z"], "coefficient": -0.9},
        {"names": ["base.z", "base.alpha"], "coefficient": 0.01},
    ]
    with pytest.raises(DescriptionError) as caught:
        tolerance("one_link", {**table, "correlations": entries})
    assert "'base.alpha'" not in str(caught.value)
    assert all(f"'base.{c}'" in str(caught.value) for c in "xyz")


def test_allocation_is_of_independent_tolerances() -> None:
    found = tolerance(arm(4), {**PLANE, "correlations": pair(0.5)})
    with pytest.raises(InputError, match=r"accuracy: .*'frames\.tcp\.x'.* are correlated; allowed: tables of indep"):
        found.allocate(1e-4)
    assert tolerance(arm(4), {**PLANE, "correlations": pair(0.0)}).allocate(1e-3).radius <= 1e-3


# The result


def test_they_are_saved_shown_and_load_again(tmp_path: Path) -> None:
    table, _, _ = random_table(np.random.default_rng(11))
    found = tolerance(arm(4), table, random=2)
    again = load_tolerance(found.save(tmp_path / "found.json"))
    assert again.as_dict() == found.as_dict()
    np.testing.assert_array_equal(again.correlation, found.correlation)
    assert np.array_equal(again.sample(50), found.sample(50))
    assert "10 tolerances (6 correlated) at 2 poses" in found.lines()[0]
    assert json.loads(json.dumps(found.as_dict()))["correlations"][0]["matrix"][0][0] == 1.0
    assert "are correlated" in page_of(found).html()
    data = json.loads((tmp_path / "found.json").read_text())
    del data["correlations"]
    (tmp_path / "older.json").write_text(json.dumps(data))
    assert load_tolerance(tmp_path / "older.json").correlated == ()


def test_files_that_are_no_text_are_refused(tmp_path: Path) -> None:
    (tmp_path / "found.json").write_bytes(b'{"kind": "tolerance\xac"}')
    with pytest.raises(InputError, match=r"found\.json: cannot be read: .*; allowed: what its save wrote"):
        load_tolerance(tmp_path / "found.json")


def test_a_compensating_share_is_among_the_greatest() -> None:
    table = {"base.z": {"deviation": 3e-4}, "joints.*.placement.z": {"deviation": 4e-4}}
    found = tolerance("one_link", {**table, "correlations": pair(-1.0, "base.z", "joints.*.placement.z")})
    first, second = (found.shares["position"][k] for k in found.by_share)
    assert first == pytest.approx(4.0)
    assert second == pytest.approx(-3.0)


def test_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table = tmp_path / "t.toml"
    name = '"joints.*.offset.x"'
    table.write_text(f"{name} = {{ deviation = 1e-4 }}\n[[correlations]]\nnames = [{name}]\ncoefficient = 0.5\n")
    assert cli.main(["tolerance", "ur5", str(table), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    direct = tolerance("ur5", table)
    assert found["covariance"] == direct.covariance.tolist()
    assert len(found["correlations"][0]["names"]) == 6
    assert cli.main(["tolerance", "ur5", str(table), "--accuracy", "3e-4"]) == 1
    assert "are correlated; allowed" in capsys.readouterr().err
