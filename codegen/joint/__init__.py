"""One joint in SymPy: eq. (3), its derivatives, and which terms vanish.

Uses robot.
"""
