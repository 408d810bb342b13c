"""Hand-made bad files of all formats: the message has the place, the value and what is allowed; commands print it."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from eomgen.cli import entry as cli
from eomgen.description.load import robot_from_toml, robot_from_urdf
from eomgen.errors import DescriptionError, InputError
from tests.support.bad_files import BAD, COMMANDS, READERS, SLOW, Bad
from tests.support.fuzzing import LENGTH, check_message
from tests.support.refusals import refused

FROM_TEXT = {"robot.toml": robot_from_toml, "robot.urdf": lambda text: robot_from_urdf(text, inertia="error")}


def name_of(case: Bad) -> str:
    content = "" if callable(case.content) else str(case.content)[:30]
    return f"{case.name}: {case.title or ' '.join((content, *case.parts))[:60]}"


@pytest.mark.parametrize(
    "case",
    [
        *(pytest.param(case, id=name_of(case)) for case in BAD),
        *(pytest.param(case, id=name_of(case), marks=pytest.mark.soak) for case in SLOW),
    ],
)
def test_bad_files(
    case: Bad, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """By the reader, by the command line, and as a text of which no file is known."""
    monkeypatch.chdir(tmp_path)
    case.write(tmp_path)
    before = set(tmp_path.iterdir())
    caught = refused(InputError, "", READERS[case.name], Path(case.name))
    message = str(caught)
    check_message(caught, 1000 if case.parts[0] == "tunable" else LENGTH)  # which lists what is allowed
    start = re.match(rf"{re.escape(case.name)}(?::(\d+)(?::\d+)?)?: ", message)
    said = message[start.end() if start else 0 :]
    assert said.startswith(case.parts[0]), message
    assert not [part for part in case.parts if part not in said], message
    assert "root:" not in message  # of /etc/passwd
    if case.name in COMMANDS:
        assert isinstance(caught, DescriptionError)
        line = caught.line
        assert (line or 0) == case.line if case.line is not None else line, message
        assert int(start[1] or 0) == (line or 0) if start else not line
    if case.name in COMMANDS and not case.title:  # not all of those that are one word of a sample
        assert cli.main(COMMANDS[case.name]) == 1
        assert capsys.readouterr() == ("", f"eomgen: {message}\n")
        assert set(tmp_path.iterdir()) == before
    if case.name in FROM_TEXT and line and isinstance(case.content, str):
        again = refused(DescriptionError, "", FROM_TEXT[case.name], case.content)
        assert re.findall(r"\bline ([0-9]+)", str(again))[:1] == [str(line)]
