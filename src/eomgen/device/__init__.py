"""Kernels on accelerators: the text of codegen.simt compiled for a device, called with arrays that lie on it.

CUDA and HIP by the driver's library through ctypes, OpenCL by pyopencl; each is loaded when asked for.
Uses runtime, robot, codegen (kernels, c, program, simt, package), templates and pipeline.
"""
