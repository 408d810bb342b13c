"""The result of a simulation: a trajectory beside its reference, its summary, and its file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..description import RobotLike, as_robot
from ..description.recorded import robot_from_record
from ..errors import InputError, UnknownNameError
from ..files import as_path
from ..forms.plain import printable
from ..identifiers import plain_path
from ..integration.contacts import STOP, Contact
from ..integration.reference_motions import GlobalError
from ..integration.trajectory import Trajectory, motion_columns
from ..motion.files import MeasuredMotion, write_motion
from ..names import kind_of, listed, nearest, show
from ..npz import read_npz
from ..results.contents import FORMAT, META, as_plain, plain_fields, plain_of, write_npz
from ..robot.coordinates import index_of, unit_of
from ..robot.model import build_model
from ..robot.record import robot_hash
from ..robot.value import MOTOR, Robot
from ..scenario.recorded import scenario_from_record
from ..shown import Plotting, Shown, prefixed
from ..tabular import AXES, Rows, TableColumn, Tabular
from .balance import TERMS, EnergyBalance
from .contents import ARRAYS, BALANCE, DERIVED, ERROR, OLDER_NAMES, RESULT, TRAJECTORY, Meta, check_contents, meta_of

WHOLE = ("steps", "evaluations", "jacobians", "redundant")  # numbers of a trajectory's ``info``


@dataclass(frozen=True)
class Series(Shown):
    """Values of a name over time: t (T,), s; values (T,) or (T, k), in their unit."""

    name: str
    unit: str
    t: Array
    values: Array


@dataclass(frozen=True, kw_only=True)
class SimulationResult(Plotting, Shown, Tabular, plot="plot_series"):
    """A simulated motion beside its reference trajectory.

    Attributes:
        robot: the robot's name.
        trajectory: all n coordinates over T times.
        program_coordinates, program_q: names of the coordinates that are driven, themselves or by a motor, (p,), and
            their reference trajectory, (T, p), m or rad; of a compensated path the one that it corrects.
        tool: name of the frame of the poses.
        pose, program_pose: its pose, and that of the rigid robot on its reference, (T, 4, 4), base frame, m.
        notes: lines about the method and about assumptions.
        versions: of eomgen, NumPy and Python.
        programmed: whether there was a reference; if not, ``program_q`` is the motion of the principal coordinates, and
            ``program_pose`` leaves out the deviations alone.
        prescribed: names of the prescribed coordinates.
        passive: names of the coordinates that depend on the driven ones through loops.
        robot_hash: of the description, as ``robot.record.robot_hash`` makes it.
        scenario: the scenario, as ``Scenario.as_dict`` has it.
        links: names of the links of ``wrench``, (T, links, 6), N, N m, as kernels take it; None without wrenches.
        balance: the energy balance; None in files of eomgen 0.1 before it was there.
        description: the robot that was simulated, as ``robot.record.record_of`` has it; empty in older files.
        stopped: empty where the motion came to its end; else its ``reason`` (text), the ``coordinate`` to blame, and
            the last good state: ``t`` (s), ``q`` and ``v`` (n numbers each), and ``z`` of internal states, if any.
        global_error: estimated error of the integration, with that of the tool; None where it was not asked for.
    """

    robot: str
    trajectory: Trajectory
    program_coordinates: tuple[str, ...]
    program_q: Array
    tool: str
    pose: Array
    program_pose: Array
    notes: tuple[str, ...]
    versions: Mapping[str, str]
    programmed: bool = True
    prescribed: tuple[str, ...] = ()
    passive: tuple[str, ...] = ()
    robot_hash: str = ""
    scenario: Mapping[str, Any] = field(default_factory=dict)
    links: tuple[str, ...] = ()
    wrench: Array | None = None
    balance: EnergyBalance | None = None
    description: Mapping[str, Any] = field(default_factory=dict)
    stopped: Mapping[str, Any] = field(default_factory=dict)
    global_error: GlobalError | None = None

    @property
    def deviation_coordinates(self) -> tuple[str, ...]:
        """Names of the coordinates that no reference, prescribed motion or loop moves; motors follow their joints'."""
        others = (*self.program_coordinates, *self.prescribed, *self.passive)
        names = self.trajectory.coordinates
        return tuple(name for name in names if name not in others and kind_of(name) != MOTOR)

    @property
    def deviations(self) -> Array:
        """Deviations over time, (T, n - p), m or rad."""
        return self.trajectory.q[:, index_of(self.trajectory.coordinates, self.deviation_coordinates)]

    @property
    def tracking_error(self) -> Array:
        """Driven coordinates less their reference, (T, p), m or rad."""
        return self.trajectory.q[:, index_of(self.trajectory.coordinates, self.program_coordinates)] - self.program_q

    @property
    def tool_deviation(self) -> Array:
        """TCP position error: the tool's position less its reference, (T, 3), m, base frame."""
        return self.pose[:, :3, 3] - self.program_pose[:, :3, 3]

    @property
    def tool_rotation(self) -> Array:
        """TCP orientation error: the angle between the tool's orientation and its reference, (T,), rad."""
        return angle_between(self.program_pose, self.pose)

    @property
    def units(self) -> tuple[str, ...]:
        """Unit of every coordinate, "m" or "rad", (n,)."""
        return tuple(unit_of(name) for name in self.trajectory.coordinates)

    def summary(self) -> dict[str, Any]:
        """Return results in short, as plain numbers and texts that JSON can hold; SI units, rad."""
        motion, tool = self.trajectory, np.linalg.norm(self.tool_deviation, axis=1)
        turned = self.tool_rotation
        return {
            "robot": self.robot,
            "coordinates": len(motion.coordinates),
            "driven": list(self.program_coordinates) if self.programmed else [],
            "duration": float(motion.t[-1]),
            "method": motion.method,
            **{key: int(value) if key in WHOLE else float(value) for key, value in motion.info.items()},
            "tool": self.tool,
            "tool_deviation_max": float(tool.max()),
            "tool_deviation_max_at": float(motion.t[int(tool.argmax())]),
            "tool_deviation_end": float(tool[-1]),
            "tool_rotation_max": float(turned.max()),
            "tool_rotation_end": float(turned[-1]),
            "linear_max": _largest(self.deviation_coordinates, self.deviations, "m"),
            "angular_max": _largest(self.deviation_coordinates, self.deviations, "rad"),
            "tracking_max": {
                unit: _largest(self.program_coordinates, self.tracking_error, unit) if self.programmed else None
                for unit in ("m", "rad")
            },
            "energy": None if self.balance is None else self.balance.summary(),
            "global_error": None if self.global_error is None else self.global_error.summary(),
            "notes": list(self.notes),
            "stopped": dict(self.stopped) or None,
            "versions": dict(self.versions),
        }

    def summary_lines(self) -> list[str]:
        """Return the summary as lines of text."""
        facts = self.summary()
        error = "tracking error" if self.programmed else "deviation from the rigid robot"
        steps = f"{facts['steps']} steps, " if facts["steps"] else ""
        deviation, rotation = (
            [prefixed(facts[f"tool_{error_kind}_{when}"], unit) for when in ("max", "end")]
            for error_kind, unit in (("deviation", "m"), ("rotation", "rad"))
        )
        lines = [
            f"{self.robot}: {facts['coordinates']} coordinates, "
            f"{f'{len(self.program_coordinates)} of them driven' if self.programmed else 'no reference'}, "
            f"{facts['duration']:g} s of motion",
            *([f"  stopped too early: {self.stopped['reason']}"] if self.stopped else []),
            f"  {facts['method']}: {steps}{facts['evaluations']} evaluations, {facts['jacobians']} Jacobians, "
            f"{facts['wall_s']:.2f} s",
            f"  tool {self.tool}: {error} at most {deviation[0]} (at {facts['tool_deviation_max_at']:.3f} s)"
            f" and {rotation[0]}; {deviation[1]} and {rotation[1]} at the end",
        ]
        largest = [("largest deviation", facts["linear_max"]), ("largest deviation", facts["angular_max"])]
        largest += [("largest tracking error", entry) for entry in facts["tracking_max"].values()]
        for text, entry in largest:
            if entry:
                lines.append(f"  {text}: {entry['coordinate']} {prefixed(entry['value'], entry['unit'], sign=True)}")
        if self.balance is not None:
            lines.append(f"  {self.balance.line()}")
        if self.global_error is not None:
            lines.append(f"  {self.global_error.line()}")
        lines += [*self._contact_lines(), *self._rest_lines()]
        return lines + [f"  {note}" for note in self.notes]

    def _contact_lines(self) -> list[str]:
        """Say how often clearances closed and stops were touched, and the first time of each, in lines."""
        closings: dict[tuple[str, str], list[Contact]] = {}
        for c in self.trajectory.contacts:
            if c.closes:
                what = f"{'upper' if c.side > 0 else 'lower'} stop" if c.kind == STOP else "clearance"
                closings.setdefault((what, c.coordinate), []).append(c)
        return [
            f"  {what} of {name}: {'touched' if 'stop' in what else 'closed'} {len(contacts)} times, first at"
            f" {contacts[0].t:.4f} s{_direction(contacts[0])}"
            for (what, name), contacts in closings.items()
        ]

    def _rest_lines(self) -> list[str]:
        """Say how often and how long friction held each coordinate, and the first time of each, in lines."""
        lines, motion = [], self.trajectory
        for name in dict.fromkeys(rest.coordinate for rest in motion.rests):
            sticking = [rest for rest in motion.rests if rest.coordinate == name]
            whole = sum(rest.ends - rest.begins for rest in sticking)
            first = f"from {sticking[0].begins:.4f} to {sticking[0].ends:.4f} s"
            lines.append(f"  friction of {name}: held it {len(sticking)} times, {whole:.4g} s in all, first {first}")
        return lines

    @property
    def motion(self) -> MeasuredMotion:
        """The motion as if it had been measured, with the drives that are not always 0; ``forces``, ``fit`` take it."""
        motion = self.trajectory
        driven = tuple(name for name, u in zip(motion.coordinates, motion.u.T, strict=True) if u.any())
        return MeasuredMotion(
            coordinates=motion.coordinates,
            t=motion.t,
            q=motion.q,
            v=motion.v,
            a=None,
            u=motion.u,
            measured=motion.coordinates,
            driven=driven,
            source=f"the simulation of {self.robot}",
            states={} if motion.z is None else dict(zip(motion.internal_states or (), motion.z.T, strict=True)),
        )

    @property
    def names(self) -> tuple[str, ...]:
        """Names that ``series`` knows."""
        return tuple(self._series())

    def series(self, name: str) -> Series:
        """Return values over time by name, with their unit.

        Names are those of coordinates ("joint1.x"), with .rate, .drive or .program behind them; of internal states
        ("joint1.gamma.friction.z"); JOINT.qw, .qx, .qy and
        .qz of joints with alpha, beta and gamma (see ``Trajectory.quaternion``); TOOL.position (base frame) and
        TOOL.program; TOOL.rotation, the orientation error; LINK.force and LINK.moment of wrenches (about the centre of
        mass, base frame); where the global error is estimated NAME.error of coordinates, and TOOL.error of the
        position; energy.kinetic, energy.potential, energy.residue, and
        work.TERM with the terms of ``EnergyBalance``.

        Raises:
            UnknownNameError: there is nothing of that name; ``names`` has all.
        """
        known = self._series()
        if name not in known:
            raise UnknownNameError(f"series: {show(name)}{nearest(name, known)} is unknown; known: {listed(known)}")
        unit, values = known[name]
        return Series(name, unit, self.trajectory.t, values)

    def _series(self) -> dict[str, tuple[str, Array]]:
        motion = self.trajectory
        series = motion_columns(motion)
        for i, name in enumerate(self.program_coordinates if self.programmed else ()):
            series[f"{name}.program"] = (unit_of(name), self.program_q[:, i])
        series[f"{self.tool}.position"] = ("m", self.pose[:, :3, 3])
        series[f"{self.tool}.program"] = ("m", self.program_pose[:, :3, 3])
        series[f"{self.tool}.rotation"] = ("rad", self.tool_rotation)
        if self.global_error is not None:
            series |= self.global_error.columns(self.tool)
        for i, link in enumerate(self.links if self.wrench is not None else ()):
            assert self.wrench is not None
            series[f"{link}.force"] = ("N", self.wrench[:, i, :3])
            series[f"{link}.moment"] = ("N m", self.wrench[:, i, 3:])
        series["energy.kinetic"], series["energy.potential"] = (("J", column) for column in motion.energy.T)
        if self.balance is not None:
            series |= {f"work.{term}": ("J", self.balance.of(term)) for term in TERMS}
            series["energy.residue"] = ("J", self.balance.residue)
        return series

    def facts(self) -> dict[str, str]:
        """Return names and short texts that ``repr`` and notebooks show."""
        motion = self.trajectory
        shown = {"robot": show(self.robot), "coordinates": str(len(motion.coordinates))}
        shown |= {"driven": str(len(self.program_coordinates) if self.programmed else 0), "samples": str(motion.t.size)}
        shown |= {"duration": f"{motion.t[-1]:.6g} s", "method": show(motion.method), "tool": show(self.tool)}
        shown["tool_deviation"] = prefixed(float(np.linalg.norm(self.tool_deviation, axis=1).max()), "m")
        return shown | ({"stopped": show(self.stopped.get("reason", ""))} if self.stopped else {})

    def as_rows(self) -> Rows:
        """Return a row per time: all that ``series`` knows, vectors by x, y and z."""
        columns = [
            TableColumn(name, unit, values, AXES if values.ndim > 1 else ())
            for name, (unit, values) in self._series().items()
        ]
        about = {"robot": self.robot, "tool": self.tool, "method": self.trajectory.method}
        return Rows("t", "s", self.trajectory.t, columns, about)

    def save(self, path: Path | str) -> Path:
        """Write the result and return the path; folders are made, and files are written to a temporary name first.

        Args:
            path: of a file of all of it, .npz, which ``eomgen.load_result`` reads; or ending in .csv, of the motion
                alone: t, coordinates, .rate, and .drive where one is not always 0, as ``motion.read_motion`` reads it.

        Raises:
            InputError: the file cannot be written, or cannot be read back.
        """
        if as_path(path).suffix == ".csv":
            about = f"Motion of {self.robot}, simulated ({self.trajectory.method}): s, m and rad, N and N m."
            return write_motion(path, self.motion, [about])
        owners = {RESULT: self, TRAJECTORY: self.trajectory, BALANCE: self.balance, ERROR: self.global_error}
        contents = {item.name: getattr(owners[item.owner], item.name, None) for item in ARRAYS}
        texts = [item.name for item in ARRAYS if item.of is str]
        arrays = {name: np.asarray(x, str if name in texts else None) for name, x in contents.items() if x is not None}
        whose = {item.name: owners[item.metadata.get("owner", RESULT)] for item in fields(Meta)}
        values = {name: as_plain(getattr(owner, name, None)) for name, owner in whose.items()}
        meta = meta_of(values, "the result cannot be saved")
        check_contents(meta, arrays, "the result cannot be saved")
        return write_npz(path, {"format": FORMAT, **plain_fields(meta)}, arrays, load_result)


