"""Cost of starts, first builds and packages: ``python -m benchmarks.builds [--packages] [--rounds N] [ROBOT ...]``.

All of them take turns, each in a process; caches are empty where nothing else is said; the least of all rounds counts.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from time import perf_counter

from eomgen.bench.beside import processor_name
from eomgen.codegen.c.expected import pack_expected, read_expected
from eomgen.errors import InternalError
from eomgen.pipeline.load import load_module
from eomgen.pipeline.options import Options
from eomgen.pipeline.self_test import first_difference
from eomgen.pipeline.stages import derive, describe, make_package, tools_for

from .bars import Bar, conclusion
from .peers.cases import URDFS, case
from .size import CODE, PYTHON, size_of

PAGE = Path(__file__).parents[1] / "docs" / "builds.md"
STARTS: Mapping[str, tuple[str, ...]] = {
    "`import numpy`": ("-c", "import numpy"),
    "`import eomgen`": ("-c", "import eomgen"),
    "`eomgen --help`": ("-m", "eomgen", "--help"),
    "`eomgen cache`": ("-m", "eomgen", "cache"),
    "`eomgen robots`": ("-m", "eomgen", "robots"),
    "`eomgen info one_link`": ("-m", "eomgen", "info", "one_link"),
    "`eomgen simulate puma560_elastic`": ("-m", "eomgen", "simulate", "puma560_elastic", "-o", "{folder}/out"),
}
ANSWER = "import sys, numpy, eomgen; k = eomgen.build(sys.argv[1]); k.mass_matrix(numpy.zeros(k.n))"
ANSWERS = {  # in one cache, one after the other
    '`eomgen.build("ur5").mass_matrix(q)`, empty cache': "ur5",
    "the same of `panda`, with the cache of the first": "panda",
    "the same of `ur5` again": "ur5",
}
SELF_TEST = "self-test of `ur5`, all kernels"
ROBOTS = ("ur5", "puma560_elastic", "Talos")
MEASURED = (
    "forward_dynamics",
    "residual_jacobian",
    "forward_dynamics_jacobian",
    "inverse_dynamics_hessian",
    "forward_dynamics_hessian",
    "explicit_gradient",
    "implicit_gradient",
    "rosenbrock_gradient",
)
DYNAMICS, EVERY = "derivatives of the dynamics", "derivatives of all kernels"
BUILDS = {
    "forward dynamics, from Python's start": "",
    "all kernels": "all",
    DYNAMICS: ",".join(MEASURED),
    EVERY: "derivatives",
}
DIFFERENTIATED = {DYNAMICS: ("ur5", "Talos"), EVERY: ("ur5",)}  # robots; of Talos some programs are refused as too long
BARS: Mapping[tuple[str, str], tuple[float, float]] = {  # (robot, what) -> seconds on the clock, MB that are to hold
    (robot, what): (seconds, 2000.0)
    for what, robots in DIFFERENTIATED.items()
    for robot, seconds in (("ur5", 5.0), ("Talos", 60.0))
    if robot in robots
}
WORK = """
import json, resource, sys, warnings
warnings.simplefilter("ignore")
import numpy as np
import eomgen
robot, kernels = eomgen.load_robot(sys.argv[1]), sys.argv[2]
if kernels == "derivatives":
    from eomgen.codegen.kernels.signatures import KERNELS, available
    from eomgen.robot.model import build_model

    known = available(build_model(robot))
    kernels = ("forward_dynamics", *(name for name in known if KERNELS[name].derivative_of))
elif kernels != "all":
    kernels = tuple(filter(None, kernels.split(",")))
