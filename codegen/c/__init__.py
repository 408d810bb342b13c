"""Equations -> C: statements, functions, files, CMake projects, metadata.

Uses robot, the table of methods in kernel, runtime, program, joint, tree, solve, kernels and templates.
"""
