"""Work that begins before its results are asked for."""

from __future__ import annotations

import threading
from pathlib import Path

import numpy as np
import pytest

import eomgen
from eomgen.errors import BuildError
from eomgen.pipeline.ahead import THREADS, Ahead
from tests.support.quick_builds import logging_compiler, script

Q = np.array([0.2, 0.5])
pytestmark = pytest.mark.usefixtures("unoptimised", "empty_cache")


def test_work_is_done_beside_the_caller() -> None:
    met = threading.Barrier(2)
    with Ahead() as ahead:
        ahead.begin(met.wait)
        met.wait()


def test_what_has_not_begun_is_left_out() -> None:
    begun, free, seen = threading.Semaphore(0), threading.Event(), list[int]()

    def hold() -> None:
        begun.release()
        free.wait()

    with Ahead() as ahead:
        ahead.begin(*[hold] * THREADS, lambda: seen.append(1))
        for _ in range(THREADS):
            begun.acquire()
        threading.Timer(0.05, free.set).start()
    assert not seen


def test_work_that_comes_while_a_thread_ends_is_done(monkeypatch: pytest.MonkeyPatch) -> None:
    work, ended, free, done = Ahead._work, threading.Event(), threading.Event(), threading.Event()

    def end_slowly(ahead: Ahead) -> None:
        work(ahead)
        ended.set()
        free.wait()

    monkeypatch.setattr(Ahead, "_work", end_slowly)
    monkeypatch.setattr("eomgen.pipeline.ahead.THREADS", 1)
    with Ahead() as ahead:
        ahead.begin(int)
        ended.wait()
        ahead.begin(done.set)
        is_done = done.wait(10)
        free.set()
    assert is_done


def test_a_function_is_built_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    compiler, log = logging_compiler(tmp_path)
    monkeypatch.setenv("CC", compiler)
    kernel = eomgen.build("one_link")
    with Ahead() as ahead:
        ahead.build(kernel, "mass_matrix")
        ahead.build(kernel, "mass_matrix", batch=True)
        kernel.mass_matrix(Q)
        kernel.mass_matrix(np.array([Q]))
    assert [log.read_text().count(f"-DEOMGEN_{half}_ONLY") for half in ("SINGLES", "BATCHES")] == [1, 1]


def test_a_failure_is_said_by_who_asks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = 'case "$*" in *SINGLES_ONLY*) echo no room on the moon; exit 3;; esac\nexec cc "$@"'
    monkeypatch.setenv("CC", script(tmp_path / "cc", text))
    kernel, done = eomgen.build("one_link"), threading.Event()
    with Ahead() as ahead:
        ahead.build(kernel, "mass_matrix")
        ahead.begin(done.set)
        assert done.wait(60)
        with pytest.raises(BuildError, match="no room on the moon"):
            kernel.mass_matrix(Q)
