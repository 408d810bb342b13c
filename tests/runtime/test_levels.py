"""Levels of processors: which ones run here, and which one is taken."""

from __future__ import annotations

from pathlib import Path

import pytest

from eomgen.errors import BuildError, InputError
from eomgen.runtime import levels
from tests.support.processors import PROCESSORS, needs_levels, pretend
from tests.support.refusals import refused

pytestmark = pytest.mark.quick


@needs_levels
@pytest.mark.parametrize(("processor", "known"), [("old", "v1"), ("avx2", "v1 v3"), ("avx512", "v1 v3 v4")])
def test_a_processor_runs_what_it_has_instructions_for(
    processor: str, known: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    pretend(monkeypatch, processor)
    monkeypatch.delenv(levels.VARIABLE, raising=False)
    assert levels.supported() == levels.allowed_levels() == tuple(known.split())
    assert levels.best_level() == known.split()[-1]


@needs_levels
@pytest.mark.parametrize("missing", ["fma", "avx2", "movbe", "avx512dq"])
def test_every_feature_of_a_level_counts(missing: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(levels, "_features", lambda: PROCESSORS["avx512"] - {missing})
    assert levels.supported()[-1] == ("v3" if missing == "avx512dq" else "v1")
    said = f"level: 'v4' is beyond this processor, which lacks {missing};"
    refused(InputError, said, levels.check_level, "v4", "level")


def test_machines_without_levels_have_the_base(monkeypatch: pytest.MonkeyPatch) -> None:
    for system in ("darwin", "win32"):
        monkeypatch.setattr(levels.sys, "platform", system)
        assert levels.machine_levels() == levels.supported() == ("v1",)
        refused(InputError, r"level: 'v3' is of x86-64 on Linux, .*; allowed: v1$", levels.check_level, "v3", "level")


def test_what_the_system_says_of_its_processor() -> None:
    """This very one: base first, in the order of LEVELS."""
    found = levels.supported()
    assert found == levels.LEVELS[: len(found)]
    assert found[0] == levels.BASE


@needs_levels
def test_the_variable_is_the_highest_level_to_be_used(monkeypatch: pytest.MonkeyPatch) -> None:
    pretend(monkeypatch, "avx2")
    for highest, known in (("", "v1 v3"), ("v3", "v1 v3"), ("v1", "v1")):
        monkeypatch.setenv(levels.VARIABLE, highest)
        assert levels.allowed_levels() == tuple(known.split())
    assert levels.best_level(("v1", "v4")) == "v1"
    with pytest.raises(BuildError, match="the compiled code is for processors of level v3, v4; allowed here: v1"):
        levels.best_level(("v3", "v4"))
    for wrong, reason in (("v4", "is beyond this processor, which lacks avx512f, avx512bw,"), ("avx", "is unknown")):
        monkeypatch.setenv(levels.VARIABLE, wrong)
        refused(InputError, rf"\$EOMGEN_LEVEL: '{wrong}' {reason}.*; allowed: v1, v3$", levels.best_level)


@needs_levels
def test_folders_of_binaries(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Those of the best level that is there and runs here; none where that is the package's own folder."""
    pretend(monkeypatch, "avx512")
    monkeypatch.delenv(levels.VARIABLE, raising=False)
    assert levels.binary_folders(tmp_path, "v1") == []
    for level in ("v3", "v4"):
        (tmp_path / level).mkdir()
        assert levels.binary_folders(tmp_path, "v1") == [str(tmp_path / level)]
    assert levels.binary_folders(tmp_path, "native") == []
    pretend(monkeypatch, "old")
    assert levels.binary_folders(tmp_path, "v1") == []
    refused(BuildError, "level v4; allowed here: v1", levels.binary_folders, tmp_path / "v4", "v4")
