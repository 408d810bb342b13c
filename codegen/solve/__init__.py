"""Forward dynamics: elimination of joints from the tips, and the factorised mass matrix.

Uses tree.
"""
