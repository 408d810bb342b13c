"""Cross-sections of beams: area, second moments, torsion constant and shear coefficients from their dimensions.

A section has axes y and z through its centroid, x along the beam.  Shear coefficients are those of G. R. Cowper, "The
Shear Coefficient in Timoshenko's Beam Theory", Journal of Applied Mechanics 33 (1966) 335-340; across the web of an
I-beam its flanges count, as rectangles.  Torsion constants are de Saint-Venant's of rounds, rectangles and open thin
walls, and R. Bredt's of a closed thin wall (VDI-Zeitschrift 40, 1896): sections warp freely.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

from .geometry import IDENTITY, Matrix

# columns: the axes of the section, x along the beam; y and z follow cyclically, and the other way round z is kept
AXES: Mapping[str, Matrix] = MappingProxyType(
    {
        "x": IDENTITY,
        "y": ((0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)),
        "z": ((0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (1.0, 0.0, 0.0)),
        "-x": ((-1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, 1.0)),
        "-y": ((0.0, 0.0, 1.0), (-1.0, 0.0, 0.0), (0.0, -1.0, 0.0)),
        "-z": ((0.0, -1.0, 0.0), (0.0, 0.0, 1.0), (-1.0, 0.0, 0.0)),
    }
)
POISSON = (-1.0, 0.5)  # ratios that an isotropic material may have
_TERMS = 40  # of the series of a rectangle's torsion, whose terms fall as n^-5: far below round-off


@dataclass(frozen=True)
class Section:
    """A section's area A (m^2), second moments Iy and Iz about its axes (m^4), torsion constant J (m^4), and shear
    coefficients along y and z; () where Poisson's ratio is not one of an isotropic material.  form: its kind and
    dimensions, where A, Iy, Iz and J are all those of one."""

    A: float
    Iy: float
    Iz: float
    J: float
    shear: tuple[float, ...]
    form: tuple[str, tuple[float, ...]] | None = None


@dataclass(frozen=True)
class Shape:
    """A kind of section: a line about it, names of its dimensions, what they have to fulfil, and its formulas.

    rule: the message of ``fits``.  fits and section take the dimensions, m; section Poisson's ratio, too, which is None
    where no shear coefficients are wanted.
    """

    about: str
    names: tuple[str, ...]
    rule: str
    fits: Callable[[Sequence[float]], bool]
    section: Callable[[Sequence[float], float | None], Section]


def _round(sizes: Sequence[float], nu: float | None) -> Section:
    """Return the section of a tube, outer and inner diameter, or of a rod, its diameter."""
    outer, inner = sizes if len(sizes) > 1 else (sizes[0], 0.0)
    A, second = math.pi / 4.0 * (outer**2 - inner**2), math.pi / 64.0 * (outer**4 - inner**4)
    shear: tuple[float, ...] = ()
    if nu is not None:
        ratio = (inner / outer) ** 2
        square = (1.0 + ratio) ** 2
        shear = 2 * (6.0 * (1.0 + nu) * square / ((7.0 + 6.0 * nu) * square + (20.0 + 12.0 * nu) * ratio),)
    return Section(A, second, second, 2.0 * second, shear)


def _bar(sizes: Sequence[float], nu: float | None) -> Section:
    """Return the section of a solid rectangle: height along z, width along y."""
    height, width = sizes
    long, short = max(sizes), min(sizes)
    odd = range(1, 2 * _TERMS, 2)
    series = sum(math.tanh(n * math.pi / 2.0 * (long / short)) / n**5 for n in odd)
    J = long * short**3 * (1.0 / 3.0 - 64.0 / math.pi**5 * (short / long) * series)
    shear = () if nu is None else (_rectangle(nu), _rectangle(nu))
    return Section(height * width, width * height**3 / 12.0, height * width**3 / 12.0, J, shear)


def _box(sizes: Sequence[float], nu: float | None) -> Section:
    """Return the section of a rectangular tube: outer height along z, outer width along y, wall thickness."""
    height, width, wall = sizes
    h, w = height - 2.0 * wall, width - 2.0 * wall  # of the hole
    high, wide = height - wall, width - wall  # of the wall's middle
    J = 2.0 * wall * (high * wide) ** 2 / (high + wide)
    shear = () if nu is None else (_box_shear(nu, high / wide), _box_shear(nu, wide / high))
    Iy, Iz = (width * height**3 - w * h**3) / 12.0, (height * width**3 - h * w**3) / 12.0
    return Section(height * width - h * w, Iy, Iz, J, shear)


def _beam(sizes: Sequence[float], nu: float | None) -> Section:
    """Return the section of an I-beam: height along z, width of the flanges along y, their and the web's thickness."""
    height, width, flange, web = sizes
    inner = height - 2.0 * flange
    A = 2.0 * width * flange + inner * web
    Iy = (width * height**3 - (width - web) * inner**3) / 12.0
    Iz = (2.0 * flange * width**3 + inner * web**3) / 12.0
    J = (2.0 * width * flange**3 + inner * web**3) / 3.0
    shear: tuple[float, ...] = ()
    if nu is not None:
        middle = height - flange
        m, n = 2.0 * width * flange / (middle * web), width / middle
        # across the web the flanges carry all, as rectangles do
        shear = (
            _rectangle(nu) * 2.0 * width * flange / A,
            _flanged(nu, m, 30.0 * n**2 * (m + m**2) + 5.0 * nu * n**2 * (8.0 * m + 9.0 * m**2)),
        )
    return Section(A, Iy, Iz, J, shear)


