"""TOML tables by their forms: keys, types, ranges, places of what is wrong, JSON Schema; whatever they are about.

Uses the root alone.
"""
