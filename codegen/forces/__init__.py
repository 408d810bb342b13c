"""Generalized forces: laws of coordinates, measured curves, springs between points, wrenches.

Uses robot, program and tree.
"""
