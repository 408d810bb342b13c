"""How coordinates of a robot belong together where forces are known: rigid couplings, motors, what rubs.

With rigid couplings q = G z + c, forces of coupled coordinates do work along z alone: G^T u = G^T Y theta, a row for
each coordinate that follows from no other.  So the motor of a wrist that turns with two joints acts, rubs and has its
inertia in both of their rows.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np

from ..arrays import Array, Mask
from ..errors import InputError
from ..kernel.complete import Kernel
from ..motion.files import MeasuredMotion
from ..names import joint_of, listed, nearest, show
from ..robot.coordinates import is_mode
from ..robot.model import Model, build_model
from ..robot.value import Robot
from ..runtime.internal_states import split_state

OFF = 0.05  # of the rms of a coordinate: by so much measured ones contradict a coupling


@dataclass(frozen=True)
class Relations:
    """Couplings of coordinates that the regressor of a tree leaves out.

    Attributes:
        coordinates: names of all, n of them.
        free: indices of those that follow from no others, f of them: the rows.
        matrix, offset: (n, f) and (n,), all coordinates from the free ones.
        rubbing: indices of the coordinates whose friction and offset can be sought: with a drive, or coupled rigidly.
        motors: indices of a motor's coordinate and of the one that it drives, and the gear's ratio.
        known: names of links whose inertial parameters are not sought; among them those that bend, and nodes
            that nothing is fixed to.
        sums: (f, f), what the rows of forces are sums of; None where they are those of the coordinates (``anchored``).
    """

    coordinates: tuple[str, ...]
    free: tuple[int, ...]
    matrix: Array
    offset: Array
    rubbing: tuple[int, ...]
    motors: tuple[tuple[int, int, float], ...]
    known: frozenset[str] = frozenset()
    sums: Array | None = None

    @property
    def onto(self) -> Array:
        """Forces at all coordinates to rows, (n, f): u @ onto."""
        return self.matrix if self.sums is None else np.asarray(self.matrix @ self.sums)

    @property
    def rows(self) -> tuple[str, ...]:
        """Names of the free coordinates."""
        return tuple(self.coordinates[i] for i in self.free)

    @property
    def is_coupled(self) -> bool:
        """Whether coordinates follow from others."""
        return len(self.free) < len(self.coordinates)

    def forces(self, u: Array) -> Array:
        """Return forces along the free coordinates, (..., f), of those at all, (..., n)."""
        return np.asarray(u @ self.onto) if self.is_coupled or self.sums is not None else u

    def columns(self, Y: Array) -> Array:
        """Return columns of the free coordinates' rows, (..., f, p), from (..., n, p)."""
        return np.asarray(self.onto.T @ Y) if self.is_coupled or self.sums is not None else Y

    def rows_of(self, marked: Mask) -> Mask:
        """Return rows that a marked coordinate acts in, (..., f), from (..., n)."""
        return np.asarray((marked.astype(np.float64) @ (self.onto != 0.0)) > 0.0)


def refuse_followers(robot: Robot, kernel: Kernel) -> None:
    """Raise InputError where a kernel lacks coordinates that follow others, whose forces are looked for."""
    lacking = [name for name in kernel.follower_names if joint_of(name) not in robot.nodes]
    if lacking:
        raise InputError(
            f"kernel: {listed(lacking)} of {kernel.name} is no coordinate of it; allowed: a kernel of"
            " robot.with_constraints()"
        )


def refuse_internal_states(kernel: Kernel, allowed: str) -> None:
    """Raise InputError where laws of a kernel have states, which nobody has measured; with what is allowed."""
    if kernel.internal_states:
        owners = dict.fromkeys(split_state(name)[0] for name in kernel.internal_states)
        raise InputError(f"{kernel.name}: laws of {listed(owners)} have states; allowed: {allowed}")


