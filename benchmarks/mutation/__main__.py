"""Mutation testing; writes docs/mutation.md, which says how.

derivation: small changes of modules of codegen, judged without a compiler. packages: functions of every package that
return wrong values, judged by the tests that execute them. record: which test executes which function, for packages.
choose: the list of functions, anew (with --renew: those that are gone alone). page: the page alone, of the last runs.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from tests.support.mutant import Mutant, dependents, mutated, source_of

from .executions import read_coverage, read_executions
from .functions import LIST, SEED, choose, eligible, located, read_list, renewed, write_list
from .packages import Packages, read_verdicts, record
from .page import MODULES, file_of, write_derivation, write_packages
from .runner import Clock, Outcome, run

ROOT = Path(__file__).parents[2]
OUT = ROOT / "out"
RAW, RAW_PACKAGES = OUT / "mutation.json", OUT / "mutation_packages.json"  # a line per mutant that was run
EXECUTIONS = OUT / "executions.json.gz"


def main() -> None:
    """Make mutants, run tests on each, write the page."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.mutation", description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    modes = ("derivation", "packages", "record", "choose", "page")
    parser.add_argument("mode", nargs="?", choices=modes, default=modes[0], help="default: derivation")
    parser.add_argument("--only", nargs="+", default=[], help="modules (derivation) or packages that are run anew")
    parser.add_argument("--sample", type=int, default=0, help="at most so many mutants of each module; 0: all")
    parser.add_argument("--processes", type=int, default=2, help="number of mutants at once, default 2")
    parser.add_argument("--survivors", action="store_true", help="run those of the last run that survived alone")
    parser.add_argument("--tree", type=Path, default=ROOT, help="checkout that packages mutates, default: this one")
    parser.add_argument("--coverage", type=Path, help="file of a recorded run, junit.xml beside it (record)")
    parser.add_argument("--budget", type=float, default=90.0, help="processor time per mutant in s, default 90")
    parser.add_argument("--seed", type=int, default=SEED, help=f"of the choice of functions, default {SEED}")
    parser.add_argument("--renew", action="store_true", help="replace functions that are gone (choose)")
    options = parser.parse_args()
    OUT.mkdir(exist_ok=True)
    {
        "derivation": _derivation,
        "packages": _packages,
        "record": _record,
        "choose": _choose,
        "page": _page,
    }[options.mode](options)


def _choose(options: argparse.Namespace) -> None:
    functions = eligible(options.tree)
    listed = renewed(read_list(), functions, options.seed) if options.renew else choose(functions, seed=options.seed)
    write_list(listed)
    print(f"{len(listed)} functions in {LIST}")


def _record(options: argparse.Namespace) -> None:
    if options.coverage:
        found = read_coverage(options.coverage, options.coverage.with_name("junit.xml"), options.tree)
    else:
        found = record(options.tree, options.processes, options.only or ["tests"])
    found.write(EXECUTIONS)
    print(f"{len(found.tests)} tests execute {len(found.functions)} functions")


def _packages(options: argparse.Namespace) -> None:
    functions, gone = located(read_list(), eligible(options.tree))
    for function in gone:
        print(f"gone: {function.key}; --renew replaces it")
    done = {v.mutant.key: v for v in read_verdicts(RAW_PACKAGES)}
    wanted = [f for f in functions if not options.only or f.package in options.only]
    if options.survivors:
        wanted = [f for f in wanted if f.key in done and done[f.key].result != "killed"]
    elif not options.only:  # goes on where it was interrupted
        wanted = [f for f in wanted if f.key not in done or done[f.key].mutant != f]
    executions = read_executions(EXECUTIONS)
    Packages(options.tree, executions, RAW_PACKAGES, options.budget, options.processes).run(wanted, functions)
    _page(options)


def _derivation(options: argparse.Namespace) -> None:
    from .mutants import mutants_of

    names = options.only or MODULES
    if unknown := [name for name in names if name not in MODULES]:
        raise SystemExit(f"no module of the page: {', '.join(unknown)}; it has {', '.join(MODULES)}")
    if options.survivors:
        before = _read()
        again = {o.mutant: o for o in _run([o.mutant for o in before if o.result == "survived"], options.processes)}
        _write([again.get(o.mutant, o) for o in before])
    else:
        _write([o for o in _read() if o.mutant.module not in names])
        _run([m for name in names for m in mutants_of(name, source_of(name), options.sample)[0]], options.processes)
    _page(options)


def _run(mutants: Sequence[Mutant], processes: int) -> list[Outcome]:
    """Run mutants and return their outcomes, each appended to the file as it comes."""
    from tests.oracles.mutation import checks, every_check
    from tests.support.mutation_cases import cases, small_cases

    def judge(mutant: Mutant) -> None:
        with mutated(mutant.module, mutant.applied(source_of(mutant.module))):
            for check in checks(mutant.module):
                check()

    cases(), small_cases()
    for check in every_check():  # all pass on the code as it is; and what children need is imported
        check()
    dependents("joint.lemmas")  # what imports what, once for all
    clock, outcomes = Clock(len(mutants)), []
    with RAW.open("a", encoding="utf-8") as file:
        for outcome in run(mutants, judge, processes):
            outcomes.append(outcome)
            file.write(json.dumps(asdict(outcome)) + "\n")
            file.flush()
            clock.tick(outcome.result)
    return outcomes


def _page(options: argparse.Namespace) -> None:
    """Write the parts of the page whose runs are complete; name all that survived."""
    if verdicts := read_verdicts(RAW_PACKAGES):
        functions, _ = located(read_list(), eligible(options.tree))
        listed = [v for v in verdicts if v.mutant in functions]
        for v in listed:
            if v.result != "killed":
                print(f"{v.mutant.key} ({v.mutant.kind}): {v.result}")
        print(f"{sum(v.result == 'killed' for v in listed)} of {len(listed)} killed")
        if len(listed) == len(functions):
            write_packages(listed)
    if outcomes := _read():
        from .mutants import mutants_of

        modules = sorted({o.mutant.module for o in outcomes}, key=MODULES.index)
        sources = {name: source_of(name) for name in modules}
        for o in outcomes:
            if o.result == "survived":
                m = o.mutant
                print(f"{file_of(m.module)}:{m.line} {m.function}: {m.change(sources[m.module])}")
        if tuple(modules) == MODULES:
            write_derivation(outcomes, sources, {name: mutants_of(name, sources[name], 1)[1] for name in modules})


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
