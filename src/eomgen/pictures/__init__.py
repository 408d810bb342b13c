"""Figures, pages and views of robots and results.

Uses runtime, robot, description, codegen.joint, pipeline, simulation, analysis and sweep.
"""
