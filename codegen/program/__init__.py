"""Straight-line programs: instructions, optimization passes, differentiation.

Uses the root alone; nothing is known here of robots.
"""
