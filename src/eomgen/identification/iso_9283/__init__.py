"""Figures of ISO 9283:1998: how accurately and how repeatably a tool comes to poses and follows paths.

Uses runtime, robot, motion, simulation and sweep.
"""
