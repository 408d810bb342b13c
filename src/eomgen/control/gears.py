"""Elastic gears from their forces: deflections by inverse springs, and with dampers by stable filters.

Of a gear, f = phi(e) + d e' is the force that it transmits in the deflection e = motor / ratio - principal coordinate.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..arrays import Array, Index, Mask
from ..codegen.kernels.groups import GEARS
from ..errors import InputError
from ..kernel.complete import Kernel
from ..pipeline.building import build
from ..robot.coordinates import force_unit_of
from ..robot.value import PRINCIPAL, Coordinate, Joint, Link, Motor, Robot

LINEAR = {"stiffness", "damping", "preload"}  # numbers of springs that are straight lines
TRIES = 200  # of Newton's method, bisection and steps outwards together
CLOSE = 1e-9  # of the largest force, by which that of a spring is the one that is wanted
FLAT = 1e-9  # of the steepest slope of a spring, below which it is none
FARTHEST = 1e9  # m or rad
JUMPS = 1e-6  # of the largest velocity: less is no jump
FINER = 2  # steps of filters between two samples
NODES = np.array([(4.0 - 6.0**0.5) / 10.0, (4.0 + 6.0**0.5) / 10.0, 1.0])  # of Radau's method of order 5
STAGES = (np.vander(NODES, 4, increasing=True)[:, 1:] / [1, 2, 3]) @ np.linalg.inv(np.vander(NODES, increasing=True))


@dataclass(frozen=True, eq=False)
class Gears:
    """Transmissions of a robot's motors, g of them.

    Attributes:
        names: of the motors' coordinates, (g,).
        joints: whose they are, (g,).
        ratios: rad of the motor per rad or m of the joint, (g,).
        damping: d, N s/m or N m s/rad, of the joint's side, (g,).
        linear: which springs are straight lines, (g,).
        kernel: whose coordinates are the deflections, and whose generalized forces what the gears transmit.
    """

    names: tuple[str, ...]
    joints: tuple[Joint, ...]
    ratios: Array
    damping: Array
    linear: Mask
    kernel: Kernel

    @property
    def motors(self) -> tuple[Motor, ...]:
        """The motors behind them, (g,)."""
        return tuple(joint.motor for joint in self.joints if joint.motor is not None)

    @property
    def damped(self) -> Mask:
        """Which have a damper beside the spring, (g,)."""
        return np.asarray(self.damping > 0.0)

    def springs(self, e: Array) -> tuple[Array, Array, Array]:
        """Return the springs' forces phi at deflections, (..., g), with the first and second derivatives by these."""
        e = np.ascontiguousarray(e)
        ones, zeros = np.ones_like(e), np.zeros_like(e)
        phi, slope, curvature = self.kernel.jet(self.kernel.generalized_force, (e, ones, zeros, zeros), 2)
        return -phi - self.damping, -slope, -curvature

    @cached_property
    def stiffness(self) -> Array:
        """Slopes of the springs where they are not deflected, (g,)."""
        return self.springs(np.zeros(len(self.names)))[1]

    def unit(self, gear: int) -> str:
        """Return the unit of what a gear transmits to its joint: N or N m."""
        return force_unit_of(principal_of(self.joints[gear]))

    def wound(self, force: Array, t: Array) -> Array:
        """Return the deflections at which springs have these forces, (T, g) at times (T,); of zero slope refused.

        Raises:
            InputError: a spring that has such a force nowhere, or does not hold there: its force is no flat output.
        """
        preload = self.springs(np.zeros(len(self.names)))[0]
        steepest = np.maximum(np.abs(self.stiffness), np.finfo(float).tiny)
        with np.errstate(all="ignore"):
            e = np.where(self.stiffness > 0.0, (force - preload) / self.stiffness, 0.0)
        largest = np.abs(force).max(axis=0) + np.abs(preload)
        low, high = np.full(e.shape, -np.inf), np.full(e.shape, np.inf)
        moving = np.ones(e.shape, dtype=bool)
        for _ in range(TRIES):
            phi, slope, _ = self.springs(e)
            off = phi - force
            steepest = np.maximum(steepest, np.abs(slope).max(axis=0))
            low, high = np.where(off < 0.0, np.maximum(low, e), low), np.where(off > 0.0, np.minimum(high, e), high)
            with np.errstate(all="ignore"):
                trial = e - off / slope
                middle = 0.5 * (low + high)
                outwards = e - np.sign(off) * (np.abs(e) + np.abs(off) / steepest)
            trial = np.where((slope > 0.0) & (trial > low) & (trial < high), trial, middle)
            trial = np.clip(np.where(np.isfinite(trial), trial, outwards), -FARTHEST, FARTHEST)
            moving &= (np.abs(trial - e) > 2.0 * np.finfo(float).eps * largest / steepest) & (off != 0.0)
            e = np.where(moving, trial, e)
            if not moving.any():
                break
        phi, slope, _ = self.springs(e)
        slack = ~(np.abs(phi - force) <= CLOSE * largest) | ~(slope > FLAT * steepest)
        self._refuse_slack(slack, force, t)
        return e

    def _refuse_slack(self, slack: Mask, force: Array, t: Array) -> None:
        if slack.any():
            row, gear = (int(x) for x in np.argwhere(slack)[0])
            raise InputError(
                f"joints.{self.joints[gear].name}.motor: its spring holds no force of {force[row, gear]:.4g}"
                f" {self.unit(gear)}, which the motion takes at t = {t[row]:.4g} s; allowed: springs whose force rises"
                " with the deflection, up to all forces of the motion"
            )


