"""Write the list of packages in pyproject.toml, which the wheel is built from: python -m release.packages.

With --check: status 1 if it differs from the tree instead.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
PLACES = {"eomgen": "src/eomgen", "eomgen.codegen": "codegen", "eomgen.templates": "templates"}  # as [package-dir] says


def packages(root: Path = ROOT) -> list[str]:
    """Return the full names of all packages of a tree, sorted."""
    names = []
    for package, place in PLACES.items():
        for path in (root / place).rglob("__init__.py"):
            names.append(".".join((package, *path.parent.relative_to(root / place).parts)))
    return sorted(names)


def with_packages(text: str, names: list[str]) -> str:
    """Return the text of a pyproject.toml whose list of packages has these names, one to a line."""
    lines = "".join(f'  "{name}",\n' for name in names)
    return re.sub(r"^packages = \[\n.*?^\]", lambda _: f"packages = [\n{lines}]", text, flags=re.M | re.S)


def main() -> int:
    """Write the list, or compare it with the tree; return the exit status."""
    path = ROOT / "pyproject.toml"
    now = path.read_text(encoding="utf-8")
    wanted = with_packages(now, packages())
    if "--check" in sys.argv[1:]:
        return int(now != wanted)
    if now != wanted:
        path.write_text(wanted, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
