"""Contexts of the templates of a kernel's header and C: every name that they use."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from eomgen._version import __version__
from eomgen.robot.joint_types import CUTS
from eomgen.robot.model import Model

from ..joint.zeros import zero_map
from ..kernels.blocks import row_blocks
from ..kernels.bodies import axes_of, first_frame, frame_bodies
from ..kernels.closed_motion import CLOSING, row_kinds
from ..kernels.constraint_rows import deriving_precision
from ..kernels.derived import GRADIENTS
from ..kernels.entries import JOINED, KernelTable
from ..kernels.equations import Equations
from ..kernels.interface import places_of_forces, turning_joints
from ..kernels.signatures import BATCHES, KERNELS, SIGNATURES, SINGLES, Function, by_kind, functions, signatures_of
from ..program.ir import Program
from ..program.orders import with_short_lives
from ..program.shares import GIVEN
from ..tree.followers import coordinate_parents
from .definitions import define, define_setup, define_share
from .lanes import batched, calls_of, kept_size, pack, part_by_part
from .names import HEADINGS, entry_names, name_tables, status_texts
from .scalar_types import SCALARS, Constants, Scalar
from .statements import CHUNK
from .tableaus import STAGES

LIBRARY = {"float64": "eom", "float32": "eomf"}  # what names of the library begin with
PIVOT_LIMITS = {"float64": 1e-12, "float32": 1e-5}  # EOM_VANISHED of clib/precision.h
OPEN_GAPS = {"float64": 1e-9, "float32": 1e-5}  # m or rad, and per second of a rate of 1: more is not round-off
CLOSED_GAPS = {"float64": 1e-11, "float32": 2e-6}  # m or rad, from which one more projection leaves round-off
MET_GAPS = {"float64": 1e-12, "float32": 2e-6}  # m, or sine of an angle: a constraint that is met
LEFT = 10.0  # times that is what round-off may leave of it
RUN = ("last", "h", "q", "sine", "cosine", GIVEN, "pose", "origins", "axes")  # that a run of bodies may take
# Programs whose callers look at the closure residuals that they write
CHECKED = ("constrained_dynamics", "constrained_drives")


def statuses(model: Model) -> int:
    """Return reasons why a kernel may fail in one state.

    A pivot of a coordinate; a constraint's residual, its rate, or its acceleration; a force on an undriven coordinate.
    """
    n, m = len(model.coordinates), len(model.constraints)
    return 2 * n + 3 * m if m else n


def header_context(equations: Equations, meta: Mapping[str, Any], batches: bool) -> dict[str, Any]:
    """Return names, their counts, and functions, for kernel.h and kernel.c; ``meta`` is the package's metadata."""
    model, known = equations.model, signatures_of(equations.model)
    public = functions(equations.kernels, known)
    turning = turning_joints(model)
    return {
        "name": model.name,
        "guard": f"EOMGEN_{model.name.upper()}_H",
        "version": __version__,
        "dtype": equations.dtype,
        "real": SCALARS[equations.dtype].name,
        "eom": LIBRARY[equations.dtype],
        "n": len(model.coordinates),
        "rates": model.size,
        "inputs_in_c": len(model.coordinates) + len(model.drives),
        "m": len(model.constraints),
        "statuses": statuses(model),
        "status_texts": status_texts(model.coordinates, model.constraints),
        "headings": HEADINGS,
        "tables": [table for table in name_tables(meta) if table["names"]],
        "defaults": [(x, SCALARS[equations.dtype].literal(value)) for x, value in meta["parameters"].items()],
        "closed": bool(model.constraints),
        "batches": batches,
        "simd": BATCHES in meta["halves"],
        "declared": [name for names in meta["halves"].values() for name in names],
        "coordinates": model.coordinates,
        "internal_states": model.internal_states,
        "inputs": meta.get("inputs", {}),
        "links": model.links,
        "frames": model.frames,
        "constraints": model.constraints,
        "closed_functions": _closed_functions(equations),
        "springs": [spring.name for spring in model.robot.springs],
        "parameters": list(model.parameters),
        "hoisted": len(equations.setup.outputs),
        "turning": list(turning["joints"].values()),
        "turned_size": turning["room"],
        "operations": meta["operations"],
        **_functions(public),
        "controlled": "driven" if model.motors else "principal",
        "gaps_at_most": sum(len(CUTS[loop.type]) for loop in model.robot.loops) + len(model.robot.couplings),
    }


