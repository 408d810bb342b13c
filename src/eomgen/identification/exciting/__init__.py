"""Motions that excite: Fourier series within limits, what they tell of base parameters, and their exact gradients.

Uses ``dynamics`` and ``identifiable``, runtime, robot, description, motion and pipeline.
"""
