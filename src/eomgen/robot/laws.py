"""The table of force laws that a coordinate may have beyond a linear spring and damper: numbers, units, texts.

Reading, JSON Schemas, conflicts, parameters, units, reports and exports take what they need from here; a law's formula
stands under its name in ``codegen.forces.laws``.  Numbers of laws go by their names below the coordinate, which are
also those of the run-time parameters: "cubic", "friction.coulomb", "curve.0".
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from types import MappingProxyType

from .internal_states.bouc_wen import CONDITIONS as PASSIVE
from .internal_states.bouc_wen import WOUND, hysteresis_conflict, hysteresis_states
from .internal_states.branches import BRANCHES, MOST_BRANCHES, branch_conflict, branch_states, branches_of
from .internal_states.bristles import BRISTLES, bristle_conflict, bristle_states
from .internal_states.drives import DRIVE, drive_conflict, drive_numbers, drive_states
from .internal_states.states import State
from .numbers import (
    DAMPING,
    FORCE,
    INERTIA,
    LENGTH,
    RATE,
    SMALLEST,
    STIFFNESS,
    YIELD,
    Condition,
    Conflict,
    Number,
    Values,
    by_key,
    divisor,
)

SHARE = 0.05  # of a clearance over which contact sets in
SMOOTHING = 4e-8  # m/s or rad/s over which friction reverses: 90 % of the limit creep by 0.8 um in 10 s
SHARP = 1e-6  # of the Stribeck velocity, at most: so little of the peak is lost where friction reverses
SHAPES = LORENTZIAN, GAUSSIAN = "lorentzian", "gaussian"  # of Stribeck's curve
SHAPED = {f"friction.{GAUSSIAN}": "friction.stribeck"}  # numbers that descriptions have under another key and a shape
COARSE = 1e-3  # m/s or rad/s by which explicit steps chatter where the smoothing of friction is too narrow for them
ONSET = 1e-4  # m or rad over which a stop sets in

Curve = tuple[tuple[float, float], ...]  # (deviation, force)
POINTS = (2, 64)  # fewest and most points of a curve


@dataclass(frozen=True, kw_only=True)
class Law:
    """A force of a coordinate beyond stiffness and damping.

    Attributes:
        numbers: the first of them says whether the law is there.
        about: a line about its table, where its numbers have one.
        is_spring: whether it holds its coordinate.
        stiffness: (k, numbers, deviations of a curve) -> stiffness (N/m, N m/rad) of a coordinate that has k without
            this law, for the choice of a method and the sizes of coordinates; None where it stays k.
        rate_slope: (numbers, least) -> the largest slope of its force by the velocity, N s/m or N m s/rad, ``least`` as
            of ``rate_slope_of``, for the choice of a method, too; None where its force does not depend on the velocity
            alone.
        contact: numbers -> the stiffness of a contact or of what a state stretches, N/m or N m/rad, which steps have
            to resolve; None where there is none.  It does not count in ``stiffness``.
        mjcf: numbers -> what becomes of it in MuJoCo where it is not written as it is; empty where it is.
        takes_stiffness: whether its formula has the coordinate's stiffness, too.
        of_rotor: whether in a motor's table it is a law of the rotor's angle, rad at the shaft, and not of the
            transmission's deflection.
        absorbs: springs that act within its formula.
        excludes: numbers and laws that it cannot stand beside; ``instead`` is what the message calls allowed.
        rule: numbers, "stiffness" among them -> key and message of what does not go together, None if all does.
        conditions: what of this rule run-time parameters must satisfy: each where all its numbers are there.
        has_points: whether it is a curve: its forces are the numbers "NAME.0", "NAME.1", ...
        states: numbers -> its internal states; None of a law that is a function of deviation and velocity.
        any_number: whether each of its numbers says that the law is there, not the first of them alone.
    """

    name: str
    numbers: tuple[Number, ...]
    is_spring: bool
    stiffness: Callable[[float, Values, Sequence[float]], float] | None
    mjcf: Callable[[Values], str]
    about: str = ""
    rate_slope: Callable[[Values, float], float] | None = None
    contact: Callable[[Values], float] | None = None
    takes_stiffness: bool = False
    of_rotor: bool = False
    absorbs: tuple[str, ...] = ()
    excludes: tuple[str, ...] = ()
    instead: str = ""
    rule: Callable[[Values], Conflict | None] | None = None
    conditions: tuple[Condition, ...] = ()
    has_points: bool = False
    states: Callable[[Values], tuple[State, ...]] | None = None
    any_number: bool = False

    def is_in(self, numbers: Values) -> bool:
        """Tell whether the law is there."""
        return self.first in numbers or (self.any_number and any(number.key in numbers for number in self.numbers))

    @property
    def first(self) -> str:
        """The parameter that is set where the law is active."""
        return f"{self.name}.0" if self.has_points else self.numbers[0].key

    @property
    def has_table(self) -> bool:
        """Whether descriptions have its numbers in a table of its name."""
        return "." in self.numbers[0].key


def _no_preload_alone(numbers: Values) -> str:
    alone = numbers["preload"] and (numbers.get("cubic") or not numbers.get("stiffness"))
    return "left out (springref shifts a linear spring alone)" if alone else ""


def _two_sides(numbers: Values) -> Conflict | None:
    if "stiffness" in numbers:
        return None
    return "stiffness_negative", "there is no stiffness for positive values; allowed: with stiffness"


def _ends(numbers: Values) -> Conflict | None:
    """Return the conflict of a clearance whose ends have no stiffness or no smoothing, None if they have both."""
    if "stiffness" not in numbers or not (numbers["stiffness"] or numbers.get("stiffness_negative")):
        return "clearance", "there is no stiffness at the end of it; allowed: with stiffness > 0"
    if "smoothing" not in numbers:
        return "clearance", f"got 0 and no smoothing; allowed: 0 with a smoothing of at least {SMALLEST:g}"
    return None


def _soft_friction(numbers: Values) -> str:
    if BRISTLES in numbers:
        return "frictionloss = coulomb, a soft constraint, without bristles and Stribeck term"
    coulomb = any(numbers.get(f"friction.{key}") for key in ("coulomb", "static", "coefficient"))
    lost = "smoothing, load and Stribeck term" if numbers.get("friction.coefficient") else "smoothing and Stribeck term"
    return f"frictionloss, a soft constraint, without {lost}" if coulomb else ""


def _between_stops(numbers: Values) -> Conflict | None:
    lower, upper = numbers.get("stops.lower"), numbers.get("stops.upper")
    if lower is None and upper is None:
        return "stops", "there is no lower and no upper; allowed: with one of them, or both"
    if lower is not None and upper is not None and lower > upper:
        return "stops.lower", f"got {lower!r}; allowed: at most upper, {upper!r}"
    return None


def _unwound(numbers: Values) -> str:
    stays = numbers["hysteresis.share"] and not ("clearance" in numbers or "curve.0" in numbers)
    return "left out but for its elastic share, a spring" if stays else "left out"


def _stribeck(numbers: Values) -> Conflict | None:
    coulomb, static = numbers["friction.coulomb"], numbers.get("friction.static")
    if BRISTLES in numbers:
        conflict = bristle_conflict(numbers)
        if conflict is not None:
            return conflict
    else:
        for key in ("bristle_damping", "fade"):
            if f"friction.{key}" in numbers:
                return f"friction.{key}", "there is no bristle_stiffness; allowed: with it"
    if (static is None) != (not any(f"friction.{key}" in numbers for key in ("stribeck", GAUSSIAN))):
        return "friction", "static and stribeck belong together; allowed: both or none"
    if static is not None and static < coulomb:
        return "friction.static", f"got {static!r}; allowed: at least coulomb, {coulomb!r}"
    if "friction.radius" in numbers and "friction.coefficient" not in numbers:
        return "friction.radius", "there is no coefficient; allowed: radius with coefficient"
    return None


def _friction_smoothing(numbers: Values) -> float | None:
    if BRISTLES in numbers:
        return None
    velocity = numbers.get("friction.stribeck", numbers.get(f"friction.{GAUSSIAN}", 1.0))
    return max(min(SMOOTHING, SHARP * velocity), SMALLEST)


def _friction_slope(numbers: Values, least: float) -> float:
    """Return the slope at zero velocity, where friction reverses; of LuGre's that of its dampers."""
    if BRISTLES in numbers:
        return numbers.get("friction.bristle_damping", 0.0) + numbers.get("friction.viscous", 0.0)
    level = max(numbers["friction.coulomb"], numbers.get("friction.static", 0.0))
    level += numbers.get("friction.coefficient", 0.0) * numbers.get("friction.radius", 1.0)  # of a load of 1 N
    smoothing = numbers["friction.smoothing"]
    return level / (smoothing if smoothing >= 0.01 * least else least) + numbers.get("friction.viscous", 0.0)


