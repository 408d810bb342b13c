"""Links that are beams: statics in closed form, frequencies of other elements and of the continuous beam."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import eigh

from eomgen.bending.beam import beam_modes, beam_shapes, shapes_along
from eomgen.bending.beams.stations import COUNT, stations_of
from eomgen.robot.geometry import COORDINATES
from eomgen.robot.sections import SHAPES
from eomgen.robot.value import AXES, BeamModes, Link, LinkBeam, LinkModes, Node
from eomgen.robot.value.sliding import chebyshev, combined, derivative
from tests.support.beam_elements import Plane
from tests.support.bending_links import nested

pytestmark = pytest.mark.quick
Array = NDArray[np.float64]
BOOM = LinkBeam(1.3, 7e10, 2.6e10, 4e-4, 2e-8, 5e-8, 3e-8, (0.85, 0.8), 2700.0, BeamModes(5, 4, 3, 2))
STUBBY = replace(BOOM, length=0.05)  # shears more than it bends
WIDE = replace(BOOM, Iz=5e-6)
BEAMS = (BOOM, STUBBY, WIDE)


def planes(beam: LinkBeam) -> dict[str, Plane]:
    """Bending along y, about z of the section, and along z."""
    shear, along, rho = beam.G * beam.A, beam.density * beam.A, beam.density
    seconds = {"y": (beam.Iz, beam.shear[0]), "z": (beam.Iy, beam.shear[1])}
    return {key: Plane(beam.E * x, k * shear, along, rho * x, beam.length) for key, (x, k) in seconds.items()}


def arrays(modes: LinkModes) -> dict[str, Array]:
    """Constants and the tip's shapes as arrays."""
    (tip,) = modes.nodes
    assert tip.name == "tip"
    found: dict[str, Any] = {key: getattr(modes, key) for key in ("H0", "P", "Q", "K", "D", "masses")}
    return {key: np.array(x) for key, x in (found | {"Phi": tip.Phi, "Psi": tip.Psi}).items()}


def groups(beam: LinkBeam) -> dict[str, slice]:
    """Places of the modes of each direction."""
    found, first = {}, 0
    for key, count in beam.modes.counts.items():
        found[key] = slice(first, first := first + count)
    return found


@pytest.mark.parametrize("beam", BEAMS)
@pytest.mark.parametrize("count", [1, 2, 3, 6])
def test_loads_at_the_tip_deflect_it_exactly(beam: LinkBeam, count: int) -> None:
    """Those of a moment by two modes or more."""
    beam = replace(beam, modes=BeamModes(count, count, count, count))
    modes = arrays(beam_modes(beam))
    found = modes["Phi"] @ np.linalg.inv(modes["K"]) @ modes["Phi"].T
    L, E, G = beam.length, beam.E, beam.G
    expected = np.zeros((6, 6))
    expected[0, 0], expected[3, 3] = L / (E * beam.A), L / (G * beam.J)
    for row, turns, second, k, sense in ((1, 5, beam.Iz, beam.shear[0], 1), (2, 4, beam.Iy, beam.shear[1], -1)):
        expected[row, row] = L**3 / (3 * E * second) + L / (k * G * beam.A)
        expected[row, turns] = expected[turns, row] = sense * L**2 / (2 * E * second)
        expected[turns, turns] = L / (E * second) if count > 1 else found[turns, turns]
    assert found == pytest.approx(expected, rel=1e-12, abs=0.0)


