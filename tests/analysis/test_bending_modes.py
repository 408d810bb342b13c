"""Modes and error budgets of robots whose links bend: finite elements of a whole robot, energies, differences."""

from __future__ import annotations

from types import MappingProxyType

import numpy as np
import pytest
from scipy.linalg import eigh

import eomgen
from eomgen.analysis import budget, modes
from eomgen.errors import InputError
from eomgen.integration.trajectory import Trajectory
from eomgen.names import joint_of, kind_of
from eomgen.robot.coordinates import index_of
from eomgen.simulation.result import SimulationResult
from tests.support.beam_elements import Plane

pytestmark = pytest.mark.usefixtures("unoptimised")

ELEMENTS, HUB, PAYLOAD = 12, (1.0, 0.1), (0.1, 0.0005)  # of each link; kg and kg m^2 of the elbow's hub and the load


def by_elements() -> np.ndarray:
    """Frequencies of flexible_arm in its plane with locked drives, Hz: its elbow is at 90 degrees.

    The upper arm bends, and the forearm, clamped to its tip, goes along with that and bends itself; neither stretches.
    """
    beam = eomgen.load_robot("flexible_arm").links[0].beam
    assert beam is not None
    along, second = beam.density * beam.A, beam.density * beam.Iz
    plane = Plane(beam.E * beam.Iz, beam.shear[0] * beam.G * beam.A, along, second, beam.length)
    M1, K1 = plane.matrices(ELEMENTS)
    rows, element = 2 * ELEMENTS, plane.element(ELEMENTS)
    M2, K2 = np.zeros((2, rows + 2, rows + 2))
    for k in range(ELEMENTS):
        at = slice(2 * k, 2 * k + 4)
        M2[at, at] += element[0]
        K2[at, at] += element[1]
    M2[-2, -2] += PAYLOAD[0]
    M2[-1, -1] += PAYLOAD[1]
    # of the forearm's root only the rotation, that of the upper arm's tip
    M, K = np.zeros((2, 2 * rows, 2 * rows))
    M[:rows, :rows], K[:rows, :rows] = M1, K1
    shared = np.arange(rows - 1, 2 * rows)
    M[np.ix_(shared, shared)] += M2[1:, 1:]
    K[np.ix_(shared, shared)] += K2[1:, 1:]
    M[rows - 2, rows - 2] += HUB[0] + along * beam.length + PAYLOAD[0]
    M[rows - 1, rows - 1] += HUB[1]
    return np.sqrt(eigh(K, M, eigvals_only=True)) / (2.0 * np.pi)


def test_assembled_frequencies_are_those_of_finite_elements() -> None:
    """Six modes: both static shapes of each link, two eigenmodes of the forearm."""
    found = modes("flexible_arm")
    assert found.frequencies[:4] == pytest.approx(by_elements()[:4], rel=1e-4)


def test_energies_say_which_link_bends() -> None:
    """Potential energy is that of modal stiffness, without gravity in the plane; rigid bodies have kinetic alone."""
    robot = eomgen.load_robot("flexible_arm")
    for drives, rigid in (("locked", 0), ("free", 2)):
        found = modes(robot, drives=drives)
        K = {
            f"{x.name}.{kind}": x.modes.K[k][k] for x in robot.links if x.modes for k, kind in enumerate(x.modes.names)
        }
        stored = np.abs(found.shapes) ** 2 * [K.get(name, 0.0) for name in found.coordinates]
        assert found.strain_energy[rigid:] == pytest.approx(
            stored[rigid:] / stored[rigid:].sum(axis=1, keepdims=True), abs=1e-9
        )
        assert not found.strain_energy[:rigid].any()
        assert found.kinetic_energy.sum(axis=1) == pytest.approx(1.0, abs=1e-12)
        by_owner = found.by_owner()
        assert list(by_owner) == ["shoulder", "upper.modes", "elbow", "forearm.modes"]
        assert sum(by_owner.values())[rigid:] == pytest.approx(1.0)
    plain = found.as_dict()["modes"][2]
    assert plain["strain_energy"]["upper.modes"] == pytest.approx(by_owner["upper.modes"][2])
    assert "upper.modes 100 %" in found.lines()[5]
    assert "elbow 100 %" in found.lines()[3]
    with pytest.raises(InputError, match="energy: 'potential'; allowed: strain_energy, kinetic_energy"):
        found.by_owner("potential")


def test_a_budget_has_links_that_bend() -> None:
    """Contributions of modes are first differences of poses; those of a link stand apart from those of its joint."""
    robot = eomgen.load_robot("flexible_arm")
    kernel = eomgen.build(robot, kernels=("kinematics",))
    names, t = kernel.coordinates, np.linspace(0.0, 1.0, 21)
    driven = ("shoulder.gamma", "elbow.gamma")
    left = []
    for size in (1e-3, 5e-4):
        rng, program = np.random.default_rng(0), np.zeros((21, len(names)))
        program[:, index_of(names, driven)] = np.sin(np.outer(t, [0.5, 0.9]))
        q = program + size * np.cos(np.outer(t, rng.uniform(1.0, 5.0, len(names))))
        pose, ideal = (np.asarray(kernel.frame_pose(x, "tcp")) for x in (q, program))
        result = SimulationResult(
            robot=robot.name,
            trajectory=Trajectory(t, q, 0 * q, 0 * q, np.zeros((21, 2)), names, "none"),
            program_coordinates=driven,
            program_q=program[:, index_of(names, driven)],
            tool="tcp",
            pose=pose,
            program_pose=ideal,
            notes=(),
            versions=MappingProxyType({}),
        )
        found = budget(result, robot, kernel=kernel)
        left.append(np.abs(found.remainder).max())
        for k, name in enumerate(names):
            if kind_of(name).startswith("mode"):
                off = np.zeros_like(q)
                off[:, k] = (q - program)[:, k]
                ends = [np.asarray(kernel.frame_pose(program + 0.5 * sense * off, "tcp")) for sense in (1.0, -1.0)]
                moved = (ends[0] - ends[1])[:, :3, 3]
                assert found.contributions[:, k, :3] == pytest.approx(moved, rel=2e-5, abs=1e-12), name
        by_owner = found.joints()
        for owner, own in (("upper.modes", "upper"), ("forearm.modes", "forearm")):
            columns = [k for k, name in enumerate(names) if joint_of(name) == own]
            assert by_owner[owner] == pytest.approx(found.contributions[:, columns].sum(axis=1))
        assert sum(by_owner.values()) + found.remainder == pytest.approx(found.deviation, abs=1e-15)
        assert sum(row.share for row in found.table("displacement", "joint")) == pytest.approx(1.0)
    assert left[1] == pytest.approx(0.25 * left[0], rel=0.05)
