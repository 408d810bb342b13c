"""Kernels whose scalar and batch functions are compiled apart, and generated packages beside other modules."""

from __future__ import annotations

import pickle
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen.cli.entry import main
from eomgen.codegen.c.library import SETUP_ONLY
from eomgen.description.load import load_robot
from eomgen.errors import BuildError, DescriptionError, EomgenWarning, InputError, IntegrationStopped, SingularError
from eomgen.export.wheel import export_wheel
from eomgen.motion.csv_columns import read_csv
from eomgen.npz import read_npz
from eomgen.pipeline.building import build_groups
from eomgen.pipeline.generating import check_module_name, generate
from eomgen.pipeline.options import Options
from eomgen.runtime.raw import RawFunction
from tests.support.builds import Build
from tests.support.quick_builds import logging_compiler, script
from tests.support.random_robots import random_robot
from tests.support.refusals import refused

Q, V = np.array([0.2, 0.5]), np.array([-0.3, 0.1])
FILES = {"singles": "/one_link.c ", "batches": "/one_link_batch.c "}  # in commands that compile
MANY = np.random.default_rng(3).uniform(-0.5, 0.5, (600, 2))
STIFFNESS = "joints.joint1.x.stiffness"
pytestmark = pytest.mark.usefixtures("unoptimised")


class Compiled:
    """Halves that a compiler was asked for."""

    def __init__(self, log: Path) -> None:
        self._log = log

    def new(self) -> list[str]:
        """Those since the last time, in their order."""
        lines, _ = self._log.read_text().splitlines(), self._log.write_text("")
        return [half for line in lines if f"-D{SETUP_ONLY}" not in line for half, file in FILES.items() if file in line]


@pytest.fixture
def compiled(tmp_path: Path, empty_cache: Path, monkeypatch: pytest.MonkeyPatch) -> Compiled:
    compiler, log = logging_compiler(tmp_path)
    monkeypatch.setenv("CC", compiler)
    return Compiled(log)


def test_a_half_is_compiled_when_it_is_asked_for(compiled: Compiled) -> None:
    kernel = eomgen.build("one_link")
    kernel.energy(Q, V)
    kernel.energy(Q.tolist(), V)
    kernel.rollout(Q, V, V, 1e-3, 3)
    assert compiled.new() == ["singles"] * 2
    kernel.energy(MANY, V)
    kernel.energy(MANY[:1], V)
    assert compiled.new() == ["batches"]
    kernel.rollout(MANY[:2], V, V, 1e-3, 3)
    assert compiled.new() == ["batches"]
    eomgen.build("one_link").energy(MANY, V)
    assert compiled.new() == []


@pytest.mark.soak
def test_a_batch_needs_no_single_state(compiled: Compiled) -> None:
    kernel = eomgen.build("one_link")
    kernel.frame_pose(MANY, "link1")
    kernel.blocks(MANY)
    kernel.mass_matrix(MANY)
    assert compiled.new() == ["batches"] * 3
    assert kernel._bound["mass_matrix"].takes_many  # type: ignore[attr-defined]
    assert not kernel._bound["mass_matrix"].is_armed  # type: ignore[attr-defined]
    refused((IntegrationStopped, SingularError), "", kernel.rollout, MANY[:2], V, V * 1e300, 1e3, 5)
    assert compiled.new() == ["batches"]
    found = kernel.mass_matrix(Q)
    assert compiled.new() == ["singles"]
    assert np.array_equal(kernel.mass_matrix(np.array([Q]))[0], found)


