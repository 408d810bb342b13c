"""Mutation testing of the derivation; writes docs/mutation.md, which says how."""

from __future__ import annotations

import argparse
import importlib.metadata
import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from tests.oracles.mutation import checks, every_check
from tests.support.mutant import dependents, mutated, source_of
from tests.support.mutation_cases import cases, small_cases

from .mutants import Mutant, mutants_of
from .page import MODULES, file_of, write_page
from .runner import Clock, Outcome, run

ROOT = Path(__file__).parents[2]
RAW = ROOT / "out" / "mutation.json"  # a line per mutant that was run


def main() -> None:
    """Make mutants, run the checks on each, write the page if all its modules were run."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.mutation", description=__doc__)
    parser.add_argument("modules", nargs="*", default=list(MODULES), help="run anew; those of the page if none")
    parser.add_argument("--sample", type=int, default=0, help="at most so many mutants of each module; 0: all")
    parser.add_argument("--processes", type=int, default=2, help="how many mutants at once")
    parser.add_argument("--survivors", action="store_true", help="of the last run, those alone that survived it")
    parser.add_argument("--page", action="store_true", help="the page alone, of the last run")
    options = parser.parse_args()
    if unknown := [name for name in options.modules if name not in MODULES]:
        parser.error(f"no module of the page: {', '.join(unknown)}; it has {', '.join(MODULES)}")
    RAW.parent.mkdir(exist_ok=True)
    if options.survivors:
        before = _read()
        again = {o.mutant: o for o in _run([o.mutant for o in before if o.result == "survived"], options.processes)}
        _write([again.get(o.mutant, o) for o in before])
    elif not options.page:
        _write([o for o in _read() if o.mutant.module not in options.modules])
        chosen = [mutant for name in options.modules for mutant in mutants_of(name, source_of(name), options.sample)[0]]
        _run(chosen, options.processes)
    _report(_read())


def _run(mutants: Sequence[Mutant], processes: int) -> list[Outcome]:
    """Run mutants and return their outcomes, each appended to the file as it comes."""
    cases(), small_cases()
    for check in every_check():  # all pass on the code as it is; and what children need is imported
        check()
    dependents("joint.lemmas")  # what imports what, once for all
    clock, outcomes = Clock(len(mutants)), []
    with RAW.open("a", encoding="utf-8") as file:
        for outcome in run(mutants, _judge, processes):
            outcomes.append(outcome)
            file.write(json.dumps(asdict(outcome)) + "\n")
            file.flush()
            clock.tick(outcome)
    return outcomes


def _judge(mutant: Mutant) -> None:
    with mutated(mutant.module, mutant.applied(source_of(mutant.module))):
        for check in checks(mutant.module):
            check()


def _report(outcomes: Sequence[Outcome]) -> None:
    modules = sorted({o.mutant.module for o in outcomes}, key=MODULES.index)
    sources = {name: source_of(name) for name in modules}
    for o in outcomes:
        if o.result == "survived":
            m = o.mutant
            print(f"{file_of(m.module)}:{m.line} {m.function}: {m.change(sources[m.module])}")
    if tuple(modules) == MODULES:
        sizes = {name: mutants_of(name, sources[name], 1)[1] for name in modules}
        print(write_page(ROOT / "docs" / "mutation.md", outcomes, sources, sizes, importlib.metadata.version("mutmut")))


def _read() -> list[Outcome]:
    lines = RAW.read_text(encoding="utf-8").splitlines() if RAW.exists() else []
    outcomes = {o.mutant: o for o in (Outcome(Mutant(**x.pop("mutant")), **x) for x in map(json.loads, lines))}
    if unknown := {mutant.module for mutant in outcomes} - {*MODULES}:
        raise ValueError(f"{RAW}: no module of the page: {', '.join(sorted(unknown))}; remove the file")
    return sorted(outcomes.values(), key=lambda o: (MODULES.index(o.mutant.module), o.mutant.place()))


def _write(outcomes: Sequence[Outcome]) -> None:
    RAW.write_text("".join(json.dumps(asdict(o)) + "\n" for o in outcomes), encoding="utf-8")


if __name__ == "__main__":
    main()
