"""Tolerances that are asked for as quantities: the tool to 1 um, whatever tolerance of a step that takes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from ..errors import InputError, IntegrationError
from ..limits import LARGEST, is_usable
from ..names import listed, show
from ..robot.coordinates import unit_of
from ..scenario.value import Integrator, Scenario
from ..shown import prefixed
from .result import SimulationResult

TOOL, ROTATION = "tool", "tool.rotation"
NARROWEST = 1e-12  # rtol, below which no reference is narrower enough
AIM, LEAST, MOST = 0.5, 1e-3, 0.5  # of what is asked for; by how much a round may narrow rtol
IMPROVES = 0.7  # of the error before, which a narrower rtol must come below


def checked_within(within: Mapping[str, float], coordinates: tuple[str, ...], scenario: Scenario) -> dict[str, float]:
    """Return what errors are asked for, by name.

    Raises:
        InputError: an unknown name, a number that is none above 0, nothing, or a method without tolerances.
    """
    if not isinstance(within, Mapping) or not within:
        allowed = f"errors by name, such as {{{TOOL!r}: 1e-6}}"
        raise InputError(f"within: {show(within)}; allowed: {allowed}")
    for name, error in within.items():
        if name not in (TOOL, ROTATION, *coordinates):
            raise InputError(f"within: {show(name)} is unknown; allowed: {listed((TOOL, ROTATION, *coordinates))}")
        if not (is_usable(error) and error > 0.0):
            raise InputError(f"within: {name}: {show(error)}; allowed: an error above 0, up to {LARGEST:g}")
    if scenario.integrator.method == "rk4":
        raise InputError("within: rk4 has a step and no tolerances; allowed: other methods")
    return {str(name): float(error) for name, error in within.items()}


def run_within(
    run: Callable[[Scenario], SimulationResult], scenario: Scenario, within: Mapping[str, float]
) -> SimulationResult:
    """Run a scenario with narrower tolerances until its estimated errors are as asked for.

    Args:
        run: simulates a scenario, with its global error.
        scenario: whose rtol is the first one, and a number of whose atol narrows with it.
        within: as of ``checked_within``.

    Raises:
        IntegrationError: no tolerance brings that: rounding errors, or laws that no step resolves, are larger.
    """
    before = np.inf
    while True:
        result = run(scenario)
        errors = {name: _error(result, name) for name in within}
        share, name = max((errors[name] / within[name], name) for name in within)
        assert result.global_error is not None
        if share <= 1.0 and result.global_error.is_resolved:
            asked = ", ".join(f"{name} {_shown(errors[name], name)} of {_shown(within[name], name)}" for name in within)
            note = f"errors within what was asked for (estimated): {asked}; by rtol {scenario.integrator.rtol:.2g}"
            return replace(result, notes=(*result.notes, note))
        how = scenario.integrator
        if how.rtol <= NARROWEST or not share < IMPROVES * before:
            trouble = "it does not fall any more" if how.rtol > NARROWEST else "no narrower one has an estimate"
            if share <= 1.0:
                trouble = "estimates by narrower tolerances do not agree"
            raise IntegrationError(
                f"within: {name}: {_shown(errors[name], name)} at rtol {how.rtol:.2g}, and {trouble};"
                f" allowed: more than {_shown(errors[name], name)}, or another method"
            )
        before = share
        rtol = max(NARROWEST, how.rtol * min(MOST, max(LEAST, AIM / share)))
        atol = None if how.atol is None else how.atol * rtol / how.rtol
        scenario = replace(scenario, integrator=Integrator(how.method, rtol, atol, how.step))


def _error(result: SimulationResult, name: str) -> float:
    """Return the largest estimated error of a quantity with what is open of it, m or rad."""
    estimate = result.global_error
    assert estimate is not None
    assert estimate.tool_rotation_error is not None
    if name == TOOL:
        size = estimate.tool_max or 0.0
    elif name == ROTATION:
        size = float(estimate.tool_rotation_error.max())
    else:
        size = float(np.abs(estimate.q_error[:, estimate.coordinates.index(name)]).max())
    return size * (1.0 + estimate.unresolved)


def _shown(error: float, name: str) -> str:
    units = {TOOL: "m", ROTATION: "rad"}
    return prefixed(error, units[name] if name in units else unit_of(name))
