"""Commands of eomgen, run in this process."""

from __future__ import annotations

import contextlib
import io
import json
from typing import Any

from eomgen.cli import main


def run(*words: object) -> tuple[int, str, str]:
    """Run a command; return its exit status, what it prints, and its errors."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            status = main([str(word) for word in words])
        except SystemExit as stop:  # of the parser
            status = int(stop.code or 0)
    return status, out.getvalue(), err.getvalue()


def command(*words: object, code: int = 0) -> str:
    """Run a command that ends with this exit status; return what it prints, or its errors where the status is not 0."""
    status, out, err = run(*words)
    assert status == code, f"{status}: {out}{err}"
    return err if code else out


def facts(*words: object) -> Any:
    """Run a command with --json; return what it prints."""
    return json.loads(command(*words, "--json"))


def errors_of(*words: object) -> str:
    """Run a command that is refused before it has printed anything; return its errors."""
    status, out, err = run(*words)
    assert (status, out) == (1, "")
    return err
