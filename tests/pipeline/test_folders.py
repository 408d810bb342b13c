"""Folders that are replaced in one step; headers, reports and cached facts of the derivation."""

from __future__ import annotations

import errno
import os
import sys
import textwrap
import time
from dataclasses import replace
from pathlib import Path
from subprocess import PIPE, Popen

import pytest

import eomgen
from eomgen.cli.entry import main
from eomgen.codegen.joint import deriving
from eomgen.errors import InputError, InternalError
from eomgen.pipeline import cache, folders
from eomgen.pipeline.derivations import derived_model
from eomgen.pipeline.folders import new_folder, put_folder
from eomgen.pipeline.generating import generate
from eomgen.pipeline.options import Options
from eomgen.pipeline.stages import make_source
from tests.support.quick_builds import ONE_LEVEL, flip
from tests.support.refusals import refused

REPLACING = """
    import sys
    from pathlib import Path
    from eomgen.pipeline.folders import new_folder, put_folder
    target, who = Path(sys.argv[1]), sys.argv[2]
    print("ready", flush=True)
    sys.stdin.readline()
    for turn in range(int(sys.argv[3])):
        with new_folder(target) as private:
            for name in ("one", "two"):
                (private / name).write_text(f"{who} {turn}")
            put_folder(private, target, lambda place: None)
"""


def start_writers(target: Path, count: int, turns: int) -> list[Popen[str]]:
    """Writers of a folder with the files "one" and "two", which say the same; they wait until ``release``."""
    code = textwrap.dedent(REPLACING)
    arguments = ([sys.executable, "-c", code, str(target), str(who), str(turns)] for who in range(count))
    writers = [Popen(words, stdin=PIPE, stdout=PIPE, stderr=PIPE, text=True) for words in arguments]
    for writer in writers:
        assert writer.stdout.readline() == "ready\n"
    return writers


def release(writers: list[Popen[str]]) -> None:
    for writer in writers:
        writer.stdin.write("\n")
        writer.stdin.flush()


pytestmark = pytest.mark.quick


def put(target: Path, text: str) -> None:
    with new_folder(target) as private:
        for name in ("one", "two"):
            (private / name).write_text(text, encoding="ascii")
        put_folder(private, target, lambda place: None)


def test_what_is_replaced(tmp_path: Path) -> None:
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


def test_what_must_not_be_replaced_stays(tmp_path: Path) -> None:
    target = tmp_path / "arm"
    put(target, "old")

    def check(place: Path) -> None:
        raise InputError("not yours")

    with new_folder(target) as private, pytest.raises(InputError, match="not yours"):
        put_folder(private, target, check)
    assert (target / "one").read_text() == "old"
    assert [path.name for path in tmp_path.iterdir() if path.name != "cache"] == ["arm"]


def test_a_move_that_fails_loses_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    target = tmp_path / "arm"
    put(target, "old")
    rename = os.rename

    def refuse(one: Path, other: Path) -> None:
        if Path(other) == target and not Path(one).name.endswith("-replaced"):
            raise OSError(errno.EIO, "no")
        rename(one, other)

    monkeypatch.setattr(os, "rename", refuse)
    refused(OSError, "no", put, target, "new")
    assert (target / "one").read_text() == "old"


def test_several_writers(tmp_path: Path) -> None:
    """None fails, and the folder is that of one of them."""
    target = tmp_path / "arm"
    put(target, "old")
    writers = start_writers(target, 4, 40)
    release(writers)
    assert [(writer.wait(), writer.communicate()[1]) for writer in writers] == [(0, "")] * 4
    assert (target / "one").read_text() == (target / "two").read_text()
    assert [path.name for path in tmp_path.iterdir()] == ["arm"]


