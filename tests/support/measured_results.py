"""Results of measurements, one of each kind, by the names that files give the kinds."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from tests.support.kept_files import MEASURED, kept_result


def _result(kind: str, _: Path) -> Any:
    return kept_result(kind)


RESULTS: dict[str, Callable[[Path], Any]] = {kind: partial(_result, kind) for kind in MEASURED}
