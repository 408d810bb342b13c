"""Source -> a package that imports: files, the C compiler, cffi.

A package is written into a folder that nobody else uses; whoever calls moves it into place.  cffi's API mode needs
Python's headers; on a machine without them the same C is loaded in cffi's ABI mode, which costs about a microsecond
more per call.
"""

from __future__ import annotations

import hashlib
import importlib.resources
import importlib.util
import json
import os
import platform
import shlex
import shutil
import subprocess
import sys
import sysconfig
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cache
from importlib.machinery import EXTENSION_SUFFIXES
from pathlib import Path
from typing import Any

import _cffi_backend

from eomgen._version import __version__
from eomgen.errors import BuildError
from eomgen.runtime.levels import BASE

from ..c.library import LINKED, SETUP_ONLY, included_files, library_files
from ..c.source import Source, environment
from ..kernels.groups import CARRIED_STEPS
from ..kernels.signatures import SINGLES
from .environment import check_flags, environment_words, expanded
from .levels import fuses_unasked, level_flags
from .running import Compiler, identity, run_all

OPTIMISED, QUICK = "-O2", "-O1"
FLAGS = (OPTIMISED, "-fno-math-errno", "-fno-trapping-math", "-ffp-contract=off")
NATIVE = ("-march=native", "-ffp-contract=fast")
LONG = 1500  # values of a program; compilers that look for vectors in so many lines find ones that wait for their parts
NO_VECTORS = "-fno-tree-slp-vectorize"
# Files of eomgen that are copied to their places in a package, beside those of the C library that its C includes
CARRIED = ("errors.py", "names.py", "runtime/*.py")
# Those that only some robots need: a package has one where its metadata has one of these entries, or a kernel so named
CARRIED_WITH = {
    "runtime/flexible_links.py": ("flexible_links",),
    "runtime/internal_states.py": ("internal_states",),
    "runtime/loop_errors.py": ("constraints",),
    "runtime/many_steps.py": CARRIED_STEPS,
    "runtime/parameter_conditions.py": ("matrices", "conditions"),
    "runtime/rollouts.py": CARRIED_STEPS,
}
PACKAGE = "package/package.py.jinja"  # template of the Python of a package
_LIBRARY = Path(__file__).with_name("library.py")  # how the objects are compiled that a package is linked with
WARNINGS = ("-std=c99", "-Wall", "-Wextra", "-Wconversion", "-pedantic")


def find_compiler() -> Compiler:
    """Find $CC, or cc, gcc or clang on the path, or the package ziglang's; with $CFLAGS and $LDFLAGS.

    Raises:
        BuildError: there is none, or it does not run; or a variable cannot be read, or asks for unsafe arithmetic.
    """
    chosen, compiling, linking = (environment_words(name) for name in ("CC", "CFLAGS", "LDFLAGS"))
    for name, words in (("$CC", chosen[1:]), ("$CFLAGS", compiling), ("$LDFLAGS", linking)):
        check_flags(words, name)
    asked = chosen or _default()
    command, version = _probe(asked, identity(asked[0]))
    return Compiler(command, version, compiling, linking)


def _default() -> tuple[str, ...]:
    """Return the command of a compiler where $CC names none."""
    for name in ("cc", "gcc", "clang"):
        if shutil.which(name):
            return (name,)
    if importlib.util.find_spec("ziglang") is None:
        raise BuildError(
            "no C compiler found: $CC is not set, and cc, gcc and clang are not on the path; install one"
            " (Debian: apt install gcc; or pip install ziglang, as eomgen[compiler] does), or set CC to its command"
        )
    return (sys.executable, "-m", "ziglang", "cc")


@cache
def _probe(command: tuple[str, ...], stamp: tuple[str, int, int]) -> tuple[tuple[str, ...], str]:
    """Return the command, and what it says of its version; asked again when the binary changes, see ``identity``."""
    try:
        asked = [*command, "--version"]
        answer = subprocess.run(
            asked, capture_output=True, encoding="utf-8", errors="backslashreplace", timeout=60, check=True
        )
    except (OSError, subprocess.SubprocessError) as error:
        raise BuildError(
            f"the C compiler does not run: {shlex.join(command)} --version: {error}; install gcc or clang, or set CC"
        ) from None
    return (*command, *_any_processor(command)), answer.stdout.strip()


