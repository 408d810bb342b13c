"""Derivations afresh: what SymPy derives is what is kept and rendered, nothing else passes; reports name every term."""

from __future__ import annotations

import re
import shutil
import subprocess
from collections.abc import Callable
from dataclasses import replace
from html.parser import HTMLParser
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from eomgen.codegen.derivation import report
from eomgen.codegen.derivation.afresh import Derived, derive_afresh
from eomgen.codegen.derivation.fresh import derive_blocks
from eomgen.codegen.derivation.generic_terms import check_zeros
from eomgen.codegen.derivation.programs import CHECKED
from eomgen.codegen.derivation.report import render_report, terms
from eomgen.codegen.forces.coordinates import ModalCouplings
from eomgen.codegen.forces.element import ForceElement
from eomgen.codegen.joint.facts import SHARPER, Facts, ZeroPair
from eomgen.codegen.joint.kept import KEPT
from eomgen.codegen.joint.zeros import zero_map
from eomgen.codegen.kernels.equations import Equations, derive_equations
from eomgen.codegen.program.ir import Program, evaluate
from eomgen.description.load import load_robot, robot_from_toml
from eomgen.errors import DerivationError
from eomgen.names import component_name
from eomgen.robot.model import build_model
from eomgen.robot.value import Robot
from tests.support.elastic_robots import elastic_robot
from tests.support.every_element import ROBOTS, robot_with
from tests.support.random_followers import with_followers
from tests.support.random_motors import with_motors
from tests.support.random_robots import random_robot, seeds, with_offsets, with_random_loops
from tests.support.refusals import refused
from tests.support.soak import soaked


