"""MJCF through MuJoCo's compiler, for what the reader here leaves to it: includes, copies, inertias of meshes.

A separate process compiles (``mjcf.compiling``), within limits: a crash of MuJoCo's C++ on a foreign file ends that
process alone.
"""

from __future__ import annotations

import importlib.util
import json
import os
import signal
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, SubElement

from eomgen.errors import DescriptionError
from eomgen.optional import NotInstalledError, optional_import

from ..xml_text import Xml
from .other_files import check_other_files

SECONDS, GIBIBYTES = 60, 4  # of processor time, and of address space, of which threads reserve some

_ALLOWED = "a model that MuJoCo compiles, with all files that it names"
_MOST_WARNINGS = 5
_BEGIN = (
    "import sys; sys.path[:] = sys.argv[4:]; from eomgen.description.mjcf.compiling import main; main(*sys.argv[1:4])"
)


@dataclass(frozen=True)
class Compiled:
    """A file as MuJoCo compiles it: the root of plain MJCF, the version of MuJoCo, and its warnings."""

    root: Element
    version: str
    warnings: tuple[str, ...]


def compiled_model(path: Path, refusal: DescriptionError, xml: Xml) -> Compiled:
    """Compile a model by MuJoCo and return it as plain MJCF: bodies with their inertias, joints, sites.

    Args:
        path: the file.
        refusal: the error of the reader here.
        xml: the file's elements.

    Raises:
        DescriptionError: MuJoCo is not installed, or does not take the file either, or not within the limits of time
            and memory; with MuJoCo's message.
    """
    try:
        _check_installed()
    except NotInstalledError as missing:
        raise DescriptionError(f"{refusal.message}; or {missing}", where=refusal.where, source=refusal.source) from None
    check_other_files(path, xml)
    answer = _answer_of_child(path)
    if "said" in answer:
        text = f"{_compiler(answer)} says: {answer['said']}"
    elif "rows" not in answer:
        text = f"{_compiler(answer)} {answer['ended']}"
    else:
        return Compiled(_root(answer["rows"]), answer["version"], _as_notes(answer["warnings"]))
    raise DescriptionError(f"{text}; allowed: {_ALLOWED}", where=refusal.where, source=refusal.source)


def _check_installed() -> None:
    with optional_import("MuJoCo", "it is read through"):
        if importlib.util.find_spec("mujoco") is None:
            raise ModuleNotFoundError("mujoco")


def _compiler(answer: dict[str, Any]) -> str:
    return f"MuJoCo {answer['version']}, which is to compile the file," if "version" in answer else "MuJoCo"


def _answer_of_child(path: Path) -> dict[str, Any]:
    """Compile a file in a separate process; return its answer, or how it ended."""
    paths = [os.path.abspath(each) for each in sys.path]  # it works in a temporary folder: MuJoCo writes logs
    command = [sys.executable or "", "-c", _BEGIN, str(path.resolve()), str(SECONDS), str(GIBIBYTES), *paths]
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}  # each reserves memory
    with tempfile.TemporaryDirectory(prefix="eomgen-mjcf-") as folder:
        try:
            child = subprocess.run(
                command,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                cwd=folder,
                env=environment,
                timeout=3 * SECONDS,
            )
        except subprocess.TimeoutExpired:
            return {"ended": f"took more than {3 * SECONDS} s to compile the file"}
        except OSError as error:
            return {"ended": f"cannot be started in a separate process ({error.strerror or error})"}
    try:
        answer: dict[str, Any] = json.loads(child.stdout)
    except ValueError:  # it ended before it could say anything
        return {"ended": _ending(child.returncode)}
    return answer


def _ending(status: int) -> str:
    """Say how a process without an answer ended."""
    limits = f"allowed to it: {SECONDS} s and {GIBIBYTES} GiB"
    if status < 0:
        names = {each.value: each.name for each in signal.Signals}
        return f"was ended by {names.get(-status, f'signal {-status}')} while it compiled the file ({limits})"
    return f"ended with status {status} while it compiled the file ({limits})"


def _as_notes(warnings: list[str]) -> tuple[str, ...]:
    """Return MuJoCo's warnings as notes, each once, and how many more there are."""
    different = list(dict.fromkeys(warnings))
    notes = [f"MuJoCo warns: {text}" for text in different[:_MOST_WARNINGS]]
    if len(different) > _MOST_WARNINGS:
        notes.append(f"MuJoCo gives {len(different) - _MOST_WARNINGS} more warnings")
    return tuple(notes)


def _root(rows: list[tuple[int, str, dict[str, str]]]) -> Element:
    """Return the element of the first row, with all others in it: index of the parent's row, tag, attributes."""
    made: list[Element] = []
    for parent, tag, attributes in rows:
        made.append(SubElement(made[parent], tag, attributes) if made else Element(tag, attributes))
    return made[0]
