"""JSON Schemas of our TOML files, made of the forms that the readers use, for ``eomgen schema``.

Draft 7, without references, for editors of TOML (taplo, Even Better TOML, Tombi).  The reader refuses all that a schema
refuses; not the other way round: only the reader checks that keys go together, that names exist, that the joints form
a tree, that an inertia is one of a body.
"""

from __future__ import annotations

import json

from ..description.keys import ROBOT
from ..errors import InputError, check_kind
from ..forms.keys import Json
from ..forms.tables import Entries, Form
from ..names import show
from ..scenario.keys import SCENARIO
from ..sweep.keys import PLAN

FORMATS: dict[str, tuple[Form, str]] = {
    "robot": (ROBOT, "Robot description of eomgen, SI units and radians"),
    "scenario": (SCENARIO, "Scenario of eomgen, SI units and radians"),
    "plan": (PLAN, "Plan of a sweep of eomgen"),
}
_DRAFT = "http://json-schema.org/draft-07/schema#"


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
    return {"$schema": _DRAFT, "title": title, **schema}


def schema_text(name: str) -> str:
    """Return the schema as JSON, ended by a newline; errors as ``schema_of``."""
    check_kind("name", name, isinstance(name, str), "a name")
    return json.dumps(schema_of(name), indent=1) + "\n"
