"""Compilers: the binary of a command, and commands that are terminated with the calling process."""

from __future__ import annotations

import atexit
import os
import shlex
import shutil
import signal
import subprocess
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass

from eomgen.errors import BuildError
from eomgen.threads import check_not_ending

PATIENCE = 2.0  # s for a terminated compiler to remove its temporary files


@dataclass(frozen=True)
class Compiler:
    """A C compiler: the command, what it says of its version, and what $CFLAGS and $LDFLAGS add to our flags."""

    command: tuple[str, ...]
    version: str
    flags: tuple[str, ...] = ()
    link_flags: tuple[str, ...] = ()


def identity(command: str) -> tuple[str, int, int]:
    """Return the path of a command's binary, its size in bytes and the time of its last change, ns."""
    path = os.path.realpath(shutil.which(command) or command)
    try:
        status = os.stat(path)
    except OSError:  # asking it for its version says why
        return path, 0, 0
    return path, status.st_size, status.st_mtime_ns


def run_all(commands: Sequence[Sequence[str]]) -> None:
    """Run compiler commands in parallel and report the output of the first that fails.

    All commands are terminated after an exception such as KeyboardInterrupt, and when Python exits, also if the caller
    is a daemon thread.

    Raises:
        BuildError: a command cannot be run, fails, or does not write its output file (``-o``); or Python is exiting.
    """
    check_not_ending()
    running: list[subprocess.Popen[str]] = []

    def end_all() -> None:
        for process in running:
            _end(process)

    atexit.register(end_all)
    try:
        for command in commands:
            running.append(_start(command))
        said = [process.communicate()[0] for process in running]
    finally:
        end_all()
        atexit.unregister(end_all)
        for process in running:
            with process:  # closes its pipe
                pass
    for command, process, text in zip(commands, running, said, strict=True):
        if process.returncode != 0:
            what = f"the C compiler failed with status {process.returncode}"
        elif not os.path.isfile(command[command.index("-o") + 1]):
            what = f"the C compiler wrote no {'object' if '-c' in command else 'library'}"
        else:
            continue
        raise BuildError(
            f"{what}:\n  {shlex.join(command)}\n{text.strip()[:4000]}\n"
            "check that the compiler works (CC names another one), that the disk is not full, and that flags are right"
        )


def _start(command: Sequence[str]) -> subprocess.Popen[str]:
    """Start a command in a process group of its own, because compiler drivers start child processes."""
    try:
        return subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            encoding="utf-8",
            errors="backslashreplace",  # the output may have any encoding
            process_group=0 if os.name == "posix" else None,
        )
    except OSError as error:
        raise BuildError(f"the C compiler does not run: {shlex.join(command)}: {error}") from None


def _end(process: subprocess.Popen[str]) -> None:
    """Terminate a running command and its child processes."""
    if process.poll() is not None:
        return
    _send(process, signal.SIGTERM)
    try:
        process.wait(PATIENCE)
    except subprocess.TimeoutExpired:
        _send(process, signal.SIGKILL if os.name == "posix" else signal.SIGTERM)
        process.wait()


def _send(process: subprocess.Popen[str], number: signal.Signals) -> None:
    with suppress(OSError):  # the process has just ended
        if os.name == "posix":
            os.killpg(process.pid, number)
        else:
            process.send_signal(number)
