"""Models of MuJoCo as its compiler leaves them.

A separate process compiles (``mjcf.compiling``), within limits: a crash of MuJoCo's C++ on a foreign file ends that
process alone.
"""

from __future__ import annotations

import importlib.util
import json
import os
import re
import signal
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from eomgen.errors import DescriptionError
from eomgen.limits import LARGEST
from eomgen.names import show
from eomgen.optional import optional_import

from ..xml_text import one_line
from .copies import check_copies, refusal
from .poses import Array, Pose, rotation_from_quaternion

SECONDS = 10  # of processor time: three times that of 5,000 bodies
GIBIBYTES = 2  # of address space, of which threads reserve some
WALL_SECONDS = 60  # for one that waits, or gets a tenth of a processor

_ALLOWED = "a model that MuJoCo compiles, with all files that it names"
_MOST_WARNINGS = 5
_NAN = re.compile(r"\b(?!name\b)(\w+)\s*=\s*([\"'])([^\"']*?[+-]?\bnan\b[^\"']*)\2", re.ASCII | re.IGNORECASE)
_LINE = re.compile(r"\bline(?: number=)? ?(\d+)", re.IGNORECASE)  # in what MuJoCo says
_QUOTED = re.compile(r"'([^'\s]+)'")
_BEGIN = (
    "import sys; sys.path[:] = sys.argv[4:]; from eomgen.description.mjcf.compiling import main; main(*sys.argv[1:4])"
)
_FLAGS = {"stiffness": "mjDSBL_SPRING", "damping": "mjDSBL_DAMPER"}
_KIND_OF = {"jnt": "joint", "eq": "equality"}  # of arrays of mjModel; others begin with it
_ADDRESSES = {"dof": "jnt_dofadr", "qpos0": "jnt_qposadr", "qpos": "jnt_qposadr"}  # of joints, in such arrays


