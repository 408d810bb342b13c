"""Print what cold builds cost: ``python benchmarks/builds.py [--repeat TIMES] [ROBOT ...]``.

Each build runs in a process of its own with an empty cache.  "first" is from the process's start to the first forward
dynamics of a kernel that has that function alone, "all" to a package with every kernel; wall seconds depend on what
else runs, processor seconds less so.  "memory" is the largest resident size of one process among the compilers.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from time import perf_counter

ROBOTS = ("puma560", "puma560_elastic")
WORK = """
import json, resource, sys
import numpy as np
import eomgen
from eomgen.pipeline.stages import Options, make_package
robot = eomgen.load_robot(sys.argv[1])
if sys.argv[2] == "all":
    make_package(robot, Options())
else:
    kernel = eomgen.build(robot, kernels=("forward_dynamics",))
    kernel.forward_dynamics(*np.zeros((3, kernel.n)))
own, others = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
print(json.dumps([own.ru_utime + own.ru_stime, others.ru_utime + others.ru_stime, others.ru_maxrss / 1024]))
"""


@dataclass(frozen=True)
class Cost:
    """What a build cost: wall seconds, processor seconds of Python and of compilers, the largest compiler's MB."""

    wall: float
    python: float
    compilers: float
    memory: float


def cold_build(robot: str, what: str) -> Cost:
    """Build in a process of its own, with a cache that is empty and goes when it ends.

    Args:
        robot: a built-in robot or the path of a description.
        what: "first" or "all".

    Raises:
        subprocess.CalledProcessError: the build failed; it has said why.
    """
    with tempfile.TemporaryDirectory(prefix="eomgen-builds-") as folder:
        begin = perf_counter()
        done = subprocess.run(
            [sys.executable, "-W", "ignore", "-c", WORK, robot, what],
            env={**os.environ, "EOMGEN_CACHE_DIR": folder},
            stdout=subprocess.PIPE,
            text=True,
            check=True,
        )
        wall = perf_counter() - begin
    return Cost(wall, *json.loads(done.stdout))


def table(robots: Sequence[str], repeat: int) -> list[str]:
    """Lines of a table in Markdown: of every build the one that took the compilers least."""
    lines = [
        "| robot | build | wall, s | Python, s | compilers, s | memory, MB |",
        "|---|---|---:|---:|---:|---:|",
    ]
    for robot in robots:
        for what in ("first", "all"):
            cost = min((cold_build(robot, what) for _ in range(repeat)), key=lambda found: found.compilers)
            numbers = f"{cost.wall:.2f} | {cost.python:.2f} | {cost.compilers:.2f} | {cost.memory:.0f}"
            lines.append(f"| {os.path.basename(robot)} | {what} | {numbers} |")
    return lines


def main() -> int:
    parser = argparse.ArgumentParser(description="Measure builds from an empty cache.")
    parser.add_argument("robots", nargs="*", metavar="ROBOT", help=f"names or paths (default: {' '.join(ROBOTS)})")
    parser.add_argument("--repeat", type=int, default=1, metavar="TIMES", help="builds of each (default 1)")
    arguments = parser.parse_args()
    print("\n".join(table(arguments.robots or ROBOTS, arguments.repeat)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
