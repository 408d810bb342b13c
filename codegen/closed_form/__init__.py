"""Closed-form equations of small robots as traces of matrices, eqs. (5) and (10) to (12).

To be read, and to compare programs with.
Uses robot, program, joint, tree, forces and kernels.
"""
