"""The command sweep: one scenario for many values of its numbers."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from ..errors import InputError
from .states import Command, Load, Progress


def add_sweep(commands: Any, robot_command: Command, load: Load, progress: Progress) -> None:
    """``eomgen sweep``; ``robot_command`` makes a command that takes a robot, ``load`` reads it."""

    def run_command(options: argparse.Namespace) -> None:
        from ..sweep.driver import run
        from ..sweep.plan import load_plan

        given = [name for name in ("threads", "processes", "dask") if getattr(options, name) is not None]
        if len(given) > 1:
            raise InputError(f"{' and '.join(f'--{name}' for name in given)} are given together; allowed: one of them")
        if options.processes is not None and options.processes < 1:
            raise InputError(f"--processes: {options.processes} is no number of processes; allowed: from 1 on")
        robot, plan = load(options), load_plan(options.plan)
        try:
            with progress("sweeping") as report, _executor(options) as executor:
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
            print(f"eomgen: what was done is in {options.output}; the same command goes on with it", file=sys.stderr)
            raise
        written = [result.save_table(options.output / f"samples.{_table_suffix()}")]
        if not options.no_plots:
            from ..pictures.sweep import plot_sweep

            written += plot_sweep(result, options.output)
        if options.json:
            print(json.dumps({"files": [str(path) for path in written], **result.as_dict()}, indent=1))
            return
        print("\n".join(result.lines()))
        for path in written:
            print(f"wrote {path}")

    command = robot_command(
        commands, "sweep", run_command, "a scenario for many values of parameters and of its numbers"
    )
    command.add_argument("--scenario", metavar="FILE", required=True, help="path of a .toml file, or a built-in name")
    command.add_argument("--plan", metavar="FILE", required=True, help="what changes and what is recorded (.toml)")
    command.add_argument(
        "-o", "--output", type=Path, required=True, help="folder for results; goes on with what it has"
    )
    command.add_argument("--threads", type=int, metavar="N", help="threads of this process (one per core)")
    command.add_argument(
        "--processes", type=int, metavar="N", help="processes instead of threads: faster for long sweeps"
    )
    command.add_argument("--dask", metavar="ADDRESS", help="scheduler such as tcp://host:8786, instead of threads")
    command.add_argument("--no-plots", action="store_true", help="write the table only")
    command.add_argument("--json", action="store_true", help="print JSON")


def _table_suffix() -> str:
    try:
        import pyarrow  # noqa: F401
    except ImportError:
        return "csv"
    return "parquet"


@contextmanager
def _executor(options: argparse.Namespace) -> Iterator[Any]:
    """That of a Dask scheduler, processes of this machine, or None."""
    address: str | None = options.dask
    if options.processes is not None:
        with ProcessPoolExecutor(options.processes, mp_context=get_context("spawn")) as pool:
            yield pool
        return
    if address is None:
        yield None
        return
    try:
        import distributed
    except ImportError:
        raise InputError('--dask needs Dask: pip install "eomgen[sweep]"') from None
    try:
        client: Any = distributed.Client(address, timeout="10s")  # type: ignore[no-untyped-call,unused-ignore]
    except (OSError, ValueError, TimeoutError) as error:
        raise InputError(f"--dask: no scheduler answers at {address} ({error}); allowed: tcp://host:port") from None
    with client, client.get_executor() as executor:
        yield executor
