"""Facts about one joint as plain values: steps of eq. (3), and the pairs of coordinates that the lemmas name.

``freezing`` takes them from SymPy's expressions and proofs, ``kept`` holds them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from eomgen.robot.value import LINEAR

LEMMA_7 = "lemma (7): two translations"
SHARPER = "sharper lemma: nothing downstream turns a translation"


@dataclass(frozen=True)
class FrozenStep:
    """An elementary transform of eq. (3): along or about ``axis``; rotation[i][j] = (1, sine, cosine) factors."""

    is_rotation: bool
    axis: int
    rotation: tuple[tuple[tuple[float, float, float], ...], ...]


@dataclass(frozen=True)
class ZeroPair:
    """A pair of coordinates whose second derivative of A_0k is proved to vanish identically.

    Both coordinates belong to one joint (``same_joint``), or ``first`` to a joint upstream of that of ``second``.
    """

    first: str
    second: str
    same_joint: bool
    reason: str


def lemma_of(first: str, second: str) -> str:
    """Name the lemma about a pair of coordinates."""
    return LEMMA_7 if first in LINEAR and second in LINEAR else SHARPER


@dataclass(frozen=True)
class Facts:
    """All that the generator takes from a joint.

    steps: by coordinate, "x" ... "gamma".
    zero_pairs: of ``prove_second_derivative_zeros``.
    orthogonal: pairs of translations of ``prove_translations_orthogonal``.
    coaxial: pairs of a translation and a rotation of ``prove_coaxial``.
    """

    steps: Mapping[str, FrozenStep]
    zero_pairs: tuple[ZeroPair, ...]
    orthogonal: tuple[tuple[str, str], ...]
    coaxial: tuple[tuple[str, str], ...]
