"""Content-addressed cache of sources and compiled packages, safe between processes.

An entry is a folder whose name is a hash of all that it depends on.  It is written under a private name and renamed
into place, under a lock that a killed process releases.  Its files are read once: what is used are the very bytes whose
hashes were checked, so that nothing that happens to the folder later matters.  An entry that does not match is made
again; one that a crash of the machine left half written is one of these, so nothing waits for the disk.
"""

from __future__ import annotations

import atexit
import hashlib
import json
import os
import shutil
import stat
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path, PurePosixPath

from ..errors import BuildError

MANIFEST = "manifest.json"
_MOST_MANIFEST = 1 << 20  # bytes; a name and a hash of each file
VARIABLE = "EOMGEN_CACHE_DIR"
KINDS = ("derivations", "sources", "packages", "objects", "externals", "extensions", "libraries", "devices")
LOCKS = "locks"
PASSING = ("making-", "damaged-", "loading-")  # folders that live for one call
GRACE = 5.0  # s for a thread to finish or remove an entry when Python exits
PATIENCE = 900.0  # s, after which a process that holds a lock is no longer waited for
DAY = 86400.0

Files = Mapping[str, bytes]


@dataclass(frozen=True)
class Entry:
    """An entry of the cache: files by name ("one_link.json"), whose hashes were checked."""

    kind: str
    key: str
    files: Files
    private: Path | None = None

    @property
    def folder(self) -> Path:
        """Folder that the entry was read from; the private one of an entry that is still made."""
        return self.private or cache_folder() / self.kind / self.key


def cache_folder() -> Path:
    """Return the cache's root: $EOMGEN_CACHE_DIR, or "eomgen" in the user's cache folder."""
    chosen = os.environ.get(VARIABLE, "")
    if chosen:
        return Path(chosen)
    import platformdirs

    return Path(platformdirs.user_cache_dir("eomgen"))


def entry(kind: str, key: str, make: Callable[[Path], None]) -> Entry:
    """Return an entry, made by ``make(private folder)`` if it is missing or damaged.

    Args:
        kind: one of KINDS.
        key: hexadecimal hash of what the entry depends on.

    Raises:
        BuildError: the cache cannot be written, or is not a folder of this user's alone.
    """
    root = cache_folder()
    with _reported(root):
        files = _read(root, kind, key)
        if files is None:
            _make_folders(root, kind)
            files = _make_locked(root, kind, key, make)
        return Entry(kind, key, files)


