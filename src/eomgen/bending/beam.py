"""Modes of a straight uniform beam that is clamped at its root, and the constants of the link that it makes.

Shapes are those of S. P. Timoshenko's beam, direction by direction, x along the beam.  Bending along y, or z, by n
modes: the deflections by a force and, from n = 2 on, by a moment at the tip, and the lowest n - 2 eigenmodes of the
clamped beam with a free tip.  Twist and stretch by n modes: the shape by a load at the tip, and the lowest n - 1
eigenmodes.  The modes of a direction are combinations of these that diagonalise mass and stiffness (W. Ritz), so that
each has a frequency; each is scaled to a largest deflection of 1 m, or twist of 1 rad.  Forces at the tip deflect it
exactly, and moments do so by two modes or more; eigenmodes alone would leave a part of that out.

Curvature, shear, twist and stretch are series of A.-M. Legendre's polynomials, which are orthogonal: their coefficients
are coordinates in which the stiffness is diagonal, so that low frequencies have all their digits, and those of
eigenmodes are the continuous beam's within 1e-10.  All integrals are of polynomials, and exact.  Points of the axis
move back where it bends, by half of the integral of the slope's square: that gives the second order.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.polynomial import chebyshev, legendre
from numpy.typing import ArrayLike

from ..arrays import Array
from ..robot.value import AXES, COORDINATES, LinkBeam, LinkModes, Node, ShapesAlong
from ..robot.value.link_beam import TIP as TIP
from .constants import Constants, as_tuples, constants_of_masses, modal_damping, placed_node

# row of Phi that a direction's modes move, the row of rotations by the slope, and their sense: about y it is -dw/dx
_ROWS: Mapping[str, tuple[int, int, float]] = {
    "y": (1, 5, 1.0),
    "z": (2, 4, -1.0),
    "torsion": (3, 3, 1.0),
    "axial": (0, 0, 1.0),
}
_LEAST = 1e-13  # of a series' greatest coefficient: what is left out is below it
_TERMS, _PER_MODE = 18, 2  # of a series: a mode of n waves has all its digits by some 3 n and a dozen


@dataclass(frozen=True, eq=False)
class _Curves:
    """Series of the n modes of one direction, (terms, n) each.

    deflection: m, or rad of twist.  rotation: of sections in bending, rad; slope: dv/dx of the axis; both 0 where
    nothing bends.
    """

    length: float
    deflection: Array
    rotation: Array
    slope: Array

    @property
    def count(self) -> int:
        """n, the number of modes."""
        return int(self.deflection.shape[1])

    def scaled(self, largest: Array) -> _Curves:
        """Return the modes divided by numbers, (n,)."""
        return _Curves(self.length, self.deflection / largest, self.rotation / largest, self.slope / largest)

    def deflection_at(self, x: float) -> Array:
        """Return the deflections at a distance from the root, m, (n,)."""
        return _at(self.deflection, 2.0 * x / self.length - 1.0)

    def rotation_at(self, x: float) -> Array:
        """Return the rotations there, (n,)."""
        return _at(self.rotation, 2.0 * x / self.length - 1.0)

    def drawn_in(self, x: float) -> Array:
        """Return the integrals of products of slopes from the root to there, m, (n, n)."""
        points, weights = legendre.leggauss(len(self.slope) + 1)
        there = (1.0 + points) * x / 2.0
        slopes = _at(self.slope, 2.0 * there / self.length - 1.0)
        found = (slopes * (weights * x / 2.0)[:, None]).T @ slopes
        return np.asarray((found + found.T) / 2.0)

    def series(self) -> tuple[list[Array], list[Array], list[Array], dict[tuple[int, int], Array]]:
        """Return deflections, rotations and slopes, and integrals of products of slopes by pairs (k, j), k <= j.

        All of them are series of P. L. Chebyshev's polynomials of 2 x / length - 1.
        """
        turned = [_chebyshev(self.rotation[:, k]) for k in range(self.count)]
        slopes = [_chebyshev(self.slope[:, k]) for k in range(self.count)]
        products = dict[tuple[int, int], Array]()
        if self.slope.any():
            for k in range(self.count):
                for j in range(k, self.count):
                    product = np.asarray(chebyshev.chebmul(slopes[k].tolist(), slopes[j].tolist()), float)
                    integral = chebyshev.chebint(product, lbnd=-1.0, scl=self.length / 2.0)
                    products[k, j] = _trimmed(np.asarray(integral))
        return [_chebyshev(self.deflection[:, k]) for k in range(self.count)], turned, slopes, products


@dataclass(frozen=True, eq=False)
class _Shapes:
    """Modes of one direction at G points of integration along the beam.

    deflection: (G, n), m or rad; of the tip, (n,).  rotation: of sections in bending, rad; slope: dv/dx of the axis;
    both 0 where nothing bends.  stiffness: (n,).  curves: the same at any place.
    """

    deflection: Array
    rotation: Array
    slope: Array
    tip: Array
    tip_rotation: Array
    stiffness: Array
    curves: _Curves

    def scaled(self) -> _Shapes:
        """Return the modes with a largest deflection of 1, the tip's positive."""
        largest = np.maximum(np.abs(self.deflection).max(axis=0), np.abs(self.tip))
        largest = np.where(self.tip < 0.0, -largest, largest)
        return _Shapes(
            self.deflection / largest,
            self.rotation / largest,
            self.slope / largest,
            self.tip / largest,
            self.tip_rotation / largest,
            self.stiffness / largest**2,
            self.curves.scaled(largest),
        )


