"""C -> WebAssembly: the compiler that is here for it, and its flags."""

from __future__ import annotations

import importlib.metadata
import importlib.util
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

from eomgen.codegen.package.compile import FLAGS, NO_VECTORS, WARNINGS, key_of
from eomgen.codegen.package.running import run_all
from eomgen.errors import BuildError
from eomgen.pipeline import cache as store

TARGET = "wasm32-wasi"  # its C library has the sines and powers that generated C calls; what asks the host falls away
STACK = 1 << 20  # bytes
# Vectors as on a processor with SSE2, so that sines have the same polynomials, and so the same bits.
VECTORS = ("-msimd128", "-DEOM_VECTOR_BYTES=16")
LINKING = ("-mexec-model=reactor", "-Wl,--gc-sections", "-Wl,--strip-all", f"-Wl,-z,stack-size={STACK}")
MODULE = "module.wasm"
EXPORTED = "__heap_base"  # where memory is free


def wasm_command() -> tuple[str, ...]:
    """Return the command of a compiler that makes WebAssembly: that of the package ziglang, or clang with wasm-ld.

    Raises:
        BuildError: there is none.
    """
    if importlib.util.find_spec("ziglang") is not None:
        return (sys.executable, "-m", "ziglang", "cc", "-target", TARGET)
    if shutil.which("clang") and (shutil.which("wasm-ld") or shutil.which("wasm-ld-14")):
        return ("clang", f"--target={TARGET}", "-Wl,--stack-first")  # zig does so unasked: an overflow is a trap
    raise BuildError(
        "no compiler for WebAssembly found; pip install ziglang, as eomgen[compiler] does, or install clang with"
        " wasm-ld and a C library for wasm32-wasi"
    )


def compile_wasm(sources: Mapping[str, str], exported: Sequence[str], *, long: bool = False) -> bytes:
    """Return the module of C sources, by their names, compiled or from the cache; headers are among them.

    Args:
        exported: functions that the host calls, beside those that the sources export themselves.
        long: whether there is a program so long that compilers find vectors in it that wait for their parts.

    Raises:
        BuildError: no compiler, or one that fails.
    """
    command = wasm_command()
    exports = [f"-Wl,--export={name}" for name in (*exported, EXPORTED)]
    flags = [*WARNINGS, *FLAGS, *((NO_VECTORS,) if long else ()), *VECTORS, *LINKING, *exports]
    key = key_of({"sources": dict(sources), "command": command, "version": _version(command), "flags": flags})

    def make(folder: Path) -> None:
        with tempfile.TemporaryDirectory() as work:
            for name, text in sources.items():
                Path(work, name).parent.mkdir(exist_ok=True)
                Path(work, name).write_text(text, encoding="ascii")
            codes = [str(Path(work, name)) for name in sources if name.endswith(".c") and "/" not in name]
            run_all([[*command, *flags, *codes, "-o", str(folder / MODULE), "-lm"]])
        (folder / MODULE).chmod(0o600)

    return store.entry("externals", key, make).files[MODULE]


def _version(command: Sequence[str]) -> str:
    """Say which compiler a command is."""
    if "ziglang" in command:
        return importlib.metadata.version("ziglang")
    asked = [*command, "--version"]
    return subprocess.run(asked, capture_output=True, encoding="utf-8", errors="backslashreplace", check=False).stdout