@dataclass(frozen=True)
class Model:
    """A compiled model.

    Attributes:
        source: the file's name, for messages.
        notes: attributes that MuJoCo ignores, and its warnings.
        name: of the model.
        arrays: of mjModel by their names.
        words: arrays of mjModel that hold an enumeration, such as jnt_type: "hinge".
        option: gravity (m/s^2), density, viscosity.
        disabled: flags that are off, such as "mjDSBL_SPRING".
        names: by kind, such as "body", of each element; empty where it has none.
        lines: by kind, of each element in the text; None where it is not known.
        explicit: bodies whose inertia is that of an <inertial>.
        degrees: hinges whose range is in degrees.
        aligned: bodies whose frames ``align`` or ``alignfree`` has moved.
        fused: names of bodies that ``fusestatic`` has joined with their parents.
    """

    source: str
    notes: tuple[str, ...]
    name: str
    arrays: Mapping[str, Array]
    words: Mapping[str, Sequence[str]]
    option: Mapping[str, Any]
    disabled: frozenset[str]
    names: Mapping[str, Sequence[str]]
    lines: Mapping[str, Sequence[int | None]]
    explicit: frozenset[int]
    degrees: frozenset[int]
    aligned: frozenset[int]
    fused: Sequence[str]

    def __getitem__(self, key: str) -> Array:
        return self.arrays[key]

    def count(self, kind: str) -> int:
        """Return the number of elements of a kind."""
        return len(self.names[kind])

    def pose(self, prefix: str, index: int) -> Pose:
        """Return the pose of a body or site in its parent or body, or of an inertia ("body_i") in its body."""
        return Pose(rotation_from_quaternion(self[f"{prefix}quat"][index]), self[f"{prefix}pos"][index])

    def numbers(self, key: str, index: int) -> list[float]:
        """Return an element's numbers; of a coefficient that those of higher powers follow, where this MuJoCo has them.

        Numbers of newer versions of MuJoCo are [0.0] in others.
        """
        rows = [self.arrays[name][index] for name in (key, f"{key}poly") if name in self.arrays]
        return [float(x) for row in rows for x in np.atleast_1d(row)] or [0.0]

    def law(self, kind: str, index: int, array: str, at: int, cubic: bool = True) -> tuple[float, float]:
        """Return the linear and the cubic coefficient of an element's stiffness or damping; 0 where its flag is off.

        ``array``, such as "dof_damping", has them at ``at``.  Others, or those below 0, are refused.
        """
        key, numbers = array.partition("_")[2], self.numbers(array, at)
        first, second, third = (*numbers, 0.0, 0.0)[:3]
        if second or min(numbers) < 0.0 or (third and not cubic):
            allowed = "a linear and a cubic term that are" if cubic else "a linear term that is"
            self.fail(kind, index, f"{key} is {text_of(numbers)}; allowed: {allowed} at least 0")
        return (0.0, 0.0) if _FLAGS[key] in self.disabled else (first, third)

    def fail(self, kind: str, index: int, message: str) -> NoReturn:
        """Raise the DescriptionError of an element."""
        name = self.names[kind][index]
        where = f"{kind} {show(name)}" if name else f"{kind} number {index + 1}"
        raise refusal(message, self.source, self.lines[kind][index], where)

    def check_numbers(self) -> None:
        """Raise DescriptionError if a number is not finite, or too large to compute with."""
        for key, values in self.arrays.items():
            rows = (~(np.abs(values) <= LARGEST)).reshape(len(values), values[0].size if len(values) else 0).any(axis=1)
            if rows.any():
                index, kind = int(rows.argmax()), key.partition("_")[0]
                row = np.atleast_1d(values[index])
                value = row[~(np.abs(row) <= LARGEST)][0]
                if kind in _ADDRESSES:
                    kind, index = "jnt", int(np.searchsorted(self[_ADDRESSES[kind]], index, side="right")) - 1
                message = f"{key} is {value:g}; allowed: finite numbers of magnitude up to {LARGEST:g}"
                kind = _KIND_OF.get(kind, kind)
                if kind in self.names and index < len(self.names[kind]):
                    self.fail(kind, index, message)
                raise DescriptionError(message, source=self.source)


def text_of(numbers: Sequence[float]) -> str:
    """Return numbers as MJCF has them, without trailing zeros."""
    count = max((place for place, number in enumerate(numbers, 1) if number), default=1)
    return show(" ".join(f"{number:g}" for number in numbers[:count]))


def compiled_model(text: str, source: str, folder: Path | None) -> Model:
    """Compile a text of MJCF with MuJoCo.

    Args:
        text: the XML.
        source: its name, for messages.
        folder: where files that it names are; None: it may open none.

    Raises:
        NotInstalledError: MuJoCo is not installed.
        DescriptionError: MuJoCo does not take the text, or not within the limits of time and memory; with its message.
    """
    with optional_import("MuJoCo", "models of MuJoCo (MJCF) are read through"):
        if importlib.util.find_spec("mujoco") is None:
            raise ModuleNotFoundError("mujoco")
    notes = check_copies(text, source, folder)
    answer = _answer_of_child(text, folder)
    if any("NaN" in warning for warning in answer.get("warnings", ())):
        raise _not_a_number(text, source)
    if "model" not in answer:
        raise _refused(answer, text, source)
    found = answer["model"]
    attached = "<attach" in text  # lines of elements are those of other files, too
    found["lines"] = {
        kind: _lines(infos, len(found["names"][kind]), attached) for kind, infos in found["lines"].items()
    }
    found["arrays"] = {key: np.array(rows, dtype=float) for key, rows in found["arrays"].items()}
    found |= {key: frozenset(found[key]) for key in ("disabled", "explicit", "degrees", "aligned")}
    model = Model(source, (*notes, *_as_notes(answer["warnings"])), **found)
    model.check_numbers()
    return model


