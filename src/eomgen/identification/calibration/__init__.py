"""Calibration: from measured poses to offsets, placements and stiffness, with what is known of them; files of it.

Uses the error model of ``geometry``, robot, forms and description.
"""
