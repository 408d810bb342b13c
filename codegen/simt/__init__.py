"""Equations -> one text that is CUDA, HIP, OpenCL C, C and C++: orders, registers, statements, a kernel per function.

Uses robot, program, kernels, samples, c and templates; beside c, whose modules these mirror.
"""
