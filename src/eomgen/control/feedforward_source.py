"""The feed-forward of elastic gears as C: a function of the motion's time derivatives, without heap."""

from __future__ import annotations

import importlib.resources
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from .._version import __version__
from ..arrays import Array
from ..codegen.c.scalar_types import SCALARS
from ..codegen.c.source import environment
from ..codegen.kernels.groups import INVERSE_DYNAMICS, ROTORS_OF_GEARS, SPRINGS_OF_GEARS
from ..description import RobotLike, as_robot
from ..errors import InputError
from ..files import as_path
from ..identifiers import word_in
from ..limits import LARGEST, is_usable
from ..names import listed, show
from ..pipeline.building import build
from ..pipeline.options import Options
from ..pipeline.stages import make_source
from ..progress import StageReport, no_report, tells_at_prompt
from ..robot.mechanism import driven_coordinates
from ..robot.model import build_model
from ..robot.value import Coordinate, Motor, Robot
from .elastic_feedforward import check_flat, check_smoothing, links_alone
from .gears import Gears, check_one_slope, filter_weights, gears_of, laws_alone, principal_of
from .link_friction import coulomb_frictions, softened
from .observer_source import write_texts

LIBRARY = "feedforward.h"
ALONE = ("springs", "dampers", "rotors")  # robots whose coordinates have nothing but laws


@tells_at_prompt("writing the feed-forward")
def write_feedforward(
    robot: RobotLike,
    folder: Path | str,
    *,
    dt: float = 1e-3,
    dtype: str = "float64",
    friction_smoothing: float | None = None,
    progress: StageReport = no_report,
) -> list[Path]:
    """Write the feed-forward of elastic gears as C99, with the robot's equations that it calls, and return the paths.

    The C takes the links' positions, velocities, accelerations, jerks and (where a gear has no damper) snaps, and gives
    positions, velocities and forces of drives.  ``cc -c *.c`` in the folder compiles it; all warnings may be errors.

    Args:
        robot: a Robot, the name of a built-in one, or the path of a description.
        folder: written to; files of the same names are replaced.
        dt: between samples, s: the step of filters, which gears with dampers have.
        dtype: "float64" or "float32", of all numbers.
        friction_smoothing: m/s or rad/s, over which Coulomb friction of joints behind gears reverses; needed with it.
        progress: called with a line of text when a stage begins.

    Raises:
        InputError: no motor behind a gear, what ``feedforward`` refuses of robots, loops, Coulomb friction without
            smoothing, numbers out of their range, or a folder that cannot be written.
    """
    target = Path(as_path(folder, "folder"))
    files = feedforward_files(robot, dt=dt, dtype=dtype, friction_smoothing=friction_smoothing, progress=progress)
    return write_texts(files, target)


def feedforward_files(
    robot: RobotLike,
    *,
    dt: float = 1e-3,
    dtype: str = "float64",
    friction_smoothing: float | None = None,
    progress: StageReport = no_report,
) -> dict[str, str]:
    """Return texts of a feed-forward by their places in one folder; arguments as of ``write_feedforward``."""
    robot = as_robot(robot)
    if not (is_usable(dt) and dt > 0.0):
        raise InputError(f"dt: {show(dt)}; allowed: a time above 0, up to {LARGEST:g} s")
    word_in("dtype", dtype, SCALARS)
    progress("looking at the gears")
    parts = _parts_of(robot, friction_smoothing)
    progress("deriving the equations")
    sources = {
        made.name: make_source(made, Options(kernels=kernels, dtype=dtype, batches=False))
        for made, kernels in parts.equations()
    }
    texts = {place: text for source in sources.values() for place, text in source.files.items()}
    context = _context(parts, float(dt), dtype)
    made = {
        f"{robot.name}_feedforward.{end}": environment()
        .get_template(f"control/feedforward.{end}.jinja")
        .render(context)
        for end in ("h", "c")
    }
    library = importlib.resources.files("eomgen.control").joinpath(LIBRARY).read_text(encoding="ascii")
    return {**texts, LIBRARY: library, **made}


@dataclass(frozen=True)
class _Parts:
    """Parts of a feed-forward.

    Attributes:
        name: the robot's.
        gears: its transmissions.
        links: the robot without its motors.
        drives: names of drives, motors among them, in the order of the robot's coordinates.
        order: of the highest time derivative of forces that deflections depend on.
        springs, dampers: numbers of gears whose springs are no straight lines, without dampers and with them.
        rotors: numbers of gears whose rotors have forces of their own, such as friction.
    """

    name: str
    gears: Gears
    links: Robot
    drives: tuple[str, ...]
    order: int
    springs: tuple[int, ...]
    dampers: tuple[int, ...]
    rotors: tuple[int, ...]

    def robot_of(self, what: str) -> Robot:
        """Return the robot whose coordinates are the deflections of gears without their dampers, or the rotors."""
        laws = [
            (joint.name, "gamma", _rotor(motor)) if what == "rotors" else (joint.name, joint.principal, _spring(motor))
            for joint, motor in ((self.gears.joints[i], self.gears.motors[i]) for i in getattr(self, what))
        ]
        return laws_alone(f"{self.name[:39]}_{what}", self.links.base, laws)

    def equations(self) -> list[tuple[Robot, tuple[str, ...]]]:
        """Return the robots whose C is needed, with the kernels of each."""
        jets = tuple(f"{name}_jet{self.order}" for name in INVERSE_DYNAMICS)
        made: list[tuple[Robot, tuple[str, ...]]] = [(self.links, jets)]
        made += [(self.robot_of(x), SPRINGS_OF_GEARS) for x in ("springs", "dampers") if getattr(self, x)]
        if self.rotors:
            made.append((self.robot_of("rotors"), ROTORS_OF_GEARS))
        return made