def beam_modes(beam: LinkBeam, damping: float = 0.0) -> LinkModes:
    """Return the modes of a link that is a beam: constants in its frame, stiffness, damping, and its nodes.

    Those are the one at the tip, and those that the beam names.

    What symmetry makes zero is exactly 0.0: a mode that bends along y moves nothing along z, and masses and stiffness
    of the modes of one direction are diagonal.

    Args:
        beam: numbers that go together (``LinkBeam.conflict``).
        damping: of each mode of the clamped beam, a part of critical damping.
    """
    series = _series(beam)
    shapes = _shapes(beam, series)
    constants = _constants(beam, series, shapes)
    count, R = constants.count, np.array(AXES[beam.axis])
    Phi, Psi = np.zeros((6, count)), np.zeros((3, count, count))
    for (direction, shape), columns in zip(shapes.items(), _places(shapes), strict=True):
        row, turns, sense = _ROWS[direction]
        if shape.slope.any():
            Phi[turns, columns] = sense * shape.tip_rotation
            Psi[0, columns, columns] = -_products(shape.slope, series.weights)
        Phi[row, columns] = shape.tip
    nodes = [_node(TIP, beam.length, R, Phi, Psi)]
    nodes += [_node(name, x, R, *_moved_at(shapes, x, count)) for name, x in beam.nodes.items()]
    K = np.diag(np.concatenate([shape.stiffness for shape in shapes.values()]))
    return constants.turned(R).link_modes(K, modal_damping(constants.masses, K, damping), nodes)


