"""Motions that excite: at rest at both ends, within limits everywhere, better than random ones; exact gradients."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen.errors import InputError
from eomgen.identification import ExciteResult, IdentifyResult, excite, identify, load_excitation
from eomgen.identification.dynamics.solve import without_sought
from eomgen.identification.exciting.allowed import Limits, RequestedLimits, limits_of
from eomgen.identification.exciting.constraints import held_by
from eomgen.identification.exciting.fourier import FourierSeries, at_rest
from eomgen.identification.exciting.searching import Search, objective
from eomgen.identification.exciting.solve import KERNELS, moving_robot
from eomgen.identification.exciting.weighted_columns import CRITERIA, WeightedColumns
from eomgen.identification.identifiable import TERMS, combinations
from eomgen.identification.relations import tree_relations
from eomgen.motion.files import read_motion
from eomgen.pictures import plot_excitation, report_of
from eomgen.robot.value import Coordinate, Frame, Friction, Joint, Link, Placement, Robot
from tests.support.builds import Build
from tests.support.commands import command
from tests.support.measurements import motion_of
from tests.support.random_robots import Array
from tests.support.refusals import refused

pytestmark = pytest.mark.quick

DRIVES = {"joint1": 30.0, "joint2.gamma": 45.0, "joint3": 14.0}
PLACES: dict[str, Any] = {
    "boxes": {"tcp": [[-1.0, -1.0, -0.2], [1.0, 1.0, 0.9]]},
    "half_spaces": [("tcp", (0.0, 0.6, 0.8), -0.1)],
    "clear_of": [("fore", (0.0, 0.0, 0.8), 0.1)],
}
LIMITS: dict[str, Any] = {"rates": 2.0, "accelerations": {"joint2": 7.0}, "drives": DRIVES, **PLACES}
SHORT: dict[str, Any] = {"duration": 4.0, "harmonics": 3, "step": 8e-3, "starts": 1}
NOISE = 0.2
ELBOW = Placement((0.5, 0.0, 0.0))


def arm() -> Robot:
    """Three links about a vertical and two horizontal axes, with rotors and friction."""

    def drive(armature: float, damping: float, coulomb: float) -> dict[str, Coordinate]:
        friction = Friction(coulomb=coulomb, smoothing=1e-9)
        return {"gamma": Coordinate(armature=armature, damping=damping, friction=friction)}

    links = (
        Link("column", 8.0, (0.0, 0.0, 0.2), (0.1, 0.1, 0.05, 0.0, 0.0, 0.0)),
        Link("upper", 5.0, (0.25, 0.01, 0.0), (0.01, 0.1, 0.1, 0.001, 0.0, 0.0)),
        Link("fore", 3.0, (0.2, 0.0, 0.02), (0.01, 0.06, 0.06, 0.0, 0.001, 0.0)),
    )
    turned = Placement.from_rpy((0.0, 0.0, 0.4), (np.pi / 2, 0.0, 0.0))
    joints = (
        Joint("joint1", "base", "column", "revolute", coordinates=drive(0.3, 1.5, 2.0), limits=(-2.8, 2.8)),
        Joint("joint2", "column", "upper", "revolute", turned, coordinates=drive(0.25, 1.2, 1.5), limits=(-1.5, 1.5)),
        Joint("joint3", "upper", "fore", "revolute", ELBOW, coordinates=drive(0.1, 0.8, 1.0), limits=(-2.0, 2.0)),
    )
    return Robot("arm", (0.0, 0.0, -9.81), links, joints, (Frame("tcp", "fore", Placement((0.4, 0.0, 0.0))),))


@pytest.fixture(scope="module")
def kernel(built: Build) -> eomgen.Kernel:
    return built(moving_robot(arm()), *KERNELS)


@pytest.fixture(scope="module")
def whole(built: Build) -> eomgen.Kernel:
    return built(arm(), "inverse_dynamics")


@pytest.fixture(scope="module")
def found(kernel: eomgen.Kernel) -> ExciteResult:
    return excite(arm(), **LIMITS, **SHORT, noise=NOISE, kernel=kernel)


def search_of(kernel: eomgen.Kernel, limits: Limits) -> Search:
    held = held_by(limits, kernel, np.array([2.0, 1.5, 1.0]))
    return Search(limits, SHORT["duration"], SHORT["harmonics"], held, kernel.n, np.arange(kernel.n))


def test_series_rest_at_both_ends_and_have_their_derivatives() -> None:
    rng = np.random.default_rng(1)
    x = rng.standard_normal((2, 9)) @ at_rest(5).T
    series = FourierSeries(("a", "b"), 3.0, x[:, 0], x[:, 1:6], x[:, 6:])
    for t in (0.0, 3.0):
        q, v, a = series.at(t)
        assert np.abs(q - series.start).max() < 1e-12
        assert np.abs(v).max() < 1e-12
        assert np.abs(a).max() < 1e-11
    t, h = rng.uniform(0.1, 2.9, 20), 1e-5
    before, here, after = (series.at(t + dt) for dt in (-h, 0.0, h))
    assert np.abs((after[0] - before[0]) / (2 * h) - here[1]).max() < 1e-7 * np.abs(here[2]).max()
    assert np.abs((after[1] - before[1]) / (2 * h) - here[2]).max() < 1e-6 * np.abs(here[2]).max()
    assert np.abs(series.at([5.0])[0][0] - series.start).max() < 1e-12
    assert np.linalg.matrix_rank(at_rest(5)) == 9


def test_numbers_within_limits_are_those_of_the_motion(kernel: eomgen.Kernel, whole: eomgen.Kernel) -> None:
    """Drives are those of the robot less its Coulomb friction, for which their limits leave room."""
    limits = limits_of(arm(), kernel.coordinates, kernel.frames, RequestedLimits(**LIMITS))
    q, v, a = np.random.default_rng(7).uniform(0.2, 0.8, (3, 4, kernel.n))
    friction = np.array([2.0, 1.5, 1.0])
    names = tuple(f"{name} drive" for name in kernel.coordinates)
    (held,) = (held for held in held_by(limits, kernel, friction) if held.names == names)
    np.testing.assert_allclose(held.values((q, v, a)), whole.inverse_dynamics(q, v, a) - friction, atol=1e-6)
    np.testing.assert_allclose(held.high, np.array(list(DRIVES.values())) - friction)
    np.testing.assert_allclose(held.low, -held.high)


@pytest.mark.parametrize("kind", list(CRITERIA))
@pytest.mark.parametrize("size", [1.0, 3.0])
def test_gradients_are_exact(kind: str, size: float, kernel: eomgen.Kernel) -> None:
    """Within limits, and beyond some of them, where the barrier is a parabola."""
    limits = limits_of(arm(), kernel.coordinates, kernel.frames, RequestedLimits(**LIMITS))
    search = search_of(kernel, limits)
    everywhere = np.ones(3, dtype=np.bool_)
    base = combinations(kernel, TERMS, everywhere, everywhere, tree_relations(arm()))
    rng = np.random.default_rng(2)
    sizes = rng.uniform(0.1, 1.0, len(base))
    weighted = WeightedColumns(kernel, base, np.arange(3), np.array([0.2, 0.3, 0.4]), sizes, np.full(3, 0.1))
    narrowed = [rng.uniform(0.0, 0.01, len(held.names)) for held in search.held]
    x = size * rng.uniform(-0.3, 0.3, (3, 5))

    def value(x: Array) -> tuple[float, Array]:
        return objective(search, weighted, kind, 1e-3, narrowed, x)

    gradient, h = value(x)[1], 3e-6
    for i, j in np.ndindex(x.shape):
        step = np.zeros_like(x)
        step[i, j] = h
        slope = (value(x + step)[0] - value(x - step)[0]) / (2 * h)
        assert gradient[i, j] == pytest.approx(slope, rel=2e-5, abs=2e-5 * np.abs(gradient).max())


def test_limits_hold_between_samples_and_are_used(
    found: ExciteResult, kernel: eomgen.Kernel, whole: eomgen.Kernel
) -> None:
    """At ten thousand times that are none of the search's, with dry friction in the drives."""
    t = np.linspace(0.0, 4.0, 10_007)
    q, v, a = found.series.at(t)
    assert (np.abs(q) <= [2.8, 1.5, 2.0]).all()
    assert (np.abs(v) <= 2.0).all()
    assert (np.abs(a[:, 1]) <= 7.0).all()
    assert (np.abs(whole.inverse_dynamics(q, v, a)) <= [30.0, 45.0, 14.0]).all()
    tcp, fore = (kernel.frame_pose(q, name)[:, :3, 3] for name in ("tcp", "fore"))
    assert ((tcp >= [-1.0, -1.0, -0.2]) & (tcp <= [1.0, 1.0, 0.9])).all()
    assert (tcp @ [0.0, 0.6, 0.8] >= -0.1).all()
    assert (np.linalg.norm(fore - [0.0, 0.0, 0.8], axis=1) >= 0.1).all()
    assert found.used.max() <= 1.0
    used = dict(zip(found.limited, found.used, strict=True))
    assert sum(value > 0.95 for value in used.values()) > 4
    assert min(used[f"{name} rate"] for name in found.coordinates) > 0.9
    assert np.abs(found.u - whole.inverse_dynamics(found.q, found.v, found.a)).max() < 1e-9
    assert all(np.abs(found.series.at(found.t)[i] - x).max() < 1e-12 for i, x in enumerate((found.q, found.v, found.a)))


