"""Springs between points written once more: Pinocchio's points and Jacobians, laws with branches; and random ones."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
from scipy.integrate import quad
from scipy.interpolate import PchipInterpolator

import eomgen
from eomgen.robot.model import build_model
from eomgen.robot.value import Robot, Spring
from tests.oracles.pinocchio_models import PinocchioOracle
from tests.support.optional import OptionalModule
from tests.support.random_robots import Array

pin = OptionalModule("pinocchio")


def pulled(spring: Spring, length: float, rate: float) -> float:
    """Tension, N."""
    e, k, c = length - (spring.free_length or 0.0), spring.stiffness or 0.0, spring.damping or 0.0
    if spring.tension_only:
        w = spring.smoothing
        assert w is not None
        if e <= 0.0:
            return 0.0
        d, slope = (e * e / (2.0 * w), e / w) if e < w else (e - w / 2.0, 1.0)
        return max(0.0, k * d + c * slope * rate)
    if spring.curve is not None:
        x, y = (np.array(column) for column in zip(*spring.curve, strict=True))
        found, at = PchipInterpolator(x, y), float(np.clip(e, x[0], x[-1]))
        return float(found(at) + found(at, 1) * (e - at)) + c * rate
    return k * e + c * rate


def stored(spring: Spring, length: float) -> float:
    """Elastic energy by quadrature from the free length on, J."""
    rest = spring.free_length or 0.0
    places = [rest + x for x, _ in spring.curve or ()]
    if spring.smoothing is not None:
        places.append(rest + spring.smoothing)
    low, high = sorted((rest, length))
    edges = [low, *sorted(x for x in places if low < x < high), high]
    total = sum(quad(lambda x: pulled(spring, x, 0.0), a, b, epsabs=1e-13, epsrel=1e-12)[0] for a, b in pairwise(edges))
    return total if length >= rest else -total


class SpringOracle:
    """Pinocchio for the bodies and where points are; the springs are forces from outside."""

    def __init__(self, robot: Robot) -> None:
        self.bodies, self.springs = PinocchioOracle(replace(robot, springs=())), robot.springs
        self.tree = build_model(robot)
        self.moving = [joint for joint in robot.joints if joint.coordinates]

    def _points(self, q: Array, spring: Spring) -> list[tuple[int, Array, Array]]:
        """Per end Pinocchio's joint, position in the base, and Jacobian (3, n) in base axes."""
        model, data, found = self.bodies.model, self.bodies.data, []
        pin.computeJointJacobians(model, data, q)
        pin.updateFramePlacements(model, data)
        for link, point in zip(spring.links, spring.points, strict=True):
            number = [frame.name for frame in model.frames].index(link)
            at, pose = model.frames[number].parentJoint, model.frames[number].placement
            local = pose * np.array(point)
            if at == 0:
                found.append((0, local, np.zeros((3, len(q)))))
                continue
            J = pin.getFrameJacobian(model, data, at, pin.SE3(np.eye(3), local), pin.LOCAL_WORLD_ALIGNED)
            found.append((at, data.oMi[at] * local, np.array(J).reshape(6, len(q))[:3]))
        return found

    def forces(self, q: Array, v: Array) -> Array:
        """Length and tension of every spring."""
        return np.array([self._line(q, v, spring)[:2] for spring in self.springs])

    def _line(self, q: Array, v: Array, spring: Spring) -> tuple[float, float, Array, list[tuple[int, Array, Array]]]:
        ends = self._points(q, spring)
        d = ends[1][1] - ends[0][1]
        length = float(np.linalg.norm(d))
        n = d / length
        rate = float(n @ (ends[1][2] - ends[0][2]) @ v)
        return length, pulled(spring, length, rate), n, ends

    def jacobian(self, q: Array) -> Array:
        rows = []
        for spring in self.springs:
            _, _, n, ends = self._line(q, np.zeros_like(q), spring)
            rows.append(n @ (ends[1][2] - ends[0][2]))
        return np.array(rows)

    def stiffness(self, q: Array) -> Array:
        """Sum of k D^T D, D of the vector between both points: of a curve its steepest piece counts, of a cable k.

        What moves both points only turns the vector.
        """
        total = np.zeros((len(q), len(q)))
        for spring in self.springs:
            ends = self._points(q, spring)
            D = ends[1][2] - ends[0][2]
            first, second = (set(self.tree.ancestors(self.tree.body_of[link])) for link in spring.links)
            for body in first & second:
                D[:, self.tree.bodies[body].indices] = 0.0
            k = spring.stiffness or 0.0
            for (x, low), (y, high) in pairwise(spring.curve or ()):
                k = max(k, (high - low) / (y - x))
            total += k * D.T @ D
        return total

    def external(self, q: Array, v: Array) -> Array:
        """Generalized force of all springs."""
        total = np.zeros(len(q))
        for spring in self.springs:
            _, T, n, ends = self._line(q, v, spring)
            total += ends[0][2].T @ (T * n) - ends[1][2].T @ (T * n)
        return total

    def inverse_dynamics(self, q: Array, v: Array, a: Array) -> Array:
        return np.asarray(self.bodies.inverse_dynamics(q, v, a) - self.external(q, v))

    def generalized_force(self, q: Array, v: Array) -> Array:
        return np.asarray(self.bodies.generalized_force(q, v) + self.external(q, v))

    def forward_dynamics(self, q: Array, v: Array, u: Array) -> Array:
        return np.asarray(self.bodies.forward_dynamics(q, v, u + self.external(q, v)))

    def energy(self, q: Array, v: Array) -> Array:
        found = np.array(self.bodies.energy(q, v))
        lengths = [self._line(q, v, spring)[0] for spring in self.springs]
        found[1] += sum(stored(spring, length) for spring, length in zip(self.springs, lengths, strict=True))
        return found

    def wrenches(self, q: Array, v: Array) -> list[pin.Force]:
        """What the springs exert on Pinocchio's joints, in their frames."""
        data = self.bodies.data
        wrenches = [pin.Force.Zero() for _ in range(self.bodies.model.njoints)]
        for spring in self.springs:
            _, T, n, ends = self._line(q, v, spring)
            for (at, point, _), sign in zip(ends, (1.0, -1.0), strict=True):
                force = sign * T * n
                in_base = pin.Force(force, np.cross(point, force))
                wrenches[at] = wrenches[at] + data.oMi[at].actInv(in_base)
        return wrenches

    def reactions(self, q: Array, v: Array, a: Array) -> Array:
        """Pinocchio's inverse dynamics with the springs as external wrenches on its joints; (joints, 6).

        In the axes and at the origin behind the joint, its offsets included.
        """
        model, data, wrenches = self.bodies.model, self.bodies.data, self.wrenches(q, v)
        pin.rnea(model, data, q, v, a, wrenches)
        found = []
        for at, joint in zip(self.bodies.last, self.moving, strict=True):
            number = [frame.name for frame in model.frames].index(joint.child)
            behind = model.frames[number].placement * pin.SE3(np.array(joint.axis_turn), np.zeros(3))
            found.append(behind.actInv(data.f[at]).vector)
        return np.array(found)


