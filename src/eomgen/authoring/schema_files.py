"""Files of the JSON Schemas that are installed with eomgen; ``schemas`` writes them."""

from __future__ import annotations

import json
from pathlib import Path

from ..files import read_regular

_MOST_BYTES = 1 << 24  # of a schema, far more than one has
_FOLDER = Path(__file__).parents[1] / "schemas"


def schema_path(name: str) -> Path:
    """Return the file of a schema ("robot", "scenario" or "plan"), for editors."""
    return _FOLDER / f"{name}.schema.json"


def is_schema(path: Path, name: str) -> bool:
    """Return whether a file is a schema of that name, of whatever version."""
    try:
        title = json.loads(read_regular(path, _MOST_BYTES))["title"]
    except (OSError, ValueError, LookupError, TypeError, RecursionError):
        return False
    return bool(title == json.loads(schema_path(name).read_text(encoding="ascii"))["title"])
