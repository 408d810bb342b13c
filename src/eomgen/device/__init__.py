"""Kernels on CUDA devices, called with device arrays.

CUDA by the driver's library and NVRTC through ctypes, loaded when asked for.
Uses kernel, robot, codegen (kernels, c, program, simt, package), templates and pipeline.
"""
