"""Many steps in one call of C: rollouts of fixed steps, steps that the error chooses, and loads that are data.

A generated package carries a copy of this folder.
"""