def _steepest(k: float, numbers: Values, knots: Sequence[float]) -> float:
    """Return the slope of the steepest rising piece of a curve, at least k."""
    forces = [numbers[f"curve.{i}"] for i in range(len(knots))]
    pairs = zip(pairwise(forces), pairwise(knots), strict=True)
    return max(k, *((high - low) / (b - a) for (low, high), (a, b) in pairs))


ARMATURE = "armature"
YIELDING = f"coulomb of at least {SMALLEST:g}, at which bristles yield"
BASIC = (
    Number("stiffness", "linear spring", STIFFNESS),
    Number("damping", "linear damper", DAMPING),
    Number(ARMATURE, "inertia of a drive, added to the diagonal of the mass matrix", INERTIA),
)
_LAWS = (
    Law(
        name="preload",
        numbers=(
            Number("preload", "constant force; a positive one pushes towards negative values", FORCE, least=None),
        ),
        is_spring=False,
        stiffness=None,
        mjcf=_no_preload_alone,
    ),
    Law(
        name="cubic",
        numbers=(Number("cubic", "cubic spring, times the third power of the deviation", ("N/m^3", "N m/rad^3")),),
        is_spring=True,
        stiffness=None,
        mjcf=lambda numbers: "",
    ),
    Law(
        name="stiffness_negative",
        numbers=(Number("stiffness_negative", "in the place of stiffness at negative values", STIFFNESS),),
        is_spring=True,
        stiffness=lambda k, numbers, knots: max(k, numbers["stiffness_negative"]),
        mjcf=lambda numbers: "stiffness on both sides",
        takes_stiffness=True,
        rule=_two_sides,
    ),
    Law(
        name="exponential",
        about="exponential spring: force times exp(s / scale) - 1 at the deviation s",
        numbers=(
            Number("exponential.force", "times exp(s / scale) - 1", FORCE, needed="a force in N or N m"),
            Number(
                "exponential.scale",
                "deviation over which the spring grows by the factor e",
                LENGTH,
                least=SMALLEST,
                needed="a deviation in m or rad, greater than 0",
            ),
        ),
        is_spring=True,
        stiffness=lambda k, numbers, knots: k + numbers["exponential.force"] / numbers["exponential.scale"],
        mjcf=lambda numbers: "left out",
        excludes=("clearance", "curve"),
        instead="an exponential spring without clearance, whose ends act on the penetration, and without curve, which"
        " stands in the place of springs",
    ),
    Law(
        name="clearance",
        numbers=(
            Number("clearance", "half the range in which no spring acts; with stiffness", LENGTH),
            Number(
                "restitution_damping",
                "multiplies a contact's force by 1 + restitution_damping * velocity of its penetration; with clearance",
                ("s/m", "s/rad"),
            ),
            divisor(
                "smoothing",
                "over which a contact sets in; with clearance, default clearance / 20",
                LENGTH,
                default=lambda numbers: max(SHARE * numbers["clearance"], SMALLEST) if numbers["clearance"] else None,
            ),
        ),
        is_spring=False,
        stiffness=None,
        mjcf=lambda numbers: "a spring without clearance",
        takes_stiffness=True,
        absorbs=("stiffness_negative", "cubic"),
        rule=_ends,
    ),
    Law(
        name="friction",
        about="Coulomb, Stribeck and viscous friction: coulomb, static, stribeck, shape, viscous, smoothing,"
        ' coefficient, radius; with model = "lugre" bristles: bristle_stiffness, bristle_damping, fade',
        numbers=(
            Number("friction.coulomb", "force that resists any motion; 0 where there is a coefficient", FORCE),
            Number("friction.static", "breakaway force, at least coulomb; with stribeck", FORCE),
            divisor("friction.stribeck", "velocity over which static friction falls to coulomb; with static", RATE),
            divisor(f"friction.{GAUSSIAN}", 'the same of a curve with shape = "gaussian"', RATE),
            Number("friction.viscous", "force per velocity", DAMPING),
            divisor(
                "friction.smoothing",
                "velocity s over which friction reverses, sgn(v) = v / sqrt(v^2 + s^2): x times the limit creeps at"
                " s x / sqrt(1 - x^2), where lugre holds; default 4e-8, or 1e-6 stribeck if that is less",
                RATE,
                default=_friction_smoothing,
            ),
            Number(
                "friction.coefficient",
                "of load-dependent friction: of the load on the joint's springs, contacts and dampers across it",
                ("1", "1"),
            ),
            Number("friction.radius", "friction radius of a rotation; with coefficient", ("m", "m")),
            divisor(BRISTLES, "of the bristles of LuGre friction, sigma_0", STIFFNESS),
            Number("friction.bristle_damping", "of these bristles, sigma_1", DAMPING),
            divisor("friction.fade", "velocity over which bristle_damping fades as exp(-(v / fade)^2)", RATE),
        ),
        is_spring=False,
        stiffness=None,
        mjcf=_soft_friction,
        rate_slope=_friction_slope,
        contact=lambda numbers: numbers.get(BRISTLES, 0.0),
        of_rotor=True,
        rule=_stribeck,
        conditions=(
            Condition({"friction.static": 1.0, "friction.coulomb": -1.0}, 0.0, "static of at least coulomb"),
            Condition(
                {"friction.coulomb": 1.0, BRISTLES: 0.0},
                SMALLEST,
                YIELDING,
            ),
        ),
        states=bristle_states,
    ),
    Law(
        name=WOUND,
        about="Bouc-Wen hysteresis, a spring with a state: stiffness, A, beta, gamma, n, share",
        numbers=(
            divisor(f"{WOUND}.stiffness", "where the motion begins, of A = 1", STIFFNESS),
            divisor(f"{WOUND}.A", "rate of the state per velocity; default 1", ("1", "1"), default=lambda numbers: 1.0),
            Number(f"{WOUND}.beta", "how fast the state yields, of n = 1 per deviation", YIELD, needed="a number"),
            Number(
                f"{WOUND}.gamma",
                "the same by the sense of the motion, from -beta to beta",
                YIELD,
                least=None,
                needed="a number from -beta to beta",
            ),
            Number(
                f"{WOUND}.n",
                "exponent of the state, at least 1: sharpness of yielding; default 1",
                ("1", "1"),
                least=1.0,
                default=lambda numbers: 1.0,
            ),
            Number(
                f"{WOUND}.share",
                "of the stiffness that has no hysteresis, less than 1; default 0",
                ("1", "1"),
                default=lambda numbers: 0.0,
            ),
        ),
        is_spring=False,
        stiffness=lambda k, numbers, knots: k + numbers["hysteresis.share"] * numbers["hysteresis.stiffness"],
        mjcf=_unwound,
        contact=lambda numbers: (
            (1.0 - numbers["hysteresis.share"]) * numbers["hysteresis.stiffness"] * numbers["hysteresis.A"]
        ),
        rule=hysteresis_conflict,
        conditions=PASSIVE,
        states=hysteresis_states,
    ),
    Law(
        name=BRANCHES,
        about="generalized Maxwell element: branches, each a spring in series with a damper",
        numbers=tuple(
            divisor(f"{BRANCHES}.{i}.{key}", about, unit)
            for i in range(MOST_BRANCHES)
            for key, about, unit in (
                ("stiffness", "of a branch's spring", STIFFNESS),
                ("damping", "of the damper in series with it", DAMPING),
            )
        ),
        is_spring=False,
        stiffness=None,
        mjcf=lambda numbers: "left out",
        contact=lambda numbers: sum(numbers[f"{BRANCHES}.{i}.stiffness"] for i in range(branches_of(numbers))),
        rule=branch_conflict,
        states=branch_states,
    ),
    Law(
        name="stops",
        about="contacts at which a coordinate ends: stiffness, damping, restitution_damping, smoothing, lower, upper",
        numbers=(
            Number(
                "stops.stiffness", "of both stops, per penetration", STIFFNESS, needed="a stiffness in N/m or N m/rad"
            ),
            Number("stops.damping", "of both stops, per velocity of the penetration", DAMPING),
            Number(
                "stops.restitution_damping",
                "multiplies a stop's elastic force by 1 + restitution_damping * velocity of the penetration",
                ("s/m", "s/rad"),
            ),
            divisor(
                "stops.smoothing", "over which a stop sets in; default 1e-4", LENGTH, default=lambda numbers: ONSET
            ),
            Number("stops.lower", "where the lower stop is; none without", LENGTH, least=None),
            Number("stops.upper", "where the upper stop is; none without", LENGTH, least=None),
        ),
        is_spring=False,
        stiffness=None,
        mjcf=lambda numbers: (
            "a limited range, a soft constraint as stiff as MuJoCo makes it" if numbers["stops.stiffness"] else ""
        ),
        rate_slope=lambda numbers, least: numbers.get("stops.damping", 0.0),
        contact=lambda numbers: numbers["stops.stiffness"],
        of_rotor=True,
        rule=_between_stops,
        conditions=(Condition({"stops.upper": 1.0, "stops.lower": -1.0}, 0.0, "lower of at most upper"),),
    ),
    Law(
        name="curve",
        numbers=(
            Number(
                "curve",
                "measured points [[deviation, force], ...], or a CSV file of two columns; in the place of stiffness",
                FORCE,
                least=None,
            ),
        ),
        is_spring=True,
        stiffness=_steepest,
        mjcf=lambda numbers: "left out",
        excludes=("stiffness", "stiffness_negative", "cubic", "clearance"),
        instead="a curve instead of stiffness, stiffness_negative, cubic, clearance",
        has_points=True,
    ),
    Law(
        name=DRIVE,
        about="an electrical drive that acts on it: lag, winding, current_limit, voltage_limit, controller",
        numbers=drive_numbers(),
        is_spring=False,
        stiffness=None,
        mjcf=lambda numbers: "left out: the actuator is a motor, whose control is the force",
        of_rotor=True,
        rule=drive_conflict,
        states=drive_states,
        any_number=True,
    ),
)
LAWS: Mapping[str, Law] = MappingProxyType({law.name: law for law in _LAWS})
NUMBERS: Mapping[str, Number] = by_key(*(number for law in _LAWS for number in law.numbers))