def _arguments(known: KernelTable, n: int, real: str, shared: str) -> dict[str, Callable[..., Any]]:
    """Return what templates write of a function's arguments: ``taken`` in its head, ``passed`` where it is called.

    ``joined`` gives both for the function that integrations call instead, if there is one.
    """

    def taken(kernel: str) -> str:
        arrays = [f"const {shared} *restrict h", *(f"const {real} *restrict {x}" for x in known[kernel].reads)]
        return f"{', '.join(arrays)}, {real} *restrict out"

    def passed(kernel: str, **others: str) -> str:
        return ", ".join(["h", *(others.get(x, x) for x in known[kernel].reads)])

    def joined(kernel: str) -> tuple[str, str] | None:
        reads = known[kernel].reads
        if not known[kernel].is_joined:
            return None
        given = ", ".join([f"const {shared} *h", *(f"const {real} *{x}" for x in reads if x not in JOINED)])
        values = passed(kernel, **{x: f"&{array}[{n}]" for x, array in JOINED.items()})
        return f"{given}, {real} *out", values

    return {"taken": taken, "passed": passed, "joined": joined}


def _closed_functions(equations: Equations) -> list[str]:
    """List the functions that assemble loops, with their programs, which do so without a look at residuals."""
    closing = {*CHECKED, "settling"}
    return [name for name in equations.kernels if name in closing or closing & set(equations.calls.get(name, ()))]


def _functions(public: list[Function]) -> dict[str, Any]:
    """Group functions by how they are called: with arrays alone, with a frame's number; and tell of rollouts."""
    return {
        "functions": [function for function in public if not function.is_framed and not function.is_rollout],
        "frame_functions": [function for function in public if function.is_framed],
        "rolls": any(function.kind == "rollout" for function in public),
        "adapts": [function.name for function in public if function.kind == "adaptive"],
        "gradients": [function.name for function in public if function.kind == "gradient"],
    }


def number_context(equations: Equations, meta: Mapping[str, Any], constants: Constants | None = None) -> dict[str, Any]:
    """Return names that C uses beside the header's, where a number is one state's; ``meta`` as of the header.

    ``constants`` takes up long literals.
    """
    model, dtype, scalar = equations.model, equations.dtype, replace(SCALARS[equations.dtype], constants=constants)
    known = signatures_of(model)
    programs = equations.programs.values()
    public = [name for name in equations.kernels if SIGNATURES[name].kind != "frames"]
    whole = [program for program in programs if program.name not in equations.shares]
    singular = f"eom_singular({len(model.coordinates)}, pivot)"
    definitions = [
        define(
            program,
            known[program.name],
            model.name,
            scalar,
            singular=singular,
            public=program.name in public,
            names=_names(known[program.name].writes, equations, meta),
        )
        for program in whole
    ]
    looped = [x for x in functions(equations.kernels, known) if f"{x.name}_batch" in meta["halves"][SINGLES]]
    return {
        "scalar": scalar.name,
        "shared": scalar.name,
        "suffix": "",
        "linkage": "",
        "singular": singular,
        **_arguments(known, len(model.coordinates), scalar.name, scalar.name),
        "one": scalar.literal(1.0),
        "zero": scalar.literal(0.0),
        "whole": scalar.whole,
        "open_gap": scalar.literal(OPEN_GAPS[dtype]),
        "redundant": meta.get("redundant", False),
        "closed_gap": scalar.literal(CLOSED_GAPS[dtype]),
        "met_gap": scalar.literal(MET_GAPS[dtype]),
        "left_gap": scalar.literal(LEFT * MET_GAPS[dtype]),
        "closing": _closing_files(equations, _composed(equations)),
        "sizes": {key: int(np.prod(shape)) for key, shape in equations.interface["shapes"].items()},
        "setup": define_setup(equations.setup, model.name, scalar, list(meta["parameters"])),
        "programs": definitions,
        "equations_of_robot": {"": {program.name for program in whole}},
        "composed": _templates(_composed(equations)),
        "looped": [function for function in looped if not function.is_rollout],
        "rollout_is_looped": any(function.kind == "rollout" for function in looped),
        "adaptive_looped": [function.name for function in looped if function.kind == "adaptive"],
        "shares": _shares(equations, scalar),
        **_tables(model),
        **(_frame_tables(model) if equations.shares else {}),
        **_closing_tables(equations),
        "kept_size": kept_size(equations),
        "has_radau": "pair_factors" in equations.programs,
        "pair_size": kept_size(equations, "pair_kept"),
        "rubs": any(name.endswith("friction.smoothing") for name in model.parameters),
        "kept_numbers": kept_of_a_step(model),
        "texts": {name: KERNELS[name].text for name in GRADIENTS},
    }


def _names(array: str, equations: Equations, meta: Mapping[str, Any]) -> dict[str, str]:
    """Return names of the entries of the array that a program writes, by their places in C."""
    shape = equations.interface["shapes"].get(array)
    return {} if shape is None else {f"out[{i}]": name for i, name in enumerate(entry_names(array, shape, meta))}


