"""Shape functions of a beam along which a joint slides, as functions of where it is: a load that moves along a beam.

A coordinate of the place on the axis where the joint is, at s from the root, is p_k(s) e_k + 1/2 b_kj(s) e_k e_j, with
modal coordinates e.  All of these are polynomials, as series of P. L. Chebyshev's T_i(2 s / length - 1), which keep
their digits.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from ..fields import Picklable

Series = tuple[float, ...]  # coefficients of T_0, T_1, ...


@dataclass(frozen=True)
class SlidingShapes(Picklable):
    """Functions of a place on a beam by which one coordinate of that follows modes.

    by: name of the coordinate s, m from the root.  length: of the beam, m.  first: p_k by names of modes, m or rad.
    second: b_kj by pairs of names, each pair once.  slopes: by directions of bending, c and s_k by names: the
    derivative of b_kj by the place is c s_k s_j.
    """

    by: str
    length: float
    first: tuple[tuple[str, Series], ...]
    second: tuple[tuple[str, str, Series], ...] = ()
    slopes: tuple[tuple[float, tuple[tuple[str, Series], ...]], ...] = ()

    def __post_init__(self) -> None:
        if self.second and not self.slopes:
            raise ValueError("second: there are no slopes, of whose products these are integrals")

    @property
    def modes(self) -> tuple[str, ...]:
        """Names of the modes, each once."""
        names = [name for name, _ in self.first] + [name for pair in self.second for name in pair[:2]]
        return tuple(dict.fromkeys(names))

    @property
    def products(self) -> tuple[tuple[str, str], ...]:
        """Pairs of coordinates by which the second derivative does not vanish."""
        return ((self.by, self.by), *((self.by, name) for name in self.modes), *(pair[:2] for pair in self.second))

    @property
    def degree(self) -> int:
        """The highest degree of the polynomials."""
        slopes = (item for _, group in self.slopes for item in group)
        return max((len(series) - 1 for *_, series in (*self.first, *self.second, *slopes)), default=0)

    def value(self, of: Callable[[str], Any]) -> Any:
        """Return what the coordinate has to be; ``of`` gives a coordinate by its name, a number or an array."""
        T = chebyshev(2.0 / self.length * of(self.by) - 1.0, self.degree)
        value: Any = 0.0
        for name, series in self.first:
            value = value + combined(series, T) * of(name)
        for name, other, series in self.second:
            value = value + (0.5 if name == other else 1.0) * combined(series, T) * of(name) * of(other)
        return value


def chebyshev(x: Any, degree: int) -> list[Any]:
    """Return T_0 ... T_degree at x, a number, an array or a node of a program."""
    T: list[Any] = [1.0, x]
    twice = 2.0 * x
    while len(T) <= degree:
        T.append(twice * T[-1] - T[-2])
    return T[: degree + 1]


def combined(series: Sequence[float], T: Sequence[Any]) -> Any:
    """Return the value of a series, of the polynomials' values."""
    value: Any = 0.0
    for coefficient, polynomial in zip(series, T, strict=False):
        if coefficient != 0.0:
            value = value + coefficient * polynomial
    return value


def derivative(series: Sequence[float]) -> Series:
    """Return the series of the derivative by the polynomials' argument."""
    slopes = [0.0] * (len(series) + 1)
    for i in range(len(series) - 1, 0, -1):
        slopes[i - 1] = slopes[i + 1] + 2.0 * i * series[i]
    slopes[0] *= 0.5
    return tuple(slopes[: max(len(series) - 1, 1)])
