"""At a prompt and in a notebook long work says how far it has come, as commands do; in scripts it says nothing."""

from __future__ import annotations

import ast
import importlib
import inspect
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

import eomgen
from eomgen import progress
from eomgen.cli import entry as cli
from eomgen.cli.shared.progress import stage_bar
from eomgen.errors import EomgenWarning
from eomgen.pipeline import building, on_demand
from eomgen.progress import no_progress, no_report, tells_at_prompt, told_at_prompt
from tests.support.oscillators import chain

pytestmark = pytest.mark.usefixtures("unoptimised")

EOMGEN = Path(eomgen.__file__).parent
SUBPACKAGES = ("analysis", "export", "identification", "integration", "pictures", "pipeline", "simulation", "sweep")
OTHERWISE = {"build", "make_source"}  # one tells in its body, the other is part of what does
OF_PYTHON = {"integrating"}  # what no command does


class Session:
    """What a session has on standard error, with lines every 20 ms."""

    def __init__(self, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
        self._capsys, self._text = capsys, ""
        monkeypatch.setattr(progress, "EVERY", 0.02)

    @property
    def lines(self) -> list[str]:
        self._text += self._capsys.readouterr().err
        return self._text.splitlines()

    def wait(self) -> None:
        """Wait for two further lines, as long work does."""
        wanted, deadline = len(self.lines) + 2, time.monotonic() + 10.0
        while len(self.lines) < wanted and time.monotonic() < deadline:
            time.sleep(0.005)

    def take(self) -> list[str]:
        """Return the lines that came since the last call."""
        lines, self._text = self.lines, ""
        return lines


@pytest.fixture
def script(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Session:
    monkeypatch.delattr(sys, "ps1", raising=False)
    return Session(capsys, monkeypatch)


@pytest.fixture
def prompt(script: Session, monkeypatch: pytest.MonkeyPatch) -> Session:
    monkeypatch.setattr(sys, "ps1", ">>> ", raising=False)
    return script


@tells_at_prompt("fitting")
def work(
    session: Session,
    inner: Callable[[], object] = lambda: None,
    *,
    wait: bool = True,
    progress: Callable[[str], None] = no_report,
) -> str:
    progress("reading")
    inner()
    progress("stage 2")
    if wait:
        session.wait()
    return "done"


@tells_at_prompt("sweeping")
def counted(session: Session, *, progress: Callable[[float, str], None] | None = None) -> None:
    (progress or no_progress)(0.25, "sample 3")
    session.wait()


def test_lines_at_a_prompt(prompt: Session) -> None:
    assert work(prompt) == "done"
    assert prompt.take()[-1].startswith("fitting: stage 2 (")
    counted(prompt)
    assert prompt.take()[-1].startswith("sweeping: 25 % sample 3 (")
    with pytest.raises(ZeroDivisionError):
        work(prompt, lambda: 1 // 0)
    assert "eomgen-progress" not in {thread.name for thread in threading.enumerate()}


def test_nothing_in_a_script(script: Session) -> None:
    assert work(script, lambda: time.sleep(0.1), wait=False) == "done"
    with told_at_prompt("building") as report:
        report("compiling")
        time.sleep(0.1)
    assert script.lines == []


def test_a_report_of_the_caller_is_enough(prompt: Session) -> None:
    heard: list[str] = []
    assert work(prompt, lambda: time.sleep(0.1), wait=False, progress=heard.append) == "done"
    assert heard == ["reading", "stage 2"]
    assert prompt.lines == []


def test_the_outermost_says_it_alone(prompt: Session) -> None:
    """Also of work in threads, and below a command, whose bar is there already."""

    def inner() -> None:
        with told_at_prompt("building") as report:
            report("compiling")
            time.sleep(0.1)

    def threads() -> None:
        beside = threading.Thread(target=inner)
        beside.start()
        beside.join()

    for nested in (inner, threads):
        work(prompt, nested)
        assert {line.split(":")[0] for line in prompt.take()} == {"fitting"}
    with stage_bar("generating"):  # of a block that is too short for lines of its own
        work(prompt, inner, wait=False)
    assert prompt.lines == []


def test_commands_and_python_do_not_say_it_twice(
    prompt: Session, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    assert cli.main(["simulate", "one_link", "--duration", "0.05", "--no-plots"]) == 0
    assert not [line for line in prompt.take() if not line.startswith("note: ")]


def test_build_tells_and_so_do_kernels_that_are_built_later(prompt: Session, monkeypatch: pytest.MonkeyPatch) -> None:
    at_once = building._at_once

    def slow(described: Any, report: Callable[[str], None]) -> Any:
        kernel = at_once(described, report)
        report("compiling")
        prompt.wait()
        return kernel

    monkeypatch.setattr(building, "_at_once", slow)
    eomgen.build("one_link", kernels=["mass_matrix"])
    assert prompt.take()[-1].startswith("building: compiling (")
    loaded = on_demand.loaded

    def slowly(*about: Any) -> Any:
        prompt.wait()
        return loaded(*about)

    monkeypatch.setattr(on_demand, "loaded", slowly)
    kernel = eomgen.build("one_link")
    prompt.take()
    kernel.mass_matrix([0.1] * kernel.n)
    assert prompt.take()[-1].startswith("building mass_matrix of one_link")
    kernel.mass_matrix([0.2] * kernel.n)
    assert prompt.take() == []


def test_simulations_tell(prompt: Session, monkeypatch: pytest.MonkeyPatch) -> None:
    from eomgen.simulation import run

    calls = []
    assembly = run.run_assembly

    def slow(*about: Any, **options: Any) -> Any:
        calls.append(about)
        prompt.wait()
        return assembly(*about, **options)

    monkeypatch.setattr(run, "run_assembly", slow)
    eomgen.simulate("one_link", duration=0.02)
    assert calls
    assert {line.split(":")[0] for line in prompt.lines} == {"simulating"}


def public_functions() -> Iterator[tuple[str, Any]]:
    for module in (eomgen, *(importlib.import_module(f"eomgen.{name}") for name in SUBPACKAGES)):
        for name in module.__all__:
            value = getattr(module, name)
            if inspect.isfunction(value) and "progress" in inspect.signature(value).parameters:
                yield name, value


def test_all_functions_with_progress_tell() -> None:
    functions = dict(public_functions())
    assert len(functions) > 20
    assert {name for name, value in functions.items() if not any(map(tells, decorated(value)))} == OTHERWISE


def decorated(function: Any) -> Iterator[Any]:
    """Give a function and what its decorators wrap."""
    while function is not None:
        yield function
        function = getattr(function, "__wrapped__", None)


def tells(function: Any) -> bool:
    return bool(function.__code__.co_filename == progress.__file__)


def words(name: str, *folders: str) -> set[str]:
    """Return first arguments of calls of some function in the source of some folders, where these are texts."""
    texts = set()
    for path in (path for folder in folders for path in (EOMGEN / folder).rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and getattr(node.func, "id", "") == name:
                texts |= {x.value for x in node.args[:1] if isinstance(x, ast.Constant) and isinstance(x.value, str)}
    return texts


def test_they_say_it_in_the_words_of_commands() -> None:
    said = words("tells_at_prompt", *SUBPACKAGES)
    of_commands = words("progress_bar", "cli") | words("stage_bar", "cli")
    assert said
    assert said - of_commands == OF_PYTHON


def test_warnings_still_point_at_the_caller() -> None:
    with pytest.warns(EomgenWarning, match="nothing holds") as caught:
        eomgen.analysis.modes(chain(2, ends="free-free"))
    assert {Path(one.filename) for one in caught} == {Path(__file__)}


def test_an_interactive_python_is_a_prompt() -> None:
    asked = "from eomgen.progress import is_at_prompt\nprint(is_at_prompt())\n"
    for option, text in ((["-i"], asked), (["-"], asked)):
        done = subprocess.run([sys.executable, *option], input=text, capture_output=True, text=True, check=True)
        assert done.stdout.split() == [str(option == ["-i"])]
