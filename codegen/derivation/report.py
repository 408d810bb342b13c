"""A model's derivation to be read: a summary for headers; a page or LaTeX with joint matrices and surviving terms."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement, groupby
from textwrap import wrap
from typing import Any

import numpy as np

from eomgen.errors import InputError
from eomgen.robot.geometry import Entries, JointFacts
from eomgen.robot.model import FIXED_BODY, Body, Model
from eomgen.robot.value import COORDINATES

from ..c.source import environment
from ..joint.facts import facts_of, lemma_of
from ..joint.zeros import Tally, ZeroMap, zero_map

MOST_COUNTED = 256  # coordinates of robots whose terms of C are counted
WIDTH = 110  # of lines in a header
_NUMBERS = {name: place for place, name in enumerate(COORDINATES)}

Zeros = tuple[tuple[str, int], ...]


@dataclass(frozen=True)
class Terms:
    """Terms of one equation of (10), that of a coordinate.

    number: of its joint.  mass: per v the joints l whose M_i^sv survives.  christoffel: per v and w the joints l, f;
    one of two that are equal.  zeros: how many entries of M and of C vanish, by reason.
    """

    coordinate: str
    number: int
    kind: str
    mass: tuple[tuple[str, str], ...]
    christoffel: tuple[tuple[str, str, str], ...]
    zeros: tuple[Zeros, Zeros]


def summary(model: Model) -> list[str]:
    """Write lines: what SymPy derived, and how many terms of M and C vanish by which lemma."""
    facts, zeros = _kinds(model), _zeros(model)
    joints = ", ".join(f"({' '.join(active)})" for active in facts if active)
    lines = wrap(
        f"SymPy {next(iter(facts.values())).sympy} derived A_(i-1)i of eq. (3) and its first and second derivatives for"
        f" joints with the active coordinates {joints}, and proved which terms tr(dA/ds H dA^T) of M and"
        " tr(dA/ds H d2A^T) of C vanish:",
        WIDTH,
    )
    lines += [f"terms of more than {MOST_COUNTED} coordinates are not counted"] if zeros is None else zeros.lines()
    if any(body.modes for body in model.bodies):
        lines.append("lemmas of modes: those of docs/theory.md, which the tests of eomgen prove")
    return lines


def with_summary(header: str, model: Model) -> str:
    """Return a C header with the summary in its first comment."""
    end = header.index("\n */\n")
    return header[:end] + "".join(f"\n * {line}".rstrip() for line in ("", *summary(model))) + header[end:]


def _kinds(model: Model) -> dict[tuple[str, ...], JointFacts]:
    """Return the facts about the joints of the tree, by their active coordinates."""
    return {body.active: facts_of(model, body.active) for body in model.tree.bodies}


def _zeros(model: Model) -> ZeroMap | None:
    """Find the zeros of the tree, with followers as coordinates; None of large robots."""
    return zero_map(model.tree) if model.tree.size <= MOST_COUNTED else None


def terms(model: Model) -> Iterator[Terms]:
    """List the surviving terms between coordinates of joints, joint by joint; none where zeros are not counted."""
    model, zeros = model.tree, _zeros(model)
    if zeros is None:
        return
    owner = {index: (k + 1, name) for k, body in enumerate(model.bodies) for index, name in _active(body)}
    for index, (number, kind) in owner.items():
        mass: dict[str, list[int]] = {}
        for v in filter(owner.get, np.flatnonzero(zeros.mass_matrix.mask[index]).tolist()):
            mass.setdefault(owner[v][1], []).append(owner[v][0])
        pairs: dict[tuple[str, str], list[tuple[int, int]]] = {}
        for v, w in np.argwhere(zeros.christoffel.mask[index]).tolist():
            if v not in owner or w not in owner:
                continue  # modes of flexible links
            (first, one), (second, other) = owner[v], owner[w]
            if _NUMBERS[one] < _NUMBERS[other] or (one == other and first <= second):
                pairs.setdefault((one, other), []).append((first, second))
        yield Terms(
            model.coordinates[index],
            number,
            kind,
            tuple((v, _ranges(mass[v])) for v in sorted(mass, key=_NUMBERS.__getitem__)),
            tuple((*key, _pairs(pairs[key])) for key in sorted(pairs, key=lambda x: (_NUMBERS[x[0]], _NUMBERS[x[1]]))),
            _vanishing(zeros, index),
        )


def _active(body: Body) -> Iterator[tuple[int, str]]:
    return zip(body.indices, body.active, strict=True)


def _vanishing(zeros: ZeroMap, index: int) -> tuple[Zeros, Zeros]:
    """Count the entries of a coordinate's M and C that vanish, by reason; of two that are equal one."""

    def counted(tally: Tally, reasons: Any) -> Zeros:
        counts = Counter(reasons[reasons >= 0].tolist())
        return tuple((tally.zeros[place][0], counts[place]) for place in sorted(counts))

    pairs = zeros.christoffel.reason[index]
    upper = pairs[np.triu_indices(len(pairs))]
    return counted(zeros.mass_matrix, zeros.mass_matrix.reason[index]), counted(zeros.christoffel, upper)


