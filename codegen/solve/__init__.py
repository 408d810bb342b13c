"""Accelerations from forces: joint elimination, factorised mass matrix, free bodies, rotors.

Uses robot, tree and forces.
"""
