"""Generalized forces: laws of coordinates, springs, bushings, journals, whole joints, wrenches.

A new law is an entry of ``robot.laws`` and its formula in ``laws``; a new kind of force a class in ``elements``.
Uses robot, program and tree.
"""
