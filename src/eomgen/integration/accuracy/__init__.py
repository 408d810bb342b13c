"""Errors of integrated motions: local ones by collocation, carried along the motion to the global one.

Uses the system and loads of integration, runtime, robot, state and loops.
"""
