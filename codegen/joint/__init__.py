"""One joint in SymPy: the lemmas, what vanishes identically and why.

Uses robot.
"""
