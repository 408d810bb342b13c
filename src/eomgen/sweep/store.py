"""The folder of a sweep: finished samples are only ever appended, so that they survive their writer's end.

sweep.json says what is swept; samples.jsonl has a line for every sample that is done, in the order of completion; a
last line without an end is of a writer that was killed, and is cut off.  Both carry checksums of what they say (since
format 2), so that no digit changes without a word.  Folders of format 1 are read, and not gone on with.
"""

from __future__ import annotations

import hashlib
import json
import os
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from ..errors import InputError
from ..files import open_regular, read_regular, write_atomically
from ..forms.plain import parse_json, value_of
from ..names import show
from ..npz import most_bytes
from .contents import CheckRow, SampleRow

MANIFEST, ROWS, LOCK = "sweep.json", "samples.jsonl", ".lock"
FORMAT = 2
VARIABLE = "EOMGEN_SWEEP_MB"  # of the environment: megabytes that the rows of a sweep may have
_MOST_MB = 1024
_MOST_MANIFEST = 1 << 25  # bytes
_MOST_LINE = 1 << 22
_MOST_VALUES = 1 << 28  # bytes of memory that a line or the manifest may take
SECONDS = 1.0  # after which what was written is on the disk


class SweepStore:
    """The open folder of one sweep; nobody else writes to it meanwhile."""

    def __init__(self, folder: Path, rows: dict[int, SampleRow], resumed: bool) -> None:
        self.folder, self.rows, self.resumed = folder, rows, resumed
        self._file = (folder / ROWS).open("ab", buffering=0)  # a line is the system's at once
        self._synced = time.monotonic()

    def append(self, rows: list[SampleRow]) -> None:
        """Take further samples.

        Raises:
            InputError: the folder cannot be written any more.
        """
        lines = "".join(json.dumps(line_of(row)) + "\n" for row in rows)
        try:
            rest = memoryview(lines.encode("ascii"))
            while rest:  # a disk that fills up takes some of it, and says so at the next write
                rest = rest[self._file.write(rest) :]
            if time.monotonic() - self._synced > SECONDS:
                self.sync()
        except OSError as error:
            raise InputError(f"{self.folder}: cannot be written: {error.strerror or error}") from None
        self.rows.update((row.index, row) for row in rows)

    def sync(self) -> None:
        """Wait until everything is on the disk."""
        os.fsync(self._file.fileno())
        self._synced = time.monotonic()

    def close(self) -> None:
        """Write everything to the disk, and close the file."""
        self.sync()
        self._file.close()


@contextmanager
def opened(folder: Path, manifest: Mapping[str, Any], check: CheckRow | None = None) -> Iterator[SweepStore]:
    """Open the folder of a sweep, new or resumed.

    Args:
        folder: new, empty, or of the same sweep.
        manifest: values that JSON holds, among them "key", "eomgen" and "robot"; those of what is resumed must be the
            same, but for "notes".
        check: says what is wrong with a row that is there, "" where nothing is.

    Raises:
        InputError: something else is in the folder, another process writes to it, or it cannot be written.
    """
    from filelock import FileLock, Timeout

    try:
        folder.mkdir(parents=True, exist_ok=True)
        resumed = (folder / MANIFEST).exists()
        if not resumed and any(path.name != LOCK for path in folder.iterdir()):
            raise InputError(f"{folder}: is not empty and holds no sweep; allowed: a new folder, or that of this sweep")
        manifest = {"format": FORMAT, **{key: x for key, x in manifest.items() if key != "check"}}
        lock = FileLock(str(folder / LOCK))
        try:
            lock.acquire(timeout=0)
        except Timeout:
            raise InputError(f"{folder}: another process is at work on this sweep; wait for it, or end it") from None
        try:
            if resumed:
                _check_same(folder, read_manifest(folder), manifest)
            else:
                text = json.dumps({**manifest, "check": checksum(manifest)}, indent=1)
                # read=None: the result of the sweep is loaded from the folder
                write_atomically(folder / MANIFEST, lambda stream: stream.write(text.encode()), read=None)
            store = SweepStore(folder, read_rows(folder, check, repair=True), resumed)
            try:
                yield store
            finally:
                store.close()
        finally:
            lock.release()
    except OSError as error:
        raise InputError(f"{folder}: cannot be written: {error.strerror or error}") from None


