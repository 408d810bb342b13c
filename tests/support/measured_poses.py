"""Measured poses of robots that are off, with what they are off by: for tests of calibration."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import eomgen
from eomgen.identification.geometry.error_model import ErrorModel, ErrorParameter, Rows, model_parameters, rows_of
from eomgen.identification.geometry.poses import MeasuredPoses, poses_from_columns
from eomgen.identification.geometry.rotations import pose_from, vectors_of
from eomgen.identification.geometry.stations import chain_of, matrix_of
from eomgen.motion.turns import rotation_of
from eomgen.robot.model import build_model, program_coordinates
from eomgen.robot.value import Coordinate, Frame, Joint, Link, Placement, Robot

Array = NDArray[np.float64]
TCP = [f"tcp.{part}" for part in ("x", "y", "z", "rx", "ry", "rz")]
BASE = np.array([1.0, 2.0, 0.5, 0.3, 1.0, -2.0])  # of the robot before the device


@dataclass(frozen=True)
class Trial:
    """Columns of a file, the error model that they are of, its rows and its true values."""

    robot: Robot
    columns: dict[str, Array]
    model: ErrorModel
    rows: Rows
    truth: Array

    def poses(self, *without: str) -> MeasuredPoses:
        """The poses, without columns that end so."""
        kept = {name: values for name, values in self.columns.items() if not name.endswith(without or ("?",))}
        return poses_from_columns(kept, build_model(self.robot).coordinates, list(self.model.chain.tools))


def chain(seed: int | np.random.Generator, kinds: str, special: bool = False) -> Robot:
    """A chain of revolute (R) and prismatic (P) joints; special: parallel, coaxial and intersecting axes, too."""
    rng = np.random.default_rng(seed)
    joints, links = list[Joint](), list[Link]()
    for i, kind in enumerate(kinds):
        xyz, rpy = rng.uniform(-0.4, 0.4, 3), rng.uniform(-3.0, 3.0, 3)
        if special:
            xyz = xyz * rng.integers(0, 2, 3)
            rpy = np.pi / 2 * rng.integers(0, 3, 3) * (rng.random(3) < 0.5)
        parent = f"link{i}" if i else "base"
        placed = Placement.from_rpy(tuple(map(float, xyz)), tuple(map(float, rpy)))  # type: ignore[arg-type]
        name, principal = ("revolute", "gamma") if kind == "R" else ("prismatic", "z")
        joints.append(
            Joint(f"joint{i + 1}", parent, f"link{i + 1}", name, placed, coordinates={principal: Coordinate()})
        )
        links.append(Link(f"link{i + 1}", 1.0 + i, (0.1, 0.05, 0.0), (0.1, 0.1, 0.1, 0.0, 0.0, 0.0)))
    end = Placement.from_rpy((0.1, 0.2, 0.15), (0.3, 0.5, -0.4))
    return Robot("chain", (0.0, 0.0, -9.81), tuple(links), tuple(joints), (Frame("tcp", links[-1].name, end),))


def trial(
    robot: Robot,
    seed: int,
    count: int,
    *,
    noise: tuple[float, float] = (5e-5, 1e-4),
    size: float = 1.0,
    frames: Mapping[str, tuple[str, Array]] | None = None,
    more: Sequence[ErrorParameter] = (),
    columns: Mapping[str, Array] | None = None,
) -> Trial:
    """Poses of a robot whose offsets are off by random numbers of the sizes that are expected, times ``size``.

    frames: link and pose of measured ones, by default the description's first.  more: further parameters, true at
    their size.  columns: further ones of the file, such as loads.
    """
    rng = np.random.default_rng(seed)
    measured = dict(frames or {x.name: (x.link, matrix_of(x.placement)) for x in robot.frames[:1]})
    stations = chain_of(robot, measured)
    q = {}
    for name in program_coordinates(robot):
        limits = robot.joint(name.rpartition(".")[0]).limits
        low, high = limits or ((-2.5, 2.5) if name.endswith("gamma") else (-0.4, 0.4))
        q[name] = rng.uniform(low, high, count)
    given = {**q, **(columns or {}), **{f"{frame}.x": np.zeros(count) for frame in measured}}
    given |= {f"{frame}.{axis}": np.zeros(count) for frame in measured for axis in "yz"}
    place = {station.name: k for k, station in enumerate(stations.stations) if station.joint}
    known = {name: (place[name.rpartition(".")[0]], 5 if name.endswith("gamma") else 2, 1.0) for name in q}
    rows = rows_of(stations, robot, poses_from_columns(given, build_model(robot).coordinates, list(measured)), known)
    described = {*(frame.name for frame in robot.frames), *(link.name for link in robot.links)}
    parameters = (*model_parameters(robot, stations, [0], {name: name in described for name in measured}), *more)
    model = ErrorModel(robot, stations, parameters, {0: pose_from(BASE)})
    truth = model.nominal + size * model.sizes * rng.normal(size=len(parameters))
    truth[:6] = 0.0
    for i, parameter in enumerate(parameters):
        if parameter in more:
            truth[i] = parameter.nominal + parameter.size
        elif parameter.size > 0.2:  # of frames that are attached
            truth[i] = model.nominal[i]
    state = model.at(truth, rows)
    found = {**q, **(columns or {})}
    for frame, station in stations.tools.items():
        p = state.located.p[station] + noise[0] * rng.normal(size=(count, 3))
        R = rotation_of(noise[1] * rng.normal(size=(count, 3))) @ state.located.R[station]
        found |= {f"{frame}.{axis}": values for axis, values in zip("xyz", p.T, strict=True)}
        found |= {f"{frame}.r{axis}": values for axis, values in zip("xyz", vectors_of(R).T, strict=True)}
    return Trial(robot, found, model, rows, truth)


@cache
def arm() -> Robot:
    """Two joints that turn and one that slides, with axes that are parallel and that meet."""
    return chain(4, "RRP", special=True)


@cache
def puma() -> Trial:
    return trial(eomgen.load_robot("puma560"), 0, 100)


def turned(columns: dict[str, Array]) -> Array:
    """Rotations of a file's rotation vectors."""
    return rotation_of(np.stack([columns[name] for name in TCP[3:]], axis=1))


def write_csv(path: Path, columns: dict[str, Array]) -> None:
    """Write a file of columns, empty cells where there is no number."""
    rows = [",".join("" if np.isnan(x) else repr(float(x)) for x in row) for row in zip(*columns.values(), strict=True)]
    path.write_text("\n".join(["# measured", ",".join(columns), *rows]) + "\n")
