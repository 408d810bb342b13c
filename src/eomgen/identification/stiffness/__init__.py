"""Stiffness and damping from measured motion and known drives: of trees, and of what loops and couplings leave free.

Uses runtime, robot, results, description, state, motion and pipeline.
"""
