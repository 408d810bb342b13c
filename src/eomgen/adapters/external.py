"""C of a kernel's function for CasADi's external-function interface, compiled; no Python at run time.

See https://web.casadi.org/docs/#using-external-functions.  CasADi stores matrices by columns, kernels by rows: every
array and derivative goes through a table of places.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import math
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._version import __version__
from ..control.discrete_steps import DiscreteStep, literal
from ..errors import InputError
from ..kernel.complete import Kernel
from ..pipeline import cache as store
from ..runtime.bound import frame_number
from .mappings import DifferentiableFunction


@dataclass(frozen=True)
class Table:
    """A matrix of CasADi: its shape, its nonzeros in compressed columns, and where each is in the kernel's rows."""

    name: str
    rows: int
    columns: int
    starts: tuple[int, ...]
    indices: tuple[int, ...]
    places: tuple[int, ...]


def external_library(
    function: DifferentiableFunction, called: str, flags: Sequence[str] = (), order: int = 2
) -> store.Entry:
    """Return the compiled library CALLED.so of a function by the name ``called``, and its C, from the cache.

    Args:
        function: whose kernel's C is taken.
        called: its name in CasADi.
        flags: further flags of the compiler.
        order: of the derivatives in it, 1 or 2.

    Raises:
        UnknownNameError: the kernel was built without second derivatives, which are asked for.
        InputError: the kernel is not one of float64.
        BuildError: its C is not there any more, or cannot be compiled.
    """
    kernel = function.kernel
    _require_double(kernel)
    if order == 2:
        function.require_second()
    names = (*function.kernels, *(function.second if order == 2 else ()))
    kernel = kernel.replaced(together=names)
    return compiled_external(kernel, render(function, kernel, called, order), called, flags)


def step_library(step: DiscreteStep, called: str, flags: Sequence[str] = ()) -> store.Entry:
    """Return the compiled library CALLED.so of a step by the name ``called``, and its C, from the cache.

    Raises:
        InputError: the kernel is not one of float64.
        BuildError: its C is not there any more, or cannot be compiled.
    """
    _require_double(step.kernel)
    return compiled_external(step.together, render_step(step, called), called, flags)


def _require_double(kernel: Kernel) -> None:
    if kernel.dtype != np.float64:
        raise InputError(f"{kernel.name} is a kernel of {kernel.dtype}; allowed for CasADi: float64")


def compiled_external(kernel: Kernel, wrapper: str, called: str, flags: Sequence[str]) -> store.Entry:
    """Return the library CALLED.so of a kernel's C and a wrapper around it, from the cache.

    Args:
        kernel: with all that the wrapper calls in one library of C.
        wrapper: C, which includes the kernel's header.
        called: name of the library.
        flags: further flags of the compiler.

    Raises:
        BuildError: its C is not there any more, or cannot be compiled.
    """
    from ..codegen.c.library import FOLDER
    from ..codegen.package.compile import WARNINGS, compile_flags, find_compiler, link_shared, toolchain
    from ..codegen.package.probe import check_compiler
    from ..codegen.package.running import run_all

    header, code = (kernel.raw.source(ending) for ending in ("h", "c"))
    library = _library(kernel)
    compiler = find_compiler()
    every = compile_flags(compiler, False, flags)
    tools = toolchain(compiler, every)
    compile_c = [*compiler.command, "-c", "-fPIC", "-fvisibility=hidden", *WARNINGS, *every]

    def compile_kernel(folder: Path) -> None:
        check_compiler(compiler, every)
        (folder / f"{kernel.name}.c").write_text(code, encoding="ascii")
        _write(folder, {f"{kernel.name}.h": header, **library})
        source = str(folder / f"{kernel.name}.c")
        run_all([[*compile_c, source, "-o", str(folder / "kernel.o")]])
        shutil.rmtree(folder / FOLDER)

    made = store.entry("objects", _key(tools, header, code, *library.values()), compile_kernel)

    def link(folder: Path) -> None:
        check_compiler(compiler, every)
        source, shared = folder / f"{called}.c", folder / f"{called}.so"
        objects = [folder / "kernel.o", folder / "wrapper.o"]
        _write(folder, {f"{kernel.name}.h": header, **library})  # a header with rollouts includes the library's
        source.write_text(wrapper, encoding="ascii")
        objects[0].write_bytes(made.files["kernel.o"])
        run_all([[*compile_c, "-iquote", str(folder), str(source), "-o", str(objects[1])]])
        link_shared(compiler, objects, shared, flags)
        shutil.rmtree(folder / FOLDER)
        for made_here in objects:
            made_here.unlink()

    return store.entry("externals", _key(tools, header, code, wrapper, *library.values()), link)


