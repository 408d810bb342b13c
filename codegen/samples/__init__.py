"""Equations -> samples: what compiled code must answer in a few states, from the same programs in Python's arithmetic.

Uses robot, program, joint, solve, kernels and c.
"""
