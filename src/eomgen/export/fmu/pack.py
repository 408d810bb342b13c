"""FMUs (functional mock-up units): a robot as a block of other tools' simulations, in C, without Python.

See docs/fmu.md for variables, modes and what is computed how.
"""

from __future__ import annotations

import hashlib
import json
import math
import platform
import sys
import tempfile
import uuid
import zipfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

import numpy as np

from eomgen._version import __version__
from eomgen.description import RobotLike, as_robot
from eomgen.errors import InputError
from eomgen.files import as_path, write_atomically
from eomgen.kernel.stepping.methods import ADAPTIVE as STEPPERS
from eomgen.kernel.stepping.methods import COST
from eomgen.kernel.stepping.options import rollout_of
from eomgen.names import show
from eomgen.pipeline.options import Options
from eomgen.pipeline.stages import make_source
from eomgen.progress import StageReport, no_report, tells_at_prompt
from eomgen.robot.model import Model, build_model
from eomgen.robot.value import Robot
from eomgen.runtime.parameter_conditions import FADING

from ...codegen.kernels.derived import METHODS as PROGRAMS_OF_METHODS
from ...codegen.kernels.entries import JOINED
from ...codegen.kernels.groups import CLOSED_FMU, FMU, kernel_group
from ...codegen.kernels.signatures import CLOSED_PROGRAMS, signatures_of
from ...pipeline.mechanisms import assembled_home
from ..step import default_step
from .choices import ADAPTIVE, AUTO, METHODS, VERSIONS

if TYPE_CHECKING:
    from .variables import Variable

RTOL = 1e-6  # relative tolerance of co-simulation at first


@tells_at_prompt("exporting")
def export_fmu(
    robot: RobotLike,
    path: Path | str,
    version: int = 3,
    *,
    method: str = AUTO,
    rtol: float | None = None,
    step: float | None = None,
    flags: Sequence[str] = (),
    progress: StageReport = no_report,
) -> Path:
    """Write an FMU (functional mock-up unit) for model exchange and co-simulation, and return its path.

    It has the binary of this machine and the C sources.  Loops are closed after every step of co-simulation; in
    model exchange, ordinary differential equations let constraint violations decay.

    Args:
        robot: a Robot, the name of a built-in one, or the path of a description.
        path: file to write, usually with the suffix .fmu.
        version: of the Functional Mock-up Interface, 2 or 3.
        method: of co-simulation, as of ``Kernel.rollout``: "rosenbrock", "tsit5" or "radau", with adaptive
            step size; "rk4" or "implicit"; or "auto", automatic stiffness switching between the first two.
        rtol: the relative tolerance of co-simulation at first, 1e-6 by default; of methods with adaptive
            step size.
        step: the greatest step of co-simulation at first, s; by default 1e-3, or what "rk4" needs if that is less; of
            "rk4" and "implicit".
        flags: further flags of the compiler, behind those of $CFLAGS; none that give up IEEE arithmetic.
        progress: called with a line of text when a stage begins.

    Raises:
        InputError: an argument is none of these, or the file cannot be written.
        LoopError: the loops do not close near the description's home.
        BuildError: no compiler, or a compiler that fails.
    """
    path = as_path(path, "path")
    robot = as_robot(robot)
    _check(version, method, rtol, step)
    home = assembled_home(robot, progress)
    solver = _solver(robot, method, rtol, step, progress)
    kernels = kernel_group(robot, CLOSED_FMU if build_model(robot).constraints else FMU)
    options = Options((*kernels, rollout_of(method)), batches=False)
    files = _files(robot, options, version, method, (solver, home), progress)
    with tempfile.TemporaryDirectory() as work:
        progress("compiling the FMU")
        binary, content = _compiled(robot.name, files, version, Path(work), flags)
    target = Path(path)
    packed = {**files, binary: content}
    return write_atomically(target, lambda stream: _pack(packed, stream), read=None)


def _check(version: int, method: str, rtol: float | None, step: float | None) -> None:
    from .variables import LOOSEST, TIGHTEST

    if version not in VERSIONS or isinstance(version, bool):
        raise InputError(f"fmi: version {show(version)} is unknown; allowed: {', '.join(map(str, VERSIONS))}")
    if method not in METHODS:
        raise InputError(f"method: {show(method)} is unknown; allowed: {', '.join(METHODS)}")
    if step is not None and method in ADAPTIVE:
        named = ", ".join(name for name in METHODS if name not in ADAPTIVE)
        raise InputError(f"step: {show(step)} is given with method {show(method)}; allowed: with the methods {named}")
    if rtol is not None and method not in ADAPTIVE:
        named = ", ".join(ADAPTIVE)
        raise InputError(f"rtol: {show(rtol)} is given with method {show(method)}; allowed: with the methods {named}")
    if step is not None and not (_is_number(step) and 1e-9 <= step < math.inf):
        raise InputError(f"step: {show(step)} is no length of a step; allowed: a finite number of at least 1e-9 s")
    if rtol is not None and not (_is_number(rtol) and TIGHTEST <= rtol <= LOOSEST):
        raise InputError(
            f"rtol: {show(rtol)} is no relative tolerance; allowed: a number from {TIGHTEST:g} to {LOOSEST:g}"
        )


