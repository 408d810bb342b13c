"""Files of results: writers that are killed, disks that are full, bits that flip; nothing looks whole that is not."""

from __future__ import annotations

import json
import os
import random
import signal
import subprocess
import sys
import textwrap
import time
from pathlib import Path
from typing import BinaryIO

import numpy as np
import pytest

import eomgen
from eomgen import files
from eomgen.errors import InputError
from eomgen.scenario.load import scenario_from_toml
from eomgen.simulation.result import SimulationResult
from eomgen.simulation.run import run_scenario
from eomgen.sweep.contents import SampleRow
from eomgen.sweep.store import opened, read_rows
from tests.support.optional import needs
from tests.support.soak import WHOLE, soaked

pytestmark = pytest.mark.usefixtures("unoptimised")

SCENARIO = "duration = 0.2\noutput_step = 0.005\n[motion]\ntype = 'point_to_point'\ngoal = [0.3]\n"


@pytest.fixture(scope="module")
def result() -> SimulationResult:
    return run_scenario(eomgen.load_robot("one_link"), scenario_from_toml(SCENARIO))


def writer(code: str, *arguments: object) -> subprocess.Popen[str]:
    command = [sys.executable, "-c", textwrap.dedent(code), *map(str, arguments)]
    return subprocess.Popen(command, stderr=subprocess.PIPE, text=True)


RESULTS = """
    import dataclasses, sys, numpy as np, eomgen
    from pathlib import Path
    folder = Path(sys.argv[1])
    first = eomgen.load_result(folder / "start.npz")
    number = 0.0
    while True:
        number += 1.0
        motion = dataclasses.replace(first.trajectory, q=np.full_like(first.trajectory.q, number))
        result = dataclasses.replace(first, trajectory=motion, notes=(str(number),))
        result.save(folder / "r.npz")
        result.save(folder / f"r{int(number) % 3}.npz")
"""


def sizes(folder: Path) -> list[tuple[str, int]]:
    return sorted((path.name, path.stat().st_size) for path in folder.glob("*") if not path.name.startswith("."))


def check_results(folder: Path) -> int:
    """Whatever is called a result is one, of one piece; the number of the last."""
    last = 0
    for path in folder.glob("*.npz"):
        if path.name != "start.npz":
            found = eomgen.load_result(path)
            (number,) = np.unique(found.trajectory.q)
            assert found.notes == (str(number),)
            last = max(last, int(number))
    return last


ROWS = """
    import sys
    from pathlib import Path
    from eomgen.sweep.contents import SampleRow
    from eomgen.sweep.store import opened
    with opened(Path(sys.argv[1]), {"key": "k", "eomgen": "0", "robot": "r"}) as store:
        start = max(store.rows, default=-1) + 1
        for i in range(start, start + 10**7):
            pair = (2 * i, 2 * i + 1)
            store.append([SampleRow(k, (float(k), k / 3), tuple(k + j / 7 for j in range(60))) for k in pair])
"""


def check_rows(folder: Path) -> int:
    """Every sample that is there is right, and nothing before the last is missing."""
    rows = read_rows(folder)
    for k, row in rows.items():
        assert row.sample == (float(k), k / 3)
        assert row.record == tuple(k + j / 7 for j in range(60))
    return len(rows)


STREAM = """
    import sys, numpy as np
    from eomgen.simulation.stream import MotionStream
    stream = MotionStream(sys.argv[1] + "/s" + sys.argv[2], ["a.x", "b.gamma", "c.z"], 100_000, {})
    for i in range(100_000):
        row = np.full((1, 3), float(i))
        stream.append(np.array([float(i)]), row, -row)
        if i % 7 == 0:
            stream.flush()
"""


def check_streams(folder: Path) -> int:
    """What the last one left: up to where t goes, everything is there."""
    path = max(folder.glob("s*"), key=lambda path: int(path.name[1:]))
    try:
        found = eomgen.load_stream(path)
    except InputError:  # killed before there was one
        assert not (path / "t" / "c").exists()
        return 0
    assert not found.complete
    assert np.array_equal(found.t, np.arange(float(found.t.size)))
    for values, sign in ((found.q, 1.0), (found.v, -1.0)):
        assert np.array_equal(values, np.repeat(sign * found.t[:, np.newaxis], 3, axis=1))
    return int(found.t.size)


WRITERS = {"results": (RESULTS, check_results), "rows": (ROWS, check_rows), "streams": (STREAM, check_streams)}


@pytest.mark.soak
@pytest.mark.parametrize("kind", soaked(WRITERS, ("results",)))
@pytest.mark.parametrize("count", [2, pytest.param(20 if WHOLE else 8, marks=pytest.mark.soak)])
def test_killed_writers(kind: str, count: int, result: SimulationResult, tmp_path: Path) -> None:
    """One after the other in the same folder, each killed at a random moment after its first file."""
    if kind == "streams":
        needs("zarr")
    code, check = WRITERS[kind]
    rng, folder = random.Random(f"{kind} {count}"), tmp_path / "folder"
    folder.mkdir()
    if kind == "results":
        result.save(folder / "start.npz")
    found = [0]
    for number in range(count):
        before = sizes(folder)
        process = writer(code, folder, number)
        while sizes(folder) == before:
            assert process.poll() is None, process.communicate()[1]
            time.sleep(0.002)
        time.sleep(rng.uniform(0.0, 0.2))
        process.send_signal(signal.SIGKILL)
        process.communicate()
        assert process.returncode == -signal.SIGKILL
        found.append(check(folder))
    assert max(found) > 0
    if kind == "rows":  # each goes on where the last one ended
        assert found == sorted(found)


