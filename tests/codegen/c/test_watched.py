"""Locals of C that are read before they are written, memory beyond its ends, and lanes that depend on each other.

A package is compiled twice: with locals filled by zeros, and with locals filled by a pattern and with sanitizers.  Both
move the same states in every way, and no bit differs, between both or between a state alone and in a batch.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import eomgen
from eomgen.codegen.c.source import Source
from eomgen.codegen.c.sources import render
from eomgen.codegen.kernels.equations import derive_equations
from eomgen.codegen.package.compile import carried_contents, compile_flags, find_compiler, write_package
from eomgen.description.builtin import builtin_robots
from eomgen.pipeline.cache import write_files
from eomgen.robot.model import Model, build_model
from eomgen.robot.value import Coordinate, Friction, Robot
from eomgen.runtime.levels import supported
from tests.oracles.force_laws import with_laws
from tests.oracles.journals import random_journals
from tests.support import watched_calls
from tests.support.makers import MAKERS
from tests.support.random_robots import random_robot
from tests.support.small_robots import free_body
from tests.support.soak import WHOLE, share, soaked

FILLED = "-ftrivial-auto-var-init"
SANITIZERS = ("-g1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all", "-fno-omit-frame-pointer")
MOVING = ("forward_dynamics", "rollout", "adaptive_rollout", "radau_rollout")
SLOPES = (
    "forward_dynamics_jacobian",
    "explicit_gradient",
    "implicit_gradient",
    "rosenbrock_gradient",
    "explicit_sensitivity",
    "implicit_sensitivity",
    "rosenbrock_sensitivity",
)


def tree() -> Robot:
    robot = random_robot(7, joints=(2, 2), tree=True, types=("revolute", "prismatic"), max_coordinates=2)
    return replace(with_laws(robot, 7), name="tree")


def rubbing_loop() -> Robot:
    robot = eomgen.load_robot("four_bar")
    rubbing = Coordinate(friction=Friction(coulomb=0.1, smoothing=1e-3))
    crank, *others = robot.joints
    return replace(robot, name="rubbing_loop", joints=(replace(crank, coordinates={"gamma": rubbing}), *others))


def free_joint() -> Robot:
    return random_robot(5, joints=(1, 1), types=("free",), max_coordinates=3, name="free_joint")


def contacts() -> Robot:
    robot = random_robot(3, joints=(1, 1), types=("revolute",), max_coordinates=6, name="contacts")
    return replace(random_journals(robot, 3), name="contacts")


QUICK: dict[str, Callable[[], Robot]] = {
    "tree": tree,
    "bennett": partial(eomgen.load_robot, "bennett"),
    "rubbing_loop": rubbing_loop,
    "free_joint": free_joint,
    "free_body": free_body,
    "contacts": contacts,
}
SLOW = (  # minutes to hours with sanitizers: many coordinates, or stiff where steps are explicit
    "andrews",
    "delta",
    "gough",
    "hexapod_elastic",
    "puma560_elastic",
    "two_arms",
    "worn_arm",
    "balanced_arm",
)
SOAK: dict[str, tuple[Callable[[], Robot], tuple[str, ...]]] = {
    f"{name}, as built in": (partial(eomgen.load_robot, name), ())
    for name in builtin_robots()
    if name not in MAKERS and (WHOLE or name not in SLOW)
}
SOAK |= {f"{name}, differentiated": (make, SLOPES) for name, make in QUICK.items() if not name.startswith("free")}


def states_of(model: Model) -> dict[str, np.ndarray]:
    """Seven states near home, ever faster and under ever greater drives, (7, n): their steps end at different times."""
    rng, n = np.random.default_rng(6), model.size
    speeds, forces = np.logspace(-1.0, 1.0, 7)[:, np.newaxis], np.logspace(0.0, 3.0, 7)[:, np.newaxis]
    driven = np.isin(np.arange(n), model.driven)
    q = np.array([*model.home, *(0.0 for _ in model.memory)]) + 0.02 * rng.normal(size=(7, n))
    v = speeds * rng.normal(size=(7, n))
    v[:, len(model.coordinates) :] *= 1e-3  # states of laws: bristles are short
    return {"q": q, "v": v, "u": driven * forces * rng.normal(size=(7, 1))}


def moved(source: Source, model: Model, folder: Path, flags: tuple[str, ...]) -> dict[str, np.ndarray]:
    """What a package that is compiled with the flags makes of the states, in a process of its own."""
    (folder / source.name).mkdir(parents=True)
    compiler, level = replace(find_compiler(), flags=("-O0", *flags)), supported()[-1]
    try:
        subprocess.run([*compiler.command, *flags, "-E", "-x", "c", os.devnull], check=True, capture_output=True)
    except subprocess.CalledProcessError:
        pytest.skip("this compiler fills no locals")
    write_package(source, compiler, compile_flags(compiler, False, (), level), folder / source.name, level)
    write_files(folder / source.name, carried_contents())
    np.savez(folder / watched_calls.STATES, **states_of(model))
    environment, results = {**os.environ, "ASAN_OPTIONS": "detect_leaks=0"}, folder / "results.npz"
    if SANITIZERS[1] in flags:
        which = [*compiler.command, "-print-file-name=libasan.so"]
        library = subprocess.run(which, check=True, capture_output=True, text=True).stdout.strip()
        environment |= {"LD_PRELOAD": library, "PYTHONMALLOC": "malloc"}
    command = [sys.executable, watched_calls.__file__, str(folder), source.name, str(results)]
    result = subprocess.run(command, capture_output=True, text=True, check=False, env=environment, cwd=folder)
    assert result.returncode == 0, result.stderr[-6000:]
    with np.load(results) as found:
        return dict(found)


def check_filled(source: Source, model: Model, folder: Path, flags: tuple[str, ...]) -> None:
    """Move the same states with locals filled by zeros and by a pattern, this with further flags, and compare bits."""
    expected = moved(source, model, folder / "zeros", (f"{FILLED}=zero", "-w"))
    found = moved(source, model, folder / "pattern", (f"{FILLED}=pattern", *flags))
    assert found.keys() == expected.keys()
    assert len(found) >= 9
    different = [key for key, x in found.items() if not np.array_equal(x, expected[key], equal_nan=True)]
    assert not different


@pytest.mark.skipif(sys.platform != "linux", reason="sanitizers are preloaded as Linux has it")
@pytest.mark.parametrize("name", soaked(share((*QUICK, *SOAK), 6), ()))
def test_nothing_is_read_before_it_is_written(name: str, tmp_path: Path) -> None:
    """Steps, their derivatives and accelerations: no byte out of bounds, no undefined value, no lane by another."""
    make, further = (QUICK[name], ()) if name in QUICK else SOAK[name]
    model = build_model(make())
    source = render(derive_equations(model, (*MOVING, *further)), "float64")
    check_filled(source, model, tmp_path, SANITIZERS)


@pytest.mark.soak
def test_a_local_that_is_not_written_is_seen(tmp_path: Path) -> None:
    model = build_model(eomgen.load_robot("one_link"))
    source = render(derive_equations(model, MOVING), "float64")
    empty = r"    double sine[PADDED(\1)], cosine[PADDED(\1)];"  # of angles of which nobody takes the sine
    broken = replace(source, code=re.sub(r"^ *TURN\((\d+), .*\);$", empty, source.code, flags=re.M))
    assert broken.code != source.code
    with pytest.raises(AssertionError):
        check_filled(broken, model, tmp_path, ("-w",))
