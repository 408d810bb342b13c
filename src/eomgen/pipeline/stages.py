"""Robot -> Kernel, one line per stage.

    stage            input              output
    build_model      Robot              Model       the ordered tree, its coordinates and parameters
    derive_equations Model              Equations   SymPy joint blocks bound along the tree: one program per kernel
    render           Equations          Source      C, header, metadata
    write_package    Source             package     compiled; with what all carry importable with NumPy and cffi alone
    check_package    package            package     its functions return what the programs evaluate to
    load_kernel      package            Kernel      the NumPy interface

The first three are skipped when the cache holds their source, the next two when it holds their package.  Where it is
asked for, ``derive_afresh`` derives the joints anew beside the compiler, and compares; no cache spares that.
"""

from __future__ import annotations

import hashlib
import json
import os
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Future
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Literal, cast

from .._version import __version__
from ..codegen.kernels.signatures import DTYPES, KERNELS, OWN_KERNELS, SINGLES, available, with_beside
from ..description import RobotLike, as_robot
from ..errors import EomgenWarning, InputError
from ..files import as_path, check_ending, read_regular, write_atomically
from ..lazily import from_above
from ..names import plain_path, show
from ..progress import StageReport, no_report, tells_at_prompt, told_at_prompt
from ..robot.model import build_model
from ..robot.record import robot_hash
from ..robot.value import Robot
from ..runtime.arrays import word_in
from ..runtime.kernel import Kernel
from ..runtime.levels import BASE, LEVELS, NATIVE, allowed_levels
from . import cache as store
from . import direct_calls
from .folders import new_folder, put_folder
from .generator_key import generator_hash, room_hash
from .importable import check_module_name
from .library_objects import Libraries
from .on_demand import OnDemand, one_library

if TYPE_CHECKING:
    from ..codegen.c.source import Source
    from ..codegen.derivation.afresh import Derived
    from ..codegen.package.compile import Compiler

KERNEL_NAMES = tuple(KERNELS)
OWNERS = {name: name for name in KERNELS} | {  # the kernel that a name stands for
    function: kernel for kernel, signature in KERNELS.items() for function in signature.functions
}
_NAMED = tuple(name for name, kernel in OWNERS.items() if kernel in OWN_KERNELS)
_SOURCE, _EXPECTED = "source.json", "expected"  # files of an entry
_LARGEST = 1 << 28  # bytes of a package's metadata
_BINARIES = (".so", ".pyd", ".dylib", ".dll")


@dataclass(frozen=True)
class Options:
    """Options of a build: which kernels are generated, and how they are compiled.

    kernels: names of KERNEL_NAMES, all but derivatives if empty; those of springs between points come with any.  A
        function that belongs to a kernel of another name stands for it: frame_pose and frame_jacobian for "kinematics".
    dtype: "float64" or "float32".
    native: compile for this processor alone, with fused multiply-add, which changes the last bits.
    level: instructions that may be used, on x86-64: "v1" (SSE2, any processor), "v3" (AVX2) or "v4" (AVX-512).  Without
        one ``build`` takes the best that runs here, up to the environment's EOMGEN_LEVEL, and ``generate`` takes all,
        of which the best is chosen where the package is loaded.  All give the same bits.
    flags: further compiler flags, behind those of $CFLAGS; none that give up IEEE arithmetic.
    batches: with functions for several states in one call; Python's kernels need them.
    quick: compile in two thirds of the time, for calls from Python; code that stores much, such as a mass matrix, may
        be slower by half.
    within: of float32, the largest error of results by their size: instructions are in double precision, those first
        that contribute most, until proved bounds are within (docs/rounding.md).  None: all are in single precision.
    ranges: (name, least, largest) of inputs and parameters that errors in float32 are bounded over.
    """

    kernels: tuple[str, ...] = ()
    dtype: str = "float64"
    native: bool = False
    flags: tuple[str, ...] = ()
    batches: bool = True
    level: str = ""
    quick: bool = False
    within: float | None = None
    ranges: tuple[tuple[str, float, float], ...] = ()

    def __post_init__(self) -> None:
        if isinstance(self.kernels, str) or not isinstance(self.kernels, Iterable):
            such = (
                f"({self.kernels!r},)" if isinstance(self.kernels, str) and self.kernels else 'such as ("mass_matrix",)'
            )
            raise InputError(f"kernels: {show(self.kernels)}; allowed: a sequence of names, {such}, or for build 'all'")
        names = tuple(self.kernels)
        for name in names:
            if not isinstance(name, str) or name not in OWNERS:
                known = f"{', '.join(_NAMED)}, and their derivatives, such as energy_adjoint"
                raise InputError(f"kernels: {show(name)} is unknown; allowed: {known}")
        object.__setattr__(self, "kernels", tuple(dict.fromkeys(OWNERS[name] for name in names)))
        word_in("dtype", self.dtype, DTYPES)
        if not isinstance(self.level, str) or self.level not in ("", *LEVELS):
            raise InputError(f"level: {show(self.level)} is unknown; allowed: {', '.join(LEVELS)}")
        if self.level and self.native:
            raise InputError(f"level: {show(self.level)} beside native; allowed: one of them")
        if self.within is not None:
            from ..rounding.mixing import check_within

            check_within(self.within, self.dtype)
        if not isinstance(self.ranges, tuple) or any(not isinstance(x, tuple) or len(x) != 3 for x in self.ranges):
            raise InputError(f"ranges: {show(self.ranges)}; allowed: a tuple of (name, least, largest)")
        if self.ranges and self.dtype != "float32":
            raise InputError(f"ranges: given with dtype {self.dtype!r}; allowed: with 'float32'")

    @property
    def ranges_by_name(self) -> dict[str, tuple[float, float]]:
        """Ranges of inputs and parameters by their names."""
        return {name: (lower, upper) for name, lower, upper in self.ranges}


