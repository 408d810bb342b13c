"""Model -> Equations: the table of all kernels, and the program that each of them is.

A new kernel is an entry of ``signatures`` and a function of ``writers``.
Uses robot, runtime, program, joint, tree, forces and solve.
"""
