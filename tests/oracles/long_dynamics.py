"""An independent oracle: equations of motion of trees at 60 digits, from the numbers of the description.

Nothing of eomgen but the description (``Robot``) is used: Newton-Euler's equations of every link in the base frame,
velocities and accelerations link by link, joint forces by projecting the wrenches of all links behind a coordinate.
Nothing is merged, regrouped or left out.  Of force laws there are linear springs, dampers and gears.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import mpmath

from eomgen.robot.value import Joint, Link, Robot

DIGITS = 60
mp = mpmath.MPContext()
mp.dps = DIGITS
AXES = {"x": 0, "y": 1, "z": 2, "alpha": 0, "beta": 1, "gamma": 2}
LINEAR = {"stiffness", "damping", "armature", "inertia", "ratio"}  # numbers of laws that are known here
Vector = list[Any]
Matrix = list[list[Any]]


def _add(*vectors: Sequence[Any]) -> Vector:
    return [sum(parts[1:], parts[0]) for parts in zip(*vectors, strict=True)]


def _scaled(x: Sequence[Any], by: Any) -> Vector:
    return [component * by for component in x]


def _cross(x: Sequence[Any], y: Sequence[Any]) -> Vector:
    return [x[1] * y[2] - x[2] * y[1], x[2] * y[0] - x[0] * y[2], x[0] * y[1] - x[1] * y[0]]


def _dot(x: Sequence[Any], y: Sequence[Any]) -> Any:
    return x[0] * y[0] + x[1] * y[1] + x[2] * y[2]


def _times(R: Sequence[Sequence[Any]], x: Sequence[Any]) -> Vector:
    return [_dot(row, x) for row in R]


def _product(A: Sequence[Sequence[Any]], B: Sequence[Sequence[Any]]) -> Matrix:
    columns = list(zip(*B, strict=True))
    return [[_dot(row, column) for column in columns] for row in A]


def _about(axis: int, angle: Any) -> Matrix:
    c, s = mp.cos(angle), mp.sin(angle)
    j, k = (axis + 1) % 3, (axis + 2) % 3
    R = [[mp.mpf(i == m) for m in range(3)] for i in range(3)]
    R[j][j], R[j][k], R[k][j], R[k][k] = c, -s, s, c
    return R


def _long(numbers: Any) -> Any:
    return [_long(x) for x in numbers] if isinstance(numbers, (tuple, list)) else mp.mpf(numbers)


@dataclass(frozen=True)
class _Axis:
    """A coordinate: its place in q, its direction, the point that an angle's axis goes through (None of a length)."""

    place: int
    direction: Vector
    point: Vector | None

    def work(self, force: Vector, moment: Vector, at: Vector) -> Any:
        """Project a wrench about a point on the coordinate."""
        if self.point is None:
            return _dot(self.direction, force)
        lever = _add(at, _scaled(self.point, -1))
        return _dot(self.direction, _add(moment, _cross(lever, force)))


@dataclass
class _State:
    """A frame's rotation, origin, angular and linear velocity and acceleration, and the coordinates in front of it."""

    R: Matrix
    p: Vector
    w: Vector
    v: Vector
    dw: Vector
    a: Vector
    axes: tuple[_Axis, ...]

    def shifted(self, r: Vector) -> None:
        """Move the origin by r, base axes, which is fixed in the frame."""
        self.a = _add(self.a, _cross(self.dw, r), _cross(self.w, _cross(self.w, r)))
        self.v = _add(self.v, _cross(self.w, r))
        self.p = _add(self.p, r)


