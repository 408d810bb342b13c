"""Parts that commands share: what a command is, its arguments and options, how it reads, shows progress and prints.

Nothing here is particular to one command, and nothing imports a command.
"""