def shapes_along(beam: LinkBeam) -> ShapesAlong:
    """Return what the modes of ``beam_modes`` make of places on the axis, in the link's frame."""
    shapes = _shapes(beam, _Series(beam.length, _TERMS + _PER_MODE * max(beam.modes.counts.values())))
    R = np.array(AXES[beam.axis])
    first: dict[str, list[tuple[int, tuple[float, ...]]]] = {}
    second: dict[str, list[tuple[int, int, tuple[float, ...]]]] = {}
    inclined: dict[str, list[tuple[float, list[tuple[int, tuple[float, ...]]]]]] = {}
    for (direction, shape), columns in zip(shapes.items(), _places(shapes), strict=True):
        row, turns, sense = _ROWS[direction]
        deflections, rotations, slopes, products = shape.curves.series()
        for of, factor, series in ((row, 1.0, deflections), (turns, sense, rotations)):
            kind, along = _turned_row(R, of)
            moved = [(columns.start + k, as_tuples(along * factor * x)) for k, x in enumerate(series) if x.any()]
            if moved:
                first.setdefault(kind, []).extend(moved)
        kind, along = _turned_row(R, 0)
        drawn = [
            (columns.start + k, columns.start + j, as_tuples(-along * x)) for (k, j), x in products.items() if x.any()
        ]
        if drawn:
            second.setdefault(kind, []).extend(drawn)
            inclined.setdefault(kind, []).append(
                (-along, [(columns.start + k, as_tuples(x)) for k, x in enumerate(slopes)])
            )
    return ShapesAlong(first, second, inclined)


def _turned_row(R: Array, row: int) -> tuple[str, float]:
    """Return the coordinate of the link's frame in which one of the section's axes lies, and its sense."""
    axis = int(np.flatnonzero(R[:, row % 3])[0])
    return COORDINATES[row - row % 3 + axis], float(R[axis, row % 3])


def _moved_at(shapes: Mapping[str, _Shapes], x: float, count: int) -> tuple[Array, Array]:
    """Return Phi and Psi of a place on the axis, in the section's axes."""
    Phi, Psi = np.zeros((6, count)), np.zeros((3, count, count))
    for (direction, shape), columns in zip(shapes.items(), _places(shapes), strict=True):
        row, turns, sense = _ROWS[direction]
        if shape.slope.any():
            Phi[turns, columns] = sense * shape.curves.rotation_at(x)
            Psi[0, columns, columns] = -shape.curves.drawn_in(x)
        Phi[row, columns] = shape.curves.deflection_at(x)
    return Phi, Psi


def _node(name: str, x: float, R: Array, Phi: Array, Psi: Array) -> Node:
    """Return a node in the link's axes, of Phi and Psi in the section's."""
    node = Node(name, (x, 0.0, 0.0), as_tuples(Phi), as_tuples(Psi) if Psi.any() else None)
    return placed_node(node, R, np.zeros(3))


def beam_inertia(beam: LinkBeam) -> Array:
    """Return the integral of rho0 rho0^T over the mass of a beam, in the link's frame, (4, 4)."""
    H00, R = np.zeros((4, 4)), np.eye(4)
    mass, length = beam.mass, beam.length
    H00[0, 0], H00[0, 3], H00[3, 0], H00[3, 3] = mass * length**2 / 3.0, mass * length / 2.0, mass * length / 2.0, mass
    H00[1, 1], H00[2, 2] = beam.density * beam.Iz * length, beam.density * beam.Iy * length
    R[:3, :3] = AXES[beam.axis]
    return np.asarray(R @ H00 @ R.T + 0.0)


def beam_shapes(beam: LinkBeam, along: ArrayLike) -> tuple[Array, Array]:
    """Return what the modes make of the coordinates of a beam's sections, link frame, as Phi and Psi of nodes.

    Args:
        beam: numbers that go together.
        along: distances of the sections from the root, (S,), m.

    Returns:
        Phi, (S, 6, m), and Psi, (S, 3, m, m).
    """
    places, series = np.asarray(along, dtype=np.float64), _series(beam)
    shapes = _shapes(beam, series)
    own_places, R = _places(shapes), np.array(AXES[beam.axis])
    count = own_places[-1].stop
    Phi, Psi = np.zeros((len(places), 6, count)), np.zeros((len(places), 3, count, count))
    for (direction, found), own in zip(shapes.items(), own_places, strict=True):
        row, turns, sense = _ROWS[direction]
        if found.slope.any():
            Phi[:, turns, own] = sense * series.values_at(found.rotation, places)
            Psi[:, 0, own, own] = -series.products_up_to(found.slope, places)
        Phi[:, row, own] = series.values_at(found.deflection, places)
    turned = R @ Phi.reshape(len(places), 2, 3, count)
    return turned.reshape(len(places), 6, count), np.einsum("ij,sjkl->sikl", R, Psi)


