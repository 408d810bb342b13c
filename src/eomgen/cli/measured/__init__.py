"""Commands about what was measured, and what tolerances make of it."""

from . import exciting, motions, poses, standard, tolerances

COMMANDS = (*motions.COMMANDS, *exciting.COMMANDS, *poses.COMMANDS, *standard.COMMANDS, *tolerances.COMMANDS)
