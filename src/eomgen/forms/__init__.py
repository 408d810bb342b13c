"""TOML tables by their forms: keys, types, ranges, places of what is wrong, JSON Schema; declared types out of JSON.

Whatever the tables are about: nothing is known here of robots.
Uses the root alone.
"""
