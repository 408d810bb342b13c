"""Device source run on the processor, compiled as C++ or C or by OpenCL, compared with the kernel's functions."""

from __future__ import annotations

import atexit
import ctypes
import json
import math
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen.codegen.simt.kernels import ROLLOUTS
from eomgen.codegen.simt.sources import SimtSource
from eomgen.kernel.complete import Kernel
from tests.support.methods import method_of

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


def compiled(source: SimtSource, folder: Path, language: str) -> Callable[..., None]:
    """Compile the text, and return what launches a function of it: its name, how many threads, and its arguments."""
    header, path = folder / f"{source.name}_simt.h", folder / f"{language}.so"
    header.write_text(source.code, encoding="ascii")
    (folder / "threads.h").write_text(THREADS, encoding="ascii")
    compiler, *chosen = {**LANGUAGES, **FUSED}[language]
    subprocess.run([compiler, *FLAGS, *chosen, f"-I{folder}", str(header), "-o", str(path), "-lm"], check=True)
    library = ctypes.CDLL(str(path))

    def launch(function: str, threads: int, *arguments: Any) -> None:
        """Call a function once, whose loop goes over states, or as threads of HIP one by one."""
        given = [
            x.ctypes.data_as(ctypes.c_void_p) if x.ndim else np.ctypeslib.as_ctypes_type(x.dtype)(x) for x in arguments
        ]
        for thread in range(threads if hasattr(library, "block") else 1):
            if hasattr(library, "block"):
                library.block(ctypes.c_uint(thread))
            getattr(library, function)(*given)

    return launch


def under_opencl(source: SimtSource) -> Callable[..., None]:
    """Return the same of the first device of OpenCL; the test is skipped without one."""
    if not opencl_platforms():
        pytest.skip("no runtime of OpenCL, or no pyopencl")
    import pyopencl as cl

    meta, context = json.loads(source.meta), cl.create_some_context(interactive=False)
    queue, flags = cl.CommandQueue(context), cl.mem_flags.READ_WRITE | cl.mem_flags.COPY_HOST_PTR
    rounded = ["-cl-fp32-correctly-rounded-divide-sqrt"] if meta["dtype"] == "float32" else []
    program = cl.Program(context, source.code).build(["-cl-std=CL1.2", meta["flags"]["opencl"], *rounded])

    def launch(function: str, threads: int, *arguments: Any) -> None:
        given = [cl.Buffer(context, flags, hostbuf=x) if x.ndim else x for x in arguments]
        kernel = cl.Kernel(program, function)
        kernel.set_args(*given)
        cl.enqueue_nd_range_kernel(queue, kernel, (threads,), None)
        for x, buffer in zip(arguments, given, strict=True):
            if x.ndim:
                cl.enqueue_copy(queue, x, buffer)
        queue.finish()

    return launch


class Compiled:
    """Kernels of the text, compiled in a language, at the described parameters.

    ``launch`` calls a function of the text; ``status`` keeps what ``run`` has last found.
    """

    def __init__(self, source: SimtSource, folder: Path, language: str = "c++") -> None:
        self.meta = json.loads(source.meta)
        self.dtype, self.tile = np.dtype(self.meta["dtype"]), self.meta["tile"]
        self.h, self.status = np.array(self.meta["h"], self.dtype), np.zeros(0, np.int32)
        self.launch = under_opencl(source) if language == "opencl" else compiled(source, folder, language)

    def run(self, name: str, *arrays: Any, **scalars: float) -> Any:
        """Return results of states, (count, ...), several as a tuple."""
        kernel, count = self.meta["kernels"][name], len(arrays[0])
        types, shapes = {"int": np.int32, "real": self.dtype.type}, list(kernel["writes"].values())
        numbers = [types[kind](scalars[key]) for key, kind in kernel["scalars"].items()]
        read = [self.to_tiles(x) for x in arrays]
        made = [np.full((len(read[0]), math.prod(shape), self.tile), np.nan, self.dtype) for shape in shapes]
        self.status = np.full(count, -1, np.int32)
        for function in kernel["functions"]:
            arguments = (np.uint64(count), self.h, *numbers, *read, *made, self.status)
            self.launch(function, len(read[0]) * self.tile, *arguments)
        results = [self.from_tiles(x, count).reshape(count, *shape) for x, shape in zip(made, shapes, strict=True)]
        return results[0] if len(results) == 1 else tuple(results)

    def to_tiles(self, x: Any) -> Any:
        """Return an array of states, (count, ...), as tiles (ceil(count / tile), size, tile), padded with 0."""
        rows = x.reshape(len(x), -1)
        tiles = np.zeros((-(-len(x) // self.tile), self.tile, rows.shape[1]), self.dtype)
        tiles.reshape(-1, rows.shape[1])[: len(x)] = rows
        return np.ascontiguousarray(tiles.swapaxes(1, 2))

    def from_tiles(self, tiles: Any, count: int) -> Any:
        """Return so many states, (count, size), of tiles."""
        return np.ascontiguousarray(tiles.swapaxes(1, 2).reshape(-1, tiles.shape[1])[:count])


def states(meta: Mapping[str, Any], name: str, seed: int = 0, count: int = COUNT, size: float = 0.3) -> list[Any]:
    """Return random arrays that a kernel reads."""
    rng, reads = np.random.default_rng(seed), meta["kernels"][name]["reads"]
    gains = {"kp": (0.0, 1e2), "kd": (0.0, 1.0)}  # explicit steps of the lightest links stand them
    ranges = [(gains.get(array, (-size, size)), shape) for array, shape in reads.items()]
    return [rng.uniform(*ends, (count, *shape)).astype(meta["dtype"]) for ends, shape in ranges]


def scalars(meta: Mapping[str, Any], name: str) -> dict[str, float]:
    """Return numbers of steps for a kernel that takes some."""
    return {"step": STEP, "steps": 3} if meta["kernels"][name]["scalars"] else {}


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