def test_nothing_is_called_a_result_before_it_is_whole(tmp_path: Path) -> None:
    """Nor under a temporary name: a writer may be killed at any moment, and leave what it has then."""
    seen = dict[str, list[bytes]]()

    def look(when: str) -> None:
        seen[when] = [path.read_bytes() for path in tmp_path.glob("*.npz")]

    def write(stream: BinaryIO) -> None:
        stream.write(b"half")
        stream.flush()
        look("half")
        stream.write(b" and half")

    files.write_atomically(tmp_path / "r.npz", write, read=lambda path: look("read"))
    look("end")
    assert seen == {"half": [], "read": [b"half and half"], "end": [b"half and half"]}
    assert len([*tmp_path.iterdir()]) == 1


def test_a_killed_writers_leftovers_are_removed_a_day_later(result: SimulationResult, tmp_path: Path) -> None:
    path = result.save(tmp_path / "r[1].npz")
    old, fresh, other = (tmp_path / name for name in (".r[1].npz-1-aa", ".r[1].npz-2-bb", ".r1.npz-1-aa"))
    for file in (old, fresh, other):
        file.touch()
    for file in (old, other):
        os.utime(file, (time.time() - 90000.0,) * 2)
    assert result.save(path) == path
    assert {file.name for file in tmp_path.iterdir()} == {path.name, fresh.name, other.name}


FULL = """
    import json, resource, sys
    from pathlib import Path
    import eomgen
    from eomgen.errors import InputError
    folder = Path(sys.argv[1])
    result = eomgen.load_result(folder / "r.npz")
    resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[2]), resource.RLIM_INFINITY))
    for _ in range(2):
        try:
            result.save(folder / "r.npz")
        except InputError as error:
            assert "cannot be written: File too large" in str(error), error
        else:
            raise SystemExit("no error")
"""


@pytest.mark.skipif(os.name != "posix", reason="limits of file sizes as POSIX has them")
def test_no_room_for_a_result(result: SimulationResult, tmp_path: Path) -> None:
    """The error says so, the earlier file stays, nothing else is left."""
    content = result.save(tmp_path / "r.npz").read_bytes()
    process = writer(FULL, tmp_path, len(content) // 2)
    assert process.communicate()[1] == ""
    assert process.returncode == 0
    assert [path.name for path in tmp_path.iterdir()] == ["r.npz"]
    assert (tmp_path / "r.npz").read_bytes() == content


SHORT = """
    import resource, sys
    from pathlib import Path
    from eomgen.errors import InputError
    from eomgen.sweep.contents import SampleRow
    from eomgen.sweep.store import opened
    resource.setrlimit(resource.RLIMIT_FSIZE, (5000, resource.RLIM_INFINITY))
    done = 0
    try:
        with opened(Path(sys.argv[1]), {"key": "k", "eomgen": "0", "robot": "r"}) as store:
            for k in range(100):
                store.append([SampleRow(k, (float(k), k / 3), tuple(k + j / 7 for j in range(300)))])
                done += 1
    except InputError as error:
        assert "cannot be written: File too large" in str(error), error
        print(done)
"""


@pytest.mark.skipif(os.name != "posix", reason="limits of file sizes as POSIX has them")
def test_no_room_for_samples(tmp_path: Path) -> None:
    """A system that writes a part of a line does not make it a sample: it is reported, and done again."""
    command = [sys.executable, "-c", textwrap.dedent(SHORT), str(tmp_path)]
    found = subprocess.run(command, capture_output=True, text=True, check=False)
    assert found.returncode == 0, found.stderr
    done = int(found.stdout)
    assert 0 <= done == len(read_rows(tmp_path))
    with opened(tmp_path, {"key": "k", "eomgen": "0", "robot": "r"}) as store:
        store.append([SampleRow(done, (float(done), done / 3), tuple(done + j / 7 for j in range(300)))])
    assert len(read_rows(tmp_path)) == done + 1


@pytest.mark.parametrize("count", [60, pytest.param(2000, marks=pytest.mark.soak)])
def test_damaged_results(count: int, result: SimulationResult, tmp_path: Path) -> None:
    """One bit, a truncation or nothing: the error that names the file, or what was saved."""
    rng = random.Random(count)
    path = result.save(tmp_path / "r.npz")
    whole, refused = path.read_bytes(), 0
    expected = eomgen.load_result(path)
    for number in range(count):
        data = bytearray(whole)
        if number % 10 == 0:
            data = data[: rng.randrange(len(data))]
        else:
            data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
        path.write_bytes(data)
        try:
            found = eomgen.load_result(path)
        except InputError:
            refused += 1
            continue
        for name in ("t", "q", "v", "u", "energy"):
            assert np.array_equal(getattr(found.trajectory, name), getattr(expected.trajectory, name))
        assert json.dumps(dict(found.scenario)) == json.dumps(dict(expected.scenario))
    assert refused > count * 0.8