class _Reader(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.open = list[str]()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag != "meta":
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def checked_page(derived: Derived) -> str:
    """The page of a derivation, which names every coordinate that has an equation."""
    text, reader = render_report(derived, ".html"), _Reader()
    reader.feed(text)
    reader.close()
    assert not reader.open
    assert text.isascii()
    assert all(f">{body.joint}<" in text or f"{body.joint}." in text for body in derived.model.bodies if body.active)
    return text


def checked_latex(derived: Derived, folder: Path) -> str:
    """The document of a derivation; pdflatex, where there is one, leaves nothing out of it."""
    text = render_report(derived, ".tex")
    assert text.isascii()
    begun, ended = (sorted(re.findall(rf"\\{word}{{(\w+\*?)}}", text)) for word in ("begin", "end"))
    assert begun == ended
    assert text.count("{") == text.count("}")
    if shutil.which("pdflatex"):
        (folder / "derivation.tex").write_text(text, encoding="ascii")
        command = ["pdflatex", "-interaction=nonstopmode", "-halt-on-error", "derivation.tex"]
        made = subprocess.run(command, cwd=folder, capture_output=True, text=True, errors="replace")
        assert made.returncode == 0, made.stdout[-3000:]
        assert "Missing character" not in made.stdout
        assert (folder / "derivation.pdf").stat().st_size > 10_000
    return text


pytestmark = pytest.mark.quick

KINDS: dict[str, Callable[[int], Robot]] = {
    "trees of all coordinates": lambda seed: random_robot(
        seed, tree=True, types=("revolute", "prismatic", "fixed", "free")
    ),
    "spherical joints": lambda seed: random_robot(seed, counts=(3, 1, 3), types=("fixed", "revolute")),
    "six elastic coordinates": lambda seed: elastic_robot(seed, 3, tree=True),
    "offsets": lambda seed: with_offsets(random_robot(seed, joints=(2, 4)), seed),
    "followers": lambda seed: with_followers(random_robot(seed, joints=(3, 4)), seed, tuned=True),
    "motors": lambda seed: with_motors(random_robot(seed, types=("revolute", "prismatic")), seed),
    "loops": lambda seed: with_random_loops(random_robot(seed, joints=(2, 4)), seed, ["revolute", "spherical"]),
}
LEAST = {"mass_matrix", "bias_force", "coriolis_matrix", "residual"}


@pytest.fixture
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    """Closed forms of reports end at two coordinates: others take seconds, and have tests of their own."""
    monkeypatch.setattr(report, "MOST_COORDINATES", 2)


@pytest.mark.parametrize("kind", soaked(KINDS, list(KINDS)[:2]))
@pytest.mark.parametrize("seed", seeds(2, 1, 12))
def test_random_robots(kind: str, seed: int, tmp_path: Path, short: None) -> None:
    """Programs agree, no term that is dropped is there, and none that survives vanishes; reports are documents."""
    found = derive_afresh(build_model(KINDS[kind](seed)))
    assert set(found.compared) >= LEAST
    assert found.vanishing == 0
    checked_page(found)
    checked_latex(found, tmp_path)


@pytest.mark.parametrize("family", [x for x in ROBOTS if x is not ModalCouplings], ids=lambda family: family.__name__)
def test_all_forces(family: type[ForceElement], tmp_path: Path, short: None) -> None:
    found = derive_afresh(build_model(robot_from_toml(robot_with(family))))
    assert set(found.compared) >= LEAST
    checked_page(found)
    checked_latex(found, tmp_path)


def test_float32_and_chosen_kernels() -> None:
    model = build_model(load_robot("one_link"))
    assert derive_afresh(model, ("mass_matrix",), "float32").compared == ("mass_matrix",)
    assert derive_afresh(model, ("kinematics",)).zeros is not None


@pytest.mark.soak
def test_lines_are_those_of_the_zero_map() -> None:
    found = derive_afresh(build_model(load_robot("puma560_elastic")))
    assert (found.zeros.christoffel.total, found.zeros.christoffel.survivors) == (23976, 10602)
    text = found.in_header("/* x.h\n */\nint x;\n")
    assert text.startswith("/* x.h\n *\n * Derived afresh by SymPy ")
    assert text.endswith("\n */\nint x;\n")
    assert all(line in text for line in found.zeros.lines())
    assert text.isascii()
    assert text == derive_afresh(found.model).in_header("/* x.h\n */\nint x;\n")


def wrong_step(facts: Facts) -> Facts:
    rows = [list(row) for row in facts.steps["gamma"].rotation]
    rows[0][1] = (0.0, 1.0, 0.0)  # sin instead of -sin
    steps = {**facts.steps, "gamma": replace(facts.steps["gamma"], rotation=tuple(map(tuple, rows)))}
    return replace(facts, steps=steps)


def one_zero_more(facts: Facts) -> Facts:
    return replace(facts, zero_pairs=(*facts.zero_pairs, ZeroPair("gamma", "gamma", True, SHARPER)))


def one_zero_less(facts: Facts) -> Facts:
    gone = ZeroPair("x", "gamma", False, SHARPER)
    return replace(facts, zero_pairs=tuple(pair for pair in facts.zero_pairs if pair != gone))


def another_coaxial(facts: Facts) -> Facts:
    return replace(facts, coaxial=(*facts.coaxial, ("x", "gamma")))


@pytest.mark.parametrize(
    ("change", "block", "place"),
    [
        (wrong_step, "step of gamma", "row 1, column 2"),
        (one_zero_more, "zeros of second derivatives", "gamma, gamma"),
        (one_zero_less, "zeros of second derivatives", "x, gamma"),
        (another_coaxial, "coaxial pairs", "x, gamma"),
    ],
)
def test_a_wrong_entry_of_the_kept_table_stops(change: Callable[[Facts], Facts], block: str, place: str) -> None:
    error = refused(DerivationError, "", derive_afresh, build_model(load_robot("one_link")), kept=change(KEPT))
    assert (error.joint, error.block) == ("joint1", block)
    assert error.place.startswith(place)
    assert all(word in str(error) for word in ("joint1", block, place))


def test_a_dropped_term_that_does_not_vanish_stops() -> None:
    """An entry of M or C that survives is taken for one that a lemma drops."""
    model = build_model(load_robot("puma560"))
    blocks, zeros = derive_blocks(model), zero_map(model)
    for tally, name in ((zeros.mass_matrix, "mass_matrix"), (zeros.christoffel, "christoffel")):
        mask = tally.mask.copy()
        key = tuple(np.argwhere(mask)[-1])
        mask[key] = False
        wrong = replace(zeros, **{name: replace(tally, mask=mask)})
        error = refused(DerivationError, "does not vanish", check_zeros, model, model, blocks, wrong)
        assert error.place == "; ".join(model.coordinates[i] for i in key)


@pytest.mark.parametrize("kernel", soaked(CHECKED, CHECKED[::6]))
def test_a_wrong_constant_in_a_program_stops(kernel: str) -> None:
    """A number that is off by 1e-6 of itself is refused with the kernel's name."""
    model = build_model(load_robot("ur5"))
    equations = derive_equations(model, CHECKED)
    assert set(derive_afresh(model, equations=equations).compared) == {*CHECKED} - {"generalized_force"}
    program = equations.programs[kernel]
    changed = [_changed(program, i) for i, x in enumerate(program.instructions) if x.op == "const"]
    state = {key: [0.3, 0.4, -0.5, 0.7, 1.0, 0.2] for key in "qvau"}
    state["h"] = list(evaluate(equations.setup, {"p": list(model.parameters.values())}).values())
    right = evaluate(program, state)

    def effect(other: Program) -> float:
        return max(abs(value - right[key]) for key, value in evaluate(other, state).items())

    wrong = max(changed, key=effect)
    error = refused(DerivationError, "", derive_afresh, model, equations=_with(equations, wrong))
    assert error.block == (kernel if kernel != "generalized_force" else "inverse_dynamics")
    assert error.joint in [body.joint for body in model.bodies]
    assert error.place


def _changed(program: Program, place: int) -> Program:
    """Give a program whose constant at a place is larger by 1e-6 of itself."""
    instructions = list(program.instructions)
    instructions[place] = instructions[place]._replace(leaf=instructions[place].leaf * (1 + 1e-6))
    return replace(program, instructions=tuple(instructions))


def _with(equations: Equations, program: Program) -> Equations:
    return replace(equations, programs={**equations.programs, program.name: program})


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
