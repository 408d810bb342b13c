"""The benchmark beside other people's: its pages are current, its comparison refuses.  Nothing here measures a time."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import eomgen
from benchmarks.peers import contender, page, plot, python_calls
from benchmarks.peers.cases import CHAIN, ELASTIC, TITLES, Case, case, chain
from benchmarks.peers.contender import Contender, MissingPeer, build_library
from benchmarks.peers.gradients import DIFFERENCES, OURS, Task
from benchmarks.peers.measure import READS, Disagreement, compare, states
from benchmarks.peers.ours import Ours
from benchmarks.peers.report import Call, Entry, Gradient, Report, read
from benchmarks.peers.required import AGAINST_MUJOCO, AGAINST_PINOCCHIO, required
from tests.support.builds import Build
from tests.support.optional import needs
from tests.support.refusals import refused

DOCS = Path(__file__).parents[2] / "docs"


@pytest.fixture
def report() -> Report:
    """A small one: a ratio that holds, one that does not, a variant, a kernel that is not built."""
    held = Entry(
        "UR5",
        "UR5 URDF (6 DOF)",
        6,
        "mass_matrix",
        ns={"eomgen": 100.0, "Pinocchio (local)": 450.0, "Pinocchio (world)": 600.0},
        ratios={"Pinocchio (local)": (4.4, 4.5, 4.6), "Pinocchio (world)": (5.9, 6.0, 6.1)},
    )
    missed = replace(held, kernel="inverse_dynamics", ratios={"Pinocchio": (4.4, 4.5, 4.6)})
    unbuilt = replace(held, kernel="derivatives", ratios={}, missing={"eomgen": "not built: no such kernel"})
    machine = {"Processor": "some"}
    missing = {"CasADi": "the wheel casadi is not installed"}
    calls = (
        Call("UR5 URDF (6 DOF)", "some", "mass_matrix", {"C": 50.0, "Python": 2345.0, python_calls.MANY: 70.0}),
        Call("UR5 URDF (6 DOF)", "some", "inverse_dynamics", {"C": 66.0, "Python": 3456.0, "Pinocchio": 6912.0}),
    )
    slopes = (
        Gradient(
            "UR5 URDF (6 DOF)",
            "some",
            100,
            {"eomgen `rk4`": 1.5e5, "other": 2.5e6},
            {"eomgen `rk4`": 2e-11, "other": 3e-7},
        ),
        Gradient("elastic PUMA 560 (36 DOF)", "some", 100, {"eomgen `rk4`": 4e6}, {"eomgen `rk4`": 2e-9}),
    )
    return Report(machine, 3, 16, 4096, missing, (held, missed, unbuilt), calls=calls, gradients=slopes)


def test_the_page_is_that_of_the_last_run() -> None:
    assert page.page(read(DOCS / "peers.json")) == (DOCS / "peers.md").read_text(encoding="ascii")


def test_every_required_ratio_has_an_entry() -> None:
    """In the committed run: measured, or said why not."""
    last = read(DOCS / "peers.json")
    for key, kernel, batch in (*AGAINST_PINOCCHIO, *AGAINST_MUJOCO):
        entry = last.entry(key, kernel, batch)
        assert entry is not None, (key, kernel, batch)
        assert entry.ratios or entry.missing, (key, kernel, batch)


def test_the_committed_run_says_what_calls_from_python_cost() -> None:
    """All ways of all kernels; a call is never faster than its C."""
    calls = read(DOCS / "peers.json").calls
    assert [call.kernel for call in calls] == list(python_calls.READS) * len(python_calls.ROBOTS)
    for call in calls:
        assert set(call.ns) >= {"Python", python_calls.WITHOUT, python_calls.OUT, python_calls.MANY}
        assert call.kernel in python_calls.FRAMED or call.ns["Python"] > call.ns["C"] > 0.0


def test_calls_from_python_are_a_fraction_of_pinocchios() -> None:
    """In the committed run, for what a loop of an integrator or a controller calls."""
    for call in read(DOCS / "peers.json").calls:
        if call.kernel in ("inverse_dynamics", "mass_matrix", "forward_dynamics") and "Pinocchio" in call.ns:
            most = 0.3 if call.title.startswith("UR5") else 0.25
            assert call.ns["Python"] <= most * call.ns["Pinocchio"], call


def test_tables_of_a_report(report: Report) -> None:
    table = page.page(report)
    assert "| Pinocchio, C++ | mass matrix | 4.5 (4) | - | - | - |" in table  # the faster convention counts
    assert "| Pinocchio, C++ | derivatives of inverse dynamics | not built (6) | - | - | - |" in table
    assert "| UR5 URDF (6 DOF) | C | Python | per state of 4096 | Pinocchio | ratio |" in table
    assert "| mass matrix | 0.05 | 2.35 | 0.07 | - | - |" in table
    assert "| inverse dynamics | 0.066 | 3.46 | - | 6.91 | 0.50 |" in table
    assert page.called(replace(report, calls=())) == []
    assert "| eomgen `rk4` | 0.15 | 2e-11 | 4 | 2e-09 |" in table
    assert "| other | 2.5 | 3e-07 | - | - |" in table
    assert page.rolled(replace(report, gradients=())) == []
    said = page.lines(report)
    assert [line.split()[-1] for line in said[:2]] == ["held", "missed"]
    assert "not built" in said[2]
    text = page.page(report)
    assert text.isascii()
    assert "| inverse dynamics | 4.5 (6, missed) |" in text
    assert "figures that are missed: inverse dynamics of UR5 URDF (6 DOF), Pinocchio (4.5 of 6)" in text
    assert "Required and not measured: derivatives of inverse dynamics of UR5 URDF (6 DOF), Pinocchio." in text
    assert "CasADi: missing in this run" in text
    assert "6.00 (5.90 - 6.10)" in text


def test_rows_that_are_lost_are_said(report: Report) -> None:
    """A rival that is faster, and a batch that takes longer than its states alone."""
    slower = replace(report.entries[0], ratios={"CasADi": (0.7, 0.8, 0.9), "Pinocchio (local)": (4.4, 4.5, 4.6)})
    batch = replace(report.entries[0], batch=True, ratios={"eomgen": (0.8, 0.91, 1.0)})
    text = page.page(replace(report, entries=(slower, batch)))
    assert "| C that CasADi generates from Pinocchio's algorithms | mass matrix | 0.80 | - | - | - |" in text
    assert "| eomgen itself, one state after the other | mass matrix, per state of 4096 | 0.91 | - | - | - |" in text
    assert "Lost, with ratios of 1 and less: mass matrix of UR5 URDF (6 DOF) beside C that CasADi" in text
    assert "per state of 4096 of UR5 URDF (6 DOF) beside eomgen itself, one state after the other (0.91)." in text
    assert "Lost" not in page.page(report)


def test_a_report_survives_its_file(report: Report, tmp_path: Path) -> None:
    report.write(tmp_path / "report.json")
    assert read(tmp_path / "report.json") == report


def test_plots_are_the_same_bytes(report: Report, tmp_path: Path) -> None:
    for name in ("one.svg", "two.svg"):
        plot.plot(replace(report, growing=report.entries), tmp_path / name)
    assert (tmp_path / "one.svg").read_bytes() == (tmp_path / "two.svg").read_bytes()


def test_required_ratios() -> None:
    assert required("Pinocchio", "UR5", "inverse_dynamics", batch=False) == 6
    assert required("Pinocchio", CHAIN, "forward_dynamics", batch=False) == 15
    assert required("MuJoCo", ELASTIC, "step", batch=False) == 10
    assert required("MuJoCo", "UR5", "inverse_dynamics", batch=False) is None
    assert {key for key, _, _ in (*AGAINST_PINOCCHIO, *AGAINST_MUJOCO)} <= set(TITLES)


def test_contenders_that_differ_are_refused(built: Build) -> None:
    robot = chain(1).robot
    heavier = replace(robot, links=tuple(replace(link, mass=1.001 * link.mass) for link in robot.links))
    found = []
    for given in (robot, robot, heavier):
        kernel = built(given, "inverse_dynamics")
        h = kernel.parameters.setup.address(kernel.raw.function("inverse_dynamics").library)
        found.append(Contender("ours", kernel.raw.address("inverse_dynamics"), h, kept=kernel))
    many = Contender("batch", kernel.raw.address("inverse_dynamics", batch=True), h, batch=True, kept=kernel)
    arrays = [states(robot, 5)[name] for name in ("q", "v", "a")]
    assert compare(found[:2], arrays, 6, 1e-12, "") == 0
    assert compare([found[2], many], arrays, 6, 1e-12, "") < 1e-12
    refused(Disagreement, "differs", compare, found, arrays, 6, 1e-12, "")
    refused(Disagreement, "differs", compare, [found[0], many], arrays, 6, 1e-12, "")


@pytest.mark.soak
def test_steps_alone_and_in_a_batch() -> None:
    """What is timed is ten linearly implicit steps of every state."""
    robot = eomgen.load_robot("one_link")
    ours = Ours(robot, ("step",), lambda line: None)
    q, v, u = (states(robot, 5)[name] for name in READS["step"])
    end = ours.kernel.rollout(q, v, u, 1e-3, 10, method="implicit")
    expected = np.hstack([x[:, -1] for x in end])
    for each in (ours.step(1e-3), ours.step(1e-3, 5)):
        np.testing.assert_allclose(each.results([q, v, u], 4), expected, rtol=1e-12, err_msg=each.label)  # they fuse


@pytest.mark.soak
def test_gradients_of_rollouts_by_all_ways() -> None:
    """All differentiate the same sum; those by finite differences leave a larger error."""
    needs("jax")
    task = Task(Case("UR5", eomgen.load_robot("one_link")), 6)
    for label, method in OURS.items():
        assert task.error(task.ours(method)(), method) < 1e-9, label
    for label, call in task.jax().items():
        assert task.error(call(), "rk4" if "rk4" in label else "implicit") < 1e-9, label
    try:
        found = task.mujoco()
    except MissingPeer as error:
        pytest.skip(str(error))
    assert set(found) == set(DIFFERENCES)
    for label, call in found.items():
        assert 1e-12 < task.error(call(), "implicit") < 1e-4, label


def test_a_chain_repeats_its_joints(built: Build) -> None:
    """Six joints are puma560_generic with six coordinates in each; a seventh is the first again."""
    assert [case(CHAIN).coordinates, chain(7).coordinates] == [36, 42]
    robot = chain(7).robot
    assert robot.joints[6].placement == robot.joints[0].placement
    assert robot.joints[6].parent == "link6"


def test_urdfs_are_open_trees() -> None:
    """As peers read them: a finger that mimics another one is free."""
    assert not case("Panda").robot.couplings
    assert case("Panda").coordinates == 9


def test_model_text_is_the_robot() -> None:
    """Pinocchio's own reading of a URDF, and one joint per coordinate of a chain."""
    pinocchio = needs("pinocchio")
    from benchmarks.peers.pinocchio_peer import model_text, one_by_one

    lines = model_text(case("UR5")).splitlines()
    assert lines[0] == "0.0 0.0 -9.81"
    assert [len(line.split()) for line in lines[2:]] == [30] * int(lines[1]) == [30] * 6
    assert {tuple(line.split()[2:5]) for line in lines[2:]} == {("0.0", "0.0", "1.0"), ("0.0", "1.0", "0.0")}
    model = one_by_one(case(CHAIN).robot)
    assert model.nv == 36
    mass = sum(link.mass for link in case(CHAIN).robot.links)
    assert np.isclose(pinocchio.computeTotalMass(model), mass)
    rows = [line.split() for line in model_text(case(CHAIN)).splitlines()[2:]]
    assert [row[1] for row in rows[:6]] == ["1.0"] * 3 + ["0.0"] * 3
    assert sum(float(row[17]) for row in rows) == pytest.approx(mass)


