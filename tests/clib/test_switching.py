"""Automatic stiffness switching in the C library: the choices of the class that Python's integrations switch by."""

from __future__ import annotations

import subprocess
from pathlib import Path

import numpy as np
import pytest

from eomgen.runtime.stepping.alternation import COST, Alternation, Turn
from eomgen.runtime.stepping.options import ADAPTIVE

from .test_library import HERE, LIBRARY, WARNINGS


@pytest.fixture(scope="module")
def switching(tmp_path_factory: pytest.TempPathFactory) -> Path:
    program = tmp_path_factory.mktemp("switching") / "switching"
    command = ["gcc", *WARNINGS, "-O0", f"-I{LIBRARY}", str(HERE / "switching.c"), "-o", str(program)]
    subprocess.run(command, check=True)
    return program


@pytest.mark.parametrize("seed", range(4))
def test_c_chooses_as_python_does(seed: int, switching: Path) -> None:
    """Random turns, in which the worth of both methods changes, lead to the same methods for as many steps."""
    rng = np.random.default_rng(seed)
    model, turns = Alternation(), []
    expected = [(model.method, model.steps)]
    for k in range(300):
        stiff = (k // 60) % 2 == 1
        steps = int(rng.integers(1, model.steps + 1))
        length = rng.uniform(0.5, 1.5) * (0.2 if stiff and model.method == "tsit5" else 1.0)
        turns.append((steps, float(steps * length)))
        model.took(Turn(*turns[-1], 0, COST[model.method] * steps))
        expected.append((model.method, model.steps))
    text = "".join(f"{steps} {time!r}\n" for steps, time in turns)
    said = subprocess.run([str(switching)], input=text, capture_output=True, text=True, check=True).stdout
    found = [tuple(map(int, line.split())) for line in said.splitlines()]
    assert found == [(ADAPTIVE[method], steps) for method, steps in expected]
    assert {method for method, _ in expected} == {"rosenbrock", "tsit5"}
    assert max(steps for _, steps in expected) > 24 * 8
