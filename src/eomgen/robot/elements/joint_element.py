"""Force elements of joints as wholes apart from their formulas: numbers, their units and ranges, texts."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from ..geometry import COORDINATES, Placement
from ..laws import number_texts
from ..numbers import Conflict, Number
from .matrices import Rows, matrix_lines, names_of


@dataclass(frozen=True)
class JointElement(ABC):
    """A force element of a joint, beside the forces of its coordinates.

    Its fields are the keys of its table in the joint's; a field that is a record has a separate table.

    Attributes:
        TABLE: key of the joint's table, and field of ``Joint`` and ``Loop``.
        FAMILIES: names of its numbers' families in kernels, by their owners: "joints", and "loops" of loop joints.
        NUMBERS: its numbers, by their names below the table.
        ABOUT: a line about the table by "joints" and "loops", and about each table in it.
        UNITS: of its table, and where there is none of a coordinate in reports.
        ROLE: its name in reports.
        BEYOND: what textbook algorithms have in its place.
    """

    TABLE: ClassVar[str]
    FAMILIES: ClassVar[Mapping[str, str]]
    NUMBERS: ClassVar[Mapping[str, Number]]
    ABOUT: ClassVar[Mapping[str, str]]
    UNITS: ClassVar[tuple[str, str]] = ("", "")
    ROLE: ClassVar[str]
    BEYOND: ClassVar[str]

    def law(self) -> dict[str, float]:
        """Return the numbers that are set, by their names: "clearance", "friction.coefficient"."""
        paths = {key: key.rpartition(".") for key in self.NUMBERS}
        numbers = {key: getattr(getattr(self, x) if x else self, name, None) for key, (x, _, name) in paths.items()}
        return {key: value for key, value in numbers.items() if value is not None}

    def numbers(self, active: Sequence[str]) -> Iterator[tuple[str, float | None]]:
        """Yield all numbers that may be parameters, by their names; None where one is not set.

        Args:
            active: the joint's coordinates.
        """
        yield from self.law().items()

    @property
    def felt(self) -> tuple[str, ...]:
        """Coordinates of the joint on which it depends, as far as a loop joint has to know."""
        return ()

    @property
    def held(self) -> tuple[str, ...]:
        """Coordinates of the joint that it holds as springs do."""
        return ()

    @property
    def is_isotropic(self) -> bool:
        """Whether it is the same whatever angles describe the joint."""
        return False

    @property
    def needs(self) -> tuple[str, ...]:
        """Tables of the joint that it needs beside its own."""
        return ()

    def lines(self, label: str) -> list[str]:
        """Return lines about it, for people; ``label``: the name of its table."""
        return [f"{label}: {', '.join(number_texts(self.law()))}"]

    @abstractmethod
    def conflict(self, active: Mapping[str, Any]) -> Conflict | None:
        """Return the key ("" for the table) and the message of what is wrong with it in a joint; None if nothing is.

        Args:
            active: the joint's coordinates.
        """

    @abstractmethod
    def left_with(self, active: Mapping[str, Any]) -> JointElement | None:
        """Return what is left of it where only these coordinates move; None if that is nothing."""

    def mujoco_lacks(self) -> Iterator[str]:
        """Yield what a MuJoCo model leaves out or has otherwise, each behind its key: ".smoothing: left out"."""
        yield from ()


class MatrixElement(JointElement):
    """An element that may have a symmetric matrix, whose entries are numbers with the names of two coordinates.

    entries: on and above the diagonal that are not 0, by names, "x.beta".
    """

    entries: Mapping[str, float]

    @classmethod
    @abstractmethod
    def of(cls, matrix: Rows, coordinates: Sequence[str] = COORDINATES, at: Placement | None = None) -> MatrixElement:
        """Make it of a matrix, (n, n).

        Args:
            matrix: its rows.
            coordinates: of its rows, (n,).
            at: frame in the joint's in which six rows were given; carried to the joint's origin by A^T K A, which is
                right for small deviations.
        """

    @property
    @abstractmethod
    def coordinates(self) -> tuple[str, ...]:
        """Coordinates that its matrix acts on."""

    @property
    def felt(self) -> tuple[str, ...]:
        """Coordinates that its matrix acts on."""
        return self.coordinates

    def lines(self, label: str) -> list[str]:
        """Return lines about it, the matrix row by row."""
        others = {key: number for key, number in self.law().items() if key not in self.entries}
        first = f"{label}: {', '.join(number_texts(others))}" if others or not self.entries else f"{label}:"
        return [first, *(matrix_lines(self.entries, names_of(self.entries)) if self.entries else [])]


def missing_table(elements: Mapping[str, JointElement], table: str) -> Conflict | None:
    """Return the key and the message of what an element needs beside it that is not there; None if all is."""
    for needed in elements[table].needs:
        if needed not in elements:
            return "", f"the joint has no table {needed}; allowed: with {needed} = {{ matrix = ... }}"
    return None


def elements_left(elements: Mapping[str, JointElement], active: Mapping[str, Any]) -> dict[str, JointElement | None]:
    """Return what is left of a joint's elements where only these coordinates move, by their tables."""
    left = {table: element.left_with(active) for table, element in elements.items()}
    kept = {table: element for table, element in left.items() if element is not None}
    gone = [table for table in kept if missing_table(kept, table) is not None]
    return left | dict.fromkeys(gone)
