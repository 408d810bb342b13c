"""Stations of links that bend: exact deflections along beams, cubics elsewhere, outlines of sections."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from eomgen.bending.beam import beam_modes, beam_shapes
from eomgen.bending.beams.stations import COUNT, stations_of
from eomgen.robot.sections import SHAPES
from eomgen.robot.value import AXES, Link, Node
from eomgen.robot.value.link_beam import BeamModes, LinkBeam
from tests.support.bending_links import nested

pytestmark = pytest.mark.quick

BOOM = LinkBeam(1.3, 7e10, 2.6e10, 4e-4, 2e-8, 5e-8, 3e-8, (0.85, 0.8), 2700.0, BeamModes(5, 4, 3, 2))
STUBBY = replace(BOOM, length=0.05)  # shears more than it bends


def link_of(beam: LinkBeam) -> Link:
    """Return a link that is a beam; its mass does not matter here."""
    return Link("boom", beam.mass, (0.0, 0.0, 0.0), (0.0,) * 6, beam_modes(beam), beam)


@pytest.mark.parametrize("axis", sorted(AXES))
def test_an_axis_ends_where_its_nodes_stand(axis: str) -> None:
    link = link_of(replace(BOOM, axis=axis))
    assert link.modes is not None
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
    assert link.modes is not None
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
