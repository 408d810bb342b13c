"""Fuzzing of the surfaces in ``surfaces.SURFACES``: each file is read or refused within limits of time and memory.

    python -m tests.support.fuzzing NAME... FIRST COUNT

prints a line of JSON by the name of each surface: how many files of these seeds were accepted, the slowest one in
seconds of processor time, the time of all, and the memory used, MB. A file that is not handled is an AssertionError
that names its seed.
"""

from __future__ import annotations

import json
import resource
import signal
import subprocess
import sys
import tempfile
import time
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any

from eomgen.errors import DescriptionError, EomgenWarning, InputError, UnknownNameError

if TYPE_CHECKING:
    from tests.support.surfaces import Surface

ROOT = Path(__file__).parents[2]
LENGTH = 900  # of a message


class TooSlowError(Exception):
    """A file took more processor time than its surface allows."""


def check_message(error: InputError, most: int = LENGTH) -> None:
    """Check that a refusal is one printable line of ASCII that says what is allowed."""
    message = str(error)
    assert message.isascii(), message
    assert message.isprintable(), repr(message)
    assert len(message) < most, message
    known = "known" if isinstance(error, UnknownNameError) else "allowed"
    assert isinstance(error, DescriptionError) or known in message or "allowed" in message, message
    assert error.__cause__ is None


def accepted(surface: Surface, path: Path) -> Any:
    """Return what a file is, or None where it is refused; any other exception or a poor message is an error."""
    try:
        return surface.read(path)
    except InputError as error:
        refused = error
    check_message(refused)
    assert not surface.has_line or (isinstance(refused, DescriptionError) and refused.line is not None), refused
    return None


def late(*_: object) -> None:
    raise TooSlowError


def limit_memory(megabytes: int) -> None:
    """Allow this process so many MB of addresses more than it has now; one that it starts may allow itself others."""
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    most = pages * resource.getpagesize() + megabytes * 2**20
    resource.setrlimit(resource.RLIMIT_AS, (most, resource.getrlimit(resource.RLIMIT_AS)[1]))


def strict() -> None:
    """Make all warnings but those of eomgen errors, and end what takes longer than a timer."""
    warnings.simplefilter("error")
    warnings.simplefilter("ignore", EomgenWarning)
    signal.signal(signal.SIGPROF, late)


def run(surface: Surface, folder: Path, first: int, count: int) -> dict[str, Any]:
    """Return counts and times of files of these seeds; raises AssertionError for one that is not handled."""
    strict()
    found, slowest, began = 0, 0.0, time.process_time()
    for seed in range(first, first + count):
        path = surface.write(folder, seed)
        start = time.process_time()
        signal.setitimer(signal.ITIMER_PROF, surface.seconds)
        try:
            found += accepted(surface, path) is not None
        except BaseException as error:
            signal.setitimer(signal.ITIMER_PROF, 0)
            content = path.read_bytes()[:3000] if path.is_file() else ""
            raise AssertionError(f"{surface.name} {seed}: {content!r}") from error
        finally:
            signal.setitimer(signal.ITIMER_PROF, 0)
        slowest = max(slowest, time.process_time() - start)
    assert slowest < surface.seconds
    if count >= 50 and surface.most:  # neither noise nor always the same
        assert count / 50 < found < surface.most * count, f"{surface.name}: {found} of {count} files are accepted"
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024
    return {"accepted": found, "slowest": slowest, "peak": peak, "seconds": time.process_time() - began}


def fuzzed(*names: str, first: int, count: int) -> dict[str, dict[str, Any]]:
    """Return what a process of its own finds, by surface; ``count`` 0 is that of each surface for quick tests."""
    command = [sys.executable, "-m", "tests.support.fuzzing", *names, str(first), str(count)]
    found = subprocess.run(command, capture_output=True, text=True, cwd=ROOT)
    assert found.returncode == 0, found.stderr[-6000:]
    reports: dict[str, dict[str, Any]] = json.loads(found.stdout)
    assert reports.keys() == set(names)
    return reports


def main(names: list[str], first: int, count: int) -> None:
    from tests.support.surfaces import SURFACES

    with tempfile.TemporaryDirectory() as folder:
        for name in names:  # what is imported or made on first use is no part of a file's memory
            run(SURFACES[name], Path(folder), first, 1)
        limit_memory(max(SURFACES[name].megabytes for name in names))
        reports = {name: run(SURFACES[name], Path(folder), first, count or SURFACES[name].few) for name in names}
    print(json.dumps(reports))


if __name__ == "__main__":
    *surfaces, start, number = sys.argv[1:]
    main(surfaces, int(start), int(number))
