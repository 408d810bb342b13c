"""A compile cache of the tests' own, and kernels that are built quickly."""

from __future__ import annotations

import gc
import os
import shutil
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

import eomgen
from eomgen.pipeline import direct_calls
from eomgen.pipeline.cache import VARIABLE
from eomgen.pipeline.generator_key import generator_hash
from eomgen.robot.value import Robot
from tests.support.builds import Build
from tests.support.figures import Figure, Figures, gathered, lines
from tests.support.optional import needs
from tests.support.quick_builds import one_link, without_headers
from tests.support.soak import left_out
from tests.support.soak_page import FailuresAtOnce, write_soak_page

ALL = ("all",)
BEGAN = time.monotonic()


def pytest_configure(config: pytest.Config) -> None:
    """Keep out of the user's cache; pytest-xdist's workers and later runs share what was compiled."""
    root = Path(config.rootpath, ".pytest_cache", "eomgen")
    root.mkdir(parents=True, exist_ok=True)
    here = root / generator_hash()[:16]
    here.mkdir(exist_ok=True)
    here.chmod(0o700)  # whatever the umask is: a cache that others may write to is refused
    for other in root.iterdir():  # of a generator that has changed since
        if other != here and other.stat().st_mtime < time.time() - 86400:
            shutil.rmtree(other, ignore_errors=True)
    os.environ[VARIABLE] = str(here)
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)  # compiling eomgen is half of the time of each process of a test
    sys.dont_write_bytecode = False
    if config.getoption("--soak-page") is not None and not hasattr(config, "workerinput"):
        config.pluginmanager.register(FailuresAtOnce(root.parent / "soak_failures.txt"))
    gc.set_threshold(100_000, 20, 20)  # SymPy's caches and many modules make every search for cycles long


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Of each test that the soak runs with many cases, keep some; a case that is named or selected with -k is kept."""
    if omitted := left_out(items):
        config.hook.pytest_deselected(items=[*omitted])
        items[:] = [item for item in items if item not in omitted]


@pytest.fixture(scope="session", autouse=True)
def _extension() -> None:
    """Calls of this process go through the extension module, whatever headers and compilers a test pretends."""
    direct_calls.begin()
    direct_calls.settle()


@pytest.fixture(scope="module")
def without_wrappers() -> Iterator[None]:
    """Builds of a module in this process have no wrapper in C, which takes half of the time of an unoptimised one.

    Calls go through the extension module all the same.  Modules that ask for ``built`` or ``unoptimised`` get this;
    tests of what users build have a fixture of this name that does nothing, see pipeline/conftest.py.
    """
    with pytest.MonkeyPatch.context() as patch:
        without_headers(patch)
        yield


@pytest.fixture(scope="module")
def built(without_wrappers: None) -> Build:
    """``built(robot, kernel names..., options)``: a kernel of its own, compiled without optimisation.

    The C may not contract or reorder anything, so the level changes no result; the optimiser takes most of the time.
    Without names each kernel is built when it is first called.  "all" builds all of them in one library.
    """

    def build(robot: Robot, *kernels: str, **options: object) -> eomgen.Kernel:
        with pytest.MonkeyPatch.context() as patch:
            if "flags" not in options:
                patch.setenv("CFLAGS", "-O0")  # as ``unoptimised`` does
            return eomgen.build(robot, kernels="all" if kernels == ALL else kernels, **options)  # type: ignore[arg-type]

    return build


@pytest.fixture(scope="module")
def unoptimised(without_wrappers: None) -> Iterator[None]:
    """Builds of a module's fixtures and tests, in other processes too, without the optimiser, for the reason above."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("CFLAGS", "-O0")
        yield


@pytest.fixture
def empty_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A cache folder that nothing was built into."""
    folder = tmp_path / "cache"
    monkeypatch.setenv(VARIABLE, str(folder))
    return folder


@pytest.fixture(scope="session")
def _one_link_cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("filled") / "cache"
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(VARIABLE, str(folder))
        one_link()
    return folder


@pytest.fixture
def filled_cache(_one_link_cache: Path, empty_cache: Path) -> Path:
    """A cache folder that ``one_link`` was built into, and nothing else."""
    shutil.copytree(_one_link_cache, empty_cache)
    return empty_cache


@pytest.fixture
def doubles() -> Iterator[None]:
    """JAX with numbers of double precision."""
    jax = needs("jax")
    jax.config.update("jax_enable_x64", True)
    yield
    jax.config.update("jax_enable_x64", False)


@pytest.fixture
def figures(record_property: Callable[[str, object], None]) -> Figures:
    """Counts and worst deviations of a test, which a run of soak tests prints at its end."""
    recorded: dict[str, Figure] = {}
    record_property("figures", recorded)
    return Figures(recorded)


def pytest_terminal_summary(terminalreporter: Any, exitstatus: pytest.ExitCode, config: pytest.Config) -> None:
    """Figures of all tests of a name together, whatever workers they ran on; quick runs do not show them."""
    if "not soak" in terminalreporter.config.option.markexpr:
        return
    reports = [report for status in ("passed", "failed") for report in terminalreporter.stats.get(status, ())]
    for name, figures_of_test in gathered(reports).items():
        terminalreporter.write_sep("-", name)
        terminalreporter.write_line("\n".join(lines(figures_of_test)))
    page, ended = config.getoption("--soak-page"), (pytest.ExitCode.OK, pytest.ExitCode.TESTS_FAILED)
    gathers = not hasattr(config, "workerinput")  # xdist's workers know their own share alone
    if page is not None and exitstatus in ended and gathers:  # one that was interrupted leaves the page as it was
        processes = getattr(config.option, "numprocesses", None) or 1
        write_soak_page(Path(config.rootpath, page), terminalreporter.stats, time.monotonic() - BEGAN, processes)
