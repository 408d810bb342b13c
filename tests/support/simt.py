"""Texts of threads run on the processor: compiled as C++ or C, or under OpenCL, beside the kernel's functions."""

from __future__ import annotations

import atexit
import ctypes
import math
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

import eomgen
from eomgen.codegen.simt.kernels import ROLLOUTS
from eomgen.codegen.simt.sources import SimtSource
from eomgen.kernel.complete import Kernel
from tests.support.methods import method_of
from tests.support.optional import module_of

COUNT = 37  # states: a whole tile and a part of one
STEP = 1e-6  # s, short enough for explicit steps of stiff robots
FLAGS = ("-Wall", "-Wextra", "-Wconversion", "-pedantic", "-Werror", "-O0", "-ffp-contract=off", "-fPIC", "-shared")
LANGUAGES = {
    "c++": ("g++", "-x", "c++", "-std=c++11"),
    "c": ("gcc", "-x", "c", "-std=c99"),
    "hip": ("g++", "-x", "c++", "-std=c++11", "-D__HIPCC__", "-include", "threads.h"),
}
FUSED = {"c++ fused": (*LANGUAGES["c++"], "-mfma", "-O2", "-ffp-contract=fast")}  # products and sums as one operation
THREADS = """/* What compilers of HIP and CUDA know by themselves; threads one by one, each a block of its own. */
#include <math.h>
#include <string.h>
#define __global__
#define __device__
#define __forceinline__ inline
static struct { unsigned int x; } blockIdx, threadIdx, blockDim = { 1 };
static inline long long __double_as_longlong(double x) { long long w; (void)memcpy(&w, &x, sizeof w); return w; }
static inline int __float_as_int(float x) { int w; (void)memcpy(&w, &x, sizeof w); return w; }
extern "C" void block(unsigned int number) { blockIdx.x = number; }
"""


def driver(source: SimtSource, folder: Path) -> Any:
    """Write the texts, and import the module that runs them."""
    for name, text in source.files.items():
        (folder / name).write_text(text, encoding="ascii")
    return module_of(folder / f"{source.name}_simt.py")