def _ranges(numbers: Sequence[int]) -> str:
    """Write numbers in order, runs of them as 1-6."""
    ranges = []
    for _, run in groupby(enumerate(sorted(numbers)), lambda x: x[1] - x[0]):
        values = [value for _, value in run]
        ranges.append(str(values[0]) if len(values) == 1 else f"{values[0]}-{values[-1]}")
    return ", ".join(ranges)


def _pairs(pairs: Sequence[tuple[int, int]]) -> str:
    """Group pairs (l, f) by l."""
    rows = groupby(sorted(pairs), lambda pair: pair[0])
    return "; ".join(f"({first}, {_ranges([second for _, second in row])})" for first, row in rows)


def render_report(model: Model, ending: str) -> str:
    """Write a model's derivation as a page (".html") or as a document of LaTeX (".tex")."""
    style, tree = ending.removeprefix("."), model.tree
    printer = _mathml if style == "html" else _latex
    bodies = [
        {
            "joint": body.joint,
            "parent": "base" if body.parent == FIXED_BODY else tree.bodies[body.parent].joint,
            "active": body.active,
        }
        for body in tree.bodies
    ]
    names = {
        "name": model.name,
        "summary": summary(model),
        "bodies": bodies,
        "motors": [tree.coordinates[i] for i in tree.motors],
        "blocks": [_block(tree, facts, printer) for facts in _kinds(model).values()],
        "terms": list(terms(model)),
        "closed": _closed(tree),
    }
    return environment().get_template(f"derivation/report.{style}.jinja").render(names)


def _block(model: Model, facts: JointFacts, printer: Callable[[Entries], str]) -> dict[str, Any]:
    """Print the matrices of a kind of joint."""
    second = zip(combinations_with_replacement(facts.active, 2), facts.second, strict=True)
    return {
        "joints": [k + 1 for k, body in enumerate(model.bodies) if body.active == facts.active],
        "transform": printer(facts.transform),
        "first": [(name, printer(D)) for name, D in zip(facts.active, facts.first, strict=True)],
        "second": [(*pair, printer(D)) for pair, D in second if pair not in facts.zero_pairs],
        "lemmas": [(*pair, lemma_of(*pair)) for pair in facts.zero_pairs],
    }


def _closed(model: Model) -> dict[str, Any]:
    """Return closed-form equations of a small robot, as text and for LaTeX; nothing where they cannot be read."""
    from ..closed_form.readable import MOST_COORDINATES, readable_closed_form  # imports SymPy

    if model.size > MOST_COORDINATES:
        return {}
    try:
        form = readable_closed_form(model)
    except InputError:
        return {}
    rows = [row for block in form.equations(long_frac_ratio=2) for row in block]
    return {
        "lines": form.lines(),
        "letters": [(letter.latex, letter.said) for letter in form.letters],
        "notes": form.notes(),
        "equations": [tuple(map(_breakable, row)) for row in rows],
    }


def _breakable(text: str) -> str:
    """Rewrite a formula for lines to end in it: TeX breaks sums in plain parentheses, none in those that grow."""
    return text.replace("\\left(", "(").replace("\\right)", ")")


def _latex(entries: Entries) -> str:
    from sympy import latex

    return str(latex(_matrix(entries)))


def _mathml(entries: Entries) -> str:
    from sympy.printing.mathml import mathml

    return f"<math>{mathml(_matrix(entries), printer='presentation')}</math>"


def _matrix(entries: Entries) -> Any:
    """Return SymPy's matrix of the entries."""
    import sympy

    functions = {"": lambda x: x, "sin": sympy.sin, "cos": sympy.cos}

    def product(coefficient: int, factors: Iterable[tuple[str, str]]) -> Any:
        return sympy.Mul(coefficient, *(functions[name](sympy.Symbol(x)) for name, x in factors))

    return sympy.Matrix([[sympy.Add(*(product(*term) for term in entry)) for entry in row] for row in entries])
