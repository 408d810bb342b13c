"""Processors that tests pretend to have, and levels that this one has."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import pytest

from eomgen.codegen.package.compile import processor
from eomgen.runtime import levels

PROCESSORS: Mapping[str, frozenset[str]] = {
    "old": frozenset(("sse4_2", "popcnt")),
    "avx2": frozenset(("adx", *levels.NEEDS["v3"])),
    "avx512": frozenset(("adx", *levels.NEEDS["v4"])),
}
needs_levels = pytest.mark.skipif(len(levels.machine_levels()) == 1, reason="this machine's type has no levels")


def pretend(monkeypatch: pytest.MonkeyPatch, processor: str) -> None:
    """Let this process think that it runs on another processor."""
    monkeypatch.setattr(levels, "_features", lambda: PROCESSORS[processor])


def skip_without(flags: Collection[str]) -> None:
    """Skip a test whose code, compiled with these flags, has instructions that this processor lacks."""
    for flag, need in {"-mavx2": "avx2", "-mavx512f": "avx512f"}.items():
        if flag in flags and need not in processor().split():
            pytest.skip(f"this processor knows no {flag}")
