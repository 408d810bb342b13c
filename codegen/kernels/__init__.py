"""Model -> Equations: the descriptors of all kernels, and the program of each.

A new kernel is an entry of ``signatures`` and a function of ``writers``.
Uses robot, kernel, program, joint, tree, forces and solve.
"""
