"""Long work says how far it has come where stderr is no terminal; short work says nothing."""

from __future__ import annotations

import time

import pytest

from eomgen.cli.shared.progress import progress_bar, stage_bar
from eomgen.progress import told_in_lines


def test_lines_of_long_work() -> None:
    lines: list[str] = []
    with told_in_lines("sweeping", lines.append, every=0.02) as report:
        report(0.0, "building")
        deadline = time.monotonic() + 10.0
        while not lines and time.monotonic() < deadline:
            time.sleep(0.005)
        report(0.25, "sample 3")
        count = len(lines)
        while len(lines) < count + 2 and time.monotonic() < deadline:
            time.sleep(0.005)
    assert lines[0] == "sweeping: building (0 s)"
    assert lines[-1].startswith("sweeping: 25 % sample 3 (")
    count = len(lines)
    time.sleep(0.06)
    assert len(lines) == count


def test_short_work_and_errors_say_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    with progress_bar("generating") as report:
        report(0.5, "half")
    with pytest.raises(ZeroDivisionError), stage_bar("generating") as stage:
        stage(str(1 // 0))
    assert capsys.readouterr().err == ""
