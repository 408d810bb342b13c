"""The folder of a sweep: what was done is only ever appended to, so that it survives its writer's end.

sweep.json says what is swept (its hash is checked on resumption); samples.jsonl has a line for every sample that is
done, in the order of completion; a last line without an end is of a writer that was killed, and is cut off.
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from ..errors import InputError
from ..files import write_atomically
from .job import SampleRow

MANIFEST, ROWS, LOCK = "sweep.json", "samples.jsonl", ".lock"
FORMAT = 1
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
        lines = "".join(json.dumps(_line(row)) + "\n" for row in rows)
        try:
            rest = memoryview(lines.encode("ascii"))
            while rest:  # a disk that fills up takes a part, and says so when it is given the rest
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
        """Nothing more comes."""
        self.sync()
        self._file.close()


@contextmanager
def opened(folder: Path, manifest: Mapping[str, Any]) -> Iterator[SweepStore]:
    """The folder of a sweep, new or resumed.

    Args:
        folder: new, empty, or of the same sweep.
        manifest: values that JSON holds, among them "key" and "eomgen", which must be those of what is resumed.

    Raises:
        InputError: something else is in the folder, another process writes to it, or it cannot be written.
    """
    from filelock import FileLock, Timeout

    try:
        folder.mkdir(parents=True, exist_ok=True)
        resumed = (folder / MANIFEST).exists()
        if not resumed and any(path.name != LOCK for path in folder.iterdir()):
            raise InputError(f"{folder}: is not empty and holds no sweep; allowed: a new folder, or that of this sweep")
        lock = FileLock(str(folder / LOCK))
        try:
            lock.acquire(timeout=0)
        except Timeout:
            raise InputError(f"{folder}: another process is at work on this sweep; wait for it, or end it") from None
        try:
            if resumed:
                _check_same(folder, read_manifest(folder), manifest)
            else:
                text = json.dumps({"format": FORMAT, **manifest}, indent=1)
                write_atomically(folder / MANIFEST, lambda stream: stream.write(text.encode()))
            store = SweepStore(folder, _read_rows(folder, repair=True), resumed)
            try:
                yield store
            finally:
                store.close()
        finally:
            lock.release()
    except OSError as error:
        raise InputError(f"{folder}: cannot be written: {error.strerror or error}") from None


def read_manifest(folder: Path) -> dict[str, Any]:
    """Read what a folder's sweep is; InputError where there is none."""
    try:
        found: dict[str, Any] = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
        if found["format"] > FORMAT:
            raise InputError(f"{folder}: written by a newer eomgen than this one")
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(f"{folder}: holds no sweep ({error})") from None
    return found


def read_rows(folder: Path) -> dict[int, SampleRow]:
    """The samples that are done, by index; also while others are being written."""
    return _read_rows(folder, repair=False)


def _check_same(folder: Path, found: Mapping[str, Any], wanted: Mapping[str, Any]) -> None:
    for key, what in (("eomgen", "version of eomgen"), ("robot", "robot"), ("key", "plan, scenario or robot")):
        if found.get(key) != wanted[key]:
            raise InputError(
                f"{folder}: holds a sweep of another {what} ({found.get(key)!r:.40}, here {wanted[key]!r:.40});"
                " allowed: the same one, to go on with it, or another folder"
            )


def _line(row: SampleRow) -> dict[str, Any]:
    body: dict[str, Any] = {"error": row.error} if row.error else {"record": row.record}
    return {"index": row.index, "sample": row.sample, **body}


def _read_rows(folder: Path, *, repair: bool) -> dict[int, SampleRow]:
    path, rows = folder / ROWS, dict[int, SampleRow]()
    if not path.exists():
        return rows
    data = path.read_bytes()
    whole = data[: data.rfind(b"\n") + 1]
    for number, line in enumerate(whole.splitlines(), 1):
        try:
            item = json.loads(line)
            row = SampleRow(item["index"], tuple(item["sample"]), tuple(item.get("record", ())), item.get("error", ""))
        except (ValueError, KeyError, TypeError):
            raise InputError(f"{path}: line {number} is damaged; remove it, and the sample is done again") from None
        rows[row.index] = row
    if repair and len(whole) < len(data):
        with path.open("r+b") as stream:
            stream.truncate(len(whole))
    return rows
