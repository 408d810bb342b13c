"""Accuracy of a tool by the tolerances of what a robot is made of: regions, worst cases, shares, which to tighten.

Uses runtime, robot, forms, description, state, motion, analysis and the root; a kernel is built where links bend.
"""
