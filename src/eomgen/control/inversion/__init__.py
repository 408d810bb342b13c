"""Stable inversion: drives by which outputs follow a motion, with all that moves between them."""
