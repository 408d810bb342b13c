"""Write the list of packages in pyproject.toml, which the wheel is built from: python -m release.packages.

With --check, compare the list with the tree instead: status 1 if they differ.  With --links FOLDER, write FOLDER/eomgen
instead: the three folders of the source as one package, for tools that read the source without importing it.
"""

from __future__ import annotations

import re
import shutil
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


def link_package(folder: Path) -> Path:
    """Replace a folder by one that holds the package ``eomgen`` alone, as links to the source; return the folder."""
    shutil.rmtree(folder, ignore_errors=True)
    (folder / "eomgen").mkdir(parents=True)
    inside = [path for path in (ROOT / PLACES["eomgen"]).iterdir() if path.name != "__pycache__"]
    for path in (*inside, *(ROOT / place for package, place in PLACES.items() if "." in package)):
        (folder / "eomgen" / path.name).symlink_to(path)
    return folder


def main() -> int:
    """Write the list, compare it with the tree, or write links; return the exit status."""
    if sys.argv[1:2] == ["--links"]:
        link_package(Path(sys.argv[2]))
        return 0
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