def _is_number(x: object) -> bool:
    return isinstance(x, (int, float, np.number)) and not isinstance(x, bool)


def _solver(robot: Robot, method: str, rtol: float | None, step: float | None, progress: StageReport) -> Variable:
    """Return the parameter of co-simulation."""
    from .variables import step_variable, tolerance_variable

    if method in ADAPTIVE:
        return tolerance_variable(RTOL if rtol is None else float(rtol))
    return step_variable(default_step(robot, method, progress) if step is None else float(step))


def _files(
    robot: Robot,
    options: Options,
    version: int,
    method: str,
    begin: tuple[Variable, Sequence[float]],
    progress: StageReport,
) -> dict[str, bytes]:
    """Return files of the FMU but its binary, by their paths; ``begin``: its solver's parameter and its home."""
    from eomgen.codegen.kernels.interface import places_of_forces, turning_joints

    from .variables import make_layout
    from .xml import Fmu, build_description, model_description

    model, source = build_model(robot), make_source(robot, options, progress)
    layout, [dynamics] = make_layout(model, *begin), PROGRAMS_OF_METHODS["explicit"][2]
    name, meta, turning = robot.name, json.loads(source.meta), turning_joints(model)
    context = {
        "at": layout.at,
        "variables": layout.variables,
        "frames": layout.frames,
        "literal": lambda x: repr(float(x)),
        "name": name,
        "guard": f"EOMGEN_{name.upper()}_H",
        "version": __version__,
        "n": len(model.coordinates),
        "rates": model.size,
        "inputs": len(model.coordinates) + len(model.drives),
        "passed": _arguments(model),
        "hoisted": meta["hoisted"],
        "m": len(model.constraints),
        "dynamics": CLOSED_PROGRAMS[dynamics] if model.constraints else dynamics,
        "links": len(model.links),
        "parameters": len(model.parameters),
        "turning": len(turning["joints"]),
        "turned_size": turning["room"],
        "prescribed": model.prescribed,
        "beside": places_of_forces(model) if model.drives else [],
        "columns": [states[0] for states in model.drives.values()],
        "matrices": _matrices(layout.at["parameters"], list(model.parameters), meta.get("matrices", {})),
        **_conditions(layout.at["parameters"], list(model.parameters), meta.get("conditions", ())),
        "method": method,
        **_stepping(model, method, meta),
    }
    kinds = {f"{stem}.{end}": f"fmu/{stem}.{end}" for stem in ("unit", f"fmi{version}") for end in "hc"}
    texts = _rendered(kinds, {**context, "token": ""})
    digest = hashlib.sha256(json.dumps([*source.files.values(), *texts.values()]).encode()).digest()
    token = f"{{{uuid.UUID(bytes=digest[:16])}}}"  # a GUID that the same sources have again, and no others
    texts = _rendered(kinds, {**context, "token": token})
    code = source.files | {f"{name}_{key}": text for key, text in texts.items()}
    compiled = sorted(file for file in code if _is_compiled(name, file))
    fmu = Fmu(name, token, layout, compiled, bool(model.constraints))
    files = {f"sources/{file}": text.encode("ascii") for file, text in code.items()}
    files["modelDescription.xml"] = model_description(fmu, version)
    if version == 3:
        files["sources/buildDescription.xml"] = build_description(fmu)
    return files


def _arguments(model: Model) -> Callable[..., str]:
    """Return what writes the arrays that a function reads, by their names; those that stand behind others are found."""
    known = signatures_of(model)

    def passed(function: str, **arrays: str) -> str:
        behind = {x: f"{arrays[of]} + UNIT_DOF" for x, of in JOINED.items() if of in arrays}
        return ", ".join((arrays | behind)[x] for x in known[function].reads)

    return passed


def _stepping(model: Model, method: str, meta: Mapping[str, Any]) -> dict[str, object]:
    """Return names that ``fmu/adaptive.c.jinja`` uses; ``meta`` is that of the source."""
    if method not in ADAPTIVE:
        return {"adaptive": False}
    from eomgen.codegen.kernels.steps.tolerances import rubbing_parameters

    return {
        "adaptive": True,
        "sizes": [repr(float(size)) for size in meta["sizes"]],
        "rubbing": [(i, list(model.parameters).index(name)) for i, name in rubbing_parameters(model)],
        "number": STEPPERS.get(method),
        "costs": list(COST.values()),
        "stepping": rollout_of(method),
        "most": 2**62,
    }


