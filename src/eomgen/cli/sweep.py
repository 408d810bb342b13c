"""The command sweep: one scenario for many values of its numbers."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from ..errors import InputError
from ..optional import optional_import
from ..results.beside import BESIDE_SWEEP, TABLE
from .shared.command import Command
from .shared.numbers import whole
from .shared.options import add_json
from .shared.output import can_be_left_out, say, show_files
from .shared.progress import progress_bar
from .shared.reading import add_robot, read_robot
from .shared.writing import remove_older


def _add_sweep(parser: argparse.ArgumentParser) -> None:
    add_robot(parser)
    parser.add_argument(
        "--scenario", metavar="FILE", required=True, help="a scenario: path of a .toml file, or a built-in name"
    )
    parser.add_argument(
        "--plan", metavar="FILE", required=True, help="plan of a sweep: what changes and what is recorded (.toml)"
    )
    parser.add_argument("-o", "--output", type=Path, required=True, help="folder for results; goes on with what it has")
    parser.add_argument("--threads", type=whole, metavar="N", help="threads of this process (one per core)")
    parser.add_argument(
        "--processes", type=whole, metavar="N", help="processes instead of threads: faster for long sweeps"
    )
    parser.add_argument("--dask", metavar="ADDRESS", help="scheduler such as tcp://host:8786, instead of threads")
    parser.add_argument("--no-plots", action="store_true", help="write no plots")
    add_json(parser)


def _sweep(options: argparse.Namespace) -> None:
    from ..sweep.driver import run
    from ..sweep.plan import load_plan
    from ..sweep.store import ROWS

    executors = [name for name in ("threads", "processes", "dask") if getattr(options, name) is not None]
    if len(executors) > 1:
        raise InputError(f"{' and '.join(f'--{name}' for name in executors)} are given together; allowed: one of them")
    if options.processes is not None and options.processes < 1:
        raise InputError(f"--processes: {options.processes} is no number of processes; allowed: from 1 on")
    robot, plan = read_robot(options), load_plan(options.plan)
    try:
        with progress_bar("sweeping") as report, _executor(options) as executor:
            result = run(
                robot,
                options.scenario,
                plan,
                options.output,
                threads=options.threads,
                executor=executor,
                progress=report,
            )
    except KeyboardInterrupt:
        say(f"eomgen: what was done is in {options.output}; the same command goes on with it", sys.stderr)
        raise
    written = [result.save_table(options.output / f"{TABLE}.{_table_suffix()}")]
    if not options.no_plots:
        from ..pictures.sweep import plot_sweep

        with can_be_left_out("plots are"):
            written += plot_sweep(result, options.output)
    show_files(options, result.lines(), result.as_dict(), written)
    remove_older(options.output / ROWS, BESIDE_SWEEP, written)


def _table_suffix() -> str:
    try:
        import pyarrow  # noqa: F401
    except ImportError:
        return "csv"
    return "parquet"


@contextmanager
def _executor(options: argparse.Namespace) -> Iterator[Any]:
    """Executor of a Dask scheduler or of processes of this machine, or None for threads."""
    address: str | None = options.dask
    if options.processes is not None:
        from concurrent.futures import ProcessPoolExecutor
        from multiprocessing import get_context

        with ProcessPoolExecutor(options.processes, mp_context=get_context("spawn")) as pool:
            yield pool
        return
    if address is None:
        yield None
        return
    with optional_import("Dask", "--dask needs"):
        import distributed
    try:
        client: Any = distributed.Client(address, timeout="10s")  # type: ignore[no-untyped-call,unused-ignore]
    except (OSError, ValueError, TimeoutError) as error:
        raise InputError(f"--dask: no scheduler answers at {address} ({error}); allowed: tcp://host:port") from None
    with client, client.get_executor() as executor:
        yield executor


COMMANDS = (
    Command(
        _add_sweep,
        _sweep,
        "simulate a scenario for many values of parameters and of its numbers",
        {"sweep arm.toml --scenario s.toml --plan p.toml -o out": "the scenario for many values of its numbers"},
    ),
)
