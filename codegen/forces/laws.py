"""Formulas of the laws in ``robot.laws``: forces that resist a deviation s at the rate v.

Every law is a function of s and v with its slopes and the energy that it stores (zero at s = 0), over any kind of
scalar.  There are no branches: u = max(s - a, 0) is what of s lies beyond a, and min(u, w) what of it is inside an
interval of the width w, so that polynomials in these parts add up to the pieces of a curve.  (u - max(u - w, 0) is
the same but for round-off: far beyond a narrow interval it keeps no digit of w.)

Contact: K. H. Hunt, F. R. E. Crossley, "Coefficient of Restitution Interpreted as Damping in Vibroimpact", Journal of
Applied Mechanics 42 (1975).  Friction: the Stribeck curve in the form of C. Canudas de Wit et al., "A New Model for
Control of Systems with Friction", IEEE Transactions on Automatic Control 40 (1995), with a Lorentzian;
the Gaussian is that of L. C. Bo, D. Pavelescu, "The Friction-Speed Relation", Wear 82 (1982), with the exponent 2.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

from eomgen.robot.laws import LAWS, active_laws, states_of

from ..tree.bound import BoundLaw
from ..tree.spatial import Scalar
from .monotone_curve import curve_pieces
from .scalar_functions import Functions

Numbers = Mapping[str, Scalar]
FRICTION = ("friction",)
LEAST_LOAD = 1e-6  # N, beside which a load bends to 0: far below what matters, and its square far above a float's least


@dataclass(frozen=True)
class Effect:
    """Resisting force (N, N m), its slopes by deviation and rate, and stored energy (J).

    friction_tangent: slope of friction by the rate, beside ``by_v``.  friction_secant: friction over its rate.
    by_load: the slope of friction by the force that presses the joint.
    """

    force: Scalar = 0.0
    by_s: Scalar = 0.0
    by_v: Scalar = 0.0
    energy: Scalar = 0.0
    friction_tangent: Scalar = 0.0
    friction_secant: Scalar = 0.0
    by_load: Scalar = 0.0

    def __add__(self, other: Effect) -> Effect:
        return Effect(*(x + y for x, y in zip(vars(self).values(), vars(other).values(), strict=True)))

    @property
    def by_rate(self) -> Scalar:
        """The whole slope by the rate."""
        return self.by_v + self.friction_tangent

    def ahead(self, dt: Scalar, square: Scalar, f: Functions) -> Scalar:
        """Return its share in the inertia of a linearly implicit step dt, with its square; 0 of a tangent that falls.

        Friction counts by its secant: along its tangent, steep at rest and flat beside it, a mass that arrives moving
        would jump over its rest for ever.
        """
        return f.max(dt * self.by_v + square * self.by_s, 0.0) + dt * self.friction_secant


@dataclass(frozen=True)
class Deflection:
    """Arguments of a law: those of its coordinate, deviation s and rate v.

    s: m or rad; v: per s.  f: functions of the scalars.  load: the force that presses the joint, N.
    """

    law: BoundLaw
    s: Scalar
    v: Scalar
    f: Functions
    load: Scalar = 0.0

    @property
    def numbers(self) -> Numbers:
        """Numbers of the laws by the names of ``robot.laws``; "stiffness" is there if a law takes it."""
        return self.law.numbers


def effect(
    law: BoundLaw, s: Scalar, v: Scalar, f: Functions, load: Scalar = 0.0, without: Collection[str] = ()
) -> Effect:
    """Sum of a coordinate's laws beyond linear stiffness and damping, without some; arguments as of ``Deflection``."""
    names = {x.name for x in active_laws(law.numbers)}
    names -= {name for name, _ in states_of(law.numbers)}  # which ``internal_states`` has
    acting = names.difference(without, *(LAWS[name].absorbs for name in names))
    x, total = Deflection(law, s, v, f, load), Effect()
    for group in GROUPS:
        total = total + sum((formula(x) for name, formula in group.items() if name in acting), Effect())
    return total


