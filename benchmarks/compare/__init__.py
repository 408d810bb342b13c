"""A commit compared with the working tree: ``python -m benchmarks.compare COMMIT [ROW ...]``.

rows      what is measured: robot, method, arrays
child     the process of one version; it uses the public API of its own eomgen alone
__main__  both versions built, their results compared, their times taken in turns
"""