@pytest.mark.parametrize("beam", BEAMS)
@pytest.mark.parametrize("part", [0.2, 0.7, 1.0])
def test_nodes_along_a_beam_move_exactly_under_loads_at_the_tip(beam: LinkBeam, part: float) -> None:
    """Deflections and rotations of sections in closed form, in the section's axes."""
    L, E, G = beam.length, beam.E, beam.G
    x = part * L
    made = beam_modes(replace(beam, modes=BeamModes(4, 3, 2, 2), nodes={"here": x}))
    tip, here = made.nodes
    assert here.place == pytest.approx((x, 0.0, 0.0))
    found = np.array(here.Phi) @ np.linalg.inv(np.array(made.K)) @ np.array(tip.Phi).T
    assert found[0, 0] == pytest.approx(x / (E * beam.A), rel=1e-11)
    assert found[3, 3] == pytest.approx(x / (G * beam.J), rel=1e-11)
    for row, turns, second, k, sense in ((1, 5, beam.Iz, beam.shear[0], 1), (2, 4, beam.Iy, beam.shear[1], -1)):
        EI = E * second
        force = (3 * L - x) * x**2 / (6 * EI) + x / (k * G * beam.A), sense * (L - x / 2) * x / EI
        assert found[[row, turns], row] == pytest.approx(force, rel=1e-10)
        assert found[[row, turns], turns] == pytest.approx((sense * x**2 / (2 * EI), x / EI), rel=1e-10)


@pytest.mark.parametrize("axis", [*AXES])
def test_shapes_along_a_beam_are_those_of_its_nodes(axis: str) -> None:
    """And what they draw in is half of the integral of the slopes' squares, by finer sums."""
    beam = replace(BOOM, axis=axis, nodes={"here": 0.31 * BOOM.length})
    made, along, T = beam_modes(beam), shapes_along(beam), chebyshev(2.0 * 0.31 - 1.0, 60)
    m = made.count
    Phi, Psi = np.zeros((6, m)), np.zeros((3, m, m))
    for kind, of_modes in along.first.items():
        for k, series in of_modes:
            Phi[COORDINATES.index(kind), k] = combined(series, T)
    for kind, of_pairs in along.second.items():
        for k, j, series in of_pairs:
            Psi[COORDINATES.index(kind), [k, j], [j, k]] = combined(series, T)
    (node,) = (node for node in made.nodes if node.name == "here")
    assert np.abs(Phi - np.array(node.Phi)).max() < 1e-11
    assert np.abs(Psi - np.array(node.Psi)).max() < 1e-11 * np.abs(Psi).max()
    bends = dict(along.first)["xyz"["xyz".index(axis[-1]) - 2]]  # y of the section
    x, weights = np.polynomial.legendre.leggauss(80)
    s = 0.31 * BOOM.length * (1.0 + x) / 2.0
    T = chebyshev(2.0 * s / BOOM.length - 1.0, 60)
    slopes = np.array([2.0 / BOOM.length * combined(derivative(series), T) for _, series in bends[:5]])
    drawn = (slopes * weights * 0.31 * BOOM.length / 2.0) @ slopes.T
    row = "xyz".index(axis[-1])
    assert np.abs(np.abs(Psi[row, :5, :5]) - np.abs(drawn)).max() < 1e-10 * np.abs(drawn).max()


@pytest.mark.parametrize("beam", BEAMS)
def test_bending_frequencies_are_those_of_the_continuous_beam(beam: LinkBeam) -> None:
    """All but two of a direction, whose modes hold the eigenmodes before these; elements come near to the same."""
    modes = arrays(beam_modes(beam))
    squares = np.diag(modes["K"]) / np.diag(modes["masses"])
    for key, plane in planes(beam).items():
        found = np.sqrt(squares[groups(beam)[key]])
        assert np.all(np.diff(found) > 0.0)
        spanned = found[:-2]
        assert spanned == pytest.approx([plane.exact_frequency(x) for x in spanned], rel=1e-11)
        assert spanned == pytest.approx(plane.frequencies(160, len(spanned)), rel=1e-4)


def test_many_modes_keep_their_digits() -> None:
    modes = arrays(beam_modes(replace(STUBBY, modes=BeamModes(12, 0, 0, 12))))
    found = np.sqrt(np.diag(modes["K"]) / np.diag(modes["masses"]))
    plane = planes(STUBBY)["y"]
    assert found[:10] == pytest.approx([plane.exact_frequency(x) for x in found[:10]], rel=1e-10)


