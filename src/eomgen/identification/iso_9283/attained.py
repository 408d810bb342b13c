"""Attained poses and paths beside the commanded ones, wherever they come from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...arrays import Array


@dataclass(frozen=True)
class Record:
    """A tool over time in one cycle: t, (T,), s, or None where times are not known; position, (T, 3), m; rotation."""

    t: Array | None
    position: Array
    rotation: Array | None

    @property
    def last(self) -> Array:
        """The last position, (3,)."""
        return np.asarray(self.position[-1])


@dataclass(frozen=True)
class Pose:
    """A commanded pose and what was attained, cycle by cycle.

    Attributes:
        name: of the pose.
        position, rotation: the command, (3,), m, base frame, and (3, 3), or None where no orientation is known.
        cycles: a record for each cycle, whose last sample is what was attained.
        labels: numbers of the cycles, which poses of one cycle share.
    """

    name: str
    position: Array
    rotation: Array | None
    cycles: tuple[Record, ...]
    labels: tuple[int, ...]

    @property
    def attained(self) -> Array:
        """Attained positions, (n, 3), m."""
        return np.array([record.last for record in self.cycles])

    @property
    def attained_rotation(self) -> Array | None:
        """Attained orientations, (n, 3, 3), or None."""
        rotations = [record.rotation[-1] for record in self.cycles if record.rotation is not None]
        return np.array(rotations) if len(rotations) == len(self.cycles) else None


@dataclass(frozen=True)
class Path:
    """A commanded path and what was attained, cycle by cycle; ``command`` and ``cycles`` are records."""

    name: str
    command: Record
    cycles: tuple[Record, ...]


@dataclass(frozen=True)
class Measured:
    """All poses and paths of one test.

    Attributes:
        source: what they come from, in a word or two.
        robot, frame: names; empty where they are not known.
        load, rate: what is known of them; empty where nothing is.
        exact: whether cycles repeat themselves because nothing differs between them.
        notes: lines about what was taken and what was left out.
    """

    source: str
    robot: str
    frame: str
    load: str
    rate: str
    poses: tuple[Pose, ...]
    paths: tuple[Path, ...]
    exact: bool
    notes: tuple[str, ...]
