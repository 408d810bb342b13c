"""About a state or a path: statics, vibration, frequency responses, linear systems, error budgets.

Uses runtime, robot, state, loops, motion, pipeline and simulation.
"""
