"""Where a robot's bodies are and how they move, from poses and axes alone: momenta and wrenches of many states.

All of it is analytic, so that complex steps go through.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from eomgen.robot.model import FIXED_BODY, Model
from eomgen.robot.value import LINEAR
from tests.support.random_robots import Array


@dataclass(frozen=True)
class Places:
    """The output of the kernel "kinematics" for states (..., outputs), taken apart; base axes.

    frames: rows of [R | x], (..., frames, 3, 4); origins: of the bodies, (..., bodies, 3); axes: of the coordinates,
    (..., n, 3).
    """

    model: Model
    frames: Array
    origins: Array
    axes: Array

    @classmethod
    def of(cls, model: Model, outputs: Array) -> Places:
        count = 12 * len(model.frames)
        rows = outputs[..., :count].reshape(*outputs.shape[:-1], -1, 3, 4)
        points = outputs[..., count:].reshape(*outputs.shape[:-1], -1, 3)
        return cls(model, rows, points[..., : len(model.bodies), :], points[..., len(model.bodies) :, :])

    def frame(self, name: str) -> tuple[Array, Array]:
        """Rotation (..., 3, 3) and origin (..., 3) of a frame or link."""
        rows = self.frames[..., self.model.frames.index(name), :, :]
        return rows[..., :3], rows[..., 3]

    def com(self, link: str) -> Array:
        """A link's centre of mass, (..., 3)."""
        R, x = self.frame(link)
        return np.asarray(R @ np.array(self.model.robot.link(link).com) + x)

    def twist(self, body: int, point: Array, v: Array) -> tuple[Array, Array]:
        """Velocity (..., 3) of a body's point at the rates v (..., n), and angular velocity."""
        linear, angular = np.zeros_like(point), np.zeros_like(point)
        for k in self.model.ancestors(body):
            given = self.model.bodies[k]
            for index, name in zip(given.indices, given.active, strict=True):
                rate = self.axes[..., index, :] * v[..., index, None]
                if name in LINEAR:
                    linear = linear + rate
                else:
                    linear = linear + np.cross(rate, point - self.origins[..., k, :])
                    angular = angular + rate
        return linear, angular

    def weights(self) -> Array:
        """Weight of all that moves, and its moment about the base's origin, (..., 6)."""
        total = np.zeros((*self.frames.shape[:-3], 6))
        for name in self.model.links:
            force = self.model.robot.link(name).mass * np.array(self.model.robot.gravity)
            moment = np.cross(self.com(name), force)
            total += np.concatenate([np.broadcast_to(force, moment.shape), moment], axis=-1)
        return total

    def _wrenches(self, reactions: Array) -> tuple[Array, Array]:
        """Forces and moments (..., bodies, 3) of the joints, at the bodies' origins, in base axes."""
        forces, moments = [], []
        for k, body in enumerate(self.model.bodies):
            R = self.frame(body.name)[0] @ np.array(self.model.robot.joint(body.joint).axis_turn)
            forces.append(np.einsum("...ij,...j->...i", R, reactions[..., k, :3]))
            moments.append(np.einsum("...ij,...j->...i", R, reactions[..., k, 3:]))
        return np.stack(forces, axis=-2), np.stack(moments, axis=-2)

    def carried_by_base(self, reactions: Array) -> tuple[Array, Array]:
        """Sum of the joints' wrenches next to the base about its origin, (..., 6), and of their absolute values."""
        forces, moments = self._wrenches(reactions)
        total, terms = np.zeros((*forces.shape[:-2], 6)), np.zeros((*forces.shape[:-2], 6))
        for k, body in enumerate(self.model.bodies):
            if body.parent == FIXED_BODY:
                force = forces[..., k, :]
                arm = np.cross(self.origins[..., k, :], force)
                total += np.concatenate([force, moments[..., k, :] + arm], axis=-1)
                terms += np.abs(np.concatenate([force, np.abs(moments[..., k, :]) + np.abs(arm)], axis=-1))
        return total, terms

    def along_coordinates(self, reactions: Array) -> Array:
        """Each joint's wrench along its own coordinates' axes, (..., n): N or N m."""
        forces, moments = self._wrenches(reactions)
        result = np.zeros(self.axes.shape[:-1])
        for k, body in enumerate(self.model.bodies):
            for index, name in zip(body.indices, body.active, strict=True):
                wrench = forces if name in LINEAR else moments
                result[..., index] = np.einsum("...i,...i->...", self.axes[..., index, :], wrench[..., k, :])
        return result


def momenta(model: Model, run: Callable[..., Array], q: Array, v: Array) -> Array:
    """Linear momentum and angular momentum about the base's origin of every link that moves, (..., links, 6)."""
    places, found = Places.of(model, run("kinematics", q=q)), []
    for name in model.links:
        link, R, point = model.robot.link(name), places.frame(name)[0], places.com(name)
        xx, yy, zz, xy, xz, yz = link.inertia
        tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        linear, angular = places.twist(model.body_of[name], point, v)
        spin = np.einsum("...ij,jk,...lk,...l->...i", R, tensor, R, angular)
        found.append(np.concatenate([link.mass * linear, link.mass * np.cross(point, linear) + spin], axis=-1))
    return np.stack(found, axis=-2)
