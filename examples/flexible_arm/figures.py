"""Measure the figures of README.md.

    python examples/flexible_arm/figures.py [motions] [linearizations] [programs] [--write]

Times are processor times, medians over samples, or the least of some rounds.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from track import (
    COARSE,
    FINE,
    PLANT,
    SEGMENTS,
    Horizon,
    Linearization,
    Model,
    Run,
    Solved,
    closed_loop,
    compare,
    intervals,
    opening,
    report,
    solved,
)

PAGE = Path(__file__).parent / "README.md"
RUNS = (  # horizons, their words, methods, seconds of a motion
    *((FINE, method, 2.0) for method in ("gauss", "implicit", "rosenbrock")),
    *((COARSE, method, 4.0) for method in ("gauss", "rosenbrock")),
)


def words(horizon: Horizon) -> str:
    """Say how many intervals a horizon has, and how long it is."""
    return f"{horizon.intervals} over {horizon.duration:g} s"


def table(head: Sequence[str], rows: Sequence[Sequence[str]], texts: int) -> str:
    """Return a table; columns behind the first ones, which are texts, are numbers."""
    lines = [" | ".join(line) for line in (head, *rows)]
    lines.insert(1, "|".join(["---"] * texts + ["---:"] * (len(head) - texts)))
    return "\n".join(f"|{line}|" if line.startswith("---") else f"| {line} |" for line in lines)


def of_runs(runs: Sequence[tuple[Horizon, str, Run]]) -> str:
    """Return the table of motions."""
    head = ["horizon", "intervals by", "before the state is measured, ms", "after, ms", "tip within 20 mm from"]
    rows = []
    for horizon, method, run in runs:
        settled = "-" if run.settled is None else f"{horizon.sample * run.settled:.2f} s"
        before, after = (f"{x:.1f}" for x in run.times)
        rows.append([words(horizon), f"`{method}`", before, after, settled, f"{1e3 * run.distances[-1]:.1f}"])
    return table([*head, "off at the end, mm"], rows, 2)


def of_linearizations(found: Sequence[Linearization]) -> str:
    """Return the table of linearizations."""
    rows = [[f"`{x.method}`", x.model, f"{x.milliseconds:.1f}", f"{x.error:.0f}", f"{x.ready:.1f}"] for x in found]
    return table(["intervals by", "model", "ms", "largest error of an angle, mrad", "ready in, s"], rows, 2)


def of_solved(found: Sequence[tuple[Horizon, Solved]]) -> str:
    """Return the table of the first prediction as one nonlinear program."""
    head = ["horizon", "intervals by", "fatrop, iterations", "ms", "cost", "steps with HPIPM", "ms", "cost"]
    rows = [
        [
            *(words(horizon), f"`{x.method}`", str(x.iterations), f"{1e3 * x.seconds:.0f}", f"{x.cost:.1f}"),
            *((str(x.steps), f"{1e3 * x.of_steps:.0f}", f"{x.cost_of_steps:.1f}") if x.has_settled else 3 * ("-",)),
        ]
        for horizon, x in found
    ]
    return table(head, rows, 2)


def filled(text: str, parts: Mapping[str, str]) -> str:
    """Return the page with each part between its marks."""
    for name, part in parts.items():
        found = re.split(rf"(<!-- (?:begin|end) of {name} -->)", text)
        assert len(found) == 5, f"the page has one place for {name}"
        text = "".join([*found[:2], f"\n{part}\n", *found[3:]])
    return text


def motions() -> dict[str, str]:
    """Measure closed loops: what track.py says of the first one, and the table of all."""
    model, plant = Model(SEGMENTS), Model(PLANT, "adaptive_rollout")
    runs = [
        (horizon, method, closed_loop(model, plant, horizon, seconds, intervals(method, model, horizon)))
        for horizon, method, seconds in RUNS
    ]
    first = f"{opening(model, plant, FINE)}\n{report(runs[0][2], FINE)}"
    return {
        "motion": f"```console\n$ python examples/flexible_arm/track.py\n{first}\n```",
        "motions": of_runs(runs),
    }


def linearizations() -> dict[str, str]:
    """Measure linearizations of a horizon."""
    return {"linearizations": of_linearizations(compare(Model(SEGMENTS), FINE))}


def programs() -> dict[str, str]:
    """Solve the first prediction in both ways, for both horizons."""
    model, methods = Model(SEGMENTS), ("implicit", "rosenbrock")
    return {"programs": of_solved([(x, solved(model, x, method)) for x in (FINE, COARSE) for method in methods])}


PARTS = {"motions": motions, "linearizations": linearizations, "programs": programs}


def main() -> None:
    parser = argparse.ArgumentParser(description="Measure figures of README.md.")
    parser.add_argument(
        "parts", nargs="*", choices=[[], *PARTS], metavar="PART", help=f"{', '.join(PARTS)}; default all"
    )
    parser.add_argument("--write", action="store_true", help="put them into README.md")
    options = parser.parse_args()
    for part in options.parts or PARTS:
        found = PARTS[part]()
        print(*found.values(), sep="\n\n")
        if options.write:
            PAGE.write_text(filled(PAGE.read_text(encoding="utf-8"), found), encoding="utf-8")


if __name__ == "__main__":
    main()
