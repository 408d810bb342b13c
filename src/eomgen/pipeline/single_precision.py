"""Notes of a package in single precision: what that costs the robot, in its metadata and in its header."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace

from ..codegen.kernels.signatures import KERNELS, available
from ..progress import StageReport
from ..robot.model import build_model
from ..robot.value import Robot
from ..rounding.advice import ADVISED, float32_advice
from ..rounding.advice_result import Float32Advice
from ..rounding.bounds import NO_RANGES, Ranges

Files = Mapping[str, bytes]
MOST = 48  # coordinates: bounds of larger mass matrices, of thousands of numbers, take longer than the compiler
TOO_LARGE = f"of more than {MOST} coordinates; eomgen check --float32 --kernels mass_matrix bounds it"


def with_notes(
    robot: Robot,
    kernels: tuple[str, ...],
    files: Files,
    progress: StageReport,
    *,
    ranges: Ranges = NO_RANGES,
    within: float | None = None,
) -> Files:
    """Return the files of a package with notes of what single precision costs.

    The metadata gains "float32": by kernel the worst output with its error, unit, size and what that comes from; the
    header a line for each kernel in its first comment.

    Args:
        robot: the package's.
        kernels: that it has; all that come without a request if empty.
        files: of the package, by their places.
        progress: called with a line of text when a kernel's turn comes.
        ranges, within: as of ``float32_advice``.
    """
    model = build_model(robot)
    known = available(model)
    there = kernels or tuple(name for name in known if not KERNELS[name].by_request)
    wanted = tuple(name for name in ADVISED if name in there and name in known)
    large = {name: TOO_LARGE for name in wanted if name == "mass_matrix" and model.size > MOST}
    advised = tuple(name for name in wanted if name not in large)
    if not advised:
        return files
    advice = float32_advice(robot, advised, ranges, within=within, progress=progress)
    advice = replace(advice, left_out={**advice.left_out, **large})
    header, meta = f"{robot.name}.h", f"{robot.name}.json"
    values = json.loads(files[meta])
    values["float32"] = {name: errors.facts_of_worst() for name, errors in advice.kernels.items()}
    values["float32"] |= {name: {"left_out": reason} for name, reason in advice.left_out.items()}
    return {
        **files,
        header: _in_header(files[header].decode("ascii"), advice).encode("ascii"),
        meta: (json.dumps(values, indent=1) + "\n").encode("ascii"),
    }


def _in_header(header: str, advice: Float32Advice) -> str:
    """Write a line for each kernel into the first comment of a C header."""
    lines = ["", "Errors of single precision, as eomgen check --float32 says:", *advice.summary_lines()]
    end = header.index("\n */\n")
    return header[:end] + "".join(f"\n * {line}".rstrip() for line in lines) + header[end:]
