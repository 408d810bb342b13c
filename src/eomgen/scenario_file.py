"""Reading of scenarios: a TOML file in, a Scenario out.  Keys: docs/scenario.md."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from .errors import DescriptionError
from .inertia import second_moments
from .integrate import METHODS
from .names import IDENTIFIER_RULE, nearest, show
from .robot import INERTIA_KEYS, ZERO, Link
from .scenario import COMPONENTS, Initial, Integrator, Payload, Scenario, Section, Wrench
from .scenario_tables import (
    CONTROL_READERS,
    MOTION_READERS,
    boolean,
    numbers_by_name,
    positive,
    read_sampled,
    time_table,
)
from .schema import Table
from .timetable import TimeTable
from .toml_place import located
from .toml_text import parse_toml, read_text

_BUILTIN = Path(__file__).parent / "scenarios"

INITIAL = ("q", "v", "equilibrium", "held")
MOTIONS: dict[str, tuple[str, ...]] = {
    "point_to_point": ("start", "goal", "begin", "duration"),
    "via": ("points", "times", "speed", "begin"),
    "sampled": ("file",),
    "line": ("frame", "from", "to", "begin", "duration"),
    "circle": ("frame", "center", "normal", "from", "angle", "begin", "duration"),
}
CONTROLS: dict[str, tuple[str, ...]] = {
    "none": (),
    "torque": ("file", "coordinates", "rows", "interpolation"),
    "pd": ("kp", "kd", "gravity"),
    "computed_torque": ("bandwidth",),
}
PRESCRIBED: dict[str, tuple[str, ...]] = {
    "harmonic": ("coordinate", "amplitude", "frequency", "phase", "offset"),
    "sampled": ("file",),
}
_WRENCH = ("link", "force", "moment", "axes", "point", "t0", "t1", "file", "rows", "interpolation")
_PAYLOAD = ("link", "mass", "point", "inertia", "t0", "t1")
INTEGRATOR = ("method", "rtol", "atol", "step")
TOP = (
    "duration",
    "output_step",
    "frame",
    "initial",
    "motion",
    "control",
    "prescribed",
    "wrenches",
    "payloads",
    "integrator",
)


def builtin_scenarios() -> tuple[str, ...]:
    """Names of the built-in scenarios, sorted."""
    return tuple(sorted(path.stem for path in _BUILTIN.glob("*.toml")))


def load_scenario(source: str | Path) -> Scenario:
    """Read a scenario: the name of a built-in one, or the path of a .toml file.

    Raises:
        DescriptionError: with the file, the key, what came and what is allowed.
        InputError: a table's file cannot be used.
    """
    text, name, folder = read_scenario(source)
    return scenario_from_toml(text, source=name, folder=folder)


def read_scenario(source: str | Path) -> tuple[str, str, Path]:
    """The text of a scenario, what messages call it, and the folder of the files that it names; errors as above."""
    if isinstance(source, str) and source in builtin_scenarios():
        return read_text(_BUILTIN / f"{source}.toml", source), source, _BUILTIN
    path = Path(source)
    if path.suffix != ".toml":
        known = builtin_scenarios()
        allowed = f"a path that ends in .toml, or one of {', '.join(known)}"
        raise DescriptionError(
            f"there is no scenario {show(str(source))}{nearest(str(source), known)}; allowed: {allowed}"
        )
    return read_text(path, str(path), ".toml file"), str(path), path.parent


def scenario_from_toml(text: str, *, source: str = "scenario", folder: Path | None = None) -> Scenario:
    """The scenario that a TOML text describes; files that it names are looked for in the folder; errors as above."""
    values = parse_toml(text, source)
    with located(text, values, source):
        return scenario_from_values(values, source=source, folder=folder)


def scenario_from_values(
    values: Mapping[str, object], *, source: str = "scenario", folder: Path | None = None
) -> Scenario:
    """The scenario of a TOML file's values; errors as above."""
    top = Table(values, "", source, TOP)
    top.require("duration", "a time in s that is greater than 0")
    duration = positive(top, "duration")
    assert duration is not None
    motion = _section(top, "motion", MOTIONS, MOTION_READERS, folder)
    control = _section(top, "control", CONTROLS, CONTROL_READERS, folder)
    return Scenario(
        duration,
        positive(top, "output_step"),
        top.text("frame"),
        _initial(top.table("initial", INITIAL)),
        motion,
        control,
        tuple(_prescribed(entry, folder) for entry in _entries(top, "prescribed", ("type", *_union(PRESCRIBED)))),
        tuple(_wrench(entry, folder) for entry in _entries(top, "wrenches", _WRENCH)),
        tuple(_payload(entry) for entry in _entries(top, "payloads", _PAYLOAD)),
        _integrator(top.table("integrator", INTEGRATOR)),
        source,
        folder,
    )


def _entries(top: Table, key: str, allowed: Sequence[str]) -> Iterator[Table]:
    value = top.values.get(key, [])
    if not isinstance(value, list):
        top.fail(f"got {show(value)}; allowed: an array of tables, written [[{key}]]", key)
    for index, item in enumerate(value):
        yield Table(item, f"{key}[{index}]", top.source, allowed)


