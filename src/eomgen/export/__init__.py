"""Robots for other tools: mock-up units, models of MuJoCo, WebAssembly, live pages, Python on arrays, wheels.

Uses runtime, robot, description, state, loops, motion, integration, scenario, codegen (arrays, c, kernels, package),
templates, pipeline, simulation and pictures.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..lazily import attributes

if TYPE_CHECKING:
    from .arrays import export_arrays
    from .fmu import export_fmu
    from .live import export_live
    from .mujoco import export_mjcf
    from .wasm import export_wasm
    from .wheel import export_wheel

__all__ = ["export_arrays", "export_fmu", "export_live", "export_mjcf", "export_wasm", "export_wheel"]

_MODULES = {
    "export_arrays": "arrays",
    "export_fmu": "fmu.pack",
    "export_live": "live.page",
    "export_mjcf": "mujoco",
    "export_wasm": "wasm.pack",
    "export_wheel": "wheel",
}


if not TYPE_CHECKING:  # or type checkers would take every name to be there
    __getattr__ = attributes(__name__, _MODULES)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
