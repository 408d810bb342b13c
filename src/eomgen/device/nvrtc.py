"""Source code -> image for a device's processor, by NVRTC, NVIDIA's compiler that comes as a library."""

from __future__ import annotations

import ctypes
import hashlib
import importlib.util
import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from ..codegen.simt.sources import CONTRACTION
from ..errors import BuildError, InputError
from ..optional import NotInstalledError
from ..pipeline import cache as store
from .driver import Chosen, first_library
from .texts import KIND

SYSTEM = ("libnvrtc.so.13", "libnvrtc.so.12", "libnvrtc.so", "nvrtc64_130_0.dll", "nvrtc64_120_0.dll")
WHEELS = ("*/lib/libnvrtc.so.*", "*/bin/nvrtc64_*.dll", "*/bin/*/nvrtc64_*.dll")  # inside the package nvidia
OPTIONS = ("--std=c++17", "--ftz=false", "--prec-div=true", "--prec-sqrt=true")
IMAGE = "image"  # file of an entry
CUBIN, PTX = "CUBIN", "PTX"  # what is asked for: machine code, or assembly for the driver


class Nvrtc:
    """The compiler.

    Attributes:
        version: its major and minor number.
    """

    def __init__(self) -> None:
        """Find and load the compiler.

        Raises:
            NotInstalledError: it is not here.
        """
        self._library = _loaded()
        version = [ctypes.c_int(), ctypes.c_int()]
        self._call("Version", *map(ctypes.byref, version))
        self.version = tuple(x.value for x in version)

    def image(self, code: str, chosen: Chosen, contract: bool) -> bytes:
        """Return what the driver loads for a device, from the cache where it is there.

        Args:
            code: source code.
            chosen: the device.
            contract: whether a product and a sum may be one operation.

        Raises:
            BuildError: the source does not compile; the compiler's log is in the message.
            InputError: the device is older than all that the compiler knows.
        """
        form, architecture = self._target(chosen)
        options = [*OPTIONS, CONTRACTION["cuda"][contract], architecture]
        key = hashlib.sha256(json.dumps([self.version, form, options, code]).encode()).hexdigest()

        def make(folder: Path) -> None:
            store.write_files(folder, {IMAGE: self._compiled(code, options, form)})

        return store.entry(KIND, key, make).files[IMAGE]

    def _target(self, chosen: Chosen) -> tuple[str, str]:
        """Return what is asked for, and the option with the processor."""
        count = ctypes.c_int()
        self._call("GetNumSupportedArchs", ctypes.byref(count))
        numbers = (ctypes.c_int * max(count.value, 1))()
        self._call("GetSupportedArchs", numbers)
        known, own = sorted(numbers[: count.value]), chosen.capability
        if own in known:
            return CUBIN, f"--gpu-architecture=sm_{own}"
        older = [x for x in known if x < own]
        if not older:
            version = ".".join(map(str, self.version))
            raise InputError(
                f"device: {chosen.name} has compute capability {own / 10:g}, and NVRTC {version} compiles for"
                f" {known[0] / 10:g} and later; allowed: an older NVRTC"
            )
        return PTX, f"--gpu-architecture=compute_{older[-1]}"

    def _compiled(self, code: str, options: Sequence[str], form: str) -> bytes:
        program = ctypes.c_void_p()
        self._call("CreateProgram", ctypes.byref(program), code.encode(), b"kernels.cu", 0, None, None)
        try:
            words = (ctypes.c_char_p * len(options))(*[x.encode() for x in options])
            status = self._function("CompileProgram")(program, ctypes.c_int(len(options)), words)
            if status:
                log = self._text("GetProgramLogSize", "GetProgramLog", program).decode("utf-8", "replace")
                raise BuildError(f"device: nvrtc {' '.join(options)} failed: {log.strip()}")
            return self._text(f"Get{form}Size", f"Get{form}", program)
        finally:
            self._call("DestroyProgram", ctypes.byref(program))

    def _text(self, size_of: str, give: str, program: ctypes.c_void_p) -> bytes:
        size = ctypes.c_size_t()
        self._call(size_of, program, ctypes.byref(size))
        room = ctypes.create_string_buffer(max(size.value, 1))
        self._call(give, program, room)
        return room.raw[: size.value]

    def _function(self, name: str) -> Any:
        return getattr(self._library, f"nvrtc{name}")

    def _call(self, name: str, *arguments: Any) -> None:
        code = self._function(name)(*arguments)
        if code:
            raise BuildError(f"device: nvrtc{name} failed ({code})")


def _loaded() -> ctypes.CDLL:
    """Load the compiler: of NVIDIA's wheel, or of the system."""
    try:
        return first_library((*_in_wheels(), *SYSTEM))
    except OSError as error:
        needed = "device: kernels need NVRTC, NVIDIA's compiler, which is not installed"
        raise NotInstalledError(f'{needed} ({error}): pip install "eomgen[cuda]"') from None


def _in_wheels() -> Iterator[str]:
    """Yield paths of NVRTC in the package nvidia, newest first."""
    try:
        spec = importlib.util.find_spec("nvidia")
    except (ImportError, ValueError):
        return
    places = [Path(place) for place in (spec.submodule_search_locations or ())] if spec else []
    found = {path for place in places for pattern in WHEELS for path in place.glob(pattern)}
    yield from sorted((str(path) for path in found if "alt" not in path.name), reverse=True)