def _rectangle(nu: float) -> float:
    return 10.0 * (1.0 + nu) / (12.0 + 11.0 * nu)


def _box_shear(nu: float, n: float) -> float:
    """Return the coefficient of a thin-walled box of one thickness, n times as wide as it is high along the force."""
    return _flanged(nu, n, 10.0 * n**2 * ((3.0 + nu) * n + 3.0 * n**2))


def _flanged(nu: float, m: float, wide: float) -> float:
    """Return Cowper's coefficient of thin-walled I-beams and boxes; m: area of flanges by that of webs."""
    bending = 12.0 + 72.0 * m + 150.0 * m**2 + 90.0 * m**3
    return (
        10.0
        * (1.0 + nu)
        * (1.0 + 3.0 * m) ** 2
        / (bending + nu * (11.0 + 66.0 * m + 135.0 * m**2 + 90.0 * m**3) + wide)
    )


SHAPES: Mapping[str, Shape] = MappingProxyType(
    {
        "tube": Shape(
            "round tube: outer and inner diameter",
            ("outer", "inner"),
            "an inner diameter below the outer one",
            lambda sizes: sizes[1] < sizes[0],
            _round,
        ),
        "rod": Shape("round rod: its diameter", ("diameter",), "a diameter", lambda _: True, _round),
        "bar": Shape(
            "solid rectangle: height along z, width along y", ("height", "width"), "two sides", lambda _: True, _bar
        ),
        "box": Shape(
            "rectangular tube: outer height along z, outer width along y, wall thickness",
            ("height", "width", "thickness"),
            "a thickness below half of height and width",
            lambda sizes: 2.0 * sizes[2] < min(sizes[:2]),
            _box,
        ),
        "I": Shape(
            "I-beam: height along z, width of the flanges along y, their thickness, that of the web",
            ("height", "width", "flange", "web"),
            "flanges thinner than half of the height, a web thinner than the width",
            lambda sizes: 2.0 * sizes[2] < sizes[0] and sizes[3] < sizes[1],
            _beam,
        ),
    }
)
ROUND = ("tube", "rod")  # kinds whose first dimension is a diameter; of others it is the height, and then the width


def reach_of(kind: str, sizes: Sequence[float]) -> tuple[float, float]:
    """Return how far a section reaches from its centroid along y and along z, m."""
    if kind in ROUND:
        return sizes[0] / 2.0, sizes[0] / 2.0
    return sizes[1] / 2.0, sizes[0] / 2.0
