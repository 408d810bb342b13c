"""Tables of the kernels that are methods, and of functions of the adapters, from the descriptors of kernels."""

from __future__ import annotations

from eomgen.adapters.mappings import CLOSED, FUNCTIONS
from eomgen.codegen.kernels.derived import FRAMED
from eomgen.codegen.kernels.entries import ARRAYS, DERIVED, Signature
from eomgen.codegen.kernels.signatures import KERNELS
from release.kernel_methods import public

CALLED = {"tangent": "jvp", "adjoint": "vjp", "hessian": "hessian", "jet": "jet"}  # methods that derive


def table() -> str:
    """Return a row per kernel: its call, shape and unit of its result, methods of its derivatives, what it computes."""
    rows = ["| kernel | result | derivatives | |", "|---|---|---|---|"]
    for name, signature in public():
        derived = "all" if signature.derivatives == DERIVED else ", ".join(CALLED[x] for x in signature.derivatives)
        call, result = f"{name}({_arguments(signature)})", _array(signature.writes)
        rows.append(f"| `{call}` | {result} | {derived} | {signature.text} |")
    return "\n".join(rows)


def arguments() -> str:
    """Return a row per argument of kernels: its shape, its unit, what it is."""
    read = dict.fromkeys(label for _, signature in public() for label in signature.reads)
    rows = [f"| `{label}` | {_array(label)} | {ARRAYS[label].text} |" for label in read]
    return "\n".join(["| argument | shape, unit | |", "|---|---|---|", *rows])


def _arguments(signature: Signature) -> str:
    framed = ["frame"] if signature.writes in ("pose", "jacobian") else []
    return ", ".join([*signature.reads, *framed, *(f"{option}=" for option in signature.takes)])


def _array(label: str) -> str:
    """Return the shape and the unit of an array in Python, n for the number of coordinates."""
    array = ARRAYS[label]
    axes = ", ".join("n" if axis in ("coordinates", "rates") else str(axis) for axis in array.axes)
    shape = f"({axes},)" if len(array.axes) == 1 else f"({axes})"
    return f"{shape}, {array.unit}" if array.unit else shape


def differentiable() -> str:
    """Return a row per function of the adapters: what it reads, and the kernel of its Jacobian."""
    rows = ["| name | of | Jacobian from |", "|---|---|---|"]
    for name, entry in FUNCTIONS.items():
        reads = ", ".join(entry.reads) + ("; a frame's name besides" if name in FRAMED else "")
        reads += "; robots with loops" if name not in FRAMED and KERNELS[name].needs == "constraints" else ""
        jacobian = f"`{entry.kernels[1]}`"
        if (closed := CLOSED.get(name)) and closed.kernels != entry.kernels:
            jacobian += f"; with loops `{closed.kernels[1]}`"
        rows.append(f"| `{name}` | {reads} | {jacobian} |")
    return "\n".join(rows)
