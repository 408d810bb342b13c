"""Kernels on GPUs: the source of codegen.simt compiled for a device of CUDA, called with arrays that lie on it.

CUDA by the driver's library and NVRTC through ctypes, loaded when asked for.
Uses runtime, robot, codegen (kernels, c, program, simt, package), templates and pipeline.
"""
