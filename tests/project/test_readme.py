"""The README keeps its promises: its blocks run, its tables are current, its commands exist."""

import importlib.util
import re
import subprocess
import sys
from pathlib import Path

import pytest

import eomgen
from eomgen.cli.entry import main
from eomgen.description.load import robot_from_toml

pytestmark = pytest.mark.usefixtures("unoptimised")

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", README, re.S)


@pytest.mark.parametrize("page", ["README.md", "docs/architecture.md"])
def test_generated_parts_are_current(page: str) -> None:
    spec = importlib.util.spec_from_file_location("tables", ROOT / "docs" / "tables.py")
    assert spec is not None
    assert spec.loader is not None
    tables = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(tables)
    assert page in tables.PARTS
    assert tables.filled(page) == (ROOT / page).read_text(encoding="utf-8"), "run: make tables"


@pytest.mark.parametrize(
    "number", [0, *(pytest.param(i, marks=pytest.mark.soak) for i in range(1, len(blocks("python"))))]
)
def test_python_blocks_run(number: int, tmp_path: Path) -> None:
    subprocess.run([sys.executable, "-c", blocks("python")[number]], check=True, capture_output=True, cwd=tmp_path)


def test_toml_blocks_are_robots() -> None:
    rod, one_link = robot_from_toml(blocks("toml")[0]), eomgen.load_robot("one_link")
    assert rod.links == one_link.links
    assert rod.joints == one_link.joints
    assert rod.gravity == one_link.gravity


def test_commands_exist(capsys: pytest.CaptureFixture[str]) -> None:
    makefile = (ROOT / "Makefile").read_text(encoding="ascii")
    for block in blocks("console"):
        for line in block.splitlines():
            program, command = line.removeprefix("$ ").split()[:2]
            if program == "make":
                assert f"\n{command}:" in makefile, line
            else:
                assert program == "eomgen"
                with pytest.raises(SystemExit) as ended:
                    main([command, "--help"])
                assert ended.value.code == 0
                assert f"eomgen {command}" in capsys.readouterr().out


def test_linked_files_exist() -> None:
    for target in re.findall(r"\]\(([^)#:]+)\)", README):
        assert (ROOT / target).exists(), target
