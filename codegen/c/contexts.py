"""Contexts of the templates of a kernel's header and C: every name that they use."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from eomgen._version import __version__
from eomgen.robot.model import Model

from ..joint.zeros import zero_map
from ..kernels.equations import Equations
from ..kernels.signatures import KERNELS, SIGNATURES, SINGLES, Function, by_kind, functions, shapes
from ..program.operations import CALLS
from ..solve.factorised import coordinate_parents
from .definitions import define, define_setup
from .lanes import SQUARES, batched, calls_of, pack
from .scalar_types import SCALARS, TURNS

LITERALS = {"zero": 0.0, "half": 0.5, "one": 1.0, "two": 2.0, "six": 6.0}  # of templates
PIVOT_LIMITS = {"float64": 1e-12, "float32": 1e-5}  # a pivot below so much of its scale counts as vanished


def header_context(equations: Equations, dtype: str, meta: Mapping[str, Any], batches: bool) -> dict[str, Any]:
    """Names, numbers of them, and functions, for kernel.h and kernel.c; ``meta`` is the package's metadata."""
    model, public = equations.model, functions(equations.kernels)
    return {
        "name": model.name,
        "guard": f"EOMGEN_{model.name.upper()}_H",
        "version": __version__,
        "dtype": dtype,
        "real": SCALARS[dtype].name,
        "n": model.size,
        "batches": batches,
        "declared": [name for names in meta["halves"].values() for name in names],
        "coordinates": model.coordinates,
        "links": model.links,
        "frames": model.frames,
        "constraints": model.constraints,
        "springs": [spring.name for spring in model.robot.springs],
        "parameters": list(model.parameters),
        "hoisted": len(equations.setup.outputs),
        "operations": meta["operations"],
        **_functions(public),
        "controlled": "driven" if model.motors else "principal",
    }


def _functions(public: list[Function]) -> dict[str, Any]:
    """Functions by how they are called: with arrays alone, with a frame's number, and whether there is a rollout."""
    return {
        "functions": [function for function in public if not function.is_framed and not function.is_rollout],
        "frame_functions": [function for function in public if function.is_framed],
        "rolls": any(function.is_rollout for function in public),
    }


def number_context(equations: Equations, dtype: str, meta: Mapping[str, Any]) -> dict[str, Any]:
    """Names that C uses beside those of the header, where a number is one state's; ``meta`` as of the header."""
    model, scalar = equations.model, SCALARS[dtype]
    programs = equations.programs.values()
    public = [name for name in equations.kernels if SIGNATURES[name].kind != "frames"]
    definitions = [define(program, model.name, scalar, public=program.name in public) for program in programs]
    looped = [x for x in functions(equations.kernels) if f"{x.name}_batch" in meta["halves"][SINGLES]]
    return {
        "scalar": scalar.name,
        "suffix": "",
        "linkage": "",
        "bytes": np.dtype(dtype).itemsize,
        "literal_suffix": scalar.suffix,
        "literals": {name: scalar.literal(value) for name, value in LITERALS.items()},
        "one": scalar.literal(1.0),
        "zero": scalar.literal(0.0),
        "whole": scalar.whole,
        "pivot_limit": scalar.literal(PIVOT_LIMITS[dtype]),
        "statuses_of_a_step": str(model.size),
        "sizes": {key: int(np.prod(shape)) for key, shape in shapes(model).items()},
        "setup": define_setup(equations.setup, model.name, scalar),
        "programs": definitions,
        "solving": any(definition.has_pivots for definition in definitions),
        "composed": _templates(_composed(equations)),
        "looped": [function for function in looped if not function.is_rollout],
        "rollout_is_looped": any(function.is_rollout for function in looped),
        "turn": TURNS[dtype],
        "turns": any(i.op in ("sin", "cos") for program in programs for i in program.instructions),
        "called": {i.op for program in (equations.setup, *programs) for i in program.instructions} & set(CALLS),
        **_tables(model),
    }


def _composed(equations: Equations) -> list[str]:
    """Kernels with a template of their own, in the order in which they are written, but for rollouts."""
    own = [name for name in equations.kernels if name in equations.calls or KERNELS[name].kind == "frames"]
    return by_kind(name for name in own if KERNELS[name].kind != "rollout")


def _templates(kernels: Iterable[str]) -> list[dict[str, str]]:
    """Templates of kernels, with what they compute; a template finds the latter as ``kernel.text``."""
    return [{"template": f"composed/{name}.c.jinja", "text": KERNELS[name].text} for name in kernels]


def _tables(model: Model) -> dict[str, Any]:
    """Numbers of the tree that templates of composed kernels have tables of."""
    bodies = model.bodies
    return {
        "origins": 12 * len(model.frames),
        "axes": 12 * len(model.frames) + 3 * len(bodies),
        "frame_bodies": [model.body_of[_link_of(model, frame)] for frame in model.frames],
        "body_parents": [body.parent for body in bodies],
        "body_first": [body.first for body in bodies],
        "body_count": [len(body.active) for body in bodies],
        "is_rotation": [int(name.endswith((".alpha", ".beta", ".gamma"))) for name in model.coordinates],
        "coordinate_parents": coordinate_parents(model),
        "prescribed": model.prescribed,
        "is_prescribed": [int(i in model.prescribed) for i in range(model.size)],
        "christoffel_words": lambda: christoffel_words(model),  # asked for by one template alone
    }


def lane_context(equations: Equations, dtype: str) -> dict[str, Any]:
    """Names that mean something else in C for several states at a time, where a number is a vector of states."""
    model, lanes = equations.model, SCALARS[dtype].lanes()
    together = batched(equations)
    wanted = {program for name in together for program in calls_of(equations, name)}
    programs = [program for name, program in equations.programs.items() if name in wanted]
    public = _functions(functions(together))
    names = {function.name for function in public["functions"]}
    packings = {p.name: packing for p in programs if p.name in names and (packing := pack(p)) is not None}
    definitions = [
        define(packings[p.name].program if p.name in packings else p, model.name, lanes, packed=p.name in packings)
        for p in programs
    ]
    called = {program for name in together for program in equations.calls.get(name, ())}
    zero, one = (SCALARS[dtype].literal(number) for number in (0.0, 1.0))
    return {
        "real": lanes.name,
        "suffix": "_lanes",
        "linkage": "static ",
        "whole": lanes.whole,
        "one": lanes.whole(one),
        "zero": lanes.whole(zero),
        "statuses_of_a_step": f"{model.size} * LANES",
        "programs": definitions,
        "packings": packings,
        "unpacked": [(name, SIGNATURES[name]) for name in packings if name in called],
        "solving": any(definition.has_pivots for definition in definitions),
        "composed": _templates(name for name in together if KERNELS[name].kind == "composed"),
        "framed": _templates(name for name in together if KERNELS[name].kind == "frames"),
        **public,
        "squares": SQUARES[dtype],
    }


def christoffel_words(model: Model) -> list[str]:
    """The zero map of the tensor C as 64-bit words, the first entry in the lowest bit."""
    mask = zero_map(model).christoffel.mask.ravel()
    padded = np.zeros(-(-mask.size // 64) * 64, bool)
    padded[: mask.size] = mask
    words = np.packbits(padded, bitorder="little").view("<u8")
    return [f"{word:#x}ULL" for word in words]


def _link_of(model: Model, frame: str) -> str:
    return {f.name: f.link for f in model.robot.frames}.get(frame, frame)