def records(kernel: eomgen.Kernel, series: FourierSeries, seed: int) -> Any:
    """A motion with noisy drives as ``identify`` reads it."""
    t = np.arange(501) * 8e-3
    q, v, a = series.at(t)
    u = kernel.inverse_dynamics(q, v, a) + NOISE * np.random.default_rng(seed).standard_normal(q.shape)
    return motion_of(kernel.coordinates, t, q, v, a, u)


@pytest.mark.soak
def test_parameters_come_out_more_exactly_than_from_random_motions(
    found: ExciteResult, kernel: eomgen.Kernel, whole: eomgen.Kernel, built: Build
) -> None:
    """From noisy records: with smaller standard deviations, smaller true errors, as large as they were to be expected.

    Random motions are as long, within the same limits, and fill them.
    """
    assert found.deviation.found < 0.7 * found.deviation.start
    assert found.deviation.found < 0.5 * found.deviation.random
    assert found.condition.found < 0.5 * found.condition.random
    bare = built(without_sought(arm(), TERMS), "regressor", "inverse_dynamics")
    search = search_of(kernel, limits_of(arm(), kernel.coordinates, kernel.frames, RequestedLimits(**LIMITS)))
    rng = np.random.default_rng(4)
    poses = search.poses(rng)
    others = [x for x in (search.random(rng, poses) for _ in range(4)) if x is not None]
    assert len(others) > 2

    def identified(series: FourierSeries) -> IdentifyResult:
        return identify(arm(), records(whole, series, 5), kernel=bare)

    def error(result: IdentifyResult) -> float:
        return float(np.sqrt(np.mean(((result.base_values - result.described) / found.sizes) ** 2)))

    best, rest = identified(found.series), [identified(search.series(x)) for x in others]
    assert best.base_names == found.base.names
    mean = np.exp(np.log(best.deviations / found.deviations).mean())
    assert 0.7 < mean < 1.5
    for other in rest:
        assert len(other.base) == len(best.base)
        assert np.log(best.deviations / other.deviations).mean() < np.log(0.7)
    assert error(best) < 0.6 * np.median([error(other) for other in rest])


