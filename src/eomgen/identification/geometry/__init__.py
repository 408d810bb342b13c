"""A robot's errors: measured poses, stations of six coordinates, what they predict, and least squares on all of it.

Uses runtime, robot, motion and the root; nothing here builds a kernel.
"""
