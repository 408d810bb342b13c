"""How long starts and first builds take: python benchmarks/start.py [--rounds ROUNDS] [ROBOT ...].

All contenders take turns, each in a process of its own; the least of all rounds is printed: seconds on the clock, and
of the processor (with the compiler's).  A first build begins with an empty cache.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

COMMANDS: Mapping[str, tuple[str, ...]] = {
    "python -c pass": ("-c", "pass"),
    "import numpy": ("-c", "import numpy"),
    "import eomgen": ("-c", "import eomgen"),
    "eomgen --help": ("-m", "eomgen", "--help"),
    "eomgen cache": ("-m", "eomgen", "cache"),
    "eomgen robots": ("-m", "eomgen", "robots"),
    "eomgen info one_link": ("-m", "eomgen", "info", "one_link"),
}
FIRST = """
import eomgen
kernel = eomgen.build({robot!r}, kernels={kernels!r})
zero = [0.0] * kernel.n
kernel.forward_dynamics(zero, zero, zero)
"""
BUILDS: Mapping[str, tuple[str, ...]] = {"forward dynamics alone": ("forward_dynamics",), "all kernels": ()}


@dataclass
class Least:
    """The least of several rounds, in s."""

    clock: float = float("inf")
    processor: float = float("inf")


def measure(words: Sequence[str], least: Least) -> None:
    """Run Python once with these arguments and an empty cache; subprocess.CalledProcessError where it fails."""
    with tempfile.TemporaryDirectory() as cache:
        environment = {**os.environ, "EOMGEN_CACHE_DIR": cache}
        before, start = os.times(), time.perf_counter()
        subprocess.run([sys.executable, *words], env=environment, check=True, stdout=subprocess.DEVNULL)
        clock, after = time.perf_counter() - start, os.times()
    spent = after.children_user + after.children_system - before.children_user - before.children_system
    least.clock, least.processor = min(least.clock, clock), min(least.processor, spent)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "robots", metavar="ROBOT", nargs="*", default=["ur5"], help="whose first builds are timed (ur5)"
    )
    parser.add_argument("--rounds", type=int, default=5, help="turns of each (5)")
    options = parser.parse_args()
    contenders = dict(COMMANDS)
    for robot in options.robots:
        for what, kernels in BUILDS.items():
            contenders[f"{robot}, {what}"] = ("-c", FIRST.format(robot=robot, kernels=kernels))
    least = {name: Least() for name in contenders}
    for _ in range(options.rounds):
        for name, words in contenders.items():
            measure(words, least[name])
    print(f"{'':<44}{'clock':>8}{'processor':>12}")
    for name, found in least.items():
        print(f"{name:<44}{found.clock:>8.3f}{found.processor:>12.3f}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
