"""Kernels as functions of other people's tools: ``eomgen.adapters.casadi``, ``.jax`` and ``.torch``.

Each is an extra and imports its tool when it is used; importing eomgen imports none of them.
Uses runtime, robot, description, control, device, codegen (arrays, c, kernels, package) and pipeline.
"""