def without_friction(law: BoundLaw, s: Scalar, v: Scalar, f: Functions) -> Effect:
    """Return the effect of a coordinate's springs, contacts and dampers, without its friction."""
    linear = Effect(law.stiffness * s + law.damping * v, law.stiffness, law.damping)
    return linear + effect(law, s, v, f, without=FRICTION)


def bearing_load(carried: Sequence[Effect], f: Functions) -> tuple[Scalar, list[Scalar]]:
    """Return the force N that presses a joint, and its slopes by what each of the coordinates across carries.

    N = sqrt(F_1^2 + F_2^2 + LEAST_LOAD^2): it has slopes where nothing presses, too.
    """
    total: Scalar = LEAST_LOAD * LEAST_LOAD
    for one in carried:
        total = total + one.force * one.force
    load = f.sqrt(total)
    inverse = 1.0 / load
    return load, [one.force * inverse for one in carried]


def bell(height: Scalar, width: Scalar, v: Scalar, f: Functions) -> tuple[Scalar, Scalar]:
    """Return height exp(-(v / width)^2) and its slope by v."""
    inverse = 1.0 / width
    x = v * inverse
    value = height * f.exp(-1.0 * (x * x))
    return value, -2.0 * inverse * (x * value)


def tension(numbers: Numbers, knots: Sequence[float], e: Scalar, rate: Scalar, f: Functions) -> Effect:
    """Return a point-to-point spring's tension, from its elongation e (m) and the rate of that (m/s).

    With "smoothing", that of a cable: max(k d + c d_dot, 0), d the penetration of a contact at clearance 0.

    Args:
        numbers: stiffness k, damping c, and "smoothing" where it is a cable.
        knots: elongations of its curve.
    """
    k, c = numbers["stiffness"], numbers["damping"]
    if "smoothing" in numbers:
        return _one_sided(k, c, numbers["smoothing"], e, rate, f)
    total = Effect(k * e + c * rate, k, c, 0.5 * (k * (e * e)))
    if knots:
        total = total + _through_points([numbers[f"curve.{i}"] for i in range(len(knots))], knots, e, f)
    return total


def _one_sided(k: Scalar, c: Scalar, w: Scalar, x: Scalar, v: Scalar, f: Functions, more: Scalar = 0.0) -> Effect:
    """Return max(k d (1 + more d_dot) + c d_dot, 0): never negative, whatever x and its rate v.

    The penetration d(x) is that of ``_contact``, with the smoothing w: it and the share of v in d_dot set in from 0 on.
    """
    beyond, inside = f.max(x - w, 0.0), f.min(w, f.max(x, 0.0))
    inverse = 1.0 / w
    slope = inside * inverse
    d, bend = 0.5 * (inside * slope) + beyond, (f.step(x) - f.step(x - w)) * inverse
    elastic = k * d
    c = c + more * elastic
    push = elastic + c * (slope * v)
    acts = f.step(push)
    energy = k * (inside * inside * slope * (1.0 / 6.0) + 0.5 * beyond * (beyond + w))
    force, rise = f.max(push, 0.0), k * slope
    by_s = rise + c * (bend * v) + (more * rise) * (slope * v)
    return Effect(force, acts * by_s, acts * (c * slope), energy)


def steepest(knots: Sequence[float], forces: Sequence[Scalar], f: Functions) -> Scalar:
    """Return the slope of the steepest rising piece between a curve's points, at least 0."""
    most: Scalar = 0.0
    for (a, b), (low, high) in zip(pairwise(knots), pairwise(forces), strict=True):
        most = f.max((high - low) * (1.0 / (b - a)), most)
    return most


def _preload(x: Deflection) -> Effect:
    p = x.numbers["preload"]
    return Effect(p, energy=p * x.s)


