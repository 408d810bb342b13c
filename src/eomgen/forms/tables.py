"""Reading of TOML tables by their forms: types, ranges and unknown keys, each refusal with its place.

Written by hand because a validation library costs 0.1 s of import, a third of what loading a compiled robot may take.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar, NoReturn

from ..errors import DescriptionError
from ..identifiers import is_identifier
from ..limits import LARGEST, MOST_ENTRIES
from ..names import listed, nearest, show
from .keys import Choice, Either, Flag, Json, Key, Keys, Listed, Number, Numbers, Strings, Text, Whole

__all__ = [
    "DEGREES",
    "LARGEST",
    "MOST_ENTRIES",
    "Entries",
    "Few",
    "Form",
    "Kinds",
    "Pair",
    "Sub",
    "Table",
    "angle_keys",
]

DEGREES = "_deg"  # behind the name of an angle's key that takes degrees, not radians


def angle_keys(name: str, kind: Number | Numbers) -> dict[str, Key]:
    """Return the key of an angle, or of three, in rad, and behind it the one that takes degrees instead."""
    return {name: kind, name + DEGREES: replace(kind, about=f"the same in degrees, instead of {name}", unit="deg")}


class Table:
    """One TOML table.  Every reader method returns None (or an empty list) where the key is absent.

    where: of it, for messages.  path: keys from the top of the file; () where they are not known.
    """

    def __init__(self, value: object, where: str, source: str, keys: Keys, path: tuple[str, ...] = ()) -> None:
        self.where, self.source, self.keys, self.path = where, source, keys, path
        if not isinstance(value, dict):
            self.fail(f"got {show(value)}; allowed: a table with the keys {listed(keys, 20)}")
        self.values: dict[str, Any] = value
        for key in value:
            if key not in keys:
                message = f"unknown key {show(key)}{nearest(key, keys)} (allowed: {', '.join(keys)})"
                raise DescriptionError(message, where=where, source=source, path=self._below(key), at_key=True)

    def fail(self, message: str, key: str = "") -> NoReturn:
        """Raise the DescriptionError of this table, or of one of its keys."""
        where = ".".join(filter(None, (self.where, key)))
        path = self._below(*key.replace("[", ".").replace("]", "").split(".")) if key else self.path
        raise DescriptionError(message, where=where, source=self.source, path=path)

    def _below(self, *keys: str) -> tuple[str, ...]:
        """Return the path of keys inside this table, () where the table's path is not known."""
        return (*self.path, *keys) if self.path or not self.where else ()

    def __contains__(self, key: str) -> bool:
        return key in self.values

    def require(self, hint: str = "") -> None:
        """Raise DescriptionError if a needed key is absent; the hint ends the message."""
        for key, kind in self.keys.items():
            if kind.needed and key not in self.values:
                self.fail(f"the key {key!r} is missing; allowed: {kind.needed}{hint}")

    def require_one(self, key: str, what: str) -> None:
        """Raise DescriptionError if the key, which other keys make necessary, is absent."""
        if key not in self.values:
            self.fail(f"the key {key!r} is missing; allowed: {what}")

    def value(self, key: str, *kinds: type[Key]) -> Any:
        """Return the value of a key of one of these kinds; None where it is absent."""
        kind = self.keys[key]
        assert isinstance(kind, kinds or Key), f"{self.where}.{key} takes {type(kind).__name__}"
        return kind.take(self, key, self.values[key]) if key in self.values else None

    def present(self) -> dict[str, Any]:
        """Return the values of present keys, but ``type``, in the order of the form; angles by the keys of radians."""
        values: dict[str, Any] = {}
        for key in self.keys:
            angle = key.removesuffix(DEGREES)
            if key not in self.values or key == "type":
                continue
            if angle != key and angle in self.keys:
                values[angle] = (self.angles if isinstance(self.keys[key], Numbers) else self.angle)(angle)
            else:
                values[key] = self.value(key)
        return values

    def text(self, key: str) -> str | None:
        """Return a string, which may have to be a name or one of a few words."""
        text: str | None = self.value(key, Text)
        return text

    def name(self) -> str:
        """Return the identifier of an entry under the key ``name``."""
        if "name" not in self.values:
            self.fail(f"the key 'name' is missing; allowed: {self.keys['name'].needed}")
        name: str = self.value("name", Text)
        return name

    def choice(self, key: str) -> str | None:
        """Return one of a few strings."""
        word: str | None = self.value(key, Choice)
        return word

    def number(self, key: str) -> float | None:
        """Return a finite number, as float."""
        number: float | None = self.value(key, Number)
        return number

    def whole(self, key: str, default: int) -> int:
        """Return a whole number."""
        number: int | None = self.value(key, Whole)
        return default if number is None else number

    def boolean(self, key: str) -> bool | None:
        """Return a truth value."""
        flag: bool | None = self.value(key, Flag)
        return flag

    def numbers(self, key: str, count: int | None = None) -> tuple[float, ...] | None:
        """Return an array of finite numbers; ``count`` of them where that follows from other keys."""
        if key not in self.values:
            return None
        kind = self.keys[key]
        kind = kind.option([]) if isinstance(kind, Either) else kind
        assert isinstance(kind, Numbers)
        return kind.take(self, key, self.values[key], count)

    def rows(self, key: str, count: int) -> list[tuple[float, ...]]:
        """Return an array of arrays of ``count`` finite numbers each."""
        if key not in self.values:
            return []
        kind = self.keys[key]
        kind = kind.option([]) if isinstance(kind, Either) else kind
        assert isinstance(kind, Listed)
        row, value = kind.item, self.values[key]
        assert isinstance(row, Numbers)
        if not isinstance(value, list):
            self.fail(f"got {show(value)}; allowed: an array of arrays of {count} numbers", key)
        return [row.take(self, f"{key}.{index}", item, count) for index, item in enumerate(value)]

    def vector(self, key: str) -> tuple[float, float, float] | None:
        """Return an array of three finite numbers."""
        value = self.numbers(key)
        return None if value is None else (value[0], value[1], value[2])

    def angle(self, key: str) -> float:
        """Read an angle, rad: of the key, or in degrees of the key with DEGREES behind it; 0 where neither is there."""
        if self._in_degrees(key):
            return math.radians(self.number(key + DEGREES) or 0.0)
        return self.number(key) or 0.0

    def angles(self, key: str) -> tuple[float, float, float] | None:
        """Read three angles, rad: of the key, or in degrees of the key with DEGREES behind it."""
        if not self._in_degrees(key):
            return self.vector(key)
        first, second, third = self.vector(key + DEGREES) or (0.0, 0.0, 0.0)
        return math.radians(first), math.radians(second), math.radians(third)

    def _in_degrees(self, key: str) -> bool:
        """Return whether an angle is in degrees; DescriptionError where it is there in radians, too."""
        if key + DEGREES in self.values and key in self.values:
            self.fail(f"{key} (rad) is given, too; allowed: one of them", key + DEGREES)
        return key + DEGREES in self.values

    def strings(self, key: str) -> list[str]:
        """Return an array of strings."""
        return self.value(key, Strings) or []

    def table(self, key: str) -> Table | None:
        """Return a table inside this one."""
        table: Table | None = self.value(key, Sub)
        return table

    def entries(self, key: str) -> Iterator[tuple[str, Table]]:
        """Yield name ("" where they have none) and table of each entry of an array of tables; names are unique."""
        kind = self.keys[key]
        assert isinstance(kind, Entries)
        if key in self.values:
            yield from kind.read(self, key, self.values[key])

    def inside(self, key: str, value: object, form: Form | Kinds, where: str = "", *steps: str) -> Table:
        """Return the table of a form below a key."""
        where = where or ".".join(filter(None, (self.where, key)))
        return form.read(value, where, self.source, self._below(key, *steps))


