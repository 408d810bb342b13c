"""Bushings between frames of two links: numbers and texts; ``codegen.forces.bushings`` has their forces."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import ClassVar

from ...limits import LARGEST
from ..geometry import ANGULAR, COORDINATES, Placement, Vector
from ..numbers import DAMPING, STIFFNESS, Conflict, Number, by_key
from .element import LinkElement, Slopes
from .joint_damping import FREQUENCY, SHARES, JointDamping, lag_of
from .joint_element import MatrixElement, missing_table
from .joint_stiffness import JointStiffness

_UNITS = {"stiffness": STIFFNESS, "damping": DAMPING}
_MATRICES: Mapping[str, type[MatrixElement]] = MappingProxyType({x.TABLE: x for x in (JointStiffness, JointDamping)})


def _numbers() -> Iterator[Number]:
    """Yield the numbers of both forms of stiffness and damping, six numbers and a matrix."""
    for key, units in _UNITS.items():
        for name in COORDINATES:
            yield Number(f"{key}.{name}", f"{key} along {name}", (units[name in ANGULAR],))
    for key, kind in _MATRICES.items():
        for number in kind.NUMBERS.values():
            if number.key not in ("linear", "angular"):
                yield Number(f"{key}.{number.key}", number.about, number.unit, number.least)


@dataclass(frozen=True)
class Bushing(LinkElement):
    """A spring and damper of six coordinates between a frame on one link and a frame on another.

    placements: the frames, in link frames.  The second frame, seen from the first, is T(x, y, z) Rx(alpha) Ry(beta)
    Rz(gamma), eq. (3), and each of these six coordinates is resisted by its ``stiffness`` (N/m, N m/rad) times itself
    and its ``damping`` (N s/m, N m s/rad) times its velocity, (6,) each, None for none; or by matrices between them, a
    ``JointStiffness`` and a ``JointDamping``.  A number that is 0 has no force and no term in any equation; angles
    have a pole at beta = +-90 degrees.
    """

    placements: tuple[Placement, Placement] = (Placement(), Placement())
    stiffness: tuple[float, ...] | JointStiffness | None = None
    damping: tuple[float, ...] | JointDamping | None = None

    TABLE: ClassVar[str] = "bushings"
    TITLE: ClassVar[str] = "springs and dampers of six coordinates between frames of two links"
    SHORT: ClassVar[str] = "bushings"
    KIND: ClassVar[str] = "bushing"
    NUMBERS: ClassVar[Mapping[str, Number]] = by_key(*_numbers())
    ABOUT: ClassVar[Mapping[str, str]] = MappingProxyType(
        {
            "placements": "the frames that it joins, on both links; default their frames",
            "stiffness": "along x, y, z and about alpha, beta, gamma of the second frame as seen from the first",
            "damping": "along x, y, z and about alpha, beta, gamma of the second frame as seen from the first",
        }
    )
    ALWAYS: ClassVar[tuple[str, ...]] = tuple(
        key for key in NUMBERS if key.partition(".")[2] not in (*SHARES, FREQUENCY)
    )

    @property
    def matrices(self) -> dict[str, MatrixElement]:
        """Matrices by their keys."""
        both = {"stiffness": self.stiffness, "damping": self.damping}
        return {key: value for key, value in both.items() if isinstance(value, MatrixElement)}

    @property
    def optional(self) -> tuple[str, ...]:
        """All numbers of the forms that it has: a parameter may stand for one that is 0."""
        names = list[str]()
        for key in _UNITS:
            matrix = self.matrices.get(key)
            below = COORDINATES if matrix is None else [name for name, _ in matrix.numbers(COORDINATES)]
            names += [f"{key}.{name}" for name in below]
        return tuple(names)

    def law(self) -> dict[str, float]:
        """Return the numbers that are not 0, by their names: "stiffness.x", of a matrix "stiffness.x.beta"."""
        numbers: dict[str, float] = {}
        for key in _UNITS:
            value, matrix = getattr(self, key), self.matrices.get(key)
            pairs = zip(COORDINATES, value or (), strict=False) if matrix is None else matrix.law().items()
            numbers |= {f"{key}.{name}": x for name, x in pairs if x}
        return numbers

    def ends(self) -> dict[str, Vector | Placement]:
        """Return its frames."""
        return {f"placements.{i}": placement for i, placement in enumerate(self.placements)}

    def conflict(self) -> Conflict | None:
        """Return the key and the message of a number that is not allowed; None if all are."""
        for key in _UNITS:
            conflict = self._matrix_conflict(key) if key in self.matrices else self._diagonal_conflict(key)
            if conflict is not None:
                return conflict
        return None if self.law() else ("", "it has no force; allowed: with a stiffness or damping above 0")

    def _diagonal_conflict(self, key: str) -> Conflict | None:
        values = getattr(self, key)
        if values is not None and len(values) != len(COORDINATES):
            return key, f"got {len(values)} numbers; allowed: six, for {', '.join(COORDINATES)}"
        for name, x in zip(COORDINATES, values or (), strict=False):
            if not (math.isfinite(x) and 0.0 <= x <= LARGEST):
                return key, f"{name}: got {x!r}; allowed: a finite number that is at least 0"
        return None

    def _matrix_conflict(self, key: str) -> Conflict | None:
        matrix = self.matrices[key]
        if isinstance(matrix, JointDamping) and (matrix.linear, matrix.angular) != (None, None):
            return key, "it is isotropic; allowed: six numbers, a matrix, ratio or loss_factor"
        conflict = matrix.conflict(dict.fromkeys(COORDINATES)) or missing_table(self.matrices, key)
        return conflict and (".".join(filter(None, (key, conflict[0]))), conflict[1])

    @classmethod
    def slopes(cls, numbers: Mapping[str, float]) -> Slopes:
        """Return stiffness and damping along each coordinate that has a number."""
        paths = {key: key.split(".") for key in numbers}
        known = {name for path in paths.values() for name in path[1:] if name in COORDINATES}
        slopes: Slopes = {}
        lag = lag_of({path[-1]: numbers[key] for key, path in paths.items()})
        for name in (x for x in COORDINATES if x in known):
            matrix = numbers.get(f"stiffness.{name}.{name}", 0.0)
            k, c = (numbers.get(f"{key}.{name}", 0.0) for key in _UNITS)
            slopes[name] = k + matrix, c + numbers.get(f"damping.{name}.{name}", 0.0) + lag * matrix
        return slopes

    @property
    def said(self) -> dict[str, float]:
        """Numbers that its line has: six of a form, none of matrices."""
        return {key: number for key, number in self.law().items() if key.partition(".")[0] not in self.matrices}

    def lines(self) -> list[str]:
        """Return its line, and its matrices row by row."""
        return [self.line(), *(f"  {line}" for key, matrix in self.matrices.items() for line in matrix.lines(key))]

    def mujoco_lacks(self) -> Iterator[str]:
        """Yield all of it: MuJoCo connects two frames by constraints alone."""
        yield ": left out"
