"""Reference of the file formats, asked of the readers themselves.

The keys of a table are those that the refusal of an unknown key names; what a key takes is what the refusal of a value
that cannot be meant says is allowed.  So the pages say what the validation does, and there is no second list.
"""

from __future__ import annotations

import copy
import inspect
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from eomgen import scenario, sweep_plan
from eomgen.description import robot_from_toml
from eomgen.errors import DescriptionError
from eomgen.robot import Coordinate, Frame, Friction, Joint, Link, Loop, Motor, Placement, Robot, Spring
from eomgen.scenario_file import scenario_from_toml
from eomgen.sweep_plan import plan_from_toml

NO_KEY = "no_such_key"
ANY_TEXT = ("", "a string", "an array of strings")  # said before it is looked at which
MOST_KEYS = 6  # of a table that are listed where it is a value, beside the section of its own
NUMBERS = ("a number", "a finite number")
DAY = "1979-05-27"  # a date: TOML that no key of ours takes
Document = dict[str, Any]


class _Raw(str):
    """TOML as it stands."""


@dataclass(frozen=True)
class Section:
    """One table of a format: where it stands in a document that is valid around it, and where it is explained.

    ``value`` is what the documents that are asked about hold there: what the table needs, so that its other keys are
    reached.
    """

    title: str
    path: tuple[str | int, ...]
    value: Document
    about: type | None
    guide: str
    within: Document


LINK = {"name": "link1", "mass": 1.0}
JOINT = {"name": "joint1", "parent": "base", "child": "link1", "type": "revolute"}
ROBOT: Document = {"name": "arm", "links": [LINK], "joints": [JOINT]}
SPRING = {"name": "spring1", "links": ["base", "link1"], "stiffness": 1.0}
LOOP = {"name": "loop1", "links": ["base", "link1"], "type": "revolute"}
SCENARIO: Document = {"duration": 1.0}
FILLED: dict[str, Document] = {
    "via": {"points": [[0.0], [1.0]], "speed": 1.0},
    "line": {"from": [0.0, 0.0, 0.0], "to": [1.0, 0.0, 0.0]},
    "circle": {"center": [0.0, 0.0, 0.0], "normal": [0.0, 0.0, 1.0], "from": [1.0, 0.0, 0.0]},
    "torque": {"coordinates": ["joint1"], "rows": [[0.0, 0.0]]},
    "pd": {"kp": 1.0, "kd": 1.0},
    "harmonic": {"coordinate": "joint1.x", "amplitude": 1.0, "frequency": 1.0},
}
VARY = {"parameter": "gravity.z", "uniform": {"low": 0.0, "high": 1.0}}
PLAN: Document = {"samples": 1, "vary": [VARY]}


def _robot_sections() -> Iterator[Section]:
    def at(title: str, path: Sequence[str | int], value: Document, about: type | None, guide: str) -> Section:
        return Section(title, tuple(path), value, about, f"../description.md{guide}", ROBOT)

    joint, inertia = ("joints", 0), {"xx": 1.0, "yy": 1.0, "zz": 1.0}
    yield at("Top level", (), ROBOT, Robot, "#keys")
    yield at("[[links]]", ("links", 0), LINK, Link, "#keys")
    yield at("inertia of a link", ("links", 0, "inertia"), inertia, None, "#inertias")
    yield at("[[joints]]", joint, JOINT, Joint, "#keys")
    yield at("dh of a joint", (*joint, "dh"), {}, None, "#keys")
    yield at("placement", (*joint, "placement"), {}, Placement, "#keys")
    yield at("Coordinate of a joint", (*joint, "alpha"), {}, Coordinate, "#forces-beyond-a-linear-spring")
    yield at("friction", (*joint, "gamma", "friction"), {"coulomb": 1.0}, Friction, "#forces-beyond-a-linear-spring")
    motor = {"inertia": 1.0, "ratio": 1.0, "stiffness": 1.0}
    yield at("motor of a joint", (*joint, "motor"), motor, Motor, "#motors-behind-elastic-gears")
    yield at("offset of a joint", (*joint, "offset"), {}, None, "#constant-deviations")
    yield at("[[frames]]", ("frames", 0), {"name": "tcp", "link": "link1"}, Frame, "#keys")
    yield at("[[springs]]", ("springs", 0), SPRING, Spring, "#springs-between-points")
    yield at("[[loops]]", ("loops", 0), LOOP, Loop, "#closed-loops")


