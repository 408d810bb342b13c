"""Marks of fields, names of numbers, and pickling, which all values of a robot share."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from types import MappingProxyType

LATER: Mapping[str, bool] = MappingProxyType({"later": True})  # marks fields that older records do not have
Numbers = Iterator[tuple[str, float | None]]  # by names of parameters below an owner's; None where one is not set


def below(table: str, numbers: Iterable[tuple[str, float | None]]) -> Numbers:
    """Yield numbers by their names with that of the table in front."""
    yield from ((f"{table}.{key}", value) for key, value in numbers)


class Picklable:
    """A record whose fields may be mapping proxies, which cannot be pickled."""

    def __reduce__(self) -> tuple[object, ...]:
        values = (dict(x) if isinstance(x, MappingProxyType) else x for x in vars(self).values())
        return type(self), tuple(values)
