"""The source distribution and the wheel, built as for an index."""

from __future__ import annotations

import importlib.metadata
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
MADE = shutil.ignore_patterns(
    ".git", ".venv", ".*cache", ".hypothesis", "__pycache__", "*.pyc", "*.egg-info", "build", "dist", "out"
)


def build_archives(copy: Path, out: Path) -> tuple[Path, Path]:
    """Source distribution, and the wheel made of it; from a copy of the tree, which stays clean."""
    shutil.copytree(ROOT, copy, ignore=MADE)
    command = [sys.executable, "-m", "build", *([] if _isolated() else ["--no-isolation"]), "--outdir", str(out)]
    result = subprocess.run([*command, str(copy)], capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stdout[-3000:] + result.stderr[-3000:]
    (source,), (wheel,) = out.glob("*.tar.gz"), out.glob("*.whl")
    return source, wheel


def _isolated() -> bool:
    """Whether the installed setuptools cannot make wheels by itself, so that one is fetched for the build."""
    major, minor = (int(part) for part in importlib.metadata.version("setuptools").split(".")[:2])
    return (major, minor) < (70, 1)
