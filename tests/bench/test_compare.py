"""The comparison of two versions: intervals, choice of rows, robots as files, calls, and what the table says."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import stats

import eomgen
from benchmarks.compare import __main__ as command
from benchmarks.compare import child
from benchmarks.compare.__main__ import Comparison, difference, interval, lines, time, work
from benchmarks.compare.rows import GRADIENT, Row, chosen, robot_file
from benchmarks.ladder import ladder
from benchmarks.peers.cases import chain
from tests.support.refusals import refused

pytestmark = pytest.mark.usefixtures("unoptimised")


def test_intervals() -> None:
    """Those of SciPy's test of a mean; they contain the true ratio in 95 % of samples."""
    samples = np.exp(np.random.default_rng(1).normal(math.log(1.02), 0.05, (2000, 20)))
    low, high = (np.exp(x) for x in stats.ttest_1samp(np.log(samples), 0.0, axis=1).confidence_interval(0.95))
    found = np.array([interval(sample) for sample in samples])
    np.testing.assert_allclose(found[:, 1], low, rtol=1e-12)
    np.testing.assert_allclose(found[:, 2], high, rtol=1e-12)
    assert 0.935 < np.mean((found[:, 1] < 1.02) & (found[:, 2] > 1.02)) < 0.965
    np.testing.assert_allclose(found[:, 0], stats.gmean(samples, axis=1), rtol=1e-12)
    assert interval([1.5])[0] == 1.5
    assert np.isnan([*interval([1.5])[1:], *interval([])]).all()


def test_rows_are_chosen_by_name_beginning_and_pattern() -> None:
    every = [row.name for row in chosen([])]
    assert len(set(every)) == len(every)
    assert {name.split("/")[0] for name in every} == {"peers", "closed", "precision"}

    def names(*patterns: str) -> list[str]:
        return [row.name for row in chosen(patterns)]

    one = "closed/four_bar/forward_dynamics/1"
    assert names(one) == [one]
    assert names("closed/*/1", one) == [name for name in every if name.startswith("closed") and name.endswith("/1")]
    assert names("precision", "closed") == [name for name in every if not name.startswith("peers")]
    assert names("peers", "*") == every
    for pattern in ("peers/UR", "nothing", one[:-2] + "/2"):
        refused(ValueError, "--list", names, "closed", pattern)


@pytest.mark.parametrize("key", ["chain", "ladder"])
def test_robots_as_files(key: str, tmp_path: Path) -> None:
    path, options = robot_file(key, tmp_path)
    robot, expected = eomgen.load_robot(path, **options), chain(6).robot if key == "chain" else ladder(40)
    assert [tuple(joint.coordinates) for joint in robot.joints] == [tuple(x.coordinates) for x in expected.joints]
    assert [link.inertia for link in robot.links] == [link.inertia for link in expected.links]
    assert [joint.placement for joint in robot.joints] == [joint.placement for joint in expected.joints]
    assert robot.loops == expected.loops
    assert robot_file("four_bar", tmp_path) == ("four_bar", {})


def answer(folder: Path, kernels: dict[str, Any], name: str, call: str, arrays: Any, **further: Any) -> Any:
    """What a child answers, as the other process reads it, and its results."""
    request = Row(f"{name}/1" if name == "each" else name, "one_link", call, lambda: arrays, **further).request(folder)
    made, counts = child.prepare(json.loads(json.dumps({**request, "results": str(folder / "results.npy")})), kernels)
    made()()
    return counts["counts"], np.load(folder / "results.npy")


