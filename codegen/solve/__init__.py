"""Accelerations from forces: joints eliminated from the tips, the factorised mass matrix, free bodies, rotors.

Uses robot, tree and forces.
"""
