"""Reference of the file formats, written from the tables of keys that the readers, the messages and the schemas use."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import singledispatch

from markdown.extensions.toc import slugify

from eomgen.authoring.schemas import FORMATS
from eomgen.description.keys import Matrix
from eomgen.forms.keys import (
    ByName,
    Choice,
    Either,
    FileName,
    Flag,
    Key,
    Keys,
    Listed,
    Name,
    Number,
    Numbers,
    RobotName,
    Strings,
    Text,
    Whole,
)
from eomgen.forms.tables import Entries, Few, Form, Kinds, Pair, Sub
from eomgen.identifiers import IDENTIFIER_RULE, ROBOT_RULE


@dataclass
class Section:
    """One table of a format: its heading, its keys, and headings of the tables inside it by key."""

    title: str
    keys: Keys
    inside: dict[str, str] = field(default_factory=dict)


def description_page() -> str:
    """Reference of robot descriptions."""
    return _page("Format of robot descriptions", "robot", "description.md", "Robot descriptions")


def scenario_page() -> str:
    """Reference of scenarios."""
    return _page("Format of scenarios", "scenario", "scenario.md", "Scenarios")


def plan_page() -> str:
    """Reference of plans of sweeps."""
    return _page("Format of plans", "plan", "sweep.md", "Sweeps")


def _page(title: str, name: str, guide: str, guide_title: str) -> str:
    lines = [
        f"# {title}",
        "",
        f"TOML in SI units and radians; [{guide_title}](../{guide}) explains what the keys do. Readers, messages, "
        f"`eomgen check` and the JSON Schema (`eomgen schema {name}`) use the tables of keys that this page shows.",
        "",
    ]
    for section in sections(FORMATS[name][0]):
        lines += [f"## {section.title.replace('[', chr(92) + '[')}", ""]
        if not section.keys:
            lines += ["No keys but `type`.", ""]
            continue
        lines += ["| key | | takes | unit | what it is |", "|---|---|---|---|---|"]
        for key, kind in section.keys.items():
            inner = section.inside.get(key)
            text = takes(kind) if inner is None else f"{takes(kind)}: [{_cell(inner)}](#{slugify(inner, '-')})"
            row = (f"`{key}`", "needed" if kind.needed else "", text if inner else _cell(text), kind.unit, kind.about)
            lines.append(f"| {' | '.join([*row[:3], *map(_cell, row[3:])])} |")
        lines.append("")
    return "\n".join(lines)


def sections(form: Form) -> Iterator[Section]:
    """The tables of a format from the outside in; each once, where it stands first."""
    titles: dict[int, str] = {id(form.keys): "Top level"}
    waiting = [Section("Top level", form.keys)]
    while waiting:
        section = waiting.pop(0)
        for key, kind in section.keys.items():
            if not isinstance(kind, (Sub, Entries, Pair)):
                continue
            for suffix, keys in _tables(kind.inner):
                if id(keys) not in titles:
                    titles[id(keys)] = _heading(key, kind, section) + suffix
                    waiting.append(Section(titles[id(keys)], keys))
                section.inside.setdefault(key, titles[id(keys)])
        yield section


def _tables(inner: Form | Kinds) -> list[tuple[str, Keys]]:
    """Keys of a table, or of one of each type."""
    if isinstance(inner, Form):
        return [("", inner.keys)]
    return [(f" of type {word}", keys) for word, keys in inner.kinds.items()]


def _heading(key: str, kind: Key, outer: Section) -> str:
    """As TOML writes it at the top level; further in, with all the keys that take the same table."""
    if outer.title == "Top level":
        return f"[[{key}]]" if isinstance(kind, Entries) else f"[{key}]"
    inner = kind.inner if isinstance(kind, (Sub, Entries, Pair)) else None
    alike = [name for name, other in outer.keys.items() if isinstance(other, Sub) and other.inner is inner]
    return f"{', '.join(alike or [key])} of {outer.title}"


def _cell(text: str) -> str:
    return text.replace("|", r"\|").replace("<", "&lt;").replace("[", r"\[")


@singledispatch
def takes(kind: Key) -> str:
    """What a key takes, in words."""
    raise TypeError(f"nothing is known of what {type(kind).__name__} takes")


@takes.register(Number)
@takes.register(FileName)
@takes.register(Listed)
def _(kind: Number | FileName | Listed) -> str:
    return kind.rule


@takes.register
def _(kind: Whole) -> str:
    most = f" to {kind.most}" if kind.most < 2**63 - 1 else " on"
    return f"a whole number from {kind.least}{most}"


@takes.register
def _(kind: Flag) -> str:
    return "true or false"


@takes.register
def _(kind: Text) -> str:
    return "a string"


@takes.register
def _(kind: Name) -> str:
    return IDENTIFIER_RULE


@takes.register
def _(kind: RobotName) -> str:
    return ROBOT_RULE


@takes.register
def _(kind: Choice) -> str:
    return ", ".join(kind.words)


@takes.register
def _(kind: Strings) -> str:
    return f"some of {', '.join(kind.words)}" if kind.words else kind.rule


@takes.register
def _(kind: Numbers) -> str:
    return "an array of numbers" if kind.count is None else f"an array of {kind.count} numbers"


@takes.register
def _(kind: Matrix) -> str:
    return "rows of as many numbers as there are rows, one to six"


@takes.register
def _(kind: ByName) -> str:
    return "a table of numbers by joint or coordinate"


@takes.register
def _(kind: Either) -> str:
    return ", or ".join(map(_option, kind.options))


def _option(kind: Key) -> str:
    """What one of several kinds takes; of a table, which has no section of its own then, its keys, too."""
    return (
        f"a table of {', '.join(kind.inner.keys)}"
        if isinstance(kind, Sub) and isinstance(kind.inner, Form)
        else takes(kind)
    )


@takes.register
def _(kind: Sub) -> str:
    return "a table"


@takes.register
def _(kind: Entries) -> str:
    return "an array of tables"


@takes.register
def _(kind: Pair) -> str:
    return "two tables"


@takes.register
def _(kind: Few) -> str:
    return f"an array of 1 to {kind.most} tables of {', '.join(kind.inner.keys)}"
