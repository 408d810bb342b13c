"""A robot's kernel as WebAssembly: the module, an ES module that calls it, and TypeScript's declarations of that."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from operator import methodcaller
from pathlib import Path
from typing import Any

from eomgen._version import __version__
from eomgen.codegen.c.scalar_types import SCALARS
from eomgen.codegen.c.source import Source, environment
from eomgen.codegen.kernels.interface import turning_joints
from eomgen.codegen.kernels.signatures import functions, signatures_of, with_beside
from eomgen.codegen.package.compile import LONG
from eomgen.description import RobotLike, as_robot
from eomgen.errors import InputError
from eomgen.files import as_path, write_atomically
from eomgen.kernel.stepping.methods import ADAPTIVE
from eomgen.kernel.stepping.options import LEAST, ROLLOUTS, rollout_of
from eomgen.pipeline.mechanisms import assembled_home
from eomgen.pipeline.options import Options
from eomgen.pipeline.stages import make_source
from eomgen.progress import StageReport, no_report, tells_at_prompt
from eomgen.robot.model import Model, build_model
from eomgen.robot.value import Robot
from eomgen.runtime.parameter_conditions import FADING
from eomgen.runtime.rollouts import FIXED

from ...codegen.kernels.groups import INVERSE_DYNAMICS, WEBASSEMBLY, kernel_group
from .compile import compile_wasm, wasm_command
from .layout import checked_places, struct_table

_SAID = (  # of a kernel's metadata, to those who call it
    *("name", "generator", "dtype", "coordinates", "joints", "links", "frames", "driven", "prescribed", "parameters"),
    *("least", "shapes", "functions", "hoisted"),
)
_ROLLING = ("rollout", "adaptive")  # kinds of functions that the script does not call as they are


@dataclass(frozen=True)
class WasmModule:
    """A kernel as WebAssembly, not yet written.

    Attributes:
        name: the robot's.
        binary: the module.
        script: text of the ES module that calls it; looks for NAME.wasm beside itself.
        declarations: text of TypeScript's declarations of the script.
        description: plain values that the script has as ``description``.
    """

    name: str
    binary: bytes
    script: str
    declarations: str
    description: Mapping[str, Any]

    def write(self, folder: Path | str) -> list[Path]:
        """Write NAME.wasm, NAME.mjs and NAME.d.mts, and return their paths; InputError if they cannot be."""
        contents = {
            f"{self.name}.wasm": self.binary,
            f"{self.name}.mjs": self.script.encode("ascii"),
            f"{self.name}.d.mts": self.declarations.encode("ascii"),
        }
        return [
            write_atomically(Path(folder) / file, methodcaller("write", x), read=None) for file, x in contents.items()
        ]


@tells_at_prompt("exporting")
def export_wasm(
    robot: RobotLike,
    folder: Path | str,
    *,
    kernels: Sequence[str] = (),
    dtype: str = "float64",
    model: bool = False,
    progress: StageReport = no_report,
) -> list[Path]:
    """Write NAME.wasm, NAME.mjs and NAME.d.mts into a folder, and return their paths.

    The module has no imports, and computes the bits of a kernel that is not ``native``.

    Args:
        robot: a Robot, the name of a built-in one, or the path of a description.
        folder: is made if it is not there.
        kernels: names of KERNEL_NAMES; by default dynamics, kinematics, energy, reactions and rollouts.
        dtype: "float64" or "float32", of all arrays.
        model: with the inverse dynamics of the rigid robot, for loads whose drives know it; of robots without loops.
        progress: called with a line of text when a stage begins.

    Raises:
        InputError: a kernel is unknown or not for JavaScript, a dtype is unknown, a model has loops, or the folder
            cannot be written.
        LoopError: the loops do not close near the description's home.
        BuildError: no compiler for WebAssembly, or one that fails.
    """
    folder = as_path(folder, "folder")
    return make_wasm(robot, kernels=kernels, dtype=dtype, model=model, progress=progress).write(folder)


def make_wasm(
    robot: RobotLike,
    *,
    kernels: Sequence[str] = (),
    dtype: str = "float64",
    model: bool = False,
    progress: StageReport = no_report,
) -> WasmModule:
    """Return the module and its texts; arguments and errors as of ``export_wasm``."""
    robot = as_robot(robot)
    wasm_command()  # before longer work
    described_model = build_model(robot)
    chosen = Options(tuple(kernels), dtype).kernels or kernel_group(described_model, WEBASSEMBLY)
    for method, kernel in ROLLOUTS.items():
        if kernel in chosen:
            named = ", ".join(name for name in (*FIXED, *ADAPTIVE) if name != method)
            raise InputError(f"kernels: {kernel} is not called from JavaScript; allowed: rollouts by {named}")
    source = make_source(robot, Options(with_beside(chosen, described_model), dtype, batches=False), progress)
    rigid = _rigid(robot, progress) if model else None
    meta = json.loads(source.meta)
    context = _context(described_model, meta, rigid)
    home = assembled_home(robot, progress)
    described = _description(meta, context["pushed"], home, None if rigid is None else json.loads(rigid.meta))
    progress(f"compiling {source.statements} statements of C")
    exported = ["setup", *(name for name, function in meta["functions"].items() if function["kind"] not in _ROLLING)]
    binary = compile_wasm(
        _sources(source, rigid, context), [f"{robot.name}_{x}" for x in exported], long=source.longest > LONG
    )
    adaptive = [name for name in ADAPTIVE if name not in ROLLOUTS]  # others have kernels of their own
    declared = _declared(described_model, meta)
    script = {
        "description": json.dumps(described, allow_nan=False),
        **context,
        **declared,
        "numbers": json.dumps(FIXED | {name: ADAPTIVE[name] for name in adaptive}),
        "fixed": json.dumps(list(FIXED)),
        "adaptive": json.dumps(adaptive),
    }
    return WasmModule(
        robot.name,
        binary,
        _filled("wasm/kernel.mjs.jinja", script),
        _filled("wasm/kernel.d.mts.jinja", {**context, **declared}),
        described,
    )


def _rigid(robot: Robot, progress: StageReport) -> Source:
    """Return inverse dynamics of the rigid robot, in double precision, with function names that differ."""
    rigid = replace(robot.rigid(), name=f"{robot.name}_rigid")
    if build_model(rigid).constraints:
        raise InputError(
            f"model: {robot.name} has loops or couplings; allowed: robots without, whose drives can ask it"
        )
    return make_source(rigid, Options(INVERSE_DYNAMICS, batches=False), progress)


def _sources(source: Source, rigid: Source | None, context: Mapping[str, Any]) -> dict[str, str]:
    """Return files of C by name: of the robot, of the rigid model of its drives, and what JavaScript calls."""
    files = {place: text for x in (source, rigid) if x for place, text in x.files.items()}
    return {**files, f"{source.name}_wasm.c": _filled("wasm/calls.c.jinja", context)}


def _context(model: Model, meta: Mapping[str, Any], rigid: Source | None) -> dict[str, Any]:
    """Return names that the templates use."""
    kinds = {function["kind"] for function in meta["functions"].values()}
    return {
        "name": model.name,
        "version": __version__,
        "real": SCALARS[meta["dtype"]].name,
        "n": len(model.coordinates),
        "states": len(model.internal_states),
        "drives": len(model.drives),
        "rolls": "rollout" in kinds,
        "adapts": "adaptive" in kinds,
        "places": checked_places(meta["dtype"]) if "adaptive" in kinds else [],
        "structs": struct_table(meta["dtype"]) if "adaptive" in kinds else "{}",
        "model": rigid.name if rigid else "",
        "coupled": "matrices" in meta,
        "fading": any("fades" in condition for condition in meta.get("conditions", ())),
        "fading_allowed": FADING,
        "pushed": "frames" in kinds and any(_pushes(function) for function in meta["functions"].values()),
        "turning": bool(meta.get("turning")),
        "turned_size": turning_joints(model)["room"],
    }


def _pushes(function: Mapping[str, Any]) -> bool:
    """Return whether a function computes the generalized forces of wrenches on links."""
    return "wrench" in function["reads"] and function["writes"] == "vector"


def _description(
    meta: Mapping[str, Any], pushed: bool, home: Sequence[float], rigid: Mapping[str, Any] | None
) -> dict[str, Any]:
    """Return plain values that the script says of the kernel, and reads itself."""
    return {
        **{name: meta[name] for name in _SAID},
        "internal_states": meta.get("internal_states", []),
        "inputs": {
            name: {"meaning": meaning, "unit": unit, "force": place}
            for name, (meaning, unit, place) in meta.get("inputs", {}).items()
        },
        "constraints": meta.get("constraints", []),
        "statuses": meta.get("statuses", len(meta["coordinates"])),
        "sizes": meta.get("sizes", []),
        "rubbing": meta.get("rubbing", []),
        "least_rtol": LEAST[meta["dtype"]],
        **({"matrices": meta["matrices"]} if "matrices" in meta else {}),
        "conditions": meta.get("conditions", []),
        "pushed": pushed,
        "home": list(home),
        "model": None if rigid is None else {key: rigid[key] for key in ("coordinates", "parameters", "hoisted")},
    }


def _declared(model: Model, meta: Mapping[str, Any]) -> dict[str, Any]:
    """Return names that the declarations use beside the others."""
    public = [x for x in functions(meta["kernels"], signatures_of(model)) if not x.is_rollout]
    kinds = {function.kind for function in functions(meta["kernels"])}
    size = {array: math.prod(shape) for array, shape in meta["shapes"].items()}
    read = {array: max(size[array], 1) for function in public for array in function.signature.reads}
    found = max((size[function.signature.writes] for function in public), default=1)
    methods = [*(FIXED if "rollout" in kinds else ()), *(x for x in ADAPTIVE if rollout_of(x) in meta["kernels"])]
    rows = [
        {
            "name": re.sub(r"_(\w)", lambda match: match[1].upper(), function.name),
            "text": function.signature.text,
            "shape": " x ".join(map(str, meta["shapes"][function.signature.writes])),
            "kernel": function.name,
            "reads": function.signature.reads,
            "size": size[function.signature.writes],
            "sizes": [size[array] for array in function.signature.reads],
            "framed": function.is_framed,
        }
        for function in public
    ]
    return {
        "plain": [row for row in rows if not row["framed"]],
        "framed": [row for row in rows if row["framed"]],
        "sizes": {**read, "found": max(found, 1)},
        "methods": _literals(methods),
        "fixed": _literals(FIXED),
        "adaptive": _literals([name for name in ADAPTIVE if name not in ROLLOUTS]),
        "array": {"float64": "Float64Array", "float32": "Float32Array"}[meta["dtype"]],
        **{key: _literals(meta[key]) for key in ("coordinates", "links", "frames", "parameters")},
        "internal_states": _literals(meta.get("internal_states", ())),
    }


def _literals(names: Sequence[str] | Mapping[str, Any]) -> str:
    """Return a type of TypeScript that allows these texts."""
    return " | ".join(map(json.dumps, names)) or "never"


def _filled(template: str, context: Mapping[str, Any]) -> str:
    return environment().get_template(template).render(context)
