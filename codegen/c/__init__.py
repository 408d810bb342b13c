"""Equations -> C: statements, functions, files, CMake projects, metadata.

Uses robot, runtime, the table of methods in kernel, program, joint, tree, solve, kernels and templates.
"""
