"""Counts and times of kernels beside a Newton-Euler algorithm in C.

Uses runtime, robot, codegen.tree, codegen.c, codegen.package and pipeline.
"""