def test_twist_and_stretch_have_the_frequencies_of_rods() -> None:
    """All but the last of a direction, whose modes hold the eigenmodes before it."""
    modes = arrays(beam_modes(BOOM))
    frequencies = np.sqrt(np.diag(modes["K"]) / np.diag(modes["masses"]))
    twist = np.sqrt(BOOM.G * BOOM.J / (BOOM.density * (BOOM.Iy + BOOM.Iz)))
    for key, speed in (("torsion", twist), ("axial", np.sqrt(BOOM.E / BOOM.density))):
        found = frequencies[groups(BOOM)[key]]
        exact = (np.arange(len(found)) + 0.5) * np.pi / BOOM.length * speed
        assert found[:-1] == pytest.approx(exact[:-1], rel=1e-12)
        assert found[-1] > exact[-1]
    alone = arrays(beam_modes(replace(BOOM, modes=BeamModes(torsion=1, axial=1))))
    first = np.sqrt(np.diag(alone["K"]) / np.diag(alone["masses"]))
    assert first == pytest.approx(np.sqrt(3.0) / BOOM.length * np.array([twist, np.sqrt(BOOM.E / BOOM.density)]))


@pytest.mark.parametrize("times", [1.0, 10.0])
def test_a_heavy_tip_is_met_by_five_modes(times: float) -> None:
    """A body of several masses of the beam, a tenth of the length wide."""
    beam = replace(BOOM, modes=BeamModes(5))
    modes, plane, tip = arrays(beam_modes(beam)), planes(beam)["y"], times * beam.mass
    about, row = tip * (0.1 * beam.length) ** 2, modes["Phi"]
    M = modes["masses"] + tip * np.outer(row[1], row[1]) + about * np.outer(row[5], row[5])
    found = np.sqrt(eigh(modes["K"], M, eigvals_only=True)[:3])
    off = found / [plane.exact_frequency(x, tip, about) for x in found] - 1.0
    assert np.all(off < [1e-10, 1e-6, 1e-4])
    assert np.all(off > -1e-12)
    one = arrays(beam_modes(replace(beam, modes=BeamModes(1))))  # the deflection by a force
    first = np.sqrt(one["K"][0, 0] / (one["masses"][0, 0] + tip * one["Phi"][1, 0] ** 2))
    assert first == pytest.approx(plane.exact_frequency(first, tip), rel=1e-3)


@pytest.mark.parametrize(("share", "tip_by_mass"), [(0.5, 2.0), (0.5, 0.0), (2.0, 1.0)])
def test_rotation_stiffens_as_elements_under_tension(share: float, tip_by_mass: float) -> None:
    """First frequency in the plane of a beam that turns steadily, with a payload: K + K_G - W^2 M of elements."""
    beam = replace(BOOM, modes=BeamModes(6))
    modes, plane = arrays(beam_modes(beam)), planes(beam)["y"]
    L, along, tip, count = beam.length, beam.density * beam.A, tip_by_mass * beam.mass, 48
    M, K = plane.matrices(count, tip)
    span, points = L / count, np.polynomial.legendre.leggauss(4)
    KG = np.zeros((2 * count + 2, 2 * count + 2))
    p = 12 * plane.bend / (plane.shear * span**2)
    for e in range(count):
        for xi, weight in zip((1 + points[0]) / 2, points[1] / 2, strict=True):
            slope = np.array(
                [
                    (6 * xi**2 - 6 * xi - p) / span,
                    1 - 4 * xi + 3 * xi**2 + p / 2 - p * xi,
                    (6 * xi - 6 * xi**2 + p) / span,
                    3 * xi**2 - 2 * xi + p * xi - p / 2,
                ]
            ) / (1 + p)
            tension = along * (L**2 - ((e + xi) * span) ** 2) / 2 + tip * L
            KG[2 * e : 2 * e + 4, 2 * e : 2 * e + 4] += weight * span * tension * np.outer(slope, slope)
    rest = plane.frequencies(count, 1, tip)[0]
    W = share * rest
    # sections that turn do not gain from it: of their masses only those that move
    moving = replace(plane, second=0.0).matrices(count, tip)[0]
    squares = eigh(K + W**2 * (KG[2:, 2:] - moving), M, eigvals_only=True)
    quadratic = modes["P"][:, :, 1, 1] + modes["Q"][:, :, 0, 0]
    at_tip = tip * (np.outer(modes["Phi"][1], modes["Phi"][1]) + L * modes["Psi"][0])
    own = modes["masses"] + tip * np.outer(modes["Phi"][1], modes["Phi"][1])
    found = eigh(modes["K"] - W**2 * (quadratic + at_tip), own, eigvals_only=True)
    assert found[0] == pytest.approx(squares[0], rel=1e-3)
    assert found[0] > rest**2 * (1.0 + 0.1 * share**2)


