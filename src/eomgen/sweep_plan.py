"""Reading of a sweep's plan: a TOML file in, a Plan out.  Keys: docs/sweep.md."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

from .errors import DescriptionError
from .names import nearest, show
from .rollout import METHODS
from .scenario_tables import positive
from .schema import Table
from .toml_place import located
from .toml_text import parse_toml, read_text

DESIGNS = ("random", "latin_hypercube")
ENGINES = ("auto", "rollout", "integrate")
RECORDS = (
    *("tool_deviation_max", "tool_deviation_rms", "tool_deviation_end", "tool_rotation_max"),
    *("drive_max", "drive_rms", "tracking_max", "deviation_max", "reaction_max"),
    *("coordinate_max", "coordinate_end", "energy_residue"),
)
DEFAULT_RECORD = ("tool_deviation_max", "tool_deviation_rms", "tool_deviation_end", "drive_max", "deviation_max")
MOST_SAMPLES = 10**8

_TOP = ("samples", "seed", "design", "record", "engine", "vary")
_ENGINE = ("type", "method", "step", "period")
_DISTRIBUTIONS = {
    "grid": ("values", "low", "high", "count"),
    "uniform": ("low", "high"),
    "normal": ("mean", "deviation", "low", "high"),
}
_VARY = ("parameter", "scenario", "relative", *_DISTRIBUTIONS)


@dataclass(frozen=True)
class Distribution:
    """Of one number.

    kind: "grid" with its values; "uniform" from low to high; "normal" with mean and deviation, cut off outside of low
    and high where they are given.
    """

    kind: str
    values: tuple[float, ...] = ()
    low: float | None = None
    high: float | None = None
    mean: float = 0.0
    deviation: float = 0.0


@dataclass(frozen=True)
class Vary:
    """What changes from sample to sample: one of parameter (a pattern as in ``tunable``) and scenario (a dotted path).

    relative: numbers are multiples of what robot and scenario say.
    """

    parameter: str | None
    scenario: str | None
    distribution: Distribution
    relative: bool = False


@dataclass(frozen=True)
class Engine:
    """How a sample is integrated: type of ENGINES; method of rollouts, step and period in s, None for the default."""

    type: str = "auto"
    method: str = "implicit"
    step: float | None = None
    period: float | None = None


@dataclass(frozen=True)
class Plan:
    """A sweep: ``samples`` draws of all that is random, at every point of the product of all grids."""

    vary: tuple[Vary, ...]
    samples: int = 1
    seed: int = 0
    design: str = "random"
    record: tuple[str, ...] = DEFAULT_RECORD
    engine: Engine = Engine()
    source: str = ""

    def fail(self, key: str, message: str) -> NoReturn:
        """Raise the DescriptionError of a key."""
        raise DescriptionError(message, where=key, source=self.source)


def load_plan(path: str | Path) -> Plan:
    """Read a plan from a .toml file.

    Raises:
        DescriptionError: with the file, the key, what came and what is allowed.
    """
    if Path(path).suffix != ".toml":
        raise DescriptionError(f"the plan {show(str(path))} is no .toml file; allowed: a path that ends in .toml")
    return plan_from_toml(read_text(Path(path), str(path), ".toml file"), source=str(path))


def plan_from_toml(text: str, *, source: str = "plan") -> Plan:
    """The plan that a TOML text describes; errors as ``load_plan``."""
    values = parse_toml(text, source)
    with located(text, values, source):
        return _plan(Table(values, "", source, _TOP))


def _plan(top: Table) -> Plan:
    top.require("vary", "one or more tables [[vary]]")
    entries = top.values["vary"]
    if not isinstance(entries, list) or not entries:
        top.fail(f"got {show(entries)}; allowed: one or more tables, written [[vary]]", "vary")
    vary = tuple(_vary(Table(item, f"vary[{i}]", top.source, _VARY)) for i, item in enumerate(entries))
    _refuse_twins(top, vary)
    drawn = any(entry.distribution.kind != "grid" for entry in vary)
    if drawn:
        top.require("samples", f"the number of draws, a whole number from 1 to {MOST_SAMPLES}")
    elif "samples" in top:
        top.fail("nothing is drawn, there are grids alone; allowed: with uniform or normal", "samples")
    return Plan(
        vary,
        _whole(top, "samples", 1, MOST_SAMPLES, 1),
        _whole(top, "seed", 0, 2**63 - 1, 0),
        top.choice("design", DESIGNS) or "random",
        _record(top),
        _engine(top.table("engine", _ENGINE)),
        top.source,
    )


def _whole(table: Table, key: str, least: int, most: int, default: int) -> int:
    value = table.values.get(key, default)
    if isinstance(value, bool) or not isinstance(value, int) or not least <= value <= most:
        table.fail(f"got {show(value)}; allowed: a whole number from {least} to {most}", key)
    return value


def _record(top: Table) -> tuple[str, ...]:
    if "record" not in top:
        return DEFAULT_RECORD
    names = top.strings("record")
    if not names or len(set(names)) < len(names):
        top.fail(f"got {show(names)}; allowed: one or more different names of {', '.join(RECORDS)}", "record")
    for name in names:
        if name not in RECORDS:
            top.fail(f"got {show(name)}{nearest(name, RECORDS)} (allowed: {', '.join(RECORDS)})", "record")
    return tuple(names)


def _engine(table: Table | None) -> Engine:
    if table is None:
        return Engine()
    kind = table.choice("type", ENGINES) or "auto"
    for key in ("method", "step", "period"):
        if kind == "integrate" and key in table:
            table.fail('allowed: with type = "rollout" or "auto"; [integrator] of the scenario says it here', key)
    step, period = positive(table, "step"), positive(table, "period")
    if step is not None and period is not None and step > period:
        table.fail(f"got {step:g}; allowed: a time in s up to the period, {period:g}", "step")
    return Engine(kind, table.choice("method", tuple(METHODS)) or "implicit", step, period)


def _vary(table: Table) -> Vary:
    if ("parameter" in table) == ("scenario" in table):
        table.fail("needs parameter or scenario, the name of a number; allowed: one of them")
    kinds = [kind for kind in _DISTRIBUTIONS if kind in table]
    if len(kinds) != 1:
        came = ", ".join(kinds) or "none"
        table.fail(f"needs one distribution, got {came}; allowed: one of {', '.join(_DISTRIBUTIONS)}")
    inner = table.table(kinds[0], _DISTRIBUTIONS[kinds[0]])
    assert inner is not None
    readers = {"grid": _grid, "uniform": _uniform, "normal": _normal}
    relative = table.boolean("relative") or False
    return Vary(table.text("parameter"), table.text("scenario"), readers[kinds[0]](inner), relative)


def _grid(table: Table) -> Distribution:
    if "values" in table:
        for key in ("low", "high", "count"):
            if key in table:
                table.fail("given together with values; allowed: values, or low, high and count", key)
        given = table.values["values"]
        if not isinstance(given, list) or not given:
            table.fail(f"got {show(given)}; allowed: an array of one or more numbers", "values")
        values = table.numbers("values", len(given)) or ()
        if len(set(values)) < len(values):
            table.fail(f"got {show(list(values))}; allowed: different numbers", "values")
        return Distribution("grid", values)
    low, high = _bounds(table)
    table.require("count", "a whole number from 2 on")
    count = _whole(table, "count", 2, 10**6, 2)
    return Distribution("grid", tuple(low + (high - low) * (i / (count - 1)) for i in range(count)))


def _bounds(table: Table) -> tuple[float, float]:
    for key in ("low", "high"):
        table.require(key, "a finite number")
    low, high = table.number("low"), table.number("high")
    assert low is not None
    assert high is not None
    if not low < high:
        table.fail(f"got {high:g}; allowed: a number greater than low, {low:g}", "high")
    return low, high


def _uniform(table: Table) -> Distribution:
    low, high = _bounds(table)
    return Distribution("uniform", low=low, high=high)


def _normal(table: Table) -> Distribution:
    for key in ("mean", "deviation"):
        table.require(key, "a finite number")
    mean, deviation = table.number("mean"), table.number("deviation")
    low, high = table.number("low"), table.number("high")
    assert mean is not None
    assert deviation is not None
    if deviation <= 0.0:
        table.fail(f"got {deviation:g}; allowed: a number greater than 0", "deviation")
    if low is not None and high is not None and not low < high:
        table.fail(f"got {high:g}; allowed: a number greater than low, {low:g}", "high")
    for key, bound, side in (("low", low, 1.0), ("high", high, -1.0)):
        if bound is not None and side * (bound - mean) > 8.0 * deviation:
            table.fail(f"got {bound:g}, which leaves a tail beyond 8 deviations; allowed: nearer to the mean", key)
    return Distribution("normal", (), low, high, mean, deviation)


def _refuse_twins(top: Table, vary: tuple[Vary, ...]) -> None:
    seen: dict[tuple[str | None, str | None], int] = {}
    for i, entry in enumerate(vary):
        name = (entry.parameter, entry.scenario)
        if name in seen:
            top.fail(f"{show(name[0] or name[1])} is varied before, by vary[{seen[name]}]; allowed: once", f"vary[{i}]")
        seen[name] = i


__all__ = ["Distribution", "Engine", "Plan", "Vary", "load_plan", "plan_from_toml"]
