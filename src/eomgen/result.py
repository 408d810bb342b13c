"""What a simulation yields: a trajectory beside its program, its summary, and its file."""

from __future__ import annotations

import json
import os
import secrets
import zipfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .errors import InputError
from .integrate import Trajectory
from .robot import LINEAR, MOTOR

Array = NDArray[np.float64]

FORMAT = 1  # of the .npz; raised when a reader of the old one would misread it


@dataclass(frozen=True)
class SimulationResult:
    """A simulated motion beside its program.

    Attributes:
        robot: the robot's name.
        trajectory: all n coordinates over T times.
        program_coordinates, program_q: names of the coordinates that are driven, themselves or by a motor, (p,), and
            their program, (T, p), m or rad.
        tool: name of the frame that is looked at.
        pose, program_pose: its pose, and that of the rigid robot on its program, (T, 4, 4), base axes, m.
        notes: lines about the method and about what was assumed.
        versions: of eomgen, NumPy and Python.
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

    @property
    def deviation_coordinates(self) -> tuple[str, ...]:
        """Names of the coordinates without a program; motors follow their joints' and are left out."""
        return tuple(
            name
            for name in self.trajectory.coordinates
            if name not in self.program_coordinates and name.rpartition(".")[2] != MOTOR
        )

    @property
    def deviations(self) -> Array:
        """Those coordinates over time, (T, n - p), m or rad."""
        return self.trajectory.q[:, index_of(self.trajectory.coordinates, self.deviation_coordinates)]

    @property
    def tracking_error(self) -> Array:
        """Driven coordinates less their program, (T, p), m or rad."""
        return self.trajectory.q[:, index_of(self.trajectory.coordinates, self.program_coordinates)] - self.program_q

    @property
    def tool_deviation(self) -> Array:
        """The tool's place less its program, (T, 3), m, base axes."""
        return self.pose[:, :3, 3] - self.program_pose[:, :3, 3]

    @property
    def tool_rotation(self) -> Array:
        """Angle between the tool's axes and their program, (T,), rad."""
        turn = np.swapaxes(self.program_pose[:, :3, :3], 1, 2) @ self.pose[:, :3, :3]
        skew = np.stack([turn[:, 2, 1] - turn[:, 1, 2], turn[:, 0, 2] - turn[:, 2, 0], turn[:, 1, 0] - turn[:, 0, 1]])
        angle: Array = np.arctan2(np.linalg.norm(skew, axis=0), np.trace(turn, axis1=1, axis2=2) - 1.0)
        return angle

    @property
    def units(self) -> tuple[str, ...]:
        """Unit of every coordinate, "m" or "rad", (n,)."""
        return tuple(unit_of(name) for name in self.trajectory.coordinates)

    def summary(self) -> dict[str, Any]:
        """What came out, as plain numbers and texts that JSON can hold; SI units, rad."""
        motion, tool = self.trajectory, np.linalg.norm(self.tool_deviation, axis=1)
        return {
            "robot": self.robot,
            "coordinates": len(motion.coordinates),
            "driven": list(self.program_coordinates),
            "duration": float(motion.t[-1]),
            "method": motion.method,
            **{key: float(value) if key == "wall_s" else int(value) for key, value in motion.info.items()},
            "tool": self.tool,
            "tool_deviation_max": float(tool.max()),
            "tool_deviation_max_at": float(motion.t[int(tool.argmax())]),
            "tool_deviation_end": float(tool[-1]),
            "tool_rotation_max": float(self.tool_rotation.max()),
            "linear_max": _largest(self.deviation_coordinates, self.deviations, "m"),
            "angular_max": _largest(self.deviation_coordinates, self.deviations, "rad"),
            "tracking_max": {
                "m": _largest(self.program_coordinates, self.tracking_error, "m"),
                "rad": _largest(self.program_coordinates, self.tracking_error, "rad"),
            },
            "notes": list(self.notes),
            "versions": dict(self.versions),
        }

    def summary_lines(self) -> list[str]:
        """The summary for a reader, lengths in micrometres and angles in microradians."""
        facts = self.summary()
        lines = [
            f"{self.robot}: {facts['coordinates']} coordinates, {len(self.program_coordinates)} of them driven, "
            f"{facts['duration']:g} s of motion",
            f"  {facts['method']}: {facts['steps']} steps, {facts['evaluations']} evaluations, "
            f"{facts['jacobians']} Jacobians, {facts['wall_s']:.2f} s",
            f"  tool {self.tool}: off its program by at most {facts['tool_deviation_max'] * 1e6:.3g} um "
            f"(at {facts['tool_deviation_max_at']:.3f} s) and {facts['tool_rotation_max'] * 1e6:.3g} urad; "
            f"{facts['tool_deviation_end'] * 1e6:.3g} um at the end",
        ]
        found = [("largest deviation", facts["linear_max"]), ("largest deviation", facts["angular_max"])]
        found += [("largest error of a drive", entry) for entry in facts["tracking_max"].values()]
        for text, entry in found:
            if entry:
                unit = "um" if entry["unit"] == "m" else "urad"
                lines.append(f"  {text}: {entry['coordinate']} {entry['value'] * 1e6:+.3g} {unit}")
        return lines + [f"  {note}" for note in self.notes]

    def save(self, path: Path | str) -> Path:
        """Write the result as .npz, to a temporary name first, and return the path; folders are made.

        Raises:
            InputError: the file cannot be written.
        """
        motion, target = self.trajectory, Path(path)
        text = {"robot": self.robot, "tool": self.tool, "method": motion.method, "notes": self.notes}
        meta = json.dumps({"format": FORMAT, **text, "info": dict(motion.info), "versions": dict(self.versions)})
        arrays: dict[str, Any] = {name: getattr(motion, name) for name in ("t", "q", "v", "u", "energy")}
        arrays.update({name: getattr(self, name) for name in ("program_q", "pose", "program_pose")})
        arrays.update(coordinates=motion.coordinates, units=self.units, program_coordinates=self.program_coordinates)

        def write(stream: Any) -> None:
            np.savez_compressed(stream, meta=meta, **arrays)

        return write_atomically(target, write)