def _any_processor(command: Sequence[str]) -> tuple[str, ...]:
    """Return flags that keep zig from compiling for the processor at hand, which it does unless told not to."""
    zig = any(Path(word).stem in ("zig", "ziglang") for word in command)
    chosen = any(word.startswith(("-mcpu", "-march", "-target", "--target")) for word in command)
    return ("-mcpu=baseline",) if zig and not chosen else ()


def processor() -> str:
    """Return the machine's type and its processor's features, which native code may depend on."""
    info = Path("/proc/cpuinfo")
    if not info.exists():
        return f"{platform.machine()} {platform.processor()}"
    lines = info.read_text(encoding="utf-8", errors="replace").splitlines()
    return platform.machine() + next((line for line in lines if line.startswith(("flags", "Features"))), "")


def interface() -> dict[str, str]:
    """Return the environment that a binary must fit: Python's ABI, its headers, the C library."""
    known = "CS_GNU_LIBC_VERSION" in getattr(os, "confstr_names", ())
    return {
        "suffix": str(sysconfig.get_config_var("EXT_SUFFIX")),
        "python": str(sys.implementation.cache_tag),
        "headers": str(_headers() is not None),
        "system": sys.platform,
        "machine": platform.machine(),
        "library": str(os.confstr("CS_GNU_LIBC_VERSION")) if known else "",
    }


def kernel_flags(native: bool, quick: bool = False) -> tuple[str, ...]:
    """Return flags of a kernel's C, whatever the environment says; ``quick`` spares a third of the compiler's work."""
    chosen = tuple(QUICK if flag == OPTIMISED and quick else flag for flag in FLAGS)
    return (*chosen, *(NATIVE if native else ()))


def compile_flags(
    compiler: Compiler, native: bool, further: Sequence[str], level: str = BASE, quick: bool = False
) -> tuple[str, ...]:
    """Return flags of a kernel's C: ours, then those of $CFLAGS, then those of the call.

    Args:
        level: of processors, where the code is not native.

    Raises:
        BuildError: a flag asks for arithmetic that is not IEEE's, or a response file cannot be read.
    """
    words = expanded(further, "flags")
    check_flags(words, "flags")
    base, extra = kernel_flags(native, quick), (*compiler.flags, *words)
    chosen = () if native else level_flags(level, compiler, fused=contracts((*base, *extra)))
    return (*base, *chosen, *extra)


def fuses(flags: Sequence[str]) -> bool:
    """Whether the compiler may fuse products with sums, or the processor may keep more digits than a double has."""
    return contracts(flags) or sys.maxsize < 2**32 or fuses_unasked(flags)


def contracts(flags: Sequence[str]) -> bool:
    """Whether the compiler is allowed to fuse products with sums."""
    words = [word for word in flags if word.startswith(("-ffp-contract", "-ffp-model", "-fp-model", "--fp-"))]
    return words[-1:] != ["-ffp-contract=off"]


def toolchain(compiler: Compiler, flags: Sequence[str]) -> dict[str, Any]:
    """Return all but the source that a binary depends on: flags, compiler, versions, environment, processor."""
    tuned = any(word.endswith("=native") for word in (*compiler.command, *flags))
    return {
        "flags": list(flags),
        "command": list(compiler.command),
        "environment": [list(compiler.flags), list(compiler.link_flags)],
        "compiler": compiler.version,
        "eomgen": __version__,
        "interface": interface(),
        "processor": processor() if tuned else "",
    }


def dependencies(source: Source, compiler: Compiler, flags: Sequence[str]) -> dict[str, Any]:
    """Return all that a package depends on, by names, as plain values of JSON."""
    return {
        **toolchain(compiler, flags),
        "source": asdict(source),
        "cffi": _cffi_backend.__version__,
        **_hashes(),
    }


