"""Methods of kernels in groups, a class and a file each; ``Kernel`` inherits them.

A generated package carries a copy of this folder.
"""
