"""Sections of beams, and beams of segments: areas, published constants, and Timoshenko's continuous beam."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad

from eomgen.robot.sections import SHAPES, Section
from tests.support.beams import SIZES, STEEL, cantilever, straight, timoshenko
from tests.support.description_samples import homogeneous, link_poses
from tests.support.figures import Figures

L = 1.3
EA, GJ = STEEL["E"] * 2.0e-3, STEEL["G"] * 5.0e-7
EIY, EIZ = STEEL["E"] * 4.0e-7, STEEL["E"] * 3.0e-7
GAY, GAZ = 0.8 * STEEL["G"] * 2.0e-3, 0.6 * STEEL["G"] * 2.0e-3
RHO_A = STEEL["density"] * 2.0e-3
AXES = {"x": "xyz", "y": "yzx", "z": "zxy", "-x": "XYz", "-y": "YZx", "-z": "ZXy"}  # the section's; capitals: negative


def turned(axis: str) -> np.ndarray:
    """Columns: the section's axes in those of the root."""
    rows = [np.eye(3)["xyz".index(x.lower())] * (1 if x.islower() else -1) for x in AXES[axis]]
    return np.array(rows, dtype=float).T


def flexibility() -> np.ndarray:
    """Displacements and rotations of the tip, section's axes, by forces and moments there: closed forms."""
    C = np.zeros((6, 6))
    C[0, 0], C[3, 3] = L / EA, L / GJ
    C[1, 1], C[2, 2] = L**3 / (3 * EIZ) + L / GAY, L**3 / (3 * EIY) + L / GAZ
    C[5, 5], C[4, 4] = L / EIZ, L / EIY
    C[1, 5] = C[5, 1] = L**2 / (2 * EIZ)
    C[2, 4] = C[4, 2] = -(L**2) / (2 * EIY)
    return C


@pytest.mark.parametrize("axis", AXES)
@pytest.mark.parametrize("segments", [1, 2, 7])
def test_a_tip_deflects_as_the_continuous_beams(segments: int, axis: str, figures: Figures) -> None:
    """Deflection and slope under forces and moments; the child's frame is parallel to the root's."""
    model = straight(cantilever(segments=segments, axis=axis))
    T = np.kron(np.eye(2), turned(axis))
    wanted = T @ flexibility() @ T.T
    found = np.array([model.by_tip(wrench) for wrench in np.eye(6)]).T
    size = np.sqrt(np.diag(wanted))
    figures.at_most("flexibility", float(np.abs((found - wanted) / np.outer(size, size)).max()), 1e-12)


@pytest.mark.parametrize("segments", [1, 2, 7])
def test_a_tip_sags_by_its_weight_as_the_continuous_beams(segments: int, figures: Figures) -> None:
    """Deflections and slopes under a weight in any direction."""
    model, g = straight(cantilever(segments=segments)), np.array([3.0, -4.0, -9.0])
    x, y, z = RHO_A * g
    wanted = np.array(
        [
            x * L**2 / (2 * EA),
            y * (L**4 / (8 * EIZ) + L**2 / (2 * GAY)),
            z * (L**4 / (8 * EIY) + L**2 / (2 * GAZ)),
            0.0,
            -z * L**3 / (6 * EIY),
            y * L**3 / (6 * EIZ),
        ]
    )
    found = model.by_weight(g)
    figures.at_most("sag", float(np.abs(found - wanted)[[0, 1, 2, 4, 5]].max() / np.abs(wanted).max()), 1e-12)
    for i in (0, 1, 2, 4, 5):
        assert found[i] == pytest.approx(wanted[i], rel=1e-12)
    assert found[3] == 0.0


