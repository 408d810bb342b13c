"""Robots for other tools: functional mock-up units, models of MuJoCo.

Uses runtime, robot, description, codegen (c, package), templates and pipeline.
"""

from .fmu import export_fmu
from .mujoco import export_mjcf

__all__ = ["export_fmu", "export_mjcf"]
