"""Built-in robots: their folder and their names."""

from __future__ import annotations

from pathlib import Path

BUILTIN = Path(__file__).parents[1] / "robots"


def builtin_robots() -> tuple[str, ...]:
    """Return the names of the built-in robots, sorted."""
    return tuple(sorted(path.stem for path in BUILTIN.glob("*.toml")))
