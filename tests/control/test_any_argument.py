"""Whatever is given for an argument of eomgen.control: a result, or an error of eomgen in a line of ASCII."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import eomgen
from docs.generators.public import called, keywords
from eomgen import control
from eomgen.motion.point_to_point import PointToPoint
from eomgen.names import show
from tests.control.test_inversion import carts
from tests.runtime.test_any_argument import WRONG, wrong_errors
from tests.support.geared_arms import two_link_arm

RECORDS = ("FeedForward", "StableInversion", "Observability")  # results, which eomgen makes
MORE: tuple[Any, ...] = (
    *(
        None,
        "",
        "1",
        "\0",
        "x" * 300,
        "0/" * 3000,
        0,
        10**5000,
        np.inf,
        np.array(3.0),
        np.ones((2, 2)),
        np.ones((3, 2)),
    ),
    *([None, 1.0], [[]], {1: None}, {10**5000: 1.0}, {"joint1.gamma": "x"}, {"encoder": 10**400}, np.ma.masked),
)
Call = tuple[Callable[..., Any], dict[str, Any]]


def table(folder: Path) -> list[Call]:
    """Public functions, classes and methods, with arguments that they take beside their defaults."""
    q, motion = np.zeros(2), PointToPoint([0.0], [0.3], 0.02, smooth=4)
    elastic = {"robot": two_link_arm(), "motion": PointToPoint([0.0, 0.0], [0.3, 0.1], 0.02, smooth=4)}
    sensors = "encoder:joint1.gamma,pose:tcp"
    measured = control.Measurement.of("one_link", sensors, drift={"encoder": 1e-6})
    kernel = eomgen.build(measured.robot, kernels=measured.kernels)
    y = kernel.functions.measurement(q, q, q)
    kalman = control.observer("one_link", "encoder:joint1.gamma,encoder:joint1.x", dt=1e-3)
    momentum = control.MomentumObserver("one_link", 10.0, 1e-3)
    inverse = control.stable_inversion(carts(), motion, step=5e-4)
    return [
        (control.feedforward, elastic),
        (control.feedforward, {"robot": carts(), "motion": motion, "tolerance": 1e-3}),
        (control.stable_inversion, {"robot": carts(), "motion": motion, "step": 1e-3}),
        (control.write_feedforward, {"robot": elastic["robot"], "folder": folder}),
        (control.observer, {"robot": "one_link", "measure": sensors, "dt": 1e-3, "form": "covariance"}),
        (control.write_observer, {"observer": kalman, "folder": folder}),
        (control.parse_sensors, {"text": sensors}),
        (control.Uncertainty, {}),
        (control.Uncertainty().of_coordinates, {"name": "position", "n": 2}),
        (control.Measurement, {"robot": measured.robot, "noise": measured.noise, "drift": measured.drift}),
        (control.Measurement.of, {"robot": "one_link", "sensors": sensors}),
        (measured.innovation, {"measured": y, "predicted": y}),
        (measured.weights, {"predicted": y}),
        (measured.jacobian, {"kernel": kernel, "q": q, "v": q, "a": q}),
        (measured.noisy, {"exact": y, "rng": np.random.default_rng(1)}),
        (measured.sources, {}),
        (control.Observer, {"model": kalman.filter, "steps": kalman._steps}),
        (kalman.begin, {"q": q}),
        (kalman.estimate, {"name": "joint1.x"}),
        (kalman.predict, {"u": q}),
        (kalman.update, {"y": q}),
        (kalman.transition, {"by": np.eye(4)}),
        (kalman.observability, {"q": q}),
        (control.MomentumObserver, {"robot": "one_link", "gain": 10.0, "dt": 1e-3}),
        (momentum.start, {"q": q, "v": q}),
        (momentum.step, {"q": q, "v": q, "u": q}),
        (momentum.write, {"folder": folder}),
        (control.feedforward(**elastic).of, {"coordinate": "joint1.gamma"}),
        (control.feedforward(**elastic).drive, {}),
        (inverse.drive, {}),
    ]


@pytest.fixture(scope="module")
def calls(tmp_path_factory: pytest.TempPathFactory) -> list[Call]:
    return table(tmp_path_factory.mktemp("c"))


def test_any_argument_is_taken_or_refused(calls: list[Call], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)  # where texts that may be folders are written
    wrong = list[str]()
    for function, needed in calls:
        function(**needed)
        for key in inspect.signature(function).parameters:
            for value in (*WRONG, *MORE):
                what = f"{function.__qualname__}: {key}={show(value)}"
                wrong += wrong_errors(what, partial(function, **{**needed, key: value}))
    assert wrong == []


def test_all_arguments_are_tried(calls: list[Call]) -> None:
    tried = {function.__qualname__ for function, _ in calls}
    labels = [label for label, function in called() if keywords(function)]
    public = {label.removeprefix("eomgen.control.") for label in labels if label.startswith("eomgen.control.")}
    assert public - tried == set(RECORDS)
