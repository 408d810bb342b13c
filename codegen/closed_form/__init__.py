"""Closed-form equations of small robots, as traces of matrices.

To be read, and to compare programs with.
Uses robot, program, joint, tree, forces and kernels.
"""
