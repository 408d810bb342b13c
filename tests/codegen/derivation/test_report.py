"""Reports of derivations: every surviving term is named once, pages parse, LaTeX compiles where there is one."""

from __future__ import annotations

from itertools import product
from pathlib import Path

import pytest

from eomgen.codegen.derivation.afresh import Derived, derive_afresh
from eomgen.codegen.derivation.report import terms
from eomgen.description.load import load_robot
from eomgen.names import component_name
from eomgen.robot.model import build_model
from tests.support.derivation_reports import checked_latex, checked_page


def derived(name: str) -> Derived:
    return derive_afresh(build_model(load_robot(name)), ("mass_matrix",))


def numbers(text: str) -> list[int]:
    """Read 1-3, 5 as 1, 2, 3, 5."""
    ends = [list(map(int, part.split("-"))) for part in text.split(", ")]
    return [n for end in ends for n in range(end[0], end[-1] + 1)]


@pytest.mark.parametrize("name", ["one_link", "puma560_elastic", "two_arms", "geared_arm"])
def test_all_surviving_terms_are_named_once(name: str) -> None:
    found = derived(name)
    model, zeros = found.model, found.zeros
    assert zeros is not None
    place = {name: i for i, name in enumerate(model.coordinates)}

    def index(joint: int, kind: str) -> int:
        return place[component_name(model.bodies[joint - 1].joint, kind)]

    mass, christoffel = [], []
    for row in terms(found):
        s = place[row.coordinate]
        mass += [(s, index(joint, v)) for v, joints in row.mass for joint in numbers(joints)]
        for v, w, pairs in row.christoffel:
            for pair in pairs.split("; "):
                first, others = pair.strip("()").split(", ", 1)
                christoffel += [(s, index(int(first), v), index(other, w)) for other in numbers(others)]
        for zero, tally in zip(row.zeros, (zeros.mass_matrix, zeros.christoffel), strict=True):
            assert {reason for reason, _ in zero} <= {reason for reason, _ in tally.zeros}
    spatial = [i for body in model.bodies for i in body.indices]
    assert sorted(mass) == [(s, v) for s, v in product(spatial, repeat=2) if zeros.mass_matrix.mask[s, v]]
    both = christoffel + [(s, w, v) for s, v, w in christoffel if v != w]
    assert sorted(both) == [key for key in product(spatial, repeat=3) if zeros.christoffel.mask[key]]


@pytest.mark.parametrize("name", ["one_link", "puma560_elastic"])
def test_pages_close_what_they_open(name: str) -> None:
    text = checked_page(derived(name))
    assert ("Closed form" in text) == (name == "one_link")
    assert "M<sub>1</sub><sup><i>x</i><i>&gamma;</i></sup>" in text


@pytest.mark.parametrize("name", ["one_link", "puma560_elastic", pytest.param("bennett", marks=pytest.mark.soak)])
def test_latex(name: str, tmp_path: Path) -> None:
    """Lines end in sums, also in those of a closed form that takes many of them."""
    text = checked_latex(derived(name), tmp_path)
    assert ("Closed form" in text) == (name != "puma560_elastic")
    assert (r"\mathbf{M}_{1}^{x \gamma}" in text) == (name != "bennett")
    assert r"\left(" not in text.partition("Closed form")[2]