def gears_of(robot: Robot) -> Gears | None:
    """Return the transmissions of a robot's motors; None without motors.

    Raises:
        InputError: a motor does not follow from its transmission's force: with backlash, internal states or no spring.
    """
    joints = tuple(joint for joint in robot.joints if joint.motor is not None)
    if not joints:
        return None
    for joint in joints:
        _check_invertible(joint)
    motors = [joint.motor for joint in joints if joint.motor is not None]
    own = [{key for key, x in motor.transmission.numbers().items() if x} for motor in motors]
    return Gears(
        names=tuple(f"{joint.name}.motor" for joint in joints),
        joints=joints,
        ratios=np.array([motor.ratio for motor in motors]),
        damping=np.array([motor.transmission.damping or 0.0 for motor in motors]),
        linear=np.array([keys <= LINEAR for keys in own]),
        kernel=build(_deflected(robot, joints), kernels=GEARS).replaced(checks=False),
    )


def principal_of(joint: Joint) -> str:
    """Return the name of a joint's principal coordinate."""
    return f"{joint.name}.{joint.principal}"


def _check_invertible(joint: Joint) -> None:
    assert joint.motor is not None
    law, where = joint.motor.transmission, f"joints.{joint.name}.motor"
    numbers = law.numbers()
    if law.clearance is not None:
        raise InputError(
            f"{where}.clearance: {law.clearance:g}: within its backlash no motor's angle makes a force; allowed for"
            " feed-forward: transmissions without clearance"
        )
    stateful = sorted(key for key in numbers if key.startswith(("hysteresis", "maxwell")))
    if stateful:
        raise InputError(
            f"{where}.{stateful[0]}: its force depends on what was before; allowed for feed-forward: transmissions of"
            " springs and dampers without internal states"
        )
    springs = [x for key, x in numbers.items() if key not in ("damping", "preload", "stiffness_negative") and x]
    if not springs:
        raise InputError(
            f"{where}.stiffness: {law.stiffness or 0.0:g}: behind no spring the joint is no flat output of its motor;"
            " allowed for feed-forward: a stiffness above 0, exponential, or a curve"
        )


def _deflected(robot: Robot, joints: Sequence[Joint]) -> Robot:
    """Return a robot whose coordinates are the transmissions' deflections, each with its law."""
    laws = []
    for joint in joints:
        assert joint.motor is not None
        laws.append((joint.name, joint.principal, replace(joint.motor.transmission, limits=None, prescribed=False)))
    return laws_alone(robot.name[:42] + "_gears", robot.base, laws)


def laws_alone(name: str, base: str, laws: Sequence[tuple[str, str, Coordinate]]) -> Robot:
    """Return a robot without weight whose coordinates have laws alone, each by names of its joint and coordinate."""
    types = {kind: name for name, kind in [*PRINCIPAL.items()][::-1]}
    joints = tuple(Joint(x, base, x, types[kind], coordinates={kind: law}) for x, kind, law in laws)
    links = tuple(Link(joint.name, 1.0, (0.0, 0.0, 0.0), (1.0, 1.0, 1.0, 0.0, 0.0, 0.0)) for joint in joints)
    return Robot(name, (0.0, 0.0, 0.0), links, joints, base=base)


def check_one_slope(joint: Joint) -> None:
    """Refuse a gear whose spring's slope jumps and that no damper follows, for motions that are not known."""
    assert joint.motor is not None
    law = joint.motor.transmission
    if law.stiffness_negative not in (None, law.stiffness) and not law.damping:
        raise InputError(
            f"joints.{joint.name}.motor.stiffness_negative: {law.stiffness_negative:g}: where the force of its gear"
            " reverses, the motor's velocity would have to jump; allowed for feed-forward in C: one stiffness on both"
            " sides, a damping beside them, or samples of eomgen.control.feedforward"
        )


