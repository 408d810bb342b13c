"""Model -> SimtSource: device source code of kernels, and the metadata that host programs read."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from eomgen._version import __version__
from eomgen.errors import InputError
from eomgen.names import show
from eomgen.robot.model import Model

from ..c.contexts import OPEN_GAPS, PIVOT_LIMITS
from ..c.functions import COEFFICIENTS, device_functions, sine_constants
from ..c.scalar_types import SCALARS, Scalar
from ..c.source import environment
from ..kernels.signatures import DTYPES
from ..program.ir import Program
from ..program.operations import OPERATIONS, Operations
from .kernels import CONTROLLED, ROLLOUTS, ThreadKernel, ThreadKernels, derive_kernels
from .parts import Part, split_columns
from .registers import PLACES, scheduled
from .setup import setup_values
from .statements import PIVOTS, STATUS, Writer

TILE = 32  # states of a tile: threads that go together on most accelerators
STATE = ("q", "v", "z", "out")  # arrays whose numbers a thread keeps from step to step
FORCES = ("u", "added")  # and those that a controller makes in every step
BESIDE = {  # numbers per coordinate that it keeps beside a step's values, and half as many per internal state
    "rk4_rollout": 6,
    "implicit_rollout": 2,
    "rk4_pd_rollout": 7,
    "implicit_pd_rollout": 4,
}
LEAST = 16  # values that have room all the same
NUMBERS = {"zero": 0.0, "half": 0.5, "one": 1.0, "two": 2.0, "six": 6.0}
SCALAR_TYPES = {"step": "real", "steps": "int"}
CONTRACTION: Mapping[str, Mapping[bool, str]] = {  # what compilers are told, by whether products and sums may be one
    "cuda": {False: "--fmad=false", True: "--fmad=true"},
    "hip": {False: "-ffp-contract=off", True: "-ffp-contract=fast"},
    "c": {False: "-ffp-contract=off", True: "-ffp-contract=fast"},
    "opencl": {False: "-DEOM_CONTRACT=0", True: "-DEOM_CONTRACT=1"},
}
TILES = (1, 2, 4, 8, 16, 32, 64, 128, 256)


@dataclass(frozen=True)
class SimtSource:
    """Device source ``code``, and its metadata ``meta`` as JSON."""

    name: str
    code: str
    meta: str

    @property
    def files(self) -> dict[str, str]:
        """Texts by the names of their files."""
        return {f"{self.name}_simt.h": self.code, f"{self.name}_simt.json": self.meta}


Plans = Sequence[tuple[ThreadKernel, tuple[Part, ...]]]


def render_simt(
    model: Model,
    kernels: Sequence[str] = (),
    dtype: str = "float64",
    tile: int = TILE,
    *,
    contract: bool = False,
) -> SimtSource:
    """Render kernels of a model as one text that is CUDA, HIP, OpenCL C, C99 and C++.

    Args:
        kernels: names of kernels, those of FRAMES and ROLLOUTS among them; those of DEFAULT if empty.
        dtype: "float64" or "float32".
        tile: states whose numbers stand side by side, a power of two.
        contract: let products and sums be one operation, unless a compiler is told otherwise.

    Raises:
        InputError, UnknownNameError: a kernel, dtype, tile or contract is unknown; a kernel is none of straight
            statements; or a number of the description is too large for the dtype.
    """
    if dtype not in DTYPES:
        raise InputError(f"dtype: {show(dtype)} is unknown; allowed: {', '.join(DTYPES)}")
    if isinstance(tile, bool) or tile not in TILES:
        raise InputError(f"tile: {show(tile)}; allowed: {', '.join(map(str, TILES))}")
    if not isinstance(contract, bool):
        raise InputError(f"contract: {show(contract)}; allowed: True or False")
    derived, scalar = derive_kernels(model, kernels, dtype), SCALARS[dtype]
    plans = [(kernel, _parts(kernel, model, dtype)) for kernel in derived.kernels]
    said = {
        "name": model.name,
        "dtype": dtype,
        "tile": tile,
        "flags": {language: told[contract] for language, told in CONTRACTION.items()},
    }
    described = [part for kernel, parts in plans for part in _kernel(model, kernel, parts, scalar)]
    context = _context(said, described, contract=contract)
    return SimtSource(
        model.name,
        environment().get_template("simt/kernels.h.jinja").render(context),
        json.dumps({**said, "contract": contract, **_metadata(model, derived, plans, dtype)}, indent=1) + "\n",
    )


def _context(
    said: Mapping[str, Any],
    kernels: Sequence[Mapping[str, Any]],
    operations: Operations = OPERATIONS,
    *,
    contract: bool = False,
) -> dict[str, Any]:
    """Return the names that templates use of a text with these kernels."""
    dtype = said["dtype"]
    scalar = SCALARS[dtype]
    return {
        **said,
        "version": __version__,
        "is_double": int(dtype == "float64"),
        "contract": int(contract),
        "sines": sine_constants(dtype),
        "functions": device_functions(operations, scalar),
        **{word: scalar.literal(number) for word, number in NUMBERS.items()},
        "vanished": scalar.literal(PIVOT_LIMITS[dtype]),
        "open": scalar.literal(OPEN_GAPS[dtype]),
        "far": STATUS["far"],
        "kernels": kernels,
    }


def _metadata(model: Model, derived: ThreadKernels, plans: Plans, dtype: str) -> dict[str, Any]:
    """Return what host programs read of the device source, for JSON."""
    setup, parameters = _setup(derived.setup), {key: float(value) for key, value in model.parameters.items()}
    h = setup_values(setup, [*parameters.values(), *[0.0] * len(model.turning)], np.dtype(dtype))
    return {
        "generator": f"eomgen {__version__}",
        "coordinates": list(model.coordinates),
        "internal_states": list(model.internal_states),
        "links": list(model.links),
        "frames": list(model.frames),
        "parameters": parameters,
        "charts": len(model.turning),
        "setup": setup,
        "h": h.tolist(),
        "status": {"pivots": PIVOTS, **STATUS},
        "farthest": COEFFICIENTS[dtype].farthest,
        "kernels": {kernel.name: _described(model, kernel, parts) for kernel, parts in plans},
    }


def _parts(kernel: ThreadKernel, model: Model, dtype: str) -> tuple[Part, ...]:
    """Choose orders of a kernel's statements; in steps a state and what is added up of it stay beside the values."""
    places = PLACES[dtype]
    if kernel.name in ROLLOUTS:
        kept = BESIDE[kernel.name] * len(model.coordinates) + BESIDE[kernel.name] // 2 * len(model.internal_states)
        places = replace(places, room=max(places.room - kept, LEAST))
    if kernel.has_columns:
        return split_columns(kernel.program, kernel.writes["out"][-1], places)
    return ((kernel.program, scheduled(kernel.program, places)),)


