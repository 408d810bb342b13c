"""Reading of TOML tables: types, ranges and unknown keys, each refusal with its place.

Written by hand because a validation library costs 0.1 s of import, a third of what loading a compiled robot may take.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Sequence
from typing import Any, NoReturn

from .errors import DescriptionError
from .names import IDENTIFIER_RULE, is_identifier, listed, nearest, show, to_identifier
from .robot import Vector

LARGEST = 1e30  # numbers beyond it would overflow in products
SYNONYMS = {"continuous": "revolute", "hinge": "revolute", "slide": "prismatic", "floating": "free"}


class Table:
    """One TOML table.  Every reader method returns None (or an empty list) where the key is absent."""

    def __init__(
        self, value: object, where: str, source: str, allowed: Collection[str], path: tuple[str, ...] = ()
    ) -> None:
        self.where, self.source, self.path = where, source, path
        if not isinstance(value, dict):
            self.fail(f"got {show(value)}; allowed: a table with the keys {listed(allowed, 20)}")
        self.values: dict[str, Any] = value
        for key in value:
            if key not in allowed:
                self._refuse_key(key, allowed)

    def _refuse_key(self, key: str, allowed: Collection[str]) -> NoReturn:
        message = f"unknown key {show(key)}{nearest(key, allowed)} (allowed: {', '.join(allowed)})"
        raise DescriptionError(message, where=self.where, source=self.source, path=self._below(key))

    def fail(self, message: str, key: str = "") -> NoReturn:
        """Raise the DescriptionError of this table, or of one of its keys."""
        where = ".".join(filter(None, (self.where, key)))
        path = self._below(*key.replace("[", ".").replace("]", "").split(".")) if key else self.path
        raise DescriptionError(message, where=where, source=self.source, path=path)

    def _below(self, *keys: str) -> tuple[str, ...]:
        """The path of what is inside this table, () where the table's own is not known."""
        return (*self.path, *keys) if self.path or not self.where else ()

    def __contains__(self, key: str) -> bool:
        return key in self.values

    def require(self, key: str, what: str) -> None:
        """DescriptionError if the key is absent."""
        if key not in self.values:
            self.fail(f"the key {key!r} is missing; allowed: {what}")

    def text(self, key: str) -> str | None:
        """A string."""
        value = self.values.get(key)
        if value is not None and not isinstance(value, str):
            self.fail(f"got {show(value)}; allowed: a string", key)
        return value

    def name(self) -> str:
        """The identifier of an entry under the key ``name``."""
        self.require("name", IDENTIFIER_RULE)
        name = self.text("name")
        assert name is not None
        if not is_identifier(name):
            hint = f", such as {to_identifier(name)!r}" if name else ""
            self.fail(f"got {show(name)}; allowed: {IDENTIFIER_RULE}{hint}", "name")
        return name

    def choice(self, key: str, allowed: Sequence[str]) -> str | None:
        """One of a few strings."""
        value = self.text(key)
        if value is not None and value not in allowed:
            hint = f"; did you mean {SYNONYMS[value]!r}?" if SYNONYMS.get(value) in allowed else nearest(value, allowed)
            self.fail(f"got {show(value)}{hint} (allowed: {', '.join(allowed)})", key)
        return value

    def number(self, key: str, minimum: float | None = None) -> float | None:
        """A finite number, as float."""
        return None if key not in self.values else self.number_of(self.values[key], key, minimum)

    def number_of(self, value: object, key: str, minimum: float | None = None) -> float:
        """The value as a finite number, as float; the key is where it stands."""
        allowed = "a finite number" if minimum is None else f"a number that is at least {minimum:g}"
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            self.fail(f"got {show(value)}; allowed: {allowed}", key)
        if not math.isfinite(value) if isinstance(value, float) else False:
            self.fail(f"got {show(value)}; allowed: {allowed}", key)
        if abs(value) > LARGEST:
            self.fail(f"got {show(value)}; allowed: {allowed} of magnitude up to {LARGEST:g}", key)
        if minimum is not None and value < minimum:
            self.fail(f"got {show(value)}; allowed: {allowed}", key)
        return float(value) + 0.0  # turns -0.0 into 0.0

    def boolean(self, key: str) -> bool | None:
        """true or false."""
        value = self.values.get(key)
        if value is not None and not isinstance(value, bool):
            self.fail(f"got {show(value)}; allowed: true or false", key)
        return value

    def numbers(self, key: str, count: int) -> tuple[float, ...] | None:
        """An array of ``count`` finite numbers."""
        if key not in self.values:
            return None
        value = self.values[key]
        if not isinstance(value, list) or len(value) != count:
            self.fail(f"got {show(value)}; allowed: an array of {count} numbers", key)
        return tuple(self.number_of(item, f"{key}.{index}", None) for index, item in enumerate(value))

    def rows(self, key: str, count: int) -> list[tuple[float, ...]]:
        """An array of arrays of ``count`` finite numbers each."""
        value = self.values.get(key, [])
        if not isinstance(value, list):
            self.fail(f"got {show(value)}; allowed: an array of arrays of {count} numbers", key)
        rows = {str(i): row for i, row in enumerate(value)}
        table = Table(rows, f"{self.where}.{key}", self.source, rows, self._below(key))
        return [table.numbers(str(i), count) or () for i in range(len(value))]

    def vector(self, key: str) -> Vector | None:
        """An array of three finite numbers."""
        value = self.numbers(key, 3)
        return None if value is None else (value[0], value[1], value[2])

    def strings(self, key: str) -> list[str]:
        """An array of strings."""
        value = self.values.get(key, [])
        if not isinstance(value, list) or not all(isinstance(item, str) for item in value):
            self.fail(f"got {show(value)}; allowed: an array of strings", key)
        return value

    def table(self, key: str, allowed: Sequence[str]) -> Table | None:
        """A table inside this one."""
        if key not in self.values:
            return None
        where = ".".join(filter(None, (self.where, key)))
        return Table(self.values[key], where, self.source, allowed, self._below(key))

    def entries(self, key: str, allowed: Sequence[str]) -> Iterator[tuple[str, Table]]:
        """Name and table of each entry of an array of tables; names are identifiers and unique."""
        value = self.values.get(key, [])
        if not isinstance(value, list):
            self.fail(f"got {show(value)}; allowed: an array of tables, written [[{key}]]", key)
        seen = set()
        for index, item in enumerate(value):
            name = item.get("name") if isinstance(item, dict) else None
            place = name if isinstance(name, str) and is_identifier(name) else None
            where = f"{key}.{place}" if place else f"{key}[{index}]"
            entry = Table(item, where, self.source, allowed, (key, str(index)))
            name = entry.name()
            if name in seen:
                entry.fail(f"the name {name!r} is taken by an earlier entry of [[{key}]]; allowed: unique names")
            seen.add(name)
            yield name, entry
