"""TOML tables by their forms: keys, types, ranges, places of what is wrong, JSON Schema.

Whatever the tables are about: nothing is known here of robots.
Uses the root alone.
"""