@dataclass(frozen=True, eq=False)
class Form:
    """The keys of a table.  refines: an entry that refines one of a URDF need not have the needed keys."""

    keys: Keys
    refines: bool = False

    def read(self, value: object, where: str, source: str, path: tuple[str, ...]) -> Table:
        """Return the table; its values are checked when they are read."""
        return Table(value, where, source, self.keys, path)

    @property
    def needed(self) -> list[str]:
        """Keys that must be there."""
        return [key for key, kind in self.keys.items() if kind.needed]

    def json(self) -> Json:
        """Return the JSON Schema of the table."""
        needed = [key for key in self.needed if key == "name" or not self.refines]
        properties = {key: kind.schema() for key, kind in self.keys.items()}
        required = {"required": needed} if needed else {}
        return {"type": "object", "properties": properties, **required, "additionalProperties": False}


@dataclass(frozen=True, eq=False)
class Kinds:
    """Tables whose key ``type`` determines their keys; ``about``: its description in editors."""

    about: str
    kinds: Mapping[str, Keys]

    def read(self, value: object, where: str, source: str, path: tuple[str, ...]) -> Table:
        """Return the table, with the keys of its type."""
        kind = Choice(self.about, needed=", ".join(self.kinds), words=tuple(self.kinds))
        union = {"type": kind, **{key: inner for keys in self.kinds.values() for key, inner in keys.items()}}
        table = Table(value, where, source, union, path)
        table.require_one("type", kind.needed)
        return Table(value, where, source, {"type": kind, **self.kinds[table.choice("type") or ""]}, path)

    def json(self) -> Json:
        """Return the JSON Schema of the table: one object for each type."""
        forms = {
            word: Form({"type": Choice(self.about, needed=word, words=(word,)), **keys})
            for word, keys in self.kinds.items()
        }
        return {"oneOf": [{"title": word, **form.json()} for word, form in forms.items()]}


