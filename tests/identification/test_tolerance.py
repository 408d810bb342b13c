"""Tolerances: regions, worst cases against the exact model, shares, allocation, correlations, flexible links."""

from __future__ import annotations

import json
import time
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import quad
from scipy.optimize import minimize
from scipy.special import ndtr

import eomgen
from eomgen.analysis import deflection
from eomgen.description.load import robot_from_toml
from eomgen.errors import ArrayError, DescriptionError, InputError, UnknownNameError
from eomgen.identification import ToleranceResult, load_tolerance, tolerance
from eomgen.identification.tolerances import allocation
from eomgen.identification.tolerances.allocation import least
from eomgen.identification.tolerances.correlations import groups_of, read_correlations, root_of
from eomgen.identification.tolerances.regions import ellipsoids, mixed_quantiles, quantile_of_normal, radii
from eomgen.identification.tolerances.solve import tolerance_quantities
from eomgen.identification.tolerances.table import Table, Tolerance, meant, read_table
from eomgen.identification.tolerances.vertices import farthest
from eomgen.pictures import plot_tolerance
from eomgen.pictures.measured.kinds import page_of
from eomgen.robot.value import Coordinate, Robot
from tests.support.commands import command, facts
from tests.support.joint_table import frame_table, joint_table, link_table
from tests.support.measured_poses import chain
from tests.support.refusals import refused
from tests.support.soak import soaked
from tests.support.text_files import text_file

pytestmark = [pytest.mark.quick, pytest.mark.usefixtures("unoptimised")]

Array = NDArray[np.float64]

OFFSETS = {"joints.*.offset.*": {"deviation": 2e-5}}
TABLE = {
    **OFFSETS,
    "joints.joint3.offset.gamma": {"deviation": 3e-4},  # written out: goes before the pattern
    "joints.joint2.axis.alpha": {"deviation": 1e-4},
    "joints.joint3.length": {"deviation": 5e-5},
    "frames": {"tcp": {"x": {"deviation": 1e-4}, "beta": {"deviation": 2e-4}}},
    "base.x": {"deviation": 5e-5},
}


def arm(seed: int = 4) -> Robot:
    robot = chain(seed, "RPR")
    return replace(robot, joints=tuple(replace(joint, limits=(-0.5, 0.5)) for joint in robot.joints))


def soft() -> Robot:
    stiff = Coordinate(stiffness=4e5)
    return chain(4, "RRR").with_coordinates({"joint1": {"alpha": stiff}, "joint2": {"beta": stiff}})


# Names


@pytest.mark.parametrize(
    ("pattern", "names"),
    [
        ("*.arm.*", {"joints.arm.x", "joints.arm.gamma"}),
        ("joints.*.x", {"joints.arm.x", "joints.ooo.x"}),
        ("joints.*", set()),  # a star is no dot
        ("*", {"base"}),
        ("b*e", {"base"}),
        ("ba*ase", set()),  # pieces do not overlap
        ("**s*", {"base"}),
        ("joints.**.*mm*", {"joints.arm.gamma"}),
        ("joints.o*o*o.x", {"joints.ooo.x"}),
        ("joints.o*o*o*o.x", set()),
        ("joints.a[r]m.*", set()),
        ("base", {"base"}),
        ("Base", set()),
    ],
)
def test_names_with_stars(pattern: str, names: set[str]) -> None:
    assert set(meant(pattern, ["base", "joints.arm.x", "joints.arm.gamma", "joints.ooo.x"])) == names


def test_many_stars_take_no_time() -> None:
    name = f"joints.{'o' * 60}.x"
    begun = time.process_time()
    assert meant(f"joints.{'*o' * 20}*p.x", [name]) == []
    assert meant(f"joints.{'*o' * 20}*.x", [name]) == [name]
    assert time.process_time() - begun < 1.0


def endless() -> dict[str, Any]:
    table: dict[str, Any] = {}
    table["a"] = table
    return table


@pytest.mark.parametrize(
    ("table", "reason"),
    [
        ({"x" * 100_000: {"bound": 1.0}}, "there is no such parameter"),
        ({"\x1b" * 1000: {"bound": 1.0}}, "there is no such parameter"),
        ({"base.x": {"y" * 100_000: 1.0}}, "is unknown"),
        ({"base.x": {"bound": 1.0}, "correlations": [{"y" * 100_000: 1.0}]}, "is unknown"),
        (endless(), "a.a.a: is nested too deeply"),
    ],
)
def test_long_names_and_endless_tables_are_refused_in_short(table: dict[str, Any], reason: str) -> None:
    with pytest.raises(DescriptionError, match=reason) as caught:
        read_correlations(read_table(table, ["base.x"]))
    message = str(caught.value)
    assert message.isascii()
    assert message.isprintable()
    assert len(message) < 400
    assert "allowed" in message


# Regions


