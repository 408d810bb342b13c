"""Numbers of options: what cannot be computed with is refused where it comes in, by all commands."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator

import numpy as np
import pytest

from eomgen.cli.entry import NAMES, main, make_parser
from eomgen.description.load import load_robot
from eomgen.errors import InputError
from eomgen.identification import calibrate, fit
from eomgen.identification.exciting.solve import excite
from eomgen.identification.tolerances.solve import tolerance
from eomgen.motion.ends import default_motion
from eomgen.motion.point_to_point import PointToPoint
from eomgen.simulation.run import simulate
from tests.support.soak import soaked

HOSTILE = ("1e300", "-1e300", "1e-300", "nan", "inf", "-inf", "1" + "0" * 400, "9" * 5000, "\x1b[2J", "", "1_0e300")
OTHER = {"port", "fmi", "kernels"}  # a port is the system's to refuse, a version one of a few, kernels are names


def options() -> Iterator[tuple[str, argparse.Action]]:
    """All options of all commands."""
    (commands,) = (x for x in make_parser(NAMES)._actions if isinstance(x, argparse._SubParsersAction))
    for name, parser in commands.choices.items():
        if name in NAMES:  # what is left are groups of the same commands
            yield from ((name, action) for action in parser._actions)


def test_all_numbers_of_options_are_bounded() -> None:
    seen = 0
    for command, action in options():
        if action.type is None or action.dest in OTHER or not action.type.__module__.startswith("eomgen"):  # type: ignore[union-attr]
            assert action.type not in (int, float) or action.dest in OTHER, (command, action.dest)
            continue
        seen += 1
        for text in HOSTILE:
            with pytest.raises(argparse.ArgumentTypeError, match="allowed") as caught:
                action.type(text)  # type: ignore[operator]
            assert str(caught.value).isprintable()
    assert seen > 40


@pytest.mark.parametrize("words", [
    ("simulate", "ur5", "--duration", "1e300"),
    ("modes", "puma560_elastic", "--along", "gone", "--points", "2147483648"),
    ("response", "puma560_elastic", "--points", "2147483648"),
    ("excite", "ur5", "--starts", "100000000000000000000"),
])  # fmt: skip
def test_they_are_usage(words: tuple[str, ...], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        main(words)
    assert caught.value.code == 2
    assert f"argument {words[-2]}: '{words[-1]}'; allowed: " in capsys.readouterr().err


@pytest.mark.parametrize(("words", "refused"), [
    (("deflection", "one_link", "--load", "tcp", *"001000", "--load", "tcp", *"100000"), "load: 'tcp'"),
    (("deflection", "one_link", "--set", "gravity.z=0", "gravity.z=-1"), "set: 'gravity.z'"),
    (("modes", "one_link", "--state", "one.x.friction.z=1", "one.x.friction.z=2"), "state: 'one.x.friction.z'"),
    (("modes", "one_link", "--pose", "joint1.gamma=1", "joint1.gamma=2"), "pose: 'joint1.gamma'"),
    (("modes", "one_link", "--drives", "pd", "--kp", "joint1.gamma=1", "joint1.gamma=2"), "kp: 'joint1.gamma'"),
    (("poses", "ur5", *("--range", "joint1.gamma", "0", "1") * 2), "range: 'joint1.gamma'"),
    (("excite", "ur5", "--box", "tcp", *"000111", "--box", "tcp", *"000222"), "box: 'tcp'"),
    (("compensate", "ur5", "--scenario", "gone.toml", "--weights", "x=1", "x=2"), "weights: 'x'"),
    (("info", "robot.xacro", "--xacro", "--package", "arm=a", "--package", "arm=b"), "package: 'arm'"),
])  # fmt: skip
def test_a_name_is_given_once(words: tuple[str, ...], refused: str, capsys: pytest.CaptureFixture[str]) -> None:
    """The last value does not silently take the place of the first."""
    assert main(words) == 1
    assert f"{refused} is given twice; allowed: once" in capsys.readouterr().err


@pytest.mark.parametrize(
    "value",
    soaked([1e300, 1e-300, 10**400, float("nan"), "1", True, [1.0], None], [1e300, 10**400, None]),
    ids=range(8),
)
def test_functions_refuse_them_as_well(value: object) -> None:
    robot = load_robot("ur5")
    given: dict[str, object]
    for given in ({"duration": value}, {"bandwidth": value}):
        with pytest.raises(InputError, match="allowed"):
            simulate(robot, **given)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="a motion takes a time above 0"):
        default_motion(robot, value, ["joint1.gamma"])  # type: ignore[arg-type]
    with pytest.raises(InputError, match="a motion takes a time above 0"):
        PointToPoint([0.0], [1.0], value)  # type: ignore[arg-type]
    for given in ({"duration": value}, {"step": value}):
        with pytest.raises(InputError, match="allowed"):
            excite(robot, **given)  # type: ignore[arg-type]
    for given in ({"bandwidth": value}, {"confidence": value}):
        with pytest.raises(InputError, match=rf"{next(iter(given))}: .*; allowed: a number"):
            fit(robot, "gone.csv", **given)  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"confidence: .*; allowed: a number between 0 and 1"):
        calibrate(robot, "gone.csv", confidence=value)  # type: ignore[arg-type]
    if value is not None:
        with pytest.raises(InputError, match="allowed"):
            excite(robot, noise=value)  # type: ignore[arg-type]


WRONG = (
    *(np.ones(3), np.array([True, False]), "x", 10**400, np.nan, 1e300, object(), [], {}, -1, {"a": 1}, 2**70),
    *(np.array(["a"]), [[1], [1, 2]], 1j, b"x", {1: 2}),
)
TABLE = {"frames.*.x": {"bound": 1e-4}}


@pytest.mark.parametrize(
    ("function", "key"),
    [
        *((tolerance, key) for key in ("along", "poses", "random", "seed", "wrench", "confidence")),
        *((simulate, key) for key in ("duration", "rtol", "output_step", "goal")),
        *(pytest.param(simulate, key, marks=pytest.mark.soak) for key in ("bandwidth", "step", "start", "tool")),
        (simulate, "method"),
    ],
)
def test_anything_given_is_taken_or_refused(function: Callable[..., object], key: str) -> None:
    """Arrays, texts and huge numbers in the place of what belongs there: an error of eomgen, and no other."""
    given: dict[str, object] = {"table": TABLE} if function is tolerance else {"duration": 0.01}
    given |= {"seed": {"random": 1}, "step": {"method": "rk4"}}.get(key, {})
    said = []
    for value in WRONG:
        try:
            function("one_link", **{**given, key: value})
        except InputError as error:
            said.append(str(error))
    assert said
    assert [text for text in said if not text.isprintable()] == []
