"""Commands about what is to be measured, what was measured, what tolerances make of it, and what to command for it."""

from . import accuracy, motions, poses

COMMANDS = (*motions.COMMANDS, *poses.COMMANDS, *accuracy.COMMANDS)
