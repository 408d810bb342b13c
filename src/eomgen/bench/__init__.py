"""Kernels compared with a Newton-Euler algorithm in C: operations and times.

Uses runtime, kernel, robot, description, codegen (tree, kernels, c, package), templates and pipeline.
"""