def check_kinks(joints: Sequence[Joint], courses: Sequence[Array], t: Array) -> list[str]:
    """Return notes about springs of gears that pass a place at which their slope or its derivative jumps.

    Args:
        joints: of the gears, g of them.
        courses: deflections, their rates and accelerations, (T, g) each.
        t: times, (T,), s.

    Raises:
        InputError: a gear without a damper passes a place at which the slope jumps: so would its motor's velocity.
    """
    notes = []
    for joint, e, rate, acceleration in zip(joints, *(x.T for x in courses), strict=True):
        assert joint.motor is not None
        law, ratio = joint.motor.transmission, joint.motor.ratio
        above, below = law.stiffness or 0.0, law.stiffness_negative
        passed = [row for knot, _ in law.curve or () for row in _passed(e, knot).tolist()]
        if below is not None and below != above:
            before = _passed(e, 0.0)
            slopes = np.where(np.outer([1.0, -1.0], e[before]) < 0.0, below, above)  # before 0 and behind it, (2, rows)
            with np.errstate(divide="ignore"):  # without a stiffness on the other side it jumps without bound
                jumps = np.abs(ratio * rate[before] * (1.0 - slopes[0] / slopes[1]))
            rows = before[jumps > JUMPS * np.abs(ratio * rate).max(initial=0.0)]
            if rows.size and not law.damping:
                raise InputError(
                    f"joints.{joint.name}.motor.stiffness_negative: {below:g}, beside a stiffness of {above:g}: the"
                    f" motion passes the deflection 0 at t = {t[rows[0]]:.4g} s, where the motor's velocity would have"
                    f" to jump by {jumps[before == rows[0]][0]:.3g} rad/s; allowed for feed-forward: one stiffness on"
                    " both sides, a damping beside them, or motions that keep a gear on one side"
                )
            passed += rows.tolist()
        if passed:
            at = np.sort(passed)
            size = joint.motor.inertia * ratio * np.abs(acceleration[at + 1] - acceleration[at]).max()
            times = ", ".join(f"{x:.4g}" for x in t[at[:3]]) + (f" and {at.size - 3} more times" if at.size > 3 else "")
            notes.append(
                f"{joint.name}.motor: its torque jumps, by up to {size:.2g} N m, where the slope of its gear's spring"
                f" or that of the slope does, at {times} s; the closer the samples, the better the link follows there"
            )
    return notes


def _passed(e: Array, place: float) -> Index:
    """Return the last samples before a deflection, (T,), passes a place."""
    off = np.flatnonzero(e != place)
    return np.asarray(off[np.flatnonzero(np.diff(np.sign(e[off] - place)))])


def deflections(gears: Gears, forces: Array, t: Array) -> tuple[Array, Array, Array]:
    """Return deflections of gears, their rates and accelerations, (T, g) each, that transmit these forces.

    Springs alone are inverted.  With a damper the deflection obeys d e' + phi(e) = f, which forgets how it began; of a
    straight line its rate is taken through the filter d w' + k w = f', exactly for the polynomials between the samples
    of f and its time derivatives, and other springs by Radau's method of order 5.

    Args:
        gears: the transmissions.
        forces: f and its time derivatives, (2 or 3, T, g): to the second where a gear has no damper.
        t: times, (T,), s, increasing.
    """
    f, rate = forces[:2]
    damped, linear = gears.damped, gears.linear
    e = gears.wound(f, t)
    _, slope, curvature = gears.springs(e)
    de = rate / slope
    dde = np.zeros_like(f)
    if not damped.all():
        dde = (forces[2] - curvature * de**2) / slope
    filtered = damped & linear
    if filtered.any():
        k, d = slope[0, filtered], gears.damping[filtered]
        w = _filtered(k / d, forces[:, :, filtered] / d, t, de[0, filtered])
        e[:, filtered] -= d * w / k
        de[:, filtered], dde[:, filtered] = w, (rate[:, filtered] - k * w) / d
    stepped = damped & ~linear
    if stepped.any():
        begin = gears.wound((f - gears.damping * de)[:1], t[:1])[0]
        e[:, stepped] = _stepped(gears, stepped, forces, t, begin)[:, stepped]
        phi, slope, _ = gears.springs(e)
        d = np.where(stepped, gears.damping, 1.0)
        de[:, stepped] = ((f - phi) / d)[:, stepped]
        dde[:, stepped] = ((rate - slope * de) / d)[:, stepped]
    return e, de, dde


