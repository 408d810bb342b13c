"""The compile cache under kill -9, full disks, damage and crowds: no wrong value, no stuck lock, right at once."""

from __future__ import annotations

import errno
import json
import math
import multiprocessing
import os
import random
import shutil
import signal
import subprocess
import sys
import textwrap
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen.errors import BuildError
from eomgen.pipeline import cache
from eomgen.pipeline.cache import VARIABLE
from tests.support.quick_builds import QUICK, Q, as_new_process, logging_compiler, one_link, package_of
from tests.support.soak import WHOLE

LIMIT = 5.0  # CPU s, beyond builds, for the next call to be right
forks = pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")


def amounts(short: int, whole: int) -> list[Any]:
    return [short, pytest.param(whole, marks=pytest.mark.soak)]


def say(capsys: pytest.CaptureFixture[str], text: str) -> None:
    with capsys.disabled():
        print(f"\n{text}")


def build_in_a_group_of_its_own() -> None:
    """What a forked child does: it builds, together with its compilers in a process group that can be killed."""
    os.setsid()
    os._exit(0 if one_link().n == 2 else 1)


def fork() -> Any:
    """A process that has imported everything already."""
    process = multiprocessing.get_context("fork").Process(target=build_in_a_group_of_its_own)
    process.start()
    return process


def timed(call: Callable[[], np.ndarray]) -> tuple[np.ndarray, float]:
    """What a call returns, and the processor time of this process and its compilers for it."""
    before = sum(os.times()[:4])
    return call(), sum(os.times()[:4]) - before


def mass_matrix() -> np.ndarray:
    return np.asarray(one_link().mass_matrix(Q))


