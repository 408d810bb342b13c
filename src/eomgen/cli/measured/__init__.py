"""Commands about what was measured."""

from . import motions, poses, standard

COMMANDS = (*motions.COMMANDS, *poses.COMMANDS, *standard.COMMANDS)
