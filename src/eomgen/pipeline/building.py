"""Robot -> Kernel: ``build`` at once or on demand, and the same kernel again in another process."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from types import MappingProxyType
from typing import Any, Literal, cast

from .._version import __version__
from ..codegen.kernels.signatures import available
from ..description import RobotLike
from ..identifiers import word_in
from ..kernel.complete import Kernel
from ..progress import StageReport, no_report, told_at_prompt
from ..robot.value import Robot
from ..runtime.levels import LEVELS, allowed_levels
from . import cache as store
from . import direct_calls
from .load import one_library
from .on_demand import OnDemand
from .options import ALL, Options
from .stages import Described, describe, make_package, tools_for


def build(
    robot: RobotLike,
    *,
    kernels: Sequence[str] | Literal["all"] = (),
    dtype: str = "float64",
    native: bool = False,
    flags: Sequence[str] = (),
    level: str = "",
    progress: StageReport = no_report,
) -> Kernel:
    """Derive, render and compile the robot's equations of motion, or load them from the cache.

    Args:
        robot: a Robot, the name of a built-in one, or the path of a description.
        kernels: names of KERNEL_NAMES that are built at once, in one library; "all" for all but derivatives, gravity
            and others that are built by name alone.  Without names each kernel is built when it is first called.
        dtype, native, flags: see Options.
        level: x86-64 level to compile for, see Options; the best that runs here by default.
        progress: called with a line of text when a stage begins, also when that is later; without one a terminal sees
            a line for every kernel that is built later.

    Raises:
        InputError: an option is unknown, or a level that this processor does not run.
        BuildError: no compiler, a compiler that fails or whose binary computes something else than the equations, a
            cache that cannot be written; from the call of a kernel where that is what builds it.
    """
    whole = isinstance(kernels, str) and kernels == ALL
    levels = (word_in("level", level, LEVELS),) if level else ()
    options = Options((ALL,) if whole else cast(tuple[str, ...], kernels), dtype, native, tuple(flags), levels=levels)
    described = describe(robot, options)
    with told_at_prompt("building", progress) as report:
        return _at_once(described, report) if options.kernels else _on_demand(described, progress)


def build_groups(robot: Robot, groups: Mapping[str, tuple[str, ...]], progress: StageReport = no_report) -> Kernel:
    """Build like ``build`` without names, quickly: for known functions, those called for one state and for batches.

    Args:
        robot, progress: as of ``build``.
        groups: kernels whose "singles", and kernels whose "batches" are compiled together.

    Raises:
        BuildError: see ``build``.
    """
    return _on_demand(describe(robot, Options(quick=True)), progress, groups)


def _at_once(described: Described, progress: StageReport = no_report) -> Kernel:
    """Return a kernel with all of its functions in one library."""
    tools = tools_for(described.options)
    package = make_package(described.with_beside(), tools, "", progress)
    return _loaded(package, described, tools.level)


def _loaded(package: store.Entry, described: Described, level: str) -> Kernel:
    """Return the kernel of a package, which knows how to become one in another process."""
    again = built_again, (described.robot, described.options, package.key, __version__, level)
    return load_kernel(package, described.robot.name, again, partial(_on_device, described.robot))


def _on_demand(
    described: Described,
    progress: StageReport = no_report,
    groups: Mapping[str, tuple[str, ...]] = MappingProxyType({}),
) -> Kernel:
    """Return a kernel whose functions are built when they are first asked for, by the compiler that is here now."""
    from ..codegen.kernels.interface import describe_kernels

    tools, model, options = tools_for(described.options), described.model, described.options
    meta = describe_kernels(model, available(model), options.dtype)
    libraries = OnDemand(meta, described, tools, progress, groups)
    again = built_again, (described.robot, options, "", __version__)
    return Kernel(libraries, again, direct_calls.begin(tools.compiler), partial(_on_device, described.robot))


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
    described = describe(robot, options)
    if not key:
        return _on_demand(described)
    fits = version == __version__ and level in allowed_levels()
    package = store.find("packages", key) if fits else None
    return _at_once(described) if package is None else _loaded(package, described, level)


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


def _on_device(robot: Robot, kernel: Kernel, where: Any, **options: Any) -> Any:
    """Return methods of a robot's kernel on a device."""
    from ..device.face import open_device

    return open_device(robot, kernel, where, **options)
