"""Folders that are replaced in one step: whoever looks sees the old one or the new one, and never none.

Two folders change places where the system has a call for that: renameat2 of Linux, renamex_np of macOS.  Elsewhere, and
on file systems that cannot do it, writers take turns and a reader may find nothing for a moment.  A generated package
with the name of another module would be imported in its place: ``check_module_name`` refuses such names.
"""

from __future__ import annotations

import ctypes
import errno
import glob
import hashlib
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from importlib.machinery import PathFinder
from pathlib import Path

from ..errors import InputError
from ..files import read_regular
from . import cache as store

NEEDED = ("numpy", "cffi", "_cffi_backend", "eomgen")  # what a package imports, and what writes it
_MOST = 1 << 26  # bytes of a package's metadata
_HERE, _EXCHANGE, _SWAP = -100, 2, 2  # AT_FDCWD, RENAME_EXCHANGE and RENAME_SWAP of the systems' headers
_CANNOT = (errno.ENOSYS, errno.EINVAL, errno.ENOTSUP, errno.EOPNOTSUPP)
_TAKEN = (errno.ENOTEMPTY, errno.EEXIST, errno.ENOTDIR)
_REFUSED = (errno.EACCES, errno.EPERM)  # what Windows says of a folder that is there
_ATTEMPTS = 1000  # each begins anew only where somebody else was faster


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
    """Put a folder of ``new_folder`` in place of its target; what was there before is left under the private name.

    Args:
        private: the new folder.
        target: its place; nothing, or what ``check`` lets pass.
        check: raises for what must not be replaced.

    Raises:
        OSError: it cannot be moved there.
    """
    for _ in range(_ATTEMPTS):
        check(target)
        try:
            os.rename(private, target)  # nothing is there, or an empty folder
            return
        except OSError as error:
            if error.errno not in _TAKEN and not (error.errno in _REFUSED and os.path.lexists(target)):
                raise
        try:
            if not exchange(private, target):
                _take_turns(private, target, check)
                return
        except FileNotFoundError:  # somebody took the target away
            if not private.exists():
                raise
            continue
        try:
            check(private)
        except BaseException:  # somebody put something else there after the first look
            exchange(private, target)
            raise
        return
    raise OSError(errno.EBUSY, "others replace it all the time", str(target))


def exchange(one: Path, other: Path) -> bool:
    """Let two paths change places in one step; False where the system or the file system cannot.

    Raises:
        OSError: the paths cannot be renamed.
    """
    call = _system_call()
    if call is None:
        return False
    if call(os.fsencode(one), os.fsencode(other)) == 0:
        return True
    number = ctypes.get_errno()
    if number in _CANNOT:
        return False
    raise OSError(number, os.strerror(number), str(other))


def _system_call() -> Callable[[bytes, bytes], int] | None:
    """Return the system call that exchanges two paths, or None."""
    if not sys.platform.startswith(("linux", "darwin")):
        return None
    library = ctypes.CDLL(None, use_errno=True)
    if sys.platform == "darwin":
        swap = getattr(library, "renamex_np", None)
        return None if swap is None else lambda one, other: int(swap(one, other, ctypes.c_uint(_SWAP)))
    rename = getattr(library, "renameat2", None)
    if rename is None:
        return None
    return lambda one, other: int(rename(_HERE, one, _HERE, other, ctypes.c_uint(_EXCHANGE)))


def _take_turns(private: Path, target: Path, check: Callable[[Path], None]) -> None:
    """Replace a folder by two renames, under a lock that writers know; the first one is undone if the second fails."""
    with store.locked(hashlib.sha256(os.fsencode(target.absolute())).hexdigest()):
        check(target)
        aside = private.with_name(f"{private.name}-replaced")
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


def check_module_name(name: str) -> str:
    """Refuse a name for a package that could not be imported, or that would break others.

    Args:
        name: of the package.

    Returns:
        A note about a package of that name that is installed and would be hidden, or hide this one; "" where there is
        none.

    Raises:
        InputError: it is the name of a module of Python itself, or of what the package needs.
    """
    if name in NEEDED or name in sys.stdlib_module_names:
        owner = "which the package itself imports" if name in NEEDED else "a module of Python itself"
        raise InputError(f"name: the package would be called {name!r}, {owner}; allowed: another name of the robot")
    spec = PathFinder.find_spec(name)  # of those on sys.path; nothing is imported
    if spec is None or _is_generated(name, spec.origin):
        return ""
    return f"a package {name!r} is installed; where both can be found, import takes the first on sys.path"


def _is_generated(name: str, origin: str | None) -> bool:
    """Whether a module is a package that was generated before."""
    try:
        return origin is not None and b'"generator"' in read_regular(Path(origin).parent / f"{name}.json", _MOST)
    except (OSError, ValueError):
        return False
