"""One joint in SymPy: eq. (3), its derivatives and the proofs of the lemmas, as plain values that the recursion reads; and
the map of what vanishes.

Uses robot.
"""