def test_calls(tmp_path: Path) -> None:
    """All kinds of rows; one state a call and many give the same."""
    kernels: dict[str, Any] = {}
    kernel = eomgen.build("one_link")
    q, v, a, w = np.random.default_rng(1).uniform(-0.1, 0.1, (4, child.COMPARED, kernel.n))
    for call in ("inverse_dynamics", "forward_dynamics"):
        found = [answer(tmp_path, kernels, name, call, (q, v, a), out=True) for name in ("each", "many")]
        assert found[0][0] == found[1][0] == kernel.operations[call]
        np.testing.assert_allclose(found[0][1], np.ravel(getattr(kernel, call)(q, v, a)), rtol=1e-12)
        np.testing.assert_allclose(found[1][1], found[0][1], rtol=1e-12)
    jacobian = answer(tmp_path, kernels, "each", "residual_jacobian", (q[:1], v[:1], a[:1]))[1]
    np.testing.assert_allclose(jacobian[-1], kernel.mass_matrix(q[0])[-1, -1], rtol=1e-12)  # the last is by a
    contracted = answer(tmp_path, kernels, "each", "hessian", (q[:1], v[:1], a[:1], w[:1]))[1]
    np.testing.assert_allclose(contracted, kernel.hessian("inverse_dynamics", (q[0], v[0], a[0]), w[0]).ravel())
    span = {"duration": 0.05, "samples": 5, "rtol": 1e-8}
    ways = {"rollout": {**span, "method": "tsit5"}, "integrate": {**span, "method": "auto"}}
    motions = {call: answer(tmp_path, kernels, "x", call, (q[0], v[0], a[0]), keywords=ways[call]) for call in ways}
    assert all(counts["steps"] > 5 for counts, _ in motions.values())
    size = 6 * kernel.n
    np.testing.assert_allclose(motions["rollout"][1][:size], motions["integrate"][1], atol=1e-7)
    start = (q[0], v[0], np.zeros((GRADIENT["steps"], kernel.n)))
    keywords = {**GRADIENT, "method": "implicit"}
    _, gradient = answer(tmp_path, kernels, "x", "rollout_gradient", start, keywords=keywords)
    end = kernel.rollout(*start, GRADIENT["dt"], GRADIENT["steps"], method="implicit")[0][-1]
    assert gradient[0] == pytest.approx(end.sum())
    assert list(kernels) == ["one_link"]


class Stub:
    """A version whose samples are given."""

    def __init__(self, order: list[str], name: str, ns: float) -> None:
        self.order, self.name, self.ns = order, name, ns

    def send(self, request: Mapping[str, Any]) -> None:
        self.order.append(self.name)

    def answer(self) -> dict[str, Any]:
        return {"ns": self.ns}


def test_versions_take_turns() -> None:
    order: list[str] = []
    versions: Any = [Stub(order, "commit", 10.0), Stub(order, "here", 15.0)]
    assert time(chosen(["closed"])[0], versions, 3) == [1.5, 1.5, 1.5]
    assert order == ["commit", "here", "here", "commit", "commit", "here"]


def test_the_table() -> None:
    first, second, third, fourth = chosen(["closed/*/1"])
    count = {"mul": 10, "add": 5, "steps": 3}
    comparisons = [
        Comparison(first, (count, {**count, "steps": 6}), 0.0, "", [1.2, 1.21, 1.2]),
        Comparison(second, (count, {**count, "mul": 4}), 1e-9, "", [0.8, 0.9, 0.85]),
        Comparison(third, ({}, {}), 0.5),
        Comparison(fourth, missing="commit: no such method"),
    ]
    assert [each.differs for each in comparisons] == [False, False, True, False]
    table = lines(comparisons, "abc")
    assert table[2].startswith(f"| {first.name} | 10 mul 5 add 3 steps | 10 mul 5 add 6 steps | 2.000 | 1.203 | ")
    assert table[4].endswith("| 5.0e-01, not timed |")
    assert table[5].endswith("| commit: no such method |")
    assert table[-4:] == [
        f"More operations: {first.name}.",
        f"Fewer operations: {second.name}.",
        f"Slower: {first.name}.",
        f"Faster: {second.name}.",
    ]
    assert work({"steps": 7}) == 7


def test_results_that_differ() -> None:
    one = np.array([1.0, -4.0])
    assert difference(one, one + [0.0, 1.0]) == 0.25
    assert difference(one, np.zeros(3)) == math.inf
    assert Comparison(chosen(["closed"])[0], difference=difference(one, np.array([np.nan, 1.0]))).differs


def test_wrong_words(capsys: pytest.CaptureFixture[str]) -> None:
    for words, message in {
        (): "COMMIT is missing",
        ("HEAD", "nothing"): "ROW: 'nothing'",
        ("--rounds", "-1", "HEAD"): "--rounds",
        ("no-such-commit", "closed"): "COMMIT: 'no-such-commit'",
    }.items():
        refused(SystemExit, "", command.main, words)
        assert message in capsys.readouterr().err


@pytest.mark.soak
def test_a_commit_beside_the_working_tree(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(command, "CACHES", tmp_path)
    assert command.main(["HEAD", "closed/four_bar/forward_dynamics/1", "--rounds", "2"]) == 0
    assert "| 0.0e+00 |" in capsys.readouterr().out
    assert list(tmp_path.iterdir())
    (tmp_path / "src" / "eomgen").mkdir(parents=True)
    monkeypatch.setattr(command, "contents", lambda *_, **__: iter([]))
    with pytest.raises(ChildProcessError):
        command.Version(tmp_path, None, tmp_path / "cache").answer()  # an eomgen from elsewhere
