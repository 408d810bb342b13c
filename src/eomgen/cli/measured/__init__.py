"""Commands about what is to be measured, what was measured, what tolerances make of it, and what to command for it."""

from . import compensating, exciting, motions, poses, standard, tolerances

_MODULES = (motions, exciting, poses, standard, tolerances, compensating)
COMMANDS = tuple(command for module in _MODULES for command in module.COMMANDS)
