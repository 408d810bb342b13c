"""Keys of our TOML files: reading, messages and JSON Schema of each, side by side.

A form lists the keys of one table.  ``description.keys``, ``scenario.keys`` and ``sweep.keys`` hold those of our files:
the readers, their messages, the JSON Schemas and ``eomgen check`` use these, and there is no second list.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, NoReturn, Protocol

from ..identifiers import (
    IDENTIFIER,
    IDENTIFIER_RULE,
    ROBOT_LENGTH,
    ROBOT_NAME,
    ROBOT_RULE,
    is_identifier,
    is_robot_name,
    is_word,
    to_identifier,
    to_robot_name,
)
from ..limits import LARGEST, MOST_ENTRIES
from ..names import NAME_LENGTH, nearest, show

Json = dict[str, Any]


class Place(Protocol):
    """The table that a value stands in."""

    def fail(self, message: str, key: str = "") -> NoReturn:
        """Raise the DescriptionError of the key."""


@dataclass(frozen=True, eq=False, repr=False)
class Key:
    """One key of a table.

    about: a line for who writes the file; editors show it.  unit: of its numbers.  needed: what the message calls
    allowed where the key is missing; "" where it may be.
    """

    about: str
    unit: str = ""
    needed: str = ""
    form: ClassVar[type | tuple[type, ...]] = object  # Python types of its TOML values

    def take(self, table: Place, key: str, value: Any) -> Any:
        """Convert a value for the reader; DescriptionError if the key does not take it."""
        raise NotImplementedError

    def json(self) -> Json:
        """Return the JSON Schema of the value."""
        raise NotImplementedError

    def schema(self) -> Json:
        """Return the JSON Schema with the description that editors show."""
        about = f"{self.about} [{self.unit}]" if self.unit else self.about
        return {**({"description": about} if about else {}), **self.json()}

    def refuse(self, table: Place, key: str, value: Any, allowed: str) -> NoReturn:
        """Raise the DescriptionError of the value."""
        table.fail(f"got {show(value)}; allowed: {allowed}", key)


@dataclass(frozen=True, eq=False, repr=False)
class Number(Key):
    """A finite number, read as float; at least ``minimum``, greater than ``above``, less than ``below``."""

    minimum: float | None = None
    above: float | None = None
    below: float | None = None
    form = (int, float)

    @property
    def rule(self) -> str:
        """Rule for messages: the values that are allowed."""
        if self.below is not None:
            return f"from {self.minimum:g} to less than {self.below:g}"
        if self.above is not None:
            return f"a number greater than {self.above:g}"
        return "a finite number" if self.minimum is None else f"a number that is at least {self.minimum:g}"

    def take(self, table: Place, key: str, value: Any) -> float:
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            self.refuse(table, key, value, self.rule)
        if isinstance(value, float) and not math.isfinite(value):
            self.refuse(table, key, value, self.rule)
        if abs(value) > LARGEST:
            self.refuse(table, key, value, f"{self.rule} of magnitude up to {LARGEST:g}")
        low = (self.minimum is not None and value < self.minimum) or (self.above is not None and value <= self.above)
        if low or (self.below is not None and value >= self.below):
            self.refuse(table, key, value, self.rule)
        return float(value) + 0.0  # turns -0.0 into 0.0

    def json(self) -> Json:
        bounds: Json = {"type": "number"}
        if self.above is not None:
            bounds["exclusiveMinimum"] = self.above
        else:
            bounds["minimum"] = -LARGEST if self.minimum is None else self.minimum
        bounds["maximum" if self.below is None else "exclusiveMaximum"] = LARGEST if self.below is None else self.below
        return bounds


@dataclass(frozen=True, eq=False, repr=False)
class Whole(Key):
    """A whole number from ``least`` to ``most``."""

    least: int = 0
    most: int = 2**63 - 1
    form = int

    def take(self, table: Place, key: str, value: Any) -> int:
        if isinstance(value, bool) or not isinstance(value, int) or not self.least <= value <= self.most:
            self.refuse(table, key, value, f"a whole number from {self.least} to {self.most}")
        return value

    def json(self) -> Json:
        return {"type": "integer", "minimum": self.least, "maximum": self.most}


@dataclass(frozen=True, eq=False, repr=False)
class Flag(Key):
    """True or false."""

    form = bool

    def take(self, table: Place, key: str, value: Any) -> bool:
        if not isinstance(value, bool):
            self.refuse(table, key, value, "true or false")
        return value

    def json(self) -> Json:
        return {"type": "boolean"}


@dataclass(frozen=True, eq=False, repr=False)
class Text(Key):
    """A string."""

    form = str

    def take(self, table: Place, key: str, value: Any) -> str:
        if not isinstance(value, str):
            self.refuse(table, key, value, "a string")
        return value

    def json(self) -> Json:
        return {"type": "string"}


@dataclass(frozen=True, eq=False, repr=False)
class Name(Text):
    """An identifier."""

    pattern, length, rule = IDENTIFIER.pattern, NAME_LENGTH, IDENTIFIER_RULE
    is_allowed, nearly = staticmethod(is_identifier), staticmethod(to_identifier)

    def take(self, table: Place, key: str, value: Any) -> str:
        name = super().take(table, key, value)
        if not self.is_allowed(name):
            self.refuse(table, key, name, self.rule + (f", such as {self.nearly(name)!r}" if name else ""))
        return name

    def json(self) -> Json:
        return {"type": "string", "pattern": f"^{self.pattern}$", "maxLength": self.length}


@dataclass(frozen=True, eq=False, repr=False)
class RobotName(Name):
    """The name of a robot."""

    pattern, length, rule = ROBOT_NAME.pattern, ROBOT_LENGTH, ROBOT_RULE
    is_allowed, nearly = staticmethod(is_robot_name), staticmethod(to_robot_name)


@dataclass(frozen=True, eq=False, repr=False)
class FileName(Text):
    """The path of a file with one of a few suffixes."""

    suffixes: tuple[str, ...] = ()

    def take(self, table: Place, key: str, value: Any) -> str:
        name = super().take(table, key, value)
        if not name.endswith(self.suffixes):
            self.refuse(table, key, name, self.rule)
        return name

    @property
    def rule(self) -> str:
        """Rule for messages: the values that are allowed."""
        an = "an" if self.suffixes[0][1] in "aeiou" else "a"
        return f"the path of {an} {' or '.join(self.suffixes)} file, relative to this file"

    def json(self) -> Json:
        return {"type": "string", "pattern": f"({'|'.join(map(re.escape, self.suffixes))})$"}


@dataclass(frozen=True, eq=False, repr=False)
class Choice(Text):
    """One of a few words; ``synonyms``: what other words mean, of which a message reminds."""

    words: Sequence[str] = ()
    synonyms: Mapping[str, str] = field(default_factory=dict)

    def take(self, table: Place, key: str, value: Any) -> str:
        word = super().take(table, key, value)
        if word not in self.words:
            near = self.synonyms.get(word)
            hint = f"; did you mean {near!r}?" if near in self.words else nearest(word, self.words)
            table.fail(f"got {show(word)}{hint} (allowed: {', '.join(self.words)})", key)
        return word

    def json(self) -> Json:
        return {"type": "string", "enum": list(self.words)}


@dataclass(frozen=True, eq=False, repr=False)
class Strings(Key):
    """An array of strings: any up to ``most``, ``count`` of them (``rule`` says which), or some different ``words``."""

    count: int | None = None
    rule: str = "an array of strings"
    words: Sequence[str] = ()
    some: bool = False  # one or more, each once
    most: int = MOST_ENTRIES
    form = list

    def take(self, table: Place, key: str, value: Any) -> list[str]:
        if not isinstance(value, list) or not all(isinstance(item, str) for item in value):
            self.refuse(table, key, value, "an array of strings")
        if self.count is not None and len(value) != self.count:
            self.refuse(table, key, value, self.rule)
        if len(value) > self.most:
            self.refuse(table, key, value, f"up to {self.most} strings")
        if self.some and (not value or len(set(value)) < len(value)):
            self.refuse(table, key, value, self.rule)
        for word in value if self.words else ():
            if word not in self.words:
                hint = nearest(word, self.words)
                table.fail(f"got {show(word)}{hint} (allowed: {', '.join(self.words)})", key)
        return value

    def json(self) -> Json:
        words = {"enum": list(self.words)} if self.words else {}
        lengths = {"maxItems": self.most} if self.count is None else {"minItems": self.count, "maxItems": self.count}
        some = {"minItems": 1, "uniqueItems": True} if self.some else {}
        return {"type": "array", "items": {"type": "string", **words}, **lengths, **some}


@dataclass(frozen=True, eq=False, repr=False)
class Numbers(Key):
    """An array of numbers: ``count`` of them, or some; ``item`` is the key of each."""

    count: int | None = None
    item: Number = Number("")
    form = list

    def take(self, table: Place, key: str, value: Any, count: int | None = None) -> tuple[float, ...]:
        """Return the numbers as a tuple; ``count`` of them where that follows from other keys."""
        count = self.count if count is None else count
        if not isinstance(value, list) or (count is not None and len(value) != count):
            self.refuse(table, key, value, f"an array of {'' if count is None else f'{count} '}numbers")
        return tuple(self.item.take(table, f"{key}.{index}", item) for index, item in enumerate(value))

    def json(self) -> Json:
        lengths = {} if self.count is None else {"minItems": self.count, "maxItems": self.count}
        return {"type": "array", "items": self.item.json(), **lengths}


@dataclass(frozen=True, eq=False, repr=False)
class Listed(Key):
    """An array of values of one kind; from ``fewest`` to ``most`` of them."""

    item: Key = Number("")
    fewest: int = 0
    most: int | None = None
    rule: str = "an array"
    form = list

    def take(self, table: Place, key: str, value: Any) -> list[Any]:
        if not isinstance(value, list):
            self.refuse(table, key, value, self.rule)
        items = [self.item.take(table, f"{key}.{index}", item) for index, item in enumerate(value)]
        if len(value) < self.fewest or (self.most is not None and len(value) > self.most):
            self.refuse(table, key, value, self.rule)
        return items

    def json(self) -> Json:
        lengths = {"minItems": self.fewest} if self.fewest else {}
        return {"type": "array", "items": self.item.json(), **lengths, **({"maxItems": self.most} if self.most else {})}


@dataclass(frozen=True, eq=False, repr=False)
class ByName(Key):
    """Numbers by the names of joints, coordinates or others; ``joint1.x = 1`` and ``joint1 = { x = 1 }`` are one TOML.

    Attributes:
        named: what names are those of.
        by: by which of them a number is.
        depth: of tables in tables, at most.
        numbered: whether numbers may stand among the words of a name.
    """

    item: Number = Number("")
    form = dict
    named: str = "joints or coordinates"
    by: str = "joint or coordinate"
    depth: int = 3
    numbered: bool = False

    def take(self, table: Place, key: str, value: Any) -> dict[str, float]:
        numbers: dict[str, float] = {}

        def walk(inner: object, path: tuple[str, ...]) -> None:
            where = ".".join((key, *path))
            if isinstance(inner, dict) and len(path) < self.depth:
                for name, value in inner.items():
                    if not all(map(is_word if self.numbered else is_identifier, name.split("."))):
                        table.fail(f"got the name {show(name)}; allowed: names of {self.named}", where)
                    walk(value, (*path, *name.split(".")))
            elif path:
                name = ".".join(path)
                if name in numbers:
                    table.fail(f"{show(name)} stands twice; allowed: once", key)
                numbers[name] = self.item.take(table, where, inner)
            else:
                self.refuse(table, key, inner, f"a table of numbers by {self.by}")

        walk(value, ())
        return numbers

    def json(self) -> Json:
        name = r"[A-Za-z0-9_]+" if self.numbered else IDENTIFIER.pattern
        schema: Json = self.item.json()
        for _ in range(self.depth):
            inner = schema if schema.get("type") == "number" else {"anyOf": [self.item.json(), schema]}
            names = {"pattern": rf"^{name}(\.{name})*$"}
            schema = {"type": "object", "propertyNames": names, "additionalProperties": inner}
        return schema


@dataclass(frozen=True, eq=False, repr=False)
class Either(Key):
    """One of several kinds, told apart by their TOML types; others are refused as the first, or by the rule."""

    options: tuple[Key, ...] = ()
    rule: str = ""

    def take(self, table: Place, key: str, value: Any) -> Any:
        if self.rule and not any(isinstance(value, option.form) for option in self.options):
            self.refuse(table, key, value, self.rule)
        return self.option(value).take(table, key, value)

    def option(self, value: object) -> Key:
        """Return the kind of key that the value is meant for."""
        return next((option for option in self.options if isinstance(value, option.form)), self.options[0])

    def json(self) -> Json:
        return {"anyOf": [option.schema() for option in self.options]}


Keys = Mapping[str, Key]
