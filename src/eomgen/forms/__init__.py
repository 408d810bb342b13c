"""TOML tables by declared keys: types, ranges, positions of errors, JSON Schema.

Whatever the tables are about: nothing is known here of robots.
Uses the root alone.
"""
