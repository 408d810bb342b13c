"""Reading of a sweep's plan: a TOML file in, a Plan out.  Keys: docs/sweep.md."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NoReturn

from ..errors import DescriptionError, InputError
from ..files import as_path
from ..forms.tables import Table
from ..forms.toml_place import located, refusal
from ..forms.toml_text import parse_toml, read_text
from ..names import show
from .keys import DEFAULT_RECORD, DISTRIBUTIONS, FORMER, MOST_SAMPLES, PLAN


@dataclass(frozen=True)
class Distribution:
    """Distribution of one number.

    kind: "grid" with its values; "uniform" from low to high; "normal" with mean and deviation, truncated at low and
    high where there are such.
    """

    kind: str
    values: tuple[float, ...] = ()
    low: float | None = None
    high: float | None = None
    mean: float = 0.0
    deviation: float = 0.0

    def as_dict(self) -> dict[str, Any]:
        """Return the key and the table from which ``read_distribution`` makes it."""
        bounds = {key: getattr(self, key) for key in ("low", "high") if getattr(self, key) is not None}
        if self.kind == "grid":
            return {"grid": {"values": list(self.values)}}
        return {
            self.kind: bounds if self.kind == "uniform" else {"mean": self.mean, "deviation": self.deviation, **bounds}
        }


@dataclass(frozen=True)
class Vary:
    """A number that changes from sample to sample: parameter (a pattern as in ``tunable``) or scenario (a dotted path).

    relative: numbers are multiples of the nominal value.
    """

    parameter: str | None
    scenario: str | None
    distribution: Distribution
    relative: bool = False


@dataclass(frozen=True)
class Plan:
    """A sweep: ``samples`` draws of all that is random, at every point of the product of all grids.

    engine: of ENGINES, how samples are integrated.
    """

    vary: tuple[Vary, ...]
    samples: int = 1
    seed: int = 0
    design: str = "random"
    record: tuple[str, ...] = DEFAULT_RECORD
    engine: str = "auto"
    source: str = ""
    text: str = field(default="", repr=False, compare=False)

    def fail(self, key: str, message: str) -> NoReturn:
        """Raise the DescriptionError of a key."""
        raise refusal(message, key, self.source, self.text)


def as_plan(plan: Plan | str | Path) -> Plan:
    """Return the plan itself, or the one that ``load_plan`` reads; InputError if it is neither."""
    if isinstance(plan, Plan):
        return plan
    if not isinstance(plan, (str, Path)):
        raise InputError(
            f"plan: got a value of type {type(plan).__name__}; allowed: a Plan (from load_plan), or the path of a"
            " .toml file"
        )
    return load_plan(plan)


def load_plan(path: str | Path) -> Plan:
    """Read a plan from a .toml file.

    Raises:
        DescriptionError: with the file, the key, what came and what is allowed.
    """
    if as_path(path, "plan").suffix != ".toml":
        raise DescriptionError(f"the plan {show(str(path))} is no .toml file; allowed: a path that ends in .toml")
    return plan_from_toml(read_text(Path(path), str(path), ".toml file"), source=str(path))


def plan_from_toml(text: str, *, source: str = "plan") -> Plan:
    """Return the plan of a TOML text; errors as ``load_plan``."""
    values = parse_toml(text, source)
    with located(text, values, source):
        return replace(_plan(PLAN.read(values, "", source, ())), text=text)


def _plan(top: Table) -> Plan:
    top.require()
    vary = _varied(top)
    _refuse_twins(top, vary)
    drawn = any(entry.distribution.kind != "grid" for entry in vary)
    if drawn:
        top.require_one("samples", f"the number of draws, a whole number from 1 to {MOST_SAMPLES}")
    elif "samples" in top:
        top.fail("nothing is drawn, there are grids alone; allowed: with uniform or normal", "samples")
    return Plan(
        vary,
        top.whole("samples", 1),
        top.whole("seed", 0),
        top.choice("design") or "random",
        tuple(top.strings("record")) if "record" in top else DEFAULT_RECORD,
        _engine(top),
        top.source,
    )


def _varied(top: Table) -> tuple[Vary, ...]:
    """Read the entries; stops once their grids have more points together than a sweep can have."""
    entries: list[Vary] = []
    points = 1
    for index, (_, entry) in enumerate(top.entries("vary")):
        entries.append(_vary(entry))
        points *= max(len(entries[-1].distribution.values), 1)
        if points > MOST_SAMPLES:
            top.fail(f"the grids have {points} points together; allowed: up to {MOST_SAMPLES}", f"vary[{index}]")
    return tuple(entries)


def _engine(top: Table) -> str:
    engine = top.values.get("engine")
    for key in FORMER:
        if isinstance(engine, dict) and key in engine:
            allowed = "allowed: type; method, rtol and atol in the scenario's [integrator]"
            top.fail(f"samples are integrated with adaptive step size; {allowed}", f"engine.{key}")
    table = top.table("engine")
    return (table.choice("type") if table else None) or "auto"


def _vary(table: Table) -> Vary:
    if ("parameter" in table) == ("scenario" in table):
        table.fail("needs parameter or scenario, the name of a number; allowed: one of them")
    distribution = read_distribution(table)
    relative = table.boolean("relative") or False
    return Vary(table.text("parameter"), table.text("scenario"), distribution, relative)


def read_distribution(table: Table) -> Distribution:
    """Return the one distribution that a table has among its keys; DescriptionError if it has none, or several."""
    kinds = [kind for kind in DISTRIBUTIONS if kind in table]
    if len(kinds) != 1:
        came = ", ".join(kinds) or "none"
        table.fail(f"needs one distribution, got {came}; allowed: one of {', '.join(DISTRIBUTIONS)}")
    inner = table.table(kinds[0])
    assert inner is not None
    readers = {"grid": _grid, "uniform": _uniform, "normal": _normal}
    return readers[kinds[0]](inner)


def _grid(table: Table) -> Distribution:
    if "values" in table:
        for key in ("low", "high", "count"):
            if key in table:
                table.fail("stands beside values; allowed: values, or low, high and count", key)
        values = tuple(table.value("values"))
        if len(set(values)) < len(values):
            table.fail(f"got {show(list(values))}; allowed: different numbers", "values")
        return Distribution("grid", values)
    low, high = _bounds(table)
    table.require_one("count", "a whole number from 2 on")
    count = table.whole("count", 2)
    return Distribution("grid", tuple(low + (high - low) * (i / (count - 1)) for i in range(count)))


def _bounds(table: Table) -> tuple[float, float]:
    for key in ("low", "high"):
        table.require_one(key, "a finite number")
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
    mean, deviation = table.number("mean"), table.number("deviation")
    low, high = table.number("low"), table.number("high")
    assert mean is not None
    assert deviation is not None
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
            top.fail(f"{show(name[0] or name[1])} varies already, by vary[{seen[name]}]; allowed: once", f"vary[{i}]")
        seen[name] = i
