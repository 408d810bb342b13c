"""Blocks of a robot's joints as SymPy derives them now, compared with what is kept."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, reduce
from itertools import combinations_with_replacement, product
from operator import matmul
from typing import Any

import sympy as sp

from eomgen.errors import DerivationError, InternalError
from eomgen.robot.model import Model

from ..joint.facts import Facts, FrozenStep, ZeroPair
from ..joint.freezing import derived_facts
from ..joint.kept import KEPT
from ..joint.lemmas import Matrix, joint_derivatives, joint_transform, step

Flat = tuple[list[Any], list[list[Any]], list[list[Any]]]


@dataclass(frozen=True)
class Blocks:
    """A_(i-1)i of eq. (3) of joints with these active coordinates, and its derivatives, 4x4 each.

    first: by coordinate.  second: by pair in order, zeros among them.  lemmas: why a second derivative vanishes.
    """

    active: tuple[str, ...]
    transform: Matrix
    first: Mapping[str, Matrix]
    second: Mapping[tuple[str, str], Matrix]
    lemmas: Mapping[tuple[str, str], str]

    def values(self, at: Sequence[tuple[Any, Any]]) -> Flat:
        """Return entries by rows of the transform, of first and of second derivatives.

        Args:
            at: per active coordinate (0, position) of a translation, (sine, cosine) of an angle, of any exact kind.
        """
        entries: Flat = _evaluator(self.active)(*(number for pair in at for number in pair))
        return entries


def derive_blocks(*models: Model, kept: Facts = KEPT) -> dict[tuple[str, ...], Blocks]:
    """Derive the blocks of all kinds of joints of a robot's models, by their active coordinates, after every proof.

    Raises:
        DerivationError: a proof fails, or what is kept is not what is derived.
    """
    try:
        _compare(models[0], derived_facts(), kept)
    except DerivationError:
        raise
    except InternalError as error:
        raise DerivationError(str(error), joint="", block="lemmas", place="") from None
    kinds: dict[tuple[str, ...], str] = {}
    for body in (body for model in models for body in model.bodies):
        kinds.setdefault(body.active, body.joint)
    return {active: _blocks(joint, active, kept) for active, joint in kinds.items()}


def _blocks(joint: str, active: tuple[str, ...], kept: Facts) -> Blocks:
    A, derivatives = joint_transform(active), joint_derivatives(active)
    turns = [_rotation(name, kept.steps[name]) for name in active if kept.steps[name].is_rotation]
    residue = (A[:3, :3] - reduce(matmul, turns, sp.eye(3))).expand()
    for i, j in product(range(3), repeat=2):
        if residue[i, j] != 0:
            raise _differs(joint, "A_(i-1)i", f"row {i + 1}, column {j + 1}", f"{A[i, j]} is derived, more is kept")
    why = {(pair.first, pair.second): pair.reason for pair in kept.zero_pairs if pair.same_joint}
    second = {pair: derivatives.second[pair] for pair in combinations_with_replacement(active, 2)}
    for pair, D in second.items():
        if bool(D.is_zero_matrix) != (pair in why):
            raise _differs(joint, "d2A_(i-1)i", ", ".join(pair), "derived and kept do not agree whether it vanishes")
    lemmas = {pair: why[pair] for pair, D in second.items() if D.is_zero_matrix}
    return Blocks(active, A, derivatives.first, second, lemmas)


def _rotation(name: str, kept: FrozenStep) -> Matrix:
    s = step(name).symbol
    rows = [[one + by_sin * sp.sin(s) + by_cos * sp.cos(s) for one, by_sin, by_cos in row] for row in kept.rotation]
    return sp.Matrix(rows).applyfunc(lambda entry: sp.nsimplify(entry, rational=True))


def _compare(model: Model, derived: Facts, kept: Facts) -> None:
    """Raise DerivationError at the first fact that differs."""
    for name, frozen in derived.steps.items():
        held = kept.steps.get(name)
        if held != frozen:
            raise _differs(_joint_with(model, name), f"step of {name}", _place(frozen, held), "derived and kept differ")
    facts: tuple[tuple[str, Callable[[Facts], Sequence[Any]]], ...] = (
        ("zeros of second derivatives", lambda x: x.zero_pairs),
        ("orthogonal translations", lambda x: x.orthogonal),
        ("coaxial pairs", lambda x: x.coaxial),
    )
    for block, pairs in facts:
        ours, theirs = set(pairs(derived)), set(pairs(kept))
        for others, said in ((ours - theirs, "is derived and not kept"), (theirs - ours, "is kept and not derived")):
            for pair in sorted(others, key=str):
                is_zero = isinstance(pair, ZeroPair)
                names = (pair.first, pair.second) if is_zero else pair
                place = f"{', '.join(names)}{f' ({pair.reason})' if is_zero else ''}"
                raise _differs(_joint_with(model, *names), block, place, said)


def _place(derived: FrozenStep, kept: FrozenStep | None) -> str:
    """Say where two steps differ."""
    if kept is None:
        return "all of it"
    for i, j in product(range(3), repeat=2):
        if derived.rotation[i][j] != kept.rotation[i][j]:
            return f"row {i + 1}, column {j + 1}"
    return "axis" if derived.is_rotation == kept.is_rotation else "kind"


def _joint_with(model: Model, *names: str) -> str:
    """Name the first joint with these coordinates; with one of them; "" where there is none."""
    for enough in (all, any):
        for body in model.bodies:
            if enough(name in body.active for name in names):
                return body.joint
    return ""


def _differs(joint: str, block: str, place: str, said: str) -> DerivationError:
    where = ", ".join(text for text in (joint, block, place) if text)
    return DerivationError(f"{where}: {said}; please report it", joint=joint, block=block, place=place)


@cache
def _evaluator(active: tuple[str, ...]) -> Callable[..., Flat]:
    """Return the entries of a kind of joint as a function of pairs of numbers; only sums and products of integers."""
    swap: dict[Any, Any] = {}
    arguments: list[Any] = []
    for name in active:
        one = step(name)
        pair = sp.symbols(f"sin_{name} cos_{name}")
        arguments += pair
        swap |= {sp.sin(one.symbol): pair[0], sp.cos(one.symbol): pair[1]} if one.is_rotation else {one.symbol: pair[1]}
    derivatives, pairs = joint_derivatives(active), combinations_with_replacement(active, 2)
    matrices = (
        joint_transform(active),
        [derivatives.first[name] for name in active],
        [derivatives.second[pair] for pair in pairs],
    )
    texts = [
        list(matrices[0].xreplace(swap)),
        *([list(D.xreplace(swap)) for D in group] for group in matrices[1:]),
    ]
    evaluate: Callable[..., Flat] = sp.lambdify(arguments, texts, modules=[{}], cse=True)
    return evaluate
