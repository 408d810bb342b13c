"""Arrays of .npz files: what a file says of itself is looked at before anything is taken into memory."""

from __future__ import annotations

import os
import struct
import tokenize
import zipfile
import zlib
from collections.abc import Collection
from math import prod
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from .errors import InputError
from .files import as_path, open_regular
from .identifiers import plain_path
from .limits import MOST_TEXTS
from .names import show

VARIABLE = "EOMGEN_NPZ_MB"  # of the environment: megabytes that the arrays of a file may have
_MOST_MB = 256
_MOST_DIRECTORY = 1 << 20  # bytes of a file's directory: some ten thousand arrays
_END = struct.Struct("<4s4H2LH")  # of the directory, as the ZIP format has it
_BLOCK = 1 << 20
_WIDE = 8  # bytes of a number, once it is computed with
_ALLOWED = "; allowed: what numpy.savez writes"
REAL = "biufUS"  # kinds of dtypes: real numbers and texts
COMPLEX = f"{REAL}c"
_DAMAGED = (  # what NumPy and zipfile raise for files that are not what NumPy wrote
    ValueError,
    LookupError,
    ArithmeticError,
    TypeError,
    AttributeError,
    EOFError,
    NotImplementedError,
    RuntimeError,  # also RecursionError
    SyntaxError,
    MemoryError,
    struct.error,
    tokenize.TokenError,
    zipfile.BadZipFile,
    zlib.error,
)


def read_npz(
    path: Path | str, names: Collection[str] | None = None, kinds: str = REAL, most: int | None = None
) -> dict[str, NDArray[Any]]:
    """Read arrays of numbers and texts by name, as ``numpy.savez`` and ``numpy.savez_compressed`` write them.

    Arrays may have 256 MB together, where a shorter number counts as one of eight bytes; the environment's
    ``EOMGEN_NPZ_MB`` says otherwise.  It is known before anything is unpacked, so that a small file cannot become a
    large one.

    Args:
        path: of the file.
        names: of the arrays to read, as far as they are there; None: all.
        kinds: of dtypes that arrays may have, REAL or COMPLEX.
        most: bytes that they may have together, where that is less than what is said above.

    Raises:
        InputError: the file cannot be read, is no such file or a damaged one, holds a name twice or an array of
            something else, or is larger.
    """
    place, usual = as_path(path), most_bytes()
    allowed = f"{usual} (the environment's {VARIABLE} has their MB)"
    if most is not None and most < usual:
        usual, allowed = most, str(most)
    try:
        with open_regular(place, usual) as stream:
            _check_end(stream, plain_path(path))
            with zipfile.ZipFile(stream) as archive:
                return _arrays(archive, plain_path(path), (usual, allowed), names, kinds)
    except InputError:
        raise
    except OSError as error:
        reason = error.strerror or str(error)
        raise InputError(
            f"{plain_path(path)}: cannot be read: {reason}{'' if 'allowed: ' in reason else _ALLOWED}"
        ) from None
    except _DAMAGED as error:
        raise InputError(f"{plain_path(path)}: is no .npz as NumPy writes it ({show(str(error))}){_ALLOWED}") from None


def most_bytes(variable: str = VARIABLE, megabytes: int = _MOST_MB) -> int:
    """Return the bytes that a file may have: megabytes, or as the environment says; InputError for no number."""
    text = os.environ.get(variable, str(megabytes))
    if not (text.isascii() and text.isdecimal() and int(text[:9]) > 0 and len(text) <= 9):
        raise InputError(f"the environment's {variable} is {show(text)}; allowed: a number of megabytes")
    return int(text) << 20


