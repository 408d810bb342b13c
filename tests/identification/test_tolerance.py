"""Tolerances: regions and worst cases against the exact model, shares, allocation, tables, the command."""

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

from eomgen.cli import entry as cli
from eomgen.errors import ArrayError, DescriptionError, InputError, UnknownNameError
from eomgen.identification import ToleranceResult, load_tolerance, tolerance
from eomgen.identification.tolerances.allocation import least
from eomgen.identification.tolerances.correlations import read_correlations
from eomgen.identification.tolerances.regions import ellipsoids, mixed_quantiles, quantile_of_normal, radii
from eomgen.identification.tolerances.table import meant, read_table
from eomgen.identification.tolerances.vertices import farthest
from eomgen.pictures import plot_tolerance
from eomgen.robot.value import Coordinate, Robot
from tests.support.measured_poses import chain
from tests.support.soak import soaked

pytestmark = pytest.mark.usefixtures("unoptimised")

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


def arm() -> Robot:
    robot = chain(4, "RPR")
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
    from scipy.integrate import quad

    def integrand(u: float) -> float:
        theta = 0.5 * np.arctan(variances * u).sum() - 0.5 * x * u
        return float(np.sin(theta) / (u * np.prod((1.0 + (variances * u) ** 2) ** 0.25)))

    value = quad(integrand, 0.0, 4e3, limit=20_000, epsabs=1e-6)[0]
    return 0.5 - value / np.pi


def in_plane(bound: float, deviation: float, r: float) -> float:
    """Probability that a uniform number within a bound and a normal one stay below r together, by quadrature."""
    from scipy.integrate import quad
    from scipy.special import ndtr

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
        sizes = {
            name: {"bound" if rng.random() < 0.6 else "deviation": 1e-4 * rng.random()} for name in ("x", "y", "z")
        }
        table = {f"frames.tcp.{name}": size for name, size in sizes.items()} | {"joints.joint2.length": {"bound": 2e-4}}
        for confidence in (0.3, 0.95, 0.999):
            found = tolerance(arm(), table, random=3, seed=seed, confidence=confidence)
            for pose in range(3):
                drawn = found.sample(20_000, pose=pose, seed=pose)[:, :3]
                along = np.linalg.eigh(found.covariance[pose, :3, :3])[1][:, -1]
                share = (np.abs(drawn @ along) <= found.direction["position"][pose]).mean()
                assert share == pytest.approx(
                    confidence, abs=5.0 * np.sqrt(confidence * (1 - confidence) / 20_000) + 1e-3
                )
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
    robot = soft()
    table = {"joints.joint1.alpha.stiffness": {"bound": 4e4}}
    found = tolerance(robot, table, wrench=[0.0, 0.0, -2000.0, 0.0, 0.0, 0.0])
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
    with pytest.raises(UnknownNameError, match=r"base\.y.*base\.x"):
        found.share("base.y")


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
    np.savetxt(
        motion, np.linspace(0.0, 1.0, 5)[:, np.newaxis] * [1.0, 0.1, 0.2, 0.3], "%.6f", ",", header=header, comments=""
    )
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
    ],
)
def test_refusals_of_arguments(options: dict[str, Any], error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message):
        tolerance(arm(), OFFSETS, **options)


def test_random_poses_need_limits_of_joints_that_slide() -> None:
    with pytest.raises(InputError, match=r"random: joint2\.z has no limits"):
        tolerance(chain(4, "RPR"), OFFSETS, random=2)


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
    path = tmp_path / "t.toml"
    path.write_text(text)
    with pytest.raises(DescriptionError, match=message):
        tolerance(arm(), path)


def test_a_stiffness_cannot_vanish() -> None:
    for entry in ({"bound": 4e5}, {"deviation": 1e5}):
        with pytest.raises(DescriptionError, match="or the stiffness may vanish"):
            tolerance(soft(), {"joints.joint1.alpha.stiffness": entry})


# Allocation