@pytest.mark.parametrize(
    ("variances", "radius"),
    [
        ((1.0, 1.0, 1.0), 2.795483),  # the root of the quantile of chi-square with 3, 2 and 1 degrees of freedom
        ((4.0, 4.0, 0.0), 2.0 * 2.447747),
        ((0.0, 9.0, 0.0), 3.0 * 1.959964),
        ((0.0, 0.0, 0.0), 0.0),
    ],
)
def test_radii_of_known_distributions(variances: tuple[float, ...], radius: float) -> None:
    turn = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
    covariance = turn @ np.diag(variances) @ turn.T
    assert radii(covariance[np.newaxis], 0.95)[0] == pytest.approx(radius, rel=1e-5, abs=1e-12)


@pytest.mark.parametrize("probability", soaked((0.5, 0.95, 0.999), (0.95,)))
def test_radii_of_unequal_variances(probability: float) -> None:
    """Against Imhof's integral of the characteristic function."""
    rng = np.random.default_rng(1)
    for variances in ((1.0, 0.5, 0.1), (1.0, 0.9, 1e-3), (1.0, 1e-4, 1e-6), tuple(rng.random(3))):
        r = float(radii(np.diag(variances)[np.newaxis], probability)[0])
        assert imhof(np.array(variances), r**2) == pytest.approx(probability, abs=2e-5)


@pytest.mark.parametrize("variances", [(1.0, 2.0, 3.0), (0.0, 1.0, 4.0), (0.0, 0.0, 1.0), (0.0, 0.0, 0.0)])
def test_ellipsoids_hold_samples(variances: tuple[float, ...]) -> None:
    turn = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
    covariance = turn @ np.diag(variances) @ turn.T
    half, axes = (found[0] for found in ellipsoids(covariance[np.newaxis], 0.9))
    assert np.linalg.det(axes) == pytest.approx(1.0)
    drawn = np.random.default_rng(4).normal(size=(40_000, 3)) * np.sqrt(variances) @ turn.T
    along = drawn @ axes
    is_wide = half > 0.0
    assert is_wide.sum() == np.count_nonzero(variances)
    assert np.abs(along[:, ~is_wide]).max(initial=0.0) < 1e-12
    if is_wide.any():
        inside = ((along[:, is_wide] / half[is_wide]) ** 2).sum(axis=1) < 1.0
        assert inside.mean() == pytest.approx(0.9, abs=0.006)  # four standard deviations of the share


def imhof(variances: Array, x: float) -> float:
    """Probability that the sum of variances times squares of normal numbers is below x."""

    def integrand(u: float) -> float:
        theta = 0.5 * np.arctan(variances * u).sum() - 0.5 * x * u
        return float(np.sin(theta) / (u * np.prod((1.0 + (variances * u) ** 2) ** 0.25)))

    value = quad(integrand, 0.0, 4e3, limit=20_000, epsabs=1e-6)[0]
    return 0.5 - value / np.pi


def in_plane(bound: float, deviation: float, r: float) -> float:
    """Probability that a uniform number within a bound and a normal one stay below r together, by quadrature."""

    def inside(x: float) -> float:
        return float(ndtr((r - x) / deviation) - ndtr((-r - x) / deviation)) / (2.0 * bound)

    return quad(inside, -bound, bound, limit=500, epsabs=1e-10)[0]


@pytest.mark.parametrize("probability", [0.3, 0.683, 0.95, 0.999])
def test_mixed_quantiles(probability: float) -> None:
    """Against closed forms, quadrature, and sums of many uniform numbers, which are normal."""
    found = mixed_quantiles(np.array([0.0, 2.0, 0.0]), np.array([[3.0, 0.0], [0.0, 0.0], [1.0, 1.0]]), probability)
    assert found[0] == pytest.approx(3.0 * probability, rel=1e-9)
    assert found[1] == pytest.approx(2.0 * quantile_of_normal(probability), rel=1e-9)
    assert found[2] == pytest.approx(2.0 * (1.0 - np.sqrt(1.0 - probability)), rel=1e-4)  # a triangle
    for bound, deviation in ((1.0, 0.01), (1.0, 0.3), (0.2, 1.0)):
        r = float(mixed_quantiles(np.array([deviation]), np.array([[bound]]), probability)[0])
        assert in_plane(bound, deviation, r) == pytest.approx(probability, abs=8e-4)
    many = float(mixed_quantiles(np.zeros(1), np.full((1, 300), 0.1), probability)[0])
    assert many == pytest.approx(np.sqrt(300.0 / 3.0) * 0.1 * quantile_of_normal(probability), rel=2e-3)