def test_masses_are_those_of_the_elements() -> None:
    """Traces of P over all modes, against bending, twist and stretch without each other."""
    modes = arrays(beam_modes(BOOM))
    assert np.count_nonzero(modes["masses"] - np.diag(np.diag(modes["masses"]))) == 0
    assert np.count_nonzero(modes["K"] - np.diag(np.diag(modes["K"]))) == 0
    assert np.all(modes["P"] == modes["P"].transpose(1, 0, 3, 2))
    assert np.all(modes["Q"] == modes["Q"].transpose(1, 0, 2, 3))
    total = np.array([modes["H0"][k, 3] for k in range(len(modes["K"]))])
    for key, row in (("y", 1), ("z", 2), ("axial", 0)):
        # the first mode alone holds some 60 % of the mass, all of them nearly the whole
        own = groups(BOOM)[key]
        effective = total[own, row] ** 2 / np.diag(modes["masses"])[own]
        assert 0.6 < effective[0] / BOOM.mass < 0.82
        assert 0.85 < effective.sum() / BOOM.mass < 1.0


def test_symmetry_leaves_exact_zeros() -> None:
    """Entries by direction that may not be 0.0, of all modes and pairs of these."""
    modes, own = arrays(beam_modes(BOOM)), groups(BOOM)
    H0 = {
        "y": {(0, 1), (1, 0), (3, 1)},
        "z": {(0, 2), (2, 0), (3, 2)},
        "torsion": {(1, 2), (2, 1)},
        "axial": {(0, 0), (3, 0)},
    }
    moved = {"y": {1, 5}, "z": {2, 4}, "torsion": {3}, "axial": {0}}
    for key, at in own.items():
        assert {tuple(int(x) for x in place[1:]) for place in np.argwhere(modes["H0"][at])} == H0[key]
        assert {int(row) for row, _ in np.argwhere(modes["Phi"][:, at])} == moved[key]
    assert np.all(modes["Phi"][:4][modes["Phi"][:4] != 0.0] == 1.0)  # in units of the tip's motion
    pairs = {
        ("y", "y"): {(0, 0), (1, 1)},
        ("z", "z"): {(0, 0), (2, 2)},
        ("torsion", "torsion"): {(1, 1), (2, 2)},
        ("axial", "axial"): {(0, 0)},
        ("y", "z"): {(1, 2)},
        ("y", "axial"): {(1, 0)},
        ("z", "axial"): {(2, 0)},
        ("y", "torsion"): {(0, 2)},
        ("z", "torsion"): {(0, 1)},
        ("torsion", "axial"): set(),
    }
    for (one, other), places in pairs.items():
        block = modes["P"][own[one], own[other]]
        assert {tuple(int(x) for x in place[2:]) for place in np.argwhere(block)} == places, (one, other)
    bends = np.zeros(modes["K"].shape, dtype=bool)
    for key in ("y", "z"):
        bends[own[key], own[key]] = True
    assert np.all((modes["Psi"][0] != 0.0) == bends)
    assert not modes["Psi"][1:].any()
    assert np.all((modes["Q"][:, :, 0, 0] != 0.0) == bends)
    assert np.count_nonzero(modes["Q"]) == 2 * np.count_nonzero(bends)


