"""Error models as plain values of a file, and back: the robot, what is unknown of it, where bases and tools stand."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import numpy as np

from ...arrays import Array
from ...description.recorded import robot_from_record
from ...errors import InputError
from ...names import listed, show
from ...results.contents import Contents
from ...robot.model import build_model
from ...robot.record import record_of
from ...robot.value import COORDINATES
from ..geometry.blocks import ENTRY, FORCE, unfinished
from ..geometry.error_model import COMPLIANCE, DRIVE, OFFSET, PLACEMENT, ZERO, ErrorModel, ErrorParameter
from ..geometry.loop_constraints import closed_robot, closing_of
from ..geometry.stations import chain_of

_KINDS = (PLACEMENT, ZERO, OFFSET, COMPLIANCE, DRIVE)
_PLACES = tuple(map(str, range(len(COORDINATES))))
_NUMBER = re.compile(r"-?[0-9]{1,18}")
_HARMONIC = re.compile(r"[0-9]{1,20}(?:\.[0-9]{1,20})?(?:e[+-]?[0-9]{1,3})?")


def record_of_model(model: ErrorModel, frames: Mapping[str, str]) -> dict[str, Any]:
    """Return the values of a file from which ``model_from_record`` makes the model.

    Args:
        model: of a calibration.
        frames: link of every measured frame.
    """
    return {
        "description": record_of(model.robot),
        "quantities": model.parameters,
        "bases": {str(number): pose for number, pose in model.bases.items()},
        "tools": {name: model.tool_on_link(name, link) for name, link in frames.items()},
    }


def model_from_record(file: Contents, links: Mapping[str, str]) -> ErrorModel:
    """Return the error model that a file has, with the links of its measured frames.

    Raises:
        InputError: a value of it is missing, or they do not go together; names the file and the key.
        DescriptionError: its robot cannot be.
    """
    robot = robot_from_record(file.plain.get("description", {}), file.path)
    parameters = file.value(tuple[ErrorParameter, ...], "quantities")
    tools = _poses(file, "tools")
    if set(tools) != set(links):
        raise InputError(f"{file.path}: tools: got {listed(tools)}; allowed: those of frames, {listed(links)}")
    frames = {name: (link, tools[name]) for name, link in links.items()}
    bases = {_series(number, file.path): pose for number, pose in _poses(file, "bases").items()}
    chain, closing = chain_of(robot, frames), None
    for parameter in parameters:
        _check(parameter, len(chain.stations), file.path)
    alone = unfinished(parameters)
    if alone:
        raise InputError(f"{file.path}: quantities: {show(alone)}: got it alone; allowed: all entries of its matrix")
    if robot.is_closed:
        every = [(k, c) for k in range(len(chain.stations)) for c in range(6)]
        soft = [parameter for parameter in parameters if parameter.kind == COMPLIANCE]
        closing = closing_of(build_model(closed_robot(robot, chain, soft)), chain, every, file.path)
    return ErrorModel(robot, chain, parameters, bases, closing)


def _poses(file: Contents, name: str) -> dict[str, Array]:
    rows = file.value(Mapping[str, tuple[tuple[float, ...], ...]], name)
    for key, pose in rows.items():
        if [len(row) for row in pose] != [4] * 4:
            raise InputError(f"{file.path}: {name}.{show(key)}: got other numbers; allowed: a pose, 4 rows of 4")
    return {key: np.array(pose, dtype=np.float64) for key, pose in rows.items()}


def _series(number: str, path: str) -> int:
    if not _NUMBER.fullmatch(number):
        raise InputError(f"{path}: bases: got {show(number)}; allowed: numbers of series")
    return int(number)


def _check(parameter: ErrorParameter, stations: int, path: str) -> None:
    """Refuse a parameter that no model has; the message has the file and the key."""
    harmonic = parameter.factor[3:] if parameter.factor.startswith(("cos", "sin")) else ""
    where = f"{path}: quantities: {show(parameter.name)}"
    if harmonic and not _HARMONIC.fullmatch(harmonic):
        raise InputError(f"{where}: factor: got {show(parameter.factor)}")
    for key, value, allowed in (
        ("kind", parameter.kind, _KINDS),
        ("coordinate", str(parameter.coordinate), _PLACES),
        ("other", str(parameter.other), ("None", *_PLACES)),
    ):
        if value not in allowed:
            raise InputError(f"{where}: {key}: got {show(value)}; allowed: {listed(allowed)}")
    if (parameter.kind == COMPLIANCE) != (parameter.factor in (FORCE, ENTRY)):
        known = f"{FORCE} or {ENTRY}" if parameter.kind == COMPLIANCE else f"another than {FORCE} and {ENTRY}"
        raise InputError(f"{where}: factor: got {show(parameter.factor)}; allowed of a {parameter.kind}: {known}")
    if not 0 <= parameter.station < stations:
        raise InputError(
            f"{path}: {show(parameter.name)} is of station {parameter.station}; allowed: 0 to {stations - 1}"
        )