def relations_of(robot: Robot, known: Collection[str] = ()) -> Relations:
    """Return the relations of a robot.

    Args:
        robot: without loops and elastic couplings.
        known: names of links whose numbers are the description's.

    Raises:
        InputError: it has loops or elastic couplings, or no such link.
    """
    elastic = [coupling.name for coupling in robot.own_couplings if coupling.law is not None]
    if robot.loops or elastic:
        raise InputError(f"identify: {robot.name} has loops or elastic couplings; allowed: robots without")
    rules = {coupling.of: coupling for coupling in robot.own_couplings}
    tree = tree_relations(robot, known)
    names, n = tree.coordinates, len(tree.coordinates)
    free = tuple(i for i, name in enumerate(names) if name not in rules)
    matrix, offset = np.zeros((n, len(free))), np.zeros(n)
    matrix[list(free), range(len(free))] = 1.0
    left = set(rules)
    while left:  # couplings do not go round in a circle
        name = next(name for name in sorted(left) if not left.intersection(rules[name].to))
        i = names.index(name)
        offset[i] = rules[name].offset or 0.0
        for other, ratio in rules[name].to.items():
            matrix[i] += ratio * matrix[names.index(other)]
            offset[i] += ratio * offset[names.index(other)]
        left.remove(name)
    coupled = {names.index(name) for x in robot.own_couplings for name in (x.of, *x.to) if not is_mode(name)}
    rubbing = tuple(sorted(coupled.union(tree.rubbing)))
    return replace(tree, free=free, matrix=matrix, offset=offset, rubbing=rubbing)


def anchored(relations: Relations) -> Relations:
    """Add the row of a motor, times its ratio, to that of the joint behind it.

    The transmission's force is in both and cancels.  The joint's row, in which no drive is, would be 0 = 0 for
    parameters that are all 0, and the less noise it has the more that counts.
    """
    sums, free = np.eye(len(relations.free)), {place: row for row, place in enumerate(relations.free)}
    for rotor, joint, ratio in relations.motors:
        if rotor in free and joint in free:
            sums[free[rotor], free[joint]] = ratio
    return replace(relations, sums=sums)


def tree_relations(robot: Robot, known: Collection[str] = ()) -> Relations:
    """Return the relations of the open tree, in which no coordinate follows from others; errors as ``relations_of``."""
    model = build_model(robot)
    bodies = tuple(body.name for body in model.bodies)
    for name in known:
        if name not in bodies:
            raise InputError(
                f"known: there is no moving link {show(name)}{nearest(name, bodies)}; allowed: {listed(bodies)}"
            )
    n = len(model.coordinates)
    every, driven, motors = tuple(range(n)), tuple(model.driven), _motors(robot, model)
    nodes = robot.nodes
    bending = {x.name for x in model.bodies if x.modes or (x.name in nodes and len(x.links) == 1)}
    return Relations(model.coordinates, every, np.eye(n), np.zeros(n), driven, motors, frozenset({*known, *bending}))


def _motors(robot: Robot, model: Model) -> tuple[tuple[int, int, float], ...]:
    motors = []
    for index, principal in model.motors.items():
        motor = robot.joint(joint_of(model.coordinates[index])).motor
        assert motor is not None
        motors.append((index, principal, motor.ratio))
    return tuple(motors)


def completed(robot: Robot, motion: MeasuredMotion) -> MeasuredMotion:
    """Return the motion with the coordinates that couplings make of those that were measured.

    Raises:
        InputError: measured coordinates contradict a coupling.
    """
    measured = set(motion.measured)
    index = {name: i for i, name in enumerate(motion.coordinates)}
    q, v, a = (None if x is None else np.array(x) for x in (motion.q, motion.v, motion.a))
    assert q is not None
    open_rules = list(robot.own_couplings)
    for _ in robot.own_couplings:
        for rule in open_rules:
            terms = {rule.of: -1.0, **rule.to}
            missing = [name for name in terms if name not in measured and terms[name] != 0.0]
            if len(missing) != 1:
                continue
            known = {index[name]: ratio for name, ratio in terms.items() if name != missing[0]}
            place, factor = index[missing[0]], terms[missing[0]]
            for x, offset in ((q, rule.offset or 0.0), (v, 0.0), (a, 0.0)):
                if x is not None:
                    x[:, place] = -(x[:, list(known)] @ np.array(list(known.values())) + offset) / factor
            measured.add(missing[0])
    for rule in robot.own_couplings:
        terms = {rule.of: -1.0, **rule.to}
        if measured.issuperset(terms):
            off = q[:, [index[name] for name in terms]] @ np.array(list(terms.values())) + (rule.offset or 0.0)
            size, error = float(np.std(q[:, index[rule.of]])), float(np.sqrt(np.mean(off**2)))
            if error > OFF * size and error > 0.0:
                raise InputError(
                    f"{motion.source}: {rule.of} is off by {error:.3g} rms from what the coupling {rule.name} makes of"
                    f" {', '.join(rule.to)}, and moves by {size:.3g}: other units, or angles of motors? allowed:"
                    " coordinates as the description has them"
                )
    return replace(motion, q=q, v=v, a=a, measured=tuple(x for x in motion.coordinates if x in measured))
