"""Source -> an importable package: its files, the C compiler, cffi.

Uses c, the names of kernels, and the files of runtime, which it copies; neither SymPy nor a robot.
"""
