"""Files that are written whole or not at all, and read only where they are files, and no larger than expected."""

from __future__ import annotations

import csv
import errno
import glob
import io
import os
import stat
import time
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, BinaryIO

from .errors import InputError
from .identifiers import plain_path, show_path

FIGURE_ENDINGS = (".svg", ".pdf", ".png")  # of files that figures are written to
PAGE_ENDING = ".html"

Reader = Callable[[Path], object]  # of a format: raises InputError where the file cannot be used

_KINDS = {  # what a path may lead to, and what a reader would wait for, or never come to the end of
    stat.S_IFIFO: "a FIFO",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
    stat.S_IFSOCK: "a socket",
    stat.S_IFDIR: "a folder",
}


def as_path(path: Path | str, label: str = "path") -> Path:
    """Return a path that a caller gave as text or as a Path; InputError with the label if it is neither."""
    if not isinstance(path, (str, os.PathLike)):
        raise InputError(f"{label}: got a value of type {type(path).__name__}; allowed: a path, as text or as a Path")
    if not str(path):
        raise InputError(f"{label}: is an empty text; allowed: a path, as text or as a Path")
    if "\0" in str(path):
        raise InputError(f"{label}: {show_path(str(path))} has a null byte; allowed: a path, as text or as a Path")
    return Path(path)


def check_ending(path: Path | str, *endings: str, label: str = "output") -> Path:
    """Check the path of a file to write, and return it.

    Raises:
        InputError: it has none of the endings; the message begins with the label.
    """
    target = as_path(path, label)
    if target.suffix not in endings:
        raise InputError(f"{label}: {show_path(str(target))}; allowed: a path that ends in {', '.join(endings)}")
    return target


@contextmanager
def open_regular(path: Path, most: int) -> Iterator[BinaryIO]:
    """Open a file to be read, and give the stream to a block; nothing is waited for.

    Args:
        path: of a file, or of a link to one.
        most: bytes that it may have.

    Raises:
        OSError: there is no such file, it cannot be opened, it is a folder, a FIFO, a device or a socket, or it is
            larger; ``strerror`` says which.
        ValueError: the path holds a NUL.
    """
    flags = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_NOCTTY", 0) | getattr(os, "O_BINARY", 0)
    descriptor = os.open(path, flags)
    try:
        status = os.fstat(descriptor)
        if not stat.S_ISREG(status.st_mode):
            kind = _KINDS.get(stat.S_IFMT(status.st_mode), "no file")
            raise OSError(errno.EINVAL, f"it is {kind}; allowed: a regular file", str(path))
        if status.st_size > most:
            raise _too_large(f"{status.st_size} bytes", most, path)
    except BaseException:
        os.close(descriptor)
        raise
    with os.fdopen(descriptor, "rb") as stream:
        yield stream


def read_regular(path: Path, most: int) -> bytes:
    """Read all bytes of a file; arguments and errors as ``open_regular``, also for a file that grows meanwhile."""
    with open_regular(path, most) as stream:
        data = stream.read(most + 1)
    if len(data) > most:
        raise _too_large("more bytes than that", most, path)
    return data


def _too_large(size: str, most: int, path: Path) -> OSError:
    return OSError(errno.EFBIG, f"the file has {size}; allowed: up to {most}", str(path))


def write_atomically(target: Path, write: Callable[[Any], None], *, read: Reader | None) -> Path:
    """Write a temporary file beside the target, read it back, rename it into place, and return the target.

    Whatever ends the process or the machine, the target is what it was before, or new and whole.

    Args:
        target: path of the file; missing folders are made.
        write: called with the open stream.
        read: reads the format, see ``read_back``.  None where eomgen has no reader: figures, pages, source code, FMUs,
            wheels, WebAssembly, tables of results for other programs, forms with cells to fill in.

    Raises:
        InputError: the folder or the file cannot be written, or the file cannot be read back.
    """
    temporary = target.with_name(f".{target.name}-{os.getpid()}-{os.urandom(4).hex()}")
    made: list[Path] = []
    try:
        made = [folder for folder in (target.parent, *target.parent.parents) if not folder.exists()]
        target.parent.mkdir(parents=True, exist_ok=True)
        try:
            with temporary.open("xb") as stream:
                write(stream)
                stream.flush()
                os.fsync(stream.fileno())  # first the content, then its name
            if read is not None:  # which is of one piece now, and may be called what readers know formats by
                temporary = temporary.rename(temporary.with_name(f"{temporary.name}{target.suffix}"))
                read_back(temporary, target, read)
            temporary.replace(target)
            made = []
            _remove_leftovers(target)
        finally:
            temporary.unlink(missing_ok=True)
    except OSError as error:
        raise InputError(f"{plain_path(target)} cannot be written: {error.strerror or error}") from None
    finally:
        for folder in made:
            with suppress(OSError):
                folder.rmdir()
    return target


def read_back(path: Path, target: Path, read: Reader) -> None:
    """Read a file that was just written, before it gets its name.

    Args:
        path: of the file as it is now.
        target: its later path, which messages have in the place of the other one.
        read: reads the format from a path, and may compare what it finds with what was meant.

    Raises:
        InputError: ``read`` refuses the file; names the target and the reason.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # whoever reads the file later gets them
            read(path)
    except InputError as error:
        reason = str(error).replace(path.name, target.name)
        raise InputError(f"{plain_path(target)}: is not written, since it cannot be read back: {reason}") from None


def write_csv(
    target: Path, rows: Iterable[Iterable[Any]], comments: Iterable[str] = (), *, read: Reader | None
) -> Path:
    """Write rows of a table, the first one its header, behind lines of comments, and return the path.

    Raises:
        InputError: as of ``write_atomically``, which says what ``read`` is.
    """
    text = io.StringIO()
    text.writelines(f"# {line}\n" for line in comments)
    csv.writer(text, lineterminator="\n").writerows(rows)
    return write_atomically(target, lambda stream: stream.write(text.getvalue().encode("utf-8")), read=read)


def csv_cells(place: str, line: str, separator: str = ",", *, skip_spaces: bool = False) -> list[str]:
    """Return the cells of one line of a .csv file; a cell does not go on in the next line.

    Args:
        place: of the line, for messages.
        line: of the file.
        separator: of cells.
        skip_spaces: whether spaces before a cell, its quote too, are left out.

    Raises:
        InputError: the line is none of a .csv file.
    """
    if line.count('"') % 2:
        raise InputError(f"{place}: a quote is not closed; allowed: quotes that end in their line")
    try:
        return next(csv.reader([line], delimiter=separator, skipinitialspace=skip_spaces), [])
    except csv.Error as error:
        raise InputError(f"{place}: is no CSV ({error}); allowed: values with {separator!r} between them") from None


def _remove_leftovers(target: Path) -> None:
    """Remove temporary files of the target whose writers were killed more than a day ago."""
    before = time.time() - 86400.0
    for path in target.parent.glob(f".{glob.escape(target.name)}-*"):
        with suppress(OSError):
            if path.lstat().st_mtime < before:
                path.unlink()
