"""Words that options take, for help and shells: tests compare them with the functions' types.

What they come from imports NumPy and SciPy, for which nobody waits to read a help.
"""

FORMATS = ("robot", "scenario", "plan")
LOSSES = ("huber", "cauchy", "tukey")
VARIANTS = ("placement", "zeros", "full", "prior")
MEASURES = ("pose", "position", "distance")
POSE_CRITERIA = ("D", "V")
EXCITATION_CRITERIA = ("D", "condition")
ROTATIONS = ("rotvector", "rpy", "quaternion")
AXES = ("x", "y", "z", "-x", "-y", "-z")
TERMS = ("links", "rotors", "viscous", "dry", "offset")
FURTHER_TERMS = ("stribeck", "gains", "delay", "transmissions", "modes")
SHAPES = ("lorentzian", "gaussian")
MODES = ("dynamic", "static")
KINDS = ("displacement", "velocity", "acceleration")
