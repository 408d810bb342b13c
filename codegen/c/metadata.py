"""Metadata of a package, NAME.json: all that Python and headers of other languages need to know of its kernels."""

from __future__ import annotations

import json
from collections.abc import Iterable
from typing import Any

import numpy as np

from eomgen.robot.model import Model

from ..joint.zeros import zero_map
from ..kernels.constraint_rows import is_redundant
from ..kernels.equations import Equations
from ..kernels.interface import inertial_parameters
from ..kernels.signatures import KERNELS, SIGNATURES
from ..kernels.steps.tolerances import coordinate_sizes, rubbing_parameters
from .contexts import kept_of_a_step, statuses
from .lanes import functions_of_libraries
from .operation_counts import operations

WIDTH = 120  # of lines


def kernel_metadata(equations: Equations, *, batches: bool = True, scalar: bool = False) -> dict[str, Any]:
    """Return plain values for JSON: the interface of the equations, operations, zeros, functions of both libraries."""
    model, mapped = equations.model, any(KERNELS[name].mapped for name in equations.kernels)
    kept = {name: number for name, number in kept_of_a_step(model).items() if name in equations.kernels}
    return {
        **equations.interface,
        "hoisted": len(equations.setup.outputs),
        "operations": operations(equations),
        "survivors": survivors(model) if mapped else {},
        "halves": functions_of_libraries(equations, batches=batches, scalar=scalar),
        **({"statuses": statuses(model)} if model.constraints else {}),
        **(_tolerances(model) if any(KERNELS[name].kind == "adaptive" for name in equations.kernels) else {}),
        **({"kept": kept} if kept else {}),
        **({"inertial": inertial_parameters(model)} if "regressor" in _written(equations.kernels) else {}),
        **({"redundant": is_redundant(model)} if "settling" in _written(equations.programs) else {}),
    }


def json_text(value: Any, indent: int = 0, before: int = 0) -> str:
    """Return JSON in which everything that fits on a line stands on one."""
    flat = json.dumps(value)
    if len(flat) + indent + before < WIDTH or not isinstance(value, (dict, list)):
        return flat
    margin, (begin, end) = " " * (indent + 1), "{}" if isinstance(value, dict) else "[]"
    keys = [f"{json.dumps(key)}: " for key in value] if isinstance(value, dict) else [""] * len(value)
    values = value.values() if isinstance(value, dict) else value
    lines = [f"{margin}{key}{json_text(x, indent + 1, len(key))}" for key, x in zip(keys, values, strict=True)]
    return f"{begin}\n" + ",\n".join(lines) + f"\n{margin[1:]}{end}"


def _written(names: Iterable[str]) -> set[str]:
    """Return the arrays that kernels or programs write."""
    return {SIGNATURES[name].writes for name in names}


def _tolerances(model: Model) -> dict[str, Any]:
    """Return what tolerances refer to: sizes of coordinates, then of rates; and rates that frictions turn round in."""
    return {"sizes": np.concatenate(coordinate_sizes(model)).tolist(), "rubbing": rubbing_parameters(model)}


def survivors(model: Model) -> dict[str, list[str]]:
    """Encode entries that do not vanish identically: bits as hexadecimal digits, the first in the highest bit.

    By array a text per coordinate s: of M_sv the bits of all v, of C_s,vw those of all v <= w, row by row.
    """
    zeros = zero_map(model)
    v, w = np.triu_indices(len(model.coordinates))
    rows = {"matrix": zeros.mass_matrix.mask, "tensor": zeros.christoffel.mask[:, v, w]}
    return {name: [np.packbits(row).tobytes().hex() for row in array] for name, array in rows.items()}