def build(
    robot: RobotLike,
    *,
    kernels: Sequence[str] | Literal["all"] = (),
    dtype: str = "float64",
    native: bool = False,
    flags: Sequence[str] = (),
    level: str = "",
    derive: bool = False,
    progress: StageReport = no_report,
) -> Kernel:
    """Derive, render and compile the robot's equations of motion, or load them from the cache.

    Args:
        robot: a Robot, the name of a built-in one, or the path of a description.
        kernels: names of KERNEL_NAMES that are built at once, in one library; "all" for all but derivatives.  Without
            names each kernel is built when it is first called.
        dtype, native, flags, level: see Options.
        derive: derive the joints with SymPy now, beside the compiler, and compare what is kept of them, the terms that
            are dropped and the programs, at random rational points; without it builds rely on the tests that did so.
        progress: called with a line of text when a stage begins, also when that is later; without one a terminal sees
            a line for every kernel that is built later.

    Raises:
        InputError: an option is unknown, or a level that this processor does not run.
        BuildError: no compiler, a compiler that fails or whose binary computes something else than the equations, a
            cache that cannot be written; from the call of a kernel where that is what builds it.
        DerivationError: what ``derive`` compares differs.
    """
    robot, whole = as_robot(robot), isinstance(kernels, str) and kernels == "all"
    options = Options(() if whole else cast(tuple[str, ...], kernels), dtype, native, tuple(flags), level=level)
    at_once = whole or options.kernels
    if derive:
        _check_derivable(robot)
    with told_at_prompt("building", progress) as report:
        if derive and at_once:  # first, so that the derivation is beside the compiler, and not beside another one
            make_source(robot, _with_beside(robot, options), report)
        derived = _begin_derivation(robot, options) if derive else None
        kernel = _at_once(robot, options, report) if at_once else _on_demand(robot, options, progress)
        if derived is not None:
            derived.result()
    return kernel


def _check_derivable(robot: Robot) -> None:
    """Refuse, before anything is compiled, what cannot be derived."""
    from ..codegen.derivation.afresh import check_derivable

    check_derivable(robot)


def _begin_derivation(robot: Robot, options: Options) -> Future[Derived]:
    """Derive a robot's joints with SymPy in a thread, and compare; the result raises DerivationError."""
    from ..codegen.package.running import begin_in_thread

    def work() -> Derived:
        from ..codegen.derivation.afresh import derive_afresh

        return derive_afresh(build_model(robot), options.kernels, options.dtype)

    return begin_in_thread(work)


def _at_once(robot: Robot, options: Options, progress: StageReport = no_report) -> Kernel:
    """Return a kernel with all of its functions in one library."""
    from ..codegen.package.compile import find_compiler

    compiler = find_compiler()
    fixed = _with_beside(robot, replace(options, level=build_level(options, compiler)))
    package = make_package(robot, fixed, progress, compiler)
    return _loaded_again(package, robot, options, fixed.level)


def _with_beside(robot: Robot, options: Options) -> Options:
    """Return the options with the kernels that come with those that are asked for."""
    return replace(options, kernels=with_beside(options.kernels, build_model(robot)))


