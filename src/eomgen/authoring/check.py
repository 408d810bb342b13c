"""Checks of files that people wrote, without generating anything, for ``eomgen check``."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ..description.builtin import builtin_robots
from ..description.load import SUFFIXES, load_robot
from ..description.macros import Xacro
from ..description.options import ReadOptions
from ..errors import DescriptionError, InputError
from ..files import as_path
from ..forms.structure import faults
from ..forms.toml_place import locate
from ..forms.toml_text import parse_toml, read_text
from ..forms.unusual_sizes import quantities_in, unit_note
from ..robot.internal_states.drives import short_time_notes
from ..robot.model import build_model
from ..scenario.load import load_scenario
from ..sweep.plan import load_plan
from .inertia import inertia_notes
from .schemas import FORMATS
from .stops import home_notes, start_notes
from .unusual import inherited_sizes


@dataclass(frozen=True)
class Checked:
    """A checked file: its kind (of ``FORMATS``), its counts, and all of its errors.

    summary: counts by name, such as links and coordinates; empty where there are errors.
    """

    file: str
    kind: str
    summary: Mapping[str, float]
    errors: tuple[InputError, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def lines(self) -> list[str]:
        """Lines to print."""
        if self.errors:
            return [str(error) for error in self.errors]
        counts = ", ".join(f"{value:g} {name}" for name, value in self.summary.items())
        return [f"{self.file}: ok: {counts}", *(self._note(note) for note in self.notes)]

    def _note(self, note: str) -> str:
        """Return a note behind its place, which is the file where the note has none."""
        placed = re.match(rf"({re.escape(self.file)}(?::[0-9]+)+): ", note)
        return f"{self.file}: note: {note}" if placed is None else f"{placed[1]}: note: {note[placed.end() :]}"

    def as_dict(self) -> dict[str, Any]:
        """Return values that JSON holds."""
        about = {"file": self.file, "kind": self.kind, "ok": not self.errors, **self.summary}
        return {**about, "errors": [_facts(error) for error in self.errors], "notes": list(self.notes)}


def check_file(
    path: str | Path,
    *,
    inertia: str | None = None,
    floating_base: bool = False,
    xacro: Xacro = False,
    xacro_args: Mapping[str, object] | None = None,
) -> Checked:
    """Read a description (.toml, .urdf, .xml), a scenario or a plan; which of them a .toml file is, its keys say.

    Args:
        path: of the file, or the name of a built-in robot.
        inertia: what to do with an inertia that no body can have, as in ``load_robot``: a link that this lets through
            is a note, one that it refuses an error.
        floating_base, xacro, xacro_args: as in ``load_robot``.
    """
    path = as_path(path, "path")
    options = ReadOptions(inertia=inertia, floating_base=floating_base, xacro=xacro, xacro_args=xacro_args)
    name = str(path)
    kind = "robot"
    try:
        if name in builtin_robots() and not os.path.isfile(path):
            return _read(name, name, kind, options)
        if Path(path).suffix not in (*SUFFIXES, ".sdf"):  # whose refusal says what to do
            message = f"cannot be checked; allowed: a path that ends in {', '.join(SUFFIXES)}"
            raise DescriptionError(message, source=name if name.isascii() and name.isprintable() else ascii(name))
        if Path(path).suffix == ".toml":
            text = read_text(Path(path), name, ".toml file")
            values = parse_toml(text, name)
            kind = kind_of(values)
            errors = faults(FORMATS[kind][0], values, name)
            locate(errors, text, values)
            if errors:
                errors.sort(key=lambda error: (error.line or 0, error.column or 0))
                return Checked(name, kind, {}, tuple(errors))
            return _read(Path(path), name, kind, options, values)
        return _read(Path(path), name, kind, options)
    except InputError as error:
        return Checked(name, kind, {}, (error,))


def check_files(
    paths: Sequence[str | Path],
    *,
    inertia: str | None = None,
    floating_base: bool = False,
    xacro: Xacro = False,
    xacro_args: Mapping[str, object] | None = None,
) -> list[Checked]:
    """Check each file as ``check_file``; notes of scenarios refer to the robots among them, too."""
    how: dict[str, Any] = {"inertia": inertia, "floating_base": floating_base, "xacro": xacro, "xacro_args": xacro_args}
    checked = [check_file(path, **how) for path in paths]
    usable = [(path, file) for path, file in zip(paths, checked, strict=True) if not file.errors]
    scenarios = {file.file: load_scenario(Path(path)) for path, file in usable if file.kind == "scenario"}
    of_robots = [path for path, file in usable if file.kind == "robot" and scenarios]
    robots = [load_robot(path, **how) for path in of_robots]
    return [
        replace(file, notes=(*file.notes, *(note for robot in robots for note in start_notes(scenario, robot))))
        if (scenario := scenarios.get(file.file)) is not None
        else file
        for file in checked
    ]


def kind_of(values: Mapping[str, object]) -> str:
    """Return the format, of FORMATS, that has most of the keys; a robot where that does not tell."""
    return max(FORMATS, key=lambda kind: len(FORMATS[kind][0].keys.keys() & values.keys()))


def _read(
    path: Path | str, name: str, kind: str, options: ReadOptions, values: Mapping[str, Any] | None = None
) -> Checked:
    """Read a file that may be used as far as its form says; ``values`` of a .toml file."""
    written = [] if values is None else [*quantities_in(FORMATS[kind][0], values)]
    if kind == "scenario":
        scenario = load_scenario(Path(path))
        counts = {"s": scenario.duration, "wrenches": len(scenario.wrenches), "payloads": len(scenario.payloads)}
        return Checked(name, kind, counts, (), unit_note(written))
    if kind == "plan":
        plan = load_plan(Path(path))
        return Checked(name, kind, {"samples": plan.samples, "numbers varied": len(plan.vary)}, (), unit_note(written))
    names = ("inertia", "floating_base", "xacro", "xacro_args")
    robot = load_robot(path, **{key: getattr(options, key) for key in names})
    coordinates = sum(len(joint.all_coordinates) for joint in robot.joints) - len(robot.followers)
    states, sizes = build_model(robot).states, [*written, *inherited_sizes(robot, values)]
    return Checked(
        name,
        kind,
        {"links": len(robot.links), "coordinates": coordinates}
        | ({"states of force laws": len(states)} if states else {}),
        (),
        (*robot.notes, *inertia_notes(robot), *home_notes(robot), *short_time_notes(states), *unit_note(sizes)),
    )


def _facts(error: InputError) -> dict[str, Any]:
    """Return the fields of a message."""
    if not isinstance(error, DescriptionError):
        return {"message": str(error)}
    place = {"file": error.source, "line": error.line, "column": error.column, "place": error.where}
    return {**place, "message": error.message}
