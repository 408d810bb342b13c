"""An independent oracle: the equations of motion from ``sympy.physics.mechanics``, evaluated on numbers.

Nothing of eomgen but the description (``Robot``) is used: frames, points, rigid bodies and LagrangesMethod do
kinematics and dynamics their own way.  Meant for robots with up to about six coordinates.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import sympy as sp
from numpy.typing import NDArray
from sympy.physics.mechanics import (
    Inertia,
    LagrangesMethod,
    Lagrangian,
    Point,
    ReferenceFrame,
    RigidBody,
    dynamicsymbols,
)

from eomgen.robot.value import Joint, Link, Robot

Array = NDArray[np.float64]
NO_WRENCH: Mapping[str, Sequence[float]] = {}


class LagrangeOracle:
    """Equations of motion of a robot by LagrangesMethod; derived once (seconds), evaluated at any state.

    Args:
        robot: the description; fixed joints, trees, welded links and turned axes are taken as they are.
        wrenches: derive the generalized forces of external wrenches too, which takes longer.
    """

    def __init__(self, robot: Robot, wrenches: bool = False) -> None:
        self.robot = robot
        names = [f"{joint.name}_{name}" for joint in robot.joints for name in joint.coordinates]
        self.size = len(names)
        self._q = [dynamicsymbols(name) for name in names]
        self._wrenches = [sp.Symbol(f"w_{link.name}_{i}") for link in robot.links for i in range(6)] if wrenches else []
        self._derive()

    def residual(
        self,
        q: Sequence[float] | Array,
        v: Sequence[float] | Array,
        a: Sequence[float] | Array,
        u: Sequence[float] | Array,
        wrench: Mapping[str, Sequence[float]] = NO_WRENCH,
    ) -> Array:
        """M a + bias - Q_P - Q_G - Q_F - u, shape (n,), N or N m.

        Args:
            q, v, a, u: state and drives, each (n,).
            wrench: by link name, force (N) then moment (N m) about the link's centre of mass, base axes.
        """
        forcing = self._forcing(q, v, wrench)
        residual: Array = self.mass_matrix(q) @ np.asarray(a) - forcing + self._damping * np.asarray(v) - np.asarray(u)
        return residual

    def mass_matrix(self, q: Sequence[float] | Array) -> Array:
        """The mass matrix, shape (n, n)."""
        M: Array = np.reshape(np.array(self._mass(*q), dtype=float), (self.size, self.size))
        return M

    def bias_force(self, q: Sequence[float] | Array, v: Sequence[float] | Array) -> Array:
        """Coriolis and centrifugal terms, shape (n,): what v changes in the equations, damping apart."""
        return self._forcing(q, np.zeros(self.size), NO_WRENCH) - self._forcing(q, v, NO_WRENCH)

    def energy(self, q: Sequence[float] | Array, v: Sequence[float] | Array) -> tuple[float, float]:
        """Kinetic energy, and potential energy of gravity (zero at the base's origin) and springs, J."""
        kinetic, potential = self._energy(*q, *v)
        return float(kinetic), float(potential)

    def _forcing(
        self, q: Sequence[float] | Array, v: Sequence[float] | Array, wrench: Mapping[str, Sequence[float]]
    ) -> Array:
        unknown = set(wrench) - {link.name for link in self.robot.links}
        if unknown or (wrench and not self._wrenches):
            raise KeyError(f"no such link, or derived without wrenches: {sorted(wrench)}")
        numbers = [float(t) for link in self.robot.links for t in wrench.get(link.name, (0.0,) * 6)]
        return np.array(self._force(*q, *v, *numbers[: len(self._wrenches)]), dtype=float)

    def _derive(self) -> None:
        t = dynamicsymbols._t
        N, origin = ReferenceFrame("N"), Point("O")
        origin.set_vel(N, 0)
        q, qd = self._q, [s.diff(t) for s in self._q]
        bodies = self._bodies(N, origin)
        table = [given for joint in self.robot.joints for given in joint.coordinates.values()]
        self._damping = np.array([given.damping or 0.0 for given in table])
        springs = sum((given.stiffness or 0.0) * s**2 / 2 for given, s in zip(table, q, strict=True))
        rotors = sum((given.armature or 0.0) * s**2 / 2 for given, s in zip(table, qd, strict=True))
        L = Lagrangian(N, *bodies.values()) + rotors - springs
        method = LagrangesMethod(L, q, forcelist=self._forces(bodies, N), frame=N)
        method.form_lagranges_equations()
        kinetic = rotors + sum(body.kinetic_energy(N) for body in bodies.values())

        plain_q, plain_v = (sp.symbols(f"{letter}:{self.size}") for letter in "qv")
        swap = dict(zip([*qd, *q], [*plain_v, *plain_q], strict=True))

        def function(arguments: Sequence[Any], expressions: Sequence[Any]) -> Any:
            plain = [sp.sympify(e).xreplace(swap) for e in expressions]
            return sp.lambdify(arguments, plain, modules="math", cse=True)

        self._energy = function([*plain_q, *plain_v], [kinetic, kinetic - L])
        self._force = function([*plain_q, *plain_v, *self._wrenches], list(method.forcing))
        self._mass = function(plain_q, list(method.mass_matrix))

    def _forces(self, bodies: Mapping[str, RigidBody], N: ReferenceFrame) -> list[tuple[Any, Any]]:
        forces = []
        for k, link in enumerate(self.robot.links):
            if self._wrenches and link.name in bodies:
                body, w = bodies[link.name], self._wrenches[6 * k : 6 * k + 6]
                forces += [(body.masscenter, _vector(w[:3], N)), (body.frame, _vector(w[3:], N))]
        return forces

    def _bodies(self, N: ReferenceFrame, origin: Point) -> dict[str, RigidBody]:
        """Rigid bodies of the moving links, by name."""
        poses = {self.robot.base: _Pose(N, origin, np.eye(3), moves=False)}
        bodies: dict[str, RigidBody] = {}
        coordinates = iter(self._q)
        for joint in self.robot.joints:
            poses[joint.child] = _kinematics(
                joint, poses[joint.parent], N, [next(coordinates) for _ in joint.coordinates]
            )
        g = _vector(self.robot.gravity, N)
        for link in self.robot.links:
            if poses[link.name].moves:
                bodies[link.name] = _rigid_body(link, poses[link.name], N)
                bodies[link.name].potential_energy = -link.mass * bodies[link.name].masscenter.pos_from(origin).dot(g)
        return bodies


@dataclass(frozen=True)
class _Pose:
    """A link's pose: axes turned by a constant ``turn`` from ``frame``, origin at ``point``."""

    frame: ReferenceFrame
    point: Point
    turn: Array
    moves: bool


def lagrange(
    robot: Robot,
    q: Sequence[float] | Array,
    v: Sequence[float] | Array,
    a: Sequence[float] | Array,
    u: Sequence[float] | Array,
    wrench: Mapping[str, Sequence[float]] = NO_WRENCH,
) -> tuple[Array, Array]:
    """Residual (n,) and mass matrix (n, n) of a robot in one state; for many states keep a LagrangeOracle."""
    oracle = LagrangeOracle(robot, wrenches=bool(wrench))
    return oracle.residual(q, v, a, u, wrench), oracle.mass_matrix(q)


def _kinematics(joint: Joint, parent: _Pose, N: ReferenceFrame, symbols: Sequence[Any]) -> _Pose:
    """The child's pose: placement, turn of the axes, translation, then rotations about moving axes.

    Velocities are expressed in the newest axes at each step, and constant rotations are merged: long sums over all
    frames would take LagrangesMethod minutes.
    """
    q = dict(zip(joint.coordinates, symbols, strict=True))
    placed = parent.point.locatenew(f"{joint.name}_at", _vector(parent.turn @ joint.placement.xyz, parent.frame))
    placed.v2pt_theory(parent.point, N, parent.frame)
    turn = parent.turn @ np.array(joint.placement.rotation)
    if not q:
        return _Pose(parent.frame, placed, turn, parent.moves)
    frame = ReferenceFrame(f"{joint.name}_at")
    frame.orient_dcm(parent.frame, sp.Matrix((turn @ np.array(joint.axis_turn)).T))
    shift = _vector([q.get(name, 0) for name in "xyz"], frame)
    w = parent.frame.ang_vel_in(N).express(frame)
    v = placed.vel(N).express(frame) + (w ^ shift) + shift.dt(frame)
    point = placed.locatenew(f"{joint.name}_origin", shift)
    for axis, name in enumerate(("alpha", "beta", "gamma")):
        if name in q:
            turned = frame.orientnew(f"{joint.name}_{name}", "Axis", (q[name], (frame.x, frame.y, frame.z)[axis]))
            w = w.express(turned) + q[name].diff(dynamicsymbols._t) * (turned.x, turned.y, turned.z)[axis]
            v, frame = v.express(turned), turned
    frame.set_ang_vel(N, w)
    point.set_vel(N, v)
    return _Pose(frame, point, np.array(joint.axis_turn).T, moves=True)


def _rigid_body(link: Link, pose: _Pose, N: ReferenceFrame) -> RigidBody:
    com = pose.point.locatenew(f"{link.name}_com", _vector(pose.turn @ link.com, pose.frame))
    com.v2pt_theory(pose.point, N, pose.frame)
    xx, yy, zz, xy, xz, yz = link.inertia
    tensor = pose.turn @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ pose.turn.T
    scalars = (tensor[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2)))
    inertia = Inertia.from_inertia_scalars(com, pose.frame, *scalars)
    return RigidBody(link.name, com, pose.frame, link.mass, inertia)


def _vector(components: Sequence[Any] | Array, frame: ReferenceFrame) -> Any:
    x, y, z = components
    return x * frame.x + y * frame.y + z * frame.z
