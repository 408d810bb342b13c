"""Options of pytest, which it looks for here whatever paths a command line names."""

from __future__ import annotations

from pathlib import Path

import pytest


def pytest_addoption(parser: pytest.Parser) -> None:
    """Let ``make soak`` name the page that a whole run writes."""
    parser.addoption("--soak-page", type=Path, help="write the outcome of the run into this page")
