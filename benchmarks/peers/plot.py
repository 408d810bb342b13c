"""Time per state over the number of coordinates, both axes logarithmic."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from eomgen.pictures import style as plots

from .cases import URDFS
from .page import KERNELS
from .report import Entry, Report

SHOWN = ("inverse_dynamics", "mass_matrix", "forward_dynamics")
STYLES = {  # Okabe and Ito: told apart by colour-blind readers
    "Pinocchio": ("#d55e00", "s"),
    "textbook": ("#777777", "^"),
    "eomgen": ("#0072b2", "o"),
    "eomgen, batch": ("#009e73", "D"),
}
RC: Any = {**plots.RC, "svg.hashsalt": "eomgen"}  # the same ids on every run


def plot(report: Report, path: Path) -> None:
    """Write the figure: chains of 6-DOF joints as lines, robots of URDFs as single hollow points."""
    import matplotlib as mpl
    from matplotlib.figure import Figure

    with mpl.rc_context(RC):
        figure = Figure(figsize=(9.6, 3.6), layout="constrained")
        panels = figure.subplots(1, len(SHOWN), sharey=True)
        for axes, kernel in zip(panels, SHOWN, strict=True):
            _panel(axes, report, kernel)
        panels[0].set_ylabel("time per state, ns")
        handles, labels = panels[0].get_legend_handles_labels()
        if handles:
            figure.legend(handles, labels, loc="outside lower center", ncols=len(labels))
        figure.savefig(path, metadata={"Date": None, "Creator": None})
    path.write_text("\n".join(line.rstrip() for line in path.read_text().splitlines()) + "\n", encoding="utf-8")


def _panel(axes: Any, report: Report, kernel: str) -> None:
    axes.set_title(KERNELS[kernel])
    axes.set_xlabel("degrees of freedom")
    for label, (color, marker) in STYLES.items():
        chain = _points(report.growing, kernel, label)
        if chain:
            axes.loglog(*zip(*chain, strict=True), color=color, marker=marker, markersize=3.5, label=label)
        single = _points([entry for entry in report.entries if entry.case in URDFS], kernel, label)
        if single:
            axes.loglog(
                *zip(*single, strict=True), color=color, marker=marker, markersize=5, linestyle="", fillstyle="none"
            )
    names = {entry.coordinates: entry.case for entry in report.entries if entry.case in URDFS}
    for coordinates, name in names.items():
        axes.annotate(name, (coordinates, 1.0), xycoords=("data", "axes fraction"), ha="center", va="top", fontsize=6.5)
    ticks = sorted({entry.coordinates for entry in report.growing})
    if ticks:
        axes.set_xticks(ticks, [str(tick) for tick in ticks])
        axes.minorticks_off()


def _points(entries: Sequence[Entry], kernel: str, label: str) -> list[tuple[int, float]]:
    """Return (coordinates, ns) of a label, of its fastest variant."""
    points = []
    for entry in entries:
        if entry.kernel == kernel and entry.batch == label.endswith("batch"):
            times = [ns for name, ns in entry.ns.items() if name.split(" (")[0] == label]
            if times:
                points.append((entry.coordinates, min(times)))
    return sorted(points)
