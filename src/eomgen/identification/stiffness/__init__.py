"""Stiffness and damping from measured motion and known drives, numbers of laws by simulations (``output_error``).

Uses runtime, robot, results, description, state, motion and pipeline.
"""