class Compiled:
    """Kernels of the text as functions of this process, called like those of ``OpenCL``."""

    def __init__(self, source: SimtSource, folder: Path, language: str = "c++") -> None:
        self.module, library = driver(source, folder), folder / f"{language}.so"
        (folder / "threads.h").write_text(THREADS, encoding="ascii")
        compiler, *chosen = {**LANGUAGES, **FUSED}[language]
        command = [compiler, *FLAGS, *chosen, f"-I{folder}", str(folder / f"{source.name}_simt.h")]
        subprocess.run([*command, "-o", str(library), "-lm"], check=True)
        self.library, self.h = ctypes.CDLL(str(library)), self.module.setup()
        self.status = np.zeros(0, np.int32)

    def run(self, name: str, *arrays: Any, **scalars: float) -> Any:
        """Return results of states, (count, ...), several as a tuple; ``status`` keeps the statuses."""
        module, read = self.module, self.module.checked(name, arrays)
        kernel, count = module.META["kernels"][name], read[0].shape[0]
        real = ctypes.c_double if np.float64 == module.REAL else ctypes.c_float
        numbers = [ctypes.c_int(x) if x.dtype == np.int32 else real(x) for x in module.checked_scalars(name, scalars)]
        tiles, shapes = [module.to_tiles(x) for x in read], list(kernel["writes"].values())
        made = [np.full((len(tiles[0]), math.prod(shape), module.TILE), np.nan, module.REAL) for shape in shapes]
        self.status = np.full(count, -1, np.int32)
        h, *pointers = [x.ctypes.data_as(ctypes.c_void_p) for x in (self.h, *tiles, *made, self.status)]
        for function in kernel["functions"]:
            self._launch(function, count, ctypes.c_ulonglong(count), h, *numbers, *pointers)
        results = [module.from_tiles(x, count).reshape(count, *shape) for x, shape in zip(made, shapes, strict=True)]
        return results[0] if len(results) == 1 else tuple(results)

    def _launch(self, function: str, count: int, *arguments: Any) -> None:
        """Call a function once, whose loop goes over states, or as threads of HIP one by one."""
        if not hasattr(self.library, "block"):
            getattr(self.library, function)(*arguments)
            return
        for thread in range(-(-count // self.module.TILE) * self.module.TILE):
            self.library.block(ctypes.c_uint(thread))
            getattr(self.library, function)(*arguments)


def states(module: Any, name: str, seed: int = 0, count: int = COUNT, size: float = 0.3) -> list[Any]:
    """Return random arrays that a kernel reads."""
    rng, reads = np.random.default_rng(seed), module.META["kernels"][name]["reads"]
    gains = {"kp": (0.0, 1e2), "kd": (0.0, 1.0)}  # explicit steps of the lightest links stand them
    ranges = [(gains.get(array, (-size, size)), shape) for array, shape in reads.items()]
    return [rng.uniform(*ends, (count, *shape)).astype(module.REAL) for ends, shape in ranges]


def scalars(module: Any, name: str) -> dict[str, float]:
    """Return numbers of steps for a kernel that takes some."""
    return {"step": STEP, "steps": 3} if module.META["kernels"][name]["scalars"] else {}


def expected(kernel: Kernel, name: str, arrays: Sequence[Any]) -> Any:
    """Return what the kernel's functions say of the same states."""
    if name.endswith("_pd_rollout"):
        return controlled(kernel, name, arrays)
    if name.endswith("_rollout"):
        made = kernel.rollout(*arrays, dt=STEP, steps=3, method=name.removesuffix("_rollout"))
        return tuple(x[:, -1] for x in (made if isinstance(made, tuple) else (made.q, made.v)))
    if name == "frame_poses":
        return np.stack([kernel.frame_pose(arrays[0], frame)[:, :3] for frame in kernel.frames], 1)
    if name == "frame_jacobians":
        return np.stack([kernel.frame_jacobian(arrays[0], frame) for frame in kernel.frames], 1)
    for ending, method in (("_tangent", kernel.jvp), ("_adjoint", kernel.vjp)):
        if name.endswith(ending):
            return _derivative(method, name.removesuffix(ending), arrays, ending == "_tangent")
    result = method_of(kernel, name)(*arrays)
    return result if isinstance(result, np.ndarray) else np.stack(result, 1)


def controlled(kernel: Kernel, name: str, arrays: Sequence[Any]) -> tuple[Any, Any]:
    """Return the ends of rollouts under joint controllers, whose gains on driven coordinates each state has its own."""
    driven = list(kernel.raw.libraries.meta["driven"])
    q, v, u, *gains = arrays
    whole = [np.zeros_like(q) for _ in gains]
    for wide, narrow in zip(whole, gains, strict=True):
        wide[:, driven] = narrow
    kp, kd, target = whole
    ends = []
    for k in range(len(q)):
        made = kernel.rollout(
            *(q[k], v[k], u[k], STEP, 3),
            method=name.removesuffix("_pd_rollout"),
            kp=kp[k],
            kd=kd[k],
            target=target[k],
        )
        ends.append([x[-1] for x in made])
    return np.stack([end[0] for end in ends]), np.stack([end[1] for end in ends])


def _derivative(method: Any, name: str, arrays: Sequence[Any], is_tangent: bool) -> Any:
    if is_tangent:
        half = len(arrays) // 2
        return method(name, tuple(arrays[:half]), tuple(arrays[half:]))
    slopes = method(name, tuple(arrays[:-1]), arrays[-1])
    return np.concatenate([x.reshape(len(x), -1) for x in slopes], 1)


def same_bits(one: Any, other: Any) -> bool:
    """Whether all numbers are the same, zeros of either sign; of tuples all arrays."""
    if isinstance(one, tuple):
        return len(one) == len(other) and all(map(same_bits, one, other))
    return bool(np.array_equal(one, other, equal_nan=True))


def has_fused_products() -> bool:
    """Whether this processor has products and sums as one operation."""
    try:
        return " fma " in Path("/proc/cpuinfo").read_text(encoding="utf-8")
    except OSError:
        return False


def opencl_platforms() -> list[Any]:
    """List platforms of OpenCL; none where pyopencl or a runtime is missing.

    Intel's runtime for processors may be that of the wheels intel-opencl-rt and intel-cmplr-lib-rt, where loaders do
    not look.
    """
    library = Path(sys.prefix, "lib", "libintelocl.so")
    if library.exists() and "OCL_ICD_VENDORS" not in os.environ:
        folder = Path(tempfile.mkdtemp(prefix="opencl"))
        atexit.register(shutil.rmtree, folder, ignore_errors=True)
        (folder / "intel.icd").write_text(f"{library}\n", encoding="utf-8")
        os.environ["OCL_ICD_VENDORS"] = str(folder)
    try:
        import pyopencl

        return list(pyopencl.get_platforms())
    except Exception:  # pyopencl says that there is no platform by an error of its own
        return []


def built(robot: Any, kernels: Sequence[str], dtype: str) -> Kernel:
    """Build the kernels that are compared."""
    owners = {"frame_poses": "kinematics", "frame_jacobians": "kinematics"}
    owners |= dict.fromkeys(ROLLOUTS, "rollout")
    return eomgen.build(robot, kernels=list(dict.fromkeys(owners.get(x, x) for x in kernels)), dtype=dtype)