@pytest.mark.soak
def test_what_wrenches_add_is_compiled_for_its_own_states(compiled: Compiled, monkeypatch: pytest.MonkeyPatch) -> None:
    """For one state, though the call has many, where neither q nor the wrench is another one in each."""
    kernel = eomgen.build("one_link")
    wrench = np.random.default_rng(4).uniform(-1.0, 1.0, kernel.raw.shapes["wrench"])
    ways = {
        "one": lambda: kernel.residual(Q, V, V, V),
        "one and one": lambda: kernel.residual(Q, V, V, V, wrench=wrench),
        "one and many": lambda: kernel.residual(Q, MANY, V, V, wrench=wrench),
        "many and many": lambda: kernel.residual(MANY, V, V, V, wrench=wrench),
    }
    expected = [["singles"], ["singles"], ["batches"], ["batches"]]
    found = {}
    for (way, call), halves in zip(ways.items(), expected, strict=True):
        found[way] = call()
        assert compiled.new() == halves, way
    monkeypatch.setattr("eomgen.runtime.calls.Calls.run", None)  # calls go to the code at once from now on
    assert all(call().tobytes() == found[way].tobytes() for way, call in ways.items())


def test_kernels_by_name_have_both_halves(compiled: Compiled) -> None:
    kernel = eomgen.build("one_link", kernels=("energy",))
    assert sorted(compiled.new()) == ["batches", "singles"]
    kernel.energy(MANY, V)
    kernel.energy(Q, V)
    assert compiled.new() == []


@pytest.mark.soak
def test_loops_over_single_states_are_in_their_half(compiled: Compiled, monkeypatch: pytest.MonkeyPatch) -> None:
    """Arrays that would not fit the stack as vectors: there is no second half."""
    monkeypatch.setattr("eomgen.codegen.c.lanes.LANE_VALUES", 0)
    kernel = eomgen.build("one_link")
    found = kernel.energy(MANY, V)
    assert compiled.new() == ["singles"]
    assert np.array_equal(kernel.energy(MANY[5], V), found[5])
    ends = kernel.rollout(MANY[:3], V, V, 1e-3, 4)
    assert np.array_equal(ends[0][1], kernel.rollout(MANY[1], V, V, 1e-3, 4)[0])
    assert compiled.new() == ["singles"]


@pytest.mark.soak
@pytest.mark.parametrize("which", ["one_link", "random"])
def test_both_halves_have_the_same_bits(which: str, built: Build) -> None:
    """One state alone, in a batch, on threads, in one library of both: of every function."""
    robot = random_robot(17, joints=(2, 2)) if which == "random" else eomgen.load_robot(which)
    apart, whole = built(robot), built(robot, "all")
    on_threads, rng = apart.replaced(threads=2), np.random.default_rng(0)
    for name, function in whole.raw.functions.items():
        arrays = [rng.uniform(-0.4, 0.4, (520, *whole.raw.shapes[label])) for label in function.reads]
        extra = (1,) if function.is_framed else ()
        expected = whole.calls.run(name, None, arrays, extra)
        assert apart.calls.run(name, None, arrays, extra).tobytes() == expected.tobytes(), name
        assert on_threads.calls.run(name, None, arrays, extra).tobytes() == expected.tobytes(), name
        for state in (0, 17, 519):
            alone = apart.calls.run(name, None, [x[state] for x in arrays], extra)
            assert alone.tobytes() == expected[state].tobytes(), name


@pytest.mark.parametrize("batch_first", [True, pytest.param(False, marks=pytest.mark.soak)])
def test_an_assignment_reaches_both_halves(batch_first: bool, built: Build) -> None:
    """Through the extension module as well, whichever half came first."""
    kernel = built(eomgen.load_robot("one_link"), dtype="float32" if batch_first else "float64")
    q, v = (x.astype(kernel.dtype) for x in (Q, V))
    several = np.array([q, q])
    other = kernel.replaced()

    def one(kernel: eomgen.Kernel) -> np.ndarray:
        return kernel.inverse_dynamics(q, v, v)

    def many(kernel: eomgen.Kernel) -> np.ndarray:
        return kernel.inverse_dynamics(several, v, v)

    ways = (many, one) if batch_first else (one, many)
    before = [way(kernel) for way in ways for _ in range(2)]
    kernel.parameters[STIFFNESS] = 7.0
    after = [way(kernel) for way in ways for _ in range(2)]
    assert all((x != y).any() for x, y in zip(before, after, strict=True))
    assert all((x == one(kernel)).all() for x in after)
    assert all((x == one(other)).all() for x in before)
    assert kernel._bound["inverse_dynamics"].is_armed  # type: ignore[attr-defined]
    assert kernel._bound["inverse_dynamics"].takes_many  # type: ignore[attr-defined]


