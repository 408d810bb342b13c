"""A robot to look at: one file of HTML with a slider for each joint, without a simulation and without a compiler."""

from __future__ import annotations

import html
import sys
import tempfile
import webbrowser
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ...arrays import Array
from ...description import RobotLike, as_robot
from ...files import PAGE_ENDING, check_ending, write_atomically
from ...kernel.turning import rotation
from ...names import component_name, joint_of
from ...pictures.scene import bent_axes, extent, placed, turned
from ...robot.coordinates import unit_of
from ...robot.geometry import ANGULAR, COORDINATES
from ...robot.joint_types import rigid_components
from ...robot.model import Model, build_model
from ...robot.value import Joint, Loop, Robot, SlidingShapes
from .geometry import geometry_of, tool_place
from .page import filled_page

HEIGHT = 520  # in a notebook, pixels
BENT, BENT_ANGLE = 0.15, 0.5  # largest deflection by a mode's slider, of the robot's size; rotation, rad
MOST_FRAMES = 4  # whose positions are shown


@dataclass(frozen=True)
class RobotPage:
    """A self-contained page with a slider for each joint of a robot.

    Attributes:
        robot: the robot's name.
        html: its text.
        notes: lines about what is not shown: meshes that are missing, say.
    """

    robot: str
    html: str
    notes: tuple[str, ...]

    def __repr__(self) -> str:
        return f"RobotPage(robot={self.robot!r}, notes={len(self.notes)}): save(path), open()"

    def _repr_html_(self) -> str:
        """Show the page in a notebook, below its cell."""
        text = html.escape(self.html, quote=True)
        return f'<iframe srcdoc="{text}" width="100%" height="{HEIGHT}" style="border: 0"></iframe>'

    def save(self, path: Path | str) -> Path:
        """Write the page and return its path; InputError of another ending than .html, or if it cannot be written."""
        target = check_ending(path, PAGE_ENDING, label="path")
        text = self.html.encode("utf-8", "replace")  # a lone surrogate of a name
        return write_atomically(target, lambda stream: stream.write(text), read=None)

    def open(self) -> Path:
        """Open the page in the browser, from a temporary file; returns its path."""
        path = self.save(Path(tempfile.mkdtemp(prefix="eomgen-")) / f"{self.robot}.html")
        webbrowser.open(path.as_uri())
        return path


def show_robot(robot: RobotLike, path: Path | str | None = None, *, browser: bool | None = None) -> RobotPage:
    """Show a robot as a page with a slider for each joint; nothing is simulated or compiled.

    Elastic joints are drawn rigid; links that bend have a slider for each mode.  Closed mechanisms are assembled
    wherever a slider is; where that cannot be, the page names the loop.

    Args:
        robot: a Robot, the name of a built-in one, or the path of a description.
        path: to write the page to, .html; None for none.
        browser: whether to open it in the browser; by default unless a notebook shows it, or it is written to a path.

    Returns:
        The page, which notebooks show below their cell.

    Raises:
        InputError: the robot is none, or the file cannot be written, or has another ending.
    """
    page = robot_page(robot)
    if path is not None:
        page.save(path)
    if browser is None:
        browser = path is None and not _in_notebook()
    if browser:
        page.open()
    return page


def _in_notebook() -> bool:
    """Return whether a Jupyter kernel runs this process; a process that only imports ipykernel is not a notebook."""
    ipython = sys.modules.get("IPython")
    return ipython is not None and getattr(ipython.get_ipython(), "kernel", None) is not None


def robot_page(robot: RobotLike) -> RobotPage:
    """Return the page of ``show_robot``."""
    described = as_robot(robot)
    values = contents_of_view(described)
    modes = len(values["modes"])
    count = len(values["sliders"]) - modes
    bend = f", {modes} mode{'s' * (modes != 1)} of links" if modes else ""
    line = f"{count} joint coordinate{'s' * (count != 1)}{bend}; elastic joints are drawn rigid, nothing is simulated"
    text = filled_page(values, {}, start="view", title=f"{described.name}: eomgen view", line=line)
    return RobotPage(described.name, text, tuple(values["notes"]))


def contents_of_view(described: Robot) -> dict[str, Any]:
    """Return what the page knows: the geometry, the mechanism, and ranges of its sliders, as JSON holds them."""
    robot = _with_modes(described)
    model = build_model(robot)
    geometry, notes = geometry_of(robot, model.coordinates, np.array(model.home))
    bent = _amplitudes(robot)
    frames = [
        dict(zip(("name", "link", "point"), (frame.name, *tool_place(robot, frame.name)), strict=True))
        for frame in robot.frames[:MOST_FRAMES]
    ]
    if len(robot.frames) > MOST_FRAMES:
        notes.append(f"positions of {MOST_FRAMES} of {len(robot.frames)} frames are shown, the first ones")
    modes = {i for i, name in enumerate(model.coordinates) if name in robot.modal_coordinates}
    return {
        "name": described.name,
        **geometry,
        **mechanism_of(model),
        "sliders": [
            _mode(name, i, bent) if i in modes else _slider(robot, name, i, model.home[i])
            for i, name in enumerate(model.coordinates)
        ],
        "held": sorted({*model.driven, *model.prescribed}),
        "frames": frames,
        "notes": notes,
    }


