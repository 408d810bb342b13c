"""Robot -> Kernel, one line per stage.

    stage            input              output
    build_model      Robot              Model       the ordered tree, its coordinates and parameters
    derive_equations Model              Equations   SymPy joint blocks bound along the tree: one program per kernel
    render           Equations          Source      C, header, metadata
    write_package    Source             package     compiled, importable with NumPy and cffi alone
    load_kernel      package            Kernel      the NumPy face

The first three are skipped when the cache holds their source, the fourth when it holds their package; then SymPy is
not imported.
"""

from __future__ import annotations

import hashlib
import json
import shutil
import tempfile
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from .._version import __version__
from ..codegen.kernels.signatures import KERNELS
from ..description import RobotLike, as_robot
from ..errors import InputError
from ..files import read_regular
from ..progress import StageReport, no_report
from ..robot.model import build_model
from ..robot.record import robot_hash
from ..robot.value import Robot
from ..runtime.kernel import Kernel
from . import cache as store
from .generator_key import generator_hash
from .load import load_module

if TYPE_CHECKING:
    from ..codegen.c.source import Source

KERNEL_NAMES = tuple(KERNELS)
DTYPES = ("float64", "float32")


@dataclass(frozen=True)
class Options:
    """Options of a build: which kernels are generated, and how they are compiled.

    kernels: names of KERNEL_NAMES, all but tangents if empty ("kinematics" stands for frame_pose and frame_jacobian);
        those of springs between points come with any.
    dtype: "float64" or "float32".
    native: compile for this processor, with fused multiply-add; the default runs on any of its kind.
    flags: further compiler flags, behind those of $CFLAGS; none that give up IEEE arithmetic.
    batches: with functions for several states in one call; Python's kernels need them.
    """

    kernels: tuple[str, ...] = ()
    dtype: str = "float64"
    native: bool = False
    flags: tuple[str, ...] = ()
    batches: bool = True

    def __post_init__(self) -> None:
        for name in self.kernels:
            if name not in KERNEL_NAMES:
                raise InputError(f"kernels: {name!r} is unknown; allowed: {', '.join(KERNEL_NAMES)}")
        if self.dtype not in DTYPES:
            raise InputError(f"dtype: {self.dtype!r} is unknown; allowed: {', '.join(DTYPES)}")


def build(
    robot: RobotLike,
    *,
    kernels: Sequence[str] = (),
    dtype: str = "float64",
    native: bool = False,
    flags: Sequence[str] = (),
    progress: StageReport = no_report,
) -> Kernel:
    """Derive, render and compile the robot's equations of motion, or load them from the cache.

    Args:
        robot: a Robot, the name of a built-in one, or the path of a description.
        kernels, dtype, native, flags: see Options.
        progress: called with a line of text when a stage begins.

    Raises:
        InputError: an option is unknown.
        BuildError: no compiler, a compiler that fails, a cache that cannot be written.
    """
    robot, options = as_robot(robot), Options(tuple(kernels), dtype, native, tuple(flags))
    return load_kernel(make_package(robot, options, progress), robot.name)


def generate(
    robot: RobotLike,
    folder: Path | str,
    options: Options | None = None,
    *,
    cmake: bool = False,
    progress: StageReport = no_report,
) -> Path:
    """Write the importable package ``folder/<robot.name>`` and return its path.

    A package of an earlier generation there is replaced in one step; a folder that holds anything else is refused.

    Args:
        robot: a Robot, the name of a built-in one, or the path of a description.
        folder: where the package's folder is made.
        options: see Options.
        cmake: write a header for C++17, a CMake project and a pkg-config file, too.
        progress: called with a line of text when a stage begins.

    Raises:
        InputError: the target exists and is not a generated package, or the folder cannot be written.
        BuildError: see ``build``.
    """
    robot, folder, options = as_robot(robot), Path(folder), options or Options()
    package = make_package(robot, options, progress)
    target = folder / robot.name
    if _is_foreign(target):
        raise InputError(f"{target} exists and is not a generated package; give another folder with -o, or move it")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        private = Path(tempfile.mkdtemp(prefix=".making-", dir=folder))
        try:
            store.write_files(private, package.files)
            if cmake:
                _write_project(private, robot.name, options)
            private.chmod(0o755)
            replaced = private / "replaced"
            if target.exists():
                target.rename(replaced)
            try:
                private.rename(target)
            except OSError:
                if replaced.exists():
                    replaced.rename(target)  # nothing is lost
                raise
            shutil.rmtree(target / "replaced", ignore_errors=True)
        finally:
            shutil.rmtree(private, ignore_errors=True)
    except OSError as error:
        raise InputError(f"{target} cannot be written: {error.strerror or error}") from None
    return target


