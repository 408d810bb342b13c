"""Generated packages beside modules that there are; and paths with line ends in what is said."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import pytest

from eomgen.cli.entry import main
from eomgen.description.load import load_robot
from eomgen.errors import DescriptionError, EomgenWarning, InputError
from eomgen.export.wheel import export_wheel
from eomgen.motion.csv_columns import read_csv
from eomgen.npz import read_npz
from eomgen.pipeline.importable import check_module_name
from eomgen.pipeline.stages import Options, generate

QUICK = Options(("energy",), flags=("-O0",))


@pytest.mark.parametrize("name", ["numpy", "cffi", "json", "sys", "math", "select", "eomgen"])
def test_a_package_that_would_break_others_is_refused(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    robot = replace(load_robot("one_link"), name=name)
    for write in (generate, export_wheel):
        with pytest.raises(InputError, match=f"would be called '{name}', .*; allowed: another name"):
            write(robot, tmp_path / "out", QUICK)
    assert not (tmp_path / "out").exists()
    path = tmp_path / "r.toml"
    text = (Path(load_robot.__code__.co_filename).parents[1] / "robots").glob("one_link.toml")
    path.write_text(next(text).read_text().replace('name = "one_link"', f'name = "{name}"'))
    assert main(["generate", str(path), "-o", str(tmp_path / "out")]) == 1
    assert f"would be called '{name}'" in capsys.readouterr().err


def test_a_package_that_is_installed_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "there").mkdir()
    (tmp_path / "there" / "other_arm.py").write_text("raise RuntimeError('it has been imported')")
    monkeypatch.syspath_prepend(str(tmp_path / "there"))
    robot = replace(load_robot("one_link"), name="other_arm")
    with pytest.warns(EomgenWarning, match="a package 'other_arm' is installed"):
        target = generate(robot, tmp_path / "out", QUICK)
    assert "other_arm" not in sys.modules
    monkeypatch.syspath_prepend(str(target.parent))
    assert check_module_name("other_arm") == ""  # what was generated before may be generated again
    assert check_module_name("an_arm_of_mine") == ""


def test_paths_with_line_ends_are_quoted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "a\neomgen: all is well\x1b[2J"
    folder.mkdir()
    description, table, arrays = (folder / f"x.{ending}" for ending in ("toml", "csv", "npz"))
    description.write_text("name = 3")
    table.write_text("t\nx")
    arrays.write_bytes(b"no archive")
    for read, path in (
        (load_robot, description),
        (read_csv, table),
        (read_npz, arrays),
        (load_robot, folder / "y.urdf"),
    ):
        with pytest.raises(InputError) as caught:
            read(path)  # type: ignore[operator]
        assert str(caught.value).isprintable(), str(caught.value)
        if isinstance(caught.value, DescriptionError):
            assert "\\neomgen: all is well" in str(caught.value)
    monkeypatch.chdir(tmp_path)
    for words in (
        ["check", str(description)],
        ["simulate", str(description)],
        ["fit", "one_link", str(table)],
        ["modes", "one_link", "--along", str(arrays)],
        ["simulate", "one_link", "--duration", "0.01", "--no-plots", "-o", str(folder / "out")],
        ["generate", "one_link", "--kernels", "energy", "-o", str(folder)],
    ):
        main(words)
        said = "".join(capsys.readouterr())
        assert "\\neomgen: all is well" in said, said
        assert not any(line.startswith("eomgen: all is well") for line in said.splitlines()), said
