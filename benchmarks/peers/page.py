"""A report as text: the page docs/peers.md, lines for the terminal."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

from ..bars import Bar, conclusion
from .cases import CHAIN, ELASTIC, TITLES
from .mujoco_peer import STEP
from .python_calls import MANY
from .report import Entry, Quartiles, Report

KERNELS: Mapping[str, str] = {
    "inverse_dynamics": "inverse dynamics",
    "mass_matrix": "mass matrix",
    "forward_dynamics": "forward dynamics",
    "derivatives": "derivatives of inverse dynamics",
    "forward_derivatives": "derivatives of forward dynamics",
    "second_derivatives": "second derivatives of inverse dynamics, contracted",
    "step": "ten linearly implicit steps",
}
CALLED: Mapping[str, str] = {
    **KERNELS,
    "residual_jacobian": "derivatives of inverse dynamics",
    "frame_pose": "pose of the last frame",
    "frame_jacobian": "Jacobian of the last frame",
}
ROBOTS = ("UR5", "Panda", "Talos", CHAIN)  # of the table with required ratios
ALONE = "eomgen"  # one state after the other, beside a batch
ROWS = (  # of the table: beside whom, kernel, whether a batch
    ("CasADi", "inverse_dynamics", False),
    ("CasADi", "mass_matrix", False),
    ("CasADi", "forward_dynamics", False),
    ("Pinocchio", "inverse_dynamics", False),
    ("Pinocchio", "mass_matrix", False),
    ("Pinocchio", "forward_dynamics", False),
    ("Pinocchio", "inverse_dynamics", True),
    ("Pinocchio", "derivatives", False),
    ("Pinocchio", "forward_derivatives", False),
    ("Pinocchio", "second_derivatives", False),
    (ALONE, "inverse_dynamics", True),
    (ALONE, "mass_matrix", True),
    (ALONE, "forward_dynamics", True),
)
BESIDE = {
    "CasADi": "C that CasADi generates from Pinocchio's algorithms",
    "Pinocchio": "Pinocchio, C++",
    ALONE: "eomgen itself, one state after the other",
}
PEERS = ("textbook", "Pinocchio", "CasADi", "MuJoCo")
NONE = "-"


def title(kernel: str, batch: bool, states: int) -> str:
    """Return a kernel's name in a table."""
    return KERNELS[kernel] + (f", per state of {states}" if batch else "")


def summary(report: Report) -> list[str]:
    """Return the table of ratios: like for like first, then a library, then what our batches gain.

    And what is missed.
    """
    heads = [next((e.title for e in report.entries if e.case == key), TITLES[key]) for key in ROBOTS]
    lines = [f"| beside | time by eomgen's | {' | '.join(heads)} |", "|---|---" + "|---:" * len(ROBOTS) + "|"]
    for peer, kernel, batch in ROWS:
        cells = [_cell(report.entry(key, kernel, batch), peer) for key in ROBOTS]
        lines.append(f"| {BESIDE[peer]} | {title(kernel, batch, report.batch_states)} | {' | '.join(cells)} |")
    lines += ["", *_steps(report), "", conclusion(required(report), ".3g"), *_lost(report)]
    return lines


def _steps(report: Report) -> list[str]:
    """Return linearly implicit steps beside those of MuJoCo."""
    step = report.entry(ELASTIC, "step")
    if step is None:
        return []
    alone, many = (_cell(report.entry(ELASTIC, "step", batch), "MuJoCo") for batch in (False, True))
    return [
        f"Ten linearly implicit steps of the {step.title} beside MuJoCo's `discrete`, which is the same scheme with"
        f" the same results: {alone}; per state of {report.batch_states}: {many}."
    ]


def required(report: Report) -> list[Bar]:
    """Return every ratio that is required of this run."""
    bars = [(entry, entry.bar(peer)) for entry in report.entries for peer in PEERS]
    return [
        replace(bar, what=f"{title(entry.kernel, entry.batch, report.batch_states)} of {bar.what}")
        for entry, bar in bars
        if bar is not None
    ]


