"""Values of plain data by dotted paths: keys of tables, names or numbers of entries of lists."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from ..errors import InputError
from ..names import listed, nearest, show

CURVE = "curve"  # pairs, whose second numbers are meant


def set_path(values: dict[str, Any], path: str, number: Any) -> None:
    """Put a value where a dotted path leads; InputError says where it ends."""
    holder, key = _place(values, path)
    holder[key] = number


def get_path(values: Mapping[str, Any], path: str) -> Any:
    """Return the value at a dotted path; None where a table has no such key yet."""
    holder, key = _place(values, path)
    return holder.get(key) if isinstance(holder, dict) else holder[key]


def numbered(entries: Sequence[Any], names: Sequence[str] = ()) -> Iterator[tuple[int, str]]:
    """Yield the number of each entry with what a path may call it: its number, its name, or one of some names.

    Args:
        entries: of a list; tables among them may have names.
        names: of all entries, where they have none themselves.
    """
    for i, entry in enumerate(entries):
        name = entry.get("name") if isinstance(entry, dict) else names[i] if i < len(names) else None
        if isinstance(name, str):
            yield i, name
        yield i, str(i)


def _place(values: Any, path: str) -> tuple[Any, Any]:
    here: Any = values
    parts = path.split(".")
    for i, part in enumerate(parts):
        if isinstance(here, list):
            places = {name: number for number, name in reversed(list(numbered(here)))}
            if part not in places:
                said = f"{show(path)}: {'.'.join(parts[:i])} has entries 0 to {len(here) - 1}"
                named = [name for name in places if not name.isdecimal()]
                raise InputError(f"{said}{f' by name: {listed(named)}' if named else ''}")
            key: Any = places[part]
        elif isinstance(here, dict):
            key = part
            if part not in here and i < len(parts) - 1:
                known = listed(here)
                raise InputError(f"{show(path)}: there is no {show(part)}{nearest(part, here)}; known: {known}")
        else:
            raise InputError(f"{show(path)}: {'.'.join(parts[:i])} is {show(here)}, which has no parts")
        if i == len(parts) - 1:
            return here, key
        here = here[key]
    raise InputError(f"{show(path)}: is empty")
