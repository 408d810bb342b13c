"""Kernels that travel by content: to a process whose cache lacks them, on this machine or another one.

Source and binary go into the worker's cache under the hashes that they have here.  A worker whose machine, C library,
compiler or Python differs has no binary under its hash and compiles the source that it was sent; none derives.
"""

from __future__ import annotations

import platform
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from ..errors import InputError
from ..pipeline import cache as store
from ..pipeline.stages import cache_keys
from ..robot.value import Robot
from ..scenario.value import Scenario
from ..simulation.assembly import rigid_kernels
from ..simulation.loads import with_payload_parameters


@dataclass(frozen=True)
class Content:
    """Entries of a cache: files by kind, key and name; ``machine`` is what their binaries were made for."""

    entries: dict[tuple[str, str], dict[str, bytes]]
    machine: tuple[str, ...]


Builds = tuple[tuple[Robot, tuple[str, ...]], ...]


def builds_of(robot: Robot, scenario: Scenario, kernels: Sequence[str]) -> Builds:
    """Return the builds that a scenario of a robot needs: the robot, and the rigid one that drives may use."""
    return ((with_payload_parameters(robot, scenario), tuple(kernels)), (robot.rigid(), rigid_kernels(robot)))


def machine() -> tuple[str, ...]:
    """Return the system and its C library, on which a binary may depend beyond its hash."""
    return (platform.system(), platform.machine(), *platform.libc_ver())


def source_keys(builds: Builds) -> tuple[str, ...]:
    """Return the keys of the sources; another eomgen has others."""
    return tuple(cache_keys(robot, kernels)[0] for robot, kernels in builds)


def pack(builds: Builds) -> Content:
    """Return the content of the builds in this cache."""
    entries: dict[tuple[str, str], dict[str, bytes]] = {}
    for robot, kernels in builds:
        source, package = cache_keys(robot, kernels)
        for kind, key in (("sources", source), ("packages", package)):
            stored = store.find(kind, key) if key else None
            if stored is not None:
                entries[kind, stored.key] = dict(stored.files)
    return Content(entries, machine())


def lacks_sources(keys: Sequence[str]) -> bool:
    """Return whether this process's cache has none of the sources."""
    return not any(store.find("sources", key) for key in keys)


def unpack(content: Content, builds: Builds, keys: Sequence[str]) -> None:
    """Put the content into this process's cache.

    Raises:
        InputError: eomgen here is another one than there.
        BuildError: the cache cannot be written.
    """
    check_same(builds, keys)
    for (kind, key), files in content.entries.items():
        if kind == "packages" and content.machine != machine():
            continue

        def write(folder: Path, files: dict[str, bytes] = files) -> None:
            store.write_files(folder, files)

        store.entry(kind, key, write)


def check_same(builds: Builds, keys: Sequence[str]) -> None:
    """Raise InputError where eomgen here would write other C for the same robot."""
    if source_keys(builds) != tuple(keys):
        raise InputError(
            "the worker's eomgen is another one than the one that sends work; allowed: the same version on all machines"
        )