def test_a_peer_that_cannot_be_had_is_named(empty_cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(MissingPeer, match="no compiler nothing_like_it"):
        build_library("x", "nothing_like_it", [("x.c",)], (), {"x.c": ""})
    refused(MissingPeer, "expected", build_library, "x", "cc", [("x.c",)], (), {"x.c": "int main(void) { return 0 }\n"})
    from benchmarks.peers import pinocchio_peer

    monkeypatch.setattr(pinocchio_peer.sys, "path", [])
    refused(MissingPeer, "wheel pin", pinocchio_peer.library)


def test_a_library_is_compiled_once(empty_cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    arguments = ("x", "cc", [("-O1", "x.c")], (), {"x.c": "int x(void) { return 1; }\n"})
    path = build_library(*arguments)
    monkeypatch.setattr(contender, "_run", lambda command: pytest.fail("compiled again"))
    assert build_library(*arguments) == path
    assert path.is_relative_to(empty_cache)


@pytest.mark.soak
def test_it_runs_without_peers(monkeypatch: pytest.MonkeyPatch) -> None:
    """All peers missing: the textbook remains, and the table says so."""
    from benchmarks.peers import run as module

    def no_peer() -> Path:
        raise MissingPeer("not here")

    for name in ("pinocchio_peer", "mujoco_peer"):
        monkeypatch.setattr(getattr(module, name), "library", no_peer)
    monkeypatch.setattr(module.casadi_peer, "tracer", no_peer)
    monkeypatch.setattr(module, "case", lambda key: replace(chain(1), key=key))
    found, differing = module.run(1, lambda line: None, ["UR5"], (1,))
    assert not differing
    assert set(found.missing) == {"Pinocchio", "CasADi", "MuJoCo"}
    first = found.entry("UR5", "inverse_dynamics")
    assert set(first.ns) == {"eomgen", "textbook"}
    assert "| inverse dynamics | - (6) |" in page.page(found)
