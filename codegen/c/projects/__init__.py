"""Files beside a robot's C: a CMake project, headers of C++, MEX, a package of ROS 2, a test program.

Uses robot, runtime, c, kernels and templates.
"""
