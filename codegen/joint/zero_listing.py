"""Every zero of the zero map with its reason, readable for many coordinates.

Blocks of joint pairs (M) and joint triples (C) whose entries vanish for the same reasons are reported together.
"""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement, product

import numpy as np
from numpy.typing import NDArray

from eomgen.robot.model import Body, Model

from .zeros import ROTOR, Tally, zero_map

LETTERS = {"x": "x", "y": "y", "z": "z", "alpha": "a", "beta": "b", "gamma": "g"}
MODE = "mode"  # and a number, which "m" stands for in the text
WIDTH = 120
SHOWN = 200  # joint pairs or triples that one line of text names

Zeros = tuple[tuple[str, tuple[tuple[str, ...], ...]], ...]


@dataclass(frozen=True)
class Group:
    """Blocks with the same zeros.

    joints: the blocks, by their joints' names.  active: the coordinates of each of the joints, and modes of the link
    that it carries.  zeros: per reason the
    names of the coordinates (s, v) or (s, v, w) whose entry vanishes, v <= w (and s <= v in M).
    """

    joints: tuple[tuple[str, ...], ...]
    active: tuple[tuple[str, ...], ...]
    zeros: Zeros

    def as_dict(self) -> dict[str, object]:
        """Return plain values, for JSON."""
        zeros = [{"reason": reason, "entries": [list(entry) for entry in entries]} for reason, entries in self.zeros]
        return {"joints": [list(key) for key in self.joints], "zeros": zeros}


@dataclass(frozen=True)
class ZeroReport:
    """The zeros of M and C that hold for any geometry, grouped; ``joints`` names the joints in order.

    The groups are those of the bodies; entries of ``motors`` vanish but for their inertias on the diagonal of M.
    ``rows``: components of the loops' constraint that vanish with all their derivatives, with the reason.
    """

    robot: str
    joints: tuple[str, ...]
    mass_matrix: tuple[Group, ...]
    christoffel: tuple[Group, ...]
    motors: tuple[str, ...] = ()
    rows: tuple[tuple[str, str], ...] = ()

    def as_dict(self) -> dict[str, object]:
        """Return plain values, for JSON."""
        parts = {"mass_matrix": self.mass_matrix, "christoffel": self.christoffel}
        motors = {"motors": list(self.motors)} if self.motors else {}
        return {
            "robot": self.robot,
            **motors,
            **{key: [group.as_dict() for group in groups] for key, groups in parts.items()},
            **({"constraints": [{"row": row, "reason": reason} for row, reason in self.rows]} if self.rows else {}),
        }

    def _has_modes(self) -> bool:
        groups = (*self.mass_matrix, *self.christoffel)
        return any(kind.startswith(MODE) for group in groups for kinds in group.active for kind in kinds)

    def lines(self) -> list[str]:
        """Write text for people: a paragraph per group of blocks, in it a line per reason."""
        numbers = {name: str(i + 1) for i, name in enumerate(self.joints)}
        legend = ", ".join(f"{number} {name}" for name, number in numbers.items())
        lines = [f"{self.robot}: what vanishes identically, and why", *_wrapped("joints: " + legend, "  ")]
        kinds = "x y z, a alpha, b beta, g gamma" + (", m1 mode1" if self._has_modes() else "")
        lines += [f"coordinates: {kinds}; a joint's pattern holds for any geometry and inertia"]
        if self.motors:
            lines += _wrapped(f"{', '.join(self.motors)}: {ROTOR}", "")
        titles = ("M_sv, eq. (11), s <= v", "C_s,vw, eq. (12), v <= w: written s:vw, *:vw for every s")
        for title, groups in zip(titles, (self.mass_matrix, self.christoffel), strict=True):
            lines += ["", title]
            for group in groups:
                lines += _group_lines(group, numbers)
            if not groups:
                lines.append("  nothing")
        if self.rows:
            lines += ["", "g(q), rows of cut joints, with their derivatives"]
            for reason in dict.fromkeys(reason for _, reason in self.rows):
                names = ", ".join(row for row, why in self.rows if why == reason)
                lines += _wrapped(f"{reason}: {names}", "  ")
        return lines


