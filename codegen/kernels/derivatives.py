"""Derivatives of kernels as kernels of their own: their names, what they read and write; without SymPy.

Of a function f(x) of arrays x, and of the run-time parameters p:

- f_tangent: what f changes by along rates dx; f_parameter_tangent: along dp.
- f_adjoint: the gradient of w . f by x for weights w, a cotangent; f_parameter_adjoint: by x and p.
- f_hessian: the second derivatives of w . f by x.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

from .entries import Signature

Shape = tuple[int, ...]

RATES: Mapping[str, str] = {"q": "dq", "v": "dv", "a": "da", "u": "du", "wrench": "dwrench"}  # of what tangents move
PARAMETER_RATES = "dp"
WEIGHTS, GRADIENT, HESSIAN = "cotangent_", "gradient_", "hessian_"  # begin names of arrays
WITH_PARAMETERS = "_p"  # ends the name of a gradient that has the parameters behind the arrays
FRAMED: Mapping[str, str] = {"frame_pose": "poses", "frame_jacobian": "jacobians"}  # results of all frames at once
EXACT = (  # kernels that are derivatives of others already, and charts, which are not differentiated
    "christoffel",
    "following",
    "forward_dynamics_jacobian",
    "tree_forward_dynamics_jacobian",
)


def differentiated(kernels: Mapping[str, Signature]) -> dict[str, Signature]:
    """The derivatives of kernels by their names; of those that are called with a frame's number for all frames."""
    found: dict[str, Signature] = {}
    for name, kernel in kernels.items():
        if kernel.kind == "frames":
            for function, own in kernel.functions.items():
                found |= _of(function, replace(own, writes=FRAMED[function]))
        elif kernel.kind in ("program", "composed") and name not in EXACT:
            found |= _of(name, kernel)
    return found


def _of(name: str, kernel: Signature) -> dict[str, Signature]:
    """The derivatives of one function."""
    x, own = ", ".join(kernel.reads), "_".join(kernel.reads)
    rates, weighted = tuple(RATES[array] for array in kernel.reads), f"{name} along weights"
    none = Signature(kernel.reads, kernel.writes, "", derivative_of=name, needs=kernel.needs)
    tangent = replace(none, kind="tangent", reads=(*none.reads, *rates))
    along = replace(none, kind="tangent", reads=(*none.reads, PARAMETER_RATES), by_parameters=True)
    back = replace(none, reads=(*none.reads, f"{WEIGHTS}{kernel.writes}"), solves=kernel.solves)
    adjoint = replace(back, kind="adjoint", writes=f"{GRADIENT}{own}")
    whole = replace(adjoint, writes=f"{adjoint.writes}{WITH_PARAMETERS}", by_parameters=True)
    hessian = replace(back, kind="hessian", writes=f"{HESSIAN}{own}")
    return {
        f"{name}_tangent": replace(tangent, text=f"What {name} changes by along {', '.join(rates)}."),
        f"{name}_parameter_tangent": replace(along, text=f"What {name} changes by along rates of the parameters."),
        f"{name}_adjoint": replace(adjoint, text=f"Gradient by {x} of {weighted}."),
        f"{name}_parameter_adjoint": replace(whole, text=f"Gradient by {x} and the parameters of {weighted}."),
        f"{name}_hessian": replace(hessian, text=f"Second derivatives by {x} of {weighted}."),
    }


def derivative_shapes(
    kernels: Mapping[str, Signature], shapes: Mapping[str, Shape], parameters: int
) -> dict[str, Shape]:
    """Shapes of the arrays that derivatives read and write beside those of the kernels.

    Args:
        kernels: derivatives, as of ``differentiated``.
        shapes: of the arrays of the kernels that they are of.
        parameters: number of run-time parameters.
    """
    found: dict[str, Shape] = {}
    known = {RATES[array]: shapes[array] for array in RATES} | {WEIGHTS + array: shapes[array] for array in shapes}
    if parameters:
        known[PARAMETER_RATES] = (parameters,)
    for kernel in kernels.values():
        found |= {array: known[array] for array in kernel.reads if array in known}
        if kernel.kind in ("adjoint", "hessian") and all(array in shapes for array in kernel.reads[:-1]):
            size = sum(math.prod(shapes[array]) for array in kernel.reads[:-1])
            found[kernel.writes] = (
                (size, size) if kernel.kind == "hessian" else (size + (parameters if kernel.by_parameters else 0),)
            )
    return found


def is_direction(array: str) -> bool:
    """Whether an array holds rates or weights, along which a derivative is taken."""
    return array.startswith(WEIGHTS) or array == PARAMETER_RATES or array in RATES.values()
