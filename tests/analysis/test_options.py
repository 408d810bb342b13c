"""The options that all analyses about a state share."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields
from typing import Any

import pytest

import eomgen
from eomgen.analysis import StateOptions, compliance_map, deflection, linearize, modes, modes_along, response
from eomgen.analysis.options import StateKeywords, prepared

ANALYSES: dict[str, Callable[..., Any]] = {
    "modes": modes,
    "modes_along": lambda robot, **options: modes_along(robot, [{}], **options),
    "deflection": deflection,
    "response": lambda robot, **options: response(robot, ["joint1.x"], ["joint1.x"], [1.0], **options),
    "linearize": linearize,
    "compliance_map": lambda robot, **options: compliance_map(robot, [0, 0, 0], [1, 0, 0], [0, 1, 0], **options),
}
REFUSED = {
    "drives": ("soft", "drives: 'soft' is unknown; allowed: locked, free, pd"),
    "kp": (1.0, "kp and kd are gains of drives 'pd'"),
    "held": (["elbow"], "held: 'elbow' is unknown"),
    "loads": ({"hand": [0.0] * 6}, "frame: 'hand' is unknown"),
    "parameters": ({"gravity.w": 1.0}, "gravity.w"),
}


@pytest.mark.parametrize("option", REFUSED)
@pytest.mark.parametrize("analysis", ANALYSES)
def test_every_analysis_checks_every_option(analysis: str, option: str) -> None:
    value, message = REFUSED[option]
    with pytest.raises(eomgen.InputError, match=message):
        ANALYSES[analysis]("one_link", **{option: value})


@pytest.mark.parametrize("analysis", ANALYSES)
def test_an_option_that_there_is_not_is_named(analysis: str) -> None:
    with pytest.raises(TypeError, match="unexpected keyword argument 'drive'"):
        ANALYSES[analysis]("one_link", drive="pd")


def test_keywords_are_the_options() -> None:
    assert [field.name for field in fields(StateOptions)] == list(StateKeywords.__annotations__)


def test_a_kernel_serves_many_analyses() -> None:
    arm = prepared("one_link", parameters={"gravity.y": 0.0})
    again = prepared("one_link", kernel=arm.kernel, loads={"link1": [1.0, 0.0, 0.0, 0.0, 0.0, 0.0]})
    assert again.kernel is arm.kernel
    assert again.kernel.parameters["gravity.y"] == 0.0
    assert again.loads["link1"].tolist() == [1.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    with pytest.raises(eomgen.InputError, match="parameters and kernel are both set"):
        prepared("one_link", kernel=arm.kernel, parameters={"gravity.y": 0.0})
