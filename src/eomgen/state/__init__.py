"""A kernel in one state: motors behind their gears, springs and their stiffness, equilibrium, vectors of a state.

Uses runtime and robot.
"""
