"""Figure of what vanishes identically in the mass matrix and in the tensor C, and why."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..robot.model import Model
from .style import COLORS, Plotted, check_kind, literal, sheet

COUNT_COLORS = "viridis"
SURVIVES = "#222222"
REASON_COLORS = ("#bbbbbb", "#dddddd", *COLORS["m"].values(), *COLORS["rad"].values())
LEGEND_WIDTH = 46  # letters of a reason


def plot_zeros(model: Model, path: Path | str | None = None, *, ax: Any = None) -> Plotted:
    """Plot entries of M by whether and why they vanish, beside how many C_s,vw survive for each s and v.

    Both are over all coordinates, with lines between joints.  Zeros are structural ones, see ``codegen.joint.zeros``.

    Args:
        model: of ``robot.build_model``.
        path: to write to, .png, .svg or .pdf.
        ax: two axes.

    Returns:
        The path where there is one, else the figure and its two axes.

    Raises:
        InputError: ``model`` is something else, or as of ``style.sheet``.
    """
    from ..codegen.joint.zeros import zero_map

    check_kind(model, Model, "model", "robot.build_model")
    zeros = zero_map(model)

    def grid(figure: Any) -> list[Any]:
        places = figure.add_gridspec(1, 3, width_ratios=(1.0, 1.0, 0.05), left=0.09, right=0.93, top=0.84, bottom=0.3)
        places.update(wspace=0.28)
        left, right, bar = (figure.add_subplot(places[0, k]) for k in range(3))
        bars.append(bar)
        return [left, right]

    bars: list[Any] = []
    with sheet(7.4, 4.6, path, f"{model.name}: what does not vanish identically", ax) as page:
        left, right = page.panels(2, grid)
        _draw_mass(left, zeros.mass_matrix.reason, [reason for reason, _ in zeros.mass_matrix.zeros])
        counts = zeros.christoffel.mask.sum(axis=2)
        drawn = right.imshow(
            np.ma.masked_equal(counts, 0), cmap=COUNT_COLORS, vmin=1, vmax=max(int(counts.max()), 2), rasterized=True
        )
        bar = page.figure.colorbar(drawn, **({"cax": bars[0]} if bars else {"ax": right}))
        bar.ax.set_title("w", loc="left")
        total = zeros.mass_matrix
        left.set_title(f"M: {total.survivors} of {total.total} entries s <= v survive", loc="left")
        total = zeros.christoffel
        right.set_title(f"C: {total.survivors} of {total.total}; colour: how many w", loc="left")
        for axes in (left, right):
            _mark_joints(axes, model)
            axes.set_ylabel("s", rotation=0.0)
            axes.set_xlabel("v", loc="right")
    return page.outcome


def _draw_mass(axes: Any, reason: NDArray[np.int8], names: list[str]) -> None:
    from matplotlib.colors import ListedColormap
    from matplotlib.patches import Patch

    present = [k for k in range(len(names)) if (reason == k).any()]
    colors = [SURVIVES, *(REASON_COLORS[k % len(REASON_COLORS)] for k in range(len(present)))]
    shown = np.zeros(reason.shape, dtype=int)
    for place, k in enumerate(present):
        shown[reason == k] = place + 1
    axes.imshow(shown, cmap=ListedColormap(colors), vmin=-0.5, vmax=len(colors) - 0.5, rasterized=True)
    patches = [Patch(color=color) for color in colors]
    labels = ["does not vanish", *(_shortened(names[k]) for k in present)]
    axes.legend(patches, labels, loc="upper left", bbox_to_anchor=(-0.15, -0.2), handlelength=1.0)


def _shortened(reason: str) -> str:
    text = reason.partition(":")[0] if len(reason) > LEGEND_WIDTH else reason
    return text if len(text) <= LEGEND_WIDTH else text[: LEGEND_WIDTH - 3] + "..."


def _mark_joints(axes: Any, model: Model) -> None:
    """White lines between joints, whose names stand at the axes where there is room."""
    middles, names = [], []
    for body in (body for body in model.bodies if body.active):
        first, last = min(body.indices), max(body.indices)
        middles.append(0.5 * (first + last))
        names.append(literal(body.joint))
        for line in (axes.axhline, axes.axvline):
            line(first - 0.5, color="#ffffff", linewidth=0.8)
    step = -(-len(names) // 12)
    axes.set_xticks(middles[::step], names[::step], rotation=60.0, ha="right", rotation_mode="anchor")
    axes.set_yticks(middles[::step], names[::step])
    axes.tick_params(length=0.0)
    axes.grid(False)
    for spine in axes.spines.values():
        spine.set_visible(False)
