"""Straight-line programs: instructions, passes over them, forward differentiation.

Uses nothing of eomgen.
"""
