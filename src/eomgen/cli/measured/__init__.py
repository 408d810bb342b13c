"""Commands about what was measured, what tolerances make of it, and what to command for it."""

from . import compensating, motions, poses, standard, tolerances

COMMANDS = (*motions.COMMANDS, *poses.COMMANDS, *standard.COMMANDS, *tolerances.COMMANDS, *compensating.COMMANDS)
