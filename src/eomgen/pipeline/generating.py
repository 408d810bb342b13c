"""Packages: a folder with C, binaries for the levels of processors, and Python that calls them."""

from __future__ import annotations

import itertools
import json
import os
import sys
import warnings
from dataclasses import replace
from importlib.machinery import PathFinder
from pathlib import Path

from ..codegen.kernels.groups import PACKAGE, kernel_group
from ..codegen.kernels.signatures import OWN_KERNELS
from ..description import RobotLike, as_robot
from ..errors import EomgenWarning, InputError
from ..files import as_path, check_ending, read_regular, write_atomically
from ..identifiers import plain_path
from ..names import show
from ..progress import Progress, no_progress, tells_at_prompt
from ..robot.value import Robot
from ..runtime.levels import best_level
from . import cache as store
from . import direct_calls
from .derivations import derived_model
from .folders import new_folder, put_folder
from .options import ALL, Options
from .stages import Described, derive, describe, make_package, tools_for

MOST_SAMPLES = 1000
_LARGEST = 1 << 28  # bytes of a package's metadata
NEEDED = ("numpy", "cffi", "_cffi_backend", "eomgen")  # what a package imports, and what writes it
_BINARIES = (".so", ".pyd", ".dylib", ".dll")


@tells_at_prompt("generating")
def generate(
    robot: RobotLike,
    folder: Path | str,
    options: Options | None = None,
    *,
    cmake: bool = False,
    ros2: bool = False,
    report: Path | str | None = None,
    samples: int = 0,
    progress: Progress = no_progress,
) -> Path:
    """Write the importable package ``folder/<robot.name>`` and return its path.

    It has binaries for several x86-64 levels, those of further levels in separate folders, and loads the best
    one that runs where it is imported.  Binaries of levels beyond this processor are compiled, but not tried.
    The header says what SymPy derived of the robot's joints, and how many terms of eqs. (11) and (12) vanish by which
    lemma.  A package of an earlier generation there is replaced; a folder that holds anything else is refused.

    Args:
        robot: a Robot, the name of a built-in one, or the path of a description.
        folder: where the package's folder is made.
        options: see Options; by default with the kernels of PACKAGE, for any processor and for the best level here.
        cmake: write a header for C++17, a CMake project, a pkg-config file and a MEX file's source for MATLAB, too.
        ros2: write them, and a package of ROS 2 in the folder ``ros2``, which simulates the robot.
        report: file to write the derivation to, .html or .tex: joint matrices, surviving terms, and of small robots
            the closed form.
        samples: with the C99 program NAME_samples.c, which tests all functions in so many random states, up to
            MOST_SAMPLES; 0: without.
        progress: called with the share of stages that are done and a line of text when the next one begins.

    Raises:
        InputError: the target exists and is not a generated package, the folder cannot be written, the robot is named
            as a module that Python or the package needs, ROS 2 is asked for without the kernel ``rollout``, or the
            report has another ending.
        BuildError: see ``build``.
    """
    from ..codegen.c.projects.samples import render_samples
    from ..codegen.derivation.report import render_report, with_summary

    folder, robot = Path(as_path(folder, "folder")), as_robot(robot)
    page = None if report is None else check_ending(report, ".html", ".tex", label="report")
    if isinstance(samples, bool) or not isinstance(samples, int) or not 0 <= samples <= MOST_SAMPLES:
        raise InputError(f"samples: {show(samples)}; allowed: a whole number from 0 to {MOST_SAMPLES}")
    hidden = check_module_name(robot.name)
    if hidden:
        warnings.warn(hidden, EomgenWarning, stacklevel=3)  # above the function that tells at a prompt
    described = describe(robot, package_options(robot, options)).with_beside()
    files, model, header = _files_of_levels(described, progress), derived_model(robot), f"{robot.name}.h"
    files = {**files, header: with_summary(files[header].decode("ascii"), model).encode("ascii")}
    if samples:
        files[f"{robot.name}_samples.c"] = render_samples(derive(described), samples).encode("ascii")
    target = folder / robot.name
    try:
        _write_package(target, files, described.options, cmake=cmake or ros2, ros2=ros2)
    except OSError as error:
        raise InputError(f"{target} cannot be written: {error.strerror or error}") from None
    if page is not None:
        write_atomically(page, lambda stream: stream.write(render_report(model, page.suffix).encode()), read=None)
    return target


def package_options(robot: RobotLike, options: Options | None = None) -> Options:
    """Return options with the kernels that a robot's package has: of PACKAGE without names, and for "all" every one."""
    options = options or Options()
    named = [name for name in options.kernels if name != ALL]
    group = PACKAGE if not options.kernels else OWN_KERNELS if ALL in options.kernels else ()
    return replace(options, kernels=tuple(dict.fromkeys((*kernel_group(as_robot(robot), group), *named))))


