"""The derivation compared with rendered programs and with terms of M and C in exact arithmetic; and its report."""

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

from eomgen.codegen.closed_form import readable
from eomgen.codegen.derivation.report import render_report, terms, with_summary
from eomgen.codegen.forces.coordinates import ModalCouplings
from eomgen.codegen.forces.element import ForceElement
from eomgen.codegen.joint.deriving import derive_joint
from eomgen.codegen.joint.zeros import zero_map
from eomgen.codegen.kernels.equations import Equations, derive_equations
from eomgen.codegen.kernels.signatures import available
from eomgen.codegen.program.ir import Program, evaluate
from eomgen.description.load import builtin_robots, load_robot, robot_from_toml
from eomgen.names import component_name
from eomgen.robot.geometry import JointFacts
from eomgen.robot.model import Model, build_model
from eomgen.robot.value import Robot
from tests.oracles.exact_programs import CHECKED, check_programs
from tests.oracles.generic_terms import check_zeros
from tests.support.elastic_robots import elastic_robot
from tests.support.every_element import ROBOTS, robot_with
from tests.support.random_followers import with_followers
from tests.support.random_motors import with_motors
from tests.support.random_robots import random_robot, seeds, with_offsets, with_random_loops
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


def checked_page(model: Model) -> str:
    """The page of a derivation, which names every coordinate that has an equation."""
    text, reader = render_report(model, ".html"), _Reader()
    reader.feed(text)
    reader.close()
    assert not reader.open
    assert text.isascii()
    assert all(f">{body.joint}<" in text or f"{body.joint}." in text for body in model.tree.bodies if body.active)
    return text


def checked_latex(model: Model, folder: Path) -> str:
    """The document of a derivation; pdflatex, where there is one, leaves nothing out of it."""
    text = render_report(model, ".tex")
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
RIGID = [name for name in builtin_robots() if all(link.modes is None for link in load_robot(name).links)]
LEAST = {"mass_matrix", "bias_force", "coriolis_matrix", "residual"}


@pytest.fixture
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    """Closed forms of reports end at two coordinates: others take seconds, and have tests of their own."""
    monkeypatch.setattr(readable, "MOST_COORDINATES", 2)


def check_derivation(model: Model) -> int:
    """Assert that programs agree and that no term that is dropped is there; how many surviving terms vanish."""
    zeros = zero_map(model.tree)
    equations = derive_equations(model, [name for name in CHECKED if name in available(model)])
    assert check_programs(equations, None if model.followers else zeros.christoffel) >= LEAST
    return check_zeros(model.tree, zeros)


@pytest.mark.parametrize("kind", soaked(KINDS, list(KINDS)[:2]))
@pytest.mark.parametrize("seed", seeds(2, 1, 12))
def test_random_robots(kind: str, seed: int, tmp_path: Path, short: None) -> None:
    """Programs agree, no term that is dropped is there, and none that survives vanishes; reports are documents."""
    model = build_model(KINDS[kind](seed))
    assert check_derivation(model) == 0
    checked_page(model)
    checked_latex(model, tmp_path)


@pytest.mark.parametrize("name", soaked(RIGID, ["one_link", "geared_arm", "four_bar"]))
def test_built_in_robots(name: str) -> None:
    check_derivation(build_model(load_robot(name)))


@pytest.mark.parametrize("family", [x for x in ROBOTS if x is not ModalCouplings], ids=lambda family: family.__name__)
def test_all_forces(family: type[ForceElement], tmp_path: Path, short: None) -> None:
    model = build_model(robot_from_toml(robot_with(family)))
    check_derivation(model)
    checked_page(model)
    checked_latex(model, tmp_path)


def test_float32() -> None:
    """Constants are those of double precision until C is written."""
    equations = derive_equations(build_model(load_robot("one_link")), ("mass_matrix",), "float32")
    assert "mass_matrix" in check_programs(equations)


def test_the_summary_counts_terms_by_lemma() -> None:
    model = build_model(load_robot("one_link"))
    text = with_summary("/* x.h\n */\nint x;\n", model)
    assert text.startswith("/* x.h\n *\n * SymPy ")
    assert "derived A_(i-1)i" in text
    assert "(x gamma)" in text
    assert text.endswith("\n */\nint x;\n")
    assert all(line in text for line in zero_map(model).lines())
    assert text.isascii()
    assert all(len(line) <= 120 for line in text.splitlines())


def test_facts_of_the_model_are_read() -> None:
    """The pairs that the model's facts name vanish, and no others."""
    model = build_model(load_robot("one_link"))
    facts = derive_joint(("x", "gamma"))
    fewer = replace(model, facts={facts.active: replace(facts, zero_pairs=facts.zero_pairs[1:])})
    assert zero_map(fewer).christoffel.survivors > zero_map(model).christoffel.survivors


