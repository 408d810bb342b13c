"""Forces as programs: laws of coordinates, measured curves, springs between points.

Uses program and tree.
"""
