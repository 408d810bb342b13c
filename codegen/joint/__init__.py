"""One joint in SymPy: eq. (3), its derivatives, the proofs of the lemmas, and the map of what vanishes.

Uses robot.
"""
