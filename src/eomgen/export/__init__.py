"""Robots for other tools: mock-up units, models of MuJoCo, WebAssembly, live pages, Python on arrays, wheels.

Uses runtime, robot, description, state, loops, motion, integration, scenario, codegen (arrays, c, kernels, package),
templates, pipeline, simulation and pictures.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..lazily import attributes

if TYPE_CHECKING:
    from .arrays import export_arrays as export_arrays
    from .fmu import export_fmu as export_fmu
    from .live import export_live as export_live
    from .mujoco import export_mjcf as export_mjcf
    from .wasm import export_wasm as export_wasm
    from .wheel import export_wheel as export_wheel
else:  # or type checkers would take every name to be there
    __getattr__, __dir__, __all__ = attributes(
        __name__,
        "arrays: export_arrays",
        "fmu.pack: export_fmu",
        "live.page: export_live",
        "mujoco: export_mjcf",
        "wasm.pack: export_wasm",
        "wheel: export_wheel",
    )