def kept_of_a_step(model: Model) -> dict[str, int]:
    """Count the numbers of a step that the C of each gradient keeps, where there is room for them."""
    closed, stages = bool(model.constraints), STAGES
    explicit = (3 if closed else 1) * stages  # accelerations of a stage; of loops q and v, which were closed, as well
    rosenbrock = (6 if closed else 2) * STAGES  # what is solved for, parts of the end; of loops all of a stage
    each = {"explicit_gradient": explicit, "implicit_gradient": int(closed), "rosenbrock_gradient": rosenbrock}
    each |= {name.replace("gradient", "sensitivity"): number for name, number in each.items()}
    return {name: model.size * number for name, number in each.items()}


def _closing_tables(equations: Equations) -> dict[str, Any]:
    """Return tables of the template of the closed accelerations' derivatives."""
    if CLOSING not in equations.programs:
        return {}
    kinds = row_kinds(equations.model, equations.programs[CLOSING])
    precision = deriving_precision(equations.model, sum(kind >= 0 for kind in kinds), equations.dtype)
    blocks = row_blocks(equations.model)
    starts = [sum(len(block.columns) for block in blocks[:b]) for b in range(len(blocks))]
    owners = [b for b, block in enumerate(blocks) for _ in range(block.rows)]
    kept = [r for r, kind in enumerate(kinds) if kind >= 0]
    return {
        "blocks": blocks,
        "block_widths": [len(block.columns) for block in blocks],
        "row_starts": [starts[owners[r]] for r in kept],
        "row_widths": [len(blocks[owners[r]].columns) for r in kept],
        "row_places": [kept.index(r) if r in kept else -1 for r in range(len(kinds))],
        "row_kinds": [kinds[r] for r in kept],
        "closing_share": SCALARS[equations.dtype].literal(precision.added),
        "closing_floor": SCALARS[equations.dtype].literal(precision.floor),
        "closing_passes": precision.refinements,
    }


def _shares(equations: Equations, scalar: Scalar) -> dict[str, Any] | None:
    """Write runs of bodies and frames as C, by the nodes of ``share_among_bodies``; None where no kernel has frames."""
    for shares in equations.shares.values():
        name, ways = equations.model.name, [shares.way(node) for node in range(len(shares.run_of))]
        angles = [shares.angles.instructions[index] for index in shares.angles.outputs.values()]
        plain = all(angle.op == "input" and angle.leaf[0] == "q" for angle in angles)
        ends = [max(node for node, run in enumerate(shares.run_of) if run == i) for i in range(len(shares.runs))]
        angles_of = [shares.turned[end] for end in ends]
        runs = {
            number: (define_share(run.program, name, scalar, run.stops), bool(run.stops))
            for number, run in enumerate(shares.runs)
            if run.program.outputs
        }
        read = {array for run, _ in runs.values() for _, array in (*run.inputs, *run.outputs)}
        read |= {"last"} if any(stops for _, stops in runs.values()) else set()
        return {
            "runs": runs,
            "unread": [array for array in RUN if array not in read],
            "run_of": shares.run_of,
            "behind": [run.behind for run in shares.runs],
            "angles": None if plain else define_share(shares.angles, name, scalar),
            "angle_places": [angle.leaf[1] if plain else place for place, angle in enumerate(angles)],
            "first": [sum(angles_of[:run]) for run in range(len(ends))],
            "turned": shares.turned,
            "first_frame": first_frame(equations.model),
            "kept": shares.kept,
            "longest": max(map(len, ways)),
            "most_turned": max(sum(shares.turned[node] for node in way) for way in ways),
        }
    return None


def _composed(equations: Equations) -> list[str]:
    """List kernels with a composed template, in the order in which they are written, but for rollouts."""
    composed = [name for name in equations.kernels if name in equations.calls or KERNELS[name].kind == "frames"]
    return by_kind(name for name in composed if not _rolls(name))


def _closing_files(equations: Equations, composed: Iterable[str]) -> list[str]:
    """List files of the library that templates of these kernels call."""
    named = list(composed)
    checks = any(program in CHECKED for name in named for program in equations.calls.get(name, ()))
    derivatives = any(name.endswith("forward_dynamics_jacobian") for name in named)
    files = {
        "constraint_checks.h": checks,
        "dependent_coordinates.h": "following" in named,
        "acceleration_derivatives.h": derivatives,
        "kinematics.h": any(KERNELS[name].kind == "frames" for name in named),
    }
    return [file for file, wanted in files.items() if wanted]


def _rolls(kernel: str) -> bool:
    return KERNELS[kernel].kind in ("rollout", "adaptive", "gradient")


