"""docs/mutation.md: how many mutants the tests kill, and why the others survive."""

from __future__ import annotations

import importlib.metadata
import re
import tomllib
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from .packages import Verdict
from .runner import Outcome

MODULES = (  # of the derivation, in the order of importance
    "joint.lemmas",
    "closed_form.trace",
    "tree.recursion",
    "tree.composite",
    "solve.articulated",
    "solve.elimination",
    "forces.coordinates",
    "forces.transmissions",
    "joint.zeros",
)
ARGUMENTS = Path(__file__).with_name("survivors.toml")

PAGE = Path(__file__).parents[2] / "docs" / "mutation.md"
TITLE = """# Mutation testing

Written by `python -m benchmarks.mutation`; do not edit. Remarks on survivors are in
`benchmarks/mutation/survivors.toml`.
"""
PACKAGES = "Wrong values in every package"
DERIVATION = "Small changes of the derivation"
ABOUT_PACKAGES = """
A mutant is one function that returns a wrong value: with another sign or size, zero, one entry, line or field changed,
the last item missing, nothing at all; a function without a value does nothing. The functions are a random choice with a
fixed seed, at least ten of every package that has so many (`benchmarks/mutation/functions.json`). The recorded run of
the suite says which tests execute a function; of these the cheapest of each module run until the first failure, up to
90 s of processor time. A test that also fails with unchanged values behind the same decorator does not count
(`python -m benchmarks.mutation record`, then `packages`).

| package | mutants | killed | not executed | value not changed | survived |
|---|---:|---:|---:|---:|---:|
"""
ABOUT_DERIVATION = """
A mutant is a module of `codegen/` with one small change. Each is loaded in a process of its own, and small robots with
every feature of the description are derived with it (`tests/support/mutation_cases.py`). Their programs are interpreted
in floating-point numbers, without a compiler, and compared with Pinocchio, with formulas and with operation counts
(`tests/oracles/mutation.py`); proofs, zero maps and the closed form have their own tests. A mutant is killed by the
first check that fails (`make mutation`).

Changes are those of mutmut's operators ({version}), applied to the syntax tree of a module. mutmut's own runner is not
used: it leaves out functions with decorators, which the proofs and most rules of pruning are, and it cannot be told
that the package `eomgen.codegen` is the folder `codegen`. Two of its operators are left out because what they make
nearly always fails at once and would flatter the figure: arguments that become None or are dropped, and assignments of
None. In their place neighbouring arguments are swapped where their order counts (not those of a sum, a maximum, a
scalar product), operands and summands are dropped, calls of vector functions
are replaced by one of their arguments, and conditions are turned round. Docstrings, annotations, decorators, messages,
texts for people and `strict=True` are not mutated.

"""


def file_of(module: str) -> str:
    """Return its path in ``codegen/``."""
    return f"{module.replace('.', '/')}.py"


def argument(where: str) -> tuple[str, str]:
    """Return the kind and the reason of the first remark whose pattern matches; empty if there is none."""
    rules = tomllib.loads(ARGUMENTS.read_text(encoding="utf-8"))["survivor"]
    return next(((rule["kind"], rule["why"]) for rule in rules if re.search(rule["match"], where)), ("", ""))


def write_packages(verdicts: Sequence[Verdict]) -> None:
    """Write the part of the page about functions with wrong values."""
    results = ("killed", "not executed", "unchanged", "survived")
    lines = [ABOUT_PACKAGES.rstrip("\n")]
    for package in sorted({v.mutant.package for v in verdicts}):
        of = Counter(v.result for v in verdicts if v.mutant.package == package)
        lines.append(f"| {package} | {sum(of.values())} | " + " | ".join(str(of[r]) for r in results) + " |")
    killed = sum(v.result == "killed" for v in verdicts)
    lines += ["", f"Killed: {killed} of {len(verdicts)} wrong values ({100 * killed / len(verdicts):.1f} %).", ""]
    rows = []
    for v in verdicts:
        if v.result != "killed":
            rows.append((f"{v.mutant.file} `{v.mutant.name}`", f"{v.mutant.kind}, {v.result}", *argument(v.mutant.key)))
    _write(PACKAGES, [*lines, *_survivors(rows)])


