"""Closed-form equations of small robots, as the paper writes them.

Uses joint, tree and forces.
"""
