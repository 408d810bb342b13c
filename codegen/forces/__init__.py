"""Generalized forces: laws of coordinates, measured curves, springs between points, journals, whole joints, wrenches.

A new law is an entry of ``robot.laws`` and its formula in ``laws``.
Uses robot, program and tree.
"""
