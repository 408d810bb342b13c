"""Many steps in one call of C: rollouts of fixed steps, adaptive step size, and time-signal inputs.

A generated package carries a copy of this folder.
"""