@pytest.fixture(autouse=True)
def locks(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """No lock that a process left keeps this one waiting until its patience ends."""
    found: list[bool] = []

    @contextmanager
    def locked(*key: Any) -> Iterator[bool]:
        with _locked(*key) as held:
            found.append(held)
            yield held

    _locked = cache._locked
    monkeypatch.setattr(cache, "_locked", locked)
    yield
    assert all(found)


@pytest.fixture
def expected(empty_cache: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[np.ndarray, float]:
    """The right value, and the processor time of a build of everything."""
    mass_matrix()  # imports
    shutil.rmtree(empty_cache)
    as_new_process(monkeypatch)
    return timed(mass_matrix)


@pytest.mark.soak
@forks
@pytest.mark.parametrize("count", amounts(6, 500 if WHOLE else 150))
def test_killed_builds(
    count: int,
    empty_cache: Path,
    expected: tuple[np.ndarray, float],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """kill -9 of a build and its compilers at a random moment, two builds at a time; every pair by another call."""
    right, build = expected
    rng, slowest, cut, pace = random.Random(count), 0.0, 0, build
    for _ in range(count // 2):
        shutil.rmtree(empty_cache / "packages", ignore_errors=True)
        if rng.random() < 0.4:
            shutil.rmtree(empty_cache / "sources", ignore_errors=True)
        processes = [fork() for _ in range(2)]
        for process in processes:
            time.sleep(rng.uniform(0.0, 0.6 * pace))
            alive = process.is_alive()
            cut += alive
            pace *= 1.05 if alive else 0.8  # as long as a build takes while the machine is as busy as it is
            try:
                os.killpg(process.pid, signal.SIGKILL)
            except ProcessLookupError:  # not yet a group of its own, or at its end
                process.kill()
            process.join()
        as_new_process(monkeypatch)
        found, seconds = timed(mass_matrix)
        assert np.array_equal(found, right)
        slowest = max(slowest, seconds)
        assert seconds < LIMIT + 3.0 * build, seconds
    assert cut > count / 4
    left = [path.name for path in empty_cache.iterdir() if path.name.startswith(cache.PASSING)]
    assert len(left) <= 4 + count // 20, left
    cache.clear()
    left = {path.name for path in empty_cache.iterdir()} - {
        "derivations",
        "extensions",
    }  # where this process has not made them
    assert left == {"locks", "packages", "sources"}
    if count > 100:
        say(capsys, f"{count} kills, {cut} in the middle; then {slowest:.2f} CPU s at most, for a build {build:.2f}")


def damage(path: Path, rng: random.Random) -> str:
    how = rng.choice(["bit", "bit", "truncated", "empty", "gone"])
    if how == "bit":
        data = bytearray(path.read_bytes())
        data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
        path.write_bytes(data)
    elif how == "truncated":
        path.write_bytes(path.read_bytes()[: rng.randrange(path.stat().st_size)])
    elif how == "empty":
        path.write_bytes(b"")
    else:
        path.unlink()
    return how


@pytest.mark.soak
@pytest.mark.parametrize("count", amounts(5, 200))
def test_damaged_files(
    count: int,
    empty_cache: Path,
    expected: tuple[np.ndarray, float],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Any file of any entry that a build reads again; every damage is noticed, and the entry made again."""
    right, build = expected
    rng, slowest, seen = random.Random(count), 0.0, dict[str, int]()
    for _ in range(count):
        entries = (path for kind in ("sources", "packages") for path in (empty_cache / kind).glob("*/*"))
        path = rng.choice(sorted(path for path in entries if path.is_file()))
        how = damage(path, rng)
        seen[how] = seen.get(how, 0) + 1
        assert not cache.is_whole(path.parent), (path, how)
        as_new_process(monkeypatch)
        found, seconds = timed(mass_matrix)
        assert np.array_equal(found, right)
        assert cache.is_whole(path.parent)
        slowest = max(slowest, seconds)
        assert seconds < LIMIT + 3.0 * build, (path, how, seconds)
    if count > 100:
        say(capsys, f"{count} damaged files {seen}: all noticed; the call after: {slowest:.2f} s at most")


def crowd(start: Any, answers: Any) -> None:
    start.wait()
    try:
        answers.put(one_link().mass_matrix(Q).tolist())
    except BaseException as error:
        answers.put(repr(error))


@pytest.mark.soak
@forks
@pytest.mark.parametrize("count", amounts(1, 50))
def test_sixteen_processes_want_the_same_kernel(
    count: int,
    empty_cache: Path,
    expected: tuple[np.ndarray, float],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """One build each round: three compilations and a link; all sixteen get it."""
    compiler, log = logging_compiler(tmp_path)
    monkeypatch.setenv("CC", compiler)
    context, began = multiprocessing.get_context("fork"), time.perf_counter()
    for number in range(count):
        shutil.rmtree(empty_cache / "packages", ignore_errors=True)
        if number % 5 == 0:
            shutil.rmtree(empty_cache, ignore_errors=True)
        log.write_text("")
        as_new_process(monkeypatch)
        start, answers = context.Event(), context.Queue()
        processes = [context.Process(target=crowd, args=(start, answers)) for _ in range(16)]
        for process in processes:
            process.start()
        start.set()
        for process in processes:
            process.join()
            assert process.exitcode == 0
        found = [answers.get() for _ in processes]
        assert found == [expected[0].tolist()] * 16
        assert len(log.read_text().splitlines()) == 4
    if count > 10:
        say(capsys, f"{count} rounds of 16 processes: one build each, {time.perf_counter() - began:.0f} s")


def attempt(build: Callable[[], Any]) -> tuple[Any, str]:
    """What it gives, or None and why not."""
    try:
        return build(), ""
    except BuildError as error:
        return None, str(error)


@pytest.fixture
def small_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A tmpfs of 8 MB as the cache, and for the compiler's files; libraries that are loaded keep their room there."""
    folder = tmp_path / "disk"
    folder.mkdir()
    mount = shutil.which("mount")
    command = [mount or "mount", "-t", "tmpfs", "-o", "size=8m,mode=700", "tmpfs", str(folder)]
    if mount is None or os.name != "posix" or subprocess.run(command, capture_output=True, check=False).returncode:
        pytest.skip("a small disk takes a mount of tmpfs, and that takes root")
    try:
        monkeypatch.setenv(VARIABLE, str(folder / "cache"))
        (folder / "tmp").mkdir()
        yield folder
    finally:
        subprocess.run(["umount", "-l", str(folder)], check=False)


@pytest.mark.soak
@pytest.mark.parametrize("where", ["cache", "cache and temporary files"])
def test_full_disks(
    where: str, small_disk: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Room for a random part of a build: the error that says so, or a kernel that is right; with room again, right."""
    if where != "cache":
        monkeypatch.setenv("TMPDIR", str(small_disk / "tmp"))
    mass_matrix()
    as_new_process(monkeypatch)
    shutil.rmtree(small_disk / "cache")
    empty = shutil.disk_usage(small_disk).free
    right, build = timed(mass_matrix)
    most = math.log10(4.0 * (empty - shutil.disk_usage(small_disk).free))  # while it builds it takes more than is left
    rng, slowest, failed = random.Random(where), 0.0, 0
    for _ in range(50):
        as_new_process(monkeypatch)
        shutil.rmtree(small_disk / "cache")
        ballast, free = small_disk / "ballast", shutil.disk_usage(small_disk).free
        with ballast.open("wb") as stream:
            stream.write(b"x" * max(0, free - int(10 ** rng.uniform(3.0, most))))
        found, said = attempt(mass_matrix)
        failed += found is None
        assert "disk" in said if found is None else np.array_equal(found, right)
        ballast.unlink()
        as_new_process(monkeypatch)
        found, seconds = timed(mass_matrix)
        assert np.array_equal(found, right)
        slowest = max(slowest, seconds)
        assert seconds < LIMIT + 3.0 * build, seconds
        assert not [path for path in (small_disk / "cache").iterdir() if path.name.startswith(cache.PASSING)]
    assert 10 < failed < 50
    say(capsys, f"50 full disks ({where}): {failed} builds failed and said so; then right in {slowest:.2f} s at most")


LIMITED = """
    import json, resource, sys, eomgen
    from eomgen.errors import BuildError
    resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[1]), resource.RLIM_INFINITY))
    try:
        kernel = eomgen.build(eomgen.load_robot("one_link"), kernels=("mass_matrix",), flags=("-O0",))
        print(json.dumps(kernel.mass_matrix([0.2, 0.5]).tolist()))
    except BuildError as error:
        print(json.dumps(str(error)))
"""


@pytest.mark.skipif(os.name != "posix", reason="limits of file sizes as POSIX has them")
@pytest.mark.parametrize("size", [500, pytest.param(15000, marks=pytest.mark.soak)])
def test_no_room_for_a_build(size: int, empty_cache: Path) -> None:
    """The same without a small disk: files may not grow beyond a size, of Python's and of the compiler's."""
    found = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(LIMITED), str(size)], capture_output=True, text=True, check=False
    )
    assert found.returncode == 0, found.stderr
    said = json.loads(found.stdout)
    assert isinstance(said, str), said
    assert "disk" in said
    assert mass_matrix().shape == (2, 2)
    left = {path.name for path in empty_cache.iterdir()} - {
        "derivations",
        "extensions",
    }  # where this process has not made them
    assert left == {"locks", "packages", "sources"}


def test_every_write_that_fails_is_reported(empty_cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A disk that is full at the first, second, ... file that Python writes into the cache."""
    count = 0

    def until(limit: int, write: Any) -> Any:
        def counted(path: Path, *arguments: Any, **named: Any) -> int:
            nonlocal count
            count += 1
            if count > limit:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            return write(path, *arguments, **named)

        return counted

    robot, failures = eomgen.load_robot("one_link"), 0
    for limit in range(50):
        count = 0
        with monkeypatch.context() as patch:
            for name in ("write_text", "write_bytes"):
                patch.setattr(Path, name, until(limit, getattr(Path, name)))
            package, said = attempt(lambda: package_of(robot, QUICK))
        if package is not None:
            break
        failures += 1
        assert "No space left on device" in said
        assert not [path for path in empty_cache.iterdir() if path.name.startswith(cache.PASSING)]
        assert not any(cache.is_whole(path) for path in (empty_cache / "packages").glob("*"))
    assert failures > 5
    assert mass_matrix().shape == (2, 2)
