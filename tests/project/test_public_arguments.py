"""Public arguments: names stay as docs/public_arguments.txt lists them, and types of choices name what is allowed."""

from __future__ import annotations

import re
import warnings
from pathlib import Path
from typing import Any, get_args

import pytest

import eomgen
from docs.generators import public
from eomgen.analysis.ports import KINDS
from eomgen.errors import EomgenWarning, InputError, renamed
from eomgen.identification.calibration.variants import VARIANTS
from eomgen.identification.choosing.information import CRITERIA as POSE_CRITERIA
from eomgen.identification.choosing.proposals import MEASURES
from eomgen.identification.exciting.weighted_columns import CRITERIA as EXCITATION_CRITERIA
from eomgen.identification.geometry.solve import LOSSES
from eomgen.kernel.kinematics import REFERENCES
from eomgen.kernel.stepping.methods import (
    ADAPTIVE,
    AUTO,
    EXPLICIT_METHODS,
    FIXED,
    IN_C,
    METHODS,
    SCIPY_IMPLICIT,
    SUNDIALS,
)
from eomgen.robot import Limits
from tests.support.refusals import refused

ROOT = Path(__file__).parents[2]
LIST = (ROOT / "docs" / "public_arguments.txt").read_text(encoding="utf-8")
OLD = [
    (label, old, new)
    for label, shown in re.findall(r"^(\S+)\((.*)\)$", LIST, re.MULTILINE)
    for new, *before in (x.split(public.OR) for x in shown.split(", "))
    for old in before
]


def test_no_argument_is_renamed_unnoticed() -> None:
    assert len(OLD) > 10
    assert public.lost(LIST) == []
    assert public.arguments() == LIST, "run: make tables"


@pytest.mark.parametrize(
    ("line", "named"),
    [
        ("eomgen.load_result(path, file)", "eomgen.load_result: file is gone; rename it beside @renamed(file=...)"),
        ("eomgen.Joint.with_limits(name, limits or given or x)", "eomgen.Joint.with_limits: x is gone; rename"),
        ("eomgen.Kernel.shut(q)", "eomgen.Kernel.shut is gone"),
        ("eomgen.robot.Chain(links)", "eomgen.robot.Chain is gone"),
    ],
)
def test_what_is_lost_is_named(line: str, named: str) -> None:
    (told,) = public.lost(f"{LIST}{line}\n")
    assert told.startswith(named)


def test_the_list_has_functions_fields_methods_and_names_of_before() -> None:
    arguments = public.listed(LIST)
    assert arguments["eomgen.simulate"][0] == "robot"
    assert "placement" in arguments["eomgen.Joint"]
    assert arguments["eomgen.Kernel.assemble"] == ["q", "fixed", "roots"]
    assert arguments["eomgen.pictures.plot_response"][:2] == ["response", "found"]
    assert "eomgen.Kernel" not in arguments


@pytest.mark.parametrize(("label", "old", "new"), OLD)
def test_an_old_name_is_taken_with_a_warning(label: str, old: str, new: str) -> None:
    """The value arrives where the new name stands: it is refused by that name."""
    function, thing = public.function_of(label), object()
    others = {"robot": "one_link"} if "robot" in public.keywords(function) else {}
    if label.endswith("with_limits"):
        joint = eomgen.load_robot("one_link").joints[0]
        limits = Limits(lower=-1.0, upper=2.0)
        with pytest.warns(EomgenWarning, match="given is called limits now"):
            assert joint.with_limits("gamma", given=limits) == joint.with_limits("gamma", limits)  # type: ignore[call-arg]
        return
    with (
        pytest.warns(EomgenWarning, match=rf"^{label.rpartition('.')[2]}: the argument {old} is called {new} now"),
        pytest.raises(InputError, match=f"^{new}: got a value of type object"),
    ):
        function(**others, **{old: thing})
    refused(InputError, f"got {new} and {old}, its name of before", function, **others, **{old: thing, new: thing})


@renamed(found="response", given="limit")
def plot(response: int, *, limit: int = 1) -> tuple[int, int]:
    """Return what came."""
    return response, limit


def test_values_by_old_names_arrive_and_the_line_of_the_call_is_told_once() -> None:
    assert plot(3, limit=4) == (3, 4)
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("default")
        for _ in range(3):
            assert plot(found=1, given=2) == (1, 2)  # type: ignore[call-arg]
    assert [(x.category, x.filename) for x in told] == [(EomgenWarning, __file__)] * 2
    assert (
        str(told[0].message)
        == "plot: the argument found is called response now; found goes with the next minor version"
    )


def test_both_names_are_refused() -> None:
    for values, named in (((1,), {"found": 2}), ((), {"response": 1, "found": 2}), ((1,), {"limit": 1, "given": 2})):
        with pytest.raises(InputError, match=r"^plot: got (response and found|limit and given), its name of before"):
            plot(*values, **named)


def test_a_name_that_renames_nothing_is_refused() -> None:
    for keywords in ({"found": "answer"}, {"response": "limit"}):
        refused(TypeError, "are not renamed to arguments of", renamed(**keywords), plot)


CHOICES = [
    (eomgen.Kernel.rollout, "method", [*FIXED, *ADAPTIVE]),
    (eomgen.Kernel.rollout_gradient, "method", [*FIXED, *ADAPTIVE]),
    (eomgen.Kernel.rollout_sensitivity, "method", [*FIXED, *ADAPTIVE]),
    (eomgen.Kernel.frame_velocity, "reference", REFERENCES),
    (eomgen.Kernel.frame_acceleration, "reference", REFERENCES),
    (eomgen.integration.integrate, "method", METHODS),
    (eomgen.simulate, "method", METHODS),
    (eomgen.analysis.compare, "method", METHODS),
    (eomgen.analysis.response, "kind", KINDS),
    (eomgen.analysis.linearize, "kind", KINDS),
    (eomgen.identification.calibrate, "loss", LOSSES),
    (eomgen.identification.calibrate, "variant", VARIANTS),
    (eomgen.identification.poses, "criterion", POSE_CRITERIA),
    (eomgen.identification.poses, "measure", MEASURES),
    (eomgen.identification.excite, "criterion", EXCITATION_CRITERIA),
]


def words(annotation: Any) -> list[str]:
    """All words of a Literal, also inside of an optional one."""
    found = [word for inner in get_args(annotation) for word in ([inner] if isinstance(inner, str) else words(inner))]
    return sorted(found)


@pytest.mark.parametrize(("function", "argument", "allowed"), CHOICES)
def test_types_name_what_is_allowed(function: Any, argument: str, allowed: Any) -> None:
    annotation = function.__annotations__[argument]
    module = __import__(function.__module__, fromlist=["*"])
    kind = eval(annotation, vars(module)) if isinstance(annotation, str) else annotation
    assert words(kind) == sorted(allowed)


def test_methods_are_those_of_their_families() -> None:
    assert sorted(METHODS) == sorted({AUTO, *IN_C, *SCIPY_IMPLICIT, *SUNDIALS, *EXPLICIT_METHODS})
