"""Hand-made bad files: file, place, reason and remedy, on the command line too, within 2 s and 512 MB."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from eomgen.cli import entry as cli
from eomgen.errors import DescriptionError
from tests.support import fuzzing
from tests.support.bad_files import BAD_FILES, READERS, written
from tests.support.fuzzing import check_message
from tests.support.soak import soaked

SLOW = {  # large ones, of whose kinds others are tried
    *("300,000 prefixes", "many deep tables", "5,000 links, MJCF", "8,000 links, TOML", "200,000 declarations"),
    *("5,000 names of tunable, one wrong", "coordinates prescribed again and again", "plan of very many points"),
    *("default classes of 100,000 attributes", "nested default classes of many attributes", "30,000 links"),
}


def test_there_are_thirty() -> None:
    assert len(BAD_FILES) >= 30


@pytest.mark.parametrize("name", soaked(BAD_FILES, set(BAD_FILES) - SLOW))
def test_diagnosis(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    case = BAD_FILES[name]
    written(case, tmp_path)
    with pytest.raises(DescriptionError) as caught:
        READERS[case.kind](case.name)
    message = str(caught.value)
    check_message(caught.value)
    place, line = case.spot
    assert line in (None, caught.value.line)
    at = "" if caught.value.line is None else f":{caught.value.line}:"
    assert message.startswith(f"{case.name}{at}" if place not in ("spring.csv", "K.mtx") else f"{place}: ")
    for part in (place, case.reason, case.remedy):
        assert part in message
    arguments = {
        "robot": ["info", case.name],
        "scenario": ["simulate", "one_link", "--scenario", case.name, "-o", "out"],
        "plan": ["sweep", "one_link", "--scenario", "puma560_circle", "--plan", case.name, "-o", "out"],
    }
    assert cli.main(arguments[case.kind]) == 1
    assert capsys.readouterr() == ("", f"eomgen: {message}\n")
    assert [path.name for path in tmp_path.iterdir()] == [case.name]


ROOT = Path(__file__).parents[2]


@pytest.mark.soak
def test_limits_of_time_and_memory(tmp_path: Path) -> None:
    """In one process that is allowed 512 MB more than it begins with, 2 s each."""
    code = f"""
import json, signal, sys, time
sys.path.insert(0, {str(ROOT)!r})
from tests.support import fuzzing
from tests.support.bad_files import BAD_FILES, READERS, written
from pathlib import Path
READERS["robot"]("ur5")
contents = {{name: written(case, Path({str(tmp_path)!r})) for name, case in BAD_FILES.items()}}
fuzzing.limit_memory()
signal.signal(signal.SIGPROF, fuzzing.late)
slowest = {{}}
for name, path in contents.items():
    case = BAD_FILES[name]
    path.write_bytes(case.content)
    began = time.process_time()
    signal.setitimer(signal.ITIMER_PROF, fuzzing.SECONDS)
    try:
        READERS[case.kind](path)
    except fuzzing.InputError:
        slowest[name] = time.process_time() - began
signal.setitimer(signal.ITIMER_PROF, 0)
print(json.dumps(slowest))
"""
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert found.returncode == 0, found.stderr[-3000:]
    times = json.loads(found.stdout)
    assert set(times) == set(BAD_FILES)
    assert max(times.values()) < fuzzing.SECONDS
