"""Robot -> compiled package, one function per stage: describe, derive, render, compile.

    stage            input              output
    describe         Robot, Options     Described   the tree of bodies, its coordinates, the names of kernels
    derive           Described          Equations   SymPy's joint blocks bound along the tree: a program per kernel
    render           Equations          Rendered    C, header, metadata, and numbers for the self-test
    compile_source   Rendered, Tools    Entry       a tested package, importable with what all packages carry

``make_package`` runs them.  The cache keeps what ``render`` and ``compile_source`` give, each under the hash of all
that it depends on; what is there is not made again.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from .._version import __version__
from ..codegen.kernels.groups import kernel_group
from ..codegen.kernels.signatures import BATCHES, OWN_KERNELS, SINGLES, available, library_objects, with_beside
from ..description import RobotLike, as_robot
from ..progress import StageReport, no_report
from ..robot.model import Model, build_model
from ..robot.record import robot_hash
from ..robot.value import Robot
from ..runtime.levels import NATIVE, allowed_levels
from . import cache as store
from . import direct_calls
from .derivations import derived_model
from .generator_key import generator_hash
from .library_objects import LibraryObjects
from .options import ALL, Options

if TYPE_CHECKING:
    from ..codegen.c.source import Source
    from ..codegen.kernels.equations import Equations
    from ..codegen.package.running import Compiler

_SOURCE, _EXPECTED = "source.json", "expected"  # files of an entry


@dataclass(frozen=True)
class Described:
    """Model of a robot to be built, the hash of its description, and options."""

    model: Model
    robot_hash: str
    options: Options

    @property
    def robot(self) -> Robot:
        """The robot of the model."""
        return self.model.robot

    @cached_property
    def key(self) -> str:
        """Hash of the description, the options that change the source, and the generator's code."""
        options = self.options
        chosen = [options.kernels, options.dtype, options.batches, options.scalar, options.libm]
        parts = [self.robot_hash, *chosen, __version__, generator_hash()]
        return hashlib.sha256(json.dumps(parts).encode()).hexdigest()

    def of(self, kernels: Sequence[str]) -> Described:
        """Return the same with other kernels: all that come without a request if empty."""
        return replace(self, options=replace(self.options, kernels=tuple(kernels)))

    def with_beside(self) -> Described:
        """Return the same with the kernels that come with those that are asked for."""
        return self.of(with_beside(self.options.kernels, self.model))


@dataclass(frozen=True)
class Rendered:
    """The C of a robot's kernels, and numbers that they have to return, of ``pack_expected``."""

    source: Source
    expected: bytes


@dataclass(frozen=True)
class Tools:
    """How C is compiled: the compiler, its flags, the level of processors, and whether this one runs what it makes."""

    compiler: Compiler
    flags: tuple[str, ...]
    level: str
    runs_here: bool


def describe(robot: RobotLike, options: Options) -> Described:
    """Return a robot's model and what is to be built of it.

    Args:
        robot: a Robot, the name of a built-in one, or the path of a description.
        options: see Options.
    """
    robot = as_robot(robot)
    model, kernels = build_model(robot), options.kernels
    if kernels == (ALL,):
        kernels = ()
    elif ALL in kernels:
        kernels = tuple(dict.fromkeys((*kernel_group(model, OWN_KERNELS), *(name for name in kernels if name != ALL))))
    return Described(model, robot_hash(robot), replace(options, kernels=kernels))


def tools_for(options: Options, level: str = "") -> Tools:
    """Return the compiler of the environment with the flags and the level of a build.

    Args:
        options: see Options.
        level: of processors, which may be beyond this one; the best of the options', or the best here, if empty.

    Raises:
        InputError: this processor does not run the options' best level, or $EOMGEN_LEVEL is no level that it runs.
        BuildError: there is no compiler, or it makes no code for the level.
    """
    from ..codegen.package.compile import compile_flags, find_compiler
    from ..codegen.package.levels import chosen_level

    compiler = find_compiler()
    if options.native:
        return Tools(compiler, compile_flags(compiler, True, options.flags, quick=options.quick), NATIVE, True)
    level = level or chosen_level(options.levels[-1] if options.levels else "", compiler, options.flags)
    flags = compile_flags(compiler, False, options.flags, level, options.quick)
    return Tools(compiler, flags, level, level in allowed_levels())