@pytest.mark.soak
def test_regions_stay_within_what_bounds_allow() -> None:
    """They pass neither the physical maximum nor fall below what one direction needs, at any probability."""
    for confidence in (0.3, 0.683, 0.95, 0.999):
        line = tolerance("one_link", {"frames.*.x": {"bound": 3e-4}}, confidence=confidence)
        assert line.radius["position"] == pytest.approx([3e-4 * confidence], rel=1e-9)
        assert line.direction["position"] == pytest.approx([3e-4 * confidence], rel=1e-9)
    plane = tolerance("one_link", {"frames.*.x": {"bound": 3e-4}, "frames.*.y": {"bound": 1e-6}})
    assert plane.radius["position"][0] <= plane.farthest["position"][0] == pytest.approx(3e-4, rel=1e-4)
    assert any("passes what bounds allow" in note for note in plane.notes)
    rng = np.random.default_rng(5)
    for seed in range(2):
        kinds = {name: "bound" if rng.random() < 0.6 else "deviation" for name in "xyz"}
        sizes = {name: {kind: 1e-4 * rng.random()} for name, kind in kinds.items()}
        table = {f"frames.tcp.{name}": size for name, size in sizes.items()} | {"joints.joint2.length": {"bound": 2e-4}}
        for confidence in (0.3, 0.95, 0.999):
            found = tolerance(arm(), table, random=3, seed=seed, confidence=confidence)
            for pose in range(3):
                drawn = found.sample(20_000, pose=pose, seed=pose)[:, :3]
                along = np.linalg.eigh(found.covariance[pose, :3, :3])[1][:, -1]
                share = (np.abs(drawn @ along) <= found.direction["position"][pose]).mean()
                near = 5.0 * np.sqrt(confidence * (1 - confidence) / 20_000) + 1e-3
                assert share == pytest.approx(confidence, abs=near)
                if all("bound" in size for size in sizes.values()):
                    assert found.radius["position"][pose] <= found.farthest["position"][pose] * (1 + 1e-12)
                assert found.radius["position"][pose] >= found.direction["position"][pose] * (1 - 1e-12)


def off_of_samples(found: ToleranceResult, count: int) -> float:
    """The greatest relative difference of standard deviations and radii from those of samples of the exact model."""
    worst = 0.0
    for pose in range(len(found.q)):
        drawn = found.sample(count, pose=pose, seed=pose)
        expected = found.standard_deviations[pose]
        moved = expected > 1e-6 * expected.max()
        worst = max(worst, float(np.abs(drawn.std(axis=0)[moved] / expected[moved] - 1.0).max()))
        for part, at in (("position", slice(0, 3)), ("orientation", slice(3, 6))):
            radius = np.quantile(np.linalg.norm(drawn[:, at], axis=1), found.confidence)
            worst = max(worst, float(abs(radius / found.radius[part][pose] - 1.0)))
    return worst


def example(kind: str) -> ToleranceResult:
    if kind == "rigid":
        return tolerance(arm(), TABLE, random=2)
    if kind == "soft":
        loose = {"joints.joint1.alpha.stiffness": {"deviation": 0.02, "relative": True}}
        return tolerance(soft(), {**OFFSETS, **loose}, random=2, wrench=[0.0, 0.0, -200.0, 0.0, 0.0, 0.0])
    return tolerance("four_bar", {"joints.*.offset.x": {"deviation": 1e-4}, "loops.*.offset.x": {"deviation": 1e-4}})


@pytest.mark.parametrize(
    ("count", "about"), [(10_000, 0.03), pytest.param(100_000, 0.01, marks=pytest.mark.soak)], ids=["some", "many"]
)
@pytest.mark.parametrize("kind", ["rigid", "soft", "closed"])
def test_regions_are_those_of_samples(kind: str, count: int, about: float) -> None:
    found = example(kind)
    assert found.nonlinearity < 0.01
    assert not found.notes
    assert off_of_samples(found, count) < about


def test_samples_see_a_region_that_is_too_small() -> None:
    found = example("rigid")
    assert off_of_samples(replace(found, covariance=0.9 * found.covariance), 10_000) > 0.03


def test_a_bound_is_an_even_distribution() -> None:
    found = tolerance("one_link", {"frames.*.x": {"bound": 3e-4}, "frames.*.y": {"deviation": 1e-4}})
    drawn = np.linalg.norm(found.sample(10_000)[:, :3], axis=1)
    assert found.deviations.tolist() == pytest.approx([3e-4 / np.sqrt(3.0), 1e-4])
    assert found.bounds.tolist() == pytest.approx([3e-4, 3e-4])
    assert drawn.std() > 0.0
    assert any("uniform within its bound" in note for note in found.notes)
    assert np.abs(found.sample(10_000).std(axis=0)[:3]).max() == pytest.approx(3e-4 / np.sqrt(3.0), rel=0.03)


