"""Reports of derivations: every surviving term is named once, pages parse, LaTeX compiles where there is one."""

from __future__ import annotations

import re
import shutil
import subprocess
from html.parser import HTMLParser
from itertools import product
from pathlib import Path

import pytest

from eomgen.codegen.derivation.afresh import Derived, derive_afresh
from eomgen.codegen.derivation.report import render_report, terms
from eomgen.description.load import load_robot
from eomgen.names import component_name
from eomgen.robot.model import build_model


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
    text, open_tags = render_report(derived(name), ".html"), list[str]()

    class Reader(HTMLParser):
        def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
            if tag != "meta":
                open_tags.append(tag)

        def handle_endtag(self, tag: str) -> None:
            assert open_tags.pop() == tag

    Reader().feed(text)
    assert not open_tags
    assert text.isascii()
    assert ("Closed form" in text) == (name == "one_link")
    assert "M<sub>1</sub><sup><i>x</i><i>&gamma;</i></sup>" in text


@pytest.mark.parametrize("name", ["one_link", "puma560_elastic"])
def test_latex(name: str, tmp_path: Path) -> None:
    text = render_report(derived(name), ".tex")
    begun, ended = (re.findall(rf"\\{word}{{(\w+\*?)}}", text) for word in ("begin", "end"))
    assert sorted(begun) == sorted(ended)
    assert text.count("{") == text.count("}")
    assert r"\mathbf{M}_{1}^{x \gamma}" in text
    if shutil.which("pdflatex"):
        (tmp_path / "derivation.tex").write_text(text, encoding="ascii")
        command = ["pdflatex", "-interaction=nonstopmode", "-halt-on-error", "derivation.tex"]
        assert subprocess.run(command, cwd=tmp_path, capture_output=True, timeout=120).returncode == 0
