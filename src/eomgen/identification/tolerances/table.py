"""Tables of tolerances: a TOML file, or a mapping, that names parameters as calibrate does; checked value by value."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

from ...errors import DescriptionError
from ...files import as_path
from ...forms.toml_place import locate
from ...forms.toml_text import parse_toml, read_text
from ...limits import LARGEST
from ...names import listed, nearest, show

KEYS = ("deviation", "bound", "relative", "cost", "fixed")
CORRELATIONS = "correlations"  # the key beside the parameters
NONE: Mapping[str, str] = MappingProxyType({})
MOST = 400  # parameters: a worst case looks at every pair of them
_LARGEST_COST = 1e12
_SIZES = ("deviation", "bound")
_LONGEST = 400  # characters of a name that a message has as it is, more than names of parameters have
_MOST_PARTS = 20  # of a name, more than those of parameters have


@dataclass(frozen=True)
class Tolerance:
    """Tolerance of one parameter, as a table states it.

    deviation: standard deviation of a normal distribution; bound: half the width of a uniform one; one of them is None.
    relative: they are shares of the described value.  cost: of tightening, beside others.  is_fixed: stays as it is.
    """

    name: str
    deviation: float | None = None
    bound: float | None = None
    relative: bool = False
    cost: float = 1.0
    is_fixed: bool = False

    def as_table(self) -> dict[str, float | bool | None]:
        """Return the entry of a table that states it."""
        size = {"deviation": self.deviation} if self.deviation is not None else {"bound": self.bound}
        return {**size, "relative": self.relative, "cost": self.cost, "fixed": self.is_fixed}


@dataclass(frozen=True)
class Table:
    """A table as it was read: its tolerances in order, correlations as they were read, and where it came from."""

    entries: tuple[Tolerance, ...]
    source: str = "tolerances"
    text: str = ""
    correlations: Any = ()

    def refusal(self, name: str, message: str) -> DescriptionError:
        """Return the error of a parameter's entry, with its line in the file."""
        return self.refused(name.split("."), name, message)

    def refused(self, keys: Sequence[str], where: str, message: str) -> DescriptionError:
        """Return the error of what has these keys, with its line in the file."""
        where = where if len(where) <= _LONGEST and where.isascii() and where.isprintable() else show(where)
        error = DescriptionError(message, where=where, source=self.source, path=tuple(keys))
        if self.text:
            locate([error], self.text, parse_toml(self.text, self.source))
        return error


def read_table(
    tolerances: Mapping[str, Any] | Path | str, known: Sequence[str], refused: Mapping[str, str] = NONE
) -> Table:
    """Return a table of tolerances, from the path of a .toml file or a mapping of the same form.

    Args:
        tolerances: names, nested or with dots, with tables of KEYS; "*" in a name stands for any letters.
            Names that are written out go before those with "*".  Beside them CORRELATIONS, which stay as they are.
        known: names of parameters that there are.
        refused: names of what there is and no table may name, each with the reason and what is allowed.

    Raises:
        DescriptionError: with the file, the name, what came and what is allowed.
    """
    if isinstance(tolerances, Mapping):
        values, text, source = dict(tolerances), "", "tolerances"
    else:
        path = as_path(tolerances, "table")
        source = str(tolerances)
        if path.suffix != ".toml":
            raise DescriptionError(f"the table {show(source)} is no .toml file; allowed: a path that ends in .toml")
        text = read_text(path, source, ".toml file")
        values = parse_toml(text, source)
    table = Table((), source, text, values.pop(CORRELATIONS, ()))
    entries: dict[str, Tolerance] = {}
    exact: set[str] = set()
    for keys, entry in _entries(table, values, ()):
        name = ".".join(keys)
        names = meant(name, known)
        if not names:
            for one in meant(name, tuple(refused)):
                raise table.refused(keys, one, refused[one])
            allowed = f"{nearest(name, known)}; allowed: {listed(known)}"
            raise table.refused(keys, name, f"there is no such parameter{allowed}")
        read = _read(table, entry, keys)
        for one in names:
            if "*" not in name and one in exact:
                raise table.refused(keys, name, "is there twice; allowed: once")
            if "*" not in name or one not in exact:
                entries[one] = Tolerance(one, **read)
        exact |= set() if "*" in name else {name}
    if not entries:
        raise DescriptionError(f"no parameter is named; allowed: {listed(known)}", source=source)
    if len(entries) > MOST:
        raise DescriptionError(f"{len(entries)} parameters are named; allowed: up to {MOST}", source=source)
    return replace(table, entries=tuple(entries[name] for name in known if name in entries))


