"""Files of the JSON Schemas that are installed with eomgen; ``schemas`` writes them."""

from __future__ import annotations

import json
from pathlib import Path

_FOLDER = Path(__file__).parents[1] / "schemas"


def schema_path(name: str) -> Path:
    """Return the file of a schema ("robot", "scenario" or "plan"), for editors."""
    return _FOLDER / f"{name}.schema.json"


def is_schema(path: Path, name: str) -> bool:
    """Return whether a file is a schema of that name, of whatever version."""
    try:
        title = json.loads(path.read_text(encoding="utf-8"))["title"]
    except (OSError, ValueError, LookupError, TypeError):
        return False
    return bool(title == json.loads(schema_path(name).read_text(encoding="ascii"))["title"])
