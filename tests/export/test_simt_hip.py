"""The text as HIP, compiled by clang for AMD's processors without ROCm: what HIP knows by itself is declared here."""

from __future__ import annotations

import re
import shutil
import subprocess
from functools import cache
from pathlib import Path

import pytest

from eomgen.codegen.simt.sources import CONTRACTION, render_simt
from eomgen.description import as_robot
from eomgen.robot.model import build_model

pytestmark = pytest.mark.soak

PROCESSORS = ("gfx90a", "gfx942", "gfx1100")  # MI200, MI300, Radeon RX 7900
OLDEST = 17  # clang that knows them all
KERNELS = ("inverse_dynamics", "mass_matrix", "forward_dynamics", "residual", "frame_poses", "rk4_rollout")
FUSED = re.compile(r"llvm\.fmuladd|\bf(add|sub) (contract|fast)\b")
RUNTIME = """
#define __global__ __attribute__((global))
#define __device__ __attribute__((device))
#define __forceinline__ inline __attribute__((always_inline))
#define __HIPCC__ 1
#define EOM_BOUNDS __attribute__((amdgpu_flat_work_group_size(1, 256))) /* __launch_bounds__(256) */
struct eom_place { unsigned int x; };
#define blockIdx (eom_place{__builtin_amdgcn_workgroup_id_x()})
#define threadIdx (eom_place{__builtin_amdgcn_workitem_id_x()})
#define blockDim (eom_place{__builtin_amdgcn_workgroup_size_x()})
static __device__ long long __double_as_longlong(double x) { return __builtin_bit_cast(long long, x); }
static __device__ int __float_as_int(float x) { return __builtin_bit_cast(int, x); }
static __device__ double fabs(double x) { return __builtin_fabs(x); }
static __device__ float fabsf(float x) { return __builtin_fabsf(x); }
static __device__ double sqrt(double x) { return __builtin_sqrt(x); }
static __device__ float sqrtf(float x) { return __builtin_sqrtf(x); }
extern "C" __device__ double exp(double x), log(double x), atan2(double y, double x);
extern "C" __device__ float expf(float x), logf(float x), atan2f(float y, float x);
static __device__ void atomicMin(unsigned int *x, unsigned int y) { (void)__atomic_fetch_min(x, y, __ATOMIC_RELAXED); }
"""


@cache
def clang() -> str | None:
    """Return the newest clang that knows these processors."""
    for name in (*(f"clang-{version}" for version in range(30, OLDEST - 1, -1)), "clang"):
        if shutil.which(name):
            said = subprocess.run([name, "--print-targets"], capture_output=True, text=True, check=False)
            version = subprocess.run([name, "-dumpversion"], capture_output=True, text=True, check=False).stdout
            if "amdgcn" in said.stdout and int(version.partition(".")[0] or 0) >= OLDEST:
                return name
    return None


def compiled(folder: Path, code: str, processor: str, *flags: str) -> str:
    """Return what clang makes of a text as HIP."""
    compiler = clang()
    if compiler is None:
        pytest.skip("no clang with AMD's processors is installed")
    (folder / "runtime.h").write_text(RUNTIME, encoding="ascii")
    (folder / "text.hip").write_text(code, encoding="ascii")
    words = ["-x", "hip", "--cuda-device-only", "-nogpuinc", "-nogpulib", f"--offload-arch={processor}", "-std=c++17"]
    words += ["-Wall", "-Wextra", "-Werror", "-Wno-unused-function", "-O2", "-S", *flags]
    words += ["-include", str(folder / "runtime.h"), str(folder / "text.hip"), "-o", "-"]
    done = subprocess.run([compiler, *words], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    return done.stdout


@pytest.mark.parametrize("processor", PROCESSORS)
@pytest.mark.parametrize("name", ["ur5", "worn_arm"])
def test_text_is_hip(tmp_path: Path, name: str, processor: str) -> None:
    """Of an arm, and of laws with all functions; in single precision an arm needs no memory for want of registers."""
    for dtype in ("float64", "float32"):
        source = render_simt(build_model(as_robot(name)), KERNELS, dtype)
        code = compiled(tmp_path, source.code, processor)
        sizes = [int(x) for x in re.findall(r"; ScratchSize: (\d+)", code)]
        assert len(sizes) >= len(KERNELS)
        assert all(f"{name}_{kernel}:" in code for kernel in KERNELS)
        if dtype == "float32" and name == "ur5":
            assert set(sizes) == {0}


@pytest.mark.parametrize("name", ["ur5", "worn_arm"])
def test_products_and_sums_are_one_operation_only_if_wanted(tmp_path: Path, name: str) -> None:
    """HIP's own choice is that they are: the text says otherwise by itself."""
    model = build_model(as_robot(name))
    for contract in (False, True):
        code = render_simt(model, ("forward_dynamics",), contract=contract).code
        for flags in ((), (CONTRACTION["hip"][contract],)):
            text = compiled(tmp_path, code, PROCESSORS[0], "-emit-llvm", *flags)
            assert bool(FUSED.search(text)) == contract, flags
