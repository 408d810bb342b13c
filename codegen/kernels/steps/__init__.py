"""Adaptive step size: tables of methods, and sizes that tolerances refer to."""
