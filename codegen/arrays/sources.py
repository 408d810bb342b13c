"""Equations -> a module of Python: a function per kernel, on NumPy's arrays or JAX's, whichever it is made for."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from eomgen._version import __version__
from eomgen.errors import InputError
from eomgen.names import show
from eomgen.robot.model import Model

from ..c.source import environment
from ..kernels.derived import METHODS
from ..kernels.equations import Equations, derive_equations
from ..kernels.groups import ARRAYS, kernel_group
from ..kernels.interface import drive_inputs
from ..kernels.signatures import CLOSED_PROGRAMS, KERNELS, available, shapes, signatures_of
from ..program.ir import Program
from .statements import write_statements

POSES = "Poses [R | X] of all frames in the base; eqs. (1) and (2)."


def render_arrays(model: Model, kernels: Sequence[str] = ()) -> str:
    """Render a model as text of a Python module that needs neither eomgen nor anything else.

    Args:
        kernels: names of KERNELS; those of ARRAYS that the model has if empty.

    Raises:
        InputError: a kernel is unknown, or no program: its C has loops or calls.
    """
    known = available(model)
    for name in kernels:
        if name not in KERNELS.compiled:
            raise InputError(f"kernels: {show(name)} is unknown; allowed: {', '.join(known)}")
    chosen = tuple(kernels) or kernel_group(model, ARRAYS)
    equations = derive_equations(model, chosen)
    functions = [_function(equations, name) for name in equations.kernels if name in chosen]
    h = write_statements(equations.setup, "h", len(equations.setup.outputs))
    context = {
        "name": model.name,
        "version": __version__,
        "coordinates": model.coordinates,
        "internal_states": model.internal_states,
        "inputs": drive_inputs(model),
        "links": model.links,
        "frames": model.frames,
        "parameters": {key: float(value) for key, value in model.parameters.items()},
        "n": len(model.coordinates),
        "sizes": {"z": len(model.internal_states), "forces": len(model.drives)},
        "setup": h,
        "functions": functions,
        "rolls": {*METHODS["explicit"][2]} <= {*chosen},
    }
    return environment().get_template("arrays/module.py.jinja").render(context)


def _function(equations: Equations, name: str) -> dict[str, Any]:
    """Return the names that the template uses of a kernel.

    Raises:
        InputError: it is no program.
    """
    model = equations.model
    program, reads, unread = _program(equations, name)
    of_frames = KERNELS[name].kind == "frames"
    shape = shapes(model, equations.kernels)["poses" if of_frames else KERNELS[name].writes]
    written = write_statements(program, "out", math.prod(shape))
    return {
        "name": "frame_poses" if of_frames else name,
        "text": POSES if of_frames else KERNELS[name].text,
        "reads": reads,
        "unread": unread,
        "shape": shape,
        **vars(written),
    }


def _program(equations: Equations, name: str) -> tuple[Program, tuple[str, ...], tuple[str, ...]]:
    """Return the program, the arrays that callers pass, and those that are zero."""
    known = signatures_of(equations.model)
    closed = CLOSED_PROGRAMS.get(name) if equations.model.constraints else None
    if closed is not None:
        reads, closed_reads = known[name].reads, known[closed].reads
        return equations.programs[closed], reads, tuple(array for array in closed_reads if array not in reads)
    if name not in equations.programs:
        raise InputError(f"kernels: {show(name)} is no program of arrays; allowed: kernels without loops or calls in C")
    return equations.programs[name], known[name].reads, ()
