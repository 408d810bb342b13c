"""x86-64 levels (SIMD instruction sets) that a package has binaries for, and the best one that this processor runs.

All levels give the same bits where the compiler may not fuse products with sums, which is so unless it was asked to.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path

from ..errors import BuildError, InputError
from ..names import show

VARIABLE = "EOMGEN_LEVEL"  # of the environment: nothing above this level is used
BASE = "v1"  # what every processor of the machine's type runs; its binaries lie in the package itself
NATIVE = "native"  # in place of a level: code for the processor that compiled it
_V3 = (
    *("cx16", "lahf_lm", "popcnt", "sse4_1", "sse4_2", "ssse3"),
    *("abm", "avx", "avx2", "bmi1", "bmi2", "f16c", "fma", "movbe", "xsave"),
)
NEEDS: Mapping[str, tuple[str, ...]] = {  # features as Linux names them; the sets are those of the psABI of x86-64
    BASE: (),
    "v3": _V3,
    "v4": (*_V3, "avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl"),
}
LEVELS = tuple(NEEDS)


def machine_levels() -> tuple[str, ...]:
    """Return the levels of this type of machine, whatever its processor: x86-64 levels on Linux, else the base."""
    wide = sys.platform == "linux" and sys.maxsize > 2**32 and os.uname().machine == "x86_64"
    return LEVELS if wide else (BASE,)


def supported() -> tuple[str, ...]:
    """Return levels that this processor and its system run, the best one last."""
    features = _features()
    return tuple(level for level in machine_levels() if features.issuperset(NEEDS[level]))


@cache
def _features() -> frozenset[str]:
    """Return features of the first processor, by Linux's names; none where the system does not say."""
    try:
        with open("/proc/cpuinfo", encoding="ascii", errors="replace") as lines:
            line = next((line for line in lines if line.startswith("flags")), "")
    except OSError:
        return frozenset()
    return frozenset(line.partition(":")[2].split())


def best_level(held: Iterable[str] = LEVELS) -> str:
    """Return the best level among those held that this processor runs, and that $EOMGEN_LEVEL does not exclude.

    Raises:
        InputError: $EOMGEN_LEVEL is no level, or one that this processor does not run.
        BuildError: none of them is such a level.
    """
    levels, allowed = tuple(held), allowed_levels()
    runnable = [level for level in allowed if level in levels]
    if not runnable:
        raise BuildError(
            f"the compiled code is for processors of level {', '.join(levels)}; allowed here: {', '.join(allowed)}"
        )
    return runnable[-1]


def allowed_levels() -> tuple[str, ...]:
    """Return levels that this processor runs, up to $EOMGEN_LEVEL where that is set; the best one last.

    Raises:
        InputError: $EOMGEN_LEVEL is no level, or one that this processor does not run.
    """
    highest, known = os.environ.get(VARIABLE, ""), supported()
    if not highest:
        return known
    check_level(highest, f"${VARIABLE}")
    return known[: known.index(highest) + 1]


def check_level(level: str, whence: str) -> None:
    """Raise InputError for an unknown level, or one that this processor does not run; ``whence``: its source."""
    if level in supported():
        return
    if level not in machine_levels():
        reason = "is unknown" if level not in LEVELS else "is of x86-64 on Linux, which this machine is not"
    else:
        lacking = [name for name in NEEDS[level] if name not in _features()]
        reason = f"is beyond this processor, which lacks {', '.join(lacking)}"
    raise InputError(f"{whence}: {show(level)} {reason}; allowed: {', '.join(supported())}")


def binary_folders(package: Path, base: str) -> list[str]:
    """Return folders in which a package's binaries are looked for first: at most one, that of a level.

    Args:
        package: the package's folder; binaries of further levels lie in folders of it.
        base: the level of the binaries in the folder itself; if that is NATIVE there are no others.

    Raises:
        InputError, BuildError: see ``best_level``.
    """
    if base == NATIVE:
        return []
    level = best_level((base, *(level for level in LEVELS if level != base and (package / level).is_dir())))
    return [] if level == base else [str(package / level)]
