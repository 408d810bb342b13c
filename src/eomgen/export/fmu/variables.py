"""Variables of a robot's FMU: names, units, start values, and what each depends on.

A variable's value reference is its place in the list: time, parameters, coordinates q, rates v, internal states z,
drives u, wrenches, and then what is computed: der(q), accelerations a, der(z), poses of frames, reactions of joints,
energies.  Where loops or rigid couplings are closed, multipliers of their constraint follow on these, and there are no
reactions.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from eomgen.identifiers import parameter_path
from eomgen.kernel.stepping.options import LEAST
from eomgen.names import joint_of, parameter_name
from eomgen.robot.coordinates import FORCES, force_unit_of, unit_of
from eomgen.robot.elements import KINDS
from eomgen.robot.internal_states.drives import input_of
from eomgen.robot.mechanism import coordinate_of
from eomgen.robot.model import FIXED_BODY, Model
from eomgen.robot.parameter_names import FAMILIES, leasts, number_of
from eomgen.robot.rules import ROTORS
from eomgen.robot.value import LINEAR, MOTOR, Robot

BASE = {  # exponents of SI base units, and of rad
    "N": {"kg": 1, "m": 1, "s": -2},
    "J": {"kg": 1, "m": 2, "s": -2},
    "V": {"kg": 1, "m": 2, "s": -3, "A": -1},
    "ohm": {"kg": 1, "m": 2, "s": -3, "A": -2},
    "H": {"kg": 1, "m": 2, "s": -2, "A": -2},
}


def unit_name(text: str) -> str:
    """Return the name of a unit in FMI: "N.m/rad3" of "N m/rad^3"."""
    return text.replace(" ", ".").replace("^", "")


def exponents(name: str) -> dict[str, int]:
    """Return exponents of the SI base units, and of rad, in a unit of FMI."""
    powers: dict[str, int] = {}
    for sign, factor in zip((1, -1), name.split("/"), strict=False):
        for unit, power in re.findall(r"([A-Za-z]+)(\d*)", factor):
            for base, exponent in BASE.get(unit, {unit: 1}).items():
                powers[base] = powers.get(base, 0) + sign * int(power or 1) * exponent
    return {base: exponent for base, exponent in powers.items() if exponent}


_OF_FORCES = (unit_name(unit) for table in FAMILIES.values() for number in table.values() for unit in number.unit)
UNITS: Mapping[str, Mapping[str, int]] = {  # but for those that internal states alone have
    name: exponents(name)
    for name in (
        *("1", "s", "m", "rad", "m/s", "rad/s", "m/s2", "rad/s2", "kg", "kg.m2", "N", "N.m", "J", "N/m"),
        *("N.m/rad", "J.s", "N.s/m", "N.m.s/rad", "N/m3", "N.m/rad3", "s/m", "s/rad", "rad/m", "m/rad", *_OF_FORCES),
    )
}
STEP = "solver.step"
TOLERANCE = "solver.tolerance"
CLOSING = "solver.closing"
CLOSING_TIME = 0.01  # s, in which gaps of model exchange fall to a third
SHORTEST = 1e-9  # s, of a step
TIGHTEST, LOOSEST = LEAST["float64"], 0.1  # relative tolerances
SMALL = 1e-3  # m or rad, the usual size of a deviation


@dataclass(frozen=True)
class Variable:
    """A variable of the FMU.

    start: its value at first, of what can be set and of states.  minimum, maximum: the least and the most that a
    parameter may be.  nominal: the size of a state.  derivative: the value reference of the state that it is the
    derivative of.  depends: value references of the states and inputs that it depends on; None for all.  is_guess:
    whether initialization looks for its value from ``start`` on.
    """

    name: str
    causality: str
    unit: str
    text: str
    start: float | None = None
    minimum: float | None = None
    maximum: float | None = None
    nominal: float | None = None
    derivative: int | None = None
    depends: tuple[int, ...] | None = None
    is_guess: bool = False


@dataclass(frozen=True)
class Layout:
    """Variables of an FMU; ``at``: value reference at which each kind begins; ``frames``: names of frames with poses.

    ``frames`` are their numbers among the model's.
    """

    variables: tuple[Variable, ...]
    at: Mapping[str, int]
    frames: tuple[int, ...]


def step_variable(step: float) -> Variable:
    """Return the parameter of steps of one length, s."""
    return Variable(STEP, "parameter", "s", "Greatest step of co-simulation", step, SHORTEST)


def tolerance_variable(rtol: float) -> Variable:
    """Return the parameter of adaptive step size: the tolerance."""
    return Variable(TOLERANCE, "parameter", "1", "Relative tolerance of co-simulation", rtol, TIGHTEST, LOOSEST)


def make_layout(model: Model, solver: Variable, home: Sequence[float]) -> Layout:
    """Return the variables of a robot's FMU.

    Args:
        solver: the parameter of its co-simulation.
        home: coordinates at the start, (n,), m or rad.
    """
    layout_variables: list[Variable] = [Variable("time", "independent", "s", "Time")]
    at: dict[str, int] = {}
    frames = tuple(i for i, name in enumerate(model.frames) if name != model.robot.base)

    def add(kind: str, variables: Iterable[Variable]) -> None:
        at[kind] = len(layout_variables)
        layout_variables.extend(variables)

    units = {name: parameter_unit(model.robot, name) for name in model.parameters}
    values, least = model.parameters.items(), leasts(model.robot, model.parameters)
    add("parameters", (Variable(x, "parameter", units[x], "Parameter", value, least.get(x)) for x, value in values))
    add("solver", [solver])
    if model.constraints:
        text = "Time constant with which model exchange closes loops"
        add("closing", [Variable(CLOSING, "parameter", "s", text, CLOSING_TIME, SHORTEST)])
    add("q", _states(model, "q", "Coordinate", "", len(layout_variables), home))
    add("v", _states(model, "v", "Rate", "/s", len(layout_variables), [0.0] * len(model.coordinates)))
    add("z", _internal_states(model, len(layout_variables)))
    add("u", _drives(model))
    add("wrench", _wrenches("wrench", "input", model.links, "on link", "about its centre of mass, base frame", 0.0))
    add("rates", _rates(model, at))
    add("a", [*_accelerations(model, at), *_rates_of_laws(model, at)])
    add("multipliers", _multipliers(model))
    add("poses", _poses(model, frames, at["q"]))
    joints = [] if model.constraints else [body.joint for body in model.bodies]
    add(
        "reactions", _wrenches("reaction", "output", joints, "on the child of joint", "at the joint, in its axes", None)
    )
    n = len(model.coordinates)
    q, v, z = (tuple(range(at[kind], at[kind] + size)) for kind, size in (("q", n), ("v", n), ("z", model.size - n)))
    add(
        "energy",
        [
            Variable("energy.kinetic", "output", "J", "Kinetic energy", depends=(*q, *v)),
            Variable(
                "energy.potential", "output", "J", "Energy of gravity, springs, internal states", depends=(*q, *z)
            ),
        ],
    )
    at["end"] = len(layout_variables)
    return Layout(tuple(layout_variables), at, frames)


def _states(model: Model, kind: str, text: str, per: str, first: int, start: Sequence[float]) -> Iterator[Variable]:
    whole = {*model.principal, *model.motors}
    for i, name in enumerate(model.coordinates):
        unit, size = unit_of(name) + per, 1.0 if i in whole or i in model.prescribed else SMALL
        yield Variable(
            f"{kind}.{name}",
            "output",
            unit,
            text,
            start[i],
            nominal=size,
            depends=(first + i,),
            is_guess=bool(model.constraints) and i not in model.prescribed,
        )


def _internal_states(model: Model, first: int) -> Iterator[Variable]:
    """Give the internal states, from the value reference ``first`` on."""
    for i, x in enumerate(model.states):
        size, text = x.state.size(x.numbers), f"State of the {x.law} of {x.owner}"
        yield Variable(f"z.{x.name}", "output", unit_name(x.unit), text, 0.0, nominal=size, depends=(first + i,))


def _rates_of_laws(model: Model, at: Mapping[str, int]) -> Iterator[Variable]:
    for i, x in enumerate(model.states):
        yield Variable(f"der(z.{x.name})", "local", _per_second(unit_name(x.unit)), "Rate", derivative=at["z"] + i)


def _per_second(unit: str) -> str:
    """Return the unit over time: "rad/s", "m/s2"."""
    if "/" not in unit:
        return f"{unit}/s"
    return f"{unit}2" if unit.endswith("/s") else f"{unit}.s"


def _drives(model: Model) -> Iterator[Variable]:
    for i, name in enumerate(model.coordinates):
        unit = unit_of(name)
        if i in model.prescribed:
            yield Variable(f"u.{name}", "input", f"{unit}/s2", "Given acceleration", 0.0)
        else:
            meant = input_of(coordinate_of(model.robot, name).law(), name)
            text = "Drive" if i not in model.drives else f"Drive: {meant.meaning}"
            yield Variable(f"u.{name}", "input", unit_name(meant.unit), text, 0.0)


def _wrenches(
    kind: str, causality: str, names: Sequence[str], on: str, where: str, start: float | None
) -> Iterator[Variable]:
    for name in names:
        for component in FORCES:
            what, unit = ("Force", "N") if component.startswith("f") else ("Moment", "N.m")
            yield Variable(f"{kind}.{name}.{component}", causality, unit, f"{what} {on} {name}, {where}", start)


def _rates(model: Model, at: Mapping[str, int]) -> Iterator[Variable]:
    for i, name in enumerate(model.coordinates):
        unit = f"{unit_of(name)}/s"
        yield Variable(f"der(q.{name})", "local", unit, "Rate", derivative=at["q"] + i, depends=(at["v"] + i,))


def _accelerations(model: Model, at: Mapping[str, int]) -> Iterator[Variable]:
    for i, name in enumerate(model.coordinates):
        drive = (at["u"] + i,) if i in model.prescribed else None
        yield Variable(
            f"a.{name}", "output", f"{unit_of(name)}/s2", "Acceleration", derivative=at["v"] + i, depends=drive
        )


def _multipliers(model: Model) -> Iterator[Variable]:
    for name in model.constraints:
        unit = unit_name(force_unit_of(constrained_coordinate(model, name)))
        yield Variable(f"constraint.{name}", "output", unit, "Force that keeps the constraint")


def constrained_coordinate(model: Model, name: str) -> str:
    """Return a name that ends like the coordinate that a constraint blocks; of a coupling that of its follower."""
    return next((coupling.of for coupling in model.robot.couplings if coupling.name == name), name)


def _poses(model: Model, frames: Sequence[int], first: int) -> Iterator[Variable]:
    links = {frame.name: frame.link for frame in model.robot.frames}
    for name in (model.frames[i] for i in frames):
        depends = tuple(first + i for i in _moving(model, model.body_of[links.get(name, name)]))
        for axis in LINEAR:
            yield Variable(f"pose.{name}.{axis}", "output", "m", f"Origin of {name} in the base", depends=depends)
        for row in "123":
            for column in "123":
                text = f"Rotation matrix of {name} in the base, row {row}, column {column}"
                yield Variable(f"pose.{name}.r{row}{column}", "output", "1", text, depends=depends)


def _moving(model: Model, body: int) -> list[int]:
    """Return indices of the coordinates that move a body."""
    moving: list[int] = []
    while body != FIXED_BODY:
        here = model.bodies[body]
        followed = {x for name, leaders in model.leaders.items() if joint_of(name) == here.joint for x in leaders}
        moving = [*here.indices, *map(model.coordinates.index, sorted(followed)), *moving]
        body = here.parent
    return list(dict.fromkeys(moving))


def _coupling_unit(robot: Robot, parts: tuple[str, ...]) -> str:
    """Return the physical unit of a number of a coupling; a ratio's is that of its coordinate per the other one's."""
    (coupling,) = (x for x in robot.couplings if x.name == parts[1])
    unit, number = unit_of(coupling.of), number_of(parameter_name(*parts))
    if parts[2] == "ratio":
        other = unit_of(parameter_name(*parts[3:]))
        return "1" if unit == other else f"{unit}/{other}"
    return unit if number is None else unit_name(number.unit[0 if unit == "m" else 1])


def parameter_unit(robot: Robot, name: str) -> str:
    """Return the physical unit of a run-time parameter, a name of UNITS."""
    parts = parameter_path(name)
    if parts[0] == "gravity":
        return "m/s2"
    if parts[0] == "links":  # modal coordinates are plain numbers
        key = parts[4] if parts[2] == "modes" else parts[2]
        return {"mass": "kg", "com": "m", "inertia": "kg.m2", "stiffness": "J", "damping": "J.s"}[key]
    number = number_of(name)
    if parts[0] == "couplings":
        return _coupling_unit(robot, parts)
    if parts[2] in ("placement", "placements") or (number is None and parts[0] in KINDS):
        return "rad" if "rpy" in parts[3:5] else "m"
    if parts[2] == "pitch":
        return "m"
    if parts[2] == "offset":
        return "m" if parts[3] in LINEAR else "rad"
    of_motor = parts[0] == "joints" and parts[2] == MOTOR
    linear = robot.joint(parts[1]).principal in LINEAR if of_motor else parts[2] in LINEAR
    if number is None:  # of a motor
        return {"inertia": "kg.m2", "ratio": "rad/m" if linear else "1"}[parts[3]]
    at_shaft = parts[2] == MOTOR and parts[3] in ROTORS
    return unit_name(number.unit[0 if linear and not at_shaft else -1])