def test_what_a_length_and_a_placement_do() -> None:
    """Those of a robot that is described with the longer link, or with the frame elsewhere; clearance as an offset."""
    robot = chain(4, "RRR")
    q = np.array([[0.3, -0.7, 1.1]])
    joint = robot.joint("joint2")
    xyz = np.array(joint.placement.xyz)
    for name, off in (("length", xyz / np.linalg.norm(xyz)), ("placement.y", np.array([0.0, 1.0, 0.0]))):
        moved = replace(joint, placement=replace(joint.placement, xyz=tuple((xyz + 1e-3 * off).tolist())))
        longer = replace(robot, joints=tuple(moved if one is joint else one for one in robot.joints))
        before, after = (tip(one, q) for one in (robot, longer))
        found = tolerance(robot, {f"joints.joint2.{name}": {"bound": 1e-3}}, poses=q)
        np.testing.assert_allclose(1e-3 * found.sensitivities[0, :3, 0], after - before, atol=1e-14)
    a, b = (tolerance(robot, {f"joints.joint2.{n}": {"bound": 1e-3}}, poses=q) for n in ("x.clearance", "offset.x"))
    np.testing.assert_array_equal(a.worst, b.worst)


def tip(robot: Robot, q: Array) -> Array:
    found = tolerance(robot, {"base.x": {"bound": 0.0}}, poses=q)
    return found.exact.poses(np.zeros((1, 1)), np.array([0]))[1][0]


def test_a_softer_joint_deflects_by_what_statics_says() -> None:
    """A stiffness that is off by 10 %: 1/k changes by k^-2, and the tool with it, here under a vertical load."""
    table = {"joints.joint1.alpha.stiffness": {"bound": 4e4}}
    found = tolerance(soft(), table, wrench=[0.0, 0.0, -2000.0, 0.0, 0.0, 0.0])
    away = found.exact.motions(np.array([[4e4, -4e4]]), np.zeros(2, dtype=np.intp))
    np.testing.assert_allclose(found.sensitivities[0, :, 0] * 8e4, away[0] - away[1], rtol=0.02)
    assert found.notes[0].startswith("not linear")  # 1/k is bent: 1/0.9 against 1/1.1


# Worst cases


@pytest.mark.parametrize("kind", ["space", "plane", "line", "coplanar triples", "zero"])
def test_farthest_is_that_of_all_signs(kind: str) -> None:
    rng = np.random.default_rng(5)
    for count in (1, 2, 5, 9):
        generators = rng.normal(size=(3, count))
        if kind in ("plane", "line", "zero"):
            generators[{"plane": 2, "line": 1, "zero": 0}[kind] :] = 0.0
        if kind == "coplanar triples":
            generators = np.round(generators)
        length, signs = farthest(generators)
        every = np.array(list(product((1.0, -1.0), repeat=count)))
        assert length == pytest.approx(np.linalg.norm(every @ generators.T, axis=1).max(), rel=1e-12)
        assert np.linalg.norm(generators @ signs) == pytest.approx(length, rel=1e-12)


def test_worst_case_is_that_of_all_vertices() -> None:
    """Of a small arm by the exact model: every component, and the distance."""
    names = ["joint1.offset.gamma", "joint1.offset.x", "joint2.offset.z", "joint2.axis.beta", "joint3.offset.alpha"]
    table = {f"joints.{name}": {"bound": 1e-5 * (k + 1)} for k, name in enumerate([*names, "joint3.length"])}
    found = tolerance(arm(), table, random=3)
    signs = np.array(list(product((1.0, -1.0), repeat=6))).T
    for pose in range(3):
        off = found.exact.motions(signs * found.bounds[:, np.newaxis], np.full(64, pose))
        np.testing.assert_allclose(np.abs(off).max(axis=0), found.worst[pose], rtol=2e-3)
        for part, at in (("position", slice(0, 3)), ("orientation", slice(3, 6))):
            lengths = np.linalg.norm(off[:, at], axis=1)
            assert lengths.max() == pytest.approx(found.farthest[part][pose], rel=2e-3)
        if pose == found.worst_pose:
            assert found.exact_worst == pytest.approx(np.linalg.norm(off[:, :3], axis=1).max(), rel=1e-12)


def test_it_warns_where_it_is_not_linear() -> None:
    """A gross tolerance, and one that only its square shows: a stretched arm and its length along the arm."""
    found = tolerance(arm(), {**OFFSETS, "joints.joint3.offset.gamma": {"bound": 0.3}})
    assert found.notes[0].startswith("not linear: the exact model is off the linear one by ")
    assert "joints.joint3.offset.gamma" in found.notes[0]
    assert not tolerance(arm(), OFFSETS).notes


def test_shares_add_up() -> None:
    found = example("rigid")
    for part in ("position", "orientation"):
        assert found.shares[part].sum() == pytest.approx(1.0)
    alone = tolerance(arm(), {"base.x": TABLE["base.x"]}, poses=found.q)
    whole = np.trace(found.covariance[:, :3, :3], axis1=1, axis2=2).sum()
    part = np.trace(alone.covariance[:, :3, :3], axis1=1, axis2=2).sum()
    assert found.share("base.x") == pytest.approx(part / whole)
    assert found.share("base.x", "orientation") == 0.0
    refused(UnknownNameError, r"base\.y.*base\.x", found.share, "base.y")


# Poses


