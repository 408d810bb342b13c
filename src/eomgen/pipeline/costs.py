"""Contents of a robot, the terms of its equations that vanish, and the cost of the rest."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from ..description import RobotLike, as_robot
from ..names import component_name, listed
from ..progress import StageReport, no_report
from ..robot.bounds import limit_texts
from ..robot.coordinates import UNITS, unit_of
from ..robot.laws import number_texts
from ..robot.model import Model
from ..robot.value import (
    CUT_NUMBERS,
    MOTOR,
    Coordinate,
    Coupling,
    Joint,
    Loop,
    Robot,
    deflection_range,
    range_line,
)
from .derivations import derived_model
from .mechanisms import Mobility


@dataclass(frozen=True)
class RobotInfo:
    """A model with its zero map's text and the operations of its kernels.

    ``choices`` says how a kernel is computed where there are several ways.  ``mobility`` is what a mechanism with loops
    can do, where that was asked for.
    """

    model: Model
    zeros: Mapping[str, Any]
    zero_lines: tuple[str, ...]
    operations: Mapping[str, Mapping[str, int]]
    choices: Mapping[str, str]
    mobility: Mobility | None = None

    def as_dict(self) -> dict[str, Any]:
        """Return plain values, for JSON."""
        model = self.model
        owners: tuple[Joint | Loop, ...] = (*model.robot.joints, *model.robot.loops)
        bending = _bending(model.robot)
        return {
            "name": model.name,
            "source": model.robot.source,
            "notes": list(model.robot.notes),
            "coordinates": list(model.coordinates),
            **({"internal_states": _states_of(model)} if model.internal_states else {}),
            "driven": [model.coordinates[i] for i in model.driven],
            "motors": {model.coordinates[i]: model.coordinates[p] for i, p in model.motors.items()},
            "joints": [body.joint for body in model.bodies],
            "links": list(model.links),
            "frames": list(model.frames),
            "loops": {loop.name: loop.type for loop in model.robot.loops},
            "constraints": list(model.constraints),
            "cut_laws": {
                component_name(owner, name) if name else owner: {**_linear(law), **law.law()}
                for owner, name, law in model.cut_laws
            },
            "couplings": {
                x.name: {"of": x.of, "to": dict(x.to), "offset": x.offset or 0.0, "rigid": x.law is None}
                for x in model.robot.couplings
            },
            "followers": {name: list(leaders) for name, leaders in model.leaders.items()},
            "home": dict(model.robot.home),
            "limits": {x: limits.numbers() for x in model.coordinates if (limits := model.robot.limits_of(x))},
            "mobility": None if self.mobility is None else self.mobility.as_dict(),
            "mass": self._mass(),
            "journals": {component_name(x.name, x.radial.TABLE): x.radial.law() for x in owners if x.radial},
            "joint_damping": {joint.name: joint.damping.law() for joint in model.robot.joints if joint.damping},
            **self._stiffness_matrices(),
            "springs": [x.as_dict() for x in model.robot.springs],
            **({"elements": [x.as_dict() for x in model.robot.elements]} if model.robot.elements else {}),
            **({"beams": [x.as_dict() for x in model.robot.beams]} if model.robot.beams else {}),
            **({"bending": bending} if bending else {}),
            "parameters": dict(model.parameters),
            "zeros": dict(self.zeros),
            "operations": {name: dict(count) for name, count in self.operations.items()},
            "choices": dict(self.choices),
        }

    def lines(self) -> list[str]:
        """Return a page of text."""
        model = self.model
        count = (
            f"{len(model.coordinates)} coordinates, {len(model.bodies)} joints that move, {self._mass():.6g} kg moving"
        )
        parameters = f"{len(model.parameters)} (kernel.parameters; list more under `tunable`)"
        sections = (
            [f"{model.name}: {count}"],
            self._joint_lines(),
            self._state_lines(),
            self._loop_lines(),
            [line for element in model.robot.link_elements for line in element.lines()],
            [beam.line() for beam in model.robot.beams],
            list(_bending_lines(model.robot)),
            self._start_lines(),
            self.mobility.lines() if self.mobility else [],
            self.zero_lines,
            self._operation_lines(),
            [f"run-time parameters: {parameters}", f"frames: {', '.join(model.frames)}"],
        )
        return [line for section in sections if section for line in ("", *section)][1:]

    def _stiffness_matrices(self) -> dict[str, Any]:
        """Return numbers of joints' stiffness matrices, where there are some."""
        matrices = {x.name: x.stiffness for x in self.model.robot.joints if x.stiffness is not None}
        return {"joint_stiffness": {name: matrix.law() for name, matrix in matrices.items()}} if matrices else {}

    def _mass(self) -> float:
        robot = self.model.robot
        return float(sum(robot.link(name).mass for name in self.model.links))

    def _joint_lines(self) -> list[str]:
        lines = ["coordinate                        stiffness     damping    armature"]
        for body in self.model.bodies:
            joint = self.model.robot.joint(body.joint)
            for name, coordinate in joint.all_coordinates.items():
                motor = joint.motor if name == MOTOR else None
                spring = motor.transmission if motor else coordinate
                numbers = (spring.stiffness, spring.damping, coordinate.armature)
                texts = ["-" if number is None else f"{number:.4g}" for number in numbers]
                label = f"{body.joint}.{name} [{UNITS[name]}]"
                role = "  prescribed" if coordinate.prescribed else ""
                if component_name(body.joint, name) in self.model.followers:
                    role = f"  follows {', '.join(self.model.leaders[component_name(body.joint, name)]) or 'nothing'}"
                lines.append(f"{label:<30} {texts[0]:>12}{texts[1]:>12}{texts[2]:>12}{role}")
                further = number_texts({**(spring.law() if motor else {}), **coordinate.law()})
                if motor is not None:
                    further.insert(0, f"drives {body.joint}.{joint.principal}, ratio {motor.ratio:.6g}")
                further += limit_texts(joint.limits_of(name), UNITS[name])
                lines += [f"  {', '.join(further)}"] if further else []
            for table, element in joint.elements.items():
                lines += element.lines(component_name(joint.name, table))
        return lines

    def _state_lines(self) -> list[str]:
        """Return the internal states, where there are some, with what they store."""
        states = {f"{name} [{state['unit']}]": state for name, state in _states_of(self.model).items()}
        width = max(map(len, states), default=0) + 2
        lines = [f"{'internal state':<{width}}{'law':<14}stores"] if states else []
        for label, state in states.items():
            stored = "nothing" if state["inertia"] is None else f"{0.5 * state['inertia']:.4g} z^2 J"
            lines.append(f"{label:<{width}}{state['law']:<14}{stored}")
        return lines

    def _loop_lines(self) -> list[str]:
        """Return the loop joints and couplings, where there are some."""
        loops, count = self.model.robot.loops, len(self.model.constraints)
        lines = []
        for loop in loops:
            lines.append(f"loop {loop.name}: {loop.type} joint between {loop.links[0]} and {loop.links[1]}, cut")
            lines += [
                f"  {name} [{UNITS[name]}]: {_law_text(coordinate)}" for name, coordinate in loop.coordinates.items()
            ]
            lines += [f"  {line}" for table, x in loop.elements.items() for line in x.lines(table)]
        lines += [_coupling_line(coupling) for coupling in self.model.robot.couplings]
        if not lines:
            return []
        followers = listed(list(self.model.followers))
        led = f"; no coordinates, since they follow: {followers}" if followers else ""
        return [*lines, f"{count} constraints; all else is that of the open tree{led}"]

    def _start_lines(self) -> list[str]:
        """Return drives and home, where the description names them."""
        robot, lines = self.model.robot, []
        if robot.driven is not None:
            lines.append(f"driven: {', '.join(self.model.coordinates[i] for i in self.model.driven) or 'nothing'}")
        if robot.home:
            lines.append("home: " + ", ".join(f"{x} {value:.6g} {unit_of(x)}" for x, value in robot.home.items()))
        return lines

    def _operation_lines(self) -> list[str]:
        lines = ["operations of the C           mul      add    div  sincos"]
        for name, count in self.operations.items():
            row = f"{count['mul']:>9}{count['add']:>9}{count['div']:>7}{count['sincos']:>8}"
            lines.append(f"{name:<24}{row}" + (f"  {self.choices[name]}" if name in self.choices else ""))
        return lines


