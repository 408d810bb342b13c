"""Which poses to measure: candidates that can be reached and seen, what they tell, an exchange, and how far it is off.

Uses the error model of ``geometry``, ``calibration``, robot and description; nothing here builds a kernel.
"""