@pytest.mark.parametrize("axis", list(AXES))
def test_other_axes_turn_all_constants(axis: str) -> None:
    plain, turned = arrays(beam_modes(BOOM)), beam_modes(replace(BOOM, axis=axis))
    found, R = arrays(turned), np.array(AXES[axis])
    assert np.array(turned.nodes[0].place) == pytest.approx(R[:, 0] * BOOM.length, rel=1e-15)
    assert np.all(found["P"] == np.einsum("ia,klab,jb->klij", R, plain["P"], R))
    assert np.all(found["H0"][:, 3] == plain["H0"][:, 3] @ R.T)
    assert np.all(found["H0"][:, :3] == np.einsum("ia,kab,jb->kij", R, plain["H0"][:, :3], R))
    assert np.all(found["Phi"] == np.vstack([R @ plain["Phi"][:3], R @ plain["Phi"][3:]]))
    assert np.all(found["Psi"] == np.einsum("ij,jkl->ikl", R, plain["Psi"]))
    assert np.all(found["Q"][:, :, :3] == np.einsum("ia,klab,jb->klij", R, plain["Q"][:, :, :3], R))
    assert np.all(found["K"] == plain["K"])


def test_damping_is_a_part_of_critical_damping() -> None:
    modes = arrays(beam_modes(BOOM, 0.02))
    critical = 2.0 * np.sqrt(np.diag(modes["K"]) * np.diag(modes["masses"]))
    assert np.diag(modes["D"]) == pytest.approx(0.02 * critical, rel=1e-14)
    assert np.count_nonzero(modes["D"]) == len(critical)


def test_what_does_not_bend_has_no_second_order() -> None:
    modes = beam_modes(replace(BOOM, modes=BeamModes(torsion=2, axial=1)))
    assert modes.nodes[0].Psi is None
    assert modes.conflict() is None
    assert beam_modes(BOOM).conflict() is None


def link_of(beam: LinkBeam) -> Link:
    """Return a link that is a beam; its mass does not matter here."""
    return Link("boom", beam.mass, (0.0, 0.0, 0.0), (0.0,) * 6, beam_modes(beam), beam)


@pytest.mark.parametrize("axis", sorted(AXES))
def test_an_axis_ends_where_its_nodes_stand(axis: str) -> None:
    link = link_of(replace(BOOM, axis=axis))
    (tip,) = link.modes.nodes
    (found,) = stations_of(link)
    assert found.places.shape == (COUNT, 3)
    np.testing.assert_array_equal(found.places[0], 0.0)
    np.testing.assert_allclose(found.places[-1], tip.place, atol=1e-15)
    np.testing.assert_allclose(found.Phi[0], 0.0, atol=1e-9)
    np.testing.assert_allclose(found.Phi[-1], tip.Phi, atol=1e-8)
    np.testing.assert_array_equal(found.Psi[0], 0.0)
    np.testing.assert_allclose(found.Psi[-1], tip.Psi, atol=1e-8)


@pytest.mark.parametrize("beam", [BOOM, STUBBY])
def test_a_force_at_the_tip_deflects_a_beam_as_in_closed_form(beam: LinkBeam) -> None:
    """All along: S. P. Timoshenko's v = F (3 L x^2 - x^3) / 6 EI + F x / kGA, and the sections' rotation."""
    modes, x = beam_modes(beam), np.linspace(0.0, beam.length, 7)
    Phi, Psi = beam_shapes(beam, x)
    e = np.linalg.solve(np.array(modes.K), np.array(modes.nodes[0].Phi)[1])
    EI, shear = beam.E * beam.Iz, beam.shear[0] * beam.G * beam.A
    v = (3.0 * beam.length * x**2 - x**3) / (6.0 * EI) + x / shear
    turn = (2.0 * beam.length * x - x**2) / (2.0 * EI)
    np.testing.assert_allclose(Phi[:, 1] @ e, v, rtol=1e-9, atol=1e-11 * v[-1])
    np.testing.assert_allclose(Phi[:, 5] @ e, turn, rtol=1e-9, atol=1e-11 * turn[-1])
    fine = np.linspace(0.0, beam.length, 20_001)
    slope = (2.0 * beam.length * fine - fine**2) / (2.0 * EI) + 1.0 / shear
    shortened = np.concatenate([[0.0], np.cumsum((slope[1:] ** 2 + slope[:-1] ** 2) / 2.0 * np.diff(fine))])
    along = np.einsum("skl,k,l->s", Psi[:, 0], e, e)
    np.testing.assert_allclose(along, -np.interp(x, fine, shortened), rtol=1e-7, atol=1e-12 * shortened[-1])