def test_poses_are_given_by_name_at_random_or_along_a_motion(tmp_path: Path) -> None:
    robot = arm()
    by_name = tolerance(robot, OFFSETS, poses={"joint2.z": 0.2})
    assert by_name.q.tolist() == [[0.0, 0.2, 0.0]]
    drawn = tolerance(robot, OFFSETS, random=50, seed=3)
    assert drawn.q.shape == (50, 3)
    assert np.abs(drawn.q).max() <= 0.5
    motion = tmp_path / "motion.csv"
    header = "t," + ",".join(by_name.coordinates)
    rows = np.linspace(0.0, 1.0, 5)[:, np.newaxis] * [1.0, 0.1, 0.2, 0.3]
    np.savetxt(motion, rows, "%.6f", ",", header=header, comments="")
    assert tolerance(robot, OFFSETS, along=motion).q[-1].tolist() == pytest.approx([0.1, 0.2, 0.3])


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"poses": [1.0]}, ArrayError, r"poses: got shape \(1,\); allowed: finite numbers of shape \(3,\)"),
        ({"poses": {"joint9.z": 1.0}}, UnknownNameError, r"no coordinate 'joint9\.z'"),
        ({"poses": {"joint2.z": "a"}}, InputError, r"joint2\.z: 'a'; allowed: a finite number"),
        ({"random": -1}, InputError, "random: -1; allowed: a whole number"),
        ({"random": 2, "seed": -1}, InputError, "seed: -1; allowed"),
        ({"random": 2, "poses": [0.0] * 3}, InputError, "more than one of them"),
        ({"wrench": [1.0]}, ArrayError, r"wrench: .*allowed: 6 finite"),
        ({"confidence": 1.0}, InputError, "confidence: 1.0; allowed"),
        ({"frame": "tip"}, UnknownNameError, "frame: 'tip' is unknown; known: .*tcp"),
        ({"robot": chain(4, "RPR"), "random": 2}, InputError, r"random: joint2\.z has no limits"),
    ],
)
def test_refusals_of_arguments(options: dict[str, Any], error: type[Exception], message: str) -> None:
    refused(error, message, tolerance, **{"robot": arm(), "table": OFFSETS, **options})


# Tables


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "joints.joint2.offset.w.bound = 1.0",
            r"t\.toml:1:22: joints\.joint2\.offset\.w: .*no such parameter; did you",
        ),
        (
            "[joints.joint2.offset]\nz = 3",
            r"t\.toml:1:\d+: joints\.joint2\.offset: there is no such parameter; did you",
        ),
        ("base.x = { deviation = -1.0 }", r"t\.toml:1:\d+: base\.x\.deviation: -1\.0; allowed"),
        ("base.x = { bound = nan }", r"base\.x\.bound: nan; allowed: a finite"),
        ("base.x = { bound = 1e-3, deviation = 1e-3 }", r"base\.x: has deviation and bound; allowed: one of"),
        ("base.x = { cost = 1.0 }", r"base\.x: has neither deviation nor bound"),
        ("base.x = { bound = 1.0, cost = 0.0 }", r"base\.x\.cost: 0\.0; allowed: a number above 0"),
        ("base.x = { bound = 1.0, fixed = 1 }", r"base\.x\.fixed: 1; allowed: true or false"),
        ("base.x = { bnd = 1.0 }", r"base\.x\.bnd: is unknown; did you mean 'bound'"),
        ("base.x = { bound = 1.0, relative = true }", r"base\.x: is relative, but nothing is described"),
        ("'base.x'.bound = 1.0\n[base]\nx.bound = 1.0", r"base\.x: is there twice"),
        ("", "no parameter is named; allowed: 'base"),
        ("joints = [", "not valid TOML"),
    ],
)
def test_refusals_of_tables(text: str, message: str, tmp_path: Path) -> None:
    path = text_file(tmp_path / "t.toml", text)
    refused(DescriptionError, message, tolerance, arm(), path)


def test_a_stiffness_cannot_vanish() -> None:
    for entry in ({"bound": 4e5}, {"deviation": 1e5}):
        with pytest.raises(DescriptionError, match="or the stiffness may vanish"):
            tolerance(soft(), {"joints.joint1.alpha.stiffness": entry})


# Allocation


def test_the_least_cost_is_that_of_a_general_method() -> None:
    rng = np.random.default_rng(2)
    for poses in (1, 4):
        A, costs = rng.random((poses, 6)) ** 3, rng.uniform(0.5, 3.0, 6)
        fixed = np.array([False] * 5 + [True])
        V = 0.5 * A[:, :5].sum(axis=1) + A[:, 5]
        z, _, is_least = least(A, V, costs, fixed, np.ones(poses))
        assert is_least
        assert (A @ z <= V * (1.0 + 1e-6)).all()
        other = minimize(
            lambda x, costs=costs: float((costs[:5] / x).sum()),
            np.full(5, 0.6),
            bounds=[(1e-3, 1.0)] * 5,
            constraints={"type": "ineq", "fun": lambda x, A=A, V=V: V - A[:, :5] @ x**2 - A[:, 5]},
            method="SLSQP",
            options={"ftol": 1e-12, "maxiter": 500},
        )
        assert (costs[:5] / np.sqrt(z[:5])).sum() == pytest.approx(other.fun, rel=1e-5)


