"""The text as cubins of NVIDIA's processors, compiled by NVRTC without a device: registers and spills."""

from __future__ import annotations

import ctypes
import importlib.util
import json
import re
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from eomgen.codegen.simt.sources import render_simt
from eomgen.description import as_robot
from eomgen.robot.model import build_model

pytestmark = pytest.mark.soak

PROCESSORS = ("sm_80", "sm_90", "sm_120")
KERNELS = ("inverse_dynamics", "mass_matrix", "forward_dynamics", "residual", "frame_poses", "rk4_rollout")
_FIGURES = re.compile(r"Function properties for (\w+)\n.*?(\d+) bytes spill stores, .*\n.*?Used (\d+) registers")


@cache
def library() -> Any:
    """Return NVRTC of the package nvidia-cuda-nvrtc-cu12; None where it is not installed."""
    try:
        spec = importlib.util.find_spec("nvidia.cuda_nvrtc")
    except ModuleNotFoundError:
        return None
    places = [Path(place) for place in spec.submodule_search_locations or ()] if spec else []
    found = [path for place in places for path in place.glob("lib/libnvrtc.so.*")]
    return ctypes.CDLL(str(found[0])) if found else None


def figures(text: str, processor: str) -> dict[str, tuple[int, int]]:
    """Return, per kernel, registers and bytes that are stored for want of them."""
    nvrtc, program = library(), ctypes.c_void_p()
    if nvrtc is None:
        pytest.skip("nvidia-cuda-nvrtc-cu12 is not installed")
    assert nvrtc.nvrtcCreateProgram(ctypes.byref(program), text.encode(), b"kernels.cu", 0, None, None) == 0
    words = [f"--gpu-architecture={processor}", "--fmad=false", "--std=c++17", "--ptxas-options=-v"]
    status = nvrtc.nvrtcCompileProgram(program, len(words), (ctypes.c_char_p * len(words))(*map(str.encode, words)))
    size = ctypes.c_size_t()
    nvrtc.nvrtcGetProgramLogSize(program, ctypes.byref(size))
    log = ctypes.create_string_buffer(size.value)
    nvrtc.nvrtcGetProgramLog(program, log)
    assert status == 0, log.value.decode()[-2000:]
    nvrtc.nvrtcDestroyProgram(ctypes.byref(program))
    return {name: (int(used), int(stored)) for name, stored, used in _FIGURES.findall(log.value.decode())}


@pytest.mark.parametrize("processor", PROCESSORS)
@pytest.mark.parametrize("name", ["ur5", "panda"])
def test_nothing_is_spilled_in_single_precision(name: str, processor: str) -> None:
    source = render_simt(build_model(as_robot(name)), KERNELS, "float32")
    found = figures(source.code, processor)
    assert found.keys() >= {f"{name}_{kernel}" for kernel in KERNELS}
    assert {kernel: stored for kernel, (_, stored) in found.items() if stored} == {}


@pytest.mark.parametrize("processor", PROCESSORS)
def test_registers_of_an_arm_in_double_precision(processor: str) -> None:
    source = render_simt(build_model(as_robot("ur5")), ("inverse_dynamics", "forward_dynamics", "mass_matrix"))
    for kernel, (used, stored) in figures(source.code, processor).items():
        assert stored == 0, kernel
        assert used <= 168, kernel


@pytest.mark.parametrize("processor", PROCESSORS)
def test_nothing_is_spilled_by_36_coordinates_in_single_precision(processor: str) -> None:
    source = render_simt(build_model(as_robot("puma560_elastic")), ("forward_dynamics", "inverse_dynamics"), "float32")
    assert [stored for _, stored in figures(source.code, processor).values()] == [0] * 4


def test_derivatives_in_parts_spill_less() -> None:
    """In double precision: 1.7 kB whole."""
    model = build_model(as_robot("ur5"))
    source = render_simt(model, ("forward_dynamics_jacobian",))
    functions = json.loads(source.meta)["kernels"]["forward_dynamics_jacobian"]["functions"]
    found = figures(source.code, "sm_90")
    assert len(functions) > 1
    assert sum(found[function][1] for function in functions) <= 700