def _union(kinds: Mapping[str, Sequence[str]]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(key for keys in kinds.values() for key in keys))


def _typed(table: Table, kinds: Mapping[str, Sequence[str]]) -> tuple[str, Table]:
    """The type of a table, and the table again with the keys of that type alone."""
    table.require("type", ", ".join(kinds))
    kind = table.choice("type", tuple(kinds))
    assert kind is not None
    return kind, Table(table.values, table.where, table.source, ("type", *kinds[kind]))


def _section(
    top: Table, key: str, kinds: Mapping[str, Sequence[str]], readers: Mapping[str, Any], folder: Path | None
) -> Section | None:
    table = top.table(key, ("type", *_union(kinds)))
    if table is None:
        return None
    kind, checked = _typed(table, kinds)
    return Section(kind, {k: x for k, x in readers[kind](checked, folder).items() if x is not None})


def _initial(table: Table | None) -> Initial | None:
    if table is None:
        return None
    equilibrium, v = boolean(table, "equilibrium"), numbers_by_name(table, "v")
    if equilibrium and v:
        table.fail(
            "rates are given together with equilibrium = true, which is a state of rest; allowed: one of both", "v"
        )
    if "held" in table and not equilibrium:
        table.fail("allowed: with equilibrium = true only", "held")
    return Initial(
        MappingProxyType(numbers_by_name(table, "q")), MappingProxyType(v), equilibrium, tuple(table.strings("held"))
    )


def _prescribed(entry: Table, folder: Path | None) -> Section:
    kind, table = _typed(entry, PRESCRIBED)
    if kind == "sampled":
        return Section(kind, read_sampled(table, folder))
    for key, what in (("coordinate", "a name such as joint1.x"), ("amplitude", "m or rad"), ("frequency", "Hz")):
        table.require(key, what)
    numbers = {key: table.number(key) or 0.0 for key in ("amplitude", "phase", "offset")}
    return Section(
        kind, {"coordinate": table.text("coordinate"), **numbers, "frequency": table.number("frequency", 0.0)}
    )


def _times(entry: Table) -> tuple[float, float | None]:
    t0, t1 = entry.number("t0", 0.0) or 0.0, entry.number("t1", 0.0)
    if t1 is not None and t1 <= t0:
        entry.fail(f"got {t1:g}; allowed: a time in s after t0, {t0:g}", "t1")
    return t0, t1


def _link(entry: Table) -> str:
    entry.require("link", "a link; " + IDENTIFIER_RULE)
    return entry.text("link") or ""


def _wrench(entry: Table, folder: Path | None) -> Wrench:
    constant = {key: entry.vector(key) for key in ("force", "moment") if key in entry}
    if bool(constant) == ("rows" in entry or "file" in entry):
        entry.fail("needs force and/or moment, or rows, or file; allowed: one of these")
    if constant:
        if "interpolation" in entry:
            entry.fail("allowed: with rows or file only", "interpolation")
        zero = (0.0, 0.0, 0.0)
        row = [*(constant.get("force") or zero), *(constant.get("moment") or zero)]
        table = TimeTable(COMPONENTS, np.zeros(1), np.array([row]), True)
    else:
        table = time_table(entry, folder, COMPONENTS)
    axes = entry.choice("axes", ("base", "link")) or "base"
    return Wrench(_link(entry), table, axes, entry.vector("point"), *_times(entry))


def _payload(entry: Table) -> Payload:
    for key, what in (("mass", "a mass in kg greater than 0"), ("point", "its centre of mass, link frame, m")):
        entry.require(key, what)
    mass, point = entry.number("mass", 0.0), entry.vector("point")
    if not mass:
        entry.fail("got 0; allowed: a mass in kg greater than 0", "mass")
    table = entry.table("inertia", INERTIA_KEYS)
    xx, yy, zz, xy, xz, yz = (0.0 if table is None else table.number(key) or 0.0 for key in INERTIA_KEYS)
    inertia = (xx, yy, zz, xy, xz, yz)
    if np.linalg.eigvalsh(second_moments([Link("payload", mass, ZERO, inertia)])[0])[0] < -1e-9 * max(xx, yy, zz, 0.0):
        rule = "each principal moment of inertia is at most the sum of the others, none is below zero"
        entry.fail(f"got {show(list(inertia))}, which no body can have; allowed: {rule}", "inertia")
    assert point is not None
    return Payload(_link(entry), mass, point, inertia, *_times(entry))


def _integrator(table: Table | None) -> Integrator:
    if table is None:
        return Integrator()
    method, rtol = table.choice("method", METHODS) or "auto", table.number("rtol")
    if rtol is not None and not 1e-13 <= rtol < 1.0:
        table.fail(f"got {rtol:g}; allowed: from 1e-13 to less than 1", "rtol")
    return Integrator(method, 1e-6 if rtol is None else rtol, table.number("atol", 0.0), positive(table, "step"))