def unfinished(kind: str, key: str, folder: Path) -> Entry:
    """Read what a ``make`` has written so far into its private folder, as the entry that it will be."""
    files = {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    return Entry(kind, key, files, folder)


def find(kind: str, key: str) -> Entry | None:
    """Return an entry that is there and whole, or None.

    Raises:
        BuildError: the cache is not a folder of this user's alone.
    """
    root = cache_folder()
    with _reported(root):
        files = _read(root, kind, key)
    return None if files is None else Entry(kind, key, files)


@contextmanager
def locked(key: str) -> Iterator[bool]:
    """Hold the lock of a key, of an entry or of anything else that processes take turns with.

    The value is False where that is not possible.

    Raises:
        BuildError: the cache cannot be written, or is not a folder of this user's alone.
    """
    root = cache_folder()
    with _reported(root):
        _make_folders(root, KINDS[0])
    with _locked(root, key) as alone:
        yield alone


def write_files(folder: Path, files: Files) -> None:
    """Write an entry's files into a folder; ValueError for a name that leads out of it."""
    for name, data in files.items():
        place = PurePosixPath(name)
        if place.is_absolute() or ".." in place.parts:
            raise ValueError(f"{name!r} leads out of the entry")
        target = folder.joinpath(*place.parts)
        target.parent.mkdir(exist_ok=True)
        target.write_bytes(data)


def is_whole(folder: Path) -> bool:
    """Whether the entry in ``folder`` (root / kind / key) is there, and every file as it was written."""
    return _read(folder.parents[1], folder.parent.name, folder.name) is not None


def contents() -> list[tuple[str, str, int]]:
    """Return the kind, key and size in bytes of what is in the cache, whole or not."""
    entries = []
    for kind in KINDS:
        place = cache_folder() / kind
        for folder in sorted(place.iterdir()) if place.is_dir() else ():
            files = [path.lstat() for path in folder.rglob("*")] if folder.is_dir() else []
            entries.append((kind, folder.name, sum(file.st_size for file in files if stat.S_ISREG(file.st_mode))))
    return entries


def clear() -> int:
    """Remove all entries and leftovers; the number of entries that were removed.

    Kernels that are loaded go on; a build that is under way is waited for.

    Raises:
        BuildError: the cache cannot be written, or is not a folder of this user's alone.
    """
    root, entries = cache_folder(), contents()
    with _reported(root):
        _check_folders(root, *KINDS, LOCKS)
        for kind, key, _ in entries:
            (root / LOCKS).mkdir(exist_ok=True, mode=0o700)
            with _locked(root, key):
                _put_away(root, kind, key)
        _sweep(root, 0.0)
    return len(entries)


@contextmanager
def _reported(root: Path) -> Iterator[None]:
    """Raise what the system says about the cache as BuildError."""
    try:
        yield
    except OSError as error:
        raise BuildError(
            f"the cache folder {root} cannot be written: {error.strerror or error}; make it writable and see that the"
            f" disk has room, or set {VARIABLE} to another folder"
        ) from None


def _make_folders(root: Path, kind: str) -> None:
    root.mkdir(parents=True, exist_ok=True, mode=0o700)
    for name in (kind, LOCKS):
        (root / name).mkdir(exist_ok=True, mode=0o700)
    _check_folders(root, kind, LOCKS)  # somebody may have been faster


def _make_locked(root: Path, kind: str, key: str, make: Callable[[Path], None]) -> Files:
    with _locked(root, key) as alone:
        present = _read(root, kind, key)
        if present is not None:  # another process was faster
            return present
        _sweep(root, DAY, key if alone else "")
        with _private_folder(root, key) as private:
            make(private)
            files = _seal(private, kind, key)
            _put_away(root, kind, key)
            try:
                os.replace(private, root / kind / key)
            except OSError:  # without a lock somebody else may have been faster; the files are right all the same
                if _read(root, kind, key) is None:
                    raise
    return files


@contextmanager
def _private_folder(root: Path, key: str) -> Iterator[Path]:
    """Make a folder that is removed behind the block, for which Python waits a while where it ends meanwhile.

    Raises:
        BuildError: Python is exiting.
    """
    from ..threads import check_not_ending

    check_not_ending()
    removed = threading.Event()
    wait = partial(removed.wait, GRACE)
    folder = Path(tempfile.mkdtemp(prefix=f"making-{key}-", dir=root))
    atexit.register(wait)  # compilers of the block are registered later, and so ended before
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)
        removed.set()
        atexit.unregister(wait)


@contextmanager
def _locked(root: Path, key: str) -> Iterator[bool]:
    """Hold the lock of a key; the value is False where that is not possible.

    The lock spares work and nothing depends on it: a process that was stopped, or a file system without locks, must
    not keep others from their kernels.
    """
    from filelock import FileLock, Timeout

    lock = FileLock(str(root / LOCKS / f"{key}.lock"))
    with suppress(Timeout, NotImplementedError):
        lock.acquire(timeout=PATIENCE)
    try:
        yield lock.is_locked
    finally:
        lock.release()


def _put_away(root: Path, kind: str, key: str) -> None:
    """Remove an entry: out of the way in one step, so that nobody sees half of it."""
    folder = root / kind / key
    if not os.path.lexists(folder):
        return
    doomed = Path(tempfile.mkdtemp(prefix=f"damaged-{key}-", dir=root))
    with suppress(FileNotFoundError):  # somebody else did
        os.replace(folder, doomed / "entry")
    shutil.rmtree(doomed, ignore_errors=True)