@cache
def _hashes() -> dict[str, dict[str, str]]:
    """Hash, by name, the files that make a package, those that it carries, and the C library's; read once."""
    template = Path(str(importlib.resources.files("eomgen.templates"))) / PACKAGE
    makers = {"compile.py": Path(__file__), "library.py": _LIBRARY, PACKAGE: template}
    library = {place: _root() / place for place in library_files()}
    kinds = {"package": makers, "carried": carried_files(), "library": library}
    return {
        kind: {name: hashlib.sha256(path.read_bytes()).hexdigest() for name, path in files.items()}
        for kind, files in kinds.items()
    }


def build_key(source: Source, compiler: Compiler, flags: Sequence[str], *, tried: bool = True) -> str:
    """Hash of all that a package depends on; another one where nobody could try what was compiled."""
    parts = dependencies(source, compiler, flags)
    return key_of(parts if tried else {**parts, "tried": False})


def key_of(parts: Mapping[str, Any]) -> str:
    """Hash of plain values, SHA-256 in hexadecimal digits."""
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()


@cache
def carried_files() -> dict[str, Path]:
    """Return files of eomgen that packages have byte-identical copies of, by their places in them, sorted."""
    root = _root()
    return {path.relative_to(root).as_posix(): path for pattern in CARRIED for path in sorted(root.glob(pattern))}


def carried_contents(meta: Mapping[str, Any], *codes: str) -> dict[str, bytes]:
    """Return the content of the ``carried_files`` that a package needs, and of the C library's that its C includes.

    Args:
        meta: the package's metadata.
        codes: its C.
    """
    there = {*(entry for entry, value in meta.items() if value), *meta["kernels"]}
    unneeded = {place for place, entries in CARRIED_WITH.items() if there.isdisjoint(entries)}
    needed = {place: path for place, path in carried_files().items() if place not in unneeded}
    library = {place: text.encode("ascii") for place, text in included_files(*codes).items()}
    return {place: path.read_bytes() for place, path in needed.items()} | library


def _root() -> Path:
    """Return eomgen's folder."""
    return Path(str(importlib.resources.files("eomgen.runtime"))).parent


@dataclass(frozen=True)
class Linked:
    """Objects of the C library that a source's scalar or batch library is linked with instead of compiling it again.

    Attributes:
        halves: "singles", "batches" or both: which of them are.
        objects: gives the objects' content, and waits for it.
    """

    halves: Sequence[str] = ()
    objects: Callable[[], Sequence[bytes]] = tuple


def write_package(
    source: Source,
    compiler: Compiler,
    flags: Sequence[str],
    folder: Path,
    level: str = BASE,
    linked: Linked = Linked(),
) -> None:
    """Write and compile the package of a kernel into an empty folder, without ``carried_contents``.

    Those are the same for all packages: headers of the C library are included from eomgen's own folder.

    Args:
        level: of processors that the flags are for, or "native".
        linked: what it is linked with; without it every half compiles what it needs of the library.

    Raises:
        BuildError: the compiler failed; the message holds its command and what it said.
    """
    name = source.name
    (folder / f"{name}.h").write_text(source.header, encoding="ascii")
    for file, text in source.codes.items():
        (folder / file).write_text(text, encoding="ascii")
    (folder / f"{name}.json").write_text(source.meta, encoding="ascii")
    package = environment().get_template(PACKAGE).render(name=name, version=__version__, level=level)
    (folder / "__init__.py").write_text(package, encoding="ascii")
    import cffi  # what is loaded from the cache needs none

    ffi, headers, work = cffi.FFI(), _headers(), folder / "build"
    ffi.cdef(source.cdef)
    work.mkdir()
    if headers is None:
        _write_opening(ffi, name, folder)
        objects, library = _compile(source, compiler, flags, folder, linked, []), f"lib{name}.so"
    else:
        job, made = _wrapper_job(ffi, name, compiler, folder, headers)
        objects = [*_compile(source, compiler, flags, folder, linked, [job]), made]
        suffix = ".abi3.so" if ".abi3.so" in EXTENSION_SUFFIXES else EXTENSION_SUFFIXES[0]
        library = f"_{name}{suffix}"
    link_shared(compiler, objects, folder / library)
    shutil.rmtree(work)


