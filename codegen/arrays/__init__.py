"""Equations -> Python source on NumPy or JAX arrays.

Uses robot, program, kernels and templates; beside c, whose modules these mirror.
"""
