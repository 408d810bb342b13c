"""Commands about what was measured, and what tolerances make of it."""

from . import motions, poses, standard, tolerances

COMMANDS = (*motions.COMMANDS, *poses.COMMANDS, *standard.COMMANDS, *tolerances.COMMANDS)
from . import compensating, motions, poses, standard

COMMANDS = (*motions.COMMANDS, *poses.COMMANDS, *standard.COMMANDS, *compensating.COMMANDS)
