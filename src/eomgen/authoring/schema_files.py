"""Files of the JSON Schemas, which eomgen is installed with; ``schemas`` writes what they hold."""

from __future__ import annotations

from pathlib import Path

_FOLDER = Path(__file__).parents[1] / "schemas"


def schema_path(name: str) -> Path:
    """The file of a schema ("robot", "scenario" or "plan"), which an editor can be pointed to."""
    return _FOLDER / f"{name}.schema.json"