def _lost(report: Report) -> list[str]:
    """Return rows in which somebody else, or our kernel alone, is as fast or faster."""
    lost = [
        f"{title(e.kernel, e.batch, report.batch_states)} of {e.title} beside {BESIDE.get(peer, peer)}"
        f" ({ratio[1][1]:.2f})"
        for e in report.entries
        for peer in (*PEERS, ALONE)
        if (ratio := e.against(peer)) is not None and ratio[1][1] <= 1.0
    ]
    lost += [
        f"{CALLED.get(call.kernel, call.kernel)} of {call.title} in batches from Python beside one state a call"
        f" ({call.ns['Python'] / call.ns[MANY]:.2f})"
        for call in report.calls
        if MANY in call.ns and call.ns[MANY] >= call.ns["Python"]
    ]
    return ["", f"Lost, with ratios of 1 and less: {'; '.join(lost)}."] if lost else []


def _cell(entry: Entry | None, peer: str) -> str:
    if entry is None:
        return NONE
    bar, against = entry.bar(peer), entry.against(peer)
    brackets = "" if bar is None else f" {bar.brackets}"
    if against is None:
        return ("not built" if "eomgen" in entry.missing else NONE) + brackets
    return f"{against[1][1]:.{1 if against[1][1] >= 2.0 else 2}f}{brackets}"


def rolled(report: Report) -> list[str]:
    """Return lines about gradients of rollouts: time beside error."""
    if not report.gradients:
        return []
    first = report.gradients[0]
    ways = list(dict.fromkeys(way for gradient in report.gradients for way in gradient.ns))
    heads = [f"{gradient.title}, ms | error" for gradient in report.gradients]
    lines = [
        "",
        f"The gradient of a sum of the coordinates after {first.steps} steps of 1 ms, by where they begin and by the"
        f" drives of every step: milliseconds on {first.processor}, the least of many rounds in turns. Ours are called"
        " from Python. MuJoCo's has transition matrices by `mjd_transitionFD` in every step, chained backwards in C;"
        " its `discrete` steps are those of `implicit`. JAX differentiates steps that call our kernels, and our whole"
        " rollout, through the adapter. Errors are relative, beside central differences of fourth order of the same"
        " steps:",
        "",
        f"| gradient | {' | '.join(heads)} |",
        "|---" + "|---:" * (2 * len(heads)) + "|",
    ]
    for way in ways:
        cells = [
            f"{1e-6 * gradient.ns[way]:.3g} | {gradient.errors[way]:.0e}" if way in gradient.ns else f"{NONE} | {NONE}"
            for gradient in report.gradients
        ]
        lines.append(f"| {way} | {' | '.join(cells)} |")
    return lines


def called(report: Report) -> list[str]:
    """Return lines about calls from Python beside the C, in microseconds, and Pinocchio's binding beside them."""
    if not report.calls:
        return []
    ways = list(dict.fromkeys(way for call in report.calls for way in call.ns))
    lines = [
        "",
        "These are times of C beside C. From Python, methods of a kernel beside Pinocchio's binding: microseconds per"
        f" state on {report.calls[0].processor}, the least of many rounds in turns, NaN and infinity looked for in"
        " arguments and results unless it says otherwise; the last column is the first of Python by Pinocchio's.",
    ]
    for robot in dict.fromkeys(call.title for call in report.calls):
        lines += ["", f"| {robot} | {' | '.join(ways)} | ratio |", "|---" + "|---:" * (len(ways) + 1) + "|"]
        for call in report.calls:
            if call.title == robot:
                cells = [f"{1e-3 * call.ns[way]:.3g}" if way in call.ns else NONE for way in ways]
                ratio = f"{call.ns['Python'] / call.ns['Pinocchio']:.2f}" if "Pinocchio" in call.ns else NONE
                lines.append(f"| {CALLED.get(call.kernel, call.kernel)} | {' | '.join(cells)} | {ratio} |")
    return lines