def angle_between(poses: Array, others: Array) -> Array:
    """Return the angles between the orientations of poses, (T, 4, 4), (T,), rad."""
    turn = np.swapaxes(poses[:, :3, :3], 1, 2) @ others[:, :3, :3]
    skew = np.stack([turn[:, 2, 1] - turn[:, 1, 2], turn[:, 0, 2] - turn[:, 2, 0], turn[:, 1, 0] - turn[:, 0, 1]])
    return np.asarray(np.arctan2(np.linalg.norm(skew, axis=0), np.trace(turn, axis1=1, axis2=2) - 1.0))


def _largest(names: Sequence[str], values: Array, unit: str) -> dict[str, Any] | None:
    """Return the largest value of that unit over time, with its sign and its coordinate; None if there is none."""
    columns = [i for i, name in enumerate(names) if unit_of(name) == unit]
    if not columns:
        return None
    row, column = np.unravel_index(int(np.abs(values[:, columns]).argmax()), (values.shape[0], len(columns)))
    return {"coordinate": names[columns[column]], "value": float(values[row, columns[column]]), "unit": unit}


def load_result(path: Path | str) -> SimulationResult:
    """Load the result that ``SimulationResult.save`` wrote as .npz; arrays, names, robot and scenario are checked.

    Raises:
        InputError: the file does not exist, or is not such a result; says what in it is wrong, and what is allowed.
    """
    if as_path(path).suffix == ".csv":
        raise InputError(
            f"{plain_path(Path(path))}: a .csv has columns of a motion, and no robot; allowed: the .npz of a result, or"
            " eomgen.motion.read_motion(path, coordinates) for the columns"
        )
    arrays = {OLDER_NAMES.get(name, name): array for name, array in read_npz(path).items()}
    meta = meta_of(_meta_in(arrays, path), f"{path}: {META}")
    arrays = check_contents(meta, arrays, str(path))
    owned: dict[str, dict[str, Any]] = {RESULT: {}, TRAJECTORY: {}, BALANCE: {}, ERROR: {}}
    for item in ARRAYS:
        if item.name in arrays and item.name not in DERIVED:
            owned[item.owner][item.name] = arrays[item.name]
    for entry in fields(Meta):
        value = getattr(meta, entry.name)
        owned[entry.metadata.get("owner", RESULT)][entry.name] = (
            MappingProxyType(value) if isinstance(value, dict) else value
        )
    trajectory = Trajectory(**owned[TRAJECTORY])
    balance = EnergyBalance(energy=trajectory.energy, **owned[BALANCE]) if owned[BALANCE] else None
    estimate = None
    if owned[ERROR]["unresolved"] is not None:
        estimate = GlobalError(coordinates=trajectory.coordinates, **owned[ERROR])
    result = SimulationResult(trajectory=trajectory, balance=balance, global_error=estimate, **owned[RESULT])
    if result.scenario:
        scenario_from_record(result.scenario, f"{path}: scenario")
    if result.description:
        _check_robot(_kept_robot(result, f"{path}: description"), result, f"{path}: description")
    return result


