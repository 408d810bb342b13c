"""A kernel for other projects: names, header for C++17, CMake package, pkg-config file, MEX file for MATLAB.

From a package's metadata, without SymPy.
"""

from __future__ import annotations

import math
import re
import shlex
from collections.abc import Mapping, Sequence
from typing import Any

from eomgen._version import __version__

from ...kernels.signatures import BATCHES, Function, functions, signature_table
from ..library import included_files
from ..names import name_tables, safe
from ..scalar_types import SCALARS
from ..source import environment

BY_VALUE = 8192  # numbers that a function of C++ returns by value: they lie on the stack
IEEE = "-fno-fast-math"  # a whole project's -ffast-math would take NaN for a number
LEVELS = ("-O0", "-O1", "-O2", "-O3", "-Os", "-Og", "-Ofast", "-Oz")


def project_files(meta: Mapping[str, Any], header: str, flags: Sequence[str]) -> dict[str, str]:
    """Return names and texts of files that make a generated package a C and C++ project, beside its .h and .c.

    Args:
        meta: of ``metadata``, as in the package's .json.
        header: text of the package's .h.
        flags: of the compiler.
    """
    name = meta["name"]
    level = next((flag for flag in reversed(flags) if flag in LEVELS), "-O2")
    context = {
        "name": name,
        "version": __version__,
        "numeric_version": _numeric(__version__),
        "flags": quoted("SHELL:" + shlex.join([IEEE, *(flag for flag in flags if flag not in LEVELS)])),
        "level": level,
        "codes": [f"{name}.c", *([f"{name}_batch.c"] if BATCHES in meta["halves"] else [])],
        "library_headers": list(included_files(header)),
    }
    templates = {
        "CMakeLists.txt": "package/CMakeLists.txt.jinja",
        f"{name}Config.cmake": "package/Config.cmake.jinja",
        f"{name}.pc.in": "package/kernel.pc.in.jinja",
    }
    files = {file: environment().get_template(template).render(context) for file, template in templates.items()}
    for file, template in (
        (f"{name}.hpp", "package/kernel.hpp.jinja"),
        (f"{name}_mex.c", "package/kernel_mex.c.jinja"),
    ):
        files[file] = environment().get_template(template).render(_header_context(meta))
    return files


def _numeric(version: str) -> str:
    """Return the numbers of a version, all that CMake takes of it."""
    match = re.match(r"\d+(\.\d+){0,3}", version)
    return match[0] if match else "0"


def quoted(text: str) -> str:
    """Quote an argument of CMake."""
    return '"' + re.sub(r'([\\"$;])', r"\\\1", text) + '"'


def _header_context(meta: Mapping[str, Any]) -> dict[str, Any]:
    """Return names that the templates of the headers use."""
    name, scalar = meta["name"], SCALARS[meta["dtype"]]
    n, states, drives = (len(meta.get(x, ())) for x in ("coordinates", "internal_states", "inputs"))
    known = signature_table(states=bool(states), drives=bool(drives))
    public = functions(meta["kernels"], known)
    described = [_function(function, meta["shapes"]) for function in public if not function.is_rollout]
    return {
        "name": name,
        "space": safe(name),
        "prefix": name.upper(),
        "version": __version__,
        "dtype": meta["dtype"],
        "real": scalar.name,
        "n": n,
        "internal_states": states,
        "rates": n + states,
        "inputs": n + drives,
        "hoisted": max(meta["hoisted"], 1),
        "tables": name_tables(meta),
        "parameters": [(key, scalar.literal(value)) for key, value in meta["parameters"].items()],
        "functions": described,
        "most": max((max(len(x["reads"]), len(x["shape"])) for x in described), default=1),
        "rolls": any(function.is_rollout for function in public),
        "solving": any(function.signature.solves for function in public),
        "m": len(meta.get("constraints", ())),
        "statuses": meta.get("statuses", n),
    }


def _function(function: Function, shapes: Mapping[str, Sequence[int]]) -> dict[str, Any]:
    """Describe a function of the header for C++ and of the MEX file: names, views and shapes of its arrays."""
    signature, shape = function.signature, shapes[function.signature.writes]
    return {
        "name": function.name,
        "text": signature.text,
        "shape": shape,
        "reads": [{"name": x, "view": view(shapes[x]), "shape": shapes[x]} for x in signature.reads],
        "out": view(shape) + (", true" if signature.symmetric else ""),
        "size": math.prod(shape),
        "by_value": math.prod(shape) <= BY_VALUE,
        "solves": signature.solves,
        "is_framed": function.is_framed,
    }


def view(shape: Sequence[int]) -> str:
    """Return rows and columns of an array as arguments of a template: leading axes are rows of rows."""
    return str(shape[0]) if len(shape) == 1 else f"{math.prod(shape[:-1])}, {shape[-1]}"
