"""Write the table of docs/qualifying.md: operations of each kernel, and the stack of its chain of calls, by gcc.

python docs/qualifying.py
"""

from __future__ import annotations

import json
import re
import subprocess
import tempfile
from functools import cache
from pathlib import Path

from eomgen.codegen.c.source import Source
from eomgen.pipeline.generating import package_options
from eomgen.pipeline.options import Options
from eomgen.pipeline.stages import make_source

PAGE = Path(__file__).with_name("qualifying.md")
BEGIN, END = "<!-- begin of kernels -->\n", "<!-- end of kernels -->"
ROBOTS = ("one_link", "puma560", "four_bar", "puma560_elastic")
FLAGS = ("-std=c99", "-O2", "-ffp-contract=off", "-fcallgraph-info=su")
INDIRECT = "__indirect_call"  # gcc's name for a call by a pointer
COUNTED = ("mul", "add", "div", "sincos")


def stacks(source: Source) -> dict[str, int]:
    """Return bytes of stack of each public function for one state, with all that it calls but the C library's."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        for name, text in source.files.items():
            (folder / name).parent.mkdir(exist_ok=True)
            (folder / name).write_text(text, encoding="ascii")
        subprocess.run(["gcc", *FLAGS, "-c", f"{source.name}.c", "-o", "code.o"], cwd=folder, check=True)
        (graph,) = folder.glob("*.ci")
        depths = chains(graph.read_text(encoding="utf-8"))
    return {name.removeprefix(f"{source.name}_"): size for name, size in depths.items() if ":" not in name}


def chains(graph: str) -> dict[str, int]:
    """Return, by functions of a call graph of gcc, the bytes of the deepest chain of calls that begins with them.

    A call by a pointer counts as one of the deepest function that calls none by a pointer itself.
    """
    frames = dict(
        re.findall(r'node: \{ title: "([^"]+)" label: "[^"]*?(\d+) bytes \((?:static|dynamic,bounded)\)', graph)
    )
    assert "bytes (dynamic)" not in graph, "a frame whose size is not known"
    calls: dict[str, set[str]] = {name: set() for name in frames}
    for caller, called in re.findall(r'edge: \{ sourcename: "([^"]+)" targetname: "([^"]+)"', graph):
        calls[caller].add(called)

    @cache
    def is_indirect(name: str) -> bool:
        return name == INDIRECT or any(is_indirect(x) for x in calls.get(name, ()))

    @cache
    def depth(name: str) -> int:
        if name == INDIRECT:
            return max(depth(x) for x in frames if not is_indirect(x))
        return int(frames.get(name, 0)) + max((depth(x) for x in calls.get(name, ())), default=0)

    return {name: depth(name) for name in frames}


def table(robot: str) -> str:
    """Write the rows of one robot."""
    source = make_source(robot, package_options(robot, Options(scalar=True)))
    meta, sizes = json.loads(source.meta), stacks(source)
    rows = []
    for name, function in meta["functions"].items():
        if name in sizes and not name.startswith("spring_"):
            counts = meta["operations"].get(function["kernel"], {})
            numbers = [str(counts[key]) if key in counts else "" for key in COUNTED]
            rows.append(f"| {robot} | `{name}` | {' | '.join(numbers)} | {sizes[name]} |")
    return "\n".join(rows)


def main() -> int:
    """Write the page."""
    version = subprocess.run(["gcc", "-dumpfullversion"], capture_output=True, text=True, check=True).stdout.strip()
    head = "| robot | function | mul | add | div | sincos | stack, bytes |\n|---|---|---:|---:|---:|---:|---:|"
    body = "\n".join(table(robot) for robot in ROBOTS)
    flags = " ".join(FLAGS[1:3])
    note = f"Counted by `python docs/qualifying.py`; stack by gcc {version} with `{flags}`, x86-64, `double`:"
    text = PAGE.read_text(encoding="utf-8")
    before, rest = text.split(BEGIN)
    PAGE.write_text(f"{before}{BEGIN}{note}\n\n{head}\n{body}\n{END}{rest.split(END)[1]}", encoding="utf-8")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
