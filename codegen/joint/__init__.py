"""One joint in SymPy: eq. (3), its derivatives and proofs of the lemmas, as plain values for the recursion; and the map
of what vanishes.

Uses robot.
"""