def _loaded_again(package: store.Entry, robot: Robot, options: Options, level: str) -> Kernel:
    """Return the kernel of a package, which knows how to become one in another process."""
    again = built_again, (robot, options, package.key, __version__, level)
    return load_kernel(package, robot.name, again, _opener(robot))


def build_groups(robot: Robot, groups: Mapping[str, tuple[str, ...]], progress: StageReport = no_report) -> Kernel:
    """Build like ``build`` without names, quickly: for known functions, those called for one state and for batches.

    Args:
        robot, progress: as of ``build``.
        groups: kernels whose "singles", and kernels whose "batches" are compiled together.

    Raises:
        BuildError: see ``build``.
    """
    return _on_demand(robot, Options(quick=True), progress, groups)


def _on_demand(
    robot: Robot,
    options: Options,
    progress: StageReport = no_report,
    groups: Mapping[str, tuple[str, ...]] = MappingProxyType({}),
) -> Kernel:
    """Return a kernel whose functions are built when they are first asked for, by the compiler that is here now."""
    from ..codegen.kernels.interface import describe_kernels
    from ..codegen.package.compile import find_compiler

    compiler, model = find_compiler(), build_model(robot)
    fixed = replace(options, level=build_level(options, compiler))
    build_flags(fixed, compiler)

    def package_of(names: tuple[str, ...], half: str, report: StageReport) -> store.Entry:
        return make_package(robot, replace(fixed, kernels=names), report, compiler, half)

    def source_of(names: tuple[str, ...], report: StageReport) -> Source:
        return make_source(robot, replace(options, kernels=names), report)

    meta = describe_kernels(model, available(model), options.dtype)
    libraries = OnDemand(meta, package_of, source_of, progress, groups)
    again = built_again, (robot, options, "", __version__)
    return Kernel(libraries, again, direct_calls.begin(compiler), _opener(robot))


def built_again(robot: Robot, options: Options, key: str, version: str, level: str = "") -> Kernel:
    """Return the kernel of a build that may have been made in another process.

    Args:
        robot, options: of that build.
        key, version, level: of its package in the cache, of eomgen there, and what processors the package is for; where
            it is not here, or is not for the processor here, the kernel is built.  Without a key each of its functions
            is, when it is first called.

    Raises:
        InputError, BuildError: see ``build``.
    """
    if not key:
        return _on_demand(robot, options)
    fits = version == __version__ and level in allowed_levels()
    package = store.find("packages", key) if fits else None
    return _at_once(robot, options) if package is None else _loaded_again(package, robot, options, level)


@tells_at_prompt("generating")
def generate(
    robot: RobotLike,
    folder: Path | str,
    options: Options | None = None,
    *,
    cmake: bool = False,
    ros2: bool = False,
    report: Path | str | None = None,
    progress: StageReport = no_report,
) -> Path:
    """Write the importable package ``folder/<robot.name>`` and return its path.

    It has binaries for all x86-64 levels, those of further levels in separate folders, and loads the best
    one that runs where it is imported.  Binaries of levels beyond this processor are compiled, but not checked.

    Beside the compiler SymPy derives the robot's joints anew.  What is kept of joints, the terms of eqs. (11) and (12)
    that are dropped, and the programs are compared with that; the header says what was derived.  Of a robot whose links
    bend nothing is.  In float32 header and metadata say what single precision costs (``eomgen check --float32``).

    A package of an earlier generation there is replaced in one step; a folder that holds anything else is refused.

    Args:
        robot: a Robot, the name of a built-in one, or the path of a description.
        folder: where the package's folder is made.
        options: see Options.
        cmake: write a header for C++17, a CMake project, a pkg-config file and a MEX file's source for MATLAB, too.
        ros2: write them, and a package of ROS 2 in the folder ``ros2``, which simulates the robot.
        report: file to write the derivation to, .html or .tex: joint matrices, surviving terms, and of small robots
            the closed form.
        progress: called with a line of text when a stage begins.

    Raises:
        InputError: the target exists and is not a generated package, the folder cannot be written, the robot is named
            as a module that Python or the package needs, ROS 2 is asked for without the kernel ``rollout``, or the
            report has another ending, or is asked for where links bend.
        BuildError, DerivationError: see ``build``.
    """
    folder = as_path(folder, "folder")
    from ..codegen.package.compile import find_compiler

    robot, folder = as_robot(robot), Path(folder)
    page = None if report is None else check_ending(report, ".html", ".tex", label="report")
    if page is not None:
        _check_derivable(robot)
    is_rigid = all(link.modes is None for link in robot.links)
    hidden = check_module_name(robot.name)
    if hidden:
        warnings.warn(hidden, EomgenWarning, stacklevel=3)  # above the function that tells at a prompt
    options = _with_beside(robot, options or Options())
    make_source(robot, options, progress)  # first, so that the derivation is beside the compiler alone
    derivation = _begin_derivation(robot, options) if is_rigid else None
    files = _files_of_levels(robot, options, progress)
    derived = None if derivation is None else derivation.result()
    header = f"{robot.name}.h"
    if derived is not None:
        files = {**files, header: derived.in_header(files[header].decode("ascii")).encode("ascii")}
    if options.dtype == "float32":
        from .single_precision import with_notes

        files = with_notes(
            robot, options.kernels, files, progress, ranges=options.ranges_by_name, within=options.within
        )
    target = folder / robot.name
    _check_target(target, target)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with new_folder(target) as private:
            binary = direct_calls.binary_of(find_compiler())  # what calls from Python go through, where it can be had
            store.write_files(private, {**files, **{f"runtime/{name}": data for name, data in binary.items()}})
            if cmake or ros2:
                _write_project(private, robot.name, options, ros2)
            private.chmod(0o755)
            put_folder(private, target, lambda place: _check_target(place, target))
    except OSError as error:
        raise InputError(f"{target} cannot be written: {error.strerror or error}") from None
    if page is not None and derived is not None:
        from ..codegen.derivation.report import render_report

        write_atomically(page, lambda stream: stream.write(render_report(derived, page.suffix).encode()), read=None)
    return target


