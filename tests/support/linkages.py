"""Kernels of mechanisms with closed loops."""

from __future__ import annotations

KERNELS = (
    "constraint",
    "constraint_jacobian",
    "constraint_bias",
    "cut_poses",
    "constrained_dynamics",
    "mass_matrix",
    "inverse_dynamics",
    "energy",
    "kinematics",
)
