"""Equations -> device source: CUDA, HIP, OpenCL C, C, C++.

Uses robot, joint, program, kernels, c and templates; beside c, whose modules these mirror.
"""