def zero_report(model: Model, rows: tuple[tuple[str, str], ...] = ()) -> ZeroReport:
    """Find and group the structural zeros of a model, beside rows of its constraint that vanish."""
    zeros, count = zero_map(model), len(model.bodies)
    pairs = list(combinations_with_replacement(range(count), 2))
    triples = [(i, *pair) for i, pair in product(range(count), pairs)]
    return ZeroReport(
        model.name,
        tuple(body.joint for body in model.bodies),
        _grouped(model.bodies, zeros.mass_matrix, pairs),
        _grouped(model.bodies, zeros.christoffel, triples),
        tuple(model.coordinates[i] for i in model.motors),
        rows,
    )


def _grouped(bodies: Sequence[Body], tally: Tally, keys: Sequence[tuple[int, ...]]) -> tuple[Group, ...]:
    """Group the blocks that have zeros, the largest group first."""
    alike: dict[tuple[object, ...], list[tuple[int, ...]]] = {}
    for key in keys:
        block = tally.reason[np.ix_(*(_places(bodies[k]) for k in key))]
        if (block >= 0).any():
            active = tuple(_kinds(bodies[k]) for k in key)
            alike.setdefault((active, key[-1] == key[-2], block.tobytes()), []).append(key)
    groups = []
    for members in sorted(alike.values(), key=len, reverse=True):
        first = members[0]
        block = tally.reason[np.ix_(*(_places(bodies[k]) for k in first))]
        zeros = _entries([bodies[k] for k in first], first[-1] == first[-2], block, [r for r, _ in tally.zeros])
        names = tuple(tuple(bodies[k].joint for k in key) for key in members)
        groups.append(Group(names, tuple(_kinds(bodies[k]) for k in first), zeros))
    return tuple(groups)


def _places(body: Body) -> list[int]:
    return [*body.indices, *body.modes]


def _kinds(body: Body) -> tuple[str, ...]:
    """Name the coordinates of a body's joint, and behind them the modes of its link."""
    return (*body.active, *(f"{MODE}{k + 1}" for k in range(len(body.modes))))


def _entries(bodies: Sequence[Body], same: bool, block: NDArray[np.int8], reasons: Sequence[str]) -> Zeros:
    """Name the entries that vanish, by reason; one of two that are mirrored."""
    zeros = []
    for place, reason in enumerate(reasons):
        entries = [
            tuple(_kinds(body)[i] for body, i in zip(bodies, index, strict=True))
            for index in np.argwhere(block == place).tolist()
            if not same or index[-2] <= index[-1]
        ]
        if entries:
            zeros.append((reason, tuple(entries)))
    return tuple(zeros)


def _group_lines(group: Group, numbers: dict[str, str]) -> list[str]:
    shown = [",".join(numbers[name] for name in key) for key in group.joints[:SHOWN]]
    more = len(group.joints) - len(shown)
    blocks = " ".join(shown) + (f" and {more} more (all: --json)" if more else "")
    lines = _wrapped(f"joints {blocks}", "  ")
    for reason, entries in group.zeros:
        lines += _wrapped(f"{reason}: {_short(group, entries)}", "    ")
    return lines


def _short(group: Group, entries: Sequence[tuple[str, ...]]) -> str:
    """Write the entries in letters; those that hold for every s once."""
    letters = [tuple(map(_letter, entry)) for entry in entries]
    if len(group.active) == 2:
        return " ".join("".join(entry) for entry in letters)
    rows: dict[str, list[str]] = {}
    for s, v, w in letters:
        rows.setdefault(s, []).append(v + w)
    every = [_letter(name) for name in group.active[0]]
    always = [pair for pair in rows[letters[0][0]] if all(pair in rows.get(s, ()) for s in every)]
    parts = [f"*:{','.join(always)}"] if always else []
    for s, pairs in rows.items():
        rest = [pair for pair in pairs if pair not in always]
        parts += [f"{s}:{','.join(rest)}"] if rest else []
    return " ".join(parts)


def _letter(kind: str) -> str:
    return LETTERS.get(kind) or kind.replace(MODE, "m")


def _wrapped(text: str, indent: str) -> list[str]:
    return textwrap.wrap(text, WIDTH, initial_indent=indent, subsequent_indent=indent + "  ", break_on_hyphens=False)
