"""Commands about what was measured."""

from . import compensating, motions, poses, standard

COMMANDS = (*motions.COMMANDS, *poses.COMMANDS, *standard.COMMANDS, *compensating.COMMANDS)
