"""Around identification of masses and friction: couplings, gains, delays, Stribeck; traps; results, files of them.

Uses robot, forms, description and motion.
"""