def _answer_of_child(text: str, folder: Path | None) -> dict[str, Any]:
    """Compile a text in a separate process; return its answer, or how it ended."""
    paths = [os.path.abspath(each) for each in sys.path]  # it works in another folder
    place = "" if folder is None else str(folder.resolve())
    command = [sys.executable or "", "-c", _BEGIN, place, str(SECONDS), str(GIBIBYTES), *paths]
    threads = dict.fromkeys(
        ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MALLOC_ARENA_MAX"), "1"
    )  # each reserves memory
    environment = {**os.environ, **threads}
    with tempfile.TemporaryDirectory(prefix="eomgen-mjcf-") as empty:
        try:
            child = subprocess.run(
                command,
                input=text.encode(errors="replace"),
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                cwd=empty,
                env=environment,
                timeout=WALL_SECONDS,
            )
        except subprocess.TimeoutExpired:
            return {"ended": f"took more than {WALL_SECONDS} s to compile the file"}
        except OSError as error:
            return {"ended": f"cannot be started in a separate process ({error.strerror or error})"}
    try:
        answer: dict[str, Any] = json.loads(child.stdout)
    except ValueError:  # it ended before it could say anything
        return {"ended": _ending(child.returncode)}
    return answer


def _ending(status: int) -> str:
    """Say how a process without an answer ended."""
    limits = f"limits: {SECONDS} s and {GIBIBYTES} GiB"
    if status < 0:
        names = {each.value: each.name for each in signal.Signals}
        return f"was ended by {names.get(-status, f'signal {-status}')} while it compiled the file ({limits})"
    return f"ended with status {status} while it compiled the file ({limits})"


def _refused(answer: dict[str, Any], text: str, source: str) -> DescriptionError:
    """Return the error of a text that is not read."""
    if "refused" in answer:
        return refusal(one_line(answer["refused"]), source, _line_of(answer["refused"], text))
    said = str(answer.get("said", ""))
    message = f"MuJoCo {answer.get('version', '')} says: {one_line(said)}" if said else f"MuJoCo {answer['ended']}"
    return refusal(f"{message}; allowed: {_ALLOWED}", source, _line_of(said, text))


def _line_of(said: str, text: str) -> int:
    """Return the line that a message names, or in which a name of it stands first, or of the model's first element."""
    if (found := _LINE.search(said)) and int(found[1]):
        return int(found[1])
    return next((line for name in _QUOTED.findall(said) if (line := line_with(name, text))), line_with("", text) or 1)


def line_with(words: str, text: str) -> int | None:
    """Return the line of a text in which words stand first, without them that of its first element; None: nowhere."""
    at = text.find(words or "<mujoco")
    return None if at < 0 else text.count("\n", 0, at) + 1


def _not_a_number(text: str, source: str) -> DescriptionError:
    """Return the error of a text with NaN among its numbers, which MuJoCo takes for a missing number."""
    found = _NAN.search(text)
    key, value = (found[1], show(found[3])) if found else ("a number", "nan, in a file that it names")
    line = text.count("\n", 0, found.start()) + 1 if found else line_with("", text)
    return refusal(f"{key} is {value}; allowed: finite numbers, or no such attribute", source, line)


def _lines(infos: Mapping[str, str], count: int, attached: bool) -> list[int | None]:
    """Return the lines of elements by their ids; None for those of other files, which MuJoCo calls line 0."""
    found = {int(index): _LINE.search(info) for index, info in infos.items()}
    numbers = [int(match[1]) if (match := found.get(index)) else 0 for index in range(count)]
    return [None if attached else number or None for number in numbers]


def _as_notes(warnings: list[str]) -> tuple[str, ...]:
    """Return MuJoCo's warnings as notes, each once, and how many more there are."""
    different = list(dict.fromkeys(map(one_line, warnings)))
    notes = [f"MuJoCo warns: {text}" for text in different[:_MOST_WARNINGS]]
    if len(different) > _MOST_WARNINGS:
        notes.append(f"MuJoCo gives {len(different) - _MOST_WARNINGS} more warnings")
    return tuple(notes)