kernel = eomgen.build(robot, kernels=kernels)
kernel.forward_dynamics(*np.zeros((3, kernel.n)))
here, others = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
memory = [x.ru_maxrss / 1024 for x in (here, others)]
print(json.dumps([here.ru_utime + here.ru_stime, others.ru_utime + others.ru_stime, max(memory)]))
"""
PACKAGES: Mapping[str, float] = {"one_link": 4.0, "ur5": 7.0, "puma560_elastic": 24.0}  # s of processors at most
CLOCK = 2 / 3  # of that, on the clock
IMPORT = """
import sys, time, numpy
sys.path.insert(0, sys.argv[1])
begin = time.perf_counter()
__import__(sys.argv[2])
print(time.perf_counter() - begin)
"""
HEAD = """# What a first build costs

A kernel is derived and compiled when it is first called, and comes from the cache from then on; its functions for
batches are compiled when a batch is first asked for. These are times
without a cache, Python's start and imports of NumPy and SymPy included. SymPy derives joints; the cache holds the
result for all robots whose joints have the same active coordinates ([Theory](theory.md)). Rollouts with error
control are linked with [the C library](library.md), whose objects a machine's first build of them compiles during the
derivation, as here, and later ones find in the cache.
Measured on {processor} with {cores} cores by `python -m benchmarks.builds`: the least of
{rounds} rounds in turns, in seconds. The time of all kernels is that of one library with all but derivatives.
Derivatives of the dynamics are, in one library with functions for batches, first and second ones of inverse and forward
dynamics and gradients of rollouts by all methods; those of all kernels are all that `kernels=` can name. In brackets
stands what is to hold of them, in seconds and MB on two quiet cores; they are built {deep}.