def _two_sides(x: Deflection) -> Effect:
    """Resist on each side by itself: where one is much softer, the other's stiffness leaves nothing in its digits."""
    k, behind = x.numbers["stiffness"], x.numbers["stiffness_negative"]
    ahead, back, is_ahead = x.f.max(x.s, 0.0), x.f.min(0.0, x.s), x.f.step(x.s)
    force, by_s = k * ahead + behind * back, k * is_ahead + behind * (1.0 - is_ahead)
    return Effect(force, by_s, energy=(k * ahead * ahead + behind * back * back) * 0.5)


def _cubic(x: Deflection) -> Effect:
    c, square = x.numbers["cubic"], x.s * x.s
    return Effect(c * square * x.s, 3.0 * c * square, energy=0.25 * c * square * square)


def _exponential(x: Deflection) -> Effect:
    F, scale = x.numbers["exponential.force"], x.numbers["exponential.scale"]
    rate = 1.0 / scale
    grown = x.f.exp(x.s * rate)
    force = F * (grown - 1.0)
    return Effect(force, F * rate * grown, energy=scale * force - F * x.s)


def _contacts(x: Deflection) -> Effect:
    """Return contact at both ends of a clearance."""
    k = x.numbers["stiffness"]
    ahead = contact(x.numbers, k, x.s, x.v, x.f)
    behind = contact(x.numbers, x.numbers.get("stiffness_negative", k), -x.s, -x.v, x.f)
    return Effect(
        ahead.force - behind.force, ahead.by_s + behind.by_s, ahead.by_v + behind.by_v, ahead.energy + behind.energy
    )


def contact(numbers: Numbers, k: Scalar, s: Scalar, v: Scalar, f: Functions) -> Effect:
    """Return contact at the end towards positive s: (k d + cubic d^3) max(1 + c d_dot, 0).

    The penetration d(x), x = s - clearance, is 0 up to x = 0, x^2 / (2 w) up to the smoothing w, and x - w / 2 beyond;
    its rate d_dot = d'(x) v sets in as it does, from 0 on.
    """
    w = numbers["smoothing"]
    x = s - numbers["clearance"]
    beyond, inside = f.max(x - w, 0.0), f.min(w, f.max(x, 0.0))  # of x beyond the smoothing, and within
    inverse = 1.0 / w
    slope = inside * inverse
    d = 0.5 * (inside * slope) + beyond
    force, by_s = k * d, k * slope
    half = 0.5 * w
    energy = k * (inside * inside * slope * (1.0 / 6.0) + 0.5 * beyond * (beyond + w))
    if "cubic" in numbers:
        c, square = numbers["cubic"], d * d
        force, by_s = force + c * square * d, by_s + 3.0 * c * square * slope
        end, root = beyond + half, half * half
        within = inside * slope * inside * slope * inside * slope * inside * (1.0 / 56.0)  # integral of d^3
        energy = energy + c * (within + 0.25 * (end * end * end * end - root * root))
    if "restitution_damping" in numbers:
        c = numbers["restitution_damping"]
        approach = c * v  # both ends share it
        raised = 1.0 + slope * approach
        factor, pushes = f.max(raised, 0.0), f.step(raised)
        bend = (f.step(x) - f.step(x - w)) * inverse
        by_s = by_s * factor + force * (pushes * (bend * approach))
        return Effect(force * factor, by_s, force * (c * (pushes * slope)), energy)
    return Effect(force, by_s, energy=energy)