def _meta_in(arrays: dict[str, NDArray[Any]], path: Path | str) -> dict[str, Any]:
    """Take the meta from the arrays of a simulation's file; InputError if it has none, or a newer eomgen's."""
    if META not in arrays or arrays[META].shape != () or arrays[META].dtype.kind != "U":
        raise InputError(f"{path}: is not a saved simulation (meta is no text); allowed: a file that eomgen wrote")
    meta = plain_of(arrays, f"{path}: {META}")
    number = meta.get("format") if isinstance(meta, dict) else None
    if isinstance(number, bool) or not isinstance(number, int) or number < 1:
        raise InputError(
            f"{path}: is not a saved simulation (format: {show(number)}); allowed: a file that eomgen wrote"
        )
    if number > FORMAT:
        versions = meta.get("versions")
        version = versions.get("eomgen") if isinstance(versions, dict) else None
        raise InputError(
            f"{path}: written by eomgen {printable(str(version))[:40]}, which is newer than this one;"
            f" allowed: up to format {FORMAT}"
        )
    return dict(meta)


def _check_robot(robot: Robot, result: SimulationResult, where: str) -> None:
    """Refuse a robot that is not what the names in the result are of."""
    links = {link.name for link in robot.links}
    for what, ours, theirs in (
        ("name", result.robot, robot.name),
        ("list of coordinates", result.trajectory.coordinates, build_model(robot).coordinates),
        ("list of links", tuple(name for name in result.links if name in links), result.links),
        ("tool", result.tool, result.tool if result.tool in build_model(robot).frames else None),
    ):
        if ours != theirs:
            led = [name for name in robot.followers if name in result.trajectory.coordinates]
            more = f" ({listed(led)} follows others by couplings, and is no coordinate any more)" if led else ""
            raise InputError(f"{where}: its {what} is not that of the result{more}; allowed: the robot simulated")