@dataclass(frozen=True, eq=False, repr=False)
class Sub(Key):
    """A table."""

    inner: Form | Kinds = Form({})
    form: ClassVar[type] = dict

    def take(self, table: Table, key: str, value: Any) -> Table:  # type: ignore[override]
        inner = table.inside(key, value, self.inner)
        inner.require()
        return inner

    def json(self) -> Json:
        return self.inner.json()


@dataclass(frozen=True, eq=False, repr=False)
class Few(Key):
    """An array of a few tables, from ``fewest`` to ``most``."""

    inner: Form = Form({})
    most: int = 1
    fewest: int = 1
    form: ClassVar[type] = list

    @property
    def rule(self) -> str:
        """Text of what is allowed."""
        return f"{self.fewest} to {self.most} tables, [{{ {', '.join(self.inner.keys)} }}, ...]"

    def takes(self, count: int) -> bool:
        """Return whether it may have so many."""
        return self.fewest <= count <= self.most

    def take(self, table: Table, key: str, value: Any) -> list[Table]:  # type: ignore[override]
        if not isinstance(value, list) or not self.takes(len(value)):
            self.refuse(table, key, value, self.rule)
        tables = [
            table.inside(key, item, self.inner, f"{table.where}.{key}.{index}", str(index))
            for index, item in enumerate(value)
        ]
        for inner in tables:
            inner.require()
        return tables

    def json(self) -> Json:
        return {"type": "array", "items": self.inner.json(), "minItems": self.fewest, "maxItems": self.most}


@dataclass(frozen=True, eq=False, repr=False)
class Pair(Few):
    """An array of two tables."""

    most: int = 2
    fewest: int = 2

    @property
    def rule(self) -> str:
        """Text of what is allowed."""
        names = ", ".join(self.inner.keys)
        return f"two tables, [{{ {names} }}, {{ {names} }}]"


@dataclass(frozen=True, eq=False, repr=False)
class Entries(Key):
    """An array of tables; where they have a ``name``, it is unique.  fewest: how many there are at least, up to two."""

    inner: Form | Kinds = Form({})
    fewest: int = 0
    form: ClassVar[type] = list

    @property
    def named(self) -> bool:
        """Whether entries have names."""
        return isinstance(self.inner, Form) and "name" in self.inner.keys

    def where(self, key: str, index: int, item: object) -> str:
        """Return the name of an entry in messages: that of its key, if it is an identifier, else its index."""
        name = item.get("name") if self.named and isinstance(item, dict) else None
        return f"{key}.{name}" if isinstance(name, str) and is_identifier(name) else f"{key}[{index}]"

    def read(self, table: Table, key: str, value: Any) -> Iterator[tuple[str, Table]]:
        """Yield name and table of each entry; needed keys are not checked."""
        if not isinstance(value, list) or len(value) < self.fewest:
            what = ("an array of tables", "one or more tables", "two or more tables")[self.fewest]
            self.refuse(table, key, value, f"{what}, written [[{key}]]")
        if len(value) > MOST_ENTRIES:
            table.fail(f"there are {len(value)} [[{key}]]; allowed: up to {MOST_ENTRIES}", f"{key}[{MOST_ENTRIES}]")
        seen = set()
        for index, item in enumerate(value):
            where = ".".join(filter(None, (table.where, self.where(key, index, item))))
            entry = table.inside(key, item, self.inner, where, str(index))
            name = entry.name() if self.named else ""
            if self.named and name in seen:
                entry.fail(f"the name {name!r} is taken by an earlier entry of [[{key}]]; allowed: unique names")
            seen.add(name)
            yield name, entry

    def json(self) -> Json:
        least = {"minItems": self.fewest} if self.fewest else {}
        return {"type": "array", "items": self.inner.json(), **least, "maxItems": MOST_ENTRIES}
