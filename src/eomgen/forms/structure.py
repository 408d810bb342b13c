"""All faults of a file's structure, not the first alone: types, unknown and missing keys, ranges, words.

The readers stop at the first error; ``eomgen check`` lists them all.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ..errors import DescriptionError
from ..limits import MOST_ENTRIES
from .keys import Either
from .tables import Entries, Few, Form, Kinds, Sub, Table

MOST_ERRORS = 50  # of a file

Path = tuple[str, ...]


def faults(form: Form, values: dict[str, object], source: str) -> list[DescriptionError]:
    """Return the faults that a reader of the form would refuse by the kinds of its keys, at most MOST_ERRORS."""
    walk = _Walk(source, refining=form.refines and "urdf" in values)
    walk.table(form, values, "", ())
    return walk.errors[:MOST_ERRORS]


class _Walk:
    """A pass over a file that collects errors.  refining: a URDF brings in keys that are needed otherwise."""

    def __init__(self, source: str, refining: bool) -> None:
        self.source, self.refining = source, refining
        self.errors: list[DescriptionError] = []

    def tried(self, read: Callable[..., Any], *arguments: Any) -> DescriptionError | None:
        """Read, note and return the error; None if there is none."""
        try:
            read(*arguments)
        except DescriptionError as error:
            self.errors.append(error)
            return error
        return None

    def table(self, form: Form | Kinds, value: Any, where: str, path: Path) -> None:
        """Note the faults of a table."""
        while len(self.errors) < MOST_ERRORS:
            error = self.tried(form.read, value, where, self.source, path)
            if error is None:
                break
            if not error.at_key:
                return
            value = {key: inner for key, inner in value.items() if key != error.path[-1]}
        else:
            return
        table = form.read(value, where, self.source, path)
        refined = self.refining and isinstance(form, Form) and form.refines
        for key, kind in table.keys.items():
            if kind.needed and (not refined or (where and key == "name")):
                self.tried(table.require_one, key, kind.needed)
        for key in value:
            self.key(table, key)

    def key(self, table: Table, key: str) -> None:
        """Note the faults of a key's value."""
        kind, value, before = table.keys[key], table.values[key], len(self.errors)
        where, path = ".".join(filter(None, (table.where, key))), (*table.path, key)
        one = kind.option(value) if isinstance(kind, Either) else kind
        if isinstance(one, Sub):
            self.table(one.inner, value, where, path)
        elif isinstance(kind, Entries) and isinstance(value, list) and len(value) <= MOST_ENTRIES:
            for index, item in enumerate(value):
                if len(self.errors) < MOST_ERRORS:
                    self.table(kind.inner, item, kind.where(key, index, item), (*path, str(index)))
            if len(self.errors) == before:
                self.tried(list, table.entries(key))
        elif isinstance(kind, Entries):
            self.tried(list, table.entries(key))
        elif isinstance(one, Few) and isinstance(value, list) and one.takes(len(value)):
            for index, item in enumerate(value):
                self.table(one.inner, item, f"{where}.{index}", (*path, str(index)))
        else:
            self.tried(kind.take, table, key, value)