def active_laws(numbers: Values) -> Iterator[Law]:
    """Return the laws that numbers belong to, in the order of the table."""
    return (law for law in _LAWS if law.is_in(numbers)) if numbers else iter(())


def states_of(numbers: Values) -> tuple[tuple[str, State], ...]:
    """Return the states of a coordinate's laws, each with the law's name, in the order of the table."""
    return tuple((law.name, state) for law in active_laws(numbers) if law.states for state in law.states(numbers))


def defaults(numbers: Values) -> dict[str, float]:
    """Return defaults of missing numbers that follow from those that are set."""
    values = {}
    for law in active_laws(numbers):
        for number in law.numbers:
            value = number.default(numbers) if number.default and number.key not in numbers else None
            if value is not None:
                values[number.key] = value
    return values


def law_conflict(numbers: Values) -> Conflict | None:
    """Return the key and the message of numbers that do not go together; None if all do.

    Args:
        numbers: of all laws of a coordinate, and "stiffness" where it is set.
    """
    for law in _LAWS:
        first, *others = law.numbers
        if not law.is_in(numbers):
            for number in others:
                if number.key in numbers:
                    return number.key, f"there is no {first.key}; allowed: {number.key} with {first.key}"
            continue
        for number in others:
            if number.needed and number.key not in numbers:
                return number.key, f"it is missing; allowed: {number.needed}"
        for name in law.excludes:
            if (LAWS[name].first if name in LAWS else name) in numbers:
                return law.name, f"{name} is set, too; allowed: {law.instead}"
        conflict = law.rule(numbers) if law.rule else None
        if conflict is not None:
            return conflict
    return None


