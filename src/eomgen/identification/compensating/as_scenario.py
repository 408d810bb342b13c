"""Compensated paths as files: samples, and a scenario that follows them."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ...arrays import Array
from ...files import Reader, check_ending, write_atomically
from ...motion.files import read_motion
from ...motion.splines import Spline
from ...robot.coordinates import FORCES
from ...robot.value import INERTIA_KEYS
from ...scenario.load import load_scenario
from ...scenario.value import Integrator, Payload, Scenario, Section, Wrench


def write_program(result: Any, target: Path) -> list[Path]:
    """Write samples and scenario, and return both paths; errors as ``CompensationResult.to_scenario``."""
    check_ending(target, ".toml", label="toml")
    table, wanted = target.with_suffix(".csv"), target.with_name(f"{target.stem}_wanted.csv")
    tables = {table: result.corrected, wanted: result.program}
    texts: dict[Path, Iterator[str]] = {path: _sample_lines(result, samples) for path, samples in tables.items()}
    texts[target] = _scenario_lines(result.scenario, table.name, wanted.name, target.parent)
    readers = dict.fromkeys(tables, partial(read_motion, coordinates=result.coordinates)) | {target: load_scenario}
    return [_written(path, lines, readers[path]) for path, lines in texts.items()]


def _written(path: Path, lines: Iterator[str], read: Reader) -> Path:
    data = ("\n".join(lines) + "\n").encode("utf-8")
    return write_atomically(path, lambda stream: stream.write(data), read=read)


def _sample_lines(result: Any, samples: Array) -> Iterator[str]:
    what = "compensated path" if samples is result.corrected else "path that is wanted"
    yield f"# {what} of {result.robot}: m, rad, s"
    names = result.coordinates
    yield ",".join(["t", *names, *(f"{x}.rate" for x in names), *(f"{x}.acceleration" for x in names)])
    spline = Spline(result.t, samples, at_rest=False)
    _, v, a = spline.at(result.t)
    for row in np.column_stack([result.t, samples, v, a]).tolist():
        yield ",".join(map(repr, row))


def _scenario_lines(scenario: Scenario, samples: str, wanted: str, folder: Path) -> Iterator[str]:
    """Yield lines of a scenario that follows a file of samples."""
    yield "# A compensated path: the tool of the elastic robot goes where that of the rigid one would."
    yield from _pairs({"duration": scenario.duration, "output_step": scenario.output_step, "frame": scenario.frame})
    initial = scenario.initial
    if initial is not None:
        equilibrium, held = initial.equilibrium, list(initial.held) or None
        yield from _table("[initial]", {"q": initial.q or None, "v": initial.v or None, "equilibrium": equilibrium})
        yield from _pairs({"held": held})
    yield from _table("[motion]", {"type": "sampled", "file": samples, "wanted": wanted})
    if scenario.control is not None:
        yield from _table("[control]", {"type": scenario.control.type, **scenario.control.values})
    for section in scenario.prescribed:
        yield from _table("[[prescribed]]", {"type": section.type, **_beside(section, folder)})
    for wrench in scenario.wrenches:
        yield from _table("[[wrenches]]", _wrench(wrench))
    for payload in scenario.payloads:
        yield from _table("[[payloads]]", _payload(payload))
    if scenario.until is not None:
        yield from _table("[until]", scenario.until.values)
    if scenario.integrator != Integrator():
        how = scenario.integrator
        yield from _table("[integrator]", {key: getattr(how, key) for key in ("method", "rtol", "atol", "step")})


def _beside(section: Section, folder: Path) -> dict[str, Any]:
    """Return values of a section, with the path of its file as it is seen from a folder."""
    values = dict(section.values)
    if "file" in values:
        values["file"] = Path(os.path.relpath(values["file"], folder)).as_posix()
    return values


def _wrench(wrench: Wrench) -> dict[str, Any]:
    table, place = wrench.table, {"axes": wrench.axes, "point": wrench.point, "t0": wrench.t0, "t1": wrench.t1}
    if table.t.size == 1:
        row = table.values[0].tolist()
        return {"link": wrench.link, "force": row[:3], "moment": row[3:], **place}
    order = [table.columns.index(name) for name in FORCES]
    rows = np.column_stack([table.t, table.values[:, order]]).tolist()
    return {"link": wrench.link, "rows": rows, "interpolation": "hold" if table.hold else "linear", **place}


def _payload(payload: Payload) -> dict[str, Any]:
    inertia = dict(zip(INERTIA_KEYS, payload.inertia, strict=True))
    values = {"link": payload.link, "mass": payload.mass, "point": payload.point, "inertia": inertia}
    return {**values, "t0": payload.t0, "t1": payload.t1}


def _table(head: str, values: Mapping[str, Any]) -> Iterator[str]:
    yield ""
    yield head
    yield from _pairs(values)


def _pairs(values: Mapping[str, Any]) -> Iterator[str]:
    for key, value in values.items():
        if value is not None:
            yield f"{key} = {_value(value)}"


def _value(value: Any) -> str:
    """Return a value in TOML."""
    if isinstance(value, Mapping):
        pairs = ", ".join(f"{_key(name)} = {_value(x)}" for name, x in value.items())
        return f"{{ {pairs} }}"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(map(_value, value)) + "]"
    if isinstance(value, (bool, str)):
        return json.dumps(value)
    return repr(float(value))


def _key(name: str) -> str:
    """Return a key as TOML takes it beside others that begin with the same words."""
    return json.dumps(name) if "." in name else name
