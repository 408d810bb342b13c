"""C -> WebAssembly: the compiler that is here for it, and its flags."""

from __future__ import annotations

import importlib.util
import shutil
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

from eomgen.codegen.package.compile import FLAGS, WARNINGS, run_all
from eomgen.errors import BuildError

TARGET = "wasm32-wasi"  # its C library has the sines and powers that generated C calls; what asks the host falls away
STACK = 1 << 20  # bytes
# Vectors as on a processor with SSE2, so that sines have the same polynomials, and so the same bits.
VECTORS = ("-msimd128", "-DEOMGEN_VECTOR=16", "-DEOMGEN_SINGLES_ONLY")
LINKING = ("-mexec-model=reactor", "-Wl,--gc-sections", "-Wl,--strip-all", f"-Wl,-z,stack-size={STACK}")
EXPORTED = "__heap_base"  # where memory is free


def wasm_command() -> tuple[str, ...]:
    """The command of a compiler that makes WebAssembly: that of the package ziglang, or clang with wasm-ld.

    Raises:
        BuildError: there is none.
    """
    if importlib.util.find_spec("ziglang") is not None:
        return (sys.executable, "-m", "ziglang", "cc", "-target", TARGET)
    if shutil.which("clang") and (shutil.which("wasm-ld") or shutil.which("wasm-ld-14")):
        return ("clang", f"--target={TARGET}")
    raise BuildError(
        "no compiler for WebAssembly found; pip install ziglang, as eomgen[compiler] does, or install clang with"
        " wasm-ld and a C library for wasm32-wasi"
    )


def compile_wasm(sources: Mapping[str, str], exported: Sequence[str], folder: Path) -> bytes:
    """The module of C sources, by their names; headers are among them.

    Args:
        exported: functions that the host calls, beside those that the sources export themselves.
        folder: an empty one, for what arises on the way.

    Raises:
        BuildError: no compiler, or one that fails.
    """
    command = wasm_command()
    for name, text in sources.items():
        (folder / name).write_text(text, encoding="ascii")
    codes = [str(folder / name) for name in sources if name.endswith(".c")]
    exports = [f"-Wl,--export={name}" for name in (*exported, EXPORTED)]
    target = folder / "module.wasm"
    run_all([[*command, *WARNINGS, *FLAGS, *VECTORS, *LINKING, *exports, *codes, "-o", str(target), "-lm"]])
    return target.read_bytes()
