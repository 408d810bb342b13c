"""Stiffness matrices of joints: springs that couple the coordinates of one joint."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, ClassVar

from ..fields import Picklable
from ..geometry import COORDINATES, Placement
from ..numbers import Conflict, Number, by_key
from .joint_element import MatrixElement
from .matrices import (
    ABOUT,
    PAIRS,
    Rows,
    carried,
    carried_forces,
    couples,
    entries_among,
    entries_of,
    entry_name,
    entry_numbers,
    matrix_conflict,
    matrix_of,
    names_of,
    ordered,
    preload_numbers,
)
from .stiffness_center import principal_line

JOINT_STIFFNESS = "stiffness"  # a joint's table of the stiffness between its coordinates


@dataclass(frozen=True)
class JointStiffness(Picklable, MatrixElement):
    """Springs between a joint's coordinates s: K s + preload resists them, beside the springs of single coordinates.

    entries: of K on and above the diagonal, by names, "x.beta"; those that are not there are 0.  Units are N/m of two
    translations, N/rad of a translation and an angle, N m/rad of two angles.
    preload: constant forces, N or N m, by coordinate.
    """

    entries: Mapping[str, float] = field(default_factory=dict, hash=False)
    preload: Mapping[str, float] = field(default_factory=dict, hash=False)

    TABLE: ClassVar[str] = JOINT_STIFFNESS
    FAMILIES: ClassVar[Mapping[str, str]] = MappingProxyType({"joints": "joint_stiffness", "loops": "cut_stiffness"})
    NUMBERS: ClassVar[Mapping[str, Number]] = by_key(
        *entry_numbers("stiffness matrix", ("/m", "/rad")), *preload_numbers()
    )
    ABOUT: ClassVar[Mapping[str, str]] = MappingProxyType(
        {
            "joints": "stiffness matrix between the joint's coordinates, beside the springs of single ones",
            "frames": "by a matrix between the six coordinates",
            "loops": "stiffness matrix between the loop joint's coordinates that have tables, beside their springs",
            **ABOUT,
        }
    )
    UNITS: ClassVar[tuple[str, str]] = ("N/m, N/rad, N m/rad", "")
    ROLE: ClassVar[str] = "joint's stiffness"
    BEYOND: ClassVar[str] = "springs of coordinates, none between them"

    def __post_init__(self) -> None:
        object.__setattr__(self, "entries", ordered(self.entries))
        forces = {x: self.preload[x] for x in dict.fromkeys((*COORDINATES, *self.preload)) if self.preload.get(x)}
        object.__setattr__(self, "preload", MappingProxyType(forces))

    @classmethod
    def of(
        cls,
        matrix: Rows,
        coordinates: Sequence[str] = COORDINATES,
        at: Placement | None = None,
        preload: Sequence[float] | None = None,
    ) -> JointStiffness:
        """Make it of a matrix.

        Args:
            matrix: (n, n), N/m, N/rad, N m/rad; ``coordinates`` and ``at`` as of ``MatrixElement.of``.
            preload: constant forces, (n,), N or N m, none where it is None; what they add to the stiffness where they
                act at another point is left out.
        """
        forces = [0.0] * len(coordinates) if preload is None else list(preload)
        if at is not None:
            matrix, forces = carried(matrix, at), carried_forces(forces, at)
        return cls(entries_of(matrix, coordinates), dict(zip(coordinates, forces, strict=True)))

    @property
    def held(self) -> tuple[str, ...]:
        """Coordinates that have a stiffness."""
        return tuple(name for name in COORDINATES if self.entries.get(entry_name(name, name)))

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Coordinates that its matrix or preload acts on."""
        return tuple(name for name in COORDINATES if name in names_of(self.entries) or name in self.preload)

    def law(self) -> dict[str, float]:
        """Return the numbers that are not 0, by their names: "x.beta", "preload.x"."""
        return {**self.entries, **{f"preload.{name}": force for name, force in self.preload.items()}}

    def numbers(self, active: Sequence[str]) -> Iterator[tuple[str, float | None]]:
        """Yield all entries and preloads of the coordinates; a parameter may stand for one that is 0."""
        law = self.law()
        for key in [entry_name(*pair) for pair in PAIRS if set(pair) <= set(active)]:
            yield key, law.get(key)
        yield from ((f"preload.{name}", self.preload.get(name)) for name in COORDINATES if name in active)

    def conflict(self, active: Mapping[str, Any]) -> Conflict | None:
        """Return the key ("" for the table) and the message of what is wrong with it in a joint; None if nothing is."""
        if not self.law():
            return "", "it has no number that is not 0; allowed: with one, or no table"
        unknown = next((key for key in self.law() if key not in self.NUMBERS), None)
        if unknown is not None:
            return unknown, f"there is no such entry; allowed: {', '.join(self.NUMBERS)}"
        for name in self.coordinates:
            if name not in active:
                return "", f"{name} does not move; allowed: entries of {', '.join(active)}"
        names = tuple(name for name in COORDINATES if name in active)
        wrong = matrix_conflict(matrix_of(self.entries, names), names)
        if wrong is not None:
            return wrong
        for name, force in self.preload.items():
            if not abs(force) < float("inf"):
                return f"preload.{name}", f"got {force!r}; allowed: a finite number"
        return None

    def left_with(self, active: Mapping[str, Any]) -> JointStiffness | None:
        """Return the rows and columns of what still moves; None if nothing is left."""
        kept = {name: force for name, force in self.preload.items() if name in active}
        left = JointStiffness(entries_among(self.entries, tuple(active)), kept)
        return left if left.law() else None

    def lines(self, label: str) -> list[str]:
        """Return the matrix row by row, and its principal stiffnesses."""
        return [*super().lines(label), f"  {principal_line(self.entries)}"]

    def mujoco_lacks(self) -> Iterator[str]:
        """Yield what is beside the diagonal: MuJoCo's springs act on single coordinates."""
        if couples(self.entries):
            yield ": its diagonal alone (springs of MuJoCo act on single coordinates)"
