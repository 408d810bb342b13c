"""Completion in shells: bash itself is asked what it completes; zsh and fish get the same names."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from eomgen.cli import entry
from eomgen.cli.completion import SHELLS
from eomgen.description.builtin import builtin_robots
from eomgen.scenario.builtin import builtin_scenarios


def script(shell: str, capsys: pytest.CaptureFixture[str]) -> str:
    pytest.importorskip("shtab")
    with pytest.raises(SystemExit) as left:
        entry.main(["--completion", shell])
    assert left.value.code == 0
    return capsys.readouterr().out


def completed(text: str, words: str, folder: Path) -> set[str]:
    """What bash offers in the place of the last of the words."""
    ask = f"""{text}
COMP_WORDS=({words}); [[ "{words}" == *" " ]] && COMP_WORDS+=("")
COMP_CWORD=$((${{#COMP_WORDS[@]}} - 1)); COMP_LINE="{words}"; COMP_POINT=${{#COMP_LINE}}
$(complete -p eomgen | sed 's/.*-F \\([^ ]*\\).*/\\1/') eomgen "${{COMP_WORDS[COMP_CWORD]}}" ""
printf '%s\\n' "${{COMPREPLY[@]}}"
"""
    done = subprocess.run(["bash", "-c", ask], capture_output=True, text=True, cwd=folder, check=False)
    assert done.returncode == 0, done.stderr
    return set(done.stdout.split())


def test_bash_completes_commands_robots_scenarios_options_and_files(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = script("bash", capsys)
    if shutil.which("bash") is None:
        pytest.skip("there is no bash here")
    (tmp_path / "mine.toml").touch()
    assert completed(text, "eomgen ", tmp_path) >= {*entry.NAMES, "measure", "show"}
    assert completed(text, "eomgen measure ", tmp_path) >= {"fit", "calibrate"}
    assert completed(text, "eomgen measure calibrate ", tmp_path) >= {*builtin_robots(), "mine.toml"}
    assert completed(text, "eomgen excite ur5 --criterion ", tmp_path) == {"D", "condition"}
    assert completed(text, "eomgen measure calibrate ur5 p.csv --loss ", tmp_path) == {"huber", "cauchy", "tukey"}
    assert completed(text, "eomgen schema ", tmp_path) == {"robot", "scenario", "plan"}
    assert "--rates" not in completed(text, "eomgen excite ur5 --", tmp_path)
    assert completed(text, "eomgen res", tmp_path) == {"response"}
    for command in ("info", "simulate", "modes", "bench", "export"):
        assert completed(text, f"eomgen {command} ", tmp_path) >= {*builtin_robots(), "mine.toml"}, command
    assert completed(text, "eomgen info pum", tmp_path) == {"puma560", "puma560_elastic"}
    assert completed(text, "eomgen simulate puma560 --scenario ", tmp_path) >= {*builtin_scenarios(), "mine.toml"}
    assert completed(text, "eomgen plot out --format ", tmp_path) == {"svg", "pdf", "png"}
    assert completed(text, "eomgen check m", tmp_path) == {"mine.toml"}
    assert "--urdf-damping" in completed(text, "eomgen modes puma560 --u", tmp_path)


@pytest.mark.parametrize("shell", SHELLS)
def test_every_shell_knows_every_command_option_and_robot(shell: str, capsys: pytest.CaptureFixture[str]) -> None:
    text = script(shell, capsys)
    for name in (*entry.NAMES, *builtin_robots(), *builtin_scenarios(), "no-plots", "urdf-damping"):
        assert name in text, name


def test_without_shtab_one_line_says_what_is_missing(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "shtab", None)
    assert entry.main(["--completion", "zsh"]) == 1
    advice = 'pip install shtab, or pip install "eomgen[completion]"'
    assert capsys.readouterr().err == f"eomgen: --completion needs shtab, which is not installed: {advice}\n"
