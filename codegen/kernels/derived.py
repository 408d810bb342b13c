"""Derivatives of kernels as further kernels: their names, what they read and write; without SymPy.

Of a function f(x) of arrays x, and of the run-time parameters p:

- f_tangent: what f changes by along rates dx; in C "f_tangent", and "f_parameter_tangent" along dp.
- f_adjoint: derivatives of w . f for weights w, a cotangent; in C "f_adjoint", the gradient by x,
  "f_parameter_adjoint", by x and p, and of some functions "f_hessian", the second derivatives by x.
- f_jet: f and its time derivatives up to an order along a motion, given by the time derivatives of q and others; in C
  "f_jet1" to "f_jet4".
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

from .entries import Signature

Shape = tuple[int, ...]

RATES: Mapping[str, str] = {x: f"d{x}" for x in ("q", "v", "z", "a", "u", "forces", "wrench")}  # of what tangents move
OTHERS = ("z", "u", "forces", "wrench")  # arrays with time derivatives of their own in jets
PARAMETER_RATES = "dp"
MOTION = ("q", "v", "a", "jerk", "snap", "crackle", "pop")  # time derivatives of coordinates, by their order
ORDERS = (1, 2, 3, 4)  # of jets
WEIGHTS, GRADIENT, HESSIAN = "cotangent_", "gradient_", "hessian_"  # begin names of arrays
WITH_PARAMETERS = "_p"  # ends the name of a gradient that has the parameters behind the arrays
JET = "jet"  # begins the name of an array of time derivatives, before the order
FRAMED: Mapping[str, str] = {"frame_pose": "poses", "frame_jacobian": "jacobians"}  # results of all frames at once
TIMES = ("dt", "times")  # arrays that steps are not differentiated by


def differentiated(kernels: Mapping[str, Signature]) -> dict[str, Signature]:
    """Return derivatives of kernels by their names; of those that are called with a frame's number for all frames."""
    derivatives: dict[str, Signature] = {}
    for name, kernel in kernels.items():
        if kernel.kind == "frames":
            for function, signature in kernel.functions.items():
                derivatives |= _of(function, replace(signature, writes=FRAMED[function]))
        elif kernel.kind in ("program", "composed"):
            derivatives |= _of(name, kernel)
    return derivatives


def _of(name: str, kernel: Signature) -> dict[str, Signature]:
    """Return the derivatives that there are of one function, each with the functions of C that its arguments choose."""
    made = {"jet": _jets, "tangent": _tangents, "adjoint": _adjoints}
    return {
        f"{name}_{kind}": replace(next(iter(variants.values())), variants=variants)
        for kind, variants in ((kind, made[kind](name, kernel)) for kind in made if kind in kernel.derivatives)
    }


def _none(name: str, kernel: Signature) -> Signature:
    """Return what the derivatives of a function have in common."""
    return Signature(kernel.reads, kernel.writes, "", derivative_of=name, needs=kernel.needs, solves=kernel.solves)


def _tangents(name: str, kernel: Signature) -> dict[str, Signature]:
    """Return what a function changes by along rates of its arrays, and along those of the parameters."""
    none, rates = _none(name, kernel), tuple(RATES[array] for array in kernel.reads)
    tangent = replace(none, kind="tangent", reads=(*none.reads, *rates))
    along = replace(none, kind="tangent", reads=(*none.reads, PARAMETER_RATES), by_parameters=True)
    return {
        f"{name}_tangent": replace(tangent, text=f"Derivative of {name} along {', '.join(rates)}."),
        f"{name}_parameter_tangent": replace(along, text=f"Derivative of {name} along rates of the parameters."),
    }


def _adjoints(name: str, kernel: Signature) -> dict[str, Signature]:
    """Return derivatives of a function along weights: the gradient, that by parameters as well, and the second ones."""
    x, arrays, weighted = ", ".join(kernel.reads), "_".join(kernel.reads), f"{name} along weights"
    back = replace(_none(name, kernel), reads=(*kernel.reads, f"{WEIGHTS}{kernel.writes}"))
    adjoint = replace(back, kind="adjoint", writes=f"{GRADIENT}{arrays}")
    whole = replace(adjoint, writes=f"{adjoint.writes}{WITH_PARAMETERS}", by_parameters=True)
    adjoints = {
        f"{name}_adjoint": replace(adjoint, text=f"Gradient by {x} of {weighted}."),
        f"{name}_parameter_adjoint": replace(whole, text=f"Gradient by {x} and the parameters of {weighted}."),
    }
    if "hessian" in kernel.derivatives:
        hessian = replace(back, kind="hessian", writes=f"{HESSIAN}{arrays}")
        adjoints[f"{name}_hessian"] = replace(hessian, text=f"Second derivatives by {x} of {weighted}.")
    return adjoints


def _jets(name: str, kernel: Signature) -> dict[str, Signature]:
    """Return a function's time derivatives along motions, by their orders."""
    none = replace(_none(name, kernel), kind="jet")
    jets = {}
    for order in ORDERS:
        series = jet_series(kernel.reads, order)
        moving = MOTION[: 1 + max(MOTION.index(x) for names in series.values() for x in names if x in MOTION)]
        others = [x for names in series.values() for x in names if x not in MOTION]
        text = f"Time derivatives of {name} up to order {order}, that of order 0 first."
        jets[f"{name}_jet{order}"] = replace(
            none, reads=(*moving, *others), writes=f"{JET}{order}_{kernel.writes}", text=text, order=order
        )
    return jets


