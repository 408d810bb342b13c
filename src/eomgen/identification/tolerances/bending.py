"""The exact model of a robot whose links bend: static equilibria of compiled equations, whose numbers are off.

A beam's E is off together with its G, so that Poisson's ratio stays: its mode shapes stay, too, and the stiffness of
all its modes is off by one factor.  A density that is off is a weight along the beam; at the tip that does what half
of it at each end does, with the moments of a beam that is clamped at both (E. Betti: shapes by loads at the tip are
modes).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from ...analysis.at_rest import rest
from ...analysis.options import HeldRobot, prepared
from ...arrays import Array, Index
from ...errors import InputError
from ...names import listed, parameter_name
from ...progress import StageReport
from ...robot.coordinates import UNITS
from ...robot.value import AXES, COORDINATES, LINEAR, Link, Robot, node_link
from ..geometry.rotations import vectors_of
from .contributions import Contribution

_TIP = "tip"
_MODULUS, _DENSITY, _OFFSET = "E", "density", "offset"


@dataclass(frozen=True)
class BendingExact:
    """The exact model of a tool at N poses of a robot whose links bend: what K contributions do to it.

    arm: the robot with drives that are locked.  q: poses of all coordinates, (N, n).  wrench: on the tool, (6,), N and
    N m, base frame.
    """

    arm: HeldRobot
    frame: str
    q: Array
    wrench: Array | None
    contributions: tuple[Contribution, ...]

    @property
    def robot(self) -> Robot:
        """The robot as it is described."""
        return self.arm.robot

    def poses(self, y: Array, chosen: Index) -> tuple[Array, Array]:
        """Return rotation (M, 3, 3) and position (M, 3), m, of the tool, with deviations (K, M), at poses chosen."""
        found = np.array([self._pose(off, int(k)) for off, k in zip(y.T, chosen, strict=True)]).reshape(-1, 4, 4)
        return found[:, :3, :3], found[:, :3, 3]

    def motions(self, y: Array, chosen: Index) -> Array:
        """Return the displacement (m) and rotation vector (rad) of the tool, (M, 6), base frame."""
        which, places = np.unique(chosen, return_inverse=True)
        R0, p0 = self.poses(np.zeros((len(self.contributions), len(which))), which)
        R, p = self.poses(y, chosen)
        return np.hstack([p - p0[places], vectors_of(R @ R0[places].transpose(0, 2, 1))])

    def sensitivities(self, sizes: Array) -> Array:
        """Return the motion of the tool per unit of every contribution, (N, 6, K), by central differences."""
        count, everywhere = len(self.contributions), np.arange(len(self.q))
        sensitivities = np.empty((len(self.q), 6, count))
        for k, one in enumerate(self.contributions):
            y = np.zeros((count, len(self.q)))
            y[k] = step = 1e-2 * sizes[k] if sizes[k] > 0.0 else 1e-6 * (one.described or 1.0)
            sensitivities[:, :, k] = (self.motions(y, everywhere) - self.motions(-y, everywhere)) / (2.0 * step)
        return sensitivities

    def _pose(self, off: Array, k: int) -> Array:
        """Return the tool's pose, (4, 4), in the equilibrium at a pose with deviations, (K,)."""
        kernel, loads = self.arm.kernel, dict(self.arm.loads)
        if self.wrench is not None:
            loads[self.frame] = self.wrench
        values: dict[str, float] = {}
        for one, change in zip(self.contributions, off.tolist(), strict=True):
            _, owner, *key = one.name.split(".")
            if key == ["beam", _MODULUS] and one.described:
                factor = 1.0 + change / one.described
                for name in _stiffness_of(self.robot.link(owner)):
                    values[name] = factor * values.get(name, kernel.parameters[name])
            elif key == ["beam", _DENSITY] and one.described:
                for name, wrench in self._weight(self.robot.link(owner), change / one.described, self.q[k]).items():
                    loads[name] = loads.get(name, 0.0) + wrench
            else:
                values[one.name] = values.get(one.name, kernel.parameters[one.name]) + change
        kernel = kernel.replaced(parameters=values) if values else kernel
        state = rest(kernel, self.q[k], self.arm.fixation, loads)
        return np.asarray(kernel.frame_pose(state.q, self.frame))

    def _weight(self, link: Link, part: float, q: Array) -> Mapping[str, Array]:
        """Return what a part of a beam's weight does at its ends, (6,) each, N and N m, base frame."""
        kernel, beam = self.arm.kernel, link.beam
        assert beam is not None
        along = np.asarray(kernel.frame_pose(q, link.name))[:3, :3] @ np.array(AXES[beam.axis])[:, 0]
        gravity = np.array([kernel.parameters[parameter_name("gravity", axis)] for axis in "xyz"])
        half = 0.5 * part * beam.mass * gravity
        moment = beam.length / 6.0 * np.cross(along, half)
        return {
            link.name: np.concatenate([half, moment]),
            node_link(link.name, _TIP): np.concatenate([half, -moment]),
        }