def _check_end(stream: BinaryIO, path: Path | str) -> None:
    """Refuse a file whose directory alone would take long: its end says how large it is."""
    stream.seek(0, os.SEEK_END)
    size = stream.tell()
    stream.seek(max(size - _END.size - 20, 0))
    tail = stream.read()
    if len(tail) < _END.size or tail[-_END.size :][:4] != b"PK\5\6" or tail[: -_END.size].startswith(b"PK\6\7"):
        raise InputError(f"{path}: is no .npz as NumPy writes it (its end is not that of a ZIP file){_ALLOWED}")
    directory = _END.unpack(tail[-_END.size :])[5]
    if directory > _MOST_DIRECTORY:
        raise InputError(f"{path}: its directory has {directory} bytes; allowed: up to {_MOST_DIRECTORY}")


def _arrays(
    archive: zipfile.ZipFile, path: Path | str, most: tuple[int, str], names: Collection[str] | None, kinds: str
) -> dict[str, NDArray[Any]]:
    """Read arrays; ``most``: bytes that they may have together, and how that is said."""
    entries: dict[str, zipfile.ZipInfo] = {}
    for entry in archive.infolist():
        name = entry.filename.removesuffix(".npy")
        if name in entries:
            raise InputError(f"{path}: array {show(name)} is there twice; allowed: once")
        entries[name] = entry
    total = sum(entry.file_size for entry in entries.values())
    if total > most[0]:
        raise InputError(f"{path}: its arrays have {total} bytes; allowed: up to {most[1]}")
    arrays: dict[str, NDArray[Any]] = {}
    wide = 0
    for name, entry in entries.items():
        if names is not None and name not in names:
            continue
        with archive.open(entry) as member:
            place = f"{path}: array {show(name)}"
            shape, by_columns, dtype = _header(member, entry.file_size, kinds, place)
            wide += prod(shape) * max(dtype.itemsize, _WIDE)
            if wide > most[0]:
                got = f"with it the arrays have {wide} bytes as numbers of {_WIDE} bytes each"
                raise InputError(f"{place}: {got}; allowed: up to {most[1]}")
            arrays[name] = _array(member, np.empty(shape, dtype, order="F" if by_columns else "C"), place)
    return arrays


def _header(member: Any, size: int, kinds: str, place: str) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    """Return shape, order and dtype of an entry of that size, as it has them."""
    if np.lib.format.read_magic(member) != (1, 0):
        raise InputError(
            f"{place}: is of another format than (1, 0), which NumPy writes for numbers and texts{_ALLOWED}"
        )
    shape, by_columns, dtype = np.lib.format.read_array_header_1_0(member)
    if dtype.kind not in kinds or dtype.itemsize == 0 or dtype.hasobject:
        raise InputError(f"{place}: has dtype {show(str(dtype))}; allowed: numbers and texts")
    counts = all(isinstance(n, int) and not isinstance(n, bool) and n >= 0 for n in shape)
    if not counts or prod(max(n, 1) for n in shape) >= 1 << 62:
        raise InputError(f"{place}: has shape {show(str(shape))}; allowed: whole numbers that an array can have")
    if prod(shape) * dtype.itemsize != size - member.tell():
        raise InputError(
            f"{place}: has {size - member.tell()} bytes; its shape and dtype ask for another number{_ALLOWED}"
        )
    if dtype.kind in "US" and prod(shape) > MOST_TEXTS:
        raise InputError(f"{place}: has {prod(shape)} texts; allowed: up to {MOST_TEXTS}")
    return shape, by_columns, dtype


def _array(member: Any, whole: NDArray[Any], place: str) -> NDArray[Any]:
    """Read an array whose header has been read."""
    flat = whole.reshape(-1, order="A").view(np.uint8).data if whole.size else memoryview(b"")
    for start in range(0, len(flat), _BLOCK):
        block = flat[start : start + _BLOCK]
        filled = 0
        while filled < len(block):
            count = member.readinto(block[filled:])
            if not count:
                raise InputError(f"{place}: ends after {start + filled} of {len(flat)} bytes{_ALLOWED}")
            filled += count
    if member.read(1):
        raise InputError(f"{place}: goes on behind its end{_ALLOWED}")
    return whole
