"""Write the measurements of docs/wasm.md: WebAssembly under node beside native code on numbers, and sizes.

    python -m benchmarks.wasm [--turns TURNS] [--print]

Both have the same C and the same bits; native code is that of the lowest level of processors, one state a call, by the
compiler of the machine.  Turns are processes that follow each other, so that both see the same noise.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import eomgen
from eomgen.bench.beside import processor_name
from eomgen.bench.textbook import compile_yardstick
from eomgen.codegen.package.compile import FLAGS, find_compiler
from eomgen.errors import InternalError
from eomgen.export.wasm.pack import make_wasm
from eomgen.robot.model import build_model
from eomgen.runtime.levels import BASE

from .peers.contender import Contender
from .peers.measure import READS, SIZES, STATES, states, time

PAGE = Path(__file__).parents[1] / "docs" / "wasm.md"
BEGIN, END = "<!-- begin of ratios -->\n", "<!-- end of ratios -->"
ROBOTS = ("ur5", "puma560", "puma560_elastic")
KERNELS = ("inverse_dynamics", "forward_dynamics", "mass_matrix")
ROUNDS = 30

# The module's functions by addresses, as a page's loop would call them: median nanoseconds of a call, and results.
RUNNER = """
import { readFileSync } from "node:fs";
const { name, hoisted, kernels, rounds } = JSON.parse(readFileSync(0, "utf8"));
const module = await WebAssembly.compile(readFileSync(`./${name}.wasm`));
const c = (await WebAssembly.instantiate(module, {})).exports;
c.memory.grow(64);
let top = (c.__heap_base.value + 63) & ~63;
const put = (values) => {
  const at = top;
  new Float64Array(c.memory.buffer, at, values.length).set(values);
  top += 8 * values.length;
  return at;
};
const timings = {};
for (const { kernel, p, arrays, size } of kernels) {
  const h = put(new Array(hoisted).fill(0));
  c[`${name}_setup`](put(p), h);
  const rows = arrays.map((array) => array.map(put));
  const out = put(new Array(size).fill(0));
  const call = c[`${name}_${kernel}`];
  const states = rows[0].length;
  const [x, y, z] = rows;
  const one = rows.length === 1 ? (i) => call(h, x[i], out) : (i) => call(h, x[i], y[i], z[i], out);
  const results = [];
  for (let i = 0; i < states; ++i) {
    if (one(i) !== 0) throw new Error(`${kernel} fails in state ${i}`);
    results.push(...new Float64Array(c.memory.buffer, out, size));
  }
  const repeat = (count) => {
    const began = process.hrtime.bigint();
    for (let k = 0; k < count; ++k) for (let i = 0; i < states; ++i) one(i);
    return Number(process.hrtime.bigint() - began) / (count * states);
  };
  const count = Math.max(1, Math.round(2e6 / (repeat(20) * states)));
  repeat(count);
  const times = Array.from({ length: rounds }, () => repeat(count)).sort((x, y) => x - y);
  timings[kernel] = { ns: times[rounds >> 1], results };
}
console.log(JSON.stringify(timings));
"""


def under_node(robot: str, folder: Path, inputs: Mapping[str, NDArray[np.float64]]) -> dict[str, float]:
    """Return nanoseconds of a call by kernel, of the module in the folder.

    Raises:
        InternalError: it answers other bits than native code.
    """
    kernel = eomgen.build(robot, kernels=KERNELS, level=BASE)
    n, meta = kernel.n, json.loads((folder / "meta.json").read_text(encoding="ascii"))
    asked = [
        {
            "kernel": name,
            "p": list(kernel.parameters.values()),
            "arrays": [inputs[array].tolist() for array in READS[name]],
            "size": SIZES[name](n) if name in SIZES else n,
        }
        for name in KERNELS
    ]
    text = json.dumps({"name": robot, "hoisted": meta["hoisted"], "kernels": asked, "rounds": ROUNDS})
    command = ["node", "--input-type=module", "-e", RUNNER]
    answer = subprocess.run(command, input=text, capture_output=True, text=True, check=True, cwd=folder)
    timings = json.loads(answer.stdout)
    for name in KERNELS:
        expected = [getattr(kernel, name)(*rows) for rows in zip(*(inputs[x] for x in READS[name]), strict=True)]
        if not np.array_equal(np.ravel(timings[name]["results"]), np.ravel(expected)):
            raise InternalError(f"{robot}: {name} has other bits under node")
    return {name: timings[name]["ns"] for name in KERNELS}


def native(robot: str, inputs: Mapping[str, NDArray[np.float64]]) -> dict[str, float]:
    """Return nanoseconds of a call of native code by kernel, the loop in C."""
    kernel = eomgen.build(robot, kernels=KERNELS, level=BASE)
    stopwatch = compile_yardstick(build_model(eomgen.load_robot(robot)), FLAGS).stopwatch
    medians = {}
    for name in KERNELS:
        function, setup = kernel.raw.functions[name], kernel.parameters.setup
        address = kernel.raw.address(name, batch=False)
        one = Contender("native", address, setup.address(function.where(batch=False)), kept=(kernel, setup))
        size = SIZES[name](kernel.n) if name in SIZES else kernel.n
        ns = time(stopwatch, [one], [inputs[array] for array in READS[name]], size, ROUNDS)
        medians[name] = float(np.median(ns["native"]))
    return medians


def measured(robot: str, turns: int) -> tuple[list[dict[str, tuple[float, float]]], int]:
    """Return native and WebAssembly's nanoseconds by kernel, a row for each turn; and bytes of the module."""
    inputs = states(eomgen.load_robot(robot), STATES)
    with tempfile.TemporaryDirectory() as work:
        folder = Path(work)
        made = make_wasm(robot)
        made.write(folder)
        (folder / "meta.json").write_text(json.dumps({"hoisted": made.description["hoisted"]}), encoding="ascii")
        rows = []
        for _ in range(turns):
            ours, theirs = native(robot, inputs), under_node(robot, folder, inputs)
            rows.append({name: (ours[name], theirs[name]) for name in KERNELS})
    return rows, len(made.binary)