def _sweep(root: Path, age: float, own: str = "") -> None:
    """Remove what processes left that were killed more than ``age`` seconds ago.

    Args:
        own: a key that this process alone makes, so that whatever passes for it is a killed process's.
    """
    before, killed = time.time() - age, tuple(f"{mark}{own}-" for mark in PASSING if own)
    for name in os.listdir(root) if root.is_dir() else ():
        try:
            doomed = name.startswith(PASSING) and (name.startswith(killed) or (root / name).lstat().st_mtime <= before)
        except OSError:  # gone
            continue
        if doomed:
            shutil.rmtree(root / name, ignore_errors=True)


def _seal(folder: Path, kind: str, key: str) -> Files:
    """Write the hashes of a new entry's files into it."""
    files = {}
    for path in sorted(folder.rglob("*")):
        if _modes_matter():
            path.chmod(stat.S_IMODE(path.stat().st_mode) & ~0o022)  # whatever the umask is
        if path.is_file():
            files[path.relative_to(folder).as_posix()] = path.read_bytes()
    manifest = {"of": f"{kind}/{key}", "files": {name: _hash(data) for name, data in files.items()}}
    text = json.dumps({**manifest, "sha256": _hash(json.dumps(manifest).encode())}, indent=1)
    target = folder / MANIFEST
    target.write_text(text, encoding="ascii")
    if _modes_matter():
        target.chmod(0o600)
    return files


def _read(root: Path, kind: str, key: str) -> Files | None:
    """Return the files of an entry that is there and whole, or None.

    Raises:
        BuildError: the cache is not a folder of this user's alone.
    """
    _check_folders(root, kind, f"{kind}/{key}")
    folder = root / kind / key
    try:
        manifest = json.loads(_bytes(folder / MANIFEST, _MOST_MANIFEST))
        recorded = manifest.pop("sha256")
        if recorded != _hash(json.dumps(manifest).encode()) or manifest["of"] != f"{kind}/{key}":
            return None
        files = {name: _bytes(folder / name) for name in manifest["files"]}
        whole = bool(files) and all(_hash(files[name]) == digest for name, digest in manifest["files"].items())
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return None
    return files if whole else None


def _bytes(path: Path, most: int | None = None) -> bytes:
    """Return the content of a file that nobody else may write; OSError where it is none, a link, or has more bytes."""
    flags = os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
    with open(os.open(path, flags), "rb") as stream:
        status = os.fstat(stream.fileno())
        if not stat.S_ISREG(status.st_mode) or (_modes_matter() and (_is_foreign(status) or _is_open(status))):
            raise OSError(f"{path} is not a file of this user's alone")
        if most is not None and status.st_size > most:
            raise OSError(f"{path} has {status.st_size} bytes")
        return stream.read()


def _check_folders(root: Path, *names: str) -> None:
    """Refuse a cache that somebody else could put a binary into; what is above its root is not looked at."""
    for folder in (root, *(root / name for name in names)):
        try:
            status = folder.lstat()
        except (FileNotFoundError, NotADirectoryError):
            continue
        if stat.S_ISLNK(status.st_mode):
            raise BuildError(
                f"the cache folder {folder} is a link to {os.readlink(folder)}; remove it, or set {VARIABLE} to a"
                " folder that is none"
            )
        if not _modes_matter():
            continue
        if _is_foreign(status):
            raise BuildError(f"the cache folder {folder} belongs to another user; set {VARIABLE} to a folder of yours")
        if _is_open(status):
            raise BuildError(
                f"the cache folder {folder} may be written by others (mode {stat.S_IMODE(status.st_mode):o});"
                f" run chmod go-w on it, or set {VARIABLE} to a folder that is yours"
            )


def _modes_matter() -> bool:
    """Whether the system has owners and modes as POSIX has them."""
    return hasattr(os, "getuid")


def _is_foreign(status: os.stat_result) -> bool:
    """Whether a file belongs to neither this user nor root."""
    return status.st_uid not in (os.getuid(), 0)


def _is_open(status: os.stat_result) -> bool:
    """Whether others may write to a file."""
    return bool(status.st_mode & (stat.S_IWGRP | stat.S_IWOTH))


def _hash(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()
