"""The report of zeros: expanded again, it is the zero map; and it is short for 36 coordinates."""

from __future__ import annotations

import json
from collections import Counter

import numpy as np
import pytest

import eomgen
from eomgen.cli import entry as cli
from eomgen.codegen.joint.zero_listing import ZeroReport, zero_report
from eomgen.codegen.joint.zeros import zero_map
from eomgen.codegen.kernels.constraint_rows import vanishing_rows
from eomgen.robot.model import Model, build_model
from tests.oracles.unpruned import brute_force
from tests.support.generic_robots import chain, generic
from tests.support.random_robots import random_robot


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
