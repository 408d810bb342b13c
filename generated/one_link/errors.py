"""The errors that eomgen raises: your input, or our bug.

Every message names the thing, the value that came, and what is allowed.  This file imports nothing, so that a
generated package can carry a copy of it.
"""

from __future__ import annotations


class EomgenError(Exception):
    """Base of all errors that eomgen raises on purpose."""


class InputError(EomgenError):
    """Something the user gave cannot be used; the message says what, where and what is allowed."""


class DescriptionError(InputError):
    """A robot description, a scenario or a plan is wrong.

    Args:
        message: what is wrong, with the value and what is allowed.
        where: the place inside the description, such as ``joints.joint2.x.stiffness``.
        source: the file, or the name of the built-in robot.
        path: keys (and indices as digits) of the place, where it is not that of ``where``.

    Attributes:
        line: of the file, from 1; None where it is not known.
    """

    def __init__(self, message: str, *, where: str = "", source: str = "", path: tuple[str, ...] = ()) -> None:
        self.message, self.where, self.source, self.path = message, where, source, path
        self.line: int | None = None
        super().__init__(message)

    def __str__(self) -> str:
        line = "" if self.line is None else f"line {self.line}"
        place = f"{self.where} ({line})" if self.where and line else self.where or line
        return ": ".join(part for part in (self.source, place, self.message) if part)


class ArrayError(InputError, ValueError):
    """An array argument has the wrong shape, dtype or layout, or holds NaN or infinity."""


class UnknownNameError(InputError, KeyError):
    """A coordinate, link, joint, frame or parameter of that name does not exist."""

    def __str__(self) -> str:
        return str(self.args[0]) if self.args else ""


class SingularError(InputError, ArithmeticError):
    """The mass matrix cannot be inverted in the given state; the message names the coordinate."""


class BuildError(InputError):
    """A kernel could not be compiled, loaded or cached; the message holds the command and what to do."""


class LoopError(InputError):
    """A loop does not close, or does not stay closed.

    Attributes:
        loop: its name.
        gap: what is left open, m, rad, or their rates.
    """

    def __init__(self, message: str, *, loop: str, gap: float) -> None:
        super().__init__(message)
        self.loop, self.gap = loop, gap


class IntegrationError(InputError):
    """A simulation could not go on; the message says when and why."""


class InternalError(EomgenError):
    """A bug of eomgen: something that the code relies on does not hold.  Please report it."""


class EomgenWarning(UserWarning):
    """Something the user asked for on purpose, but should know about (an inertia that no body can have, say)."""