def _headers() -> str | None:
    """Return the folder of Python.h, or None."""
    folder = sysconfig.get_path("include")
    return folder if folder and Path(folder, "Python.h").exists() else None


def _wrapper_job(ffi: Any, name: str, compiler: Compiler, folder: Path, headers: str) -> tuple[list[str], Path]:
    """Write the wrapper of cffi's API mode; return the command that compiles it, beside the kernel, and its object."""
    from cffi.recompiler import make_c_source

    wrapper, made = folder / "build" / f"_{name}.c", folder / "build" / "wrapper.o"
    make_c_source(ffi, f"_{name}", f'#include "{name}.h"', str(wrapper))  # emit_c_code prints to stdout
    include = ("-iquote", str(folder), *_library_headers(), "-I", headers)  # a robot may be named as a system header is
    # -O0: the wrapper passes pointers on, and optimising it takes longer than many a kernel
    job = [*compiler.command, "-c", "-fPIC", "-O0", *compiler.flags, *include, str(wrapper), "-o", str(made)]
    return job, made


def _compile(
    source: Source, compiler: Compiler, flags: Sequence[str], folder: Path, linked: Linked, beside: Sequence[list[str]]
) -> list[Path]:
    """Compile a source's files into objects, side by side; beside them whatever else; with objects to link."""
    files = dict(zip(source.cdefs, source.codes, strict=True))  # by half
    parts = [(files[half], [f"-D{LINKED}"] if half in linked.halves else []) for half in source.halves]
    if SINGLES not in source.halves:
        parts.append((files[SINGLES], [f"-D{SETUP_ONLY}"]))  # what h is made by
    objects = [folder / "build" / f"{file}.o" for file, _ in parts]
    begin = [*compiler.command, "-c", "-fPIC", *_first_flags(source), *flags, *_library_headers()]
    jobs = [
        [*begin, *macros, str(folder / file), "-o", str(made)]
        for (file, macros), made in zip(parts, objects, strict=True)
    ]
    run_all([*jobs, *beside])
    for number, data in enumerate(linked.objects()):
        objects.append(folder / "build" / f"library{number}.o")
        objects[-1].write_bytes(data)
    return objects


def _library_headers() -> tuple[str, ...]:
    """Return flags by which C beside none of the library's headers includes eomgen's own, which are the same."""
    return ("-iquote", str(_root()))


def _first_flags(source: Source) -> tuple[str, ...]:
    """Return warnings, and what helps sources with long programs; flags behind them may take it back."""
    return (*WARNINGS, NO_VECTORS) if source.longest > LONG else WARNINGS


def _write_opening(ffi: Any, name: str, folder: Path) -> None:
    """Write modules by which cffi's ABI mode opens a plain shared library."""
    from cffi.recompiler import make_py_source

    make_py_source(ffi, f"_{name}_types", str(folder / f"_{name}_types.py"))
    opened = (
        "from pathlib import Path\n\n"
        f"from ._{name}_types import ffi\n\n"
        f'lib = ffi.dlopen(str(Path(__file__).with_name("lib{name}.so")))\n'
    )
    (folder / f"_{name}.py").write_text(opened, encoding="ascii")


def shared_flags() -> tuple[str, ...]:
    return ("-bundle", "-undefined", "dynamic_lookup") if sys.platform == "darwin" else ("-shared",)


def link_shared(compiler: Compiler, objects: Sequence[Path], library: Path, further: Sequence[str] = ()) -> None:
    """Link objects into a shared library, with the flags of $CFLAGS and $LDFLAGS and further ones.

    Raises:
        BuildError: the compiler failed.
    """
    flags = [*shared_flags(), *compiler.flags, *further]
    run_all([[*compiler.command, *flags, *map(str, objects), "-o", str(library), *compiler.link_flags, "-lm"]])