def implicit_step(
    robot: Robot, kernel: eomgen.Kernel, q: Array, v: Array, u: Array, dt: float, given: Array | None = None
) -> Array:
    """Accelerations of the formula, with the whole matrix; where ``given``, u is one."""
    k, b = (np.array([getattr(c, key) or 0.0 for j in robot.joints for c in j.coordinates.values()])
            for key in ("stiffness", "damping"))  # fmt: skip
    A = kernel.mass_matrix(q) + np.diag(dt * b + dt * dt * k)
    right = u - kernel.bias_force(q, v) + kernel.generalized_force(q, v) - dt * k * v
    arms, pairs = kernel.functions.spring_jacobian(q), kernel.functions.spring_forces(q, v)
    for spring, arm, (length, now) in zip(robot.springs, arms, pairs, strict=True):
        rate, h = float(arm @ v), 1e-6
        e = length + dt * rate
        ahead = pulled(spring, e, rate)
        by_e = (pulled(spring, e + h, rate) - pulled(spring, e - h, rate)) / (2 * h)
        by_rate = (pulled(spring, e, rate + h) - pulled(spring, e, rate - h)) / (2 * h)
        right -= arm * (ahead - now)
        A += max(dt * by_rate + dt * dt * by_e, 0.0) * np.outer(arm, arm)
    if given is None:
        return np.asarray(np.linalg.solve(A, right))
    free, a = ~given, np.array(u)
    a[free] = np.linalg.solve(A[np.ix_(free, free)], right[free] - A[np.ix_(free, given)] @ u[given])
    return a
