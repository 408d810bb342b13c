"""One page about a simulation: figures, the robot, the scenario, what was counted and what is to be minded."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from ..description import RobotLike, as_robot
from ..errors import EomgenError, InputError
from ..names import component_name
from ..pipeline.costs import RobotInfo, robot_info
from ..progress import Progress, no_progress, tells_at_prompt
from ..robot.coordinates import UNITS
from ..robot.laws import number_texts
from ..robot.model import build_model
from ..robot.value import MOTOR, Coordinate, Robot
from ..simulation.balance import TERMS
from ..simulation.result import SimulationResult, simulated_robot
from .page_figures import figures_of
from .report import Report, Table, sorted_notes

ROWS = 12  # of a table that a scenario shows of a long one


@tells_at_prompt("reporting")
def report_of(
    result: SimulationResult | Any,
    robot: RobotLike | None = None,
    *,
    modes: bool = True,
    progress: Progress = no_progress,
) -> Report:
    """Return the report of a simulation, or of a result of measurements (``measured.kinds.PAGES`` has those).

    Args:
        result: from ``simulate``, ``run_scenario`` or ``load_result``; or from ``calibrate``, ``accuracy`` and others,
            which need nothing else.
        robot: that was simulated; by default the one that the result keeps.  Without either the page is made of what
            the result has, and says what is missing.
        modes: whether frequencies along the reference trajectory are computed, which compiles further kernels.
        progress: called with a fraction from 0 to 1 and a line of text.

    Raises:
        InputError: the robot is not that of the result, or Matplotlib is not installed.
    """
    if not isinstance(result, SimulationResult):
        from .measured.kinds import page_of

        if robot is not None:
            raise InputError(f"report: robot {as_robot(robot).name} is given; allowed: with simulations")
        return page_of(result)
    missing: list[str] = []
    simulated, info = _robot(result, robot, missing)
    figures = figures_of(result, simulated, missing, modes=modes, progress=progress)
    tables = [_coordinate_table(simulated), *_body_tables(simulated)] if simulated else [_motion_table(result)]
    tables.append(_rotation_table(result))
    tables.append(Table("Scenario, SI units", ("key", "value"), tuple(_entries("", result.scenario))))
    if result.balance is not None:
        tables.append(_balance_table(result))
    else:
        missing.append("the energy balance: the result was written by an eomgen without one")
    if info is not None:
        tables.append(_operation_table(info))
    tables.append(_origin_table(result))
    said = [*result.notes, *(simulated.notes if simulated else ())]
    unclosed = result.balance.note() if result.balance is not None else None
    warnings, notes = sorted_notes(line for line in said if line != unclosed)
    stopped = [f"stopped too early: {result.stopped['reason']}"] if result.stopped else []
    warnings = (*stopped, *([unclosed] if unclosed else []), *warnings)
    title = f"{result.robot}: {result.trajectory.t[-1]:g} s of simulated motion"
    lines = [line.strip() for line in result.summary_lines() if line.strip() not in (*warnings, *notes)]
    drawn_tables = tuple(table for table in tables if table.rows)
    return Report(title, tuple(lines), warnings, tuple(missing), tuple(figures), drawn_tables, notes)


def _robot(
    result: SimulationResult, robot_like: RobotLike | None, missing: list[str]
) -> tuple[Robot | None, RobotInfo | None]:
    """The robot and what its equations cost, as far as there is one."""
    if robot_like is None and not result.description:
        what = "the robot's joints, links and springs, operation counts, zeros, frequencies"
        why = f"the result does not keep its robot ({result.robot}); give its description: --robot"
        missing.append(f"{what}: {why}")
        return None, None
    robot = simulated_robot(result, robot_like)
    try:
        return robot, robot_info(robot)
    except EomgenError as error:
        missing.append(f"operation counts: {error}")
        return robot, None


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.6g}"


def _law(coordinate: Coordinate) -> str:
    """Text about the laws of a coordinate beyond stiffness and damping."""
    parts = number_texts(coordinate.law())
    if coordinate.armature is not None:
        parts.insert(0, f"armature {coordinate.armature:.4g}")
    return ", ".join(parts)


def _coordinate_table(robot: Robot) -> Table:
    rows = []
    for joint in robot.joints:
        ends = f"{joint.parent} to {joint.child}"
        if not joint.all_coordinates:
            rows.append((joint.name, joint.type, ends, "", "", "", "rigid", ""))
        for name, coordinate in joint.all_coordinates.items():
            motor = joint.motor if name == MOTOR else None
            spring = motor.transmission if motor else coordinate
            role = "principal" if name == joint.principal else "motor" if motor else "deviation"
            role = "prescribed" if coordinate.prescribed else "free" if joint.is_free else role
            law = _law(coordinate) if motor is None else f"ratio {motor.ratio:.6g}, rotor {_law(coordinate)}"
            label = component_name(joint.name, name)
            unit = UNITS[name]
            rows.append((label, joint.type, ends, unit, _number(spring.stiffness), _number(spring.damping), role, law))
        for table, element in joint.elements.items():
            label, law = component_name(joint.name, table), ", ".join(number_texts(element.law()))
            rows.append((label, joint.type, ends, element.UNITS[1], "", "", element.ROLE, law))
    head = ("coordinate", "joint", "links", "unit", "stiffness", "damping", "role", "further")
    return Table("Joints and coordinates", head, tuple(rows))


def _body_tables(robot: Robot) -> Iterator[Table]:
    moving = set(build_model(robot).links)
    links = [
        (
            link.name,
            _number(link.mass),
            _vector(link.com),
            _vector(link.inertia),
            "" if link.name in moving else "fixed",
        )
        for link in robot.links
    ]
    yield Table("Links", ("link", "mass, kg", "centre of mass, m", "xx, yy, zz, xy, xz, yz, kg m^2", ""), tuple(links))
    elements = []
    for element in robot.link_elements:
        ends = [f"{link} at {_vector(point)}" for link, point in zip(element.links, element.origins(), strict=True)]
        elements.append((element.name, element.kind, *ends, ", ".join(number_texts(element.law()))))
    yield Table("Springs between points", ("name", "kind", "from, m", "to, m", "law, SI units"), tuple(elements))
    frames = [(frame.name, frame.link, _vector(frame.placement.xyz)) for frame in robot.frames]
    yield Table("Frames", ("frame", "link", "origin, m"), tuple(frames))


def _vector(values: Any) -> str:
    return ", ".join(f"{x:.5g}" for x in values)


def _motion_table(result: SimulationResult) -> Table:
    """Coordinates as the motion alone has them."""
    motion = result.trajectory
    rows = []
    for name, unit, q in zip(motion.coordinates, result.units, motion.q.T, strict=True):
        role = "driven" if name in result.program_coordinates else "prescribed" if name in result.prescribed else ""
        rows.append((name, unit, _number(q.min()), _number(q.max()), role))
    return Table("Coordinates", ("coordinate", "unit", "least", "most", "role"), tuple(rows))


def _rotation_table(result: SimulationResult) -> Table:
    """Unit quaternions of the joints that have alpha, beta and gamma; no row where there is none."""
    motion, rows = result.trajectory, []
    for joint in motion.rotating:
        ends = motion.quaternion(joint)[[0, -1]]
        rows.append((joint, *(", ".join(f"{x:.6f}" for x in quaternion) for quaternion in ends)))
    head = ("joint", "at the start, (w, x, y, z)", "at the end, (w, x, y, z)")
    return Table("Rotations of joints, unit quaternions", head, tuple(rows))


def _entries(where: str, value: Any) -> Iterator[tuple[str, str]]:
    """Keys with dots and their values; of long arrays the size and the first and last entry."""
    if isinstance(value, Mapping):
        for key, inner in value.items():
            yield from _entries(f"{where}.{key}" if where else str(key), inner)
    elif isinstance(value, list) and any(isinstance(x, (Mapping, list)) for x in value) and len(value) <= ROWS:
        for i, inner in enumerate(value):
            yield from _entries(f"{where}[{i}]", inner)
    elif isinstance(value, list) and len(value) > ROWS:
        yield where, f"{len(value)} entries, from {_text(value[0])} to {_text(value[-1])}"
    else:
        yield where, _text(value)


def _text(value: Any) -> str:
    if isinstance(value, list):
        return "[" + ", ".join(map(_text, value)) + "]"
    return f"{value:g}" if isinstance(value, float) else str(value)


def _balance_table(result: SimulationResult) -> Table:
    balance = result.balance
    assert balance is not None
    facts = balance.summary()
    names = {term: "dissipated" if term == "dissipated" else f"work of {term}" for term in TERMS}
    rows = [(names[term], _number(facts[term]), _number(float(np.abs(balance.of(term)).max()))) for term in TERMS]
    energies = zip(("kinetic", "potential"), balance.energy.T, strict=True)
    rows += [(f"{name} energy", _number(facts[name]), _number(float(np.abs(e - e[0]).max()))) for name, e in energies]
    residue = balance.residue
    rows.append(("residue", _number(float(residue[-1])), _number(float(np.abs(residue).max()))))
    rows.append(("largest residue over the largest term", "", f"{facts['relative_residue']:.2g}"))
    return Table("Energy balance since the start", ("term", "at the end, J", "largest, J"), tuple(rows))


def _operation_table(info: RobotInfo) -> Table:
    rows = tuple(
        (name, *(str(count[key]) for key in ("mul", "add", "div", "sincos")), info.choices.get(name, ""))
        for name, count in info.operations.items()
    )
    head = ("kernel", "multiplications", "additions", "divisions", "sine-cosine pairs", "computed by")
    return Table("Operations of the generated C", head, rows)


def _origin_table(result: SimulationResult) -> Table:
    motion = result.trajectory
    rows = [("robot", result.robot), ("description, SHA-256", result.robot_hash), ("method", motion.method)]
    rows += [(key, f"{value:.4g}" if isinstance(value, float) else str(value)) for key, value in motion.info.items()]
    rows += [("samples", str(motion.t.size)), *((f"{key} version", text) for key, text in result.versions.items())]
    return Table("Origin", ("", ""), tuple(rows))
