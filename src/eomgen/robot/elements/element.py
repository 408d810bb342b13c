"""Force elements between two links apart from their formulas: numbers, their units and ranges, texts.

Each kind has a file here; its formulas are in the file of that name in ``codegen.forces``.  Readers, schemas, names of
parameters, models, kernels' packages, exports and figures go by these classes, and name no kind.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import ClassVar

from ..geometry import Placement, Vector
from ..laws import number_texts
from ..numbers import Number

Slopes = dict[str, tuple[float, float]]  # stiffness and damping along coordinates, by their names


@dataclass(frozen=True)
class LinkElement(ABC):
    """A force element between two links, either of which may be the base.

    A field behind these is a key of the element's table; one of six numbers is None without the key.

    Attributes:
        TABLE: key of descriptions that lists the elements, with which names of their parameters begin.
        TITLE: a title, in the plural.
        SHORT: the same in two or three words.
        KIND: word for one.
        NUMBERS: its numbers, by their names below the element's; one for all points of a curve.
        ABOUT: a line about each field whose numbers have none.
        ALWAYS: names of the numbers that its formulas need; default 0.
    """

    name: str
    links: tuple[str, str]

    TABLE: ClassVar[str]
    TITLE: ClassVar[str]
    SHORT: ClassVar[str]
    KIND: ClassVar[str]
    NUMBERS: ClassVar[Mapping[str, Number]]
    ABOUT: ClassVar[Mapping[str, str]]
    ALWAYS: ClassVar[tuple[str, ...]]

    @property
    def prefix(self) -> str:
        """The beginning of its numbers' names: "springs.coil"."""
        return f"{self.TABLE}.{self.name}"

    @abstractmethod
    def law(self) -> dict[str, float]:
        """Return the numbers that are run-time parameters, by their names below the element's."""

    @abstractmethod
    def ends(self) -> dict[str, Vector | Placement]:
        """Return its ends on both links, in their frames, by the names of these numbers."""

    @property
    @abstractmethod
    def optional(self) -> tuple[str, ...]:
        """Names of the numbers that a parameter may set where the description does not; they are 0 then."""

    @abstractmethod
    def conflict(self) -> tuple[str, str] | None:
        """Return the key ("" for the table) and the message of the first conflict; None if there is none."""

    @classmethod
    @abstractmethod
    def slopes(cls, numbers: Mapping[str, float]) -> Slopes:
        """Return the largest stiffness and damping (N/m, N m/rad, and times s) along the coordinates of its forces.

        Args:
            numbers: its numbers that are run-time parameters, as they are now, by their names below the element's.

        Returns:
            Both by the coordinates' names, in their order; none where other kernels than ``element_forces`` have it.
        """

    @abstractmethod
    def mujoco_lacks(self) -> Iterator[str]:
        """Yield what a MuJoCo model leaves out or has otherwise, each behind its key: ".curve: left out"."""

    def numbers(self) -> Iterator[tuple[str, float | None]]:
        """Yield all numbers that may be parameters, by their names below the element's; None where one is not set."""
        law = self.law()
        yield from ((key, law.get(key)) for key in dict.fromkeys((*self.optional, *law)))
        for name, end in self.ends().items():
            values = end.numbers() if isinstance(end, Placement) else zip("xyz", end, strict=True)
            yield from ((f"{name}.{key}", value) for key, value in values)

    def origins(self) -> list[Vector]:
        """Return its ends in the links' frames, m."""
        return [end.xyz if isinstance(end, Placement) else end for end in self.ends().values()]

    def knots(self) -> tuple[float, ...]:
        """Return the elongations (m) of its curve; () without one."""
        return ()

    def as_dict(self) -> dict[str, object]:
        """Return its forces as the description has them, for JSON."""
        return {"name": self.name, "links": list(self.links), **self.law()}

    @property
    def said(self) -> dict[str, float]:
        """Numbers that its line has, of ``law``."""
        return self.law()

    def line(self) -> str:
        """Return a line with its kind, its links and its numbers."""
        texts = ", ".join(number_texts(self.said))
        return f"{self.kind} {self.name} from {self.links[0]} to {self.links[1]}" + (f": {texts}" if texts else "")

    def lines(self) -> list[str]:
        """Return its line, and those about what has several."""
        return [self.line()]

    @property
    def kind(self) -> str:
        """Word for this one."""
        return self.KIND
