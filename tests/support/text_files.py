"""Text files that tests read."""

from __future__ import annotations

from pathlib import Path


def text_file(path: Path, text: str) -> Path:
    """Write a text file in UTF-8 and return its path."""
    path.write_text(text, encoding="utf-8")
    return path