def page(report: Report) -> str:
    """Return the whole page docs/peers.md."""
    worst = max((entry.difference for entry in (*report.entries, *report.growing)), default=0.0)
    lines = [
        "# Comparison with other libraries",
        "",
        "Written by `make bench` (`python -m benchmarks.peers`); do not edit.",
        "",
        "How many times as long as eomgen's kernel others take, in brackets the ratio to hold. Like for like is the C"
        " that CasADi generates from Pinocchio's algorithms for the same robot, with the same compiler and flags;"
        " Pinocchio's C++ headers, compiled for this processor, know no robot beforehand. Where Pinocchio has two"
        " conventions (`crba`, `aba`), the faster one counts.",
        "",
        *summary(report),
        *rolled(report),
        *called(report),
        "",
        "![time over degrees of freedom](peers.svg)",
        "",
        "Lines: chains of 6-DOF joints (those of `benchmarks/data/puma560_generic.urdf`, again and again); hollow"
        f" points: robots of URDFs. A batch has {report.batch_states} states.",
        "",
        "## How it is measured",
        "",
        f"All contenders of a row take turns in one process on one core, the loop in C: {report.rounds} rounds of at"
        f" least 0.3 ms each over the same {report.states} random states (batches: {report.batch_states} states, which"
        " eomgen takes in one call and the others one by one). A ratio is the median over the rounds of the"
        " contender's time by eomgen's, with the quartiles in brackets; above 1 eomgen is faster. Nothing is timed"
        f" before results agree: the greatest relative difference in this run is {worst:.0e}.",
        "",
        *(f"- {key}: {value}" for key, value in report.machine.items()),
        *(f"- {key}: missing in this run, {value}" for key, value in report.missing.items()),
        "",
        "What each is:",
        "",
        "- eomgen: one kernel per robot, the description's numbers folded in, gravity and parameters at run time.",
        "- textbook: recursive Newton-Euler, composite bodies and articulated bodies as loops over a table of links"
        " (`templates/bench/newton_euler.c.jinja`), with eomgen's compiler and flags.",
        "- Pinocchio: `rnea`, `crba`, `aba`, `computeRNEADerivatives`, `computeABADerivatives`,"
        " `ComputeRNEASecondOrderDerivatives` (tensors; contracted with a vector as a user would); results"
        " stay in its `Data`, the mass matrix is the upper triangle. It reads a URDF itself; a 6-DOF joint"
        " is six joints of one coordinate with no bodies in between.",
        "- MuJoCo: `mj_inverse`, `mj_forward` and `mj_step` on the same robot as MJCF, without geometries. They compute"
        " more than the row's name says (poses of all bodies, the mass matrix and its factors). Steps are those of"
        f" `{STEP}`, 1 ms long, which like ours are implicit in position and rate (MuJoCo's documentation, Computation,"
        " Numerical integration); in a batch `mj_step` goes through the states one by one, as every thread of"
        " `mujoco.batch` does. [Work-precision diagrams](precision.md) have MuJoCo's other integrators.",
        "- CasADi: Pinocchio's algorithms traced with CasADi's `SX` for this robot, the C that CasADi generates"
        " compiled with eomgen's compiler and flags.",
        "",
        *_details(report),
    ]
    return "\n".join(lines).rstrip() + "\n"


def _details(report: Report) -> Iterator[str]:
    """Yield a table per robot: ratios to every peer."""
    for case in dict.fromkeys(entry.case for entry in report.entries):
        entries = [entry for entry in report.entries if entry.case == case]
        labels = sorted(dict.fromkeys(label for e in entries for label in e.ratios), key=_order)
        yield f"## {entries[0].title}"
        yield ""
        yield f"| kernel | {' | '.join(label + ', one by one' * (label == 'eomgen') for label in labels)} |"
        yield "|---" + "|---:" * len(labels) + "|"
        for entry in entries:
            cells = [_quartiles(entry.ratios.get(label)) for label in labels]
            yield f"| {title(entry.kernel, entry.batch, report.batch_states)} | {' | '.join(cells)} |"
        yield ""
        said = dict.fromkeys(f"- {label}: {why}" for e in entries for label, why in e.missing.items())
        if said:
            yield from said
            yield ""


def _order(label: str) -> int:
    """Place of a column; eomgen itself, one state after the other beside its batch, comes first."""
    peer = label.split(" (")[0]
    return PEERS.index(peer) if peer in PEERS else -1


def _quartiles(ratio: Quartiles | None) -> str:
    return "" if ratio is None else f"{ratio[1]:.2f} ({ratio[0]:.2f} - {ratio[2]:.2f})"


def _why(entry: Entry, peer: str) -> str:
    """Return why there is no ratio to a peer."""
    return next((entry.missing[label] for label in ("not timed", "eomgen", peer) if label in entry.missing), "")


def lines(report: Report) -> list[str]:
    """Return lines for the terminal: every ratio that is required, and whether this run holds it."""
    rows = []
    for entry in report.entries:
        for peer in PEERS:
            bar = entry.bar(peer)
            if bar is None:
                continue
            name = f"{entry.title:34}{title(entry.kernel, entry.batch, report.batch_states):40}{peer:10}"
            if bar.measured is None:
                rows.append(f"{name} {'-':>7}   bar {bar.required:4g}   {_why(entry, peer)}")
            else:
                rows.append(f"{name} {bar.measured:7.2f}   bar {bar.required:4g}   {bar.verdict}")
    return rows
