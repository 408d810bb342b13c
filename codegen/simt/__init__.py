"""Equations -> one text that is CUDA, HIP, OpenCL C, C and C++: orders, registers, statements, a kernel per function.

Uses robot, joint, program, kernels, c and templates; beside c, whose modules these mirror.
"""
