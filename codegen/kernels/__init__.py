"""Model -> Equations: the table of kernels, and the program that each of them is.

Uses program, joint, tree, forces and solve.
"""
