"""Inverse kinematics of kernels: the method, the Levenberg-Marquardt search, and rotations on their way to vectors.

A generated package carries a copy of this folder.
"""