def _states_of(model: Model) -> dict[str, dict[str, Any]]:
    """Return the internal states by name: the law, the unit, and w where w z^2 / 2 is what they store, else None."""
    found = {}
    for own in model.states:
        inertia = None if own.state.inertia is None else float(own.state.inertia(own.numbers))
        found[own.name] = {"law": own.law, "unit": own.unit, "inertia": inertia}
    return found


def _bending(robot: Robot) -> dict[str, dict[str, Any]]:
    """Return what is said of links that bend, by name; amplitudes without a limit are None."""
    found = {}
    for link in robot.links:
        if link.modes is not None:
            ends = [x if math.isfinite(x) else None for x in deflection_range(link)]
            found[link.name] = {**link.modes.as_dict(), "deflection_range": ends}
    return found


def _bending_lines(robot: Robot) -> Iterator[str]:
    """Yield lines about links that bend: their modes, and how far these reach."""
    for link in robot.links:
        if link.modes is not None:
            yield link.modes.line(link.name)
            if (line := range_line(link)) is not None:
                yield line


def _linear(coordinate: Coordinate) -> dict[str, float]:
    """Return stiffness and damping, as far as they are set."""
    return {key: value for key in CUT_NUMBERS if (value := getattr(coordinate, key)) is not None}


def _law_text(coordinate: Coordinate) -> str:
    return ", ".join(number_texts({**_linear(coordinate), **coordinate.law()})) or "free"


def _coupling_line(coupling: Coupling) -> str:
    terms = [f"{ratio:.6g} {name}" for name, ratio in coupling.to.items()]
    terms += [f"{coupling.offset or 0.0:.6g}"] if coupling.offset or not terms else []
    law = "rigid" if coupling.law is None else _law_text(coupling.law)
    return f"coupling {coupling.name}: {coupling.of} = {' + '.join(terms)}, {law}"


def robot_info(robot: RobotLike, *, progress: StageReport = no_report) -> RobotInfo:
    """Derive the robot's equations and say what came out; nothing is compiled."""
    from ..codegen.c.operation_counts import operations
    from ..codegen.joint.zeros import zero_map
    from ..codegen.kernels.equations import derive_equations

    model = derived_model(as_robot(robot))
    progress(f"deriving the equations of {len(model.coordinates)} coordinates")
    equations = derive_equations(model)
    zeros = zero_map(model)
    return RobotInfo(model, zeros.as_dict(), tuple(zeros.lines()), operations(equations), equations.choices)
