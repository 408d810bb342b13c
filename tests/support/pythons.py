"""Pythons of other versions, for the tests that must hold in each of them."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

PYTHONS = ("3.11", "3.12", "3.13", "3.14")
SAYS = "import sys; print(sys.version_info[:2])"


def interpreter(wanted: str) -> str | None:
    """A Python of that version: on the path, or of pyenv."""
    found = [f"python{wanted}"]
    root = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv"), "versions")
    found += [str(path) for path in sorted(root.glob(f"{wanted}.*/bin/python"))]
    for python in found:
        try:
            said = subprocess.run([python, "-c", SAYS], capture_output=True, text=True)
        except OSError:
            continue
        if said.returncode == 0 and said.stdout.strip() == str(tuple(map(int, wanted.split(".")))):
            return python
    return None