def test_between_nodes_stand_cubics_as_in_a_beam_with_two_modes() -> None:
    slender = replace(BOOM, length=5.0, axis="y", modes=BeamModes(2, 2, 1, 1))
    link = link_of(slender)
    (exact,), (cubic,) = stations_of(link), stations_of(replace(link, beam=None))
    np.testing.assert_allclose(cubic.places, exact.places, atol=1e-12)
    np.testing.assert_allclose(cubic.Phi, exact.Phi, atol=1e-3)
    np.testing.assert_allclose(cubic.Psi[[0, -1]], exact.Psi[[0, -1]], atol=1e-9)
    assert cubic.outline is None


def test_an_axis_passes_nodes_on_its_way() -> None:
    link = link_of(replace(BOOM, modes=BeamModes(2)))
    (tip,) = link.modes.nodes
    Phi, Psi = beam_shapes(replace(BOOM, modes=BeamModes(2)), [0.65])
    middle = Node("middle", (0.65, 0.0, 0.0), nested(Phi[0]), nested(Psi[0]))
    aside = Node("aside", (0.0, 0.9, 0.0), tip.Phi)
    here = Node("here", (0.0, 0.0, 0.0), tip.Phi)
    modes = replace(link.modes, nodes=(tip, middle, aside, here))
    found = {tuple(x.places[-1]): x for x in stations_of(replace(link, modes=modes, beam=None))}
    assert found.keys() == {tip.place, middle.place, aside.place}, "no way leads to what is at the root"
    np.testing.assert_array_equal(found[tip.place].places[0], middle.place)
    np.testing.assert_array_equal(found[aside.place].places[0], 0.0)
    np.testing.assert_allclose(found[tip.place].Phi[0], middle.Phi, atol=1e-12)
    first, second, third = found[tip.place].Phi[:3, 1]
    slope = (4.0 * second - 3.0 * first - third) / (2.0 * (found[tip.place].places[1, 0] - middle.place[0]))
    np.testing.assert_allclose(slope, np.array(middle.Phi)[5], rtol=0.02)
    assert stations_of(replace(link, modes=None)) == ()


@pytest.mark.parametrize(
    ("shape", "sizes", "height", "width"),
    [
        ("tube", (0.06, 0.05), 0.06, 0.06),
        ("rod", (0.03,), 0.03, 0.03),
        ("bar", (0.05, 0.002), 0.05, 0.002),
        ("box", (0.05, 0.05, 0.002), 0.05, 0.05),
        ("box", (0.08, 0.04, 0.002), 0.08, 0.04),
        ("I", (0.1, 0.06, 0.006, 0.004), 0.1, 0.06),
    ],
)
def test_outlines_are_as_large_as_sections(shape: str, sizes: tuple[float, ...], height: float, width: float) -> None:
    """Exactly where it is said, or follows from area and second moments, else nearly."""
    made = SHAPES[shape].section(sizes, 0.3)
    numbers = {key: getattr(made, key) for key in ("A", "Iy", "Iz", "J")}
    (found,) = stations_of(link_of(replace(BOOM, **numbers, modes=BeamModes(1))))
    assert found.outline is not None
    spread = np.ptp(found.outline, axis=0)
    exact = shape != "I" and sizes[0] != 0.08
    np.testing.assert_allclose(spread, [width, height], rtol=1e-9 if exact else 0.4)
    (said,) = stations_of(link_of(replace(BOOM, **numbers, modes=BeamModes(1), section=(shape, sizes))))
    assert said.outline is not None
    np.testing.assert_allclose(np.ptp(said.outline, axis=0), [width, height], rtol=1e-12)
    x, y = found.outline.T
    assert np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)) > 0.0, "anticlockwise"