def left_out(robot: Robot) -> tuple[str, ...]:
    """Return names of the kernels, without derivatives, that a robot has and a package has on request alone."""
    described = describe(robot, package_options(robot)).with_beside()
    return tuple(x for x in kernel_group(described.model, OWN_KERNELS) if x not in described.options.kernels)


def _write_package(target: Path, files: store.Files, options: Options, *, cmake: bool, ros2: bool) -> None:
    """Write a package's files, and the extension module where it can be had, in place of an earlier package."""
    from ..codegen.package.compile import find_compiler

    _check_target(target, target)
    target.parent.mkdir(parents=True, exist_ok=True)
    with new_folder(target) as private:
        binary = direct_calls.binary_of(find_compiler())
        store.write_files(private, {**files, **{f"runtime/{name}": data for name, data in binary.items()}})
        if cmake:
            _write_project(private, target.name, options, ros2)
        private.chmod(0o755)
        put_folder(private, target, lambda place: _check_target(place, target))


def _files_of_levels(described: Described, progress: Progress) -> store.Files:
    """Return files of a package, and the binaries of each further x86-64 level in a folder."""
    from ..codegen.package.compile import carried_contents, find_compiler
    from ..codegen.package.levels import check_possible, possible_levels

    options, name, compiler = described.options, described.robot.name, find_compiler()
    possible = possible_levels(compiler, options.flags)
    asked = possible if ALL in options.levels else options.levels
    for level in asked:
        check_possible(level, possible)
    best = dict.fromkeys((possible[0], best_level(possible)))
    levels = ("",) if options.native else asked or tuple(best)
    begun = itertools.count()  # stages: the derivation, and each level

    def report(text: str) -> None:
        progress(next(begun) / (1 + len(levels)), text)

    made = [make_package(described, tools_for(options, level), "", report).files for level in levels]
    codes = [data.decode("ascii") for file, data in made[0].items() if file.endswith((".c", ".h"))]
    collected = {**carried_contents(json.loads(made[0][f"{name}.json"]), *codes), **made[0]}
    for level, files in zip(levels[1:], made[1:], strict=True):
        loaded = [x for x in files if "/" not in x and (x.endswith(_BINARIES) or x == f"_{name}.py")]
        collected |= {f"{level}/{file}": files[file] for file in loaded}
    return collected


def _write_project(package: Path, name: str, options: Options, ros2: bool) -> None:
    """Add what makes the package a project of C and C++, and one of ROS 2."""
    from ..codegen.c.projects.project import project_files
    from ..codegen.c.projects.ros2 import ros2_files
    from ..codegen.package.compile import kernel_flags

    meta, header = json.loads((package / f"{name}.json").read_bytes()), (package / f"{name}.h").read_text("ascii")
    for file, text in project_files(meta, header, (*kernel_flags(options.native), *options.flags)).items():
        (package / file).write_text(text, encoding="ascii")
    for file, text in ros2_files(meta).items() if ros2 else ():
        place = package / "ros2" / file
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_text(text, encoding="ascii")


def _check_target(place: Path, target: Path) -> None:
    """Raise InputError if a file is in the way that no generation of the target wrote; an empty folder is none."""
    try:
        text = read_regular(place / f"{target.name}.json", _LARGEST)
        foreign = "eomgen" not in json.loads(text)["generator"]
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        foreign = any(place.iterdir()) if os.path.isdir(place) else os.path.lexists(place)
    if foreign:
        shown = plain_path(target)
        raise InputError(f"{shown} exists and is not a generated package; give another folder with -o, or move it")


def check_module_name(name: str) -> str:
    """Refuse a name for a package that could not be imported, or that would break others.

    Args:
        name: of the package.

    Returns:
        A note about a package of that name that is installed and would be hidden, or hide this one; "" where there is
        none.

    Raises:
        InputError: it is the name of a module of Python itself, or of what the package needs.
    """
    if name in NEEDED or name in sys.stdlib_module_names:
        owner = "which the package itself imports" if name in NEEDED else "a module of Python itself"
        raise InputError(f"name: the package would be called {name!r}, {owner}; allowed: another name of the robot")
    spec = PathFinder.find_spec(name)  # of those on sys.path; nothing is imported
    if spec is None or _is_generated(name, spec.origin):
        return ""
    return f"a package {name!r} is installed; where both can be found, import takes the first on sys.path"


def _is_generated(name: str, origin: str | None) -> bool:
    """Whether a module is a package that was generated before."""
    try:
        return origin is not None and b'"generator"' in read_regular(Path(origin).parent / f"{name}.json", _LARGEST)
    except (OSError, ValueError):
        return False
