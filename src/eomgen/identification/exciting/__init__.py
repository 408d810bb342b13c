"""Exciting motions: Fourier series within limits, their information about base parameters, and its exact gradients.

Uses ``dynamics`` and ``identifiable``, runtime, robot, description, motion and pipeline.
"""