def _files_of_levels(robot: Robot, options: Options, progress: StageReport) -> store.Files:
    """Return files of a package, and the binaries of each further x86-64 level in a folder."""
    from ..codegen.package.compile import carried_contents, find_compiler
    from ..codegen.package.levels import check_possible, possible_levels

    compiler = find_compiler()
    possible = possible_levels(compiler, options.flags)
    if options.level:
        check_possible(options.level, possible)
    levels = ("",) if options.native else (options.level,) if options.level else possible
    made = [make_package(robot, replace(options, level=level), progress, compiler).files for level in levels]
    collected = {**carried_contents(), **made[0]}
    for level, files in zip(levels[1:], made[1:], strict=True):
        loaded = [x for x in files if "/" not in x and (x.endswith(_BINARIES) or x == f"_{robot.name}.py")]
        collected |= {f"{level}/{file}": files[file] for file in loaded}
    return collected


def _write_project(package: Path, name: str, options: Options, ros2: bool) -> None:
    """Add what makes the package a project of C and C++, and one of ROS 2."""
    from ..codegen.c.project import project_files
    from ..codegen.c.ros2 import ros2_files
    from ..codegen.package.compile import kernel_flags

    meta = json.loads((package / f"{name}.json").read_text(encoding="ascii"))
    for file, text in project_files(meta, (*kernel_flags(options.native), *options.flags)).items():
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


def make_package(
    robot: Robot,
    options: Options,
    progress: StageReport = no_report,
    compiler: Compiler | None = None,
    half: str = "",
) -> store.Entry:
    """Return the compiled package of a robot's kernels, made or from the cache.

    Args:
        robot, options, progress: as of ``generate``; a level may be beyond this processor, and none is the best here.
        compiler: that of the environment if None.
        half: of the code, see ``Source.only``; both without a name.

    Raises:
        BuildError: see ``build``.
    """
    from ..codegen.c.library import parts_of
    from ..codegen.package.compile import build_key, find_compiler, write_package

    compiler = compiler or find_compiler()
    direct_calls.begin(compiler)
    flags = build_flags(options, compiler)
    level = NATIVE if options.native else options.level or build_level(options, compiler)
    tried = level == NATIVE or level in allowed_levels()
    library = Libraries(compiler, flags, options.dtype)
    if store.find("sources", _source_key(robot, options)) is None:  # beside the derivation
        library.begin(parts_of(options.kernels or OWN_KERNELS, half if options.batches else SINGLES))
    derived = _derived(robot, options, progress)
    source = _source(derived).only(half)
    key = build_key(source, compiler, flags, tried=tried)

    def make(folder: Path) -> None:
        from .self_test import check_package

        note = "" if tried else f" for {level}, which this processor cannot try"
        progress(f"compiling {source.statements} statements of C{note}")
        write_package(source, compiler, flags, folder, level, library.begin_for(source))
        if tried:
            made = store.unfinished("packages", key, folder)
            check_package(made, source, derived.files[_EXPECTED], compiler, flags)

    return store.entry("packages", key, make)


