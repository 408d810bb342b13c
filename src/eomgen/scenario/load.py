"""Reading of scenarios: a TOML file in, a Scenario out.  Keys: docs/scenario.md."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from ..errors import DescriptionError, InputError
from ..files import as_path
from ..forms.tables import Table
from ..forms.toml_place import located
from ..forms.toml_text import parse_toml, read_text
from ..identifiers import show_path
from ..motion.timetable import TimeTable
from ..names import nearest, show
from ..robot.coordinates import FORCES
from ..robot.geometry import ZERO
from ..robot.inertia_policy import lowest_moments
from ..robot.value import INERTIA_KEYS, Link
from .builtin import BUILTIN, builtin_scenarios
from .keys import SCENARIO
from .tables import CONTROL_READERS, MOTION_READERS, read_sampled, time_table
from .value import Initial, Integrator, Payload, Scenario, Section, Wrench


def load_scenario(source: str | Path) -> Scenario:
    """Read a scenario: the name of a built-in one, or the path of a .toml file.

    Raises:
        DescriptionError: with the file, the key, what came and what is allowed.
        InputError: a table's file cannot be used.
    """
    text, name, folder = read_scenario(source)
    return scenario_from_toml(text, source=name, folder=folder)


def as_scenario(scenario: Scenario | str | Path | Mapping[str, Any]) -> Scenario:
    """Return the scenario itself, the one that ``load_scenario`` reads, or the one of a mapping of a file's values.

    Raises:
        InputError: it is none of these; says what came and what is allowed.
        DescriptionError: as ``load_scenario``.
    """
    if isinstance(scenario, Scenario):
        return scenario
    if isinstance(scenario, Mapping):
        return scenario_from_values(scenario)
    if not isinstance(scenario, (str, Path)):
        raise InputError(
            f"scenario: got a value of type {type(scenario).__name__}; allowed: a Scenario (from load_scenario), the"
            f" name of a built-in one ({', '.join(builtin_scenarios())}), the path of a .toml file, or a dict of its"
            " values"
        )
    return load_scenario(scenario)


def read_scenario(source: str | Path) -> tuple[str, str, Path]:
    """Read a scenario's text, its name in messages, and the folder of the files that it names; errors as above."""
    if isinstance(source, str) and source in builtin_scenarios():
        return read_text(BUILTIN / f"{source}.toml", source), source, BUILTIN
    path = as_path(source, "scenario")
    if path.suffix != ".toml":
        known = builtin_scenarios()
        allowed = f"a path that ends in .toml, or one of {', '.join(known)}"
        raise DescriptionError(
            f"there is no scenario {show_path(str(source))}{nearest(str(source), known)}; allowed: {allowed}"
        )
    return read_text(path, str(path), ".toml file"), str(path), path.parent


def scenario_from_toml(text: str, *, source: str = "scenario", folder: Path | None = None) -> Scenario:
    """Return the scenario of a TOML text; files that it names are looked for in the folder; errors as above."""
    values = parse_toml(text, source)
    with located(text, values, source):
        return replace(scenario_from_values(values, source=source, folder=folder), text=text)


def scenario_from_values(
    values: Mapping[str, object], *, source: str = "scenario", folder: Path | None = None
) -> Scenario:
    """Return the scenario of a TOML file's values; errors as above."""
    top = SCENARIO.read(values, "", source, ())
    top.require()
    duration = top.number("duration")
    assert duration is not None
    integrator = top.table("integrator")
    return Scenario(
        duration,
        output_step=top.number("output_step"),
        frame=top.text("frame"),
        initial=_initial(top.table("initial")),
        motion=_section(top, "motion", MOTION_READERS, folder),
        control=_section(top, "control", CONTROL_READERS, folder),
        prescribed=tuple(_prescribed(entry, folder) for _, entry in top.entries("prescribed")),
        wrenches=tuple(_wrench(entry, folder) for _, entry in top.entries("wrenches")),
        payloads=tuple(_payload(entry) for _, entry in top.entries("payloads")),
        until=_until(top.table("until")),
        integrator=Integrator(**({} if integrator is None else integrator.present())),
        source=source,
        folder=folder,
    )


