"""Files that are written whole or not at all."""

from __future__ import annotations

import glob
import os
import secrets
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from .errors import InputError

FIGURE_ENDINGS = (".svg", ".pdf", ".png")  # of files that figures are written to


def write_atomically(target: Path, write: Callable[[Any], None]) -> Path:
    """Call ``write(stream)`` on a temporary file beside the target, rename it into place, and return the target.

    Whatever ends the process or the machine, the target is what it was before, or new and whole.

    Raises:
        InputError: the folder or the file cannot be written.
    """
    temporary = target.with_name(f".{target.name}-{os.getpid()}-{secrets.token_hex(4)}")
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        try:
            with temporary.open("xb") as stream:
                write(stream)
                stream.flush()
                os.fsync(stream.fileno())  # first the content, then its name
            temporary.replace(target)
            _remove_leftovers(target)
        finally:
            temporary.unlink(missing_ok=True)
    except OSError as error:
        raise InputError(f"{target} cannot be written: {error.strerror or error}") from None
    return target


def _remove_leftovers(target: Path) -> None:
    """Temporary files of the target whose writers were killed more than a day ago."""
    before = time.time() - 86400.0
    for path in target.parent.glob(f".{glob.escape(target.name)}-*"):
        with suppress(OSError):
            if path.lstat().st_mtime < before:
                path.unlink()
