"""A scenario: motion, control and loads of a simulation, whatever the robot; an immutable value.

Names of joints, links and frames are checked when it meets a robot (``eomgen.simulation.run_scenario``).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping
from dataclasses import KW_ONLY, dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any, NoReturn

import numpy as np

from ..errors import InputError
from ..forms.toml_place import refusal
from ..integration.plan import IntegratorOptions
from ..motion.timetable import TimeTable
from ..names import nearest, show
from ..robot.geometry import Vector


@dataclass(frozen=True)
class Section:
    """A table of a scenario with a ``type``: its values by key, as written, numbers as float."""

    type: str
    values: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "values", MappingProxyType(dict(self.values)))

    def __reduce__(self) -> tuple[object, ...]:
        return (Section, (self.type, dict(self.values)))  # a mapping proxy cannot be pickled

    def get(self, key: str, default: Any = None) -> Any:
        """Return the value, or the default where the key is absent."""
        return self.values.get(key, default)


@dataclass(frozen=True)
class Initial:
    """The state at t = 0.

    q, v: by coordinate or joint, m, rad, per s.  equilibrium: static equilibrium near q; None without the key.
    held: coordinates that are fixed at their q.  z: internal states by their names, which an equilibrium keeps.
    """

    q: Mapping[str, float] = field(default_factory=dict)
    v: Mapping[str, float] = field(default_factory=dict)
    equilibrium: bool | None = None
    held: tuple[str, ...] = ()
    z: Mapping[str, float] = field(default_factory=dict)

    def __reduce__(self) -> tuple[object, ...]:
        return (Initial, (dict(self.q), dict(self.v), self.equilibrium, self.held, dict(self.z)))


@dataclass(frozen=True)
class Wrench:
    """Force (N) and moment (N m) on a link, from t0 to t1 (s).

    axes: "base" or "link".  point: where the force acts, link frame, m; None is the centre of mass.  table: of
    robot.coordinates.FORCES over time; one row where they are constant.
    """

    link: str
    table: TimeTable
    axes: str = "base"
    point: Vector | None = None
    t0: float = 0.0
    t1: float | None = None


@dataclass(frozen=True)
class Payload:
    """A rigid body that belongs to a link from t0 on, until t1 (s).

    mass: kg.  point: its centre of mass, link frame, m.  inertia: kg m^2, INERTIA_KEYS, about that, link axes.
    """

    link: str
    mass: float
    point: Vector = (0.0, 0.0, 0.0)
    inertia: tuple[float, float, float, float, float, float] = (0.0,) * 6
    t0: float = 0.0
    t1: float | None = None


@dataclass(frozen=True)
class Integrator(IntegratorOptions):
    """Integrator of a scenario, whose absolute tolerance is one number."""

    atol: float | None = None


@dataclass(frozen=True)
class Scenario:
    """A simulation as a value: duration, motion, control, loads; times in s.

    ``motion`` and ``control`` are None without a reference or drives, ``until`` where the duration ends it.
    ``source`` is the file, ``folder`` where it and the files that it names stand; ``text`` is the file's text, for
    the lines of messages.
    """

    duration: float
    _: KW_ONLY
    output_step: float | None = None
    frame: str | None = None
    initial: Initial | None = None
    motion: Section | None = None
    control: Section | None = None
    prescribed: tuple[Section, ...] = ()
    wrenches: tuple[Wrench, ...] = ()
    payloads: tuple[Payload, ...] = ()
    until: Section | None = None
    integrator: Integrator = Integrator()
    source: str = ""
    folder: Path | None = None
    text: str = field(default="", repr=False, compare=False)

    def label(self, key: str) -> str:
        """Return the name of a key in messages: with file and tables, or as the argument of a function."""
        return f"{self.source}: {key}" if self.source else key.rpartition(".")[2]

    def fail(self, key: str, message: str) -> NoReturn:
        """Raise the error of a key: DescriptionError with the file, line and column."""
        if not self.source:
            raise InputError(f"{self.label(key)}: {message}")
        raise refusal(message, key, self.source, self.text)

    def refuse(self, key: str, name: str, known: Iterable[str], what: str = "is unknown") -> NoReturn:
        """Raise the error of a key whose name is not among the known ones."""
        self.fail(key, f"{show(name)}{nearest(name, known)} {what}; allowed: {', '.join(known) or 'none'}")

    def as_dict(self) -> dict[str, Any]:
        """Return everything but the file's place, as values that JSON holds; tables of files are in it."""
        return {
            item.name: _plain(getattr(self, item.name))
            for item in dataclasses.fields(self)
            if item.name not in ("source", "folder", "text") and getattr(self, item.name) not in (None, ())
        }


def _plain(value: object) -> Any:
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        values = ((item.name, getattr(value, item.name)) for item in dataclasses.fields(value))
        return {name: _plain(x) for name, x in values if x is not None}
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, Mapping):
        return {str(key): _plain(x) for key, x in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(x) for x in value]
    if isinstance(value, np.generic):
        return value.item()
    return value if isinstance(value, (str, float, int, bool, type(None))) else type(value).__name__