def _series(beam: LinkBeam) -> _Series:
    return _Series(beam.length, _TERMS + _PER_MODE * max(beam.modes.counts.values()))


def _shapes(beam: LinkBeam, series: _Series) -> dict[str, _Shapes]:
    """Return the modes of each direction that has some."""
    ky, kz = beam.shear
    shear, along, polar = beam.G * beam.A, beam.density * beam.A, beam.density * (beam.Iy + beam.Iz)
    counts, shapes = beam.modes, dict[str, _Shapes]()
    if counts.y:
        shapes["y"] = _bent(series, beam.E * beam.Iz, ky * shear, (along, beam.density * beam.Iz), counts.y)
    if counts.z:
        shapes["z"] = _bent(series, beam.E * beam.Iy, kz * shear, (along, beam.density * beam.Iy), counts.z)
    if counts.torsion:
        shapes["torsion"] = _drawn(series, beam.G * beam.J, polar, counts.torsion)
    if counts.axial:
        shapes["axial"] = _drawn(series, beam.E * beam.A, along, counts.axial)
    return shapes


def _places(shapes: Mapping[str, _Shapes]) -> list[slice]:
    """Return where the modes of each direction stand among all."""
    ends = np.cumsum([0, *(len(shape.tip) for shape in shapes.values())])
    return [slice(int(first), int(end)) for first, end in pairwise(ends)]


def _constants(beam: LinkBeam, series: _Series, shapes: Mapping[str, _Shapes]) -> Constants:
    """Return the constants in the section's axes."""
    x, weights, places = series.points, series.weights, _places(shapes)
    count = places[-1].stop
    moves, turns = np.zeros((2, len(x), 3, count))
    Q = np.zeros((count, count, 4, 3))
    along, on_axis = beam.density * beam.A, np.zeros((len(x), 3))
    on_axis[:, 0] = x
    for (direction, shape), modes in zip(shapes.items(), places, strict=True):
        row, about, sense = _ROWS[direction]
        (moves if row < 3 else turns)[:, row % 3, modes] = shape.deflection
        if shape.slope.any():
            turns[:, about - 3, modes] = sense * shape.rotation
            # what lies beyond a place moves back by what the axis loses there
            Q[modes, modes, 0, 0] = -_products(shape.slope, along * weights * (beam.length**2 - x**2) / 2.0)
            Q[modes, modes, 3, 0] = -_products(shape.slope, along * weights * (beam.length - x))
    section = np.diag([0.0, beam.density * beam.Iz, beam.density * beam.Iy])
    made = constants_of_masses(along * weights, on_axis, weights[:, None, None] * section, moves, turns)
    P = (made.P + made.P.transpose(1, 0, 3, 2)) / 2.0
    for direction, modes in zip(shapes, places, strict=True):
        _decouple(P[modes, modes], _ROWS[direction][0])
    return Constants(made.H00, made.H0, P, Q)


def _decouple(P: Array, row: int) -> None:
    """Make the traces of P of two different modes of one direction exactly 0, which they are but for round-off.

    Where it bends, sections that turn leave what the deflections cancel.
    """
    different = ~np.eye(len(P), dtype=bool)
    kept = P[..., 0, 0][different] if row in (1, 2) else 0.0
    P[different] = 0.0
    P[different, 0, 0] = kept
    P[different, row % 3, row % 3] -= kept


def _products(functions: Array, weights: Array) -> Array:
    """Return integrals of products of functions at the points of integration, symmetric, (n, n)."""
    products = (functions * weights[:, None]).T @ functions
    return np.asarray((products + products.T) / 2.0)