def _functions(model: Model, kernel: ThreadKernel, parts: Sequence[Part]) -> list[str]:
    """Name the functions of the text that a kernel consists of."""
    name = f"{model.name}_{kernel.name}"
    return [name] if len(parts) == 1 else [f"{name}_{number}" for number in range(len(parts))]


def _kernel(model: Model, kernel: ThreadKernel, parts: Sequence[Part], scalar: Scalar) -> list[dict[str, Any]]:
    """Return the names that the template uses of a kernel's parts."""
    is_controlled = kernel.name in CONTROLLED
    local = (*STATE, *(FORCES if is_controlled else ())) if kernel.name in ROLLOUTS else ()
    common = {
        "text": kernel.text,
        "reads": {array: math.prod(shape) for array, shape in kernel.reads.items()},
        "writes": {array: math.prod(shape) for array, shape in kernel.writes.items()},
        "scalars": [(SCALAR_TYPES[name], name) for name in kernel.scalars],
        "n": len(model.coordinates),
        "states": len(model.internal_states),
        "method": kernel.name.partition("_")[0] if kernel.name in ROLLOUTS else "",
        "controlled": list(enumerate(model.driven)) if is_controlled else [],
    }
    described: list[dict[str, Any]] = []
    for name, (program, plan) in zip(_functions(model, kernel, parts), parts, strict=True):
        writer = Writer(program, plan, scalar, constraints=len(model.constraints), local=local)
        described.append({**common, "name": name, "lines": list(writer.lines()), "is_first": not described})
    return described


def _described(model: Model, kernel: ThreadKernel, parts: Sequence[Part]) -> dict[str, Any]:
    """Describe a kernel for host programs: arguments in their order, shapes, and what the model of registers says."""
    return {
        "functions": _functions(model, kernel, parts),
        "text": kernel.text,
        "arguments": ["count", "h", *kernel.scalars, *kernel.reads, *kernel.writes, "status"],
        "scalars": {name: SCALAR_TYPES[name] for name in kernel.scalars},
        "reads": {array: list(shape) for array, shape in kernel.reads.items()},
        "writes": {array: list(shape) for array, shape in kernel.writes.items()},
        "operations": [program.count() for program, _ in parts],
        "registers": [
            {
                "order": plan.order,
                "alive": plan.alive,
                "room": plan.places.room,
                "stores": plan.stores,
                "loads": plan.loads,
                "sines_again": plan.sines_again,
            }
            for _, plan in parts
        ],
    }


def _setup(setup: Program) -> dict[str, Any]:
    """Return the program that computes h as data: [operation, arguments...], parameters and numbers by themselves."""
    values = [
        ["p", leaf[1]] if op == "input" else [op, leaf] if op == "const" else [op, *args]
        for op, args, leaf in setup.instructions
    ]
    return {"values": values, "h": [setup.outputs["h", slot] for slot in range(len(setup.outputs))]}
