"""Compensation: what to command so that an elastic robot's tool goes where the rigid one's would; files of it.

Uses runtime, robot, forms, motion, scenario and simulation, and of identification ``geometry``.
"""
