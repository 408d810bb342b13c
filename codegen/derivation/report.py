"""A derivation to be read, as a page or in LaTeX: joint matrices, terms of eqs. (11) and (12) that survive."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement, groupby
from typing import Any

import numpy as np
import sympy as sp
from sympy.printing.mathml import mathml

from eomgen.errors import InputError
from eomgen.names import kind_of
from eomgen.robot.model import FIXED_BODY
from eomgen.robot.value import COORDINATES

from ..c.source import environment
from ..closed_form.readable import MOST_COORDINATES, ReadableClosedForm, readable_closed_form
from ..joint.zeros import Tally, ZeroMap
from .afresh import Derived
from .fresh import Blocks

ENDINGS = (".html", ".tex")
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


def terms(derived: Derived) -> Iterator[Terms]:
    """List the surviving terms of all equations, joint by joint; none where zeros are not counted."""
    model, zeros = derived.model, derived.zeros
    if zeros is None:
        return
    owner = {index: (k + 1, name) for k, body in enumerate(model.bodies) for index, name in _active(body)}
    for index, (number, kind) in owner.items():
        mass: dict[str, list[int]] = {}
        for v in np.flatnonzero(zeros.mass_matrix.mask[index]).tolist():
            mass.setdefault(owner[v][1], []).append(owner[v][0])
        pairs: dict[tuple[str, str], list[tuple[int, int]]] = {}
        for v, w in np.argwhere(zeros.christoffel.mask[index]).tolist():
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


def _active(body: Any) -> Iterator[tuple[int, str]]:
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


def render_report(derived: Derived, ending: str) -> str:
    """Write a derivation as a page (".html") or as a document of LaTeX (".tex")."""
    style = ending.removeprefix(".")
    printer = _mathml if style == "html" else _latex
    model = derived.model
    bodies = [
        {
            "joint": body.joint,
            "parent": "base" if body.parent == FIXED_BODY else model.bodies[body.parent].joint,
            "active": body.active,
        }
        for body in model.bodies
    ]
    names = {
        "name": model.name,
        "summary": list(derived.lines()),
        "bodies": bodies,
        "motors": [name for name in model.coordinates if kind_of(name) not in COORDINATES],
        "blocks": [_block(model, blocks, printer) for blocks in derived.blocks.values()],
        "terms": list(terms(derived)),
        "closed": _closed(derived),
    }
    return environment().get_template(f"derivation/report.{style}.jinja").render(names)


def _block(model: Any, blocks: Blocks, printer: Any) -> dict[str, Any]:
    """Print the matrices of a kind of joint."""
    pairs = combinations_with_replacement(blocks.active, 2)
    return {
        "joints": [k + 1 for k, body in enumerate(model.bodies) if body.active == blocks.active],
        "transform": printer(blocks.transform),
        "first": [(name, printer(D)) for name, D in blocks.first.items()],
        "second": [(*pair, printer(blocks.second[pair])) for pair in pairs if pair not in blocks.lemmas],
        "lemmas": [(*pair, lemma) for pair, lemma in blocks.lemmas.items()],
    }


def _closed(derived: Derived) -> dict[str, Any]:
    """Return closed-form equations of a small robot, as text and for LaTeX; nothing where they cannot be read."""
    if derived.model.size > MOST_COORDINATES:
        return {}
    try:
        form: ReadableClosedForm = readable_closed_form(derived.model)
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


def _latex(matrix: Any) -> str:
    return str(sp.latex(matrix))


def _mathml(matrix: Any) -> str:
    return f"<math>{mathml(matrix, printer='presentation')}</math>"