def test_tolerances_are_allocated(monkeypatch: pytest.MonkeyPatch) -> None:
    found = tolerance(arm(), TABLE, random=5)
    before = found.radius["position"].max()
    given = found.allocate(0.6 * before)
    assert given.radius == pytest.approx(0.6 * before, rel=1e-6)
    assert given.radius <= 0.6 * before * (1.0 + 1e-12)
    assert given.tightened
    assert (given.factors <= 1.0).all()
    tightened = {n: {"deviation": x} for n, x in zip(given.names, given.after.tolist(), strict=True)}
    again = tolerance(arm(), tightened, poses=found.q)
    assert again.radius["position"].max() == pytest.approx(given.radius, rel=1e-9)
    assert given.status == "converged"
    assert found.allocate(2.0 * before).tightened == ()
    monkeypatch.setattr(allocation, "_ROUNDS", 1)
    assert "do not bring the radius to rest" in found.allocate(0.6 * before).lines()[0]
    evenly = float(len(given.names) * (1.0 / 0.6 - 1.0))
    assert given.cost < evenly


def test_what_is_fixed_stays() -> None:
    table = {"base.x": {"deviation": 1e-4, "fixed": True}, "base.y": {"bound": 3e-4}}
    found = tolerance(arm(), table)
    given = found.allocate(2.5e-4)
    assert given.tightened == ("base.y",)
    assert given.before[1] == 3e-4  # a bound stays one
    said = r"accuracy: 0\.00015 m; allowed: above 0\.000196 m, which 'base\.x' alone make"
    refused(InputError, said, found.allocate, 1.5e-4)
    for bad in (0.0, -1.0, float("nan")):
        refused(InputError, r"accuracy: .*allowed: a positive number", found.allocate, bad)


# The result


def test_the_result_is_plain_and_shows_itself() -> None:
    found = example("rigid")
    assert json.loads(json.dumps(found.as_dict()))["names"] == list(found.names)
    text = "\n".join(found.lines())
    assert "95 % coverage" in text
    assert "joints.joint3.offset.gamma" in text
    assert repr(found).startswith("ToleranceResult(robot=")
    assert len(found.as_rows().columns) == 4
    refused(InputError, "pose: 2; allowed: a whole number from 0 to 1", found.sample, 10, pose=2)


@pytest.mark.parametrize("kind", ["rigid", "soft", "closed"])
def test_results_are_saved_and_load_again(kind: str, tmp_path: Path) -> None:
    found = replace(example(kind), t=None)
    again = load_tolerance(found.save(tmp_path / "found.json"))
    assert again.as_dict() == found.as_dict()
    assert np.array_equal(again.sample(50), found.sample(50))
    timed = replace(found, t=np.arange(float(len(found.q))))
    assert np.array_equal(load_tolerance(timed.save(tmp_path / "timed.json")).t, timed.t)
    refused(InputError, r"allowed: a path that ends in .json", found.save, tmp_path / "found.npz")
    data = json.loads((tmp_path / "found.json").read_text())
    for change, message in (
        ({"kind": "fit"}, "is no result of the kind tolerance"),
        ({"t": [0.0]}, "is no accuracy by tolerances" if len(found.q) > 1 else ""),
        ({"description": 3}, ""),
        ({"table": {"joints.none.offset.x": {"bound": 1.0}}}, "no such parameter"),
    ):
        if message:
            (tmp_path / "wrong.json").write_text(json.dumps({**data, **change}))
            refused((InputError, DescriptionError), message, load_tolerance, tmp_path / "wrong.json")


def test_a_map_has_every_pose(tmp_path: Path) -> None:
    found = example("rigid")
    assert np.allclose(found.positions[0], found.exact.poses(np.zeros((len(found.names), 1)), np.array([0]))[1][0])
    assert "<svg" in plot_tolerance(found, tmp_path / "map.svg").read_text(encoding="utf-8")


def test_the_command(tmp_path: Path) -> None:
    table, name = tmp_path / "t.toml", '"joints.*.offset.x"'
    table.write_text(f"{name} = {{ deviation = 1e-4 }}\n")
    words = ("tolerance", "ur5", table, "--random", 5, "--accuracy", "3e-4")
    found, direct = facts(*words), tolerance("ur5", table, random=5)
    assert found["radius"]["position"] == direct.radius["position"].tolist()
    assert found["allocation"]["radius"] == direct.allocate(3e-4).radius
    assert "95 % coverage radius 0.3 mm instead of" in command(*words)
    assert "there is no such file" in command("tolerance", "ur5", tmp_path / "none.toml", code=1)
    table.write_text(f"{name} = {{ deviation = 1e-4 }}\n[[correlations]]\nnames = [{name}]\ncoefficient = 0.5\n")
    found = facts("tolerance", "ur5", table)
    assert found["covariance"] == tolerance("ur5", table).covariance.tolist()
    assert len(found["correlations"][0]["names"]) == 6
    assert "are correlated; allowed" in command("tolerance", "ur5", table, "--accuracy", "3e-4", code=1)


