"""Lines of each package that the last test run with coverage executed: python -m benchmarks.coverage [DATA]."""

from __future__ import annotations

import sys
from collections import defaultdict
from pathlib import Path

import coverage

ROOT = Path(__file__).parents[1]
FOLDERS = ("src/eomgen", "codegen")


def covered(data: str = ".coverage") -> dict[str, tuple[int, int]]:
    """Return the number of statements, and how many of them were executed, by package.

    Args:
        data: A file that a run of pytest with ``--cov`` wrote.
    """
    measured = coverage.Coverage(data_file=data)
    measured.load()
    found: dict[str, tuple[int, int]] = defaultdict(lambda: (0, 0))
    for folder in FOLDERS:
        for path in sorted((ROOT / folder).rglob("*.py")):
            inside = path.relative_to(ROOT / folder).parts
            package = f"{folder}/{inside[0]}" if len(inside) > 1 else folder
            _, statements, _, missing, _ = measured.analysis2(str(path))
            count, executed = found[package]
            found[package] = count + len(statements), executed + len(statements) - len(missing)
    return dict(found)


def main() -> None:
    """Print a row for each package, the least covered first, and the total."""
    rows = covered(*sys.argv[1:])
    total = tuple(sum(column) for column in zip(*rows.values(), strict=True))
    for package, (count, executed) in sorted(rows.items(), key=lambda row: row[1][1] / max(row[1][0], 1)):
        print(f"{package:32} {executed:6} of {count:6} {100.0 * executed / max(count, 1):5.1f} %")
    print(f"{'all':32} {total[1]:6} of {total[0]:6} {100.0 * total[1] / total[0]:5.1f} %")


if __name__ == "__main__":
    main()
