"""A build goes through the packages of the generator in their order."""

from __future__ import annotations

import sys
from pathlib import Path
from types import FrameType
from typing import Any

import pytest

import eomgen
from eomgen.pipeline import cache
from tests.support.quick_builds import answer, python

RETURNS = 10  # at most, to packages that the build had left


def entered(name: str) -> str:
    """The package of a module: a folder of eomgen, or of its generator; none of the modules that all packages use."""
    parts = name.split(".")
    depth = 3 if parts[1:2] == ["codegen"] else 2
    is_package = hasattr(sys.modules[name], "__path__")
    return ".".join(parts[:depth]) if len(parts) > depth or (len(parts) == depth and is_package) else ""


@pytest.mark.quick
def test_an_uncached_build_returns_to_few_packages_that_it_had_left(empty_cache: Path) -> None:
    """In the order in which its modules are first called; they were imported by an earlier build."""
    eomgen.build("one_link", kernels=("mass_matrix",), flags=("-O0",)).mass_matrix([0.1, 0.2])
    robot, modules = eomgen.load_robot("ur5"), dict[str, None]()

    def note(frame: FrameType, event: str, argument: Any) -> None:
        name = frame.f_globals.get("__name__", "")
        if event == "call" and name.startswith("eomgen."):
            modules.setdefault(name)

    before = sys.getprofile()
    sys.setprofile(note)
    try:
        kernel = eomgen.build(robot, kernels=("mass_matrix",), flags=("-O0",))
    finally:
        sys.setprofile(before)
    assert kernel.n == 6
    packages = [package for package in map(entered, modules) if package]
    way = [package for package, last in zip(packages, ["", *packages], strict=False) if package != last]
    assert {"eomgen.pipeline", "eomgen.robot", "eomgen.codegen.tree", "eomgen.codegen.c"} <= set(way)
    assert len(way) - len(set(way)) <= RETURNS, way


def test_entries_of_another_version_are_never_loaded(empty_cache: Path) -> None:
    """Every kind of entry that a build with an adaptive rollout makes has another key."""
    code = """
    import eomgen._version
    eomgen._version.__version__ = {version!r}
    import json, eomgen
    kernel = eomgen.build("one_link", kernels=("adaptive_rollout",), flags=("-O0",))
    print(json.dumps(eomgen.__version__))
    """
    keys = []
    for version in ("0.0.1", "0.0.2"):
        assert answer(python(code.format(version=version))) == version
        keys.append({(kind, key) for kind, key, _ in cache.contents()})
    earlier, later = keys[0], keys[1] - keys[0]
    assert {kind for kind, _ in earlier} == {"derivations", "extensions", "libraries", "packages", "sources"}
    assert sorted(kind for kind, _ in later) == sorted(kind for kind, _ in earlier)
