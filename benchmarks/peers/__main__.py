"""Command line: ``python -m benchmarks.peers [--repeat ROUNDS] [--page] [--calls] [--gradients] [ROBOT ...]``."""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path

from . import page
from .cases import GROWING, TITLES
from .gradients import gradients
from .plot import plot
from .python_calls import python_calls
from .report import read
from .run import run

DOCS = Path(__file__).parents[2] / "docs"


def main() -> int:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.peers",
        description="Measure this project's kernels beside Pinocchio, MuJoCo, CasADi and a textbook's algorithms, and"
        " write docs/peers.json, docs/peers.md and docs/peers.svg.",
    )
    parser.add_argument("robots", nargs="*", metavar="ROBOT", help=f"of {', '.join(TITLES)}: prints, writes nothing")
    parser.add_argument("--repeat", type=int, default=100, metavar="ROUNDS", help="rounds per row (default 100)")
    parser.add_argument("--page", action="store_true", help="write page and plot from docs/peers.json, time nothing")
    parser.add_argument("--calls", action="store_true", help="time calls from Python alone; the rest stays as it is")
    parser.add_argument("--gradients", action="store_true", help="time gradients of rollouts alone, likewise")
    arguments = parser.parse_args()
    unknown = [name for name in arguments.robots if name not in TITLES]
    if unknown:
        parser.error(f"ROBOT: {unknown[0]!r} is unknown; allowed: {', '.join(TITLES)}")
    if arguments.repeat < 1:
        parser.error(f"--repeat: {arguments.repeat} is not a number of rounds; at least 1")
    disagreements: list[str] = []
    if arguments.calls or arguments.gradients:
        last = read(DOCS / "peers.json")
        if arguments.calls:
            last = replace(last, calls=python_calls(arguments.repeat))
        if arguments.gradients:
            last = replace(last, gradients=gradients(arguments.repeat)[0])
        last.write(DOCS / "peers.json")
    elif not arguments.page:
        progress = (lambda line: print(line, file=sys.stderr)) if sys.stderr.isatty() else (lambda line: None)
        growing = () if arguments.robots else GROWING
        report, disagreements = run(arguments.repeat, progress, arguments.robots, growing)
        print("\n".join(page.lines(report)))
        for peer, why in report.missing.items():
            print(f"missing: {peer}: {why}")
        for text in disagreements:
            print(f"differs: {text}", file=sys.stderr)
        if arguments.robots:
            return int(bool(disagreements))
        report.write(DOCS / "peers.json")
    report = read(DOCS / "peers.json")
    (DOCS / "peers.md").write_text(page.page(report), encoding="ascii")
    if not (arguments.calls or arguments.gradients):
        plot(report, DOCS / "peers.svg")
    print("wrote docs/peers.*")
    return int(bool(disagreements))


if __name__ == "__main__":
    sys.exit(main())
