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

from ..kernels.signatures import BATCHES, Function, functions, signature_table
from .library import public_headers
from .scalar_types import SCALARS
from .source import environment

BY_VALUE = 8192  # numbers that a function of C++ returns by value: they lie on the stack
IEEE = "-fno-fast-math"  # a whole project's -ffast-math would take NaN for a number
LEVELS = ("-O0", "-O1", "-O2", "-O3", "-Os", "-Og", "-Ofast", "-Oz")

# Keywords up to C++23, alternative operators, std, and macros that compilers or common headers define in small letters.
TAKEN = frozenset(
    """
    alignas alignof and and_eq asm auto bitand bitor bool break case catch char char8_t char16_t char32_t class compl
    concept const consteval constexpr constinit const_cast continue co_await co_return co_yield decltype default delete
    do double dynamic_cast else enum explicit export extern false float for friend goto if inline int long mutable
    namespace new noexcept not not_eq nullptr operator or or_eq private protected public register reinterpret_cast
    requires return short signed sizeof static static_assert static_cast struct switch template this thread_local throw
    true try typedef typeid typename union unsigned using virtual void volatile wchar_t while xor xor_eq
    std posix linux unix i386 assert errno stdin stdout stderr complex imaginary near far small interface major minor
    emit signals slots foreach NULL EOF TRUE FALSE NAN INFINITY OVERFLOW UNDERFLOW DOMAIN SING I
    """.split()  # noqa: SIM905
)


def project_files(meta: Mapping[str, Any], flags: Sequence[str]) -> dict[str, str]:
    """Return names and texts of files that make a generated package a C and C++ project, beside its .h and .c.

    Args:
        meta: of ``metadata``, as in the package's .json.
    """
    name = meta["name"]
    level = next((flag for flag in reversed(flags) if flag in LEVELS), "-O2")
    context = {
        "name": name,
        "version": __version__,
        "numeric_version": _numeric(__version__),
        "flags": quoted("SHELL:" + shlex.join([IEEE, *(flag for flag in flags if flag not in LEVELS)])),
        "level": level,
        "library_headers": public_headers(),
        "sources": [f"{name}.c", *([f"{name}_batch.c"] if BATCHES in meta["halves"] else [])],
    }
    templates = {
        "CMakeLists.txt": "package/CMakeLists.txt.jinja",
        f"{name}Config.cmake": "package/Config.cmake.jinja",
        f"{name}.pc.in": "package/kernel.pc.in.jinja",
    }
    files = {file: environment().get_template(template).render(context) for file, template in templates.items()}
    for file, template in (
        (f"{name}_names.h", "package/kernel_names.h.jinja"),
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
        "tables": _tables(meta),
        "parameters": [(key, scalar.literal(value)) for key, value in meta["parameters"].items()],
        "functions": described,
        "most": max((max(len(x["reads"]), len(x["shape"])) for x in described), default=1),
        "rolls": any(function.is_rollout for function in public),
        "solving": any(function.signature.solves for function in public),
        "m": len(meta.get("constraints", ())),
        "statuses": meta.get("statuses", n),
    }


def _tables(meta: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return tables of names by which arrays are numbered, with identifiers; frames' numbers have a separate type."""
    names = {key: meta[f"{key}s"] for key in ("coordinate", "joint", "link", "frame", "parameter")}
    names |= {key: meta[f"{key}s"] for key in ("spring", "constraint") if f"{key}s" in meta}
    names |= {"state": meta["internal_states"]} if "internal_states" in meta else {}
    return [{"key": key, "names": identifiers(list(x)), "has_type": key == "frame"} for key, x in names.items()]


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


def safe(name: str) -> str:
    """Return the name, with _ behind it where it is a word of C++."""
    return f"{name}_" if name in TAKEN else name


def identifiers(names: Sequence[str]) -> list[tuple[str, str]]:
    """Pair each name with a distinct identifier of C++: joint1_x of "joint1.x"."""
    pairs: list[tuple[str, str]] = []
    used: set[str] = set()
    for name in names:
        identifier = safe(re.sub(r"\W", "_", name))
        while identifier in used:
            identifier += "_"
        used.add(identifier)
        pairs.append((name, identifier))
    return pairs
