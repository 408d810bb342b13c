"""Export to FMU, MuJoCo, acados, WebAssembly, GPU source, NumPy, JAX and wheels.

Uses runtime, kernel, robot, description, state, loops, motion, integration, scenario, codegen (arrays, c, kernels,
package, simt), templates, pipeline, simulation, control and pictures.
"""

from typing import TYPE_CHECKING

from ..lazily import lazy_names

if TYPE_CHECKING:
    from .acados import export_acados as export_acados
    from .arrays import export_arrays as export_arrays
    from .fmu import export_fmu as export_fmu
    from .live import export_live as export_live
    from .mujoco import export_mjcf as export_mjcf
    from .simt import export_simt as export_simt
    from .wasm import export_wasm as export_wasm
    from .wheel import export_wheel as export_wheel
else:
    __getattr__, __dir__, __all__ = lazy_names(__name__)
