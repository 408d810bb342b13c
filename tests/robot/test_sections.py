"""Sections of beams against areas summed piece by piece, published constants, and the energy of their shear flow."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import quad

from eomgen.robot.sections import SHAPES, Section


def section(kind: str, *sizes: float, nu: float | None = 0.3) -> Section:
    return SHAPES[kind].section(sizes, nu)


def summed(*pieces: tuple[float, float, float, float]) -> tuple[float, float, float]:
    """A, Iy, Iz of rectangles (y, z of the centre, width along y, height along z), by Steiner's theorem."""
    A = sum(w * h for _, _, w, h in pieces)
    Iy = sum(w * h**3 / 12 + w * h * z**2 for _, z, w, h in pieces)
    return A, Iy, sum(h * w**3 / 12 + w * h * y**2 for y, _, w, h in pieces)


def test_areas_and_second_moments() -> None:
    h, w, t, s = 0.2, 0.12, 0.011, 0.007
    box = summed(
        *((0, z, w, t) for z in ((h - t) / 2, (t - h) / 2)), *((y, 0, t, h - 2 * t) for y in (0.0545, -0.0545))
    )
    flanged = summed(*((0, z, w, t) for z in ((h - t) / 2, (t - h) / 2)), (0, 0, s, h - 2 * t))
    for made, (A, Iy, Iz) in (
        (section("box", h, w, t), box),
        (section("I", h, w, t, s), flanged),
        (section("bar", h, w), summed((0, 0, w, h))),
    ):
        assert (made.A, made.Iy, made.Iz) == pytest.approx((A, Iy, Iz), rel=1e-13)
    for outer, inner, made in ((0.1, 0.09, section("tube", 0.1, 0.09)), (0.1, 0.0, section("rod", 0.1))):
        r, R = inner / 2, outer / 2
        A, _ = quad(lambda x: 2 * math.pi * x, r, R)
        polar, _ = quad(lambda x: 2 * math.pi * x**3, r, R)
        assert (made.A, made.Iy, made.Iz, made.J) == pytest.approx((A, polar / 2, polar / 2, polar), rel=1e-12)


def test_torsion() -> None:
    """Rectangles as S. P. Timoshenko and J. N. Goodier tabulate them; a closed wall's by Bredt's integral."""
    for ratio, factor in ((1, 0.1406), (1.5, 0.196), (2, 0.229), (3, 0.263), (4, 0.281), (10, 0.312)):
        for sizes in ((0.02 * ratio, 0.02), (0.02, 0.02 * ratio)):
            assert pytest.approx(factor * 0.02**4 * ratio, rel=3e-3) == section("bar", *sizes).J
    area, around = 0.19 * 0.11, 2 * (0.19 + 0.11) / 0.01
    assert pytest.approx(4 * area**2 / around, rel=1e-13) == section("box", 0.2, 0.12, 0.01).J
    open_walls = (2 * 0.12 * 0.01**3 + 0.18 * 0.006**3) / 3
    assert pytest.approx(open_walls, rel=1e-13) == section("I", 0.2, 0.12, 0.01, 0.006).J


@pytest.mark.parametrize("nu", [0.0, 0.3, 0.5])
def test_shear_coefficients_as_cowper_prints_them(nu: float) -> None:
    """Of solid sections, and the thin-walled limits that he gives as sections of their own."""
    rectangle, thin = 10 * (1 + nu) / (12 + 11 * nu), 1e-7
    assert section("rod", 0.1, nu=nu).shear == pytest.approx(2 * (6 * (1 + nu) / (7 + 6 * nu),))
    assert section("bar", 0.1, 0.2, nu=nu).shear == pytest.approx((rectangle, rectangle))
    tube = section("tube", 0.1, 0.1 * (1 - thin), nu=nu).shear
    assert tube == pytest.approx(2 * (2 * (1 + nu) / (4 + 3 * nu),), rel=1e-6)
    square = section("box", 0.1, 0.1, 0.1 * thin, nu=nu).shear
    assert square == pytest.approx(2 * (20 * (1 + nu) / (48 + 39 * nu),), rel=1e-6)
    narrow = section("I", 0.1, 0.0101, 1e-8, 0.01, nu=nu).shear
    assert narrow[1] == pytest.approx(rectangle, rel=1e-5)


def flow_coefficient(h: float, b: float, flange: float, web: float, webs: int) -> float:
    """Shear coefficient of thin walls by the energy of their shear flow: I^2 / (A sum Q^2 ds / t), force along webs."""
    free = b / 2  # from where the flow in a flange is 0, its ends or its middle, to a web
    second = webs * web * h**3 / 12 + 2 * b * flange * (h / 2) ** 2
    in_flange, _ = quad(lambda s: (flange * s * h / 2) ** 2 / flange, 0, free)

    def in_web(z: float) -> float:
        return (b * flange * h / 2 / webs + web * ((h / 2) ** 2 - z**2) / 2) ** 2 / web

    along, _ = quad(in_web, -h / 2, h / 2)
    return second**2 / ((webs * web * h + 2 * b * flange) * (4 * in_flange + webs * along))


@pytest.mark.parametrize(("h", "b"), [(0.2, 0.1), (0.1, 0.2), (0.1, 0.1)])
def test_shear_coefficients_of_thin_walls_are_those_of_their_shear_flow(h: float, b: float) -> None:
    """Where Poisson's ratio is 0, so that nothing bends across."""
    t, s = 1e-7, 2e-7
    flanged = section("I", h + t, b, t, s, nu=0.0)
    assert flanged.shear[1] == pytest.approx(flow_coefficient(h, b, t, s, 1), rel=1e-5)
    assert flanged.shear[0] * flanged.A == pytest.approx(5 / 6 * 2 * b * t, rel=1e-12)
    box = section("box", h + t, b + t, t, nu=0.0)
    assert box.shear == pytest.approx((flow_coefficient(b, h, t, t, 2), flow_coefficient(h, b, t, t, 2)), rel=1e-5)


def test_no_shear_coefficients_without_poissons_ratio() -> None:
    for kind, shape in SHAPES.items():
        sizes = np.array([0.1, 0.08, 0.01, 0.006])[: len(shape.names)]
        assert shape.fits(sizes.tolist()), kind
        assert section(kind, *sizes.tolist(), nu=None).shear == ()