def table(measurements: Mapping[str, tuple[Sequence[Mapping[str, tuple[float, float]]], int]]) -> list[str]:
    """Return a row per robot and kernel."""
    lines = [
        "| robot | module, kB | kernel | native, ns | WebAssembly, ns | speed of native |",
        "|---|---:|---|---:|---:|---:|",
    ]
    for robot, (rows, size) in measurements.items():
        for name in KERNELS:
            pairs = np.array([row[name] for row in rows])
            ns, share = np.median(pairs, axis=0), float(np.median(pairs[:, 0] / pairs[:, 1]))
            lines.append(
                f"| {robot} | {size / 1000:.0f} | {name.replace('_', ' ')} | {ns[0]:.0f} | {ns[1]:.0f} | {share:.2f} |"
            )
    return lines


def report(turns: int) -> str:
    """Return the table, and what it was measured on."""
    version = subprocess.run(["node", "--version"], capture_output=True, text=True, check=True).stdout.strip()
    measurements = {}
    for robot in ROBOTS:
        measurements[robot] = measured(robot, turns)
        print(f"{robot}: {measurements[robot]}", file=sys.stderr, flush=True)
    lines = [
        f"Measured by `python -m benchmarks.wasm` on {processor_name()}, {find_compiler().version.splitlines()[0]},"
        f" node {version}: one state a call, medians of {turns} turns. Last: native time by that under node.",
        "",
        *table(measurements),
    ]
    return "\n".join(lines) + "\n"


def main() -> None:
    """Measure, and write the figures into the page or print them."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.wasm")
    parser.add_argument("--turns", type=int, default=7, help="of both, one after the other (7)")
    parser.add_argument("--print", action="store_true", help="print the table, write nothing")
    options = parser.parse_args()
    text = report(options.turns)
    if options.print:
        print(text, end="")
        return
    page = PAGE.read_text(encoding="utf-8")
    before, rest = page.split(BEGIN)
    PAGE.write_text(before + BEGIN + text + END + rest.split(END, 1)[1], encoding="utf-8")


if __name__ == "__main__":
    main()
