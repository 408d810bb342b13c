"""Files that people write: checks of one, a new one to begin with, their JSON Schemas.

Uses runtime, robot and forms, the keys and readers of description, scenario and sweep, and codegen (tree) on floats.
"""
