"""Force elements of joints as wholes apart from their formulas: numbers, their units and ranges, texts."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from ..laws import Conflict, Number


@dataclass(frozen=True)
class JointElement(ABC):
    """A force element of a joint, beside the forces of its coordinates.

    Its fields are the keys of its table in the joint's; a field that is a record has a table of its own.

    Attributes:
        TABLE: key of the joint's table, and field of ``Joint`` and ``Loop``.
        FAMILIES: names of its numbers' families in kernels, by what may have it: "joints", and "loops" of cut joints.
        NUMBERS: its numbers, by their names below the table.
        ABOUT: a line about the table by "joints" and "loops", and about each table in it.
        UNITS: of its table, and where there is none of a coordinate in reports.
        ROLE: what it is in reports.
        BEYOND: what the textbook's algorithms have in its place.
    """

    TABLE: ClassVar[str]
    FAMILIES: ClassVar[Mapping[str, str]]
    NUMBERS: ClassVar[Mapping[str, Number]]
    ABOUT: ClassVar[Mapping[str, str]]
    UNITS: ClassVar[tuple[str, str]] = ("", "")
    ROLE: ClassVar[str]
    BEYOND: ClassVar[str]

    def law(self) -> dict[str, float]:
        """Give the numbers that are given, by their names: "clearance", "friction.coefficient"."""
        paths = {key: key.rpartition(".") for key in self.NUMBERS}
        given = {key: getattr(getattr(self, x) if x else self, name, None) for key, (x, _, name) in paths.items()}
        return {key: value for key, value in given.items() if value is not None}

    @abstractmethod
    def conflict(self, active: Mapping[str, Any]) -> Conflict | None:
        """Give the key ("" for the table) and the message of what is wrong with it in a joint; None if nothing is.

        Args:
            active: the joint's coordinates.
        """

    @abstractmethod
    def left_with(self, active: Mapping[str, Any]) -> JointElement | None:
        """Give what is left of it where only these coordinates move; None if that is nothing."""

    def mujoco_lacks(self) -> Iterator[str]:
        """Give what a model of MuJoCo leaves out or has otherwise, each behind its key: ".smoothing: left out"."""
        yield from ()
