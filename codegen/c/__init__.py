"""Programs -> C: statements, functions, files, and the metadata that Python reads.

Uses program, joint, solve and kernels.
"""
