"""Folders that are replaced whole: by two renames under a lock, between which a reader may find nothing."""

from __future__ import annotations

import glob
import hashlib
import os
import shutil
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from . import cache as store


@contextmanager
def new_folder(target: Path) -> Iterator[Path]:
    """Give an empty folder beside the target to a block; it is gone afterwards, unless it was moved.

    Folders that writers left behind who were killed more than a day ago are removed.
    """
    _remove_leftovers(target)
    private = Path(tempfile.mkdtemp(prefix=f".{target.name}-making-", dir=target.parent))
    try:
        yield private
    finally:
        _remove(private)


def put_folder(private: Path, target: Path, check: Callable[[Path], None]) -> None:
    """Put a folder of ``new_folder`` in place of its target; the first rename is undone if the second fails.

    Args:
        private: the new folder.
        target: its place; nothing, or what ``check`` lets pass.
        check: raises for what must not be replaced.

    Raises:
        OSError: it cannot be moved there.
    """
    aside = private.with_name(f"{private.name}-replaced")
    with store.locked(hashlib.sha256(os.fsencode(target.absolute())).hexdigest()):
        check(target)
        if os.path.lexists(target):
            os.rename(target, aside)
        try:
            os.rename(private, target)
        except OSError:
            if os.path.lexists(aside):
                os.rename(aside, target)  # nothing is lost
            raise
    _remove(aside)


def _remove_leftovers(target: Path) -> None:
    before = time.time() - store.DAY
    for path in target.parent.glob(f".{glob.escape(target.name)}-making-*"):
        with suppress(OSError):
            status = path.lstat()
            if max(status.st_mtime, status.st_ctime) < before:  # a folder that was moved there just now may be old
                _remove(path)


def _remove(path: Path) -> None:
    """Remove a folder, or a link to one, that may be there."""
    if path.is_symlink():
        with suppress(OSError):
            path.unlink()
    else:
        shutil.rmtree(path, ignore_errors=True)