def _with_modes(described: Robot) -> Robot:
    """Return the robot with rigid joints whose links bend: nodes follow the modes as they are described.

    So do places where joints slide along beams.  An elastic joint that carries a link that bends stays elastic where
    nothing else of it moves: without it the link would be no body of its own.
    """
    robot, modes = described.rigid(), {link.name: link.modes for link in described.links}
    nodes = described.nodes
    kept = {x.name for x in robot.joints if x.name in nodes or (modes[x.child] is not None and not x.coordinates)}
    joints = tuple(described.joint(joint.name) if joint.name in kept else joint for joint in robot.joints)
    couplings = tuple(x for x in described.couplings if joint_of(x.of) in nodes)
    links = tuple(replace(link, modes=modes[link.name]) for link in robot.links)
    return replace(robot, links=links, joints=joints, couplings=(*robot.couplings, *couplings))


def _amplitudes(robot: Robot) -> dict[str, float]:
    """Return how far modes are bent at most, by their coordinates: so that links are seen to bend, and do not fold."""
    size, least = extent(robot), dict[str, float]()
    for axis in bent_axes(robot):
        moved = np.abs(axis.stations.Phi).max(axis=0) / np.repeat([BENT * size, BENT_ANGLE], 3)[:, np.newaxis]
        for name, most in zip(axis.modes, moved.max(axis=0).tolist(), strict=True):
            least[name] = min(least.get(name, np.inf), 1.0 / most) if most > 0.0 else least.get(name, np.inf)
    return {name: float(f"{value:.2g}") for name, value in least.items() if np.isfinite(value)}


def _mode(name: str, index: int, amplitudes: Mapping[str, float]) -> dict[str, Any]:
    """Return name and range of a mode's slider."""
    most = amplitudes.get(name, 1.0)
    return {"name": name, "index": index, "low": -most, "high": most, "unit": ""}


def mechanism_of(model: Model) -> dict[str, Any]:
    """Return joints, loops and couplings as the script ``mechanism`` takes them; poses are 16 numbers, row by row."""
    robot = model.robot
    followers = [
        {
            "name": name,
            "offset": x.offset or 0.0,
            "to": [[key, ratio] for key, ratio in x.to.items()],
            "bends": [[a, b, bend * (0.5 if a == b else 1.0)] for a, b, bend in x.bends],
            "sliding": None if x.sliding is None else _sliding(x.sliding),
        }
        for name, x in robot.followers.items()
    ]
    couplings = [
        {"name": x.name, "of": x.of, "offset": x.offset or 0.0, "to": [[key, ratio] for key, ratio in x.to.items()]}
        for x in model.rigid_couplings
    ]
    return {
        "coordinates": list(model.coordinates),
        "home": list(model.home),
        "joints": [_joint(joint) for joint in robot.joints],
        "followers": followers,
        "loops": [_loop(loop) for loop in robot.loops],
        "couplings": couplings,
        "modes": [i for i, name in enumerate(model.coordinates) if name in robot.modal_coordinates],
    }


def _sliding(shapes: SlidingShapes) -> dict[str, Any]:
    """Return functions by which modes move a place on a beam: series of Chebyshev's polynomials, as JSON holds them."""
    second = [[a, b, [(0.5 if a == b else 1.0) * x for x in series]] for a, b, series in shapes.second]
    first = [[name, list(series)] for name, series in shapes.first]
    return {"by": shapes.by, "length": shapes.length, "first": first, "second": second}


def _joint(joint: Joint) -> dict[str, Any]:
    turn = turned(np.array(joint.axis_turn))
    return {
        "parent": joint.parent,
        "child": joint.child,
        "before": _flat(placed(joint.placement) @ turn),
        "after": _flat(turn.T),
        "offset": [x or 0.0 for x in joint.offset],
        "coordinates": [component_name(joint.name, x) if x in joint.coordinates else None for x in COORDINATES],
    }


def _loop(loop: Loop) -> dict[str, Any]:
    """Return a loop: the frames of its loop joint, how their axes are turned by offsets, and what is blocked.

    Where all angles are rigid, their offsets turn the axes of the first frame; otherwise alpha turns these, gamma those
    of the second one back, and beta is taken off its component.
    """
    blocked = rigid_components(loop)
    rigid = {part.name for part in blocked if part.axis is None}
    offset = [x or 0.0 for x in loop.offset]
    first, second, sine = np.eye(3), np.eye(3), 0.0
    for axis, (name, angle) in enumerate(zip(ANGULAR, offset[3:], strict=True)):
        if name not in rigid:
            continue
        turn = rotation(angle * np.eye(3)[axis])
        if len(rigid) == len(ANGULAR) or axis == 0:
            first = first @ turn
        elif axis == 1:
            sine = float(np.sin(angle))
        else:
            second = second @ turn.T
    components = [
        {
            "axis": part.axis,
            "products": [list(product) for product in part.products],
            "kept": offset[part.axis] if part.axis is not None else sine if part.name == "beta" else 0.0,
        }
        for part in blocked
    ]
    return {
        "name": loop.name,
        "links": list(loop.links),
        "frames": [_flat(placed(placement)) for placement in loop.placements],
        "turns": [_flat(turned(first)), _flat(turned(second))],
        "components": components,
    }


def _flat(pose: Array) -> list[float]:
    return [float(x) for x in pose.ravel()]


def _slider(robot: Robot, name: str, index: int, home: float) -> dict[str, Any]:
    """Return name, unit and range of a slider: the limits, else half a turn, or the robot's size, to each side."""
    unit = unit_of(name)
    usual = float(np.pi) if unit == "rad" else extent(robot)
    low, high = robot.limits_of(name).range
    low, high = low if np.isfinite(low) else home - usual, high if np.isfinite(high) else home + usual
    return {"name": name, "index": index, "low": min(low, home), "high": max(high, home), "unit": unit}
