"""C, CMake, Python, HTML and JavaScript as Jinja templates, which hold text while Python decides what goes in; and scripts
of live pages, which are plain files.

Uses nothing; codegen, export and pictures fill them.
"""
