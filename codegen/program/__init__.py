"""Straight-line programs: their instructions, passes over finished ones, forward differentiation.

Uses the root alone; nothing is known here of robots.
"""
