"""Which poses to measure: candidates within reach and sight, their information, an exchange, and how far it is off.

Uses the error model of ``geometry``, ``calibration``, robot and description; nothing here builds a kernel.
"""
