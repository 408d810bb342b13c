"""The source distribution and the wheel, built once for all tests of them."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.support.archives import build_archives


@pytest.fixture(scope="session")
def archives(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    return build_archives(tmp_path_factory.mktemp("tree") / "eomgen", tmp_path_factory.mktemp("dist"))
