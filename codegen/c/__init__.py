"""Equations -> C: statements, functions, files, projects around them, and the metadata that Python reads.

Uses robot, the table of methods in runtime, program, joint, tree, solve, kernels and templates.
"""
