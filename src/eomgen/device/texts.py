"""Function of a robot -> its text for accelerators, and what is to be known of it."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from .._version import __version__
from ..pipeline import cache as store
from ..pipeline.derivations import derived_model
from ..pipeline.generator_key import generator_hash
from ..robot.record import robot_hash
from ..robot.value import Robot

KIND = "devices"  # of entries of the cache: texts, and what compilers of devices make of them
CODE, META = "text.h", "text.json"


@dataclass(frozen=True)
class FunctionText:
    """The text of one function, with transposes and the search for what is wrong beside it.

    code: in the language that is CUDA, HIP, OpenCL C and C++.
    meta: what ``eomgen.export_simt`` writes as JSON.
    """

    name: str
    code: str
    meta: Mapping[str, Any]

    @property
    def tile(self) -> int:
        """States of a tile."""
        return int(self.meta["tile"])

    @property
    def about(self) -> Mapping[str, Any]:
        """Description of the function: what it reads and writes."""
        found: Mapping[str, Any] = self.meta["kernels"][self.name]
        return found

    def shapes(self, which: str) -> dict[str, tuple[int, ...]]:
        """Return shapes of one state's arrays that are read ("reads") or written ("writes")."""
        return {array: tuple(shape) for array, shape in self.about[which].items()}

    def beside(self, name: str) -> str:
        """Name a function of the text that stands around: "begin", "end", "find"."""
        return f"{self.meta['name']}_{name}"

    def reasons(self, status: int) -> str:
        """Say what the bits of a status mean, but for those of pivots."""
        bits = self.meta["status"]
        texts = {
            "violation": "loops are open",
            "violation_rate": "loops are opening",
            "far": f"an angle is farther than {self.meta['farthest']:g} rad; allowed: angles up to there",
        }
        return "; ".join(text for name, text in texts.items() if status >> bits[name] & 1)

    def vanished(self, status: int) -> list[str]:
        """Return names of the coordinates whose pivots vanish by a status."""
        pivots = self.meta["status"]["pivots"]
        return [name for place, name in enumerate(self.meta["coordinates"]) if status >> place % pivots & 1]


def text_of(robot: Robot, name: str, dtype: str) -> FunctionText:
    """Return the text of a function, from the cache where it is there.

    Raises:
        UnknownNameError, InputError: there is no such function, or none of straight statements.
        BuildError: the cache cannot be written.
    """
    key = hashlib.sha256(json.dumps([robot_hash(robot), name, dtype, __version__, generator_hash()]).encode())

    def make(folder: Path) -> None:
        code, meta = _rendered(robot, name, dtype)
        store.write_files(folder, {CODE: code.encode("ascii"), META: meta.encode("ascii")})

    files = store.entry(KIND, key.hexdigest(), make).files
    return FunctionText(name, files[CODE].decode("ascii"), json.loads(files[META]))


def _rendered(robot: Robot, name: str, dtype: str) -> tuple[str, str]:
    """Return the text of a function, and its JSON."""
    from ..codegen.c.source import environment
    from ..codegen.simt.sources import render_simt

    source = render_simt(derived_model(robot), (name,), dtype)
    about = json.loads(source.meta)["kernels"][name]
    reads, writes = ({x: math.prod(shape) for x, shape in about[which].items()} for which in ("reads", "writes"))
    template = environment().get_template("simt/watch.h.jinja")
    beside = template.render(name=source.name, reads=reads, writes=writes, arrays={**reads, **writes})
    return f"{source.code}\n{beside}", source.meta
