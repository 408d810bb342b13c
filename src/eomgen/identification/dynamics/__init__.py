"""Identification of masses and friction, with couplings, gains, delays, Stribeck; traps; results and files of them.

Uses runtime, robot, results, description, motion and pipeline.
"""
