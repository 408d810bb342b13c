"""One joint in SymPy: eq. (3), its derivatives, the proofs of the lemmas, what builds need of all that as plain values,
and the map of what vanishes.

Uses robot.
"""
