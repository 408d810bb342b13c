"""Calls of compiled kernels with NumPy: all that a generated package carries.

Uses NumPy, cffi's objects, and of eomgen ``errors`` and ``names`` alone.
"""