@dataclass(frozen=True)
class _Series:
    """Legendre's polynomials along a beam and their integrals from its root, ``terms`` of them.

    Each is (G, terms) at the points of integration, whose sums are exact for the products that are wanted.
    """

    length: float
    terms: int

    @cached_property
    def _gauss(self) -> tuple[Array, Array]:
        return legendre.leggauss(self.terms + 4)

    @property
    def points(self) -> Array:
        """Places of the points of integration, (G,), m."""
        return np.asarray((1.0 + self._gauss[0]) * self.length / 2.0)

    @property
    def weights(self) -> Array:
        """Weights of sums over them, (G,), m."""
        return np.asarray(self._gauss[1] * self.length / 2.0)

    @property
    def squares(self) -> Array:
        """Integrals of the squares over the length, (terms,), m."""
        return np.asarray(self.length / (2.0 * np.arange(self.terms) + 1.0))

    @cached_property
    def integrals(self) -> tuple[tuple[Array, Array], ...]:
        """The polynomials, their integrals, and integrals of these: at the points, and at the tip, (terms,)."""
        values = legendre.legvander(np.append(self._gauss[0], 1.0), self.terms + 1)
        found: list[tuple[Array, Array]] = []
        for ways in self.antiderivatives:
            there = values[:, : len(ways)] @ ways
            found.append((there[:-1], there[-1]))
        return tuple(found)

    def values_at(self, functions: Array, places: Array) -> Array:
        """Return functions (G, n) at other places (...), m, (..., n): their own polynomials are evaluated there."""
        points, weights = self._gauss
        degree = self.terms + 1  # of what is integrated twice
        projections = (legendre.legvander(points, degree) * weights[:, None]).T @ functions
        coefficients = (np.arange(degree + 1) + 0.5)[:, None] * projections
        return np.asarray(legendre.legvander(2.0 * places / self.length - 1.0, degree) @ coefficients)

    def products_up_to(self, functions: Array, places: Array) -> Array:
        """Return integrals from the root to places (S,), m, of products of functions (G, n), (S, n, n)."""
        points, weights = self._gauss
        values = self.values_at(functions, places[:, None] * (1.0 + points) / 2.0)
        return np.asarray(np.einsum("s,g,sgi,sgj->sij", places / 2.0, weights, values, values))

    @cached_property
    def antiderivatives(self) -> tuple[Array, ...]:
        """The polynomials, their integrals, and integrals of these as series, (terms + 0, 1, 2, terms)."""
        ways: Array = np.eye(self.terms)
        found = [ways]
        for _ in range(2):
            found.append(np.asarray(legendre.legint(found[-1], lbnd=-1.0, scl=self.length / 2.0)))
        return tuple(found)

    def curves(self, deflection: Array, rotation: Array, slope: Array) -> _Curves:
        """Return modes by coefficients, (3, terms, n) each: of the polynomials, their integrals, and those of these."""
        size, parts = self.terms + 2, self.antiderivatives
        padded = [np.vstack([part, np.zeros((size - len(part), self.terms))]) for part in parts]
        made = [sum(part @ x for part, x in zip(padded, of, strict=True)) for of in (deflection, rotation, slope)]
        return _Curves(self.length, *map(np.asarray, made))


