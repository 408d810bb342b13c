"""The generator: SymPy joint blocks bound along the tree, programs, C, a package that imports.

program < joint < tree < forces < solve < kernels < closed_form < c < package: each uses those before it, and robot.
"""
