"""C -> a package that imports: compiler, flags, cffi.

Uses c.
"""
