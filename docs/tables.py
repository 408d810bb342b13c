"""Write the generated parts of README.md: python docs/tables.py (--check: compare instead, status 1 if they differ)."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import eomgen
from eomgen.pipeline.costs import robot_info

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))  # for benchmarks
ROBOTS = ("one_link", "puma560", "ur5", "puma560_elastic")
KERNELS = ("inverse_dynamics", "mass_matrix", "forward_dynamics", "bias_force", "generalized_force")


def operations() -> str:
    """Table of operation counts of the built-in robots."""
    rows = ["| robot | coordinates | " + " | ".join(name.replace("_", " ") for name in KERNELS) + " |"]
    rows.append("|---" * (len(KERNELS) + 2) + "|")
    for name in ROBOTS:
        info = robot_info(eomgen.load_robot(name))
        counts = [info.operations[kernel] for kernel in KERNELS]
        cells = [f"{c['mul']}/{c['add']}" + (f" + {c['div']} div" if c["div"] else "") for c in counts]
        rows.append(f"| {name} | {info.model.size} | " + " | ".join(cells) + " |")
    return "\n".join(rows)


def sample() -> str:
    """Two functions of the committed sample."""
    code = (ROOT / "generated" / "one_link" / "one_link.c").read_text(encoding="ascii")
    found = [
        re.search(rf"/\*[^\n]*\*/\nint one_link_{name}\(.*?\n}}\n", code, re.S) for name in ("mass_matrix", "residual")
    ]
    return "```c\n" + "\n".join(match[0] for match in found if match) + "```"


def peers() -> str:
    """Ratios of the last run of ``make bench``."""
    from benchmarks.peers.page import readme
    from benchmarks.peers.report import read

    return readme(read(ROOT / "docs" / "peers.json"))


def filled(text: str) -> str:
    """The README with its generated parts as they are now."""
    for name, make in (("operations", operations), ("peers", peers), ("sample", sample)):
        begin, end = f"<!-- begin of {name} -->\n", f"<!-- end of {name} -->"
        before, rest = text.split(begin)
        text = before + begin + make() + "\n" + end + rest.split(end, 1)[1]
    return text


def main() -> int:
    path = ROOT / "README.md"
    now = path.read_text(encoding="utf-8")
    wanted = filled(now)
    if "--check" in sys.argv[1:]:
        return int(now != wanted)
    path.write_text(wanted, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