def _write(folder: Path, texts: Mapping[str, str]) -> None:
    for place, text in texts.items():
        (folder / place).parent.mkdir(exist_ok=True)
        (folder / place).write_text(text, encoding="ascii")


def _library(kernel: Kernel) -> dict[str, str]:
    """Read the files of the C library that a kernel's C includes, from its package; of one in the cache, eomgen's."""
    from ..codegen.c.library import library_files

    files = {}
    for place in library_files():
        with contextlib.suppress(OSError, KeyError):  # a package that another version wrote has other ones
            files[place] = kernel.raw.libraries.source(place)
    return files or dict(library_files())


def _key(tools: dict[str, object], *texts: str) -> str:
    here = Path(__file__).read_text(encoding="utf-8")  # how it is compiled
    return hashlib.sha256(json.dumps([tools, here, *texts], sort_keys=True).encode()).hexdigest()


def render(function: DifferentiableFunction, kernel: Kernel, called: str, order: int) -> str:
    """Return the C of the function by the name ``called``, which goes with that of the kernel."""
    from ..codegen.c.source import environment

    mask, masks = function.patterns()
    inputs = [table(label, np.ones(s, np.bool_)) for label, s in zip(function.reads, function.inputs, strict=True)]
    result = table(function.result, mask)
    blocks = [
        block_table(f"jac_{function.result}_{label}", pattern, _numbered(pattern), function.output)
        for label, pattern in zip(function.reads, masks, strict=True)
    ]
    sizes, size = [math.prod(shape) for shape in function.inputs], math.prod(function.output)
    total, room = sum(sizes), max(size * sum(sizes), 3 * kernel.n**2)
    context = {
        "called": called,
        "version": __version__,
        "robot": kernel.name,
        "function": function.name,
        "derivatives": f"casadi/{function.rule.template}.c.jinja",
        "by_kernel": function.rule.kernel,
        "calls": function.calls,
        "idle": {name: math.prod(kernel.raw.shapes[name]) for name in function.idle},
        "begins": function.begins,
        "moving": function.moving,
        "whole": math.prod(function.whole),
        "written": math.prod(kernel.raw.shapes[kernel.raw.functions[function.calls].writes]),
        "n": kernel.n,
        "frame": None if function.frame is None else frame_number(kernel.frames, function.frame),
        "inputs": inputs,
        "result": result,
        "blocks": blocks,
        "previous": _empty(f"out_{function.result}", function.output),
        "size": size,
        "sizes": sizes,
        "total": total,
        "room": room,
        "work": total + room + function.rule.spare(function),
        "places_of_inputs": dict(zip(function.reads, np.cumsum([0, *sizes]).tolist(), strict=False)),
        "read_by_derivatives": function.rule.reads(function),
        "copied": function.rule.copied(function),
        "rates": math.prod(kernel.raw.shapes["rate_vector"]),
        "places_of_blocks": (size * np.cumsum([0, *sizes])).tolist()[: len(sizes)],
        "setup": [literal(x) for x in kernel.parameters.setup.computed(kernel.raw.functions[function.calls].library)],
        "second": _second_order(function, kernel, mask, masks) if order == 2 else None,
    }
    return environment().get_template("casadi/external.c.jinja").render(context)


def render_step(step: DiscreteStep, called: str) -> str:
    """Return the C of a step by the name ``called``, which goes with that of its kernel."""
    from ..codegen.c.source import environment

    sizes = step.sizes
    begins = np.cumsum([0, *sizes.values()]).tolist()[:-1]
    full = {name: np.ones((sizes["x"], size), np.bool_) for name, size in sizes.items()}
    context = {
        **step.context(),
        "called": called,
        "version": __version__,
        "inputs": [table(name, np.ones(size, np.bool_)) for name, size in sizes.items()],
        "result": table("x_next", np.ones(sizes["x"], np.bool_)),
        "blocks": [table(f"jac_x_next_{name}", mask) for name, mask in full.items()],
        "previous": _empty("out_x_next", (sizes["x"],)),
        "seeds": table("adj_x_next", np.ones(sizes["x"], np.bool_)),
        "gradients": [table(f"adj_{name}", np.ones(size, np.bool_)) for name, size in sizes.items()],
        "begins": begins,
    }
    return environment().get_template("casadi/step.c.jinja").render(context)