def test_the_least_cost_is_that_of_a_general_method() -> None:
    from scipy.optimize import minimize

    rng = np.random.default_rng(2)
    for poses in (1, 4):
        A, costs = rng.random((poses, 6)) ** 3, rng.uniform(0.5, 3.0, 6)
        fixed = np.array([False] * 5 + [True])
        V = 0.5 * A[:, :5].sum(axis=1) + A[:, 5]
        z, _ = least(A, V, costs, fixed, np.ones(poses))
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


def test_tolerances_are_allocated() -> None:
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
    assert found.allocate(2.0 * before).tightened == ()
    evenly = float(len(given.names) * (1.0 / 0.6 - 1.0))
    assert given.cost < evenly


def test_what_is_fixed_stays() -> None:
    table = {"base.x": {"deviation": 1e-4, "fixed": True}, "base.y": {"bound": 3e-4}}
    found = tolerance(arm(), table)
    given = found.allocate(2.5e-4)
    assert given.tightened == ("base.y",)
    assert given.before[1] == 3e-4  # a bound stays one
    with pytest.raises(
        InputError, match=r"accuracy: 0\.00015 m; allowed: above 0\.000196 m, which 'base\.x' alone make"
    ):
        found.allocate(1.5e-4)
    for bad in (0.0, -1.0, float("nan")):
        with pytest.raises(InputError, match=r"accuracy: .*allowed: a positive number"):
            found.allocate(bad)


# The result


def test_the_result_is_plain_and_shows_itself() -> None:
    found = example("rigid")
    assert json.loads(json.dumps(found.as_dict()))["names"] == list(found.names)
    text = "\n".join(found.lines())
    assert "95 % coverage" in text
    assert "joints.joint3.offset.gamma" in text
    assert repr(found).startswith("ToleranceResult(robot=")
    assert len(found.as_rows().columns) == 4
    with pytest.raises(InputError, match="pose: 2; allowed: a whole number from 0 to 1"):
        found.sample(10, pose=2)


@pytest.mark.parametrize("kind", ["rigid", "soft", "closed"])
def test_results_are_saved_and_load_again(kind: str, tmp_path: Path) -> None:
    found = replace(example(kind), t=None)
    again = load_tolerance(found.save(tmp_path / "found.json"))
    assert again.as_dict() == found.as_dict()
    assert np.array_equal(again.sample(50), found.sample(50))
    timed = replace(found, t=np.arange(float(len(found.q))))
    assert np.array_equal(load_tolerance(timed.save(tmp_path / "timed.json")).t, timed.t)  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"allowed: a path that ends in .json"):
        found.save(tmp_path / "found.npz")
    data = json.loads((tmp_path / "found.json").read_text())
    for change, message in (
        ({"kind": "fit"}, "is no result of the kind tolerance"),
        ({"t": [0.0]}, "is no accuracy by tolerances" if len(found.q) > 1 else ""),
        ({"description": 3}, ""),
        ({"table": {"joints.none.offset.x": {"bound": 1.0}}}, "no such parameter"),
    ):
        if message:
            (tmp_path / "wrong.json").write_text(json.dumps({**data, **change}))
            with pytest.raises((InputError, DescriptionError), match=message):
                load_tolerance(tmp_path / "wrong.json")


def test_a_map_has_every_pose(tmp_path: Path) -> None:
    found = example("rigid")
    assert np.allclose(found.positions[0], found.exact.poses(np.zeros((len(found.names), 1)), np.array([0]))[1][0])
    assert "<svg" in plot_tolerance(found, tmp_path / "map.svg").read_text(encoding="utf-8")


def test_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table = tmp_path / "t.toml"
    table.write_text('"joints.*.offset.x" = { deviation = 1e-4 }\n')
    words = ["tolerance", "ur5", str(table), "--random", "5", "--accuracy", "3e-4"]
    assert cli.main([*words, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    direct = tolerance("ur5", table, random=5)
    assert found["radius"]["position"] == direct.radius["position"].tolist()
    assert found["allocation"]["radius"] == direct.allocate(3e-4).radius
    assert cli.main(words) == 0
    assert "95 % coverage radius 0.3 mm instead of" in capsys.readouterr().out
    assert cli.main(["tolerance", "ur5", str(tmp_path / "none.toml")]) == 1
    assert "there is no such file" in capsys.readouterr().err
