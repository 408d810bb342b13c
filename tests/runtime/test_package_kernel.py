"""The kernel of a generated package: the same numbers as eomgen's kernel, from fewer files."""

from __future__ import annotations

import importlib
import pickle
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen.codegen.package.compile import CARRIED_WITH, carried_files
from eomgen.description.load import robot_from_toml
from eomgen.pipeline.options import Options
from eomgen.runtime.levels import BASE
from tests.support.sliders import on_rail

LAW = 'friction = { model = "lugre", coulomb = 1.0, bristle_stiffness = 1e3 }'  # with a state
ROBOTS = {"link": eomgen.load_robot("one_link"), "bars": eomgen.load_robot("four_bar")}
ROBOTS["rail"] = robot_from_toml(on_rail(LAW))
SPECIAL = {
    "link": set[str](),
    "bars": {"loop_errors"},
    "rail": {"internal_states", "parameter_conditions"},
}  # modules that they need


@pytest.fixture(scope="module", params=list(ROBOTS))
def kernels(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[tuple[Any, eomgen.Kernel]]:
    """The kernel of a package, imported, and eomgen's of the same C."""
    robot = replace(ROBOTS[request.param], name=f"packaged_{request.param}")  # a module's name in this process
    folder = tmp_path_factory.mktemp("package")
    eomgen.generate(robot, folder, Options(flags=("-O0",), levels=(BASE,)))
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(folder))
        package = importlib.import_module(robot.name)
        yield package.kernel, eomgen.Kernel(package.kernel.raw.libraries)


def errors(kernel: Any) -> Any:
    """The errors of the kernel's package."""
    return importlib.import_module(f"{kernel.name}.errors")


def random_arrays(kernel: Any, labels: tuple[str, ...]) -> dict[str, np.ndarray[Any, Any]]:
    rng = np.random.default_rng(1)
    return {x: 0.1 * rng.standard_normal(kernel.raw.shapes[x]) for x in labels}


def test_functions_are_methods_with_the_numbers_of_eomgens(kernels: tuple[Any, eomgen.Kernel]) -> None:
    small, whole = kernels
    seen = 0
    for name, function in small.raw.functions.items():
        owner = whole if hasattr(type(whole), name) else whole.functions
        if function.closes or not hasattr(type(owner), name):
            continue
        frame = {"frame": small.frames[0]} if function.is_framed else {}
        arrays = random_arrays(small, function.arguments)
        z = {"z": random_arrays(small, ("z",))["z"]} if "z" in function.reads else {}
        expected = getattr(owner, name)(*arrays.values(), **frame, **z)
        assert np.array_equal(getattr(small, name)(*arrays.values(), **frame, **z), expected), name
        seen += 1
    assert seen > 10
    assert {"mass_matrix", "rollout", "parameters", "replaced"} < set(dir(small))
    assert not {name for name in dir(small) if name.startswith("tree_")}


def test_rollouts_are_those_of_eomgens_kernel(kernels: tuple[Any, eomgen.Kernel]) -> None:
    small, whole = kernels
    q, v = whole.home, np.zeros(small.n)
    for method in ("rk4", "implicit"):
        for arrays in ((q, v), (np.stack([q, q]), v)):
            found = small.rollout(*arrays, dt=1e-4, steps=20, every=5, method=method)
            expected = whole.rollout(*arrays, dt=1e-4, steps=20, every=5, method=method)
            assert all(np.array_equal(x, y) for x, y in zip(found, expected, strict=True))
            if small.internal_states:
                assert np.array_equal(found.z, expected.z)
    with pytest.raises(errors(small).InputError, match="method 'tsit5' is unknown; allowed: rk4, implicit"):
        small.rollout(q, v, dt=1e-3, steps=2, method="tsit5")
    with pytest.raises(errors(small).InputError, match="rollout: "):
        small.rollout(q, np.full(small.n, 1e200), dt=1.0, steps=3)


def test_packages_carry_modules_for_what_their_robots_have(kernels: tuple[Any, eomgen.Kernel]) -> None:
    small, _ = kernels
    assert CARRIED_WITH.keys() < carried_files().keys()
    root = Path(str(sys.modules[small.name].__file__)).parent
    special = {Path(place).stem for place in CARRIED_WITH if (root / place).exists()}
    assert special == {"many_steps", "rollouts"} | SPECIAL[small.name.removeprefix("packaged_")]


def test_what_a_package_has_not_is_no_attribute(kernels: tuple[Any, eomgen.Kernel]) -> None:
    small, _ = kernels
    for name in ("jvp", "inverse_kinematics", "rollout_gradient", "christoffel", "assemble"):
        assert not hasattr(small, name)
    with pytest.raises(AttributeError, match="'PackageKernel' object has no attribute 'christoffel'"):
        _ = small.christoffel
    with pytest.raises(errors(small).ArrayError, match="q: expected float64 of shape"):
        small.mass_matrix(np.zeros(small.n + 1))
    with pytest.raises(errors(small).UnknownNameError, match="gone"):
        small.parameters.update({"gone": 1.0})


def test_copies_are_separate_and_pickles_ask_for_the_package(kernels: tuple[Any, eomgen.Kernel]) -> None:
    small, _ = kernels
    name = next(iter(small.parameters))
    other = small.replaced(parameters={name: 0.5})
    assert (other.parameters[name], small.parameters[name]) == (0.5, 0.0)
    again = pickle.loads(pickle.dumps(other))
    assert type(again) is type(small)
    assert dict(again.parameters) == dict(other.parameters)


def test_files_of_a_package_are_few(tmp_path: Path) -> None:
    """Neither derivatives nor adaptive steps, inverse kinematics or loops that are assembled are carried."""
    package = eomgen.generate("one_link", tmp_path, Options(flags=("-O0",), levels=(BASE,)))
    carried = {path.relative_to(package).as_posix() for path in package.rglob("*.py")}
    assert {"runtime/calls.py", "runtime/many_steps.py", "runtime/compiled_kernel.py"} < carried
    assert len(carried) == 16
    files = [path for path in package.rglob("*") if path.suffix in (".py", ".c", ".h", ".json")]
    assert sum(path.read_text(encoding="ascii").count("\n") for path in files) <= 7500
