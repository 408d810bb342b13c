"""The example of a control loop: the program in C against the same loop in Python, and what makes it fail."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from tests.support.c_project import need, search_path

pytestmark = pytest.mark.usefixtures("unoptimised")

EXAMPLE = Path(__file__).parents[2] / "examples" / "control_loop"
WRONG = {  # in controller.c
    "feedback with the wrong sign": ("at[i] - c->observer.q[motors[i]]", "c->observer.q[motors[i]] - at[i]"),
    "motors that follow as if gears were rigid": ("error = at[i] -", "error = ratio * series[i] -"),
    "no damping": ("kd * slower", "0.0 * slower"),
    "a filter without torques": ("held[motors[i]] = c->u[i]", "held[motors[i]] = 0.0"),
    "a filter without readings": ("ur5_model_observer_update(&c->observer, y)", "0.0 * y[0]"),
    "a reference that is late": ("reference(++c->sample", "reference(c->sample++"),
}


@pytest.fixture(scope="module")
def example() -> Iterator[ModuleType]:
    """build.py, imported as when it is run: its neighbours are found, and forgotten again."""
    sys.path.insert(0, str(EXAMPLE))
    try:
        import build

        yield build
    finally:
        sys.path.remove(str(EXAMPLE))
        for name in ("build", "loop", "task"):
            sys.modules.pop(name, None)


@pytest.fixture(scope="module")
def out(example: ModuleType, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with what is generated, and CMake and Ninja that are found."""
    need("cmake", "ninja", "cc")
    folder = tmp_path_factory.mktemp("control_loop")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PATH", search_path())
        patch.setenv("CMAKE_GENERATOR", "Ninja")
        example.generated(folder / "generated")
    return folder


def run(program: Path, *words: str | Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run([program, *words], capture_output=True, text=True, check=False)
