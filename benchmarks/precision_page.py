"""A report of precision as text and figure: docs/precision.md, docs/precision.svg, the part of README.md."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from eomgen.pictures.style import FULL_WIDTH, canvas

from .bars import MISSED, UNKNOWN, bracket, verdict
from .precision_cases import ERRORS, ONE, OTHERS, OURS, PROBLEMS
from .precision_report import Found, Point, Report

STYLES = {  # colour and marker; Okabe and Ito: told apart by colour-blind readers
    "eomgen rosenbrock": ("#0072b2", "o"),
    "eomgen tsit5": ("#009e73", "D"),
    "eomgen implicit": ("#56b4e9", "s"),
    "eomgen rk4": ("#000000", "^"),
    "Radau": ("#d55e00", "v"),
    "CVODE": ("#e69f00", "P"),
    "IDA": ("#f0e442", "X"),
    "DOP853": ("#cc79a7", "<"),
    "MuJoCo discrete": ("#777777", "s"),
    "MuJoCo implicitfast": ("#aaaaaa", "h"),
    "MuJoCo RK4": ("#444444", "^"),
}
NAMED = ("puma560_elastic", ONE)  # the problem and tolerance of ratios at one tolerance
AT_ONE = (("Radau", 30.0, False), ("Radau", 30.0, True), ("CVODE", 10.0, True))  # peer, required, at the same error
NONE = "-"


def label(contender: str) -> str:
    """The name of a contender in a table."""
    who, _, method = contender.partition(" ")
    return f"{who} `{method}`" if method else who


def milliseconds(point: Point | None) -> str:
    """The time of a run, or a dash."""
    return NONE if point is None else f"{1e3 * point.seconds:.3g}"


def table(found: Found) -> list[str]:
    """Times to every error of every contender that has points, ms."""
    names = [name for name in (*OURS, *OTHERS) if any(p.contender == name for p in found.points)]
    lines = [f"| ms to an error of | {' | '.join(f'{e:.0e}' for e in ERRORS)} |", "|---" + "|---:" * len(ERRORS) + "|"]
    for name in names:
        cells = [milliseconds(found.cheapest([name], error)) for error in ERRORS]
        lines.append(f"| {label(name)} | {' | '.join(cells)} |")
    bars = PROBLEMS[found.problem].bars
    cells = []
    for error in ERRORS:
        ratio = found.ratio(error)
        cells.append((NONE if ratio is None else f"{ratio:.1f}") + bracket(ratio, bars[error]))
    return [*lines, f"| best of the others by best of ours | {' | '.join(cells)} |"]


def winners(found: Found) -> Iterator[str]:
    """At every error the best of both sides, with their settings, and whether the required ratio is held."""
    for error, bar in PROBLEMS[found.problem].bars.items():
        ours, others, ratio = found.cheapest(OURS, error), found.cheapest(OTHERS, error), found.ratio(error)
        if ours is None or others is None or ratio is None:
            yield f"{found.problem:16} {error:.0e}  nobody's, or one side's, is as exact   bar {bar:g}  {UNKNOWN}"
            continue
        yield (
            f"{found.problem:16} {error:.0e}  {ours.contender:18} {1e3 * ours.seconds:8.3g} ms"
            f"  {others.contender:20} {1e3 * others.seconds:8.3g} ms  {ratio:6.1f}  bar {bar:g}  {verdict(ratio, bar)}"
        )


def at_one_tolerance(found: Found) -> list[tuple[str, float, float, str]]:
    """(what, ratio, required, ours) of 2 s of the elastic arm, at the same tolerance or at the same error."""
    rows = []
    for peer, bar, same_error in AT_ONE:
        theirs = found.at(peer, NAMED[1])
        if theirs is None:
            continue
        what = f"{peer} at a relative tolerance of {NAMED[1]:.0e}, {'at the same error' if same_error else 'ours too'}"
        if same_error:
            ours = found.cheapest(OURS, theirs.error)
        else:
            fit = [p for p in (found.at(name, NAMED[1]) for name in OURS) if p is not None]
            ours = min(fit, key=lambda p: p.seconds, default=None)
        if ours is not None:
            rows.append((what, theirs.seconds / ours.seconds, bar, ours.contender))
    return rows


def lines(report: Report) -> list[str]:
    """For the terminal: every required ratio, and whether this run holds it."""
    said = [line for found in report.found for line in winners(found)]
    named = report.of(NAMED[0])
    for what, ratio, bar, ours in at_one_tolerance(named) if named else []:
        said.append(f"{what}, {ours}: {ratio:.1f}  bar {bar:g}  {verdict(ratio, bar)}")
    return said


def readme(report: Report) -> str:
    """The part of README.md: every robot's ratios, and the elastic arm's times beside MuJoCo's."""
    head = " | ".join(f"{error:.0e}" for error in ERRORS)
    rows = [f"| best of the others' time by ours, to an error of | {head} |", "|---" + "|---:" * len(ERRORS) + "|"]
    for found in report.found:
        cells = []
        for error in ERRORS:
            ratio, others = found.ratio(error), found.cheapest(OTHERS, error)
            missed = bracket(ratio, PROBLEMS[found.problem].bars[error])
            missed = missed if MISSED in missed else ""
            cells.append(NONE if ratio is None or others is None else f"{ratio:.1f}{missed} ({others.contender})")
        rows.append(f"| {PROBLEMS[found.problem].title} | {' | '.join(cells)} |")
    named = report.of(NAMED[0])
    if named is None:
        return "\n".join(rows)
    problem = PROBLEMS[NAMED[0]]
    rows += [
        "",
        f"{problem.duration:g} s of the {problem.title}, milliseconds to an error of coordinates (m, rad):",
        "",
    ]
    rows += [f"| | {head} |", "|---" + "|---:" * len(ERRORS) + "|"]
    for name in (*OURS, *OTHERS):
        if any(p.contender == name for p in named.points):
            cells = [milliseconds(named.cheapest([name], error)) for error in ERRORS]
            rows.append(f"| {label(name)} | {' | '.join(cells)} |")
    return "\n".join(rows)