def read_manifest(folder: Path) -> dict[str, Any]:
    """Read a folder's manifest, without its checksum.

    Raises:
        InputError: there is none, it was changed, or is of a newer eomgen.
    """
    try:
        text = read_regular(folder / MANIFEST, _MOST_MANIFEST).decode("utf-8")
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or show(str(error))
        raise InputError(
            f"{folder}: holds no sweep ({MANIFEST}: {reason}); allowed: a folder that eomgen wrote"
        ) from None
    where = f"{folder}: holds no sweep ({MANIFEST})"
    manifest = parse_json(text, where, _MOST_VALUES)
    number = manifest.get("format") if isinstance(manifest, dict) else None
    if isinstance(number, bool) or not isinstance(number, int) or number < 1:
        raise InputError(f"{where}: got the format {show(number)}; allowed: a folder that eomgen wrote")
    if number > FORMAT:
        raise InputError(f"{folder}: written by a newer eomgen than this one; allowed: up to format {FORMAT}")
    check = manifest.pop("check", None)
    if number > 1 and check != checksum(manifest):
        raise InputError(f"{folder / MANIFEST}: was changed since it was written; allowed: what eomgen wrote")
    values: dict[str, Any] = value_of(Mapping[str, Any], manifest, where)
    return values


def read_rows(
    folder: Path, check: CheckRow | None = None, *, checked: bool = True, repair: bool = False
) -> dict[int, SampleRow]:
    """Read the finished samples, by index; also while others are being written.

    Args:
        check: says what is wrong with a row, "" where nothing is.
        checked: whether rows have checksums: those of format 1 have none.
        repair: cut off a last line whose writer was killed.

    Raises:
        InputError: a line is damaged or was changed; says which, and what to do.
    """
    path, rows, end = folder / ROWS, dict[int, SampleRow](), 0
    try:
        with open_regular(path, most_bytes(VARIABLE, _MOST_MB)) as stream:
            for number, line in enumerate(iter(lambda: stream.readline(_MOST_LINE + 1), b""), 1):
                if not line.endswith(b"\n") and len(line) <= _MOST_LINE:
                    break  # its writer was killed, or is at work
                row, wrong = _row(line, checked)
                wrong = wrong or (check(row) if check else "")
                if not wrong and rows.setdefault(row.index, row) != row:
                    wrong = f"sample {row.index} is there before with other numbers; allowed: each sample once"
                if wrong:
                    raise InputError(
                        f"{path}: line {number} is damaged: {wrong}; remove it, and the sample is done again"
                    )
                end += len(line)
    except FileNotFoundError:
        return rows
    except OSError as error:
        raise InputError(
            f"{path}: cannot be read: {error.strerror or error} (the environment's {VARIABLE} has the MB of the rows)"
        ) from None
    if repair and end < path.stat().st_size:
        os.truncate(path, end)
    return rows


def _check_same(folder: Path, stored: Mapping[str, Any], wanted: Mapping[str, Any]) -> None:
    for key, what in (("eomgen", "version of eomgen"), ("robot", "robot"), ("key", "plan, scenario or robot")):
        if stored.get(key) != wanted[key]:
            raise InputError(
                f"{folder}: holds a sweep of another {what} ({show(stored.get(key))[:40]}, here {wanted[key]!r:.40});"
                " allowed: the same one, to go on with it, or another folder"
            )
    if stored["format"] != FORMAT:
        raise InputError(
            f"{folder}: its rows have no checksums (format {stored['format']}); allowed: to read it, and another folder"
            " to go on in"
        )
    here = value_of(Mapping[str, Any], json.loads(json.dumps(wanted)), "sweep")
    for key in sorted({*stored, *here} - {"notes"}):
        if stored.get(key) != here.get(key):
            raise InputError(
                f"{folder / MANIFEST}: {show(key)} is not what plan, scenario and robot make of it; allowed: the same"
                " sweep, to go on with it, or another folder"
            )


def checksum(values: Mapping[str, Any]) -> str:
    """Return the hash of values that JSON holds; writing and reading them does not change it."""
    return hashlib.sha256(json.dumps(values).encode("ascii")).hexdigest()[:16]


def line_of(row: SampleRow) -> dict[str, Any]:
    """Return the values of a row's line, its checksum among them."""
    outcome: dict[str, Any] = {"error": row.error} if row.error else {"record": row.record}
    exceeded = {"exceeded": row.exceeded} if row.exceeded else {}
    body = {"index": row.index, "sample": row.sample, **outcome, **exceeded}
    return {**body, "check": checksum(body)}


def _row(line: bytes, checked: bool) -> tuple[SampleRow, str]:
    """Return the row of a line, and what is wrong with it."""
    nothing = SampleRow(-1, ())
    if len(line) > _MOST_LINE:
        return nothing, f"it has more than {_MOST_LINE} bytes; allowed: a row as eomgen writes it"
    try:
        values = parse_json(line.decode("ascii"), "row", _MOST_VALUES)
        check = values.pop("check", None) if isinstance(values, dict) else None
        if checked and (not isinstance(values, dict) or check != checksum(values)):
            return nothing, "its checksum is not that of its values; allowed: a row as it was written"
        row: SampleRow = value_of(SampleRow, values, "row")
    except UnicodeDecodeError:
        return nothing, "it is no ASCII text; allowed: a row as eomgen writes it"
    except InputError as error:
        return nothing, str(error)
    return row, ""
