"""Size of the code per package, compared with the baseline of this round and with the budgets.

    python -m benchmarks.size [COMMIT] [--budgets] [--page]

Lines are those of ``git ls-files | xargs cat | wc -l``; nodes are those of ``ast.walk`` over Python's syntax tree.
"""

from __future__ import annotations

import argparse
import ast
import io
import subprocess
import sys
import tarfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from .claims import ABSENT

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "size.md"
BASELINE = "aa776adc"
FOLDERS = ("src/eomgen", "codegen", "templates", "tests", "benchmarks", "generated/one_link", "docs")
PYTHON = (".py",)
OTHERS = (".c", ".h", ".jinja", ".mjs", ".json", ".cpp", ".hpp", ".css", ".js")
CODE = (*PYTHON, *OTHERS)
VENDORED = "templates/live/three/"
COLUMNS = 120  # of a line at most
SHARE = 0.9  # of the share by which lines fall, bytes and nodes fall at least


class Size(NamedTuple):
    """Size of files: nodes of Python alone, ``long`` lines of more than COLUMNS columns."""

    files: int = 0
    lines: int = 0
    bytes: int = 0
    nodes: int = 0
    words: int = 0
    long: int = 0


Sizes = Mapping[str, Size]  # by path


class Budget(NamedTuple):
    """The greatest number of a unit in files of some folders: after core and periphery are refactored, and finally."""

    what: str
    unit: str
    folders: Sequence[str]
    kinds: Sequence[str]
    after: int
    final: int | None = None


BUDGETS = (
    Budget("Python in src/eomgen", "lines", ["src/eomgen"], PYTHON, 78_000, 87_000),
    Budget("Python in codegen", "lines", ["codegen"], PYTHON, 21_000, 22_000),
    Budget("templates and src/eomgen/clib", "lines", ["templates", "src/eomgen/clib"], CODE, 15_500, 16_000),
    Budget("Python in tests", "lines", ["tests"], PYTHON, 90_000, 96_000),
    Budget("Python in benchmarks", "lines", ["benchmarks"], PYTHON, 5_500, 6_000),
    Budget("pages of docs", "words", ["docs"], [".md"], 75_000, 85_000),
    Budget("pages of docs", "files", ["docs"], [".md"], 50, 60),
    Budget("generated/one_link", "lines", ["generated/one_link"], CODE, 7_500),
    Budget("generated/one_link", "bytes", ["generated/one_link"], CODE, 300_000),
    Budget("Python in generated/one_link", "lines", ["generated/one_link"], PYTHON, 3_300),
)


def contents(root: Path, commit: str | None = None, *, untracked: bool = False) -> Iterator[tuple[str, bytes]]:
    """Yield paths and contents of the files of a commit, or of the working tree's tracked files; no symbolic links.

    Raises:
        subprocess.CalledProcessError: ``root`` is no repository, or does not have the commit.
    """
    listing = ["ls-files", "-z", *(["-co", "--exclude-standard"] if untracked else [])]
    command = ["git", "-C", str(root), *(listing if commit is None else ["archive", "--format=tar", commit])]
    listed = subprocess.run(command, check=True, capture_output=True).stdout
    if commit is not None:
        with tarfile.open(fileobj=io.BytesIO(listed)) as archive:
            for member in archive:
                if member.isreg() and (file := archive.extractfile(member)) is not None:
                    yield member.name, file.read()
        return
    for name in filter(None, listed.decode().split("\0")):
        if (root / name).is_file() and not (root / name).is_symlink():
            yield name, (root / name).read_bytes()


def measure(root: Path, commit: str | None = None) -> Sizes:
    """Return the sizes of code in FOLDERS, without vendored files, and of the pages of docs."""
    return {
        name: size_of(name, data)
        for name, data in contents(root, commit)
        if name.startswith(tuple(f"{folder}/" for folder in FOLDERS))
        and name.endswith(".md" if name.startswith("docs/") else CODE)
        and not name.startswith(VENDORED)
    }


def size_of(name: str, data: bytes) -> Size:
    """Return the size of one file; the lines of data in .json may have any length."""
    nodes = sum(1 for _ in ast.walk(ast.parse(data))) if name.endswith(PYTHON) else 0
    text = data.decode("utf-8", "replace")
    long = 0 if name.endswith(".json") else sum(len(line) > COLUMNS for line in text.split("\n"))
    return Size(1, data.count(b"\n"), len(data), nodes, len(text.split()), long)


def total(sizes: Sizes, folders: Sequence[str], kinds: Sequence[str] = CODE) -> Size:
    """Return the size of the files of these kinds in these folders."""
    inside = tuple(f"{folder}/" for folder in folders)
    found = [size for name, size in sizes.items() if name.startswith(inside) and name.endswith(tuple(kinds))]
    return Size(*map(sum, zip(Size(), *found, strict=True)))


def fallen(before: Size, now: Size, unit: str) -> float:
    """Return the share by which a number fell."""
    old = getattr(before, unit)
    return 1.0 - getattr(now, unit) / old if old else 0.0


def is_denser(before: Size, now: Size) -> bool:
    """Tell whether bytes, or nodes of Python, fell by less than SHARE of the share by which lines fell."""
    lines = fallen(before, now, "lines")
    return lines > 0.0 and any(fallen(before, now, x) < SHARE * lines for x in ("bytes", "nodes") if getattr(before, x))


