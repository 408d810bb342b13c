"""A derivation to be read: what SymPy derived of a model's joints, and the terms of M and C that survive.

Uses robot, joint, closed_form and c.
"""