def _bent(series: _Series, bend: float, shear: float, densities: tuple[float, float], count: int) -> _Shapes:
    """Return modes of bending in a plane.

    Args:
        series: of the curvature and of the shear.
        bend: EI, N m^2.
        shear: k G A, N.
        densities: mass, kg/m, and its second moment about the axis of bending, kg m, per length.
        count: of modes.
    """
    terms, length, zero = series.terms, series.length, np.zeros(series.terms)
    # coefficients of the curvature, then those of the shear, as parts of such that store the energy 1/2
    sizes = np.concatenate([1.0 / np.sqrt(bend * series.squares), 1.0 / np.sqrt(shear * series.squares)])
    (plain, _), (once, once_tip), (twice, twice_tip) = series.integrals
    deflection, rotation = np.hstack([twice, once]) * sizes, np.hstack([once, 0.0 * once]) * sizes
    slope = np.hstack([once, plain]) * sizes
    tip, tip_rotation = np.append(twice_tip, once_tip) * sizes, np.append(once_tip, zero) * sizes
    along, second = densities
    M = _products(deflection, along * series.weights) + _products(rotation, second * series.weights)
    # by a force the curvature falls from L / EI to 0; by a moment it is 1 / EI
    force, moment = np.zeros((2, 2 * terms))
    force[[0, 1, terms]] = length / (2.0 * bend), -length / (2.0 * bend), 1.0 / shear
    moment[0] = 1.0 / bend
    ways = _ritz(M, [force / sizes, moment / sizes][:count], count)
    moved = deflection @ ways, rotation @ ways, slope @ ways
    bends, shears = np.split(sizes[:, None] * ways, 2)
    none = np.zeros_like(bends)
    curves = series.curves(
        np.array([none, shears, bends]), np.array([none, bends, none]), np.array([shears, bends, none])
    )
    return _Shapes(*moved, tip @ ways, tip_rotation @ ways, np.ones(count), curves).scaled()


def _drawn(series: _Series, stiffness: float, density: float, count: int) -> _Shapes:
    """Return modes of stretch or twist.

    Args:
        series: of the stretch or twist per length.
        stiffness: EA, N, or GJ, N m^2.
        density: mass, kg/m, or moment of inertia about the axis, kg m, per length.
        count: of modes.
    """
    sizes = 1.0 / np.sqrt(stiffness * series.squares)
    once, once_tip = series.integrals[1]
    deflection, tip = once * sizes, once_tip * sizes
    even = np.zeros(series.terms)
    even[0] = 1.0
    ways = _ritz(_products(deflection, density * series.weights), [even / sizes], count)
    still = np.zeros((len(deflection), count))
    none = np.zeros((3, series.terms, count))
    curves = series.curves(np.array([none[0], sizes[:, None] * ways, none[0]]), none, none)
    return _Shapes(deflection @ ways, still, still, tip @ ways, np.zeros(count), np.ones(count), curves).scaled()


def _ritz(M: Array, static: Sequence[Array], count: int) -> Array:
    """Return modes in coordinates whose stiffness matrix is 1, those of the lowest frequencies first, (N, count).

    Args:
        M: masses, (N, N).
        static: shapes that the modes hold; the rest are eigenmodes.
        count: of modes.
    """
    shapes = [shape / np.linalg.norm(shape) for shape in static]
    if count > len(static):
        _, X = np.linalg.eigh(M)  # its eigenvalues are 1 / frequency^2
        shapes = [*X[:, ::-1][:, : count - len(static)].T, *shapes]
    basis = np.column_stack(shapes)
    orthonormal, _ = np.linalg.qr(basis)
    inner = orthonormal.T @ M @ orthonormal
    _, mixed = np.linalg.eigh((inner + inner.T) / 2.0)
    return np.asarray(orthonormal @ mixed[:, ::-1])


def _at(series: Array, x: float | Array) -> Array:
    return np.asarray(np.asarray(legendre.legvander(np.asarray(x), len(series) - 1)) @ series)


def _chebyshev(series: Array) -> Array:
    """Return the Chebyshev series of a Legendre series, without round-off behind its last term."""
    if not series.any():
        return np.zeros(1)
    points = chebyshev.chebpts1(len(series))
    return _trimmed(np.asarray(chebyshev.chebfit(points, legendre.legval(points, series), len(series) - 1)))


def _trimmed(series: Array) -> Array:
    size = np.abs(series).max()
    kept = np.where(np.abs(series) > _LEAST * size, series, 0.0)
    return np.asarray(chebyshev.chebtrim(kept))
