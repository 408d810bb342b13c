"""The example of a control loop: the program in C against the same loop in Python, and what makes it fail."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from tests.support.c_project import need, search_path

pytestmark = pytest.mark.usefixtures("unoptimised")

EXAMPLE = Path(__file__).parents[2] / "examples" / "control_loop"
WRONG = {  # in controller.c
    "feedback of the wrong sign": ("at[i] - c->observer.q[motors[i]]", "c->observer.q[motors[i]] - at[i]"),
    "motors that move as behind rigid gears": ("error = at[i]", "error = ratio * series[i]"),
    "no damping": ("kd * slower", "0.0 * slower"),
    "a filter without torques": ("held[motors[i]] = c->u[i]", "held[motors[i]] = 0.0"),
    "a filter without readings": ("ur5_model_observer_update(&c->observer, y)", "0.0 * y[0]"),
    "a reference that is late": ("reference(++c->sample", "reference(c->sample++"),
}


@pytest.fixture(scope="module")
def example() -> Iterator[ModuleType]:
    """build.py, imported as when it is run: its neighbours are found, and forgotten again."""
    need("cmake", "ninja", "cc")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PATH", search_path())
        patch.setenv("CMAKE_GENERATOR", "Ninja")
        patch.syspath_prepend(EXAMPLE)
        import build
        import loop

        yield build
    for name in (build.__name__, loop.__name__, "task"):
        sys.modules.pop(name, None)


@pytest.fixture(scope="module")
def folder(example: ModuleType, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a copy of the example, and with what is generated for it."""
    made = tmp_path_factory.mktemp("control_loop")
    shutil.copytree(EXAMPLE, made / "source", ignore=shutil.ignore_patterns("*.py", "__pycache__"))
    example.generated(made / "generated")
    return made


def sanitized(example: ModuleType, folder: Path) -> Path:
    program: Path = example.built(folder, sanitizers=example.SANITIZERS, source=folder / "source")
    return program


def run(program: Path, *words: str) -> subprocess.CompletedProcess[str]:
    done = subprocess.run([program, *words], capture_output=True, text=True, check=False)
    assert done.stderr == "" or done.returncode == 2, done.stderr
    return done


def test_the_program_is_the_loop_in_python(example: ModuleType, folder: Path) -> None:
    """To round-off, there and back; torques reach their limits, and links their ends."""
    import loop
    import task

    program = sanitized(example, folder)
    done = run(program, "--log", str(folder / "log.csv"))
    assert done.returncode == 0, done.stdout
    found, expected = np.loadtxt(folder / "log.csv", delimiter=","), loop.simulated()
    assert found.shape == expected.shape == (round(2 * (task.MOVE + task.REST) / task.DT), 31)
    assert np.abs(found - expected).max() < 1e-8  # 2e-11 when this was written
    t, q, torques = found[:, 0], found[:, 1:13:2], found[:, 25:]
    assert np.array_equal(np.abs(torques).max(axis=0)[1:3], task.TORQUE[1:3])
    assert (np.abs(torques) <= task.TORQUE).all()
    there = np.searchsorted(t, task.MOVE + task.REST)
    assert np.abs(q[there] - task.TO).max() < task.ALLOWED["tracking"]
    assert np.abs(q[-1] - task.FROM).max() < task.ALLOWED["tracking"]
    printed = re.findall(r"([\d.]+) mrad at most", done.stdout)
    settled = range(round(task.SETTLED / task.DT) - 1, len(q))
    tracking = max(np.abs(q[k] - reference(task, k + 1)).max() for k in settled)
    assert float(printed[0]) == pytest.approx(1e3 * tracking, abs=1e-4)


def reference(task: ModuleType, k: int) -> np.ndarray:
    """Positions of the links at a sample."""
    way, t = divmod(k, round((task.MOVE + task.REST) / task.DT))
    return np.asarray(task.moves()[way % 2].at(task.DT * t)[0])


def test_a_wrong_controller_is_noticed(example: ModuleType, folder: Path) -> None:
    controller = folder / "source" / "controller.c"
    right = controller.read_text(encoding="ascii")
    try:
        for what, (old, new) in WRONG.items():
            assert right.count(old) == 1, what
            controller.write_text(right.replace(old, new), encoding="ascii")
            done = run(sanitized(example, folder), "--seconds", "0.8")
            assert done.returncode == 1, f"{what}: {done.stdout}"
    finally:
        controller.write_text(right, encoding="ascii")


def test_options(example: ModuleType, folder: Path) -> None:
    program = sanitized(example, folder)
    for words in (("--slow",), ("--seconds",), ("--seconds", "0"), ("--seconds", "1e9"), ("--priority", "-1")):
        done = run(program, *words)
        assert (done.returncode, done.stderr[:6]) == (2, "usage:"), words
    done = run(program, "--seconds", "0.5", "--log", str(folder / "nowhere" / "log.csv"))
    assert done.returncode == 1
    assert done.stdout.endswith("log.csv cannot be written\n")


def test_the_clock(example: ModuleType, folder: Path) -> None:
    """A run by the clock has the same motion, and lasts as long as it says."""
    program = sanitized(example, folder)
    done, by_clock = (run(program, "--seconds", "0.5", *words) for words in ((), ("--realtime", "--priority", "0")))
    assert by_clock.returncode == 0
    assert by_clock.stdout.endswith(done.stdout)
    rows = re.findall(r"^([a-z -]+?) +([\d.]+) +([\d.]+) +([\d.]+) +([\d.]+)$", by_clock.stdout, re.MULTILINE)
    assert [name for name, *_ in rows] == ["wake-up late by", "controller", "controller and plant"]
    for _, *times in rows:
        assert sorted(times, key=float) == times
    assert "\nmissed deadlines: " in by_clock.stdout


@pytest.mark.soak
def test_no_page_faults_in_the_loop(example: ModuleType, folder: Path) -> None:
    """Where memory may be locked."""
    program = example.built(folder, source=folder / "source")
    texts = [run(program, "--realtime", "--seconds", "0.5").stdout for _ in range(3)]
    if "memory: locked" not in texts[0]:
        pytest.skip("memory may not be locked: ulimit -l")
    assert min(int(re.findall(r"page faults: (\d+)", text)[0]) for text in texts) == 0
