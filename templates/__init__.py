"""Jinja templates of C, CMake, Python and web pages; Python decides what goes in.

Beside them lie the scripts of live pages, as they are.  Uses nothing; codegen, export and pictures fill them.
"""
