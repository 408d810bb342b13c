"""docs/mutation.md: how many mutants of the derivation the checks kill, and why the others survive."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

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

INTRODUCTION = """# Mutation testing of the derivation

Written by `make mutation`; do not edit. What is argued about survivors is in `benchmarks/mutation/survivors.toml`.

A mutant is a module of `codegen/` with one small change. Each is loaded in a process of its own, and small robots with
every feature of the description are derived with it (`tests/support/mutation_cases.py`). Their programs are interpreted
in floating-point numbers, without a compiler, and compared with Pinocchio, with formulas and with operation counts
(`tests/oracles/mutation.py`); proofs, zero maps and the closed form have their own tests. A mutant is killed by the
first check that fails.

Changes are those of mutmut's operators ({version}), applied to the syntax tree of a module. mutmut's own runner is not
used: it leaves out functions with decorators, which the proofs and most rules of pruning are, and it cannot be told
that the package `eomgen.codegen` is the folder `codegen`. Two of its operators are left out because what they make
nearly always fails at once and would flatter the figure: arguments that become None or are dropped, and assignments of
None. In their place neighbouring arguments are swapped where their order counts (not those of a sum, a maximum, a
scalar product), operands and summands are dropped, calls of vector functions
are replaced by one of their arguments, and conditions are turned round. Docstrings, annotations, decorators, messages,
texts for people and `strict=True` are not mutated.
"""


@dataclass(frozen=True)
class Survivor:
    """A mutant that lives, and what is argued about it: its kind and the reason; empty where nobody has argued."""

    outcome: Outcome
    change: str
    kind: str
    why: str


def file_of(module: str) -> str:
    """Return its path in ``codegen/``."""
    return f"{module.replace('.', '/')}.py"


def survivors(outcomes: Sequence[Outcome], sources: dict[str, str]) -> list[Survivor]:
    """Return those that survived, each with the first argument whose pattern its function and change match."""
    rules = _rules()
    listed = []
    for outcome in outcomes:
        if outcome.result == "survived":
            mutant = outcome.mutant
            change = mutant.change(sources[mutant.module])
            where = f"{mutant.module}.{mutant.function}: {change}"
            rule = next((rule for rule in rules if re.search(rule["match"], where)), {"kind": "", "why": ""})
            listed.append(Survivor(outcome, change, rule["kind"], rule["why"]))
    return listed


def _rules() -> list[dict[str, str]]:
    try:
        import tomllib
    except ImportError:  # Python 3.10
        import tomli as tomllib  # type: ignore[no-redef]
    return list(tomllib.loads(ARGUMENTS.read_text(encoding="utf-8"))["survivor"])


def write_page(
    path: Path, outcomes: Sequence[Outcome], sources: dict[str, str], sizes: dict[str, int], version: str
) -> str:
    """Write the page and return its summary line.

    Args:
        outcomes: of all mutants that were run.
        sources: text of every module.
        sizes: how many mutants of each module there are, run or not.
        version: of mutmut.
    """
    lines = [INTRODUCTION.format(version=version), *_table(outcomes, sizes)]
    results = Counter(outcome.result for outcome in outcomes)
    total = len(outcomes)
    killed = total - results["survived"]
    silent = killed - results["error"]
    summary = f"Killed: {killed} of {total} mutants ({100 * killed / total:.1f} %)."
    listed = survivors(outcomes, sources)
    kinds = Counter(survivor.kind or "not argued" for survivor in listed)
    lines += [
        summary,
        "",
        f"Of those that raise no error of their own, but would give wrong equations or costlier ones without a word: "
        f"{silent} of {total - results['error']} ({100 * silent / (total - results['error']):.1f} %). "
        f"All mutants took {sum(outcome.seconds for outcome in outcomes) / 60:.0f} minutes of one core.",
        "",
        "## Survivors",
        "",
        ", ".join(f"{count} {kind}" for kind, count in kinds.most_common()) + ".",
        "",
        "| where | change | why it lives |",
        "|---|---|---|",
    ]
    for survivor in listed:
        m = survivor.outcome.mutant
        change = " &rarr; ".join(f"`{_cell(side)}`" for side in survivor.change.split(" -> ", 1))
        why = f"{survivor.kind}: {survivor.why}" if survivor.kind else "not argued"
        lines.append(f"| {file_of(m.module)}:{m.line} `{m.function}` | {change} | {why} |")
    path.write_text("\n".join(lines) + "\n", encoding="ascii")
    return summary


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
