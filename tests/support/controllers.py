"""C of controllers, compiled beside a robot's as a user's compiler would, with all warnings as errors."""

from __future__ import annotations

import subprocess
import tempfile
from collections.abc import Mapping
from pathlib import Path

STRICT = "-std=c99 -Wall -Wextra -Wconversion -pedantic -Werror -O0 -ffp-contract=off -shared -fPIC"


def compiled(files: Mapping[str, str], folder: Path) -> Path:
    """Write files into a folder, compile those that end in .c and lie there, and return the library."""
    for name, text in files.items():
        path = folder / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(text, encoding="utf-8")
    codes = [name for name in files if name.endswith(".c") and "/" not in name]
    library = Path(tempfile.mkdtemp(dir=folder), "controller.so")  # a path that no loaded library has or had
    subprocess.run(["cc", *STRICT.split(), *codes, "-o", str(library), "-lm"], cwd=folder, check=True)
    return library
