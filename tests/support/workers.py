"""How many processes of tests the memory is enough for."""

from __future__ import annotations

import re
from pathlib import Path

OF_A_WORKER = 1.5e9  # bytes that a process of the whole suite takes at most
# limits of containers: folder, limit, usage, and the part of the usage that the system gives back when asked
GROUPS = (
    ("sys/fs/cgroup", "memory.max", "memory.current", "inactive_file"),
    ("sys/fs/cgroup/memory", "memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file"),
)


def workers_by_memory(cores: int, available: float | None) -> tuple[int, str]:
    """Return the number of workers, and the reason where it is less than one for each core; "" if it is not."""
    enough = cores if available is None else max(1, min(cores, int(available // OF_A_WORKER)))
    if enough == cores:
        return cores, ""
    return enough, (
        f"workers: {enough} instead of {cores}, one for each {OF_A_WORKER / 1e9:g} GB of the"
        f" {(available or 0.0) / 1e9:.1f} GB of memory that is available; -n {cores} uses all cores"
    )


def available_memory(root: Path = Path("/")) -> float | None:
    """Return bytes that processes may still take, on the machine and in its container; None if it is unknown."""
    found = [1024.0 * value for value in _numbers(root / "proc/meminfo", r"^MemAvailable:\s+(\d+) kB$")]
    for folder, limit, usage, idle in GROUPS:
        group = root / folder
        for most in _numbers(group / limit, r"^(\d+)$"):
            used = sum(_numbers(group / usage, r"^(\d+)$"))
            found.append(most - used + sum(_numbers(group / "memory.stat", rf"^{idle} (\d+)$")))
    return min(found, default=None)


def _numbers(path: Path, pattern: str) -> list[float]:
    try:
        return [float(number) for number in re.findall(pattern, path.read_text(encoding="ascii"), re.MULTILINE)]
    except OSError:
        return []
