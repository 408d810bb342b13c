"""A report of precision as text and figure: docs/precision.md, docs/precision.svg, the table of docs/comparison.md."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from eomgen.pictures.style import FULL_WIDTH, canvas

from .bars import Bar, conclusion
from .precision_cases import ERRORS, ONE, OTHERS, OURS, PROBLEMS, WITH_RADAU
from .precision_report import Measured, Point, Report

STYLES = {  # colour and marker; Okabe and Ito: told apart by colour-blind readers
    "eomgen rosenbrock": ("#0072b2", "o"),
    "eomgen tsit5": ("#009e73", "D"),
    "eomgen radau": ("#332288", "*"),
    "eomgen auto": ("#882255", "d"),
    "eomgen implicit": ("#56b4e9", "s"),
    "eomgen rk4": ("#000000", "^"),
    "scipy:Radau": ("#d55e00", "v"),
    "CVODE": ("#e69f00", "P"),
    "IDA": ("#f0e442", "X"),
    "scipy:DOP853": ("#cc79a7", "<"),
    "MuJoCo discrete": ("#777777", "s"),
    "MuJoCo implicitfast": ("#aaaaaa", "h"),
    "MuJoCo RK4": ("#444444", "^"),
}
NAMED = ("puma560_elastic", ONE)  # the problem and tolerance of ratios at one tolerance
AT_ONE = (
    ("scipy:Radau", 30.0, False),
    ("scipy:Radau", 30.0, True),
    ("CVODE", 10.0, True),
)  # peer, required, at the same error
NONE = "-"


def label(contender: str) -> str:
    """Return the name of a contender in a table."""
    who, _, method = contender.partition(" ")
    return f"{who} `{method}`" if method else who


def milliseconds(point: Point | None) -> str:
    """Return the time of a run, or a dash."""
    return NONE if point is None else f"{1e3 * point.seconds:.3g}"


def table(measured: Measured) -> list[str]:
    """Return times to every error of every contender that has points, ms."""
    names = [name for name in (*OURS, *OTHERS) if any(p.contender == name for p in measured.points)]
    lines = [f"| ms to an error of | {' | '.join(f'{e:.0e}' for e in ERRORS)} |", "|---" + "|---:" * len(ERRORS) + "|"]
    for name in names:
        cells = [milliseconds(measured.cheapest([name], error)) for error in ERRORS]
        lines.append(f"| {label(name)} | {' | '.join(cells)} |")
    cells = [
        (NONE if bar.measured is None else f"{bar.measured:.1f}") + f" {bar.brackets}" for bar in at_errors(measured)
    ]
    lines.append(f"| best of the others by best of ours | {' | '.join(cells)} |")
    spared = [measured.ratio(error, [x for x in OURS if x not in WITH_RADAU]) for error in ERRORS]
    cells = [NONE if ratio is None else f"{ratio:.2f}" for ratio in spared]
    return [*lines, f"| best of ours without Radau IIA by best of ours | {' | '.join(cells)} |"]


def at_errors(measured: Measured) -> list[Bar]:
    """Return what is required of a problem at every error: the best of the others' time by the best of ours."""
    problem = PROBLEMS[measured.problem]
    return [Bar(f"{problem.title} at {e:.0e}", measured.ratio(e), required) for e, required in problem.bars.items()]


def winners(measured: Measured) -> Iterator[str]:
    """Yield at every error the best of both sides, with their settings, and whether the required ratio is held."""
    for error, bar in zip(PROBLEMS[measured.problem].bars, at_errors(measured), strict=True):
        ours, others = measured.cheapest(OURS, error), measured.cheapest(OTHERS, error)
        if ours is None or others is None:
            yield f"{measured.problem:16} {error:.0e}  nobody's, or one side's, is as exact   bar {bar.required:g}"
            continue
        yield (
            f"{measured.problem:16} {error:.0e}  {ours.contender:18} {1e3 * ours.seconds:8.3g} ms"
            f"  {others.contender:20} {1e3 * others.seconds:8.3g} ms  {bar.measured:6.1f}"
            f"  bar {bar.required:g}  {bar.verdict}"
        )


def at_one_tolerance(measured: Measured) -> list[tuple[Bar, str]]:
    """Return ratios of 2 s of the elastic arm, at the same tolerance or at the same error, and our method in each."""
    rows = []
    for peer, required, same_error in AT_ONE:
        theirs = measured.at(peer, NAMED[1])
        if theirs is None:
            continue
        what = f"{peer} at a relative tolerance of {NAMED[1]:.0e}, {'at the same error' if same_error else 'ours too'}"
        if same_error:
            ours = measured.cheapest(OURS, theirs.error)
        else:
            fit = [p for p in (measured.at(name, NAMED[1]) for name in OURS) if p is not None]
            ours = min(fit, key=lambda p: p.seconds, default=None)
        if ours is not None:
            rows.append((Bar(what, theirs.seconds / ours.seconds, required), ours.contender))
    return rows


def lines(report: Report) -> list[str]:
    """Return lines for the terminal: every required ratio, and whether this run holds it."""
    said = [line for measured in report.found for line in winners(measured)]
    named = report.of(NAMED[0])
    for bar, ours in at_one_tolerance(named) if named else []:
        said.append(f"{bar.what}, {ours}: {bar.measured:.1f}  bar {bar.required:g}  {bar.verdict}")
    return said