def _matrices(
    first: int, parameters: Sequence[str], matrices: Mapping[str, Sequence[str]]
) -> list[tuple[str, list[list[int]]]]:
    """Return symmetric matrices among parameters, each with value references of its entries; 0 of those always 0.

    Args:
        first: value reference of the first parameter.
        parameters: their names.
        matrices: coordinates of each, in their order, by what stands in front of them in the entries' names.
    """
    places = {name: first + i for i, name in enumerate(parameters)}
    tables = []
    for owner, names in matrices.items():
        upper = {(one, other): places.get(f"{owner}.{one}.{other}", 0) for one in names for other in names}
        tables.append((owner, [[upper[one, other] or upper[other, one] for other in names] for one in names]))
    return tables


def _conditions(first: int, parameters: Sequence[str], conditions: Sequence[Mapping[str, Any]]) -> dict[str, object]:
    """Return names that ``fmu/laws.c.jinja`` uses: conditions between numbers of laws, by value references.

    Args:
        first: value reference of the first parameter.
        parameters: their names.
        conditions: as of ``eomgen.robot.parameter_names.conditions``.
    """
    at = {name: first + i for i, name in enumerate(parameters)}
    sums = [
        (one["allowed"], one["least"], [(at[name], factor) for name, factor in one["factors"].items()])
        for one in conditions
        if "factors" in one
    ]
    keys = ("coulomb", "bristle_damping", "fade", "static", "gaussian")
    fading = [
        [at.get(one["fades"].get(f"friction.{key}", ""), 0) for key in keys] for one in conditions if "fades" in one
    ]
    return {
        "conditions": sums,
        "terms": max((len(terms) for *_, terms in sums), default=0),
        "fading": fading,
        "fading_allowed": FADING,
    }


def _rendered(templates: Mapping[str, str], context: Mapping[str, object]) -> dict[str, str]:
    from eomgen.codegen.c.source import environment

    return {key: environment().get_template(f"{name}.jinja").render(context) for key, name in templates.items()}


def binary_path(name: str, version: int, system: str, machine: str) -> str:
    """Return the path of a platform's binary in an FMU.

    Args:
        system: "linux", "darwin" or "win32", as ``sys.platform``.
        machine: "x86_64", "arm64", ..., as ``platform.machine()``.
    """
    processor = {"amd64": "x86_64", "arm64": "aarch64"}.get(machine.lower(), machine.lower())
    ending = {"darwin": "dylib", "win32": "dll"}.get(system, "so")
    folder = f"{processor}-{'windows' if system == 'win32' else system}"
    if version == 2 and processor == "x86_64":
        folder = {"darwin": "darwin64", "win32": "win64"}.get(system, "linux64")
    return f"binaries/{folder}/{name}.{ending}"


def _is_compiled(name: str, file: str) -> bool:
    """Whether a file is compiled by itself; the FMU's C includes the robot's."""
    return file.endswith(".c") and "/" not in file and file != f"{name}.c"


def _compiled(
    name: str, files: Mapping[str, bytes], version: int, work: Path, flags: Sequence[str]
) -> tuple[str, bytes]:
    """Return the path and content of this machine's binary."""
    from eomgen.codegen.package.compile import WARNINGS, compile_flags, find_compiler, link_shared
    from eomgen.codegen.package.probe import check_compiler
    from eomgen.codegen.package.running import run_all

    compiler = find_compiler()
    check_compiler(compiler, compile_flags(compiler, False, flags))
    for path, content in files.items():
        if path.startswith("sources/"):
            place = work / path.removeprefix("sources/")
            place.parent.mkdir(exist_ok=True)
            place.write_bytes(content)
    include = ("-iquote", str(work), "-DFMI3_OVERRIDE_FUNCTION_PREFIX", "-fPIC", "-fvisibility=hidden")
    codes = [work / file for file in sorted(path.name for path in work.iterdir()) if _is_compiled(name, file)]
    objects = [code.with_suffix(".o") for code in codes]
    compile_c = [*compiler.command, "-c", *WARNINGS, *include, *compile_flags(compiler, False, flags)]
    run_all([[*compile_c, str(code), "-o", str(made)] for code, made in zip(codes, objects, strict=True)])
    library = work / "binary"
    link_shared(compiler, objects, library, flags)
    return binary_path(name, version, sys.platform, platform.machine()), library.read_bytes()


def _pack(files: Mapping[str, bytes], stream: IO[bytes]) -> None:
    """Write a ZIP file, the same bytes for the same files."""
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as packed:
        for path, content in sorted(files.items()):
            entry = zipfile.ZipInfo(path, (1980, 1, 1, 0, 0, 0))
            entry.compress_type, entry.external_attr = zipfile.ZIP_DEFLATED, 0o644 << 16
            packed.writestr(entry, content)