def _friction(x: Deflection) -> Effect:
    numbers, v = x.numbers, x.v
    smoothing = numbers["friction.smoothing"]
    inverse = 1.0 / x.f.sqrt(v * v + smoothing * smoothing)
    sign, ratio = v * inverse, smoothing * inverse
    sign_slope = ratio * ratio * inverse  # in this order nothing overflows, whatever the smoothing
    level: Scalar = numbers["friction.coulomb"]
    level_slope: Scalar = 0.0
    if "friction.static" in numbers and "friction.gaussian" in numbers:
        more, level_slope = bell(numbers["friction.static"] - level, numbers["friction.gaussian"], v, x.f)
        level = level + more
    elif "friction.static" in numbers:
        rate = 1.0 / numbers["friction.stribeck"]
        z = v * rate
        share = 1.0 / (1.0 + z * z)
        more = (numbers["friction.static"] - level) * share
        level, level_slope = level + more, -2.0 * rate * (z * (more * share))
    by_load: Scalar = 0.0
    if "friction.coefficient" in numbers:
        lever = numbers["friction.coefficient"] * numbers.get("friction.radius", 1.0)
        level, by_load = level + lever * x.load, lever * sign
    total = Effect(
        sign * level,
        friction_tangent=sign_slope * level + sign * level_slope,
        friction_secant=inverse * level,
        by_load=by_load,
    )
    if "friction.viscous" in numbers:
        b = numbers["friction.viscous"]
        total = total + Effect(b * v, friction_tangent=b, friction_secant=b)
    return total


def _stops(x: Deflection) -> Effect:
    """Return contact at the lower and at the upper end, where there are such."""
    n = x.numbers
    k, c, w = n["stops.stiffness"], n.get("stops.damping", 0.0), n["stops.smoothing"]
    more, total = n.get("stops.restitution_damping", 0.0), Effect()
    if "stops.upper" in n:
        total = total + _one_sided(k, c, w, x.s - n["stops.upper"], x.v, x.f, more)
    if "stops.lower" in n:
        back = _one_sided(k, c, w, n["stops.lower"] - x.s, -x.v, x.f, more)
        total = total + Effect(-1.0 * back.force, back.by_s, back.by_v, back.energy)
    return total


def _curve(x: Deflection) -> Effect:
    knots = x.law.knots
    return _through_points([x.numbers[f"curve.{i}"] for i in range(len(knots))], knots, x.s, x.f)


def _through_points(forces: Sequence[Scalar], knots: Sequence[float], s: Scalar, f: Functions) -> Effect:
    """Interpolate the curve through measured points; its energy is zero at s = 0."""
    force, by_s, energy = _along(knots, forces, s, f)
    return Effect(force, by_s, energy=energy - _along(knots, forces, 0.0, f)[2])


def _along(knots: Sequence[float], forces: Sequence[Scalar], s: Scalar, f: Functions) -> tuple[Any, Any, Any]:
    """Return force, slope and energy from the first knot on: what every piece adds within its interval."""
    slopes, pieces = curve_pieces(knots, forces, f)
    beyond = [f.max(s - knot, 0.0) for knot in knots]
    before = (s - knots[0]) - beyond[0]  # at most 0
    force = forces[0] + slopes[0] * before + slopes[-1] * beyond[-1]
    by_s = slopes[0]
    energy = before * (forces[0] + 0.5 * slopes[0] * before) + beyond[-1] * (forces[-1] + 0.5 * slopes[-1] * beyond[-1])
    for i, (square, cube) in enumerate(pieces):
        t = f.min(knots[i + 1] - knots[i], beyond[i])
        force = force + t * (slopes[i] + t * (square + t * cube))
        by_s = by_s + t * (2.0 * square + t * (3.0 * cube))
        inner = slopes[i] * 0.5 + t * (square * (1.0 / 3.0) + t * (cube * 0.25))
        energy = energy + t * (forces[i] + t * inner)
    return force, by_s, energy


# In the order of the sums in the generated code; a group is summed first by itself.
GROUPS: Sequence[Mapping[str, Callable[[Deflection], Effect]]] = (
    {"preload": _preload},
    {"stiffness_negative": _two_sides, "cubic": _cubic, "exponential": _exponential},
    {"clearance": _contacts},
    {"friction": _friction},
    {"stops": _stops},
    {"curve": _curve},
)