class LongDynamics:
    """Equations of motion of a tree at 60 digits; arrays are lists of numbers in the order of q."""

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self.names = [f"{j.name}.{name}" for j in robot.joints for name in j.all_coordinates]
        self.places = {name: place for place, name in enumerate(self.names)}
        for joint in robot.joints:
            given = {key: law.numbers() for key, law in joint.coordinates.items()}
            given |= {"motor": joint.motor.numbers()} if joint.motor else {}
            for key, numbers in given.items():
                unknown = {name for name, value in numbers.items() if value} - LINEAR
                assert not unknown, f"{joint.name}.{key}: {unknown} is not known here"
        assert not [*robot.loops, *robot.springs, *robot.elements, *robot.couplings]

    def inverse_dynamics(self, q: Sequence[Any], v: Sequence[Any], a: Sequence[Any]) -> Vector:
        """Return the drives of a motion: M a + bias - generalized forces."""
        q, v, a = (_long(list(map(float, x))) for x in (q, v, a))
        found = self._inertial(q, v, a, _long(self.robot.gravity))
        for joint in self.robot.joints:
            for name, law in joint.coordinates.items():
                i = self.places[f"{joint.name}.{name}"]
                found[i] += q[i] * mp.mpf(law.stiffness or 0.0) + v[i] * mp.mpf(law.damping or 0.0)
                found[i] += a[i] * mp.mpf(law.armature or 0.0)
            if joint.motor is not None:
                principal = "gamma" if joint.type == "revolute" else "z"
                i, k = self.places[f"{joint.name}.{principal}"], self.places[f"{joint.name}.motor"]
                ratio, law = mp.mpf(joint.motor.ratio), joint.motor.transmission
                force = (q[k] / ratio - q[i]) * mp.mpf(law.stiffness or 0.0)
                force += (v[k] / ratio - v[i]) * mp.mpf(law.damping or 0.0)
                found[i] -= force
                found[k] += force / ratio + a[k] * mp.mpf(joint.motor.inertia)
        return found

    def gravity(self, q: Sequence[Any]) -> Vector:
        """Return the forces that hold the links' weight."""
        still = [mp.mpf(0)] * len(self.names)
        return self._inertial(_long(list(map(float, q))), still, still, _long(self.robot.gravity))

    def mass_matrix(self, q: Sequence[Any]) -> Vector:
        """Return the mass matrix, row by row."""
        n = len(self.names)
        long, still, none = _long(list(map(float, q))), [mp.mpf(0)] * n, [mp.mpf(0)] * 3
        columns = []
        for j in range(n):
            columns.append(self._inertial(long, still, [mp.mpf(i == j) for i in range(n)], none))
        laws = [law for joint in self.robot.joints for law in joint.all_coordinates.values()]
        for j, law in enumerate(laws):
            columns[j][j] += mp.mpf(law.armature or 0.0)
        return [columns[j][i] for i in range(n) for j in range(n)]

    def _inertial(self, q: Vector, v: Vector, a: Vector, gravity: Vector) -> Vector:
        """Return forces of the links' inertia and weight, (n,)."""
        zero = [mp.mpf(0)] * 3
        unit = [[mp.mpf(i == k) for k in range(3)] for i in range(3)]
        states = {self.robot.base: _State(unit, zero, zero, zero, zero, zero, ())}
        for joint in self.robot.joints:
            states[joint.child] = self._moved(joint, states[joint.parent], q, v, a)
        found = [mp.mpf(0)] * len(self.names)
        for link in self.robot.links:
            state = states[link.name]
            force, moment, com = _wrench(link, state, gravity)
            for axis in state.axes:
                found[axis.place] += axis.work(force, moment, com)
        return found

    def _moved(self, joint: Joint, parent: _State, q: Vector, v: Vector, a: Vector) -> _State:
        """Return the state of a joint's child: placement, turned axes, translations, then rotations."""
        state = _State(parent.R, parent.p, parent.w, parent.v, parent.dw, parent.a, parent.axes)
        state.shifted(_times(state.R, _long(joint.placement.xyz)))
        state.R = _product(_product(state.R, _placed(joint)), _long(joint.axis_turn))
        offsets = dict(zip(AXES, joint.offset, strict=True))
        for name, axis in AXES.items():
            i = self.places.get(f"{joint.name}.{name}")
            value = mp.mpf(offsets[name] or 0.0) + (q[i] if i is not None else 0)
            rate, second = (v[i], a[i]) if i is not None else (mp.mpf(0), mp.mpf(0))
            n = [row[axis] for row in state.R]
            if name in ("x", "y", "z"):
                state.shifted(_scaled(n, value))
                state.a = _add(state.a, _scaled(n, second), _scaled(_cross(state.w, n), 2 * rate))
                state.v = _add(state.v, _scaled(n, rate))
            else:
                state.dw = _add(state.dw, _scaled(n, second), _scaled(_cross(state.w, n), rate))
                state.w = _add(state.w, _scaled(n, rate))
                state.R = _product(state.R, _about(axis, value))
            if i is not None:
                state.axes = (*state.axes, _Axis(i, n, None if name in ("x", "y", "z") else state.p))
        state.R = _product(state.R, [list(row) for row in zip(*_long(joint.axis_turn), strict=True)])
        return state


def _placed(joint: Joint) -> Matrix:
    """Return the rotation of a placement: of its three angles, where the description has them."""
    if joint.placement.rpy is None:
        return _long(joint.placement.rotation)
    roll, pitch, yaw = _long(joint.placement.rpy)
    return _product(_product(_about(2, yaw), _about(1, pitch)), _about(0, roll))


def _wrench(link: Link, state: _State, gravity: Vector) -> tuple[Vector, Vector, Vector]:
    """Return force and moment about the centre of mass that a link's motion takes, less its weight, and that centre."""
    r = _times(state.R, _long(link.com))
    acceleration = _add(state.a, _cross(state.dw, r), _cross(state.w, _cross(state.w, r)))
    force = _scaled(_add(acceleration, _scaled(gravity, -1)), mp.mpf(link.mass))
    xx, yy, zz, xy, xz, yz = _long(link.inertia)
    tensor = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]
    inertia = _product(_product(state.R, tensor), [list(row) for row in zip(*state.R, strict=True)])
    moment = _add(_times(inertia, state.dw), _cross(state.w, _times(inertia, state.w)))
    return force, moment, _add(state.p, r)


def evaluated(robot: Robot, kernel: str, arrays: Mapping[str, Sequence[float]]) -> Vector:
    """Return a kernel's outputs of one state, flat."""
    oracle = LongDynamics(robot)
    reads = {"inverse_dynamics": "qva", "gravity": "q", "mass_matrix": "q"}[kernel]
    found: Vector = getattr(oracle, kernel)(*(arrays[name] for name in reads))
    return found