def ratios(report: Report) -> str:
    """Return the table of docs/comparison.md: at every error the best of the others' time by the best of ours."""
    head = " | ".join(f"{error:.0e}" for error in ERRORS)
    rows = [f"| best of the others' time by ours, to an error of | {head} |", "|---" + "|---:" * len(ERRORS) + "|"]
    for measured in report.found:
        cells = []
        for error in ERRORS:
            ratio, others = measured.ratio(error), measured.cheapest(OTHERS, error)
            cells.append(NONE if ratio is None or others is None else f"{ratio:.1f} ({others.contender})")
        rows.append(f"| {PROBLEMS[measured.problem].title} | {' | '.join(cells)} |")
    return "\n".join(rows)


def page(report: Report) -> str:
    """Return the whole page docs/precision.md."""
    worst = max((measured.difference for measured in report.found), default=0.0)
    said = [
        "# Work-precision diagrams",
        "",
        "Written by `make bench` (`python -m benchmarks.precision`); do not edit.",
        "",
        "How long an integrator takes says little without how wrong it is. Here are both: every point is one"
        " integration of one motion with one tolerance, or one length of steps; down is more exact, left is faster.",
        "",
        "![error of coordinates over time](precision.svg)",
        "",
        "Errors are those of coordinates, in m and rad, the greatest at all samples. What is exact, two of our own"
        " methods say, `tsit5` and `radau` with narrow tolerances; they agree to"
        f" {worst:.0e} or better, and nothing is timed otherwise. Times are processor times of one call, the"
        f" least of {report.rounds} rounds or more in which all runs took turns on one core (runs of more than a"
        " second: of two); builds are not counted. In the tables stands the fastest run of each that is at least"
        " as exact as the column says; the last row but one divides the best of the others by the best of ours,"
        " in brackets what is required, the last one the best of ours without `radau` and `auto` by the"
        " best of all of ours.",
        "",
        *(f"- {key}: {value}" for key, value in report.machine.items()),
        "",
        "What each is:",
        "",
        "- eomgen `rosenbrock`, `tsit5`, `radau`:"
        " [adaptive step size](theory.md#adaptive-step-size), one call of C."
        " `implicit`, `rk4`: steps of one length, likewise. The kernel is that of"
        " `eomgen.build`, as it is.",
        "- eomgen `auto`: `eomgen.integration.integrate`, which switches between methods of C by stiffness,"
        " `radau` too at relative tolerances of 1e-7 and less; its time is that of a call from Python, which also looks"
        " for contacts, and computes energies and drives at samples.",
        "- scipy:Radau, scipy:DOP853, CVODE, IDA: `eomgen.integration.integrate` on the same kernel, with exact"
        " derivatives. Python calls the kernel at every evaluation, and most of their time is not the kernel's.",
        "- MuJoCo: the same robot by [`eomgen.export_mjcf`](mjcf.md), `mj_step` in a loop in C. `discrete` is implicit"
        " in position and rate and is the scheme of our `implicit`; `implicitfast` is implicit in rate alone; `RK4`"
        " is explicit.",
        "",
        *_required(report),
    ]
    for measured in report.found:
        problem = PROBLEMS[measured.problem]
        said += ["", f"## {problem.title}", ""]
        said += [
            f"`{problem.key}`: {problem.duration:g} s {problem.what}; {problem.samples} samples.",
            "",
            *table(measured),
        ]
        grouped: dict[str, list[str]] = {}
        for name, why in measured.missing.items():
            grouped.setdefault(why, []).append(label(name))
        said += [""] * bool(grouped) + [f"- {', '.join(names)}: {why}." for why, names in grouped.items()]
    return "\n".join(said).rstrip() + "\n"


def _required(report: Report) -> Iterator[str]:
    """Yield what was missed of all that is required, or that nothing was; and ratios at one tolerance."""
    named = report.of(NAMED[0])
    single = at_one_tolerance(named) if named else []
    yield conclusion([*(bar for measured in report.found for bar in at_errors(measured)), *(bar for bar, _ in single)])
    if named is not None:
        yield ""
        yield f"{PROBLEMS[NAMED[0]].duration:g} s of the {PROBLEMS[NAMED[0]].title} at one tolerance:"
        yield ""
        for bar, ours in single:
            yield (
                f"- {bar.what}: {bar.measured:.1f} times as long as {label(ours)};"
                f" required {bar.required:g}: {bar.verdict}."
            )


def draw(report: Report, path: Path) -> None:
    """Write the figure: error over time, a panel for every problem."""
    rows = (len(report.found) + 1) // 2
    with canvas(FULL_WIDTH, 2.9 * rows + 0.5, path) as figure:
        panels = figure.subplots(rows, 2, squeeze=False).ravel()
        for axes, measured in zip(panels, report.found, strict=False):
            _panel(axes, measured)
        for axes in panels[len(report.found) :]:
            axes.set_axis_off()
        seen: dict[str, Any] = {}
        for axes in panels:
            seen |= dict(zip(*reversed(axes.get_legend_handles_labels()), strict=True))
        order = [name for name in STYLES if name in seen]
        figure.legend([seen[name] for name in order], order, loc="lower center", ncols=4)
        figure.subplots_adjust(
            left=0.09, right=0.99, top=0.96, bottom=0.26 if rows == 1 else 0.17, hspace=0.36, wspace=0.24
        )


def _panel(axes: Any, measured: Measured) -> None:
    axes.set_title(PROBLEMS[measured.problem].title)
    axes.set_xlabel("time, s")
    axes.set_ylabel("error, m or rad")
    for name, (color, marker) in STYLES.items():
        points = sorted((p.setting, p.seconds, p.error) for p in measured.points if p.contender == name)
        if points:
            _, seconds, errors = zip(*points, strict=True)
            line = "-" if name in OURS else "--"
            axes.loglog(seconds, errors, line, color=color, marker=marker, markersize=3.0, linewidth=0.9, label=name)
    axes.set_ylim(1e-12, 1.0)
