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
