"""Every public function, with things of all kinds for each argument that it needs: it works, or refuses by name."""

from __future__ import annotations

import importlib
import inspect
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen.errors import InputError
from eomgen.sweep import plan_from_toml
from tests.support.optional import needs
from tests.support.soak import soaked
from tests.support.text_files import text_file

pytestmark = [pytest.mark.usefixtures("unoptimised"), pytest.mark.filterwarnings("ignore")]

PACKAGES = (
    *("eomgen", "eomgen.analysis", "eomgen.authoring", "eomgen.control", "eomgen.description", "eomgen.export"),
    "eomgen.identification",
    *("eomgen.integration", "eomgen.loops", "eomgen.motion", "eomgen.pictures", "eomgen.robot", "eomgen.scenario"),
    *("eomgen.simulation", "eomgen.state", "eomgen.sweep"),
)
PLAN = '[[vary]]\nparameter = "joints.joint1.x.stiffness"\ngrid = { values = [1e4] }\n'
SCENARIO = {"duration": 0.01, "motion": {"type": "point_to_point", "goal": {"joint1": 0.1}}}
WRITTEN = ("folder", "output")


class Thing:
    """An object of no kind that anything asks for."""


def things(folder: Path) -> dict[str, Any]:
    """Things of all kinds, none of which is a robot, a scenario, a result or a motion."""
    (folder / "empty.toml").write_text("")
    (folder / "text.csv").write_text("no, numbers\n")
    (folder / "empty.npz").write_bytes(b"")
    return {
        "a name that is none": "no_such_thing",
        "an empty text": "",
        "a folder": folder,
        "a folder's name": str(folder),
        "a missing file": folder / "missing.toml",
        "a missing result": str(folder / "missing.npz"),
        "an empty description": folder / "empty.toml",
        "a table without numbers": str(folder / "text.csv"),
        "an empty result": folder / "empty.npz",
        "an empty JSON": str(text_file(folder / "empty.json", "{}")),
        "a dict": {},
        "a dict of others": {"joint9": 1.0, 3: None},
        "an object": Thing(),
        "None": None,
        "a whole number": 3,
        "a number": -0.5,
        "no number": np.nan,
        "a truth value": True,
        "bytes": b"one_link",
        "an array": np.zeros(3),
        "an array of texts": np.array(["a", "b"]),
        "an empty list": [],
        "a list": [None, 1.0, "x"],
        "a type": Path,
        "a function": len,
    }


def functions() -> dict[str, Callable[..., Any]]:
    """Every public function by its name."""
    found: dict[str, Callable[..., Any]] = {}
    for package in PACKAGES:
        module = importlib.import_module(package)
        for name in module.__all__:
            function = getattr(module, name)
            if inspect.isfunction(function) and function not in found.values():
                found[f"{package}.{name}"] = function
    return found


def needed(function: Callable[..., Any]) -> list[str]:
    """Names of the arguments that a function needs."""
    many = (inspect.Parameter.VAR_KEYWORD, inspect.Parameter.VAR_POSITIONAL)
    parameters = inspect.signature(function).parameters.values()
    return [x.name for x in parameters if x.default is x.empty and x.kind not in many]


@pytest.fixture(scope="module")
def valid() -> dict[str, Any]:
    """What arguments of these names take."""
    robot = eomgen.load_robot("one_link")
    kernel = eomgen.build(robot)
    n = kernel.n
    coordinates = kernel.coordinates
    zero = np.zeros(n)
    return {
        "robot": robot,
        "robots": {"one": robot, "two": robot},
        "given": robot,
        "subject": robot,
        "kernel": kernel,
        "q": zero,
        "v": zero,
        "q0": zero,
        "v0": zero,
        "q_guess": zero,
        "t": np.linspace(0.0, 1.0, 3),
        "duration": 0.01,
        "scenario": SCENARIO,
        "plan": plan_from_toml(PLAN),
        "coordinates": coordinates,
        "frame": "link1",
        "pose": np.eye(4),
        "poses": [zero],
        "coordinate": "joint1.gamma",
        "frames": ("link1",),
        "corner": zero,
        "first": zero,
        "second": zero,
        "force": np.zeros(3),
        "motion": np.zeros(3),
        "inputs": ["joint1.gamma"],
        "outputs": ["joint1.gamma"],
        "frequencies": [1.0],
        "label": "q",
        "value": zero,
        "path": "out.svg",
        "folder": "out",
        "output": "out",
        "text": "",
        "name": "arm",
        "source": "one_link",
        "table": "[[length]]\n",
        "convention": "modified",
        "columns": {},
        "record": {},
        "rpy": (0.0, 0.0, 0.0),
        "result": None,
        "paths": [],
        "model": None,
    }


def refusals(function: Callable[..., Any], valid: dict[str, Any], folder: Path) -> Iterator[str]:
    """Yield what a function says that is no refusal of eomgen's: the argument, the thing and the error."""
    names = needed(function)
    for name in names:
        for kind, thing in things(folder).items():
            if name in WRITTEN and isinstance(thing, (str, Path)):  # which is where a file may be
                continue
            arguments = {other: valid.get(other) for other in names} | {name: thing}
            try:
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore")
                    function(**arguments)
            except InputError as error:
                if len(str(error)) < 10:
                    yield f"{name}, {kind}: {type(error).__name__} says {error}"
            except Exception as error:
                yield f"{name}, {kind}: {type(error).__name__}: {str(error)[:100]}"


SLOW = {"eomgen.export_fmu"}  # whose unit is compiled; tests of units see to its refusals, too


@pytest.mark.parametrize("name", soaked(functions(), functions().keys() - SLOW))
def test_it_works_or_refuses_by_name(
    name: str, valid: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if ".pictures." in name:
        needs("matplotlib")
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "folder"
    folder.mkdir()
    wrong = list(refusals(functions()[name], valid, folder))
    assert not wrong, "\n".join(wrong)


def test_robots_in_all_forms(tmp_path: Path) -> None:
    """A Robot, a name, a path and its text are alike."""
    path = text_file(tmp_path / "robot.toml", Path(eomgen.__path__[0], "robots", "one_link.toml").read_text())
    expected = eomgen.identification.base_parameters(eomgen.load_robot("one_link"))
    for robot in ("one_link", path, str(path)):
        assert eomgen.identification.base_parameters(robot).names == expected.names


def test_an_error_of_pythons_own_is_seen(tmp_path: Path) -> None:
    def careless(result: Any) -> Any:
        return result.trajectory

    found = list(refusals(careless, {}, tmp_path))
    assert len(found) == len(things(tmp_path))
    assert all("AttributeError" in line for line in found)


def test_arguments_are_named_and_what_is_allowed_is_said() -> None:
    for call, name in (
        (lambda x: eomgen.integration.rests(x, 0, 0, 0), "kernel"),
        (eomgen.robot.robot_hash, "robot"),
        (eomgen.description.robot_from_toml, "text"),
        (lambda x: eomgen.analysis.budget(x, "one_link"), "result"),
    ):
        with pytest.raises(InputError, match=rf"^{name}: got a value of type Thing; allowed: "):
            call(Thing())