def _write_project(package: Path, name: str, options: Options) -> None:
    """Add what makes the package a project of C and C++."""
    from ..codegen.c.project import project_files
    from ..codegen.package.compile import own_flags

    meta = json.loads((package / f"{name}.json").read_text(encoding="ascii"))
    for file, text in project_files(meta, (*own_flags(options.native), *options.flags)).items():
        (package / file).write_text(text, encoding="ascii")


_MOST_META = 1 << 26  # bytes of a package's metadata


def _is_foreign(target: Path) -> bool:
    """Whether something is there that no generation wrote; an empty folder is nothing."""
    if not target.is_dir():
        return target.exists()
    try:
        meta = read_regular(target / f"{target.name}.json", _MOST_META).decode("ascii")
        return "eomgen" not in json.loads(meta)["generator"]
    except (OSError, ValueError, KeyError, TypeError):
        return any(target.iterdir())


def make_package(robot: Robot, options: Options, progress: StageReport = no_report) -> store.Entry:
    """The compiled package of a robot's kernels, made or from the cache.

    Raises:
        BuildError: see ``build``.
    """
    from ..codegen.package.compile import build_key, compile_flags, find_compiler, write_package

    source = make_source(robot, options, progress)
    compiler = find_compiler()
    flags = compile_flags(compiler, options.native, options.flags)

    def make(folder: Path) -> None:
        progress(f"compiling {source.statements} statements of C")
        write_package(source, compiler, flags, folder)

    return store.entry("packages", build_key(source, compiler, flags), make)


def make_source(robot: Robot, options: Options, progress: StageReport = no_report) -> Source:
    """The C of a robot's kernels, derived or from the cache."""
    from ..codegen.c.source import Source

    sources = store.entry(
        "sources", _source_key(robot, options), lambda folder: _derive(robot, options, folder, progress)
    )
    return Source(**json.loads(sources.files["source.json"]))


def cache_keys(robot: Robot, kernels: Sequence[str]) -> tuple[str, str | None]:
    """Keys in the cache of the source and of the package of ``build(robot, kernels=kernels)``.

    That of the package depends on the compiler here, and is None while the source is not there.
    """
    options = Options(tuple(kernels))
    key = _source_key(robot, options)
    sources = store.find("sources", key)
    if sources is None:
        return key, None
    from ..codegen.c.source import Source
    from ..codegen.package.compile import build_key, compile_flags, find_compiler

    source = Source(**json.loads(sources.files["source.json"]))
    compiler = find_compiler()
    return key, build_key(source, compiler, compile_flags(compiler, False, ()))


def _derive(robot: Robot, options: Options, folder: Path, progress: StageReport) -> None:
    """Robot -> Source, written into the folder."""
    progress("importing SymPy")
    from ..codegen.c.sources import render
    from ..codegen.kernels.equations import derive_equations

    model = build_model(robot)  # Robot -> Model
    progress(f"deriving the equations of {model.size} coordinates")
    equations = derive_equations(model, options.kernels)  # Model -> Equations
    source = render(equations, options.dtype, batches=options.batches)  # Equations -> Source
    (folder / "source.json").write_text(json.dumps(asdict(source)), encoding="ascii")


def _source_key(robot: Robot, options: Options) -> str:
    """Hash of the description, the options that change the source, and the generator's own code."""
    text = json.dumps(
        [robot_hash(robot), options.kernels, options.dtype, options.batches, __version__, generator_hash()]
    )
    return hashlib.sha256(text.encode()).hexdigest()


def load_kernel(package: store.Entry, name: str) -> Kernel:
    """A kernel, with parameters of its own, from a package of the cache.

    Raises:
        BuildError: the package does not load.
    """
    module = load_module(package, name)

    def read(file: str) -> str:
        found = store.find(package.kind, package.key)
        if found is None:
            raise FileNotFoundError(file)
        return found.files[file].decode("ascii")

    return Kernel(module.ffi, module.lib, json.loads(package.files[f"{name}.json"]), read)
