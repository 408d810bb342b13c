"""Write two tables of docs/rounding.md: what results with bounds cost, and how near bounds of solutions are.

python -m benchmarks.bounded_results [--print] [--only costs|solutions]
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np

import eomgen
from eomgen.runtime import Kernel

PAGE = Path(__file__).parents[1] / "docs" / "rounding.md"
COSTS = (("ur5", "inverse_dynamics"), ("ur5", "mass_matrix"), ("puma560_elastic", "inverse_dynamics"))
SOLUTIONS = (("one_link", "float64"), ("ur5", "float64"), ("ur5", "float32"), ("puma560_elastic", "float64"))
COUNT, ROUNDS, STATES = 4096, 15, 20  # states of a batch, rounds of which the fastest counts; states with bounds


def states(kernel: Kernel, count: int) -> dict[str, np.ndarray]:
    """Draw states of a kernel: joints as they are free to move, deviations small."""
    rng = np.random.default_rng(0)
    principal = np.array([name.endswith("gamma") for name in kernel.coordinates])
    q = rng.uniform(-1.5, 1.5, (count, kernel.n)) * np.where(principal, 1.0, 1e-4)
    rates = {name: rng.uniform(-1.0, 1.0, (count, kernel.n)) for name in "vau"}
    return {"q": q.astype(kernel.dtype), **{name: x.astype(kernel.dtype) for name, x in rates.items()}}


def fastest(kernel: Kernel, name: str, arrays: Sequence[np.ndarray]) -> float:
    """Return the least processor time of a call of a function, s."""
    times = []
    for _ in range(ROUNDS):
        begin = time.process_time()
        kernel.calls.run(name, None, arrays)
        times.append(time.process_time() - begin)
    return min(times)


def costs() -> Iterator[str]:
    """Yield rows: times of batches with bounds by those without, products fused and not, and in double-double."""
    yield "| robot | method | with bounds, products fused | not fused | in double-double |"
    yield "|---|---|---:|---:|---:|"
    for robot, name in COSTS:
        names = (name, f"{name}_with_errors", f"{name}_extended")
        cells = []
        for native in (True, False):
            kernel = eomgen.build(robot, kernels=names, native=native)
            x = states(kernel, COUNT)
            arrays = [x[label] for label in kernel.raw.functions[name].reads]
            few = [array[: COUNT // 16] for array in arrays]
            plain, bounded = (fastest(kernel, function, arrays) for function in names[:2])
            extended = 16.0 * fastest(kernel, names[2], few)
            cells += [f"{bounded / plain:.1f}"] + ([] if native else [f"{extended / plain:.0f}"])
        yield f"| {robot} | {name.replace('_', ' ')} | {' | '.join(cells)} |"


def by_double(kernel: Kernel, args: tuple[np.ndarray, ...], a: np.ndarray) -> np.ndarray:
    """Bound accelerations by a residual in the kernel's arithmetic with running errors: |M^-1| (|r| + bound)."""
    q, v, u = args
    r, bound = np.moveaxis(kernel.calls.run("residual_with_errors", None, (q, v, a, u)), -2, 0)
    inverse = np.abs(np.linalg.inv(kernel.mass_matrix(q).astype(np.float64)))
    found: np.ndarray = np.einsum("nij,nj->ni", inverse, np.abs(r).astype(np.float64) + bound)
    return found


def solutions() -> Iterator[str]:
    """Yield rows: bounds of accelerations by the size of these, and by those of residuals in plain arithmetic."""
    yield "| robot | dtype | bound of accelerations by their size, median (largest) | residuals in plain arithmetic |"
    yield "|---|---|---:|---:|"
    for robot, dtype in SOLUTIONS:
        names = ("forward_dynamics", "residual", "residual_extended", "residual_with_errors", "mass_matrix")
        kernel = eomgen.build(robot, kernels=names, dtype=dtype)
        x = states(kernel, STATES)
        args = (x["q"], x["v"], x["u"])
        found = kernel.with_errors("forward_dynamics", args)
        assert found.proved.all()
        size = np.abs(found.value).max(axis=1)
        now, before = (y.max(axis=1) / size for y in (found.bound, by_double(kernel, args, found.value)))
        cells = [f"{np.median(y):.0e} ({y.max():.0e})" for y in (now, before)]
        yield f"| {robot} | {dtype} | {' | '.join(cells)} |"


TABLES: dict[str, Callable[[], Iterator[str]]] = {"costs": costs, "solutions": solutions}


def main() -> None:
    """Write the tables into the page, or print them."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.bounded_results")
    parser.add_argument("--print", action="store_true", help="print the tables, and leave the page as it is")
    parser.add_argument("--only", choices=sorted(TABLES), help="one of the tables")
    options = parser.parse_args()
    for name, rows in TABLES.items():
        if options.only not in (None, name):
            continue
        text = "\n".join(rows()) + "\n"
        if options.print:
            print(text)
            continue
        begin, end = f"<!-- begin of {name} -->\n", f"<!-- end of {name} -->"
        page = PAGE.read_text(encoding="utf-8")
        front, rest = page.split(begin)
        PAGE.write_text(front + begin + text + end + rest.split(end)[1], encoding="utf-8")


if __name__ == "__main__":
    main()