def stiffness_of(numbers: Values, knots: Sequence[float]) -> float:
    """Return the stiffness of a coordinate's springs, N/m or N m/rad; 0 where there is none.

    Args:
        numbers: of all laws of the coordinate, and "stiffness" where it is set.
        knots: deviations of its curve.
    """
    k = numbers.get("stiffness", 0.0)
    for law in active_laws(numbers):
        k = law.stiffness(k, numbers, knots) if law.stiffness else k
    return k


def rate_slope_of(numbers: Values, least: float = 0.0) -> float:
    """Return the largest slope of a coordinate's laws by its velocity, N s/m or N m s/rad, without its linear damper.

    Args:
        numbers: of all laws of the coordinate.
        least: velocity (m/s or rad/s) over which friction reverses whose smoothing is below a hundredth of it.
    """
    return sum((law.rate_slope(numbers, least) for law in active_laws(numbers) if law.rate_slope), 0.0)


def contact_stiffness_of(numbers: Values, of_rotor: bool | None = None) -> float:
    """Return the stiffness of a coordinate's stops and of springs of internal states, N/m or N m/rad; 0 without any.

    Args:
        numbers: of all laws of the coordinate.
        of_rotor: which laws count of a motor: those of the rotor's angle, or of the transmission's deflection.
    """
    laws = (law for law in active_laws(numbers) if law.contact and of_rotor in (None, law.of_rotor))
    return sum((law.contact(numbers) for law in laws if law.contact), 0.0)


