"""Programs -> C source.  Python decides here, templates hold the C.

Every program is written twice: on numbers, and on vectors with one state in every lane.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from typing import Any

import jinja2.meta
import numpy as np

from eomgen._version import __version__
from eomgen.robot.model import Model

from ..joint.zeros import zero_map
from ..kernels.equations import Equations
from ..kernels.signatures import KERNELS, SIGNATURES, shapes
from ..program.operations import CALLS
from ..solve.factorised import coordinate_parents
from .metadata import metadata
from .scalar_types import SCALARS, TURNS
from .source import Source, environment
from .statements import handed_on, split, turned, write_function

LITERALS = {"zero": 0.0, "half": 0.5, "one": 1.0, "two": 2.0, "six": 6.0}  # of templates
VECTORS = (16, 32, 64)  # bytes of a vector
LANE_VALUES = 8192  # values that a kernel for several states may keep on the stack: 512 KB of the longest vectors


def render(equations: Equations, dtype: str, *, batches: bool = True) -> Source:
    """Equations -> Source.

    Args:
        dtype: "float64" or "float32".
        batches: with the functions for several states in one call.
    """
    model = equations.model
    meta = metadata(equations, dtype)
    context = {**_context(equations, dtype, meta), "batches": batches}
    header = _fill("kernel.h.jinja", context)
    code = _fill("kernel.c.jinja", context)
    if batches:
        code += _fill("batches.c.jinja", {**context, **_lanes(equations, dtype)})
    code = _tidy(code)
    declarations = header.split("/* begin of declarations */")[1].split("/* end of declarations */")[0]
    statements = sum(len(program.instructions) for program in equations.programs.values())
    return Source(model.name, header, code, declarations, json.dumps(meta, indent=1) + "\n", statements)


def _context(equations: Equations, dtype: str, meta: Mapping[str, Any]) -> dict[str, Any]:
    """What the templates know."""
    model, scalar = equations.model, SCALARS[dtype]
    functions = {name: write_function(program, scalar) for name, program in equations.programs.items()}
    public = [name for name in KERNELS if name in equations.kernels]
    return {
        "name": model.name,
        "guard": f"EOMGEN_{model.name.upper()}_H",
        "version": __version__,
        "dtype": dtype,
        "real": scalar.name,
        "scalar": scalar.name,
        "bytes": np.dtype(dtype).itemsize,
        "literal_suffix": scalar.suffix,
        "suffix": "",
        "one": scalar.literal(1.0),
        "zero": scalar.literal(0.0),
        "pivot_limit": scalar.literal(1e-12 if dtype == "float64" else 1e-5),
        "coordinates": model.coordinates,
        "n": model.size,
        "bodies": [(body.name, body.joint) for body in model.bodies],
        "links": model.links,
        "frames": model.frames,
        "constraints": model.constraints,
        "springs": [spring.name for spring in model.robot.springs],
        "origins": 12 * len(model.frames),
        "axes": 12 * len(model.frames) + 3 * len(model.bodies),
        "frame_bodies": [model.body_of[_link_of(model, frame)] for frame in model.frames],
        "body_parents": [body.parent for body in model.bodies],
        "body_first": [body.first for body in model.bodies],
        "body_count": [len(body.active) for body in model.bodies],
        "is_rotation": [int(name.endswith((".alpha", ".beta", ".gamma"))) for name in model.coordinates],
        "parameters": list(model.parameters),
        "hoisted": len(equations.setup.outputs),
        "kernels": public,
        "all_kernels": SIGNATURES,
        "all": str,
        "literals": {name: scalar.literal(value) for name, value in LITERALS.items()},
        "lane_count": 1,
        "turn": TURNS[dtype],
        "turns": any(i.op in ("sin", "cos") for p in equations.programs.values() for i in p.instructions),
        "called": {i.op for p in (equations.setup, *equations.programs.values()) for i in p.instructions} & set(CALLS),
        "padded": lambda count: f"PADDED({count})",
        "turned": lambda angles, count: f"{angles}, PADDED({count}), sine, cosine",
        "coordinate_parents": coordinate_parents(model),
        "prescribed": model.prescribed,
        "motors": bool(model.motors),
        "sizes": {key: int(np.prod(shape)) for key, shape in shapes(model).items()},
        "functions": functions,
        "solving": any("pivot" in function.outputs for function in functions.values()),
        "batched": batched(equations),
        "looped": [name for name in public if name not in batched(equations)],
        "setup": write_function(equations.setup, scalar, turning=False),
        "loops": sorted(equations.loops),
        "survivors": christoffel_bits(model) if "christoffel" in equations.loops else [],
        "operations": meta["operations"],
    }


def _lanes(equations: Equations, dtype: str) -> dict[str, Any]:
    """What is different in the templates where a number is a vector of states."""
    scalar, lanes = SCALARS[dtype], SCALARS[dtype].lanes()
    wanted = {program for name in batched(equations) for program in SIGNATURES[name].calls or (name,)}
    functions = {name: write_function(p, lanes) for name, p in equations.programs.items() if name in wanted}
    return {
        "real": lanes.name,
        "suffix": "_lanes",
        "lane_count": "LANES",
        "padded": str,
        "turned": lambda angles, count: (
            f"(const {scalar.name} *)({angles}), {count} * LANES, ({scalar.name} *)sine, ({scalar.name} *)cosine"
        ),
        "all": lanes.whole,
        "one": lanes.whole(scalar.literal(1.0)),
        "zero_lanes": scalar.literal(0.0),
        "zero": lanes.whole(scalar.literal(0.0)),
        "functions": functions,
        "solving": any("pivot" in function.outputs for function in functions.values()),
        "lane_counts": [width // np.dtype(dtype).itemsize for width in VECTORS],
        "distances": lambda count: [1 << bit for bit in range(count.bit_length() - 1)],
        "pairs": lambda count, d: [(i, i + d) for i in range(count) if not i & d],
        "lower": lambda count, d: [count + lane - d if lane & d else lane for lane in range(count)],
        "upper": lambda count, d: [count + lane if lane & d else lane + d for lane in range(count)],
    }


def batched(equations: Equations) -> list[str]:
    """Public kernels that work on several states at a time: those whose arrays fit the stack as vectors."""
    size = {key: int(np.prod(shape)) for key, shape in shapes(equations.model).items()}

    def values(name: str) -> int:
        signature = SIGNATURES[name]
        arrays = sum(size[array] for array in (*signature.reads, signature.writes))
        if name in equations.programs:
            program = equations.programs[name]
            apart = turned(program)
            return arrays + 3 * len(apart) + len(handed_on(program, split(program, apart)))
        return arrays + max(values(program) for program in signature.calls)

    public = [name for name in KERNELS if name in equations.kernels]
    return [name for name in public if _is_vector(equations, name) and values(name) <= LANE_VALUES]


def _is_vector(equations: Equations, name: str) -> bool:
    """Whether there is C of the kernel for vectors: a program, or a template that calls programs."""
    return name in equations.programs or bool(SIGNATURES[name].calls)


def _tidy(code: str) -> str:
    """The code without the empty lines that macros leave behind."""
    code = re.sub(r"\n{3,}", "\n\n", code)
    return re.sub(r"(?<=\n{\n)\n", "", code.replace("\n\n}", "\n}"))


def _fill(template: str, context: Mapping[str, Any]) -> str:
    """The template with its context; a name that the context does not have is a bug."""
    loader = environment().loader
    assert loader is not None
    source = loader.get_source(environment(), template)[0]
    missing = jinja2.meta.find_undeclared_variables(environment().parse(source)) - set(context)
    assert not missing, f"{template} asks for {sorted(missing)}"
    return environment().get_template(template).render(context)


def christoffel_bits(model: Model) -> list[str]:
    """The zero map of the tensor C as 64-bit words, the first entry in the lowest bit."""
    mask = zero_map(model).christoffel.mask.ravel()
    padded = np.zeros(-(-mask.size // 64) * 64, bool)
    padded[: mask.size] = mask
    words = np.packbits(padded, bitorder="little").view("<u8")
    return [f"{word:#x}ULL" for word in words]


def _link_of(model: Model, frame: str) -> str:
    return {f.name: f.link for f in model.robot.frames}.get(frame, frame)
