"""Write the table of docs/simt.md: kernels of the text for accelerators that have the bits of the robot's C.

    python -m benchmarks.threads [--print] [--jobs N] [ROBOT ...]

All kernels of all built-in robots, and of thirty random ones, run as C++ and, where a runtime of OpenCL is installed,
on its first device, each in double and in single precision; numbers are robots of the tests.  The status is 1 where a
result differs that should not.
"""

from __future__ import annotations

import argparse
import itertools
import os
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from eomgen.codegen.package.compile import find_compiler
from eomgen.description import as_robot, builtin_robots
from tests.export.test_simt_bits import DTYPES, RANDOM, robot_of
from tests.support import simt
from tests.support.simt_runs import ALL, Answer, Subject, refusals

PAGE = Path(__file__).parents[1] / "docs" / "simt.md"
BEGIN, END = "<!-- begin of runs -->\n", "<!-- end of runs -->"
TITLES = {"c++": "C++", "opencl": "OpenCL"}
WORDS = {"float64": "double", "float32": "single"}


@dataclass(frozen=True)
class Run:
    """Answers of a robot's kernels in one precision; ``refused`` names what it has no text of, by the reason."""

    title: str
    robot: str
    size: int
    dtype: str
    answers: Sequence[Answer]
    refused: Mapping[str, str]


def runs(name: str, languages: Sequence[str]) -> Iterator[Run]:
    """Run all kernels of a robot in both precisions: a built-in one by name, a random one by number."""
    robot, near = robot_of(int(name)) if name.isdigit() else (as_robot(name), None)
    for dtype in DTYPES:
        with tempfile.TemporaryDirectory() as folder:
            subject = Subject(robot, dtype, Path(folder), near=near)
            answers = list(subject.answers(languages))
        title = f"random {name}" if name.isdigit() else f"`{name}`"
        run = Run(title, robot.name, subject.model.size, dtype, answers, refusals(subject.model))
        print(title, dtype, *(cell(run, language) for language in languages), file=sys.stderr, flush=True)
        for answer in answers:
            if not answer.is_right:
                print("  differs:", answer, file=sys.stderr, flush=True)
        yield run


def run_all(name: str, languages: Sequence[str]) -> list[Run]:
    """Run all kernels of a robot in both precisions, in a process of its own."""
    return list(runs(name, languages))


def cell(run: Run, language: str) -> str:
    """Say how many kernels have the same bits."""
    answers = [answer for answer in run.answers if answer.language == language]
    same = sum(answer.difference == 0.0 and answer.statuses for answer in answers)
    return f"{same} of {len(answers)}"


def table(made: Sequence[Run], languages: Sequence[str]) -> Iterator[str]:
    """Yield lines of the table: a row for each robot, random ones together by their kinds."""
    columns = [(language, dtype) for language in languages for dtype in DTYPES]
    heads = " | ".join(f"{TITLES[language]}, {WORDS[dtype]}" for language, dtype in columns)
    yield f"| robot | coordinates | {heads} |"
    yield "|---|---:" + "|---:" * len(columns) + "|"
    for title in dict.fromkeys(run.title for run in made):
        of = {run.dtype: run for run in made if run.title == title}
        cells = " | ".join(cell(of[dtype], language) for language, dtype in columns)
        yield f"| {title} | {of[DTYPES[0]].size} | {cells} |"


def differing(made: Sequence[Run]) -> Iterator[str]:
    """Yield what has other bits, by robot and language, with the largest difference."""
    for run in made:
        for language in TITLES:
            other = [x for x in run.answers if x.language == language and not (x.difference == 0.0 and x.statuses)]
            if other:
                worst = max(x.difference for x in other)
                names = ", ".join(f"`{x.kernel}`" for x in other)
                yield f"- {run.title}, {TITLES[language]}, {WORDS[run.dtype]}: within {worst:.0e}: {names}"


def absent(made: Sequence[Run]) -> Iterator[str]:
    """Yield the reasons why kernels are not there, with the robots, but for what a robot has nothing of."""
    by_reason: dict[tuple[str, str], list[str]] = {}
    for run in made:
        for kernel, text in run.refused.items():
            if "is for robots with" not in text:
                reason = text.replace(f"of {run.robot} ", "").partition(";")[0]
                by_reason.setdefault((reason, run.title), []).append(kernel)
    grouped: dict[tuple[str, tuple[str, ...]], list[str]] = {}
    for (reason, title), kernels in by_reason.items():
        grouped.setdefault((reason, tuple(dict.fromkeys(kernels))), []).append(title)
    for (reason, kernels), titles in grouped.items():
        yield f"- {', '.join(f'`{x}`' for x in kernels)}: {reason} ({', '.join(titles)})"


def page(made: Sequence[Run], languages: Sequence[str]) -> str:
    """Return what stands in the page of runs so far."""
    where = [f"`{find_compiler().version.splitlines()[0]}`, `-O0`"]
    for platform in simt.opencl_platforms()[:1]:
        device = platform.get_devices()[0]
        where.append(f"{platform.name}, {device.name.strip()}, driver {device.driver_version}")
    lines = [
        f"Kernels whose {simt.COUNT} states have the bits of the robot's C and its statuses, by {'; '.join(where)}.",
        "",
        *table(made, languages),
        "",
        "With other bits, all by functions of laws that are the device's:",
        "",
        *(list(differing(made)) or ["- none"]),
        "",
        "Not there, beside what a robot has nothing of:",
        "",
        *absent(made),
    ]
    return "\n".join(lines) + "\n"


def main() -> None:
    """Run all robots; write the table after each of them, unless it is to be printed at the end."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.threads", description=__doc__.partition("\n")[0])
    parser.add_argument("--print", action="store_true", help="write nothing")
    parser.add_argument("robots", nargs="*", metavar="ROBOT", help="built-in ones, and numbers of random ones (all)")
    parser.add_argument("--jobs", type=int, default=1, help="robots at once (1)")
    options = parser.parse_args()
    os.environ.setdefault("CFLAGS", "-O0")  # which changes no bits
    languages, made = ALL if simt.opencl_platforms() else ALL[:1], list[Run]()
    names = options.robots or [*sorted(builtin_robots()), *map(str, range(RANDOM))]
    with ProcessPoolExecutor(options.jobs) as pool:
        for found in pool.map(run_all, names, itertools.repeat(languages)):
            made += found
            if not options.print:
                before, _, rest = PAGE.read_text(encoding="utf-8").partition(BEGIN)
                text = page(made, languages)
                PAGE.write_text(before + BEGIN + text + END + rest.partition(END)[2], encoding="utf-8")
    if options.print:
        print(page(made, languages))
    sys.exit(0 if all(answer.is_right for run in made for answer in run.answers) else 1)


if __name__ == "__main__":
    main()