def _entries(
    table: Table, values: Mapping[str, Any], before: tuple[str, ...]
) -> Iterator[tuple[tuple[str, ...], Mapping[str, Any]]]:
    """Yield names, in the keys that the file has them by, and their tables."""
    for key, value in values.items():
        keys = (*before, str(key))
        if not isinstance(value, Mapping):
            message = f"{show(value)}; allowed: a table such as {{ deviation = 1e-5 }} or {{ bound = 1e-5 }}"
            raise table.refused(keys, ".".join(keys), message)
        if len(keys) > _MOST_PARTS:
            message = "is nested too deeply; allowed: names of a few parts, such as base.x"
            raise table.refused(keys, ".".join(keys), message)
        if value and all(isinstance(inner, Mapping) for inner in value.values()):
            yield from _entries(table, value, keys)
        else:
            yield keys, value


def meant(name: str, known: Sequence[str]) -> list[str]:
    """Return the known names that a name means: itself, or those that it matches; a * stands for letters, not dots."""
    if "*" not in name:
        return [name] if name in known else []
    parts = [part.split("*") for part in name.split(".")]
    return [one for one in known if _matches(parts, one.split("."))]


def _matches(parts: Sequence[Sequence[str]], components: Sequence[str]) -> bool:
    """Return whether each component consists of the pieces of its part, with any letters between them."""
    return len(parts) == len(components) and all(map(_has_pieces, parts, components))


def _has_pieces(pieces: Sequence[str], text: str) -> bool:
    """Return whether a text begins with the first piece, ends with the last one, and has the others between in order.

    Each piece is taken where it stands first, without going back; a regular expression takes minutes for many stars.
    """
    if len(pieces) == 1:
        return text == pieces[0]
    first, *between, last = pieces
    at, end = len(first), len(text) - len(last)
    if at > end or not (text.startswith(first) and text.endswith(last)):
        return False
    for piece in between:
        found = text.find(piece, at, end)
        if found < 0:
            return False
        at = found + len(piece)
    return True


def _read(table: Table, entry: Mapping[str, Any], keys: Sequence[str]) -> dict[str, Any]:
    """Return keywords of a Tolerance."""
    name = ".".join(keys)

    def refuse(key: str, message: str) -> DescriptionError:
        return table.refused((*keys, key), f"{name}.{key}", message)

    for key in entry:
        if key not in KEYS:
            raise refuse(str(key), f"is unknown{nearest(str(key), KEYS)}; allowed: {', '.join(KEYS)}")
    sizes = [key for key in _SIZES if key in entry]
    if len(sizes) != 1:
        message = f"has {' and '.join(sizes) or 'neither deviation nor bound'}; allowed: one of deviation, bound"
        raise table.refused(keys, name, message)
    fields: dict[str, Any] = {}
    for key in (*sizes, *(("cost",) if "cost" in entry else ())):
        value = entry[key]
        is_number = isinstance(value, (int, float)) and not isinstance(value, bool)
        if not is_number or not 0.0 <= value <= LARGEST or (key == "cost" and not 0.0 < value <= _LARGEST_COST):
            allowed = (
                "a number above 0, up to 1e12"
                if key == "cost"
                else f"a finite number that is not negative, up to {LARGEST:g}"
            )
            raise refuse(key, f"{show(value)}; allowed: {allowed}")
        fields[key] = float(value)
    for key, field in (("relative", "relative"), ("fixed", "is_fixed")):
        value = entry.get(key, False)
        if not isinstance(value, bool):
            raise refuse(key, f"{show(value)}; allowed: true or false")
        fields[field] = value
    return fields
