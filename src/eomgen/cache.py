"""Content-addressed cache of sources and compiled packages, safe between processes.

An entry is a folder whose name is a hash of all that it depends on.  It is written under a private name and renamed
into place, under a lock that a killed process releases; the hash of every file is checked before an entry is used, and
an entry that does not match is made again.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import stat
import tempfile
from collections.abc import Callable
from pathlib import Path

from .errors import BuildError

MANIFEST = "manifest.json"
VARIABLE = "EOMGEN_CACHE_DIR"


def cache_folder() -> Path:
    """The cache's root: $EOMGEN_CACHE_DIR, or "eomgen" in the user's cache folder."""
    chosen = os.environ.get(VARIABLE, "")
    if chosen:
        return Path(chosen)
    import platformdirs

    return Path(platformdirs.user_cache_dir("eomgen"))


def entry(kind: str, key: str, make: Callable[[Path], None]) -> Path:
    """The folder of an entry, made by ``make(private folder)`` if it is missing or damaged.

    Args:
        kind: "sources" or "packages".
        key: hexadecimal hash of what the entry depends on.

    Raises:
        BuildError: the cache cannot be written, or is not a folder of this user's alone.
    """
    root = cache_folder()
    folder = root / kind / key
    try:
        if root.exists():
            _check_owner(root)
        if _is_whole(folder):
            return folder
        root.mkdir(parents=True, exist_ok=True, mode=0o700)
        (root / kind).mkdir(exist_ok=True)
        return _make_locked(root, folder, make)
    except OSError as error:
        raise BuildError(
            f"the cache folder {root} cannot be written: {error.strerror or error}; make it writable and see that the"
            f" disk has room, or set {VARIABLE} to another folder"
        ) from None


def find(kind: str, key: str) -> Path | None:
    """The folder of an entry that is there and whole, or None."""
    folder = cache_folder() / kind / key
    return folder if _is_whole(folder) else None


def _make_locked(root: Path, folder: Path, make: Callable[[Path], None]) -> Path:
    from filelock import FileLock

    locks = root / "locks"
    locks.mkdir(exist_ok=True)
    with FileLock(str(locks / f"{folder.name}.lock")):
        if _is_whole(folder):  # another process was faster
            return folder
        private = Path(tempfile.mkdtemp(prefix="making-", dir=root))
        try:
            make(private)
            write_manifest(private)
            if folder.exists():  # damaged: out of the way in one step, so that nobody sees half of it
                doomed = Path(tempfile.mkdtemp(prefix="damaged-", dir=root))
                os.replace(folder, doomed / "entry")
                shutil.rmtree(doomed, ignore_errors=True)
            os.replace(private, folder)
        finally:
            shutil.rmtree(private, ignore_errors=True)
    return folder


def _check_owner(root: Path) -> None:
    """Refuse a cache that somebody else could put a binary into."""
    if not hasattr(os, "getuid"):
        return
    found = root.stat()
    if found.st_uid not in (os.getuid(), 0):
        raise BuildError(f"the cache folder {root} belongs to another user; set {VARIABLE} to a folder of your own")
    if found.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        raise BuildError(
            f"the cache folder {root} may be written by others (mode {stat.S_IMODE(found.st_mode):o});"
            f" run chmod go-w on it, or set {VARIABLE} to a folder of your own"
        )


def write_manifest(folder: Path) -> None:
    """Write the hashes of the folder's files into it."""
    hashes = {path.name: _hash(path) for path in sorted(folder.iterdir()) if path.is_file() and path.name != MANIFEST}
    (folder / MANIFEST).write_text(json.dumps(hashes, indent=1), encoding="ascii")


def _is_whole(folder: Path) -> bool:
    """Whether the entry is there and every file has the hash that was written down."""
    try:
        hashes = json.loads((folder / MANIFEST).read_text(encoding="ascii"))
        return bool(hashes) and all(_hash(folder / name) == digest for name, digest in hashes.items())
    except (OSError, ValueError, AttributeError):
        return False


def _hash(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()
