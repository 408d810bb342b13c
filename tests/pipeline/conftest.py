"""Tests of builds: as users build."""

import pytest


@pytest.fixture(scope="module")
def without_wrappers() -> None:
    """Wrappers in C are compiled here."""