def write_derivation(outcomes: Sequence[Outcome], sources: dict[str, str], sizes: dict[str, int]) -> None:
    """Write the part of the page about small changes.

    Args:
        outcomes: of all mutants that were run.
        sources: text of every module.
        sizes: how many mutants of each module there are, run or not.
    """
    results = Counter(outcome.result for outcome in outcomes)
    total = len(outcomes)
    killed = total - results["survived"]
    silent = killed - results["error"]
    rows = []
    for m in (outcome.mutant for outcome in outcomes if outcome.result == "survived"):
        change = m.change(sources[m.module])
        sides = " &rarr; ".join(f"`{_cell(side)}`" for side in change.split(" -> ", 1))
        remark = argument(f"{m.module}.{m.function}: {change}")
        rows.append((f"{file_of(m.module)}:{m.line} `{m.function}`", sides, *remark))
    lines = [
        ABOUT_DERIVATION.format(version=importlib.metadata.version("mutmut")).rstrip("\n"),
        "",
        *_table(outcomes, sizes),
        f"Killed: {killed} of {total} mutants ({100 * killed / total:.1f} %).",
        "",
        f"Of those that raise no error of their own, but would give wrong equations or costlier ones without a word: "
        f"{silent} of {total - results['error']} ({100 * silent / (total - results['error']):.1f} %). "
        f"All mutants took {sum(outcome.seconds for outcome in outcomes) / 60:.0f} minutes of one core.",
        "",
    ]
    _write(DERIVATION, [*lines, *_survivors(rows)])


def _survivors(rows: Sequence[tuple[str, str, str, str]]) -> list[str]:
    """Return a table of places, changes and remarks, and how many there are of each kind."""
    kinds = Counter(kind or "not argued" for *_, kind, _ in rows)
    lines = [", ".join(f"{count} {kind}" for kind, count in kinds.most_common()) + ".", ""]
    lines += ["| where | change | why it lives |", "|---|---|---|"]
    return lines + [
        f"| {where} | {change} | {f'{k}: {why}' if k else 'not argued'} |" for where, change, k, why in rows
    ]


def _write(title: str, lines: Sequence[str]) -> None:
    """Write one part of the page; the other stays."""
    parts = re.split(r"^## (.*)\n", PAGE.read_text(encoding="ascii"), flags=re.MULTILINE)
    texts = {**dict(zip(parts[1::2], parts[2::2], strict=True)), title: "\n".join(lines) + "\n"}
    kept = [f"## {name}\n{texts[name].rstrip()}\n" for name in (PACKAGES, DERIVATION) if name in texts]
    PAGE.write_text("\n".join([TITLE, *kept]), encoding="ascii")


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


def _table(outcomes: Sequence[Outcome], sizes: dict[str, int]) -> list[str]:
    lines = ["| module | mutants | run | killed by a check | killed by an error | endless | survived | killed |"]
    lines.append("|---|---:|---:|---:|---:|---:|---:|---:|")
    for module in sizes:
        of = Counter(o.result for o in outcomes if o.mutant.module == module)
        n = sum(of.values())
        share = 100 * (n - of["survived"]) / n
        cells = (of["wrong"], of["error"], of["timeout"], of["survived"])
        lines.append(
            f"| {file_of(module)} | {sizes[module]} | {n} | " + " | ".join(map(str, cells)) + f" | {share:.1f} % |"
        )
    lines.append("")
    if any(n > sum(o.mutant.module == module for o in outcomes) for module, n in sizes.items()):
        lines += [
            "Where fewer are run than there are, they are a random sample with the module's name as its seed.",
            "",
        ]
    return lines
