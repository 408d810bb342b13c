"""Beams of segments against Timoshenko's continuous beam: statics of the tip, exact for any number, and frequencies."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

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