def _second_order(
    function: DifferentiableFunction, kernel: Kernel, mask: NDArray[np.bool_], masks: Sequence[NDArray[np.bool_]]
) -> dict[str, Any]:
    """Return tables of matrices for the C of gradients, CasADi's reverse mode, and of their Jacobian.

    ``every`` counts the numbers of all that the kernel's function reads.
    """
    shapes, reads = kernel.raw.shapes, function.reads
    starts = np.cumsum([0, *(math.prod(shape) for shape in function.inputs)]).tolist()
    every = starts[-1] + sum(math.prod(shapes[label]) for label in function.idle)
    matrix, blocks = np.arange(every**2).reshape(every, every), list[tuple[str, Table]]()
    for at, label in enumerate(reads):
        rows = slice(starts[at], starts[at + 1])
        for by, other in enumerate(reads):
            shape = (*function.inputs[at], *function.inputs[by])
            places = matrix[rows, starts[by] : starts[by + 1]].reshape(shape)
            name = f"jac_adj_{label}_{other}"
            blocks.append(("b", block_table(name, function.second_pattern(at, by), places, function.inputs[at])))
        shapes_of = (math.prod(function.inputs[at]), math.prod(function.output))
        blocks.append(("", _empty(f"jac_adj_{label}_out_{function.result}", shapes_of)))
        pattern = masks[at] & mask.reshape(*mask.shape, *(1,) * len(function.inputs[at]))
        places = starts[at] * math.prod(function.output) + _numbered(pattern)
        turned = [*range(mask.ndim, pattern.ndim), *range(mask.ndim)]
        name = f"jac_adj_{label}_adj_{function.result}"
        block = block_table(name, pattern.transpose(turned), places.transpose(turned), function.inputs[at])
        blocks.append(("d", block))
    return {
        "every": every,
        "seeds": table(f"adj_{function.result}", mask),
        "gradients": [
            table(f"adj_{label}", np.ones(shape, np.bool_)) for label, shape in zip(reads, function.inputs, strict=True)
        ],
        "previous": [_empty(f"out_adj_{label}", shape) for label, shape in zip(reads, function.inputs, strict=True)],
        "blocks": blocks,
    }


def _empty(name: str, shape: tuple[int, ...]) -> Table:
    return table(name, np.zeros(_matrix(shape), np.bool_))


def _numbered(mask: NDArray[np.bool_]) -> NDArray[np.int64]:
    return np.arange(mask.size).reshape(mask.shape)


def _matrix(shape: tuple[int, ...]) -> tuple[int, int]:
    return (shape[0], shape[1]) if len(shape) == 2 else (shape[0], 1)


def table(name: str, mask: NDArray[np.bool_]) -> Table:
    """Return the sparsity of an array of one or two axes: True where it may differ from zero."""
    matrix = mask.reshape(_matrix(mask.shape))
    return _table(name, matrix, _numbered(matrix))


def block_table(name: str, mask: NDArray[np.bool_], places: NDArray[np.int64], output: tuple[int, ...]) -> Table:
    """Return the sparsity of a derivative (output shape, input shape) for CasADi: rows are results in column order."""
    inputs = mask.shape[len(output) :]

    def by_columns(array: NDArray[Any]) -> NDArray[Any]:
        four = array.reshape(*_matrix(output), *_matrix(inputs))
        return np.transpose(four, (1, 0, 3, 2)).reshape(math.prod(output), math.prod(inputs))

    return _table(name, by_columns(mask), by_columns(places))


def _table(name: str, mask: NDArray[np.bool_], places: NDArray[np.int64]) -> Table:
    column, row = np.nonzero(mask.T)
    starts = np.concatenate([[0], np.cumsum(mask.sum(axis=0))])
    rows, columns = mask.shape
    return Table(name, rows, columns, tuple(starts.tolist()), tuple(row.tolist()), tuple(places[row, column].tolist()))