def _scenario_sections() -> Iterator[Section]:
    def at(title: str, path: Sequence[str | int], value: Document, about: type | None, guide: str) -> Section:
        return Section(title, tuple(path), value, about, f"../scenario.md#{guide}", SCENARIO)

    yield at("Top level", (), SCENARIO, scenario.Scenario, "all-keys")
    yield at("[initial]", ("initial",), {"equilibrium": True}, scenario.Initial, "initial-state")
    for name, path, guide in (
        ("[motion]", ("motion",), "motion"),
        ("[control]", ("control",), "control"),
        ("[[prescribed]]", ("prescribed", 0), "prescribed-motions"),
    ):
        for kind in _choices(scenario_from_toml, SCENARIO, path):
            yield at(f"{name} of type {kind}", path, {"type": kind, **FILLED.get(kind, {})}, None, guide)
    yield at("[[wrenches]]", ("wrenches", 0), {"link": "link1", "force": [0, 0, 0]}, scenario.Wrench, "wrenches")
    payload = {"link": "link1", "mass": 1.0, "point": [0, 0, 0]}
    yield at("[[payloads]]", ("payloads", 0), payload, scenario.Payload, "payloads")
    yield at("[integrator]", ("integrator",), {}, scenario.Integrator, "how-it-is-integrated")


def _plan_sections() -> Iterator[Section]:
    def at(title: str, path: Sequence[str | int], value: Document, about: type | None) -> Section:
        return Section(title, tuple(path), value, about, "../sweep.md#keys-of-a-plan", PLAN)

    yield at("Top level", (), PLAN, sweep_plan.Plan)
    yield at("[engine]", ("engine",), {}, sweep_plan.Engine)
    yield at("[[vary]]", ("vary", 0), VARY, sweep_plan.Vary)
    named = {"parameter": "gravity.z"}
    for kind, value in {
        "grid": {"values": [1.0]},
        "uniform": {"low": 0.0, "high": 1.0},
        "normal": {"mean": 0.0, "deviation": 1.0},
    }.items():
        within = {"samples": 1, "vary": [named]} if kind != "grid" else {"vary": [named]}
        where = ("vary", 0, kind)
        yield Section(
            f"{kind} of [[vary]]", where, value, sweep_plan.Distribution, "../sweep.md#keys-of-a-plan", within
        )


def description_page() -> str:
    """Reference of robot descriptions."""
    return _page(
        "Format of robot descriptions", robot_from_toml, _robot_sections(), "description.md", "Robot descriptions"
    )


def scenario_page() -> str:
    """Reference of scenarios."""
    return _page("Format of scenarios", scenario_from_toml, _scenario_sections(), "scenario.md", "Scenarios")


def plan_page() -> str:
    """Reference of plans of sweeps."""
    return _page("Format of plans", plan_from_toml, _plan_sections(), "sweep.md", "Sweeps")


def _page(title: str, load: Callable[[str], Any], sections: Iterator[Section], guide: str, name: str) -> str:
    lines = [
        f"# {title}",
        "",
        f"TOML in SI units and radians; [{name}](../{guide}) explains what the keys do. This page is written by asking "
        "the reader: each line is what it says is allowed where it refuses a value, so that it cannot differ from what "
        "is checked.",
        "",
    ]
    for section in sections:
        lines += [f"## {section.title.replace('[', chr(92) + '[')}", ""]
        if section.about is not None:
            lines += _quoted(section.about)
        lines += ["| key | | takes |", "|---|---|---|"]
        for key in keys_of(load, section):
            needed, takes = requirement(load, section, key)
            lines.append(f"| `{key}` | {'needed' if needed else ''} | {_cell(takes)} |")
        lines += ["", f"[What they do]({section.guide})", ""]
    return "\n".join(lines)


def _quoted(about: type) -> list[str]:
    """What the class that holds the values says about them, up to its source."""
    text = (inspect.getdoc(about) or "").replace("``", "`")
    return [*(f"> {line}".rstrip() for line in text.replace("<", "&lt;").splitlines()), ""]


def _cell(text: str) -> str:
    text = text.partition(": 'base'")[0]  # names of our own document
    if text.startswith("a table with the keys") and text.count(",") > MOST_KEYS:
        text = "a table, see below"
    return text.replace("|", r"\|").replace("<", "&lt;").replace("[[", r"\[[")


def keys_of(load: Callable[[str], Any], section: Section) -> list[str]:
    """The keys that the table may have: those named where one that it has not is refused, less those of other types."""
    error = _refusal(load, section, {**section.value, NO_KEY: 1})
    if error is None or NO_KEY not in error.message:
        raise ValueError(f"{section.title}: {error}, where an unknown key was to be refused")
    named = _allowed(error).split(", ")
    return [key for key in named if not _is_unknown(_refusal(load, section, {**section.value, key: _Raw(DAY)}), key)]


