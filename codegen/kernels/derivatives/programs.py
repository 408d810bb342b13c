"""Derivatives of kernels: the program of an entry of DERIVATIVES from that of the function that it differentiates."""

from __future__ import annotations

import math

from eomgen.errors import InputError
from eomgen.robot.model import Model

from ...program.forward_mode import tangent
from ...program.ir import Program
from ...program.passes import PARAMETERS, run_passes
from ...program.reverse_mode import adjoint, hessian
from ...program.taylor import jet
from ...solve.factorised import solve_operations
from ..derived import PARAMETER_RATES, RATES, TIMES, jet_series
from ..signatures import SIGNATURES, shapes, signatures_of
from .whole import Derive, whole_program

# Of a matrix or tensor that C computes in loops, of which programs of time derivatives are made
MOST_OPERATIONS = 12000


def derive_derivative(model: Model, kernel: str, derive: Derive) -> Program:
    """Derive the program of one entry of DERIVATIVES; ``derive`` gives that of any entry of the tables."""
    signature, size = signatures_of(model)[kernel], shapes(model)
    if signature.kind == "tangent":
        rates = {array: f"d{array}" for array in signature.reads if f"d{array}" in signature.reads}
        rates |= {PARAMETERS: PARAMETER_RATES} if signature.by_parameters else {}
        program = whole_program(model, signature.derivative_of, derive)
        return run_passes(tangent(program, rates, kernel, {PARAMETERS: len(model.parameters)}))
    if signature.kind == "jet":
        _check_length(model, kernel, derive)
        series = jet_series(sorted(RATES), signature.order)
        return run_passes(jet(whole_program(model, signature.derivative_of, derive), series, signature.order, kernel))
    *reads, weights = signature.reads
    if "kept" in reads:
        size["kept"] = (sum(key[0] == "out" for key in derive("stage_factors").outputs),)
    wanted = {array: math.prod(size[array]) for array in reads if array not in TIMES}
    if signature.by_parameters:
        wanted[PARAMETERS] = len(model.parameters)
    if signature.kind == "hessian":
        return run_passes(hessian(derive(f"{signature.derivative_of}_adjoint"), wanted, kernel))
    return run_passes(adjoint(whole_program(model, signature.derivative_of, derive), weights, wanted, kernel))


def _check_length(model: Model, kernel: str, derive: Derive) -> None:
    """Refuse time derivatives of what takes loops in C where a program of it would be too long.

    Raises:
        InputError: it would be.
    """
    function = SIGNATURES[kernel].derivative_of
    if function == "christoffel":
        operations = len(model.coordinates) * sum(derive("coriolis_matrix").count().values())
    elif function.endswith("forward_dynamics_jacobian"):
        is_closed = bool(model.constraints) and function == "forward_dynamics_jacobian"
        whole = "constrained_dynamics" if is_closed else function.removesuffix("_jacobian")
        dense = model.size * sum(derive(whole).count().values())
        operations = dense if is_closed or model.followers else sum(solve_operations(model).values())
    else:
        return
    if operations > MOST_OPERATIONS:
        raise InputError(
            f"{kernel}: {function} of {model.name} takes some {operations} operations; allowed: {MOST_OPERATIONS},"
            " of which a program of time derivatives can be written out"
        )
