"""Write the measurements of docs/arrays.md: native text under NumPy and JAX beside the kernel's C, for batches.

    python -m benchmarks.arrays [--print]

All in one process and in turns; JAX and the kernel may use all processors.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import eomgen
from eomgen.bench.beside import processor_name
from eomgen.codegen.arrays.sources import render_arrays
from eomgen.robot.model import build_model

PAGE = Path(__file__).parents[1] / "docs" / "arrays.md"
BEGIN, END = "<!-- begin of times -->\n", "<!-- end of times -->"
ROBOTS = ("one_link", "ur5", "puma560_elastic")
STATES, ROUNDS = 1024, 15


def seconds(call: Callable[[], Any]) -> float:
    """Time of one call."""
    began = time.perf_counter()
    call()
    return time.perf_counter() - began


def row(name: str) -> str:
    """Return the table's row of a robot: forward dynamics."""
    import jax
    import jax.numpy as jnp

    robot = eomgen.load_robot(name)
    module: dict[str, Any] = {}
    exec(render_arrays(build_model(robot), ("forward_dynamics",)), module)
    kernel = eomgen.build(robot, kernels=("forward_dynamics",))
    kernel.threads = os.cpu_count() or 1
    rng = np.random.default_rng(0)
    x = [rng.uniform(-0.3, 0.3, (STATES, kernel.n)) * scale for scale in (1.0, 0.01, 1.0)]
    plain = module["make"](np).forward_dynamics
    compiled_call = jax.jit(module["make"](jnp).forward_dynamics)
    began = time.perf_counter()
    compiled = compiled_call.lower(*x).compile()
    compiling = time.perf_counter() - began
    expected = kernel.forward_dynamics(*x)
    error = max(float(np.abs(f(*x) - expected).max() / np.abs(expected).max()) for f in (plain, compiled))
    calls = (
        lambda: kernel.forward_dynamics(*x),
        lambda: compiled(*x).block_until_ready(),
        lambda: plain(*x),
    )
    medians = np.median([[seconds(call) for call in calls] for _ in range(ROUNDS)], axis=0) / STATES * 1e9
    cells = (f"{compiling:.1f}", *(f"{ns:.0f}" for ns in medians), f"{error:.0e}")
    return f"| {name} | {' | '.join(cells)} |"


def report() -> str:
    """Return the table, and what it was measured on."""
    import jax

    jax.config.update("jax_enable_x64", True)
    heads = ("robot", "JAX compiles, s", "C, ns", "JAX, ns", "NumPy, ns", "greatest difference")
    lines = [
        f"Measured by `python -m benchmarks.arrays` on {processor_name()}, JAX {jax.__version__}: forward dynamics",
        f"of {STATES} states together, nanoseconds a state, medians of {ROUNDS} rounds in turns"
        f" on {os.cpu_count()} processors.",
        "",
        f"| {' | '.join(heads)} |",
        "|---" + "|---:" * (len(heads) - 1) + "|",
        *map(row, ROBOTS),
    ]
    return "\n".join(lines) + "\n"


def main() -> None:
    """Measure, and write the figures into the page or print them."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.arrays")
    parser.add_argument("--print", action="store_true", help="print the table, write nothing")
    text = report()
    if parser.parse_args().print:
        print(text, end="")
        return
    page = PAGE.read_text(encoding="utf-8")
    before, rest = page.split(BEGIN)
    PAGE.write_text(before + BEGIN + text + END + rest.split(END, 1)[1], encoding="utf-8")


if __name__ == "__main__":
    main()
