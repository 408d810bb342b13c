"""Write the table of docs/global_error.md: estimated errors of the tool beside those of a far closer integration.

python -m benchmarks.global_error [--print]
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import eomgen

PAGE = Path(__file__).parents[1] / "docs" / "global_error.md"
BEGIN, END = "<!-- begin of errors -->\n", "<!-- end of errors -->"
CASES = (
    *(("ur5", method) for method in ("tsit5", "rosenbrock", "radau", "auto")),
    *((robot, "auto") for robot in ("geared_arm", "worn_arm", "four_bar", "two_arms")),
)
CLOSER = 1e-11  # rtol of what counts as exact


def row(robot: str, method: str) -> str:
    """Return a row of the table."""
    options = {"duration": 1.0, "method": method, "rtol": 1e-4}
    result = eomgen.simulate(robot, global_error=True, **options)
    closer = eomgen.simulate(robot, duration=1.0, rtol=CLOSER)
    true = float(np.linalg.norm(result.pose[:, :3, 3] - closer.pose[:, :3, 3], axis=1).max())
    estimate = result.global_error
    assert estimate is not None
    assert estimate.tool_max is not None
    steps = result.trajectory.info["steps"]
    cells = [
        f"{robot}",
        f"`{method}`",
        f"{steps:.0f}",
        f"{1e6 * true:.3g}",
        f"{1e6 * estimate.tool_max:.3g}",
        f"{estimate.tool_max / true:.2f}",
        f"{100.0 * estimate.unresolved:.2g}",
    ]
    return f"| {' | '.join(cells)} |"


def table() -> Iterator[str]:
    """Yield the lines of the table."""
    yield (
        "Measured by `python -m benchmarks.global_error`: 1 s of each robot's usual motion at rtol 1e-4, 1000 samples;"
        f" exact is what `auto` computes at rtol {CLOSER:.0e}."
    )
    yield ""
    yield ("| robot | method | steps | tool off by, um | estimated, um | ratio | open, % |")
    yield "|---|---|---:|---:|---:|---:|---:|"
    for robot, method in CASES:
        yield row(robot, method)


def main() -> None:
    """Write the table into the page, or print it."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.global_error")
    parser.add_argument("--print", action="store_true", help="print the table, and leave the page as it is")
    options = parser.parse_args()
    text = "\n".join(table()) + "\n"
    if options.print:
        print(text)
        return
    page = PAGE.read_text(encoding="utf-8")
    front, rest = page.split(BEGIN)
    PAGE.write_text(front + BEGIN + text + END + rest.split(END)[1], encoding="utf-8")


if __name__ == "__main__":
    main()