def has_springs(numbers: Values, knots: Sequence[float]) -> bool:
    """Return whether springs act on a coordinate, even if their stiffness grows from 0 on; arguments as above."""
    grows = (law for law in active_laws(numbers) if law.is_spring and law.stiffness is None)
    return stiffness_of(numbers, knots) != 0.0 or any(numbers[law.first] != 0.0 for law in grows)


def number_texts(numbers: Values) -> list[str]:
    """Return numbers of laws as texts: "cubic 3", "curve of 5 points"."""
    texts = [f"{key} {number:.4g}" for key, number in numbers.items() if not key.startswith("curve.")]
    points = len(numbers) - len(texts)
    return [*texts, f"curve of {points} points"] if points else texts


def curve_conflict(curve: Curve, what: str = "deviation") -> tuple[str, str] | None:
    """Return the key and the message of what is wrong with a curve's points; None if nothing is.

    ``what``: its abscissa.
    """
    fewest, most = POINTS
    if not fewest <= len(curve) <= most:
        return "curve", f"got {len(curve)} points; allowed: {fewest} to {most}"
    for i in range(1, len(curve)):
        if curve[i][0] - curve[i - 1][0] < SMALLEST:
            return "curve", (
                f"point {i} has the {what} {curve[i][0]!r} after {curve[i - 1][0]!r}; "
                f"allowed: {what}s that rise by at least {SMALLEST:g}"
            )
    return None
