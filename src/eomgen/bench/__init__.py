"""Operation counts and times of kernels beside a Newton-Euler algorithm in C.

Uses runtime, robot, description, codegen (tree, kernels, c, package), templates and pipeline.
"""
