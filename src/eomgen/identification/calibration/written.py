"""Fits for files: offsets that go with a description that cannot have all terms of a calibration."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from ...arrays import Array
from ...names import listed
from ..geometry.blocks import ENTRY
from ..geometry.error_model import COMPLIANCE, DRIVE
from ..geometry.solve import Fit, Problem, fitted
from .calibrated import is_said

TOML, URDF = "toml", "urdf"
_RIGID = 1e9  # times the entries of a stiffness matrix: what bends no more


@dataclass(frozen=True)
class WrittenFit:
    """A fit for a format: indices of the terms that it cannot have, and the fit of all others without them."""

    without: tuple[int, ...]
    fit: Fit


def written_fits(problem: Problem, fit: Fit, values: Mapping[str, float], loss: str | None) -> dict[str, WrittenFit]:
    """Return fits by format, of those that cannot have all terms that were fitted.

    Args:
        problem: of the variant that is written.
        fit: its fit.
        values: by name, as a description says them.
        loss: see ``fitted``.
    """
    fits: dict[str, WrittenFit] = {}
    for form in (TOML, URDF):
        x, without = fit.x.copy(), list[int]()
        for i, q in enumerate(problem.model.parameters):
            if q.kind == DRIVE:
                x[i] = 0.0
            elif q.kind == COMPLIANCE and form == URDF:
                x[i] = _RIGID * q.nominal if q.factor == ENTRY else 0.0
            elif q.kind == COMPLIANCE and not is_said(problem.model.robot, values, q.name):
                x[i] = q.nominal
            else:
                continue
            without.append(i)
        if np.array_equal(x, fit.x):
            continue
        same = [other for other in fits.values() if other.without == tuple(without)]
        reduced = replace(problem, active=np.setdiff1d(problem.active, without))
        fits[form] = same[0] if same else WrittenFit(tuple(without), fitted(reduced, x, loss=loss))
    return fits


def written_note(problem: Problem, form: str, written: WrittenFit) -> str:
    """Return a note about what a format cannot have."""
    names = [problem.model.parameters[i].name for i in written.without if i in problem.active]
    return (
        f".{form} cannot have {listed(names)}: the offsets there are fitted without them"
        if names
        else (f".{form} cannot have the described stiffness: the offsets there are those of a rigid robot")
    )


def merged_values(full: Array, apart: Array, written: WrittenFit) -> Array:
    """Return numbers of a fit for a format, (P,), with those of the full one for terms that it cannot have."""
    merged = apart.copy()
    merged[list(written.without)] = full[list(written.without)]
    return merged
