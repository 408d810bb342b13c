"""Equations -> Source: programs as C.  Python decides here, templates hold the C.

Every program is written twice: on numbers, and on vectors with one state in every lane, unless there is to be no SIMD.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from ..kernels.equations import Equations
from .contexts import header_context, lane_context, number_context
from .library import library_types
from .metadata import json_text, kernel_metadata
from .scalar_types import Constants
from .source import Source, environment
from .wrapping import wrapped

CONSTANTS = "/* constants */\n"  # a line of templates/kernel/opening.c.jinja
NOTES = {  # in front of the constants, by a word in their comments
    "": "Numbers of the description, and what comes of them.",
    "integral": "phi1: deflection by mode 1; psi12: second derivative by modes 1 and 2; x, y, z: the place at rest.",
    "Chebyshev": "A coefficient i is the factor of T_i(2 s / length - 1), with s from the root of the beam.",
}
DECLARATIONS = "kernel/declarations.jinja"


def render(equations: Equations, *, batches: bool = True, scalar: bool = False, libm: bool = False) -> Source:
    """Render equations as C.

    Args:
        batches: with the functions for several states in one call.
        scalar: without SIMD: these call the functions for one state, in the same file.
        libm: sines and cosines of the C library.
    """
    meta = kernel_metadata(equations, batches=batches, scalar=scalar)
    names = header_context(equations, meta, batches)
    constants = Constants()
    context = {**names, **number_context(equations, meta, constants), "without_simd": scalar, "libm": libm}
    header = wrapped(_fill("kernel/kernel.h.jinja", names))
    context["opening"] = _fill("kernel/opening.c.jinja", context)
    code, batch_code = _with_constants(_fill("kernel/kernel.c.jinja", context), constants), ""
    if batches and not scalar:
        batch_code = _fill("kernel/batches.c.jinja", {**context, **lane_context(equations, constants)})
        batch_code = _with_constants(batch_code, constants)
    types = library_types(equations.dtype) if names["rolls"] or names["adapts"] or names["gradients"] else ""
    cdefs = {
        half: types + _fill(DECLARATIONS, {**names, "declared": declared}) for half, declared in meta["halves"].items()
    }
    lengths = [len(program.instructions) for program in equations.programs.values()]
    text = json_text(meta) + "\n"
    cdef, longest = types + _fill(DECLARATIONS, names), max(lengths, default=0)
    return Source(equations.model.name, header, code, batch_code, cdef, text, sum(lengths), longest, cdefs)


def _with_constants(code: str, constants: Constants) -> str:
    """Put definitions of the constants that code uses behind what it includes."""
    defined = constants.definitions(code)
    notes = [text for word, text in NOTES.items() if word in defined]
    opening = f"\n/* {' '.join(notes)} */\n" if defined else ""
    return _tidy(code.replace(CONSTANTS, f"{opening}{defined}", 1))


def _tidy(code: str) -> str:
    """Remove the empty lines that macros leave behind, and break long ones."""
    code = re.sub(r"\n{3,}", "\n\n", code)
    return wrapped(re.sub(r"(?<=\n{\n)\n", "", code.replace("\n\n}", "\n}")))


def _fill(template: str, context: Mapping[str, Any]) -> str:
    """Fill a template; a name that the context does not have is a bug, which tests look for."""
    return environment().get_template(template).render(context)
