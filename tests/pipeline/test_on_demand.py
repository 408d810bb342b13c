"""Kernels that are compiled when they are first called, work that begins ahead, threads without denormal numbers."""

from __future__ import annotations

import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import eomgen
from eomgen.codegen.c.library import SETUP_ONLY
from eomgen.errors import BuildError, UnknownNameError
from eomgen.pipeline import cache
from eomgen.pipeline.ahead import Ahead, build_function
from tests.support.builds import Build
from tests.support.optional import OptionalModule
from tests.support.quick_builds import logging_compiler, script
from tests.support.random_robots import random_robot
from tests.support.refusals import refused

Q, V = np.array([0.2, 0.5]), np.array([-0.3, 0.1])
pytestmark = pytest.mark.usefixtures("unoptimised")


def packages() -> int:
    return sum(kind == "packages" for kind, _, _ in cache.contents())


@pytest.mark.usefixtures("empty_cache")
def test_only_what_is_called_is_built() -> None:
    steps: list[str] = []
    kernel = eomgen.build("one_link", progress=steps.append)
    assert not steps
    assert not cache.contents()
    assert "mass_matrix" in kernel.operations
    assert "mass_matrix" in kernel.raw.functions
    kernel.mass_matrix(Q)
    assert [step.split()[0] for step in steps] == ["deriving", "compiling"]
    kernel.mass_matrix(Q)
    kernel.replaced().mass_matrix(Q)
    assert (packages(), len(steps)) == (1, 2)
    kernel.frame_pose(Q, "link1")
    kernel.frame_jacobian(Q, "link1")
    assert packages() == 2


@pytest.mark.soak
@pytest.mark.usefixtures("empty_cache")
def test_operations_are_counted_without_a_compiler() -> None:
    kernel, whole = eomgen.build("one_link"), eomgen.build("one_link", kernels="all")
    before = packages()
    assert {name: kernel.operations[name] for name in whole.operations if name != "parameters"} == {
        name: count for name, count in whole.operations.items() if name != "parameters"
    }
    assert kernel.operations["parameters"] == whole.operations["parameters"]
    assert packages() == before


@pytest.mark.soak
def test_results_are_those_of_all_kernels_in_one_library(built: Build) -> None:
    robot = random_robot(17, joints=(2, 2))
    apart, whole = built(robot), built(robot, "energy", "residual", "rollout")
    rng = np.random.default_rng(0)
    for name in ("energy", "residual"):
        function = whole.raw.functions[name]
        arrays = [rng.uniform(-0.4, 0.4, whole.raw.shapes[label]) for label in function.reads]
        assert np.array_equal(apart.calls.run(name, None, arrays), whole.calls.run(name, None, arrays)), name
    states = rng.uniform(-0.1, 0.1, (3, whole.n))
    ends = [kernel.rollout(*states, 1e-3, 5, method="implicit") for kernel in (apart, whole)]
    assert np.array_equal(*ends)


def test_an_assignment_reaches_all_libraries(built: Build) -> None:
    kernel = built(eomgen.load_robot("one_link"))
    other = kernel.replaced()
    before = kernel.inverse_dynamics(Q, V, V), kernel.residual(Q, V, V, V)
    kernel.parameters["joints.joint1.x.stiffness"] = 7.0
    after = kernel.inverse_dynamics(Q, V, V), kernel.residual(Q, V, V, V)
    assert all((x != y).any() for x, y in zip(before, after, strict=True))
    assert np.array_equal(after[0] - V, after[1])
    assert np.array_equal(other.inverse_dynamics(Q, V, V), before[0])


@pytest.mark.usefixtures("empty_cache")
def test_threads_that_ask_for_one_kernel_build_it_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    compiler, log = logging_compiler(tmp_path)
    monkeypatch.setenv("CC", compiler)
    kernels = [eomgen.build("one_link")] * 2 + [eomgen.build("one_link")] * 2  # two of them are the same object
    found: list[np.ndarray] = []
    begin = threading.Barrier(len(kernels))

    def ask(kernel: eomgen.Kernel) -> None:
        begin.wait()
        found.append(kernel.mass_matrix(Q))

    with ThreadPoolExecutor(len(kernels)) as pool:
        list(pool.map(ask, kernels))
    assert all(np.array_equal(x, found[0]) for x in found)
    assert len(found) == len(kernels)
    assert log.read_text().count("singles.o") <= 2  # compiled once, linked once