def finer(t: Array) -> Array:
    """Return times with steps of filters between samples, (FINER (T - 1) + 1,): every FINER-th is a sample."""
    share = np.arange(FINER) / FINER
    return np.append((t[:-1, np.newaxis] + share * np.diff(t)[:, np.newaxis]).ravel(), t[-1])


def _pieces(forces: Array, t: Array) -> Array:
    """Return polynomials between samples of forces, of rising powers of the part r of a step from 0 to 1.

    Args:
        forces: (2 or 3, T, g): with the first derivatives cubic polynomials, with the second ones quintic.
        t: times, (T,), s.

    Returns:
        Coefficients, (4 or 6, T - 1, g).
    """
    h = np.diff(t)[:, np.newaxis]
    f, rate = forces[0], forces[1]
    a0, a1 = f[:-1], h * rate[:-1]
    off, off_rate = f[1:] - a0 - a1, h * (rate[1:] - rate[:-1])
    if len(forces) == 2:
        return np.stack([a0, a1, 3.0 * off - off_rate, off_rate - 2.0 * off])
    a2 = 0.5 * h**2 * forces[2][:-1]
    off, off_rate, off_second = off - a2, off_rate - 2.0 * a2, h**2 * (forces[2][1:] - forces[2][:-1])
    a3 = 10.0 * off - 4.0 * off_rate + 0.5 * off_second
    a4 = -15.0 * off + 7.0 * off_rate - off_second
    return np.stack([a0, a1, a2, a3, a4, 6.0 * off - 3.0 * off_rate + 0.5 * off_second])


def _filtered(pole: Array, forces: Array, t: Array, begin: Array) -> Array:
    """Return w of w' + pole w = f' at samples, (T, g), exactly for the polynomials of ``_pieces``."""
    pieces = _pieces(forces, t)
    decay, weights = filter_weights(pole * np.diff(t)[:, np.newaxis], len(pieces) - 1)
    driven = np.einsum("mkg,mkg->kg", pieces[1:], weights)
    w: Array = np.empty_like(forces[0])
    w[0] = begin
    for i in range(len(driven)):
        w[i + 1] = decay[i] * w[i] + driven[i]
    return w


def filter_weights(x: Array, powers: int) -> tuple[Array, Array]:
    """Return what filters keep over steps of x time constants, x.shape, and what powers of the part of a step leave.

    Args:
        x: pole times step.
        powers: count of them.

    Returns:
        exp(-x), and for r, r^2, ... of a force what w of w' + pole w = f' gets of it, (powers, *x.shape).
    """
    factors = np.arange(1.0, powers + 1).reshape(-1, *np.ones(np.ndim(x), int))
    return np.exp(-x), factors * _moments(x, powers)


def _moments(x: Array, count: int) -> Array:
    """Return the integrals of exp(-x (1 - r)) r^m over r from 0 to 1, for m from 0 on, (count, *x.shape)."""
    small = np.where(x < 1.0, x, 0.0)
    large = np.where(x < 1.0, 1.0, x)
    series, by_parts = np.zeros((2, count, *x.shape))
    for m in range(count):
        term = np.ones_like(x) / (m + 1)
        for j in range(1, 20):
            series[m] += term
            term = -term * small / (m + 1 + j)
        before = np.exp(-large) if m == 0 else m * by_parts[m - 1]
        by_parts[m] = (1.0 - before) / large
    return np.asarray(np.where(x < 1.0, series, by_parts))


def _stepped(gears: Gears, stepped: Mask, forces: Array, t: Array, begin: Array) -> Array:
    """Return deflections of d e' + phi(e) = f at samples, (T, g), by Radau's method of order 5; of other gears any."""
    h, pieces = np.diff(t), _pieces(forces, t)
    parts = np.vander(NODES, len(pieces), increasing=True)
    d = np.where(stepped, gears.damping, 1.0)
    e: Array = np.empty_like(forces[0])
    e[0] = begin
    for i in range(len(h)):
        force = parts @ pieces[:, i]
        stages = np.where(stepped, e[i], 0.0) + np.zeros((3, 1))
        for _ in range(TRIES):
            phi, slope, _ = gears.springs(stages)
            off = stages - e[i] - h[i] * (STAGES @ ((force - phi) / d))
            by = np.eye(3)[:, :, np.newaxis] + h[i] * STAGES[:, :, np.newaxis] * (slope / d)
            change = np.linalg.solve(np.moveaxis(by, 2, 0), off.T[..., np.newaxis])[..., 0].T * stepped
            stages = stages - change
            if (np.abs(change) <= 1e-15 * np.maximum(np.abs(stages), 1e-9)).all():
                break
        e[i + 1] = stages[-1]
    return e
