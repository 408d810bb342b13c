"""Kernels as functions of CasADi, in C, with exact first and second derivatives; needs the extra "casadi".

CasADi finds them by name in the library of a function f: jac_f, adj1_f (weights times the Jacobian) and jac_adj1_f.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

from ..control.discrete_steps import DiscreteStep, kernels_for_step
from ..errors import BuildError, InputError
from ..kernel.complete import Kernel
from ..optional import optional_import
from ..pipeline import cache as store
from .external import external_library, step_library
from .mappings import FUNCTIONS, DifferentiableFunction, check_order, kernels_for


def function(
    kernel: Kernel,
    name: str,
    frame: str | None = None,
    *,
    cut: bool = False,
    order: int = 2,
    called: str | None = None,
    flags: Sequence[str] = (),
) -> Any:
    """Return a ``casadi.Function`` that calls the kernel's C, without Python and from any thread.

    Parameters are those that the kernel has now.  Inputs and outputs have the shapes of the kernel's arrays, vectors as
    columns; of mass_matrix only what does not vanish identically is stored.  Where the mass matrix cannot be inverted
    the evaluation fails (IPOPT shortens its step); NaN goes through.

    Args:
        kernel: of float64, with ``kernels_for(name)``.
        name: one of FUNCTIONS: "forward_dynamics", "residual", "mass_matrix", ...
        frame: of frame_pose and frame_jacobian.
        cut: of a robot with loops, that its loops are meant to be open.
        order: of the derivatives: 2, or 1 where compiling second ones takes too long.
        called: its name in CasADi; by default eom_ROBOT_NAME, and the frame's name behind it.
        flags: further flags of the compiler.

    Returns:
        casadi.Function with the inputs FUNCTIONS[name].reads; its attribute ``library`` is its shared library's path.

    Raises:
        UnknownNameError: no function or frame of that name, or a kernel that it takes was not built.
        InputError: CasADi is not installed, or another argument cannot be used.
        BuildError: no compiler, or a compiler that fails.
    """
    casadi = _imported()
    check_order(order)
    differentiable = DifferentiableFunction(kernel, name, frame, cut=cut)
    parts = ["eom", kernel.name, name, *([] if frame is None else [frame])]
    chosen = _chosen(kernel, parts, called)
    library = external_library(differentiable, chosen, flags, order)
    # one gradient by adj1, which has derivatives; more at once by the Jacobian
    options = {"jac_penalty": 1.5 / max(int(differentiable.patterns()[0].sum()), 1)} if order == 2 else {}
    return _external(casadi, library, chosen, options)


def step(
    kernel: Kernel,
    method: str = "rk4",
    *,
    dt: float,
    substeps: int = 1,
    drives: Sequence[str] | None = None,
    parameters: Sequence[str] = (),
    called: str | None = None,
    flags: Sequence[str] = (),
) -> Any:
    """Return a ``casadi.Function`` of the next state, x_next = F(x, u) or F(x, u, p), in C without Python.

    x is q, then v with internal states behind it; u acts on ``drives`` and is held over the step; p are ``parameters``,
    all others those that the kernel has now.  Derivatives of first order are exact for the steps taken, as those of
    ``kernel.rollout_sensitivity``: Jacobians, and products with their transposes.  Where the mass matrix cannot be
    inverted, or a mechanism does not close, the evaluation fails; NaN goes through.

    Args:
        kernel: of float64, with ``kernels_for_step(method)``.
        method: "rk4", "tsit5", "implicit" (linearly implicit Euler) or "rosenbrock", as of ``kernel.rollout``.
        dt: length of the step, s.
        substeps: equal ones that it is made of, under the same drives.
        drives: names of coordinates in the order of u; by default those that have drives.
        parameters: names of run-time parameters in the order of p.
        called: its name in CasADi; by default eom_ROBOT_METHOD_step.
        flags: further flags of the compiler.

    Returns:
        casadi.Function with the inputs x, u and, with parameters, p, and with ``library`` as that of ``function``.

    Raises:
        UnknownNameError: no such drive or parameter, or a kernel that it takes was not built.
        InputError: CasADi is not installed, joints have 3-DOF rotation, or another argument cannot be used.
        BuildError: no compiler, or a compiler that fails.
    """
    casadi = _imported()
    wanted = DiscreteStep(kernel, method, dt, substeps, drives, parameters)
    chosen = _chosen(kernel, ["eom", kernel.name, method, "step"], called)
    return _external(casadi, step_library(wanted, chosen, flags), chosen, {})


def _imported() -> Any:
    with optional_import("CasADi", "functions of CasADi need"):
        import casadi
    return casadi


def _external(casadi: Any, library: store.Entry, called: str, options: dict[str, float]) -> Any:
    """Open a library in its folder of the cache: saved functions and generated code name this path."""
    path = (library.folder / f"{called}.so").absolute()
    try:
        made = casadi.external(called, str(path), options)
    except RuntimeError as error:
        raise BuildError(
            f"the compiled library {path} does not load; set {store.VARIABLE} to a folder from which libraries can be"
            f" loaded: {error}"
        ) from None
    made.library = path
    return made


def _chosen(kernel: Kernel, parts: Sequence[str], called: str | None) -> str:
    """Return the name of a function in CasADi, ``called``, or one of parts."""
    chosen = re.sub(r"_+", "_", re.sub(r"\W", "_", "_".join(parts))).rstrip("_") if called is None else called
    if not re.fullmatch(r"[A-Za-z](_?[A-Za-z0-9])*", chosen) or chosen.startswith(f"{kernel.name}_"):
        raise InputError(
            f"called: {chosen!r} is no name for this function; allowed: letters, digits and single _ between them,"
            f" not beginning with {kernel.name}_"
        )
    return chosen


__all__ = ["FUNCTIONS", "function", "kernels_for", "kernels_for_step", "step"]
