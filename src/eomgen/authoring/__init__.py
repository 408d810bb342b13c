"""Files that people write: what is wrong with one, a new one, their JSON Schemas.

Uses forms, description, scenario and sweep.
"""
