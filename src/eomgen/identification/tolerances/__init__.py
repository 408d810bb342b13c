"""Accuracy of a tool by the tolerances of what a robot is made of: regions, worst cases, shares, which to tighten.

Uses runtime, robot, forms, description, state, motion and the root; nothing here builds a kernel.
"""
