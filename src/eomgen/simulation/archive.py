"""Results in files: .npz with arrays, names, units, and what they were made of."""

from __future__ import annotations

import json
import tokenize
import zipfile
import zlib
from dataclasses import asdict
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..description import RobotLike, as_robot
from ..errors import InputError
from ..files import write_atomically
from ..integration.contacts import Contact
from ..integration.trajectory import Trajectory
from ..names import show
from ..robot.record import robot_hash, robot_of
from ..robot.value import Robot
from .balance import EnergyBalance
from .result import SimulationResult

Array = NDArray[np.float64]

FORMAT = 1  # of the .npz; raised when a reader of the old one would misread it
_DAMAGED = (  # what NumPy and zipfile raise for files that are not what they wrote
    ValueError,
    KeyError,
    TypeError,
    AttributeError,
    EOFError,
    NotImplementedError,
    RuntimeError,
    SyntaxError,
    tokenize.TokenError,
    zipfile.BadZipFile,
    zlib.error,
)
_SERIES = ("t", "q", "v", "u", "energy")
_RECORDS = ("scenario", "description", "stopped")
_TEXTS = ("robot", "tool", "notes", "programmed", "prescribed", "robot_hash", "links")


def meta_of(result: SimulationResult) -> dict[str, Any]:
    """All of a result that is no array, as values that JSON holds."""
    motion = result.trajectory
    texts = {name: getattr(result, name) for name in _TEXTS}
    texts |= {"method": motion.method, "info": dict(motion.info), "versions": dict(result.versions)}
    texts["contacts"] = [asdict(contact) for contact in motion.contacts]
    records = {name: dict(getattr(result, name)) for name in _RECORDS}
    return {"format": FORMAT, **texts, **records}


def save_result(result: SimulationResult, path: Path | str) -> Path:
    """Write a result, see ``SimulationResult.save``."""
    motion = result.trajectory
    arrays: dict[str, Any] = {name: getattr(motion, name) for name in _SERIES}
    arrays |= {name: getattr(result, name) for name in ("program_q", "pose", "program_pose")}
    arrays |= {"coordinates": motion.coordinates, "units": result.units}
    arrays["program_coordinates"] = np.array(result.program_coordinates, dtype=str)
    if result.wrench is not None:
        arrays["wrench"] = result.wrench
    if result.balance is not None:
        arrays["work"] = result.balance.work
    meta = json.dumps(meta_of(result))
    return write_atomically(Path(path), lambda stream: np.savez_compressed(stream, meta=meta, **arrays))


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
            return result_of(meta, {name: np.array(data[name]) for name in data.files if name != "meta"})
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from None
    except _DAMAGED as error:
        raise InputError(f"{path}: is not a saved simulation ({error})") from None


def result_of(meta: dict[str, Any], arrays: dict[str, Any]) -> SimulationResult:
    """The result of what ``meta_of`` made, and arrays; KeyError if something is missing."""
    names = tuple(str(name) for name in arrays["coordinates"])
    series: dict[str, Any] = {name: arrays[name] for name in _SERIES}
    work = arrays.get("work")
    contacts = tuple(Contact(**contact) for contact in meta.get("contacts", ()))
    return SimulationResult(
        meta["robot"],
        Trajectory(**series, coordinates=names, method=meta["method"], info=meta["info"], contacts=contacts),
        tuple(str(name) for name in arrays["program_coordinates"]),
        arrays["program_q"],
        meta["tool"],
        arrays["pose"],
        arrays["program_pose"],
        tuple(meta["notes"]),
        MappingProxyType(dict(meta["versions"])),
        meta.get("programmed", True),
        tuple(meta.get("prescribed", ())),
        meta.get("robot_hash", ""),
        MappingProxyType(dict(meta.get("scenario", {}))),
        tuple(meta.get("links", ())),
        arrays.get("wrench"),
        None if work is None else EnergyBalance(work, series["energy"]),
        MappingProxyType(dict(meta.get("description", {}))),
        MappingProxyType(dict(meta.get("stopped", {}))),
    )


def simulated_robot(result: SimulationResult, given: RobotLike | None = None) -> Robot:
    """The robot of a result: the one given if it is that of the simulation, else the one that the result keeps.

    Raises:
        InputError: the result keeps none and none is given, or the one given is another robot.
    """
    if given is not None:
        given = as_robot(given)
        if result.robot_hash and robot_hash(given) != result.robot_hash:
            raise InputError(
                f"robot: {given.name} is not what was simulated as {result.robot}; allowed: the same description"
            )
        return given
    if not result.description:
        raise InputError(
            f"the result was written by an eomgen that did not keep the robot ({result.robot}) in it; give it: --robot"
        )
    robot = robot_of(result.description)
    if robot_hash(robot) != result.robot_hash:
        raise InputError(f"the robot that the result keeps ({show(robot.name)}) is not that of its hash")
    return robot