def wrong_step(facts: JointFacts) -> JointFacts:
    rows = [list(row) for row in facts.steps[1].rotation]
    rows[1][0] = (0.0, -1.0, 0.0)  # -sin instead of sin
    return replace(facts, steps=(facts.steps[0], facts.steps[1]._replace(rotation=tuple(map(tuple, rows)))))


def test_wrong_facts_are_seen_by_the_oracle() -> None:
    """A program of a wrong rotation, and a zero that is none."""
    model, facts = build_model(load_robot("one_link")), derive_joint(("x", "gamma"))
    wrong = replace(model, facts={facts.active: wrong_step(facts)})
    with pytest.raises(AssertionError, match="the terms make"):
        check_programs(derive_equations(wrong, ("mass_matrix", "bias_force")))
    for change in ({"zero_pairs": (*facts.zero_pairs, ("gamma", "gamma"))}, {"orthogonal": (("x", "gamma"),)}):
        wrong = replace(model, facts={facts.active: replace(facts, **change)})
        with pytest.raises(AssertionError, match="does not vanish"):
            check_zeros(model, zero_map(wrong))


def test_a_dropped_term_that_does_not_vanish_is_seen() -> None:
    """An entry of M or C that survives is taken for one that a lemma drops."""
    model = build_model(load_robot("puma560"))
    zeros = zero_map(model)
    for tally, name in ((zeros.mass_matrix, "mass_matrix"), (zeros.christoffel, "christoffel")):
        mask = tally.mask.copy()
        key = tuple(np.argwhere(mask)[-1])
        mask[key] = False
        wrong = replace(zeros, **{name: replace(tally, mask=mask)})
        with pytest.raises(AssertionError, match=re.escape("; ".join(model.coordinates[i] for i in key))):
            check_zeros(model, wrong)


@pytest.mark.parametrize("kernel", soaked(CHECKED, CHECKED[::6]))
def test_a_wrong_constant_in_a_program_is_seen(kernel: str) -> None:
    """A number that is off by 1e-6 of itself."""
    model = build_model(load_robot("ur5"))
    equations = derive_equations(model, CHECKED)
    assert check_programs(equations) == {*CHECKED} - {"generalized_force"}
    program = equations.programs[kernel]
    changed = [_changed(program, i) for i, x in enumerate(program.instructions) if x.op == "const"]
    state = {key: [0.3, 0.4, -0.5, 0.7, 1.0, 0.2] for key in "qvau"}
    state["h"] = list(evaluate(equations.setup, {"p": list(model.parameters.values())}).values())
    right = evaluate(program, state)

    def effect(other: Program) -> float:
        return max(abs(value - right[key]) for key, value in evaluate(other, state).items())

    wrong = max(changed, key=effect)
    with pytest.raises(AssertionError, match=kernel if kernel != "generalized_force" else "inverse_dynamics"):
        check_programs(_with(equations, wrong))


def _changed(program: Program, place: int) -> Program:
    """Give a program whose constant at a place is larger by 1e-6 of itself."""
    instructions = list(program.instructions)
    instructions[place] = instructions[place]._replace(leaf=instructions[place].leaf * (1 + 1e-6))
    return replace(program, instructions=tuple(instructions))


def _with(equations: Equations, program: Program) -> Equations:
    return replace(equations, programs={**equations.programs, program.name: program})


def numbers(text: str) -> list[int]:
    """Read 1-3, 5 as 1, 2, 3, 5."""
    ends = [list(map(int, part.split("-"))) for part in text.split(", ")]
    return [n for end in ends for n in range(end[0], end[-1] + 1)]


@pytest.mark.parametrize("name", ["one_link", "puma560_elastic", "two_arms", "geared_arm", "flexible_arm"])
def test_all_surviving_terms_are_named_once(name: str) -> None:
    model = build_model(load_robot(name)).tree
    zeros = zero_map(model)
    place = {name: i for i, name in enumerate(model.coordinates)}

    def index(joint: int, kind: str) -> int:
        return place[component_name(model.bodies[joint - 1].joint, kind)]

    mass, christoffel = [], []
    for row in terms(model):
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
    text = checked_page(build_model(load_robot(name)))
    assert ("Closed form" in text) == (name == "one_link")
    assert "M<sub>1</sub><sup><i>x</i><i>&gamma;</i></sup>" in text


@pytest.mark.parametrize("name", ["one_link", "puma560_elastic", pytest.param("bennett", marks=pytest.mark.soak)])
def test_latex(name: str, tmp_path: Path) -> None:
    """Lines end in sums, also in those of a closed form that takes many of them."""
    text = checked_latex(build_model(load_robot(name)), tmp_path)
    assert ("Closed form" in text) == (name != "puma560_elastic")
    assert (r"\mathbf{M}_{1}^{x \gamma}" in text) == (name != "bennett")
    assert r"\left(" not in text.partition("Closed form")[2]
