"""JSON Schemas of our TOML files, made of the forms that the readers use, for ``eomgen schema``.

Draft 7, for editors of TOML (taplo, Even Better TOML, Tombi).  A key that stands in several tables is defined once;
references stand alone, as these editors ignore what stands beside one.  The reader refuses all that a schema refuses;
not the other way round: only the reader checks that keys go together, that names exist, that the joints form a tree,
that an inertia is one of a body.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterator
from typing import Any

from ..description.keys import ROBOT
from ..errors import InputError
from ..forms.keys import Json
from ..forms.tables import Entries, Form
from ..identifiers import check_kind
from ..names import show
from ..scenario.keys import SCENARIO
from ..sweep.keys import PLAN

FORMATS: dict[str, tuple[Form, str]] = {
    "robot": (ROBOT, "Robot description of eomgen, SI units and radians"),
    "scenario": (SCENARIO, "Scenario of eomgen, SI units and radians"),
    "plan": (PLAN, "Plan of a sweep of eomgen"),
}
_DRAFT = "http://json-schema.org/draft-07/schema#"
_SHORT = 400  # characters of a key's schema, up to which it is written wherever it stands


def schema_of(name: str) -> Json:
    """Return the JSON Schema of one of FORMATS.

    Raises:
        InputError: there is no such format.
    """
    if name not in FORMATS:
        raise InputError(f"there is no format {show(name)}; allowed: {', '.join(FORMATS)}")
    form, title = FORMATS[name]
    schema = form.json()
    if form.refines:  # a URDF may bring in keys that are needed otherwise
        inner = {
            key: {"items": {"required": kind.inner.needed}}
            for key, kind in form.keys.items()
            if isinstance(kind, Entries) and isinstance(kind.inner, Form) and kind.inner.refines
        }
        schema["anyOf"] = [{"required": ["urdf"]}, {"required": schema.pop("required"), "properties": inner}]
    return {"$schema": _DRAFT, "title": title, **_with_definitions(schema)}


def schema_text(name: str) -> str:
    """Return the schema as JSON, ended by a newline; errors as ``schema_of``."""
    check_kind("name", name, isinstance(name, str), "a name")
    return json.dumps(schema_of(name), indent=1) + "\n"


def _with_definitions(schema: Json) -> Json:
    """Return the schema with keys that stand in several tables, and are not short, defined once."""
    places = Counter(json.dumps(key) for _, key in _keys(schema, set()))
    definitions: dict[str, Json] = {}
    names: dict[str, str] = {}
    taken: Counter[str] = Counter()

    def referring(value: Any) -> Any:
        """Return a part of the schema with references in the places of such keys."""
        if isinstance(value, list):
            return [referring(item) for item in value]
        if not isinstance(value, dict):
            return value
        keys = {name: reference(name, key) for name, key in value.get("properties", {}).items()}
        return {part: keys if part == "properties" else referring(inner) for part, inner in value.items()}

    def reference(name: str, key: Json) -> Json:
        """Return the schema of a key, or a reference to its definition."""
        text = json.dumps(key)
        if places[text] < 2 or len(text) <= _SHORT:
            return referring(key)  # type: ignore[no-any-return]
        if text not in names:
            taken[name] += 1
            names[text] = name if taken[name] == 1 else f"{name}_{taken[name]}"
            definitions[names[text]] = {}  # stands before what is inside of it
            definitions[names[text]] = referring(key)
        return {"$ref": f"#/definitions/{names[text]}"}

    whole: Json = referring(schema)
    return {**whole, "definitions": definitions} if definitions else whole


def _keys(schema: object, seen: set[str]) -> Iterator[tuple[str, Json]]:
    """Yield name and schema of all keys of tables, those inside of equal schemas once."""
    if isinstance(schema, list):
        for item in schema:
            yield from _keys(item, seen)
    elif isinstance(schema, dict):
        for part, inner in schema.items():
            if part != "properties":
                yield from _keys(inner, seen)
                continue
            for name, key in inner.items():
                yield name, key
                text = json.dumps(key)
                if text not in seen:
                    seen.add(text)
                    yield from _keys(key, seen)