def build_level(options: Options, compiler: Compiler) -> str:
    """Return the level that a build compiles for here; nothing for native code.

    Raises:
        InputError: this processor does not run it, or $EOMGEN_LEVEL is no level that it runs.
        BuildError: the compiler makes no code for it.
    """
    from ..codegen.package.levels import chosen_level

    return "" if options.native else chosen_level(options.level, compiler, options.flags)


def build_flags(options: Options, compiler: Compiler) -> tuple[str, ...]:
    """Return flags of the C compiler for a build of these options; without a level for the one that is chosen here.

    Raises:
        InputError, BuildError: see ``build``.
    """
    from ..codegen.package.compile import compile_flags

    level = options.level or build_level(options, compiler) or BASE
    return compile_flags(compiler, options.native, options.flags, level, options.quick)


def make_source(robot: Robot, options: Options, progress: StageReport = no_report) -> Source:
    """Return the C of a robot's kernels, derived or from the cache."""
    return _source(_derived(robot, options, progress))


def _derived(robot: Robot, options: Options, progress: StageReport) -> store.Entry:
    """Return the source of a robot's kernels and the numbers that they have to return, derived or from the cache."""
    key = _source_key(robot, options)
    return store.entry("sources", key, lambda folder: _derive(robot, options, folder, progress))


def _source(derived: store.Entry) -> Source:
    from ..codegen.c.source import Source

    return Source(**json.loads(derived.files[_SOURCE]))


def cache_keys(robot: Robot, kernels: Sequence[str]) -> tuple[str, str | None]:
    """Return keys in the cache of the source and of the package of ``build(robot, kernels=kernels)``.

    That of the package depends on the compiler here, and is None while the source is not there.
    """
    options = Options(tuple(kernels))
    key = _source_key(robot, options)
    sources = store.find("sources", key)
    if sources is None:
        return key, None
    from ..codegen.package.compile import build_key, find_compiler

    compiler = find_compiler()
    return key, build_key(_source(sources), compiler, build_flags(options, compiler))


def _derive(robot: Robot, options: Options, folder: Path, progress: StageReport) -> None:
    """Derive the source of a robot and the numbers that it has to return, and write them into the folder."""
    from ..codegen.c.expected import pack_expected
    from ..codegen.c.sources import render
    from ..codegen.kernels.equations import derive_equations

    model = build_model(robot)  # Robot -> Model
    progress(f"deriving the equations of {len(model.coordinates)} coordinates")
    equations = derive_equations(model, options.kernels, options.dtype)  # Model -> Equations
    if options.within is not None:
        from ..rounding.mixing import mixed

        progress("choosing instructions in double precision")
        equations = mixed(equations, options.within, options.ranges_by_name)
    source = render(equations, options.dtype, batches=options.batches)  # Equations -> Source
    (folder / _SOURCE).write_text(json.dumps(asdict(source)), encoding="ascii")
    (folder / _EXPECTED).write_bytes(pack_expected(equations, options.dtype))


def _source_key(robot: Robot, options: Options) -> str:
    """Hash of the description, the options that change the source, and the generator's code."""
    parts = [robot_hash(robot), options.kernels, options.dtype, options.batches, __version__, generator_hash()]
    if options.within is not None:
        parts.append([options.within, options.ranges, room_hash("eomgen.rounding")])
    text = json.dumps(parts)
    return hashlib.sha256(text.encode()).hexdigest()


def _opener(robot: Robot) -> Callable[..., Any]:
    """Return what opens a device for kernels of a robot, by the room above, which is imported then."""

    def opened(kernel: Kernel, where: Any, **options: Any) -> Any:
        return from_above(".device.opened", "open_device")(robot, kernel, where, **options)

    return opened


def load_kernel(
    package: store.Entry,
    name: str,
    again: tuple[Callable[..., Kernel], tuple[Any, ...]] | None = None,
    opener: Callable[..., Any] | None = None,
) -> Kernel:
    """Load a kernel, with separate parameters, from a package of the cache.

    Args:
        package: of the cache.
        name: the robot's.
        again: what makes the same kernel in another process, see ``Kernel``; without it the kernel cannot be pickled.
        opener: gives its methods on a device.

    Raises:
        BuildError: the package does not load.
    """
    binding = direct_calls.begin()
    direct_calls.settle()
    return Kernel(one_library(package, name), again, binding, opener)