Packages are those of `eomgen generate ROBOT` with an empty cache, from the start of the process to a package that
imports. CPU is the time of all processors, compilers included; budgets of both times stand in brackets. Lines and kB
are those of sources in the package. Its import is timed behind that of NumPy.
"""


@dataclass(frozen=True)
class Cost:
    """What a process cost: seconds on the clock, of Python, of compilers; MB of the largest of these processes."""

    wall: float
    python: float = 0.0
    compilers: float = 0.0
    memory: float = 0.0


def start(words: Sequence[str]) -> Cost:
    """Run Python with these words and an empty cache.

    Raises:
        subprocess.CalledProcessError: it fails, and has said why.
    """
    return _timed(words)[0]


def answers() -> dict[str, Cost]:
    """Time processes that build a robot and call it, with one cache.

    Raises:
        subprocess.CalledProcessError: a build failed, and has said why.
    """
    with tempfile.TemporaryDirectory(prefix="eomgen-builds-") as folder:
        return {name: _timed_in(folder, ("-c", ANSWER, robot))[0] for name, robot in ANSWERS.items()}


def self_test() -> float:
    """Time the self-test of the ur5 with all kernels, s: the numbers that are expected, and the comparison."""
    described = describe("ur5", Options())
    equations, package = derive(described), make_package(described, tools_for(described.options))
    module, meta = load_module(package, "ur5"), json.loads(package.files["ur5.json"])
    begin = perf_counter()
    difference = first_difference(module, meta, read_expected(pack_expected(equations)))
    taken = perf_counter() - begin
    if difference is not None:
        raise InternalError(difference)
    return taken


def build(robot: str, kernels: str) -> Cost:
    """Build and call forward dynamics, by the path of a description or the name of a built-in one.

    Raises:
        subprocess.CalledProcessError: the build failed, and has said why.
    """
    cost, said = _timed(("-c", WORK, robot, kernels))
    return Cost(cost.wall, *json.loads(said))


def _timed(words: Sequence[str]) -> tuple[Cost, str]:
    with tempfile.TemporaryDirectory(prefix="eomgen-builds-") as folder:
        return _timed_in(folder, words)


def _timed_in(folder: str, words: Sequence[str]) -> tuple[Cost, str]:
    command = [sys.executable, *(word.replace("{folder}", folder) for word in words)]
    environment = {**os.environ, "EOMGEN_CACHE_DIR": f"{folder}/cache"}
    environment.pop("PYTHONDONTWRITEBYTECODE", None)  # modules are compiled once for all users
    begin = perf_counter()
    done = subprocess.run(command, env=environment, stdout=subprocess.PIPE, text=True, check=True)
    return Cost(perf_counter() - begin), done.stdout


@dataclass(frozen=True)
class Package:
    """What a package of ``eomgen generate`` cost, s, how large its sources are, and how long its import takes, ms."""

    robot: str
    cpu: float
    wall: float
    lines: int
    python_lines: int
    kilobytes: float
    import_ms: float

    def bars(self) -> tuple[Bar, Bar]:
        """Return what is required of the time of processors and of that on the clock."""
        most = PACKAGES[self.robot]
        return (
            Bar(f"package {self.robot}, CPU, s", self.cpu, most, at_most=True),
            Bar(f"package {self.robot}, clock, s", self.wall, round(CLOCK * most, 2), at_most=True),
        )


def package(robot: str) -> Package:
    """Generate a package with an empty cache, and import it.

    Raises:
        subprocess.CalledProcessError: one of both failed, and has said why.
    """
    with tempfile.TemporaryDirectory(prefix="eomgen-builds-") as folder:
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        cost, _ = _timed_in(folder, ("-m", "eomgen", "generate", robot, "-o", "{folder}/packages"))
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        files = [path for path in Path(folder, "packages", robot).rglob("*") if path.suffix in CODE]
        sizes = {path: size_of(path.name, path.read_bytes()) for path in files}
        imports = [float(_timed_in(folder, ("-c", IMPORT, "{folder}/packages", robot))[1]) for _ in range(3)]
    return Package(
        robot,
        after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime,
        cost.wall,
        sum(size.lines for size in sizes.values()),
        sum(size.lines for path, size in sizes.items() if path.suffix in PYTHON),
        sum(size.bytes for size in sizes.values()) / 1000,
        1000.0 * min(imports),
    )


@dataclass(frozen=True)
class Built:
    """A build of a robot: what was built, and the cheapest round of it."""

    robot: str
    what: str
    cost: Cost

    def bars(self) -> tuple[Bar, ...]:
        """Return what is required of the time on the clock and of the largest process, if anything is."""
        most = BARS.get((self.robot, self.what), ())
        measured = zip(("s", "MB"), (self.cost.wall, self.cost.memory), most, strict=False)
        return tuple(Bar(f"{self.robot}, {self.what}, {unit}", x, y, at_most=True) for unit, x, y in measured)


@dataclass(frozen=True)
class Report:
    """A run: where, how often, starts of Python, s, and builds; docs/builds.json."""

    processor: str
    cores: int
    rounds: int
    deep: int
    starts: Mapping[str, float]
    builds: tuple[Built, ...]
    packages: tuple[Package, ...] = ()

    def write(self, path: Path) -> None:
        """Write it as JSON, hundredths of seconds and whole MB."""
        text = json.dumps(asdict(self), indent=1, default=float)
        values = json.loads(text, parse_float=lambda x: round(float(x), 2))
        path.write_text(json.dumps(values, indent=1) + "\n", encoding="ascii")


def read(path: Path) -> Report:
    """Return the report of a JSON file."""
    values = json.loads(path.read_text(encoding="ascii"))
    built = tuple(Built(**{**each, "cost": Cost(**each["cost"])}) for each in values.pop("builds"))
    packages = tuple(Package(**each) for each in values.pop("packages", ()))
    return Report(**values, builds=built, packages=packages)


def measure(robots: Sequence[str], rounds: int, deep: int) -> Report:
    """Start and build in turns; ``deep``: rounds of builds of derivatives."""
    starts: dict[str, list[Cost]] = {name: [] for name in (*STARTS, *ANSWERS)}
    builds: dict[tuple[str, str], list[Cost]] = {
        (robot, what): []
        for robot in robots
        for what in BUILDS
        if what not in DIFFERENTIATED or (deep and robot in DIFFERENTIATED[what])
    }
    for turn in range(max(rounds, deep)):
        if turn < rounds:
            for name, cost in {**{name: start(words) for name, words in STARTS.items()}, **answers()}.items():
                starts[name].append(cost)
        for (robot, what), costs in builds.items():
            if turn < (deep if what in DIFFERENTIATED else rounds):
                costs.append(build(str(case(robot).urdf) if robot in URDFS else robot, BUILDS[what]))
    return Report(
        processor_name(),
        len(os.sched_getaffinity(0)),
        rounds,
        deep,
        {name: min(cost.wall for cost in costs) for name, costs in starts.items()}
        | {SELF_TEST: min(self_test() for _ in range(rounds))},
        tuple(Built(*key, min(costs, key=lambda cost: cost.wall)) for key, costs in builds.items()),
        measure_packages(rounds),
    )


def measure_packages(rounds: int) -> tuple[Package, ...]:
    """Generate packages in turns; of each the round with the least time of processors counts."""
    turns = [[package(robot) for robot in PACKAGES] for _ in range(rounds)]
    return tuple(min(each, key=lambda made: made.cpu) for each in zip(*turns, strict=True))


def page(report: Report) -> str:
    """Return the page with its tables in Markdown."""
    head = HEAD.format(
        processor=report.processor,
        cores=report.cores,
        rounds=report.rounds,
        deep="once" if report.deep == 1 else f"{report.deep} times",
    )
    lines = ["| start | s |", "|---|---:|"]
    lines += [f"| {name} | {wall:.2f} |" for name, wall in report.starts.items()]
    lines += ["", "| robot | what is built | clock | Python | compilers | largest process, MB |"]
    lines += ["|---|---|---:|---:|---:|---:|"]
    for built in report.builds:
        cost = built.cost
        clock, memory = [f" {bar.brackets}" for bar in built.bars()] or ("", "")
        numbers = f"{cost.wall:.2f}{clock} | {cost.python:.2f} | {cost.compilers:.2f} | {cost.memory:.0f}{memory}"
        lines.append(f"| {os.path.basename(built.robot)} | {built.what} | {numbers} |")
    lines += ["", "| package | CPU, s | clock, s | lines | of Python | kB | import, ms |"]
    lines += ["|---|---:|---:|---:|---:|---:|---:|"]
    for made in report.packages:
        cpu, clock = (bar.brackets for bar in made.bars())
        sizes = f"{made.lines:,} | {made.python_lines:,} | {made.kilobytes:.0f} | {made.import_ms:.0f}"
        lines.append(f"| {made.robot} | {made.cpu:.2f} {cpu} | {made.wall:.2f} {clock} | {sizes} |")
    bars = [bar for each in (*report.builds, *report.packages) for bar in each.bars()]
    said = ["", conclusion(bars)] if bars else []
    return head + "\n" + "\n".join([*lines, *said]) + "\n"


def main(words: Sequence[str] | None = None) -> int:
    """Measure, and write the page and what was measured beside it."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.builds", description="Measure starts and first builds.")
    parser.add_argument("robots", nargs="*", metavar="ROBOT", help=f"names or paths (default: {' '.join(ROBOTS)})")
    parser.add_argument("--rounds", type=int, default=3, help="turns of each (3)")
    parser.add_argument("--deep", type=int, default=1, help="builds of derivatives, minutes each (1)")
    parser.add_argument("--page", action="store_true", help="write the page from the .json beside it, without timing")
    parser.add_argument("--packages", action="store_true", help="measure packages alone; other figures stay")
    parser.add_argument("-o", "--output", type=Path, default=PAGE, metavar="FILE", help="the page (docs/builds.md)")
    options = parser.parse_args(words)
    kept = options.output.with_suffix(".json")
    if options.packages:
        replace(read(kept), packages=measure_packages(options.rounds)).write(kept)
    elif not options.page:
        measure(options.robots or ROBOTS, options.rounds, options.deep).write(kept)
    options.output.write_text(page(read(kept)), encoding="ascii")
    return 0


if __name__ == "__main__":
    sys.exit(main())
