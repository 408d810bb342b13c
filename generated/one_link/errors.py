"""The errors that eomgen raises: your input, or our bug.

Every message names the thing, the value that came, and what is allowed.  This file imports nothing of eomgen, so that a
generated package can carry a copy of it.
"""

from __future__ import annotations

from typing import Any


class EomgenError(Exception):
    """Base of all errors that eomgen raises on purpose."""


class InputError(EomgenError, ValueError):
    """Something the user gave cannot be used; the message says what, where and what is allowed."""


class DescriptionError(InputError):
    """A robot description, a scenario or a plan is wrong.

    Args:
        message: what is wrong, with the value and what is allowed.
        where: the place inside the description, such as ``joints.joint2.x.stiffness``.
        source: the file, or the name of the built-in robot.
        path: keys (and indices as digits) of the place, where it is not that of ``where``.
        at_key: the last key itself is wrong, and not its value.

    Attributes:
        line, column: in the file, from 1: of the value, of a key that is unknown, or of the table where one is missing;
            in a URDF of the element; None where they are not known.
    """

    def __init__(
        self, message: str, *, where: str = "", source: str = "", path: tuple[str, ...] = (), at_key: bool = False
    ) -> None:
        self.message, self.where, self.source, self.path, self.at_key = message, where, source, path, at_key
        self.line: int | None = None
        self.column: int | None = None
        super().__init__(message)

    def __str__(self) -> str:
        return ": ".join(piece for piece in (self.place, self.where, self.message) if piece)

    @property
    def place(self) -> str:
        """``file:line:column``, as editors and terminals follow it; as much of it as is known."""
        known = [(name, at) for name, at in (("line", self.line), ("column", self.column)) if at is not None]
        if self.source:
            source = self.source if self.source.isprintable() else ascii(self.source)
            return ":".join([source, *(str(at) for _, at in known)])
        return ", ".join(f"{name} {at}" for name, at in known)


class ArrayError(InputError):
    """An array argument has the wrong shape, dtype or layout, or holds NaN or infinity.

    Attributes:
        coordinate: name of the coordinate whose number is not finite; empty where something else is wrong.
    """

    def __init__(self, message: str, coordinate: str = "") -> None:
        super().__init__(message)
        self.coordinate = coordinate


class UnknownNameError(InputError, KeyError):
    """A coordinate, link, joint, frame or parameter of that name does not exist."""

    def __str__(self) -> str:
        return str(self.args[0]) if self.args else ""


class SingularError(InputError, ArithmeticError):
    """The mass matrix cannot be inverted in a state, or a loop is at a singular pose; the message names it."""


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


class ReachError(InputError):
    """A tool cannot be brought into a pose; the message says by how much it misses it.

    Attributes:
        distance: what the tool's origin misses, m; infinite where loops cannot be closed.
        angle: what its axes miss, rad; 0 where they are open.
        q: the coordinates that come nearest, (n,).
    """

    def __init__(self, message: str, distance: float, angle: float, q: Any) -> None:
        super().__init__(message)
        self.distance, self.angle, self.q = distance, angle, q

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.args[0], self.distance, self.angle, self.q)


class IntegrationError(InputError):
    """A simulation could not go on; the message says when and why."""


class IntegrationStopped(IntegrationError):
    """An integration that could not go on, with its last good state and the results until then.

    Attributes:
        t: time of the last good state, s.
        q, v: that state, (n,).
        z: internal states there, (m,); None where v has them behind the coordinates, or there are none.
        coordinate: name of the coordinate that is to blame: it, its drive or its acceleration is not finite, or it
            moves fastest for its size.
        trajectory: the ``Trajectory`` up to the last good state, which is its last sample (of ``simulate``: up to the
            last whole output step); None where nothing could be evaluated.
        result: of ``simulate`` and ``run_scenario`` the ``SimulationResult`` of that trajectory, which can be saved.
        stored: of ``Kernel.rollout`` q and v, shaped as its results; NaN where nothing good was reached.
    """

    def __init__(self, message: str, t: float, q: Any, v: Any, coordinate: str, z: Any = None) -> None:
        super().__init__(message)
        self.t, self.q, self.v, self.z, self.coordinate = t, q, v, z, coordinate
        self.trajectory: Any = None
        self.result: Any = None
        self.stored: Any = None

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the last good state alone; the trajectory and the result, which may be large, stay behind."""
        return type(self), (self.args[0], self.t, self.q, self.v, self.coordinate, self.z)

    def set_apart(self, coordinates: int) -> None:
        """Take what stands behind so many coordinates in the last good state as ``z``: internal states."""
        if self.z is None and len(self.v) > coordinates:
            self.q, self.v, self.z = self.q[:coordinates], self.v[:coordinates], self.v[coordinates:]


class InternalError(EomgenError):
    """A bug of eomgen: something that the code relies on does not hold.  Please report it."""


class EomgenWarning(UserWarning):
    """Something to know about, although it works: an inertia that no body can have."""
