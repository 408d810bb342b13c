"""What a measured motion says of a robot: forces, stiffness and damping with their confidence.

Uses runtime, robot, state, motion and pipeline.
"""
