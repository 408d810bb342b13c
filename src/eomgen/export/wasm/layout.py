"""Structures of input signals in WebAssembly's memory: places and sizes of their fields, as eom.h declares them."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from functools import cache
from typing import Any

import numpy as np

from eomgen.codegen.c.library import library_types
from eomgen.kernel.stepping.packed_inputs import STRUCTS, Field

SIZES = {"int": 4, "size_t": 4, "float": 4, "double": 8, "long long": 8}  # bytes, and what they are aligned to
POINTER = 4


@cache
def layouts(dtype: str) -> dict[str, tuple[int, dict[str, int]]]:
    """Lay out the library's structures: size, and place of each field, bytes, by names as "eom_spline"."""
    layouts: dict[str, tuple[int, dict[str, int]]] = {}
    aligned: dict[str, int] = {}
    for body, name in re.findall(r"typedef struct(?: \w+)? \{([^{}]*)\} (\w+);", library_types(dtype)):
        places, end, widest = dict[str, int](), 0, 1
        for field, size, alignment in _fields(body, layouts, aligned):
            end = -(-end // alignment) * alignment
            places[field] = end
            end, widest = end + size, max(widest, alignment)
        layouts[name], aligned[name] = (-(-end // widest) * widest, places), widest
    return layouts


def _fields(
    body: str, known: dict[str, tuple[int, dict[str, int]]], aligned: dict[str, int]
) -> Iterator[tuple[str, int, int]]:
    """Yield the name, size and alignment of each field of a structure's text."""
    for text in filter(None, (" ".join(declaration.split()) for declaration in body.split(";"))):
        if function := re.search(r"\(\*(\w+)\)\(", text):
            yield function.group(1), POINTER, POINTER
            continue
        *words, declared = text.split()
        kind = " ".join(word for word in words if word not in ("const", "struct"))
        name, _, count = declared.rstrip("]").partition("[")
        if name.startswith("*"):
            yield name.lstrip("*"), POINTER, POINTER
        elif kind in SIZES:
            yield name, SIZES[kind] * int(count or 1), SIZES[kind]
        else:
            yield name, known[kind][0], aligned[kind]


def of_c(struct: str, dtype: str) -> str:
    """Name a structure of ``STRUCTS`` as C does."""
    return f"{'eomf' if struct == 'inputs' and dtype == 'float32' else 'eom'}_{struct}"


def struct_table(dtype: str) -> str:
    """Write ``STRUCTS`` for JavaScript: size of each, and place, kind, key and more of each field."""
    table: dict[str, Any] = {}
    for struct, fields in STRUCTS.items():
        size, places = layouts(dtype)[of_c(struct, dtype)]
        table[struct] = [size, [[places[name], *_plain(field)] for name, field in fields.items()]]
    return json.dumps(table, separators=(",", ":"))


def _plain(field: Field) -> list[str | int]:
    """Return the kind and key of a field, and what more there is; JSON has infinity as text alone."""
    more = field.more
    if not isinstance(more, str):
        more = int(more) if np.isfinite(more) else ("Infinity" if more > 0 else "-Infinity")
    return [field.kind, field.key, more] if more != 0 else [field.kind, field.key] if field.key else [field.kind]


def checked_places(dtype: str) -> list[str]:
    """Write conditions in C under which its compiler lays structures out as JavaScript does."""
    checks = []
    for struct, fields in STRUCTS.items():
        name = of_c(struct, dtype)
        size, places = layouts(dtype)[name]
        checks += [f"sizeof({name}) == {size}", *(f"offsetof({name}, {field}) == {places[field]}" for field in fields)]
    return checks