# Correlated tolerances


PLANE = {"frames.tcp.x": {"deviation": 3e-4}, "base.x": {"deviation": 4e-4}}
COUNT = 40_000


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


def test_what_is_compensated_altogether_has_no_shares_and_a_part_is_among_the_greatest() -> None:
    for second, shares in ((3e-4, [0.0, 0.0]), (4e-4, [4.0, -3.0])):
        table = {"base.z": {"deviation": 3e-4}, "joints.*.placement.z": {"deviation": second}}
        found = tolerance("one_link", {**table, "correlations": pair(-1.0, "base.z", "joints.*.placement.z")})
        assert [found.shares["position"][k] for k in found.by_share] == pytest.approx(shares)
        if second == 3e-4:
            assert found.radius["position"][0] < 1e-15
            assert np.abs(found.sample(100)[:, :3]).max() < 1e-15


@pytest.mark.parametrize("seed", soaked(range(3), (0,)))
def test_covariances_and_regions_are_those_of_samples(seed: int) -> None:
    """Of random arms by the exact model, with deviations that NumPy draws, and with those of ``sample``."""
    rng = np.random.default_rng(seed)
    table, names, matrix = random_table(rng)
    found = tolerance(arm(seed), table, random=2, seed=seed)
    C = covariance_of(found, names, matrix)
    S = found.sensitivities
    np.testing.assert_allclose(found.covariance, S @ C @ S.transpose(0, 2, 1), rtol=1e-9, atol=1e-22)
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
    table = {"joints.*.*.stiffness": {"deviation": 0.02, "relative": True}}
    both = [{"names": ["joints.*.*.stiffness"], "coefficient": 1.0}]
    load = [0.0, 0.0, -500.0, 0.0, 0.0, 0.0]
    found = tolerance(soft(), {**table, "correlations": both}, wrench=load)
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
        ("names = ['base.*']\ncoefficient = 1.1", r"t\.toml:7:\d+: .*coefficient: 1\.1; allowed: a number from"),
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
    refused(DescriptionError, message, tolerance, arm(), path)


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
    caught = refused(DescriptionError, "", tolerance, "one_link", {**table, "correlations": entries})
    assert "'base.alpha'" not in str(caught)
    assert all(f"'base.{c}'" in str(caught) for c in "xyz")


def test_allocation_is_of_independent_tolerances() -> None:
    found = tolerance(arm(), {**PLANE, "correlations": pair(0.5)})
    with pytest.raises(InputError, match=r"accuracy: .*'frames\.tcp\.x'.* are correlated; allowed: tables of indep"):
        found.allocate(1e-4)
    assert tolerance(arm(), {**PLANE, "correlations": pair(0.0)}).allocate(1e-3).radius <= 1e-3


# The result


def test_they_are_saved_shown_and_load_again(tmp_path: Path) -> None:
    table, _, _ = random_table(np.random.default_rng(11))
    found = tolerance(arm(), table, random=2)
    again = load_tolerance(found.save(tmp_path / "found.json"))
    assert again.as_dict() == found.as_dict()
    np.testing.assert_array_equal(again.correlation, found.correlation)
    assert np.array_equal(again.sample(50), found.sample(50))
    assert "10 tolerances (6 correlated) at 2 poses" in found.lines()[0]
    assert json.loads(json.dumps(found.as_dict()))["correlations"][0]["matrix"][0][0] == 1.0
    assert "are correlated" in page_of(found).html()
    data = json.loads((tmp_path / "found.json").read_text())
    del data["correlations"]
    assert load_tolerance(text_file(tmp_path / "older.json", json.dumps(data))).correlated == ()
    (tmp_path / "found.json").write_bytes(b'{"kind": "tolerance\xac"}')
    with pytest.raises(InputError, match=r"found\.json: cannot be read: .*; allowed: what its save wrote"):
        load_tolerance(tmp_path / "found.json")


# Flexible links


LENGTH, LOAD, GRAVITY = 1.5, 5.0, 9.81
BOOM = f"""
name = "boom"
gravity = [0.0, 0.0, -9.81]
[[links]]
name = "tube"
beam = {{ length = 1.5, E = 7e10, G = 2.63e10, density = 2700.0, section = {{ tube = [0.06, 0.05] }}, \
modes = {{ z = 2 }} }}
{link_table("load", 5.0, inertia=(0.01, 0.01, 0.01))}
{joint_table("slew", "base", "tube", "revolute")}
{joint_table("flange", "tube", "load", "fixed")}
node = "tip"
{frame_table("tcp", "load")}
"""
E, DENSITY = "links.tube.beam.E", "links.tube.beam.density"
BOOM_TABLE = {
    E: {"deviation": 0.003, "relative": True},
    DENSITY: {"deviation": 0.02, "relative": True},
    "joints.slew.offset.gamma": {"deviation": 1e-5},
}