def test_a_place_that_random_poses_do_not_meet(kernel: eomgen.Kernel) -> None:
    box = np.array([[0.6, -0.01, 0.5], [0.62, 0.01, 0.52]])
    limits = limits_of(arm(), kernel.coordinates, kernel.frames, RequestedLimits(boxes={"tcp": box}))
    poses = search_of(kernel, limits).poses(np.random.default_rng(0))
    points = kernel.frame_pose(poses, "tcp")[:, :3, 3]
    assert len(points)
    assert ((points >= box[0]) & (points <= box[1])).all()


def test_files_and_text(found: ExciteResult, tmp_path: Path) -> None:
    path = found.save(tmp_path / "found.npz")
    again = load_excitation(path)
    assert json.dumps(again.as_dict()) == json.dumps(found.as_dict())
    assert again.lines() == found.lines()
    assert again.status == found.status == "converged"
    assert all(np.array_equal(getattr(again, name), getattr(found, name)) for name in ("t", "q", "v", "a", "u"))
    motion = read_motion(found.to_csv(tmp_path / "motion.csv"), found.coordinates)
    assert np.array_equal(motion.v, found.v)
    assert np.array_equal(motion.u, found.u)
    scenario = eomgen.load_scenario(found.to_scenario(tmp_path / "motion.toml", tmp_path / "motion.csv"))
    assert scenario.duration == 4.0
    assert scenario.motion.type == "sampled"
    text = "\n".join(found.lines())
    assert "joint2.gamma drive [N m]" in text
    assert "tcp half space [m]" in text
    assert "note" not in text.replace("note: rates", "")
    command("report", path, "-o", tmp_path / "page.html")
    page = report_of(found)
    assert (tmp_path / "page.html").read_text() == page.html()
    (limits,) = (table.rows for table in page.tables if table.title == "Limits")
    assert [row[0] for row in limits] == list(found.limited)
    drawn = plot_excitation(found, tmp_path / "motion.svg").read_text(encoding="utf-8")
    assert all(name in drawn for name in (*found.coordinates, "position", "velocity", "drive", "rad/s", "N m"))
    refused(InputError, r"beside", found.to_scenario, tmp_path / "other" / "motion.toml", tmp_path / "motion.csv")
    for write in (found.save, found.to_csv):
        refused(InputError, r"allowed: a path that ends in \.(npz|csv)", write, tmp_path / "found.txt")
    np.savez(tmp_path / "strange.npz", t=np.zeros(3))
    refused(InputError, "is no result of the kind excitation", load_excitation, tmp_path / "strange.npz")
    bad = dict(np.load(path))
    np.savez(tmp_path / "short.npz", **{**bad, "q": bad["q"][:-1]})
    refused(InputError, "array q has shape", load_excitation, tmp_path / "short.npz")


