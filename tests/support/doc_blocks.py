"""The code blocks of a page of the documentation, and what running them prints.

What a language's block is for:
    python       run, all blocks of a page in one namespace
    console      lines that begin with "$ " are commands, run in the page's folder; other lines are what they print
    js           a module, run by node in the page's folder where node is installed
    toml         a robot, a scenario or a plan, loaded; a part of a robot is completed first
    text, c      what the block in front of it printed; C with a title is a file that other blocks compile
A block with a title is also written to the file of that name in the page's folder.
"""

from __future__ import annotations

import contextlib
import io
import re
import shlex
import shutil
import subprocess
import tomllib
from dataclasses import dataclass
from doctest import ELLIPSIS, NORMALIZE_WHITESPACE, OutputChecker
from pathlib import Path
from typing import Any

from eomgen.cli import entry as cli
from eomgen.description.load import robot_from_toml
from eomgen.scenario.load import scenario_from_toml
from eomgen.sweep.plan import plan_from_toml

WITHOUT_NODE = "node is not installed"
DATA = ("csv", "xml")  # files that other blocks read
_FENCE = re.compile(r'^```(\w*)(?: title="([^"]+)")?$\n(.*?)^```$', re.DOTALL | re.MULTILINE)


@dataclass(frozen=True)
class Block:
    """A fenced block: ``line`` is that of its fence."""

    language: str
    title: str | None
    text: str
    line: int


def blocks_of(page: str) -> list[Block]:
    """All fenced blocks; AssertionError if a fence is not understood."""
    found = [Block(m[1], m[2], m[3], page[: m.start()].count("\n") + 1) for m in _FENCE.finditer(page)]
    fences = len(re.findall(r"^\s*(```|~~~)", page, re.MULTILINE))
    assert fences == 2 * len(found), "a fence with an indent, with unknown words behind it, or without an end"
    return found


def run_page(page: Path, folder: Path) -> int:
    """Run all blocks in the folder, which is the current one; returns how many there were."""
    namespace: dict[str, Any] = {"__name__": "__main__"}
    printed: str | None = None
    blocks = blocks_of(page.read_text(encoding="utf-8"))
    for block in blocks:
        where = f"{page.name}:{block.line}"
        if block.title:
            (folder / block.title).parent.mkdir(parents=True, exist_ok=True)
            (folder / block.title).write_text(block.text, encoding="utf-8")
        if block.language == "python":
            printed = run_python(block.text, namespace, where)
        elif block.language == "console":
            printed = run_commands(block.text, where)
        elif block.language == "js":
            printed = run_module(block.text, where)
        elif block.language == "toml":
            load(block.text, folder, where)
        elif block.language == "text" and printed == WITHOUT_NODE:
            continue
        elif block.language in ("text", "c") and not (block.language == "c" and block.title):
            assert printed is not None, f"{where}: nothing was printed in front of it"
            compare(block.text, printed, where)
        else:
            assert block.language in (*DATA, "c"), f"{where}: a block of {block.language or 'no language'}"
            assert block.title, f"{where}: a file without a title"
    return len(blocks)


def run_python(code: str, namespace: dict[str, Any], where: str) -> str:
    """What the code prints."""
    out = io.StringIO()
    with contextlib.redirect_stdout(out):
        exec(compile(code, where, "exec"), namespace)
    return out.getvalue()


def run_module(code: str, where: str) -> str:
    """What a module of JavaScript prints under node, in the current folder."""
    node = shutil.which("node")
    if node is None:
        return WITHOUT_NODE
    command = [node, "--input-type=module", "-e", code]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    assert result.returncode == 0, f"{where}: {result.stderr}"
    return result.stdout


def run_commands(text: str, where: str) -> str:
    """What the last command prints; where output stands below a command, it is compared."""
    printed = ""
    for part in re.split(r"^\$ ", text, flags=re.MULTILINE)[1:]:
        command, _, wanted = part.partition("\n")
        words = shlex.split(command, comments=True)
        assert words[0] == "eomgen", f"{where}: {command}"
        out = io.StringIO()
        with contextlib.redirect_stdout(out):
            status = cli.main(words[1:])
        assert status == 0, f"{where}: {command} ends with status {status}"
        printed = out.getvalue()
        if wanted.strip():
            compare(wanted, printed, where)
    assert text.startswith("$ "), f"{where}: no command"
    return printed


def compare(wanted: str, printed: str, where: str) -> None:
    """AssertionError if they differ in more than spaces; "..." stands for anything."""
    checker, options = OutputChecker(), ELLIPSIS | NORMALIZE_WHITESPACE
    assert checker.check_output(wanted, printed, options), f"{where}: printed is\n{printed}"


def load(text: str, folder: Path, where: str) -> None:
    """Load a robot, a scenario or a plan."""
    values = tomllib.loads(text)
    if "duration" in values:
        scenario_from_toml(text, source=where, folder=folder)
    elif "vary" in values:
        plan_from_toml(text, source=where)
    else:
        robot_from_toml(completed(text, values), source=where, folder=folder)


def completed(text: str, values: dict[str, Any]) -> str:
    """A part of a description with the name, the links and the joints that it lacks."""
    if "name" in values or "urdf" in values:
        return text
    joints = [*values.get("joints", []), *values.get("beams", [])]
    named = [
        link for key in ("springs", "bushings", "loops") for entry in values.get(key, []) for link in entry["links"]
    ]
    named += [joint[key] for joint in joints for key in ("parent", "child")]
    links = [name for name in dict.fromkeys(named) if name != "base" and name not in values.get("links", [])]
    carried = {joint["child"] for joint in joints}
    text = f'name = "part"\n{text}'
    for name in links:
        text += f'\n[[links]]\nname = "{name}"\nmass = 1.0\n'
        if name not in carried:
            text += f'[[joints]]\nname = "to_{name}"\nparent = "base"\nchild = "{name}"\ntype = "free"\n'
    for joint, kind in sorted(coordinates(values)):
        of_type = "prismatic" if kind == "z" else "revolute"
        text += f'\n[[links]]\nname = "of_{joint}"\nmass = 1.0\n'
        text += f'[[joints]]\nname = "{joint}"\nparent = "base"\nchild = "of_{joint}"\ntype = "{of_type}"\n'
    return text


def coordinates(values: dict[str, Any]) -> set[tuple[str, str]]:
    """Joints and coordinates that drives, home and couplings name."""
    tables = [values.get("home", {}), *(entry["to"] for entry in values.get("couplings", []))]
    names = [*values.get("driven", []), *(entry["of"] for entry in values.get("couplings", []))]
    for table in tables:
        for name, inner in table.items():
            names += [f"{name}.{kind}" for kind in inner] if isinstance(inner, dict) else [name]
    return {(joint, kind) for joint, _, kind in (name.partition(".") for name in names)}
