"""Equations -> Python text on arrays, for NumPy and JAX: statements, functions, a module that needs nothing else.

Uses robot, program, kernels and templates; beside c, whose modules these mirror.
"""
