"""Options of pytest, which it looks for here whatever paths a command line names."""

from __future__ import annotations

from collections.abc import Generator
from pathlib import Path

import pytest

from tests.support.workers import available_memory, workers_by_memory


def pytest_addoption(parser: pytest.Parser) -> None:
    """Let ``make soak`` name the page that a whole run writes."""
    parser.addoption("--soak-page", type=Path, help="write the outcome of the run into this page")


@pytest.hookimpl(wrapper=True, optionalhook=True)
def pytest_xdist_auto_num_workers() -> Generator[None, int, int]:
    """With ``-n auto``, start as many workers as there are cores and as the available memory is enough for."""
    cores = yield
    workers, reason = workers_by_memory(cores, available_memory())
    if reason:
        print(reason, flush=True)
    return workers


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """With ``-m quick``, import those test modules alone that have such tests."""
    asked = config.option.markexpr
    if "quick" not in asked.split() or "not quick" in asked or not collection_path.match("test_*.py"):
        return None
    return "pytest.mark.quick" not in collection_path.read_text(encoding="utf-8") or None
