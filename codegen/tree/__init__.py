"""Joint blocks bound along the tree, on symbols, floats or nodes of a program alike.

Uses robot and joint.
"""
