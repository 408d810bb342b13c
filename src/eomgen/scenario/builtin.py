"""Built-in scenarios: their folder and their names."""

from __future__ import annotations

from pathlib import Path

BUILTIN = Path(__file__).parents[1] / "scenarios"


def builtin_scenarios() -> tuple[str, ...]:
    """Return the names of the built-in scenarios, sorted."""
    return tuple(sorted(path.stem for path in BUILTIN.glob("*.toml")))