def budget_lines(before: Sizes, now: Sizes) -> list[str]:
    """Return the table of budgets, and which code has fewer lines because they are denser."""
    rows, denser = [], []
    for budget in BUDGETS:
        old, new = (total(sizes, budget.folders, budget.kinds) for sizes in (before, now))
        shares = [f"{round(100 * fallen(old, new, unit), 1) + 0.0:.1f}" for unit in (budget.unit, "bytes", "nodes")]
        limits = ("" if limit is None else f"{limit:,}" for limit in (budget.after, budget.final))
        numbers = (f"{getattr(size, budget.unit):,}" for size in (old, new))
        rows.append([budget.what, budget.unit, *numbers, *limits, *shares])
        denser += [budget.what] * (budget.unit == "lines" and is_denser(old, new))
    heads = ("budget", "unit", BASELINE, "now", "at most", "finally", "fallen by, %", "bytes, %", "nodes, %")
    said = f"Bytes or nodes fell by less than {SHARE} of the share of lines: {', '.join(denser) or 'nowhere'}."
    return [*table(heads, rows, 2), "", said]


def size_lines(versions: Mapping[str, Sizes]) -> list[str]:
    """Return the tables of packages with their sub-packages, and of kinds of files, with a column for each version."""
    packages: dict[str, None] = {}
    for name in sorted(name for sizes in versions.values() for name in sizes if not name.startswith("docs/")):
        folder = next(folder for folder in FOLDERS if name.startswith(f"{folder}/"))
        first, *rest = name.removeprefix(f"{folder}/").split("/")
        packages |= dict.fromkeys([folder, f"{folder}/{first}"][: 2 if rest else 1])
    heads = ("Python lines", "bytes", "nodes", "other lines", "their bytes", f"lines over {COLUMNS} columns")
    rows, kinds = [], []
    for name in packages:
        found = []
        for sizes in versions.values():
            python, others = total(sizes, [name], PYTHON), total(sizes, [name], OTHERS)
            found.append([*python[1:4], *others[1:3], python.long + others.long])
        rows.append([name, *(f"{x:,}" for column in zip(*found, strict=True) for x in column)])
    for folder in FOLDERS[:-1]:
        for kind in CODE:
            each = [total(sizes, [folder], [kind])[:3] for sizes in versions.values()]
            if any(map(sum, each)):
                kinds.append([folder, kind, *(f"{x:,}" for column in zip(*each, strict=True) for x in column)])
    both, units = ([f"{x}, {y}" for x in y_heads for y in versions] for y_heads in (heads, ("files", "lines", "bytes")))
    return [*table(["package", *both], rows), "", *table(["package", "kind", *units], kinds, 2)]


def table(heads: Sequence[str], rows: Sequence[Sequence[str]], words: int = 1) -> list[str]:
    """Return a Markdown table whose first columns have words and the others numbers."""
    rule = "|---" * words + "|---:" * (len(heads) - words) + "|"
    return [f"| {' | '.join(heads)} |", rule, *(f"| {' | '.join(row)} |" for row in rows)]


TEXT = f"""# Size of the code

Written by `python -m benchmarks.size --page`; do not edit. It compares commit {BASELINE} with commit {{commit}}.

Lines are counted as by `git ls-files | xargs cat | wc -l`; nodes are those of Python's syntax tree (`ast.walk`).
Vendored files (`{VENDORED}`) are left out.

## Budgets

"At most" applies once the core and the tools around it are refactored, "finally" after the additions that follow.
Bytes and nodes have to fall by at least {SHARE} of the share by which lines fall: longer lines are not less code.

{{budgets}}

## Packages

{{sizes}}
"""


def main(words: Sequence[str] | None = None) -> int:
    """Print sizes or budgets, or write the page."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.size", description="Measure the size of the code.")
    parser.add_argument("commit", nargs="?", metavar="COMMIT", help="default: the working tree; with --page: HEAD")
    parser.add_argument("--budgets", action="store_true", help=f"compare with {BASELINE} and with the budgets")
    parser.add_argument("--page", action="store_true", help="write docs/size.md")
    arguments = parser.parse_args(words)
    commit = arguments.commit or ("HEAD" if arguments.page else None)
    try:
        if commit is not None:
            command = ["git", "-C", str(ROOT), "rev-parse", "--short=8", commit]
            commit = subprocess.run(command, check=True, capture_output=True).stdout.decode().strip()
        now = measure(ROOT, commit)
        before = measure(ROOT, BASELINE) if arguments.budgets or arguments.page else {}
    except subprocess.CalledProcessError as error:
        print(f"{ABSENT}{error.stderr.decode().strip()}", file=sys.stderr)
        return 1
    if arguments.page:
        budgets, sizes = "\n".join(budget_lines(before, now)), "\n".join(size_lines({BASELINE: before, "now": now}))
        PAGE.write_text(TEXT.format(commit=commit, budgets=budgets, sizes=sizes), encoding="ascii")
        print(f"wrote docs/{PAGE.name}")
    else:
        print("\n".join(budget_lines(before, now) if arguments.budgets else size_lines({commit or "now": now})))
    return 0


if __name__ == "__main__":
    sys.exit(main())