def _section(top: Table, key: str, readers: Mapping[str, Any], folder: Path | None) -> Section | None:
    table = top.table(key)
    if table is None:
        return None
    kind = table.text("type") or ""
    return Section(kind, {k: x for k, x in readers[kind](table, folder).items() if x is not None})


def _initial(table: Table | None) -> Initial | None:
    if table is None:
        return None
    equilibrium, v, q = table.boolean("equilibrium"), table.value("v") or {}, table.value("q") or {}
    if equilibrium and v:
        table.fail("velocities stand beside equilibrium = true, a static equilibrium; allowed: one of both", "v")
    if "held" in table and not equilibrium:
        table.fail("allowed: with equilibrium = true only", "held")
    z = MappingProxyType(table.value("z") or {})
    return Initial(MappingProxyType(q), MappingProxyType(v), equilibrium, tuple(table.strings("held")), z)


def _prescribed(entry: Table, folder: Path | None) -> Section:
    entry.require()
    kind = entry.text("type") or ""
    if kind == "sampled":
        return Section(kind, read_sampled(entry, folder))
    return Section(kind, {"phase": 0.0, "offset": 0.0, **entry.present()})


def _times(entry: Table) -> tuple[float, float | None]:
    t0, t1 = entry.number("t0") or 0.0, entry.number("t1")
    if t1 is not None and t1 <= t0:
        entry.fail(f"got {t1:g}; allowed: a time in s after t0, {t0:g}", "t1")
    return t0, t1


def _wrench(entry: Table, folder: Path | None) -> Wrench:
    entry.require()
    constant = {key: entry.vector(key) for key in ("force", "moment") if key in entry}
    if bool(constant) == ("rows" in entry or "file" in entry):
        entry.fail("needs force and/or moment, or rows, or file; allowed: one of these")
    if constant:
        if "interpolation" in entry:
            entry.fail("allowed: with rows or file only", "interpolation")
        zero = (0.0, 0.0, 0.0)
        row = [*(constant.get("force") or zero), *(constant.get("moment") or zero)]
        table = TimeTable(FORCES, np.zeros(1), np.array([row]), True)
    else:
        table = time_table(entry, folder, FORCES)
    axes = entry.choice("axes") or "base"
    return Wrench(entry.text("link") or "", table, axes, entry.vector("point"), *_times(entry))


def _payload(entry: Table) -> Payload:
    entry.require()
    mass, point = entry.number("mass"), entry.vector("point")
    assert mass is not None
    assert point is not None
    table = entry.table("inertia")
    xx, yy, zz, xy, xz, yz = (0.0 if table is None else table.number(key) or 0.0 for key in INERTIA_KEYS)
    inertia = (xx, yy, zz, xy, xz, yz)
    if lowest_moments([Link("payload", mass, ZERO, inertia)], [math.hypot(*point)])[0] < 0.0:
        rule = "each principal moment of inertia is at most the sum of the others, none is below zero"
        entry.fail(f"got {show(list(inertia))}, which no body can have; allowed: {rule}", "inertia")
    return Payload(entry.text("link") or "", mass, point, inertia, *_times(entry))


def _until(table: Table | None) -> Section | None:
    """Return the section of the terminal event, of the type "coordinate" or "distance"."""
    if table is None:
        return None
    kinds = {"coordinate": {"coordinate", "value"}, "distance": {"frame", "point", "distance"}}
    kind = next((kind for kind, keys in kinds.items() if keys == {*table.values}), None)
    if kind is None:
        table.fail("allowed: coordinate and value, or frame, point and distance")
    return Section(kind, table.present())