def _templates(kernels: Iterable[str]) -> list[dict[str, str]]:
    """Return templates of kernels, with what they compute; a template finds the latter as ``kernel.text``."""
    return [{"template": f"composed/{name}.c.jinja", "text": KERNELS[name].text} for name in kernels]


def _frame_tables(model: Model) -> dict[str, Any]:
    """Return tables of bodies and axes by which poses and Jacobians of frames are computed."""
    bodies, axes = model.bodies, axes_of(model)
    ancestors = [set(model.ancestors(body)) for body in frame_bodies(model)]
    ways = [[x for x in axes if x.body in way] for way in ancestors]
    return {
        "frame_bodies": frame_bodies(model),
        "full_frames": [
            int(not model.followers and len(way) == model.size and all(x.is_rotation for x in way)) for way in ways
        ],
        "body_parents": [body.parent for body in bodies],
        "body_first": [next((s for s, x in enumerate(axes) if x.body == k), 0) for k in range(len(bodies))],
        "body_count": [sum(x.body == k for x in axes) for k in range(len(bodies))],
        "is_rotation": [int(axis.is_rotation) for axis in axes],
        "columns_of_axes": [axis.column for axis in axes] if model.followers else [],
    }


def _tables(model: Model) -> dict[str, Any]:
    """Return numbers of the tree that templates of composed kernels have tables of."""
    return {
        "coordinate_parents": coordinate_parents(model),
        "prescribed": model.prescribed,
        "is_prescribed": [int(i in model.prescribed) for i in range(model.size)],
        "beside": places_of_forces(model) if model.drives else [],
        "drives": [{"at": i, "states": states} for i, states in model.drives.items()],
        "states": len(model.internal_states),
        "christoffel_words": lambda: christoffel_words(model),  # asked for by one template alone
    }


def lane_context(equations: Equations, constants: Constants | None = None) -> dict[str, Any]:
    """Return names that mean something else in C on lanes, where a number is a vector of states."""
    model, together = equations.model, batched(equations)
    apart = any(_rolls(name) for name in together)
    scalar = replace(SCALARS[equations.dtype], constants=constants)
    lanes = scalar.lanes(apart=apart)
    wanted = {program for name in together for program in calls_of(equations, name)}
    programs = [
        program for name, program in equations.programs.items() if name in wanted and name not in equations.shares
    ]
    known = signatures_of(model)
    public = _functions(functions(together, known))
    names = {function.name for function in public["functions"]}
    packings = {p.name: packing for p in programs if p.name in names and (packing := pack(p)) is not None}
    singular = f"eom_singular_lanes({len(model.coordinates)}, {statuses(model)}, pivot)"
    alone = {name: packing.program for name, packing in packings.items()}
    definitions = [
        define(
            _short_lived(alone.get(p.name, p)),
            known[p.name],
            model.name,
            lanes,
            singular=singular,
            form="packed" if p.name in packings else "several" if p.name in names and part_by_part(p) else "",
        )
        for p in programs
    ]
    called = {program for name in together for program in equations.calls.get(name, ())}
    composed = by_kind(name for name in together if name in equations.calls and not _rolls(name))
    framed = [name for name in together if KERNELS[name].kind == "frames"]
    zero, one = (scalar.literal(number) for number in (0.0, 1.0))
    return {
        "real": lanes.name,
        "shared": lanes.shared,
        "suffix": "_lanes",
        "linkage": "static ",
        "singular": singular,
        **_arguments(known, len(model.coordinates), lanes.name, lanes.shared),
        "whole": lanes.whole,
        "one": lanes.whole(one),
        "zero": lanes.whole(zero),
        "programs": definitions,
        "equations_of_robot": {"_lanes": {p.name for p in programs if p.name not in packings or p.name in called}},
        "packings": packings,
        "several": {p.name for p, definition in zip(programs, definitions, strict=True) if definition.several},
        "unpacked": [(name, known[name]) for name in packings if name in called],
        "shares": _shares(equations, scalar.lanes()) if equations.shares.keys() & set(together) else None,
        "composed": _templates(composed),
        "closing": _closing_files(equations, [*composed, *framed]),
        "framed": _templates(framed),
        **public,
    }


def _short_lived(program: Program) -> Program:
    """Return a program of several parts in the order in which these hand least on; one of a single part as it is."""
    return with_short_lives(program) if len(program.instructions) > CHUNK else program


def christoffel_words(model: Model) -> list[str]:
    """Return the zero map of the tensor C as 64-bit words, the first entry in the lowest bit."""
    mask = zero_map(model).christoffel.mask.ravel()
    padded = np.zeros(-(-mask.size // 64) * 64, bool)
    padded[: mask.size] = mask
    words = np.packbits(padded, bitorder="little").view("<u8")
    return [f"{word:#x}ULL" for word in words]