def test_what_a_killed_writer_left_is_removed_after_a_day(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    target = tmp_path / "arm"
    left = target.with_name(".arm-making-x")
    (left / "inner").mkdir(parents=True)
    os.utime(left, (0.0, 0.0))
    put(target, "new")
    assert left.exists(), "it was moved there just now, however old it is"
    now = time.time()
    monkeypatch.setattr(folders.time, "time", lambda: now + 90000.0)
    put(target, "new")
    assert [path.name for path in tmp_path.iterdir()] == ["arm"]


def test_a_package_is_generated_over_another_one(tmp_path: Path) -> None:
    robot = eomgen.load_robot("one_link")
    target = generate(robot, tmp_path, ONE_LEVEL)
    before = target.stat().st_ino
    assert generate(robot, tmp_path, ONE_LEVEL) == target
    assert target.stat().st_ino != before
    assert [path.name for path in tmp_path.iterdir()] == ["one_link"]


@pytest.mark.soak
def test_many_writers_and_kills(tmp_path: Path) -> None:
    """Killed at any moment they leave an old folder, a new one or none, never parts of two."""
    target = tmp_path / "arm"
    for turn in range(10):
        put(target, "old")
        writers = start_writers(target, 8, 1_000_000)
        release(writers)
        time.sleep(0.5 + 0.1 * turn)
        for writer in writers:
            assert writer.poll() is None
            writer.kill()
            writer.communicate()
        texts = {(target / name).read_text() for name in ("one", "two")} if target.exists() else {"none"}
        assert len(texts) == 1


OPTIONS = Options(("mass_matrix",), flags=("-O0",), levels=("v1",))


def test_the_header_says_what_was_derived(tmp_path: Path) -> None:
    """Its comment alone is longer than that of the source, and the C is as it was."""
    robot = eomgen.load_robot("one_link")
    made, source = generate(robot, tmp_path, OPTIONS), make_source(robot, OPTIONS)
    text = (made / "one_link.h").read_text(encoding="ascii")
    assert "derived A_(i-1)i of eq. (3)" in text
    assert "2  sharper lemma" in text
    assert text.split("\n */\n")[1:] == source.header.split("\n */\n")[1:]
    assert text.startswith(source.header.split("\n */\n")[0])
    assert all(len(line) <= 120 for line in text.splitlines())
    assert {file: (made / file).read_text(encoding="ascii") for file in source.codes} == source.codes


@pytest.fixture
def empty_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("EOMGEN_CACHE_DIR", str(tmp_path / "cache"))


@pytest.mark.usefixtures("empty_cache")
def test_facts_are_derived_once_for_a_kind_of_joint(monkeypatch: pytest.MonkeyPatch) -> None:
    """Another robot with joints of the same coordinates is derived from the same entries."""
    facts = derived_model(eomgen.load_robot("one_link")).facts
    assert [kind for kind, _, _ in cache.contents()] == ["derivations"]
    assert facts == {("x", "gamma"): deriving.derive_joint(("x", "gamma"))}
    monkeypatch.setattr(deriving, "derive_joint", None)
    assert derived_model(replace(eomgen.load_robot("one_link"), name="another")).facts == facts


@pytest.mark.usefixtures("empty_cache")
def test_damaged_facts_are_derived_again() -> None:
    facts = derived_model(eomgen.load_robot("one_link")).facts
    (entry,) = (cache.cache_folder() / "derivations").iterdir()
    flip(entry / "facts.json")
    assert not cache.is_whole(entry)
    assert derived_model(replace(eomgen.load_robot("one_link"), name="another")).facts == facts
    assert cache.is_whole(entry)


@pytest.mark.usefixtures("empty_cache")
def test_nothing_is_written_where_a_proof_fails(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(active: tuple[str, ...]) -> None:
        raise InternalError("the proof failed")

    monkeypatch.setattr(deriving, "derive_joint", fail)
    with pytest.raises(InternalError, match="the proof failed"):
        generate("one_link", tmp_path / "out", OPTIONS, report=tmp_path / "derivation.html")
    assert not [kind for kind, _, _ in cache.contents() if kind in ("derivations", "sources")]
    assert [path.name for path in tmp_path.iterdir()] == ["cache"]


@pytest.mark.parametrize("ending", [".html", ".tex"])
def test_the_report_of_the_command(ending: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    page = tmp_path / f"derivation{ending}"
    command = ["generate", "one_link", "-o", str(tmp_path), "--kernels", "mass_matrix", "--levels", "v1"]
    assert main([*command, "--report", str(page)]) == 0
    assert f"wrote {page}" in capsys.readouterr().out
    assert "sharper lemma" in page.read_text(encoding="ascii")


def test_joints_of_robots_with_flexible_links_are_derived(tmp_path: Path) -> None:
    """Header and report say so, and name the lemmas of modes."""
    page = tmp_path / "derivation.html"
    text = (generate("flexible_arm", tmp_path, OPTIONS, report=page) / "flexible_arm.h").read_text(encoding="ascii")
    for found in (text, page.read_text(encoding="ascii")):
        assert "derived A_(i-1)i of eq. (3)" in found
        assert "lemmas of modes: those of docs/theory.md" in found


def test_refused_before_anything_is_derived(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(InputError, match=r"report: .*allowed: .*\.html, \.tex"):
        generate("one_link", tmp_path, OPTIONS, report="derivation.pdf")
    assert main(["generate", "one_link", "--wheel", "--report", "x.html"]) == 1
    assert "--report" in capsys.readouterr().err
