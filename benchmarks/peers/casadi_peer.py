"""CasADi: Pinocchio's algorithms traced with its SX, and the C that it generates.

``pinocchio.casadi`` is not in the wheel ``pin``, but its headers are, and the wheel ``casadi`` brings headers too,
so that a small C++ program traces.
"""

from __future__ import annotations

import hashlib
import importlib.metadata
import subprocess
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path

from eomgen.codegen.package.compile import find_compiler
from eomgen.errors import BuildError
from eomgen.pipeline import cache

from . import pinocchio_peer
from .cases import Case
from .contender import FFI, Contender, MissingPeer, address, build_library

NAME = "CasADi"
SOURCE = Path(__file__).with_name("casadi_trace.cpp")
KERNELS = ("inverse_dynamics", "mass_matrix", "forward_dynamics")
for _name in KERNELS:
    FFI.cdef(f"void casadi_{_name}(void);")  # an address is all that is used


def version() -> str:
    """Return the version of the wheel."""
    return importlib.metadata.version("casadi")


def tracer() -> Path:
    """Return the compiled program that traces.

    Raises:
        MissingPeer: CasADi, a header or the compiler is missing.
    """
    spec = find_spec("casadi")
    if spec is None or spec.origin is None:
        raise MissingPeer("the wheel casadi is not installed")
    folder = Path(spec.origin).parent
    if not (folder / "libcasadi.so").exists() or not (folder / "include/casadi/casadi.hpp").exists():
        raise MissingPeer("the wheel casadi has no C++ headers, and the wheel pin no pinocchio.casadi")
    flags = ("-O1", *pinocchio_peer.compile_flags(), f"-I{folder / 'include'}", SOURCE.name)
    link = (f"-L{folder}", "-lcasadi", f"-Wl,-rpath,{folder}")
    versions = (*pinocchio_peer.versions(), version())
    return build_library(
        "casadi_trace", pinocchio_peer.cxx(), [flags], link, pinocchio_peer.sources(SOURCE), versions, program=True
    )


class CasadiPeer:
    """The traced algorithms of one robot, compiled with these flags."""

    def __init__(self, case: Case, flags: Sequence[str]) -> None:
        program, text = tracer(), pinocchio_peer.model_text(case)
        key = hashlib.sha256((str(program.parent.name) + text).encode()).hexdigest()

        def trace(folder: Path) -> None:
            said = subprocess.run([program], input=text, capture_output=True, text=True, check=False)
            if said.returncode != 0:
                raise MissingPeer(f"the tracing program fails: {said.stderr.strip()[:200]}")
            (folder / "traced.c").write_text(said.stdout, encoding="ascii")

        code = cache.entry("peers", key, trace).files["traced.c"].decode("ascii")
        try:
            compiler = find_compiler()
        except BuildError as error:
            raise MissingPeer(str(error)) from None
        parts = [("-w", *flags, "traced.c")]
        path = build_library("traced", " ".join(compiler.command), parts, ("-lm",), {"traced.c": code})
        self._library = FFI.dlopen(str(path))

    def contender(self, kernel: str) -> Contender:
        """Return the traced algorithm of a kernel of ``KERNELS``."""
        code = address(FFI, FFI.addressof(self._library, f"casadi_{kernel}"))
        return Contender(NAME, code, 0, kept=self)
