"""Equations -> C: statements, functions, files, CMake projects, metadata.

Uses robot, program, joint, tree, solve, kernels and templates.
"""