@pytest.mark.parametrize("axis", AXES)
def test_mass_and_its_centre_are_the_beams(axis: str) -> None:
    robot = cantilever(segments=5, axis=axis, placement={"xyz": [0.2, 0.3, 0.4], "rpy": [0.1, 0.2, 0.3]})
    beam, model = robot.beams[0], straight(robot)
    assert sum(model.masses.values()) == pytest.approx(beam.mass, rel=1e-14) == pytest.approx(RHO_A * L, rel=1e-14)
    assert sum(m for name, m in model.masses.items() if name in beam.link_names) == pytest.approx(beam.mass)
    poses = link_poses(robot, np.zeros(30))
    centre = sum(x.mass * (poses[x.name] @ [*x.com, 1.0])[:3] for x in robot.links) / beam.mass
    root = homogeneous(beam.placement)
    along = root[:3, :3] @ turned(axis)[:, 0]
    assert centre == pytest.approx(root[:3, 3] + along * L / 2, abs=1e-14)
    assert poses["head"][:3, 3] == pytest.approx(root[:3, 3] + along * L, abs=1e-14)
    assert poses["head"][:3, :3] == pytest.approx(root[:3, :3], abs=1e-15)


def bar(ratio: float) -> dict[str, Any]:
    """Keys of a beam of 1 m that is so many times as long as its square section is high."""
    return {"length": 1.0, "section": {"bar": [1 / ratio, 1 / ratio]}, **dict.fromkeys(SIZES)}


@pytest.mark.parametrize(
    ("ratio", "segments", "count"), [(20, 16, 3), (20, 12, 2), (20, 5, 1), (50, 16, 3), (200, 16, 3), (10, 24, 3)]
)
def test_first_bending_frequencies_are_those_of_timoshenkos_equation(
    ratio: int, segments: int, count: int, figures: Figures
) -> None:
    """Within 1e-3: what docs/description.md states of these numbers of segments."""
    robot = cantilever(segments=segments, rigid=["x", "z", "alpha", "beta"], **bar(ratio))
    beam = robot.beams[0]
    wanted = timoshenko(
        beam.E * beam.Iz, beam.shear[0] * beam.G * beam.A, beam.density * beam.A, beam.density * beam.Iz, 1.0
    )
    found = straight(robot).frequencies()[:count]
    figures.at_most("frequencies", float(np.abs(found / wanted[:count] - 1.0).max()), 1e-3)


def test_timoshenkos_equation_becomes_euler_and_bernoullis() -> None:
    """Without shear and rotary inertia: cos x cosh x = -1, as books print it."""
    found = timoshenko(1.0, 1e12, 1.0, 0.0, 1.0)
    assert np.sqrt(found) == pytest.approx([1.875104068711961, 4.694091132974174, 7.854757438237613], rel=1e-9)


def test_axial_and_torsional_frequencies() -> None:
    """Those of a chain of masses and springs exactly, the bar's within 1e-3 for the first and 16 segments."""
    N = 16
    for key, stiffness, inertia in (
        ("x", EA, RHO_A),
        ("alpha", GJ, STEEL["density"] * (4.0e-7 + 3.0e-7)),
    ):
        rigid = [name for name in ("x", "y", "z", "alpha", "beta", "gamma") if name != key]
        found = straight(cantilever(segments=N, rigid=rigid)).frequencies()
        speed = math.sqrt(stiffness / inertia) / L
        order = np.arange(1, 4) - 0.5
        assert found[:3] == pytest.approx(2 * N * np.sin(order * np.pi / (2 * N)) * speed, rel=1e-11)
        assert found[0] == pytest.approx(math.pi / 2 * speed, rel=1e-3)


def test_both_planes_bend_with_their_own_sections() -> None:
    """Coordinates that stay decouple: y and gamma, z and beta."""
    whole = straight(cantilever(segments=3)).frequencies()
    planes = [["x", "z", "alpha", "beta"], ["x", "y", "alpha", "gamma"], ["y", "z", "alpha", "beta", "gamma"]]
    planes.append(["x", "y", "z", "beta", "gamma"])
    apart = np.concatenate([straight(cantilever(segments=3, rigid=rigid)).frequencies() for rigid in planes])
    assert whole == pytest.approx(np.sort(apart), rel=1e-9)


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