def _kept_robot(result: SimulationResult, source: str) -> Robot:
    """Return the robot that a result keeps; InputError if it is none, or not that of the hash."""
    robot = robot_from_record(result.description, source)
    if robot_hash(robot) != result.robot_hash:
        raise InputError(
            f"the robot that the result keeps ({show(robot.name)}) is not that of its hash;"
            " allowed: the robot simulated"
        )
    return robot


def _direction(contact: Contact) -> str:
    """Say where a journal touches; nothing of other contacts."""
    if contact.angle is None:
        return ""
    end = {1: ", at the end towards +z", -1: ", at the end towards -z"}.get(contact.side, "")
    return f" in the direction of {np.degrees(contact.angle):.0f} deg{end}"


def simulated_robot(result: SimulationResult, expected: RobotLike | None = None) -> Robot:
    """Return the robot of a result: ``expected`` if it is that of the simulation, else the one that the result keeps.

    Raises:
        InputError: it is no result, the result keeps none and none is expected, or ``expected`` is another robot.
    """
    robot = None if expected is None else as_robot(expected)
    if not isinstance(result, SimulationResult):
        raise InputError(
            f"result: got a value of type {type(result).__name__}; allowed: a SimulationResult, from simulate,"
            " run_scenario or load_result"
        )
    if robot is not None:
        if result.robot_hash and robot_hash(robot) != result.robot_hash:
            raise InputError(
                f"robot: {robot.name} is not what was simulated as {result.robot}; allowed: the same description"
            )
        _check_robot(robot, result, "robot")
        return robot
    if not result.description:
        raise InputError(
            f"the result was written by an eomgen that did not keep the robot ({result.robot}) in it; give it: --robot"
        )
    return _kept_robot(result, f"the robot of the result ({result.robot})")