def jet_series(reads: Sequence[str], order: int) -> dict[str, tuple[str, ...]]:
    """Return, per array that a function reads, the arrays of its time derivatives, that of order 0 first."""
    return {
        array: MOTION[MOTION.index(array) :][: order + 1]
        if array in MOTION
        else (array, *(f"{array}{k}" for k in range(1, order + 1)))
        for array in reads
    }


def _steps(text: str, of: str, calls: tuple[str, ...], ending: str) -> Signature:
    """Describe steps that call programs and, by the ending of their names, derivatives of these."""
    derivatives = tuple(f"{name}_{ending}" for name in calls)
    closed = tuple("constrained_dynamics" if name == "forward_dynamics" else name for name in calls)
    return Signature(
        ("q", "v", "u"),
        "rate_vector",
        text,
        "gradient",
        calls=(*calls, *derivatives),
        counts=derivatives,
        closed=(*closed, *derivatives, "settling", f"settling_{ending}"),
        derivative_of=of,
        solves=True,
        vectors=False,
    )


def _along(of: str, writes: str, reads: tuple[str, ...], *moving: str) -> Signature:
    """Describe rates of a program's results along those of arrays and of the parameters."""
    return Signature(
        (*reads, *(f"d{array}" for array in moving), PARAMETER_RATES),
        writes,
        f"Derivative of {of} along {', '.join(f'd{array}' for array in moving)} and rates of the parameters.",
        "tangent",
        derivative_of=of,
        by_parameters=True,
        states="v" in reads,
    )


def _back(of: str, writes: str, reads: tuple[str, ...], weights: str) -> Signature:
    """Describe the gradient of a program's results along weights by arrays, but for times, and by parameters."""
    arrays = ", ".join(array for array in reads if array not in TIMES)
    return Signature(
        (*reads, weights),
        writes,
        f"Gradient by {arrays} and the parameters of {of} along weights.",
        "adjoint",
        derivative_of=of,
        by_parameters=True,
        states="v" in reads,
    )


METHODS: Mapping[str, tuple[str, str, tuple[str, ...]]] = {  # in words, kernels, programs
    "explicit": ("explicit methods", "rollout", ("forward_dynamics",)),
    "implicit": ("the linearly implicit method", "rollout", ("implicit_step",)),
    "rosenbrock": (
        "the Rosenbrock method",
        "adaptive_rollout",
        ("forward_dynamics", "stage_factors", "stage_solution"),
    ),
}
GRADIENTS: Mapping[str, Signature] = {
    f"{way}_gradient": _steps(
        f"Derivatives of a sum over the states of steps by {method}.", of, calls, "parameter_adjoint"
    )
    for way, (method, of, calls) in METHODS.items()
} | {
    f"{way}_sensitivity": _steps(
        f"States of steps by {method} and their derivatives along directions.", of, calls, "along"
    )
    for way, (method, of, calls) in METHODS.items()
}
BACKWARDS: Mapping[str, Signature] = {  # programs that only gradients and sensitivities call
    "forward_dynamics_along": _along("forward_dynamics", "rate_vector", ("q", "v", "u"), "q", "v", "u"),
    "settling_along": _along("settling", "settling", ("q", "v"), "q", "v"),
    "implicit_step_along": _along("implicit_step", "rate_vector", ("q", "v", "u", "added", "dt"), "q", "v", "u"),
    "stage_factors_along": _along("stage_factors", "kept", ("q", "v", "kp", "kd", "times"), "q", "v"),
    "stage_solution_along": _along(
        "stage_solution", "rate_vector", ("kept", "rates", "shifts"), "kept", "rates", "shifts"
    ),
    "implicit_step_parameter_adjoint": _back(
        "implicit_step", "gradient_of_step", ("q", "v", "u", "added", "dt"), "cotangent_rate_vector"
    ),
    "stage_factors_parameter_adjoint": _back(
        "stage_factors", "gradient_of_factors", ("q", "v", "kp", "kd", "times"), "cotangent_kept"
    ),
    "stage_solution_parameter_adjoint": _back(
        "stage_solution", "gradient_of_solution", ("kept", "rates", "shifts"), "cotangent_rate_vector"
    ),
}


def derivative_shapes(
    kernels: Mapping[str, Signature], shapes: Mapping[str, Shape], parameters: int
) -> dict[str, Shape]:
    """Return shapes of what derivatives, as of ``differentiated``, read and write beside arrays of these shapes."""
    table: dict[str, Shape] = {}
    known = dict.fromkeys(MOTION[3:], shapes["q"])
    known |= {f"{array}{k}": shapes[array] for array in OTHERS if array in shapes for k in ORDERS}
    known |= {rate: shapes[array] for array, rate in RATES.items() if array in shapes}
    known |= {WEIGHTS + array: shapes[array] for array in shapes}
    if parameters:
        known[PARAMETER_RATES] = (parameters,)
    for kernel in kernels.values():
        table |= {array: known[array] for array in kernel.reads if array in known}
        written = kernel.writes.removeprefix(f"{JET}{kernel.order}_")
        if kernel.kind == "jet" and written in shapes:
            table[kernel.writes] = (kernel.order + 1, *shapes[written])
        if kernel.kind in ("adjoint", "hessian") and all(array in shapes for array in kernel.reads[:-1]):
            size = sum(math.prod(shapes[array]) for array in kernel.reads[:-1])
            table[kernel.writes] = (
                (size, size) if kernel.kind == "hessian" else (size + (parameters if kernel.by_parameters else 0),)
            )
    return table