def requirement(load: Callable[[str], Any], section: Section, key: str) -> tuple[bool, str]:
    """Whether a table without the key is refused for that, and what the key takes."""
    missing = _refusal(load, section, _less(section.value, key))
    needed = missing is not None and f"the key '{key}' is missing" in missing.message
    others = [name for name in section.value if name not in (key, "type", "link")]
    bases: list[list[str]] = [[], *([name] for name in others), others]  # less other keys, where they exclude this one
    asked = (_takes(load, section, _less(section.value, *less), key) for less in bases)
    absent = _allowed(missing) if needed and missing else ""
    found = [takes for takes in (absent if ", or " in absent else "", *asked, absent) if takes]
    if not found:
        raise ValueError(f"{section.title}: nothing is said about what {key} takes")
    takes = next((takes for takes in found if takes not in ANY_TEXT), found[0])
    return needed, f"{found[0]}, {takes}" if takes.startswith("with ") and found[0] != takes else takes


def _takes(load: Callable[[str], Any], section: Section, base: Document, key: str) -> str:
    """What the refusals of several values of the key name as allowed, the most particular of them."""

    def said(value: Any) -> str:
        error = _refusal(load, section, {**base, key: value})
        if error is None or _is_unknown(error, key) or not _is_about(error, key):
            return ""
        return re.sub(r", such as '.*'$", "", _allowed(error))

    takes = said(_Raw(DAY))
    if takes in ANY_TEXT:
        return next((found for found in (said("?"), said(["?"])) if found not in ANY_TEXT), takes)
    if takes.startswith(NUMBERS):
        narrower = [found for found in (said(0.0), said(-1.0)) if found.startswith(NUMBERS)]
        takes = re.sub(r", 0$", "", max([takes, *narrower], key=len))  # the other number of our document
    inside = _refusal(load, section, {**base, key: ["?"]})
    if takes.startswith((*NUMBERS, "a table of")) and inside is not None and inside.where.endswith(f"{key}.0"):
        return f"{takes}, or an array of numbers"  # it was looked at what is in the array
    path = said("?") if takes.startswith("an array") else ""
    return f"{takes}, or {path}" if path.startswith("the path") else takes


def _less(table: Document, *keys: str) -> Document:
    return {name: value for name, value in table.items() if name not in keys}


def _choices(load: Callable[[str], Any], within: Document, path: tuple[str | int, ...]) -> list[str]:
    """The types that a table may have."""
    section = Section("", path, {"type": "?"}, None, "", within)
    error = _refusal(load, section, section.value)
    assert error is not None
    return _allowed(error).split(", ")


def _is_unknown(error: DescriptionError | None, key: str) -> bool:
    return error is not None and f"unknown key '{key}'" in error.message


def _is_about(error: DescriptionError, key: str) -> bool:
    return re.search(rf"(^|\.){re.escape(key)}(\.|\[|$)", error.where) is not None or f"'{key}'" in error.message


def _allowed(error: DescriptionError) -> str:
    found = re.search(r"\(allowed: (.*)\)$", error.message) or re.search(r"allowed(?: for)?: (.*)$", error.message)
    if found is None:
        raise ValueError(f"the refusal {error} does not say what is allowed")
    return found[1]


def _refusal(load: Callable[[str], Any], section: Section, table: Document) -> DescriptionError | None:
    """What the reader says to the document with the table in its place."""
    if not section.path:
        document: Document = table
    else:
        document = copy.deepcopy(section.within)
        _place(document, section.path, table)
    try:
        load("\n".join(f"{key} = {_toml(value)}" for key, value in document.items()))
    except DescriptionError as error:
        return error
    return None


def _place(document: Any, path: Sequence[str | int], table: Document) -> None:
    for step, following in zip(path, [*path[1:], None], strict=True):
        if isinstance(step, int) and len(document) <= step:
            document.append({})
        if following is None:
            document[step] = table
        elif isinstance(step, str):
            document = document.setdefault(step, [] if isinstance(following, int) else {})
        else:
            document = document[step]


def _toml(value: Any) -> str:
    if isinstance(value, _Raw):
        return str(value)
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return f'"{value}"'
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(map(_toml, value)) + "]"
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{key} = {_toml(item)}" for key, item in value.items()) + " }"
    return repr(value)
