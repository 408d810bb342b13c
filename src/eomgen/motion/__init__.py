"""Motions of coordinates and tools over time, given by ends, programs, tables or files.

Uses runtime, robot and forms.
"""