def derive(described: Described) -> Equations:
    """Derive the programs of the kernels."""
    from ..codegen.kernels.equations import derive_equations

    options = described.options
    return derive_equations(derived_model(described.robot), options.kernels, options.dtype)


def render(equations: Equations, options: Options) -> Rendered:
    """Return the C of equations, and numbers that it has to return."""
    from ..codegen.c.expected import pack_expected
    from ..codegen.c.sources import render as render_source

    source = render_source(equations, batches=options.batches, scalar=options.scalar, libm=options.libm)
    return Rendered(source, pack_expected(equations))


def rendered(
    described: Described, progress: StageReport = no_report, library: LibraryObjects | None = None
) -> Rendered:
    """Return the C of a robot's kernels, derived or from the cache.

    Args:
        described: of ``describe``.
        progress: called with a line of text when it is derived.
        library: objects of the C library that are compiled beside the derivation.
    """
    from ..codegen.c.source import Source

    def make(folder: Path) -> None:
        if library is not None:
            library.begin()
        progress(f"deriving the equations of {len(described.model.coordinates)} coordinates")
        text = render(derive(described), described.options)
        source = json.dumps(asdict(text.source)).encode("ascii")
        store.write_files(folder, {_SOURCE: source, _EXPECTED: text.expected})

    files = store.entry("sources", described.key, make).files
    return Rendered(Source(**json.loads(files[_SOURCE])), files[_EXPECTED])


def compile_source(
    text: Rendered, tools: Tools, library: LibraryObjects, progress: StageReport = no_report
) -> store.Entry:
    """Return the compiled and tested package of a source, made or from the cache.

    Args:
        text: of ``rendered``; of one half of the code, or of both.
        tools: of ``tools_for``.
        library: objects that it is linked with.
        progress: called with a line of text when it is compiled.

    Raises:
        BuildError: see ``build``.
    """
    from ..codegen.package.compile import build_key, write_package

    source = text.source
    key = build_key(source, tools.compiler, tools.flags, tried=tools.runs_here)

    def make(folder: Path) -> None:
        from .self_test import check_package

        note = "" if tools.runs_here else f" for {tools.level}, which this processor cannot try"
        progress(f"compiling {source.statements} statements of C{note}")
        write_package(source, tools.compiler, tools.flags, folder, tools.level, library.linked())
        if tools.runs_here:
            check_package(store.unfinished("packages", key, folder), source, text.expected, tools.compiler, tools.flags)

    return store.entry("packages", key, make)


def make_package(described: Described, tools: Tools, half: str = "", progress: StageReport = no_report) -> store.Entry:
    """Return the compiled package of a robot's kernels, each stage from the cache or made.

    Args:
        described, tools: of ``describe`` and ``tools_for``.
        half: of the code, "singles" or "batches"; both if empty.
        progress: called with a line of text when a stage begins.

    Raises:
        BuildError: see ``build``.
    """
    options = described.options
    kernels = [name for name in options.kernels or OWN_KERNELS if name in available(described.model)]
    halves = (half,) if half else (SINGLES, BATCHES) if options.batches and not options.scalar else (SINGLES,)
    parts = {one: library_objects(kernels, one) for one in halves}
    direct_calls.begin(tools.compiler)
    library = LibraryObjects(tools.compiler, tools.flags, options.dtype, parts)
    text = rendered(described, progress, library)
    return compile_source(replace(text, source=text.source.only(half)), tools, library, progress)


def make_source(robot: RobotLike, options: Options, progress: StageReport = no_report) -> Source:
    """Return the C of a robot's kernels, derived or from the cache; see ``describe``."""
    return rendered(describe(robot, options), progress).source


def cache_keys(robot: Robot, kernels: Sequence[str]) -> tuple[str, str | None]:
    """Return keys in the cache of the source and of the package of ``build(robot, kernels=kernels)``.

    That of the package depends on the compiler here, and is None while the source is not there.
    """
    from ..codegen.package.compile import build_key

    described = describe(robot, Options(tuple(kernels)))
    if store.find("sources", described.key) is None:
        return described.key, None
    tools = tools_for(described.options)
    return described.key, build_key(rendered(described).source, tools.compiler, tools.flags)
