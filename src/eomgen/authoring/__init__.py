"""Files that people write: what is wrong with one, a first one to begin with, their JSON Schemas.

Uses forms, and the keys and readers of description, scenario and sweep; nothing is generated.
"""