def sags(robot: Robot) -> tuple[float, float]:
    """Sag of the tip by the load and by the beam's own weight, S. P. Timoshenko, m."""
    beam = robot.links[0].beam
    bend, shear = beam.E * beam.Iy, beam.shear[1] * beam.G * beam.A
    own = GRAVITY * beam.mass * (LENGTH**3 / (8 * bend) + LENGTH / (2 * shear))
    return GRAVITY * LOAD * (LENGTH**3 / (3 * bend) + LENGTH / shear), own


def test_sags_and_shares_are_those_of_the_textbook(tmp_path: Path) -> None:
    """The sag is in inverse proportion to E, with G, and its own part in proportion to the density."""
    robot = robot_from_toml(BOOM)
    beam = robot.links[0].beam
    found = tolerance(robot, BOOM_TABLE, poses=[[0.3], [0.0]])
    by_load, own = sags(robot)
    S = dict(zip(found.names, found.sensitivities[1].T, strict=True))
    assert beam.E * S[E][2] == pytest.approx(by_load + own, rel=1e-5)
    assert beam.density * S[DENSITY][2] == pytest.approx(-own, rel=1e-5)
    assert S["joints.slew.offset.gamma"][1] == pytest.approx(LENGTH, rel=1e-4)
    assert found.standard_deviations[1][2] == pytest.approx(np.hypot(0.003 * (by_load + own), 0.02 * own), rel=1e-5)
    drawn = found.sample(200, pose=1)
    assert drawn.std(axis=0)[1:3] == pytest.approx(found.standard_deviations[1][1:3], rel=0.2)
    again = load_tolerance(found.save(tmp_path / "found.json"))
    assert np.array_equal(again.sensitivities, found.sensitivities)
    assert again.names == found.names


def test_what_may_be_named() -> None:
    """Offsets, stiffness of modes, E and density, with their units; nothing else, and no loops."""
    units = tolerance_quantities(robot_from_toml(BOOM))
    modes = {f"links.tube.modes.{k}.stiffness": "J" for k in (1, 2)}
    offsets = {f"joints.slew.offset.{kind}": "m" if kind in "xyz" else "rad" for kind in eomgen.robot.COORDINATES}
    assert units == {**modes, **offsets, E: "N/m^2", DENSITY: "kg/m^3"}
    with pytest.raises(DescriptionError, match=r"links\.load\.mass"):
        tolerance(robot_from_toml(BOOM), {"links.load.mass": {"deviation": 0.1}})
    instead = r"goes with E, so that modes keep their shapes; allowed: links\.tube\.beam\.E, or "
    with pytest.raises(DescriptionError, match=rf"links\.tube\.beam\.G: {instead}links\.tube\.modes\.1\.stiffness$"):
        tolerance(robot_from_toml(BOOM), {"links.*.beam.G": {"deviation": 0.1}})
    twisted = robot_from_toml(BOOM.replace("modes = { z = 2 }", "modes = { y = 1, z = 2, torsion = 1, axial = 1 }"))
    twist = rf"{instead}'links\.tube\.modes\.4\.stiffness', in proportion to G alone"
    refused(DescriptionError, twist, tolerance, twisted, {"links": {"tube": {"beam": {"G": {"deviation": 0.1}}}}})
    loop = """
[[loops]]
name = "bearing"
links = ["base", "load"]
type = "spherical"
x = {}
placements = [{ xyz = [1.5, 0.0, 0.0] }, {}]
"""
    with pytest.raises(InputError, match=r"links\.tube\.modes: .* known of trees, and loops\.bearing closes a loop"):
        tolerance(robot_from_toml(BOOM + loop), BOOM_TABLE)


@pytest.mark.soak
def test_robots_whose_beams_are_made_anew_move_as_said() -> None:
    """E with G, and the density, a part higher: the difference of deflections of two robots that are built."""
    robot = robot_from_toml(BOOM)
    beam = robot.links[0].beam
    found = tolerance(
        robot, {E: {"bound": 7e8}, DENSITY: {"bound": 27.0}, "links.tube.modes.1.stiffness": {"bound": 1.0}}
    )
    before = deflection(robot).deflection
    y = np.zeros((3, 1))
    for name, changes in (
        (E, {"links.tube.beam.E": 1.01 * beam.E, "links.tube.beam.G": 1.01 * beam.G}),
        (DENSITY, {"links.tube.beam.density": 1.01 * beam.density}),
    ):
        y[:] = 0.0
        y[found.names.index(name)] = {E: 7e8, DENSITY: 27.0}[name]
        moved = found.exact.motions(y, np.zeros(1, dtype=np.intp))[0]
        after = deflection(robot.with_values(changes)).deflection
        assert moved == pytest.approx(after - before, abs=1e-4 * np.abs(moved).max())