def load_result(path: Path | str) -> SimulationResult:
    """The result that ``SimulationResult.save`` wrote.

    Raises:
        InputError: the file does not exist, or is not such a result.
    """
    try:
        with np.load(path, allow_pickle=False) as data:
            meta = json.loads(str(data["meta"]))
            if meta["format"] > FORMAT:
                raise InputError(
                    f"{path}: written by eomgen {meta['versions'].get('eomgen')}, which is newer than this one"
                )
            t, q, v, u, energy = (np.array(data[name]) for name in ("t", "q", "v", "u", "energy"))
            names = tuple(str(name) for name in data["coordinates"])
            return SimulationResult(
                meta["robot"],
                Trajectory(t, q, v, u, energy, names, meta["method"], meta["info"]),
                tuple(str(name) for name in data["program_coordinates"]),
                np.array(data["program_q"]),
                meta["tool"],
                np.array(data["pose"]),
                np.array(data["program_pose"]),
                tuple(meta["notes"]),
                MappingProxyType(dict(meta["versions"])),
            )
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from None
    except (ValueError, KeyError, TypeError, AttributeError, zipfile.BadZipFile, EOFError) as error:
        raise InputError(f"{path}: is not a saved simulation ({error})") from None


def unit_of(coordinate: str) -> str:
    """Unit of a coordinate by its name, "m" or "rad"."""
    return "m" if coordinate.rpartition(".")[2] in LINEAR else "rad"


def write_atomically(target: Path, write: Callable[[Any], None]) -> Path:
    """Call ``write(stream)`` on a temporary file beside the target, rename it into place, and return the target.

    Raises:
        InputError: the folder or the file cannot be written.
    """
    temporary = target.with_name(f".{target.name}-{os.getpid()}-{secrets.token_hex(4)}")
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        try:
            with temporary.open("xb") as stream:
                write(stream)
            temporary.replace(target)
        finally:
            temporary.unlink(missing_ok=True)
    except OSError as error:
        raise InputError(f"{target} cannot be written: {error.strerror or error}") from None
    return target


def _largest(names: Sequence[str], values: Array, unit: str) -> dict[str, Any] | None:
    """The largest value of that unit over time, with its sign and its coordinate; None if there is none."""
    columns = [i for i, name in enumerate(names) if unit_of(name) == unit]
    if not columns:
        return None
    row, column = np.unravel_index(int(np.abs(values[:, columns]).argmax()), (values.shape[0], len(columns)))
    return {"coordinate": names[columns[column]], "value": float(values[row, columns[column]]), "unit": unit}


def index_of(names: Sequence[str], wanted: Sequence[str]) -> NDArray[np.intp]:
    """Where the wanted coordinates are among the names."""
    return np.array([names.index(name) for name in wanted], dtype=np.intp)
