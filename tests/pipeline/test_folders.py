"""What is written: folders that are replaced in one step, nothing where a derivation beside the compiler differs."""

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
from eomgen.codegen.derivation import fresh
from eomgen.codegen.joint.kept import KEPT
from eomgen.errors import DerivationError, InputError
from eomgen.pipeline import folders, generating
from eomgen.pipeline.folders import new_folder, put_folder
from eomgen.pipeline.generating import generate
from eomgen.pipeline.options import Options
from eomgen.pipeline.stages import make_source
from tests.support.quick_builds import ONE_LEVEL
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


OPTIONS = Options(("mass_matrix",), flags=("-O0",), level="v1")


@pytest.fixture
def wrong(monkeypatch: pytest.MonkeyPatch) -> None:
    """A kept table that is not what is derived."""
    facts = replace(KEPT, coaxial=KEPT.coaxial[1:])
    monkeypatch.setattr(fresh, "derived_facts", lambda: facts)


def test_the_header_says_what_was_derived(tmp_path: Path) -> None:
    """Its comment alone is longer than that of the source, and the C is as it was."""
    robot = eomgen.load_robot("one_link")
    made, source = generate(robot, tmp_path, OPTIONS), make_source(robot, OPTIONS)
    text = (made / "one_link.h").read_text(encoding="ascii")
    assert "Derived afresh by SymPy" in text
    assert "2  sharper lemma" in text
    assert text.split("\n */\n")[1:] == source.header.split("\n */\n")[1:]
    assert text.startswith(source.header.split("\n */\n")[0])
    assert all(len(line) <= 120 for line in text.splitlines())
    assert (made / "one_link.c").read_text(encoding="ascii") == source.code


@pytest.mark.usefixtures("wrong")
def test_generate_writes_nothing_where_the_derivation_differs(tmp_path: Path) -> None:
    with pytest.raises(DerivationError, match="joint1, coaxial pairs, x, alpha"):
        generate("one_link", tmp_path, OPTIONS, report=tmp_path / "derivation.html")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("ending", [".html", ".tex"])
def test_the_report_of_the_command(ending: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    page = tmp_path / f"derivation{ending}"
    command = ["generate", "one_link", "-o", str(tmp_path), "--kernels", "mass_matrix", "--level", "v1"]
    assert main([*command, "--report", str(page)]) == 0
    assert f"wrote {page}" in capsys.readouterr().out
    assert "sharper lemma" in page.read_text(encoding="ascii")


def test_links_that_bend_are_generated_without(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """SymPy derives joints alone: a package is as its source; a report is refused first."""
    robot = eomgen.load_robot("flexible_arm")
    text = (generate(robot, tmp_path, OPTIONS) / "flexible_arm.h").read_text(encoding="ascii")
    assert text == make_source(robot, OPTIONS).header
    monkeypatch.setattr(generating, "rendered", None)
    with pytest.raises(InputError, match=r"links\.upper\.modes: SymPy .*allowed: robots whose links are rigid"):
        generate(robot, tmp_path, OPTIONS, report=tmp_path / "derivation.html")


def test_refused_before_anything_is_derived(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(InputError, match=r"report: .*allowed: .*\.html, \.tex"):
        generate("one_link", tmp_path, OPTIONS, report="derivation.pdf")
    assert main(["generate", "one_link", "--wheel", "--report", "x.html"]) == 1
    assert "--report" in capsys.readouterr().err