def _parts_of(robot: Robot, friction_smoothing: float | None) -> _Parts:
    """Return the parts of a robot's feed-forward; InputError where there is none in C."""
    check_smoothing(friction_smoothing)
    gears = gears_of(robot)
    if gears is None:
        raise InputError(
            f"{robot.name}: no joint has a motor behind an elastic gear; allowed: joints with one, or the kernel"
            " inverse_dynamics, of eomgen.generate"
        )
    for joint in gears.joints:
        check_one_slope(joint)
    if robot.is_closed:
        raise InputError(
            f"{robot.name}: its loops and couplings have no feed-forward in C; allowed: trees, or samples of"
            " eomgen.control.feedforward"
        )
    links = links_alone(robot)
    full = build(robot)
    check_flat(robot, links, full)
    behind = {principal_of(joint) for joint in gears.joints}
    rough = [name for name in coulomb_frictions(links) if name in behind]
    if rough and friction_smoothing is None:
        raise InputError(
            f"friction_smoothing: None, and Coulomb friction of {listed(rough)} makes motors jump; allowed: a velocity"
            " over which it reverses"
        )
    soft, _ = softened(links, dict.fromkeys(behind, friction_smoothing or 0.0))
    driven = {*driven_coordinates(robot, full.coordinates), *gears.names}
    numbers = range(len(gears.names))
    return _Parts(
        name=robot.name,
        gears=gears,
        links=replace(soft, name=f"{robot.name[:39]}_links", sensors=()),
        drives=tuple(name for name in full.coordinates if name in driven),
        order=1 if gears.damped.all() else 2,
        springs=tuple(i for i in numbers if not gears.linear[i] and not gears.damped[i]),
        dampers=tuple(i for i in numbers if not gears.linear[i] and gears.damped[i]),
        rotors=tuple(i for i in numbers if gears.motors[i].friction or gears.motors[i].further),
    )


def _spring(motor: Motor) -> Coordinate:
    """Return a gear's law without its damper."""
    return replace(motor.transmission, damping=None, limits=None, prescribed=False)


def _rotor(motor: Motor) -> Coordinate:
    """Return a rotor's law without its inertia."""
    return replace(motor.rotor, armature=None, limits=None, prescribed=False)


def _context(parts: _Parts, dt: float, dtype: str) -> dict[str, Any]:
    """Return what the templates of a feed-forward know."""
    gears, links, scalar = parts.gears, build_model(parts.links), SCALARS[dtype]
    count, order = len(gears.names), parts.order
    phi, slope, _ = gears.springs(np.zeros(count))

    def literals(values: Sequence[float] | Array) -> list[str]:
        return [scalar.literal(float(x)) for x in values]

    lines = [i for i in range(count) if gears.linear[i] and not gears.damped[i]]
    filters = [i for i in range(count) if gears.linear[i] and gears.damped[i]]
    weights = [filter_weights(slope[i] / gears.damping[i] * dt, 2 * order + 1) for i in filters]
    robots = {"links": parts.links} | {x: parts.robot_of(x) for x in ALONE if getattr(parts, x)}
    return {
        "name": parts.name,
        "links": parts.links.name,
        **{f"{x}_name": robots[x].name if x in robots else "" for x in ALONE},
        "version": __version__,
        "dtype": dtype,
        "real": scalar.name,
        "dt": repr(dt),
        "dt_literal": scalar.literal(dt),
        "zero": scalar.literal(0.0),
        "one": scalar.literal(1.0),
        "n": links.size,
        "g": count,
        "order": order,
        "coordinates": links.coordinates,
        "drives": parts.drives,
        "parameters": len(links.parameters),
        "nominal": {kind: literals(list(build_model(x).parameters.values())) for kind, x in robots.items()},
        "gears": gears.names,
        "behind": [links.coordinates.index(principal_of(joint)) for joint in gears.joints],
        "shafts": [parts.drives.index(name) for name in gears.names],
        "direct": [
            (i, links.coordinates.index(name)) for i, name in enumerate(parts.drives) if name not in gears.names
        ],
        "ratios": literals(gears.ratios),
        "inertias": literals([motor.inertia for motor in gears.motors]),
        "stiffness": literals(np.where(gears.linear, slope, 1.0)),
        "preload": literals(phi),
        "damping": literals(gears.damping),
        "lines": lines,
        "filters": filters,
        "decay": literals(np.array([decay for decay, _ in weights])),
        "driven": [literals(driven / gears.damping[i]) for i, (_, driven) in zip(filters, weights, strict=True)],
        "springs": parts.springs,
        "dampers": parts.dampers,
        "rotors": parts.rotors,
        "still_springs": literals(np.concatenate([phi[list(parts.springs)], slope[list(parts.springs)]])),
        "still_dampers": literals(np.concatenate([phi[list(parts.dampers)], slope[list(parts.dampers)]])),
        "has_state": bool(gears.damped.any()),
    }
