"""Public arguments: types of choices name what is allowed."""

from __future__ import annotations

from typing import Any, get_args

import pytest

import eomgen
from eomgen.analysis.ports import KINDS
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
    IN_C,
    METHODS,
    SCIPY_IMPLICIT,
    SUNDIALS,
)
from eomgen.runtime.rollouts import FIXED

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