def test_deviations_stay_at_zero_and_what_is_assumed_is_said(kernel: eomgen.Kernel) -> None:
    """The condition number by the other criterion; the same seed gives the same motion."""
    robot = arm()
    first, *others = robot.joints
    soft = replace(first, limits=None, coordinates={**first.coordinates, "x": Coordinate(stiffness=1e6)})
    robot = replace(robot, joints=(soft, *others))
    assert moving_robot(robot) == replace(moving_robot(arm()), joints=moving_robot(robot).joints)
    options: dict[str, Any] = {**SHORT, "duration": 3.0, "harmonics": 2, "criterion": "condition", "kernel": kernel}
    found = excite(robot, terms=("links", "rotors"), **options)
    assert found.coordinates == ("joint1.gamma", "joint2.gamma", "joint3.gamma")
    assert found.condition.found < 0.5 * found.condition.random
    for text in (
        "principal coordinates move, all others are 0",
        "joint1.gamma has no limits: -3.142 to 3.142 rad is assumed",
        "rates of all coordinates without a limit: 1 rad/s is assumed",
        "no limits of accelerations and drives",
        "noise of the drives of all coordinates is assumed",
    ):
        assert any(text in note for note in found.notes), text
    again = excite(robot, terms=("links", "rotors"), **options)
    assert np.array_equal(found.q, again.q)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"ranges": {"joint2": (0.5, 0.5)}}, r"ranges: joint2.gamma: 0.5 to 0.5 leaves no room"),
        ({"ranges": {"joint9": (0.0, 1.0)}}, r"ranges: no coordinate that moves is called 'joint9'"),
        ({"ranges": {"joint1": (0.0, np.nan)}}, r"ranges: joint1: .*finite"),
        ({"ranges": [(-1.0, 1.0)]}, r"ranges: .*; allowed: a table by names"),
        ({"rates": 0.0}, r"rates: 0; allowed: a number above 0"),
        ({"rates": {"joint1": -1.0}}, r"rates: joint1: -1"),
        ({"drives": {"joint3": 0.9}}, r"drives: joint3.gamma: 0.9 N m; allowed: more than its Coulomb friction, 1 N m"),
        ({"noise": 0.0}, r"noise: 0; allowed: a number above 0"),
        ({"noise": {"joint1": 0.1, "joint2": 0}}, r"noise: joint2: 0"),
        ({"boxes": {"hand": [[0, 0, 0], [1, 1, 1]]}}, r"hand box: there is no frame or link 'hand'"),
        ({"boxes": {"tcp": [[0, 0, 1], [1, 1, 0]]}}, r"boxes: tcp: .*the lower corner, then the upper one"),
        ({"boxes": {"tcp": [0, 1]}}, r"boxes: tcp: .*shape \(2, 3\)"),
        ({"half_spaces": [("tcp", (0, 0, 0), 0.1)]}, r"half_spaces: tcp: normal .*allowed: a direction"),
        ({"half_spaces": ["tcp"]}, r"half_spaces: 'tcp'; allowed: rows of a frame"),
        ({"clear_of": [("tcp", (0, 0, 0), -1.0)]}, r"clear_of: tcp: distance: -1"),
        (
            {"half_spaces": [("tcp", (0, 0, 1), 2.0)]},
            r"no pose at rest is within all of them; the nearest one has tcp half space 1.3.* m; allowed: from 2 m",
        ),
        ({"half_spaces": [("tcp", (0, 0, 1), 0.5), ("tcp", (0, 0, -1), -0.4)]}, r"limits: no pose at rest is within"),
        ({"harmonics": 40}, r"step: 0.008 s makes 500 samples of 4 s, too few for 40 harmonics; allowed: at most"),
        ({"step": 0.1}, r"step: 0.1 s makes 40 samples"),
        ({"step": 1e-9}, r"step: 1e-09 s makes"),
        ({"harmonics": 1}, r"harmonics: 1; allowed: a whole number 2 to 50"),
        ({"duration": np.inf}, r"duration: inf"),
        ({"criterion": "E"}, r"criterion: 'E'; allowed: D, condition"),
        ({"terms": ("masses",)}, r"terms: 'masses'"),
        ({"starts": 0}, r"starts: 0"),
        ({"seed": -1}, r"seed: -1"),
    ],
)
def test_what_cannot_be_used_is_named(options: dict[str, Any], message: str, kernel: eomgen.Kernel) -> None:
    refused(InputError, message, excite, arm(), **{**SHORT, "kernel": kernel, **options})