def page(report: Report) -> str:
    """The whole page docs/precision.md."""
    worst = max((found.difference for found in report.found), default=0.0)
    said = [
        "# Speed per error",
        "",
        "Written by `make bench` (`python -m benchmarks.precision`); do not edit.",
        "",
        "How long an integrator takes says little without how wrong it is. Here are both: every point is one"
        " integration of one motion with one tolerance, or one length of steps; down is more exact, left is faster.",
        "",
        "![error of coordinates over time](precision.svg)",
        "",
        "Errors are those of coordinates, in m and rad, the greatest at all samples. What is exact, two of our own"
        " methods say, `tsit5` and `rosenbrock` with narrow tolerances (of the UR5 `tsit5` and `rk4`); they agree to"
        f" {worst:.0e} or better, and nothing is timed otherwise. Times are wall times of one call on one core, the"
        f" least of {report.rounds} rounds in which all runs took turns in one process (runs of more than a second:"
        " of two); builds are not counted. In the tables stands the fastest run of each that is at least as exact as"
        " the column says; the last row divides the best of the others by the best of ours, in brackets what is"
        " required.",
        "",
        *(f"- {key}: {value}" for key, value in report.machine.items()),
        "",
        "What each is:",
        "",
        "- eomgen `rosenbrock`, `tsit5`: [steps that the error chooses](theory.md#steps-that-the-error-chooses), one"
        " call of C. `implicit`, `rk4`: steps of one length, likewise. The kernel is that of"
        " `eomgen.build`, as it is.",
        "- Radau, DOP853 (SciPy), CVODE, IDA (SUNDIALS): `eomgen.integration.integrate` on the same kernel, with exact"
        " derivatives. Python calls the kernel at every evaluation, and most of their time is not the kernel's.",
        "- MuJoCo: the same robot by [`eomgen.export_mjcf`](mjcf.md), `mj_step` in a loop in C. `discrete` is implicit"
        " in position and rate and is the scheme of our `implicit`; `implicitfast` is implicit in rate alone; `RK4`"
        " is explicit.",
        "",
        *_required(report),
    ]
    for found in report.found:
        problem = PROBLEMS[found.problem]
        said += ["", f"## {problem.title}", ""]
        said += [
            f"`{problem.key}`: {problem.duration:g} s {problem.what}; {problem.samples} samples.",
            "",
            *table(found),
        ]
        grouped: dict[str, list[str]] = {}
        for name, why in found.missing.items():
            grouped.setdefault(why, []).append(label(name))
        said += [""] * bool(grouped) + [f"- {', '.join(names)}: {why}." for why, names in grouped.items()]
    return "\n".join(said).rstrip() + "\n"


def _required(report: Report) -> Iterator[str]:
    """What was missed or not measured, or that all is held; and ratios at one tolerance, which count as well."""
    named = report.of(NAMED[0])
    at_one = at_one_tolerance(named) if named is not None else []
    by_verdict: dict[str, list[str]] = {}
    for found in report.found:
        for error, bar in PROBLEMS[found.problem].bars.items():
            ratio = found.ratio(error)
            number = NONE if ratio is None else f"{ratio:.1f}"
            what = f"{PROBLEMS[found.problem].title} at {error:.0e} ({number} of {bar:g})"
            by_verdict.setdefault(verdict(ratio, bar), []).append(what)
    for what, ratio, bar, _ in at_one:
        by_verdict.setdefault(verdict(ratio, bar), []).append(f"{what} ({ratio:.1f} of {bar:g})")
    if set(by_verdict) & {MISSED, UNKNOWN}:
        for word in (MISSED, UNKNOWN):
            if word in by_verdict:
                yield f"Required ratios that are {word}: {'; '.join(by_verdict[word])}."
    else:
        yield "All required ratios are held."
    if named is not None:
        yield ""
        yield f"{PROBLEMS[NAMED[0]].duration:g} s of the {PROBLEMS[NAMED[0]].title} at one tolerance:"
        yield ""
        for what, ratio, bar, ours in at_one:
            yield f"- {what}: {ratio:.1f} times as long as {label(ours)}; required {bar:g}: {verdict(ratio, bar)}."


def draw(report: Report, path: Path) -> None:
    """Write the figure: error over time, a panel for every problem."""
    rows = (len(report.found) + 1) // 2
    with canvas(FULL_WIDTH, 2.9 * rows + 0.5, path) as figure:
        panels = figure.subplots(rows, 2, squeeze=False).ravel()
        for axes, found in zip(panels, report.found, strict=False):
            _panel(axes, found)
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


def _panel(axes: Any, found: Found) -> None:
    axes.set_title(PROBLEMS[found.problem].title)
    axes.set_xlabel("time, s")
    axes.set_ylabel("error, m or rad")
    for name, (color, marker) in STYLES.items():
        points = sorted((p.setting, p.seconds, p.error) for p in found.points if p.contender == name)
        if points:
            _, seconds, errors = zip(*points, strict=True)
            line = "-" if name in OURS else "--"
            axes.loglog(seconds, errors, line, color=color, marker=marker, markersize=3.0, linewidth=0.9, label=name)
    axes.set_ylim(1e-12, 1.0)
