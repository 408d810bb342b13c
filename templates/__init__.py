"""C, CMake, Python and HTML as Jinja templates: they hold text, Python decides what goes in.

Uses nothing; codegen, export and pictures fill them.
"""
