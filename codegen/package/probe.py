"""A few lines of C, compiled as a kernel is: whether a compiler and its flags keep IEEE arithmetic.

For binaries that hold kernels and that nobody here can call, such as FMUs; compiled kernels of
packages are compared with their programs instead.
"""

from __future__ import annotations

import math
import shlex
import tempfile
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import cffi

from eomgen.errors import BuildError
from eomgen.threads import in_new_thread

from .compile import fuses, link_shared
from .running import Compiler, run_all

_FORMULAS: Mapping[str, str] = {  # of x, y, z, by what they are about
    "a constant": "x + 0.1",
    "a quotient": "x / 3.0",
    "a sum": "(x + y) - x",
    "a product": "0.5 * x",
    "a zero's sign": "x + 0.0",
    "a comparison": "(x == x) ? 1.0 : 0.0",
    "an order": "!(x > y) ? 1.0 : 0.0",
    "a difference": "x - x",
    "a product and a sum": "x * y + z",
}
_CASES: tuple[tuple[str, tuple[float, ...], float], ...] = (
    ("a constant", (0.0,), 0.1),
    ("a quotient", (5.0,), 5.0 / 3.0),
    ("a quotient", (5e-324,), 0.0),
    ("a sum", (1e16, 1.0), 0.0),
    ("a product", (4e-310,), 2e-310),
    ("a product", (1e308,), 5e307),
    ("a zero's sign", (-0.0,), 0.0),
    ("a comparison", (math.nan,), 0.0),
    ("an order", (math.nan, 1.0), 1.0),
    ("an order", (math.inf, math.nan), 1.0),
    ("a difference", (math.inf,), math.nan),
)
_FUSED = ("a product and a sum", (1.0 + 2.0**-30, 1.0 - 2.0**-30, -1.0), 0.0)  # 2^-60 with one rounding


@cache
def check_compiler(compiler: Compiler, flags: tuple[str, ...]) -> None:
    """Compile and run the formulas once in a process.

    Raises:
        BuildError: the compiler fails, or a formula gives another number; the compiler's command is named.
    """
    names = {what: f"eomgen_probe_{place}" for place, what in enumerate(_FORMULAS)}
    heads = {what: f"double {name}(double x, double y, double z)" for what, name in names.items()}
    unused = "(void)x; (void)y; (void)z;"
    text = "\n".join(f"{head};\n{head} {{ {unused} return {_FORMULAS[what]}; }}" for what, head in heads.items())
    ffi = cffi.FFI()
    ffi.cdef("".join(f"{head};" for head in heads.values()))
    with tempfile.TemporaryDirectory(prefix="eomgen-probe-", ignore_cleanup_errors=True) as folder:
        code, made, library = (Path(folder, f"probe.{ending}") for ending in ("c", "o", "so"))
        code.write_text(text + "\n", encoding="ascii")
        command = [*compiler.command, "-c", "-fPIC", *flags, str(code), "-o", str(made)]
        run_all([command])
        link_shared(compiler, [made], library)

        def ask() -> list[str]:
            lib: Any = ffi.dlopen(str(library))
            wrong = []
            for what, numbers, expected in _CASES if fuses(flags) else (*_CASES, _FUSED):
                computed = getattr(lib, names[what])(*numbers, *[0.0] * (3 - len(numbers)))
                same = computed == expected and math.copysign(1.0, computed) == math.copysign(1.0, expected)
                if not same and not (math.isnan(computed) and math.isnan(expected)):
                    wrong.append(f"{what}, {_FORMULAS[what]}, is {computed!r} for {expected!r}")
            return wrong

        try:
            wrong = in_new_thread(ask)
        except OSError as error:
            raise BuildError(f"what {shlex.join(compiler.command)} compiles does not load: {error}") from None
    if wrong:
        raise BuildError(refusal(f"the compiler does not keep IEEE arithmetic: {wrong[0]}", command))


def refusal(reason: str, command: Sequence[str]) -> str:
    """Return the text of an error about a compiler that computes something else."""
    return (
        f"{reason}\n  {shlex.join(command)}\n"
        "allowed: a compiler and flags that keep IEEE arithmetic; look at what CC, CFLAGS and LDFLAGS name"
    )
