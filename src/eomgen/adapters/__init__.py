"""Kernels as functions of CasADi, JAX and PyTorch.

Each is an extra and imports its tool when it is used; importing eomgen imports none of them.
Uses runtime, kernel, robot, description, control, device, codegen (arrays, c, kernels, package) and pipeline.
"""