def bending_exact(
    robot: Robot, frame: str, places: tuple[tuple[str, ...], Array], wrench: Array | None, report: StageReport
) -> BendingExact:
    """Return the exact model of a robot whose links bend, without contributions.

    Args:
        robot: a tree.
        frame: to look at.
        places: names of coordinates, and their values at the poses, (N, names); others are at home.
        wrench: on the frame, (6,), base frame.
        report: told when the equations are built.

    Raises:
        InputError: the robot has loops.
    """
    if robot.loops:
        bent = next(link.name for link in robot.links if link.modes is not None)
        message = f"tolerances of links that bend are known of trees, and loops.{robot.loops[0].name} closes a loop"
        raise InputError(f"links.{bent}.modes: {message}; allowed: robots without loops, or Robot.rigid()")
    moving = [joint.name for joint in robot.joints if joint.coordinates and joint.name not in robot.nodes]
    offsets = [parameter_name("joints", name, _OFFSET, kind) for name in moving for kind in COORDINATES]
    arm = prepared(replace(robot, tunable=tuple(dict.fromkeys((*robot.tunable, *offsets)))), report)
    names, values = places
    home = np.array([arm.coordinates(dict(zip(names, row, strict=True))) for row in values.tolist()])
    return BendingExact(replace(arm, robot=robot), frame, home, wrench, ())


def contributions_of_bending(exact: BendingExact) -> dict[str, Contribution]:
    """Return all that a table may name: offsets, stiffness of joints and modes, E and density of beams."""
    found = dict[str, Contribution]()
    for name, value in exact.arm.kernel.parameters.items():
        kind, owner, *key = name.split(".")
        if kind == "links" and key[:1] == ["modes"] and key[-1] == "stiffness":
            found[name] = Contribution(name, "J", value, (), True)
        elif kind == "joints" and owner not in exact.robot.nodes and key[0] == _OFFSET:
            found[name] = Contribution(name, UNITS[key[1]], value, ())
        elif kind == "joints" and key[0] in UNITS and key[1:] == ["stiffness"] and value > 0.0:
            found[name] = Contribution(name, "N/m" if key[0] in LINEAR else "N m/rad", value, (), True)
    for link in exact.robot.links:
        if link.beam is not None:
            beam = parameter_name("links", link.name, "beam")
            name, other = parameter_name(beam, _MODULUS), parameter_name(beam, _DENSITY)
            found[name] = Contribution(name, "N/m^2", link.beam.E, (), True)
            found[other] = Contribution(other, "kg/m^3", link.beam.density, ())
    return found


def refused_of_bending(robot: Robot) -> dict[str, str]:
    """Return names of a beam that a table may not name, each with the reason and what to name instead."""
    found = dict[str, str]()
    for link in robot.links:
        if link.beam is None:
            continue
        beam, counts = parameter_name("links", link.name, "beam"), link.beam.modes.counts
        stiffness, before = _stiffness_of(link), counts["y"] + counts["z"]
        twist = stiffness[before : before + counts["torsion"]]
        alone = f"{listed(twist)}, in proportion to G alone" if twist else stiffness[0]
        found[parameter_name(beam, "G")] = (
            f"goes with E, so that modes keep their shapes; allowed: {beam}.E, or {alone}"
        )
    return found


def _stiffness_of(link: Link) -> list[str]:
    """Name the parameters that are the stiffness of a link's modes."""
    count = 0 if link.modes is None else link.modes.count
    return [parameter_name("links", link.name, "modes", str(k + 1), "stiffness") for k in range(count)]