@pytest.mark.usefixtures("empty_cache")
def test_a_later_failure_is_said_by_the_call(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    broken = tmp_path / "broken"
    text = f'case "$*" in *--version*) ;; *) test -e {broken} && {{ echo no room left on the moon; exit 3; }} ;; esac'
    monkeypatch.setenv("CC", script(tmp_path / "cc", text + '\nexec cc "$@"'))
    kernel = eomgen.build("one_link")
    kernel.mass_matrix(Q)
    broken.touch()
    refused(BuildError, "no room left on the moon", kernel.energy, Q, V)
    kernel.mass_matrix(Q)
    broken.unlink()
    assert kernel.energy(Q, V).shape == (2,)


@pytest.mark.usefixtures("empty_cache")
def test_the_environment_is_that_of_the_build(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    compiler, log = logging_compiler(tmp_path)
    monkeypatch.setenv("CC", compiler)
    kernel = eomgen.build("one_link")
    monkeypatch.setenv("CC", "none-of-that-name")
    monkeypatch.setenv("CFLAGS", "-DLATER")
    kernel.mass_matrix(Q)
    assert "-O0" in log.read_text()
    assert "-DLATER" not in log.read_text()


@pytest.mark.usefixtures("empty_cache")
def test_a_terminal_sees_what_is_built(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    kernel = eomgen.build("one_link")
    kernel.mass_matrix(Q)
    assert capsys.readouterr().err == ""
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    kernel.energy(Q, V)
    kernel.energy(Q, V)
    assert capsys.readouterr().err == "eomgen: building energy of one_link\n"
    kernel.energy(np.array([Q, Q]), V)
    assert capsys.readouterr().err == "eomgen: building energy for batches of one_link\n"


def test_kernels_in_one_library(built: Build) -> None:
    kernel = built(eomgen.load_robot("one_link"))
    kernel.parameters["joints.joint1.x.stiffness"] = 7.0
    functions = [kernel.raw.function(name) for name in ("mass_matrix", "residual")]
    assert functions[0].library is not functions[1].library
    libraries = kernel.raw.libraries
    assert libraries.library("residual", "residual_batch") is not libraries.library("residual")
    one = kernel.replaced(together=("mass_matrix", "residual"))
    assert one.raw.function("mass_matrix").library is one.raw.function("residual").library
    assert np.array_equal(one.residual(Q, V, V, V), kernel.residual(Q, V, V, V))
    assert one.raw.source("h").count("int one_link_") < kernel.raw.source("h").count("int one_link_")
    refused(
        UnknownNameError, "'speed' is no kernel of one_link; known: mass_matrix, ", kernel.replaced, together=["speed"]
    )
    assert one.replaced(together=["mass_matrix"]).raw is one.raw


def test_work_is_done_beside_the_caller() -> None:
    met = threading.Barrier(2)
    with Ahead() as ahead:
        ahead.begin(met.wait)
        met.wait()


def test_what_has_not_begun_is_left_out() -> None:
    begun, free, seen = threading.Event(), threading.Event(), list[int]()

    def hold() -> None:
        begun.set()
        free.wait()

    with Ahead() as ahead:
        ahead.begin(hold, lambda: seen.append(1))
        begun.wait()
        threading.Timer(0.05, free.set).start()
    assert not seen


def test_work_is_done_in_its_order() -> None:
    seen, done = list[int](), threading.Event()
    with Ahead() as ahead:
        ahead.begin(lambda: seen.append(1), lambda: seen.append(2), done.set)
        assert done.wait(10)
    assert seen == [1, 2]


def test_an_exception_of_the_thread_is_raised_at_the_end_of_the_block() -> None:
    def block(error: type[Exception] | None) -> None:
        with Ahead() as ahead:
            ahead.begin(lambda: 1 // 0)
            seen.append(1)
            if error is not None:
                raise error

    seen: list[int] = []
    with pytest.raises(ZeroDivisionError):
        block(None)
    with pytest.raises(KeyError):
        block(KeyError)
    assert len(seen) == 2


@pytest.mark.usefixtures("empty_cache")
def test_a_function_is_built_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    compiler, log = logging_compiler(tmp_path)
    monkeypatch.setenv("CC", compiler)
    kernel = eomgen.build("one_link")
    with Ahead() as ahead:
        ahead.begin(*(partial(build_function, kernel, "mass_matrix", batch=batch) for batch in (False, True)))
        kernel.mass_matrix(Q)
        kernel.mass_matrix(np.array([Q]))
    lines = [line for line in log.read_text().splitlines() if f"-D{SETUP_ONLY}" not in line]
    assert [sum(f"/one_link{file} " in line for line in lines) for file in (".c", "_batch.c")] == [1, 1]


@pytest.mark.usefixtures("empty_cache")
def test_a_failure_is_said_by_who_asks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = 'case "$*" in *"/one_link.c "*) echo no room on the moon; exit 3;; esac\nexec cc "$@"'
    monkeypatch.setenv("CC", script(tmp_path / "cc", text))
    kernel, done = eomgen.build("one_link"), threading.Event()
    with Ahead() as ahead:
        ahead.begin(partial(build_function, kernel, "mass_matrix"), done.set)
        assert done.wait(60)
        refused(BuildError, "no room on the moon", kernel.mass_matrix, Q)


jax = OptionalModule("jax")


def of_jax(kernel: eomgen.Kernel) -> tuple[bool, np.ndarray]:
    """Whether JAX's thread keeps denormal numbers, and the mass matrix as it is computed there."""
    kept: list[bool] = []

    def host(q: np.ndarray) -> np.ndarray:
        kept.append(bool(np.array([5e-324])[0] * 1.0 > 0.0))
        return kernel.mass_matrix(np.asarray(q, np.float64)).astype(np.float32)

    shape = jax.ShapeDtypeStruct((kernel.n, kernel.n), np.float32)
    found = np.asarray(jax.jit(lambda q: jax.pure_callback(host, shape, q))(Q.astype(np.float32)))
    return kept[0], found


@pytest.mark.usefixtures("empty_cache")
def test_a_kernel_is_built_within_a_callback_of_jax() -> None:
    """In a thread that rounds denormal numbers to zero; the source is that of a build elsewhere."""
    kept, found = of_jax(eomgen.build("one_link"))
    if kept:
        pytest.skip("this JAX keeps denormal numbers")
    expected = eomgen.build("one_link", kernels=("mass_matrix",)).mass_matrix(Q.astype(np.float32).astype(float))
    assert np.array_equal(found, expected.astype(np.float32))
