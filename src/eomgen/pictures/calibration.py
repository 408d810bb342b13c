"""The figure of a calibration: what every variant leaves of the measured poses, fitted and held out."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ..identification.calibration.result import CalibrationResult
from .style import COLORS, canvas, scale_of, title_of

_KINDS = (("position", "m"), ("orientation", "rad"))


def plot_calibration(found: CalibrationResult, path: Path | str) -> Path:
    """Rms of residuals by variant, a panel for positions and one for orientations; returns the path.

    Raises:
        InputError: Matplotlib is not installed, the ending is none of FIGURE_ENDINGS, or the file cannot be written.
    """
    kinds = [entry for entry in _KINDS if entry[0] in found.residuals["full"]["fitted"]]
    with canvas(3.6 * len(kinds), 3.0, path) as figure:
        room = {"top": 0.86, "bottom": 0.12, "left": 0.18 / len(kinds), "right": 0.98, "wspace": 0.3}
        panels = figure.subplots(1, len(kinds), squeeze=False, gridspec_kw=room)
        for axes, (kind, unit) in zip(panels[0], kinds, strict=True):
            _bars(found, axes, kind, unit)
        panels[0][0].legend(loc="upper right")
        title_of(figure, f"{found.robot}: rms of residuals of {found.rows} poses")
    return Path(path)


def _bars(found: CalibrationResult, axes: Any, kind: str, unit: str) -> None:
    names = list(found.residuals)
    fitted = np.array([found.residuals[name]["fitted"][kind] for name in names])
    held = np.array([found.residuals[name]["held_out"].get(kind, np.nan) for name in names])
    factor, prefixed = scale_of(fitted, unit)
    places = np.arange(len(names))
    axes.bar(places - 0.2, factor * fitted, 0.38, color=COLORS["m"]["x"], label="fitted")
    if np.isfinite(held).any():
        axes.bar(places + 0.2, factor * held, 0.38, color=COLORS["m"]["y"], label="held out")
    axes.set_yscale("log")
    axes.set_xticks(places, names)
    axes.set_ylabel(f"{kind}, {prefixed}")