@pytest.mark.soak
@pytest.mark.parametrize("batch_first", [False, True])
def test_groups_are_compiled_together(batch_first: bool, compiled: Compiled) -> None:
    """Some kernels' functions for one state, other kernels' for batches: what each reads of parameters is its own."""
    groups = {"singles": ("residual", "mass_matrix"), "batches": ("energy", "residual")}
    kernel, whole = build_groups(eomgen.load_robot("one_link"), groups), eomgen.build("one_link", kernels="all")
    compiled.new()
    assert set(kernel.raw.libraries.about("energy")["kernels"]) == set(groups["batches"])
    ways = [(Q, V, V, V), (MANY, V, V, V)]
    for stiffness in (7.0, 8.0):
        kernel.parameters[STIFFNESS] = whole.parameters[STIFFNESS] = stiffness
        for arguments in reversed(ways) if batch_first else ways:
            for _ in range(2):
                assert kernel.residual(*arguments).tobytes() == whole.residual(*arguments).tobytes()
    assert kernel.mass_matrix(Q).tobytes() == whole.mass_matrix(Q).tobytes()
    assert kernel.energy(MANY, V).tobytes() == whole.energy(MANY, V).tobytes()
    assert sorted(compiled.new()) == ["batches", "singles"]
    assert kernel.energy(Q, V).tobytes() == whole.energy(Q, V).tobytes()
    assert kernel.mass_matrix(MANY).tobytes() == whole.mass_matrix(MANY).tobytes()
    assert sorted(compiled.new()) == ["batches", "singles"]


def test_a_failure_is_said_by_the_batch(empty_cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = 'case "$*" in *_batch.c*) echo no room for vectors; exit 3;; esac\nexec cc "$@"'
    monkeypatch.setenv("CC", script(tmp_path / "cc", text))
    kernel = eomgen.build("one_link")
    expected = kernel.energy(Q, V)
    for _ in range(2):
        refused(BuildError, "no room for vectors", kernel.energy, MANY, V)
    assert np.array_equal(kernel.energy(Q, V), expected)
    assert not kernel._bound["energy"].takes_many  # type: ignore[attr-defined]


def test_a_half_that_computes_something_else_is_refused(
    empty_cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    change = "s/0\\.3333333333333333\\b/0.33333334/"
    text = f"""
for word in "$@"; do case "$word" in */one_link_batch.c) sed -i '{change}' "$word";; esac; done
exec cc "$@\""""
    monkeypatch.setenv("CC", script(tmp_path / "cc", text))
    kernel = eomgen.build("one_link")
    kernel.mass_matrix(Q)
    with pytest.raises(BuildError, match="compute something else than their equations: mass_matrix_batch returns"):
        kernel.mass_matrix(MANY)


def test_threads_build_a_half_once(compiled: Compiled) -> None:
    kernel, found = eomgen.build("one_link"), dict[int, Any]()
    begin = threading.Barrier(6)

    def ask(number: int) -> None:
        begin.wait()
        found[number] = kernel.energy(MANY if number % 2 else MANY[3], V)

    with ThreadPoolExecutor(6) as pool:
        list(pool.map(ask, range(6)))
    assert sorted(compiled.new()) == ["batches", "singles"]
    assert all(np.array_equal(found[number], found[1] if number % 2 else found[1][3]) for number in range(6))


def test_copies_have_both_halves(built: Build) -> None:
    kernel = built(eomgen.load_robot("one_link"))
    kernel.parameters[STIFFNESS] = 7.0
    expected = kernel.residual(MANY, V, V, V)
    again = pickle.loads(pickle.dumps(kernel))
    assert again.parameters[STIFFNESS] == 7.0
    assert np.array_equal(again.residual(MANY[9], V, V, V), expected[9])
    assert np.array_equal(again.residual(MANY, V, V, V), expected)
    function: RawFunction = again.raw.function("residual")
    assert function.address() != function.address(batch=True)


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


@pytest.mark.soak
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
