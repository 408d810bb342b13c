"""Folders that are replaced in one step: several writers, readers beside them, writers that are killed."""

from __future__ import annotations

import errno
import os
import signal
import time
from pathlib import Path

import pytest

import eomgen
from eomgen.errors import InputError
from eomgen.pipeline import folders
from eomgen.pipeline.folders import exchange, new_folder, put_folder
from eomgen.pipeline.stages import generate
from tests.support.quick_builds import ONE_LEVEL
from tests.support.writers import look_until_done, release, start_writers

pytestmark = pytest.mark.quick


def put(target: Path, text: str) -> None:
    with new_folder(target) as private:
        for name in ("one", "two"):
            (private / name).write_text(text, encoding="ascii")
        put_folder(private, target, lambda place: None)


def has_exchange(folder: Path) -> bool:
    one, other = folder / "a", folder / "b"
    one.mkdir()
    other.mkdir()
    found = exchange(one, other)
    one.rmdir()
    other.rmdir()
    return found


@pytest.fixture(params=["exchange", "turns"])
def way(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch, empty_cache: Path) -> str:
    """With the system's exchange, and as it is where there is none."""
    if request.param == "turns":
        monkeypatch.setattr(folders, "exchange", lambda one, other: False)
    return str(request.param)


def test_what_is_replaced(way: str, tmp_path: Path) -> None:
    """Nothing, an empty folder, a full one, a link to a folder; nothing else is left beside it."""
    place = tmp_path / "place"
    target, other = place / "arm", tmp_path / "other"
    place.mkdir()
    put(target, "first")
    put(target, "second")
    assert (target / "one").read_text() == "second"
    other.mkdir()
    (other / "mine").write_text("kept")
    folders.shutil.rmtree(target)
    target.symlink_to(other)
    put(target, "third")
    assert not target.is_symlink()
    assert (target / "two").read_text() == "third"
    assert (other / "mine").read_text() == "kept"
    (tmp_path / "empty").mkdir()
    put(tmp_path / "empty", "fourth")
    assert [path.name for path in place.iterdir()] == ["arm"]


def test_what_must_not_be_replaced_stays(way: str, tmp_path: Path) -> None:
    """Also what somebody puts there after the first look."""
    target = tmp_path / "arm"
    put(target, "old")
    looks = []

    def check(place: Path) -> None:
        looks.append(place)
        if len(looks) == 2:
            raise InputError("not yours")

    with new_folder(target) as private, pytest.raises(InputError, match="not yours"):
        put_folder(private, target, check)
    assert (target / "one").read_text() == "old"
    assert [path.name for path in tmp_path.iterdir() if path.name != "cache"] == ["arm"]


def test_a_move_that_fails_loses_nothing(way: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    target = tmp_path / "arm"
    put(target, "old")
    rename = os.rename

    def refuse(one: Path, other: Path) -> None:
        if Path(other) == target and "making" in Path(one).name and not Path(one).name.endswith("-replaced"):
            raise OSError(errno.ENOTEMPTY if (target / "one").exists() else errno.EIO, "no")
        rename(one, other)

    def fail(one: Path, other: Path) -> bool:
        raise OSError(errno.EIO, "no")

    monkeypatch.setattr(os, "rename", refuse)
    if way == "exchange":
        monkeypatch.setattr(folders, "exchange", fail)
    with pytest.raises(OSError, match="no"):
        put(target, "new")
    assert (target / "one").read_text() == "old"


def test_several_writers_and_a_reader(tmp_path: Path) -> None:
    """None fails, and a reader finds it at every look."""
    if not has_exchange(tmp_path):
        pytest.skip("this file system cannot exchange folders")
    target = tmp_path / "arm"
    put(target, "old")
    writers = start_writers(target, 4, 40)
    release(writers)
    assert look_until_done(target, writers) > 0
    assert [(writer.wait(), writer.communicate()[1]) for writer in writers] == [(0, "")] * 4
    assert (target / "one").read_text() == (target / "two").read_text()
    assert [path.name for path in tmp_path.iterdir()] == ["arm"]


def test_a_writer_that_is_killed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It leaves an old or a new folder, and its own is swept up after a day."""
    if not has_exchange(tmp_path):
        pytest.skip("this file system cannot exchange folders")
    target = tmp_path / "arm"
    put(target, "old")
    for _ in range(3):
        (writer,) = start_writers(target, 1, 1_000_000)
        release([writer])
        while (target / "one").read_text() == "old":
            time.sleep(0.001)
        writer.send_signal(signal.SIGKILL)
        writer.communicate()
        assert (target / "one").read_text() == (target / "two").read_text()
        put(target, "old")
    left = target.with_name(".arm-making-x")
    (left / "inner").mkdir(parents=True)
    os.utime(left, (0.0, 0.0))
    put(target, "new")
    assert left.exists(), "it was moved there just now, however old it is"
    now = time.time()
    monkeypatch.setattr(folders.time, "time", lambda: now + 90000.0)
    put(target, "new")
    assert [path.name for path in tmp_path.iterdir()] == ["arm"]


def test_a_package_is_generated_over_another_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In one exchange: nobody finds the target missing."""
    if not has_exchange(tmp_path):
        pytest.skip("this file system cannot exchange folders")
    robot, seen = eomgen.load_robot("one_link"), []
    target = generate(robot, tmp_path, ONE_LEVEL)
    before = target.stat().st_ino
    monkeypatch.setattr(folders, "_take_turns", lambda *args: seen.append(args))
    assert generate(robot, tmp_path, ONE_LEVEL) == target
    assert not seen
    assert target.stat().st_ino != before
    assert [path.name for path in tmp_path.iterdir()] == ["one_link"]


@pytest.mark.soak
def test_many_writers_and_kills(tmp_path: Path) -> None:
    """The long form: eight writers, readers, and kills at any moment."""
    target = tmp_path / "arm"
    put(target, "old")
    for turn in range(10):
        writers = start_writers(target, 8, 1_000_000)
        release(writers)
        until, looks = time.monotonic() + 0.5 + 0.1 * turn, 0
        while time.monotonic() < until:
            assert (target / "one").read_text()
            assert (target / "two").read_text()
            looks += 1
        for writer in writers:
            assert writer.poll() is None
            writer.kill()
            writer.communicate()
        assert (target / "one").read_text() == (target / "two").read_text()
        assert looks > 0