def on_springs(robot: Robot) -> Robot:
    """Joints that only give way, and turn no more."""
    spring = {"gamma": Coordinate(stiffness=1e4)}
    return replace(robot, joints=tuple(replace(x, type="fixed", coordinates=spring) for x in robot.joints))


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        (lambda _: eomgen.load_robot("four_bar"), r"excite: four_bar has loops or couplings"),
        (
            lambda robot: replace(robot, joints=(replace(robot.joints[0], type="free"), *robot.joints[1:])),
            r"excite: arm moves freely at 'joint1'; allowed: robots with a fixed base",
        ),
        (lambda robot: replace(robot, driven=("joint1.gamma",)), r"excite: 'joint2.gamma', 'joint3.gamma' without"),
        (on_springs, r"excite: arm has no joint that turns or slides"),
    ],
)
def test_robots_that_cannot_be_excited_are_named(changed: Callable[[Robot], Robot], message: str) -> None:
    refused(InputError, message, excite, changed(arm()))


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["-o", "a.txt"], r"output: 'a.txt'; allowed: paths that end in .csv"),
        (["-o", "a.toml"], r"output: 'a.toml' with 0 files .csv"),
        (["--velocity-limits", "1", "2"], r"velocity-limits: 2 numbers; allowed: one number"),
        (["--half-space", "tcp", "0", "0", "z", "1"], r"half-space: tcp: 'z' is not a number; allowed: 0, or a number"),
    ],
)
def test_commands_with_bad_options(words: list[str], message: str) -> None:
    assert re.search(message, command("excite", "one_link", *words, code=1))
