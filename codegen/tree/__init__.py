"""Recursions along the tree: eqs. (5), (11), (12), poses, constraints, derivatives.

The same code works on symbols, floats and nodes of a program; ``frozen_joints`` begins where SymPy ends.
Uses robot, joint and program.
"""
