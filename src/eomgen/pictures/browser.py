"""A result in space, in the browser: reality beside its program, deviations exaggerated.

viser draws what ``scene`` computes; it is imported when a view is opened.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Sequence
from time import monotonic
from typing import Any

import numpy as np

from ..codegen.kernels.groups import PAGE_ABOUT_A_STATE
from ..description import RobotLike
from ..errors import BuildError, InputError
from ..identification.tolerances.result import ToleranceResult
from ..optional import optional_import
from ..pipeline.building import build
from ..simulation.result import SimulationResult, simulated_robot
from ..threads import begin_in_thread
from .framing import STEP, first_factor, framed, largest_power, motion_points, up_of
from .scene import (
    SLENDER,
    Array,
    Region,
    bent_axes,
    capsule_mesh,
    exaggerated,
    extent,
    link_poses,
    program_positions,
    quaternions,
    reaction_forces,
    spring_lines,
)
from .shapes import Shape, meshes_of, urdf_shapes

REAL_COLOR, PROGRAM_COLOR, FORCE_COLOR, SPRING_COLOR = (70, 120, 170), (150, 150, 150), (204, 51, 17), (0, 158, 115)
PROGRAM_OPACITY = 0.35
REGION_COLOR, REGION_OPACITY = (136, 34, 85), 0.45
PATH_POINTS = 300
RATE = 30.0  # pictures per s
HEIGHT = 520  # in a notebook, pixels
FIELD_OF_VIEW = math.radians(45.0)  # vertical
ARROW = 0.35  # length of the largest reaction, of the robot's size
SPEEDS = ("0.1", "0.25", "0.5", "1", "2")


class View:
    """A server on this machine that shows a result.

    Attributes:
        address: where the browser finds it.
        notes: lines about what could not be drawn.
    """

    def __init__(
        self,
        result: SimulationResult,
        robot: RobotLike | None = None,
        *,
        tolerance: ToleranceResult | None = None,
        port: int = 8080,
    ) -> None:
        """Open the server.

        Args:
            result: with its robot in it, or of ``robot``.
            robot: that was simulated; by default the one that the result keeps.
            tolerance: of a frame along the motion: where it may be is drawn around it, exaggerated as deviations are.
            port: to listen at; the next one that is free where it is taken.

        Raises:
            InputError: viser is not installed, the robot is missing or another one, the tolerance is of another
                robot or not along a motion, or the port is none.
        """
        with optional_import("viser", "the view needs"):
            import viser
        if not 1 <= port <= 65535:
            raise InputError(f"port: {port}; allowed: a whole number from 1 to 65535")
        self._result, self._robot = result, simulated_robot(result, robot)
        self._region = None if tolerance is None else Region(tolerance, result.robot)
        self._size, self._program = extent(self._robot), program_positions(result)
        self._off = result.trajectory.q - self._program
        shapes, notes = urdf_shapes(self._robot)
        self.notes = notes
        self._forces, self._carriers = self._reactions()
        self._server: Any = viser.ViserServer(
            host="127.0.0.1", port=port, label=f"eomgen: {result.robot}", verbose=False
        )
        self.address = f"http://127.0.0.1:{self._server.get_port()}"
        self._closed = threading.Event()
        self._axes = bent_axes(self._robot)
        self._set_stage(shapes)
        self._bodies: dict[str, list[Any]] = {}  # of links that bend, in the order of their axes
        self._frames = {kind: self._add_robot(kind, shapes) for kind in ("reality", "program")}
        self._add_lines()
        self._add_controls()
        self.show()
        self._player = begin_in_thread(self._run)

    def show(self) -> None:
        """Draw the time and the exaggeration that the controls have."""
        k = int(np.abs(self._result.trajectory.t - self._time.value).argmin())
        names, factor = self._result.trajectory.coordinates, self.factor
        q = {"reality": self._program[k] + factor * self._off[k], "program": self._program[k]}
        with self._server.atomic():
            for kind, frames in self._frames.items():
                poses = link_poses(self._robot, names, q[kind])
                for link, handle in frames.items():
                    handle.position, handle.wxyz = poses[link][:3, 3], quaternions(poses[link])
                values = {name: np.asarray(x) for name, x in zip(names, q[kind], strict=True)}
                for axis, body in zip(self._axes, self._bodies[kind], strict=True):
                    body.vertices = axis.mesh(values)[0].astype(np.float32)
                if kind == "reality":
                    self._move_lines(k, poses)
                    self._move_region(poses)

    @property
    def time(self) -> float:
        """Time that is shown, s; an assignment moves the slider and the scene."""
        return float(self._time.value)

    @time.setter
    def time(self, t: float) -> None:
        self._time.value = t
        self.show()

    @property
    def factor(self) -> float:
        """Factor by which deviations are exaggerated, 1 or more; an assignment moves the slider and the scene."""
        return float(10.0**self._power.value)

    @factor.setter
    def factor(self, factor: float) -> None:
        self._power.value = math.log10(factor)
        self._magnify()

    @property
    def playing(self) -> bool:
        """Whether time goes on by itself; an assignment is what the button does."""
        return self._playing

    @playing.setter
    def playing(self, playing: bool) -> None:
        self._playing = playing
        self._play.label = "pause" if playing else "play"

    def drawn(self, kind: str, link: str) -> Array:
        """Position, m, and unit quaternion (w, x, y, z) of a link as it is drawn, (7,), in the base frame.

        Args:
            kind: "reality" or "program".
            link: name of the base or of a link.
        """
        handle = self._frames[kind][link]
        return np.concatenate([handle.position, handle.wxyz])

    def bent(self, kind: str) -> list[Array]:
        """Vertices of links that bend as they are drawn, (V, 3) each, m, in the frames of their links.

        Args:
            kind: "reality" or "program".
        """
        return [np.asarray(body.vertices, dtype=np.float64) for body in self._bodies[kind]]

    def _repr_html_(self) -> str:
        """The view in a notebook whose browser is on this machine; its address, where it is on another."""
        words = f'<a href="{self.address}">{self.address}</a>'
        return f'<iframe src="{self.address}" width="100%" height="{HEIGHT}" style="border: 0"></iframe><p>{words}</p>'

    def wait(self) -> None:
        """Until the view is closed; raise what stopped it from playing."""
        self._player.result()

    def close(self) -> None:
        """Stop the server."""
        self._closed.set()
        self._server.stop()

    def _reactions(self) -> tuple[Array | None, list[str]]:
        """Forces of joints, (T, joints, 3), N, and their child links; None and a note where there are none."""
        if self._result.scenario.get("payloads"):
            self.notes.append("joint reactions are not drawn: links carry payloads, whose mass changes them")
            return None, []
        try:
            kernel = build(self._robot, kernels=PAGE_ABOUT_A_STATE)
        except BuildError as error:
            self.notes.append(f"joint reactions are not drawn: {error}")
            return None, []
        forces = reaction_forces(kernel, self._robot, self._result)
        return forces, [self._robot.joint(name).child for name in kernel.joints]

    def _set_stage(self, shapes: Sequence[Shape]) -> None:
        """Up, the camera, the floor and the base."""
        scene, size, up = self._server.scene, self._size, up_of(self._robot)
        places = motion_points(self._result, self._robot, first_factor(self._result, self._robot), shapes)
        scene.set_up_direction(tuple(up))
        view, camera = framed(places, up, FIELD_OF_VIEW, SLENDER * size), self._server.initial_camera
        away = float(np.linalg.norm(view.position - view.look_at))
        camera.up, camera.fov, camera.near, camera.far = tuple(up), view.fov, 1e-3 * away, 1e3 * away
        camera.look_at, camera.position = tuple(view.look_at), tuple(view.position)
        floor, aside = np.eye(4), np.cross(up, np.eye(3)[int(np.abs(up).argmin())])
        aside /= np.linalg.norm(aside)
        floor[:3, :3] = np.stack([aside, np.cross(up, aside), up], axis=1)
        below = float((places @ up).min()) - 0.25 * size  # under everything, so that nothing lies on it
        cell = 10.0 ** math.floor(math.log10(size))
        scene.add_grid(
            "/floor",
            4.0 * size,
            4.0 * size,
            cell_size=0.5 * cell,
            section_size=cell,
            wxyz=quaternions(floor),
            position=tuple(below * up),
            cell_color=(225, 225, 225),
            section_color=(200, 200, 200),
        )
        scene.add_frame("/base", axes_length=0.12 * size, axes_radius=0.004 * size)

    def _add_robot(self, kind: str, shapes: list[Any]) -> dict[str, Any]:
        """A frame for every link with its shapes in it."""
        scene = self._server.scene
        links = [self._robot.base, *(link.name for link in self._robot.links)]
        frames = {link: scene.add_frame(f"/{kind}/{link}", show_axes=False) for link in dict.fromkeys(links)}
        look = {"color": REAL_COLOR} if kind == "reality" else {"color": PROGRAM_COLOR, "opacity": PROGRAM_OPACITY}
        for i, (link, vertices, faces) in enumerate(meshes_of(self._robot, shapes)):
            scene.add_mesh_simple(f"/{kind}/{link}/body{i}", vertices, faces, **look)
        self._bodies[kind] = [
            scene.add_mesh_simple(f"/{kind}/{axis.link}/axis{i}", *axis.mesh({}), **look)
            for i, axis in enumerate(self._axes)
        ]
        return frames

    def _add_lines(self) -> None:
        scene, size = self._server.scene, self._size
        path = self._result.program_pose[:: self._stride, :3, 3]
        self._program_path = scene.add_line_segments(
            "/program/path", _segments(path), PROGRAM_COLOR, thickness=0.004 * size
        )
        self._path = scene.add_line_segments("/reality/path", _segments(path), FORCE_COLOR, thickness=0.004 * size)
        self._springs, self._arrows = None, None
        if self._robot.link_elements:
            ends = np.zeros((len(self._robot.link_elements), 2, 3))
            self._springs = scene.add_line_segments("/springs", ends, SPRING_COLOR, thickness=0.008 * size)
        self._ellipsoid: Any = None
        if self._region is not None:
            ball = capsule_mesh(np.zeros(3), np.zeros(3), 1.0)
            look: dict[str, Any] = {"color": REGION_COLOR, "opacity": REGION_OPACITY}
            self._ellipsoid = scene.add_mesh_simple("/tolerance", *ball, **look)
        if self._forces is not None and self._forces.any():
            thick = {"shaft_radius": 0.007 * size, "head_radius": 0.016 * size, "head_length": 0.035 * size}
            ends = np.zeros((self._forces.shape[1], 2, 3))
            self._arrows = scene.add_arrows("/reactions", ends, FORCE_COLOR, **thick)

    def _move_region(self, poses: dict[str, Array]) -> None:
        if self._region is None:
            return
        half, turn = self._region.at(self._time.value)
        self._ellipsoid.position = poses[self._region.frame][:3, 3]
        self._ellipsoid.wxyz = quaternions(turn)
        least = 1e-3 * SLENDER * self._size  # a mesh without any depth has no side to be seen from
        self._ellipsoid.scale = tuple(np.maximum(self.factor * half, least).tolist())

    @property
    def _stride(self) -> int:
        return max(1, self._result.trajectory.t.size // PATH_POINTS)

    def _move_lines(self, k: int, poses: dict[str, Array]) -> None:
        if self._springs is not None:
            self._springs.points = spring_lines(self._robot, poses)
        if self._arrows is not None and self._forces is not None:
            scale = ARROW * self._size / float(np.linalg.norm(self._forces, axis=2).max())
            begin = np.array([poses[link][:3, 3] for link in self._carriers])
            self._arrows.points = np.stack([begin, begin + scale * self._forces[k]], axis=1)

    def _move_path(self) -> None:
        """The tool's path with its deviation as it is exaggerated."""
        rows = exaggerated(self._result, self.factor)[:: self._stride]
        poses = link_poses(self._robot, self._result.trajectory.coordinates, rows)
        self._path.points = _segments(poses[self._result.tool][:, :3, 3])

    def _magnify(self) -> None:
        self._move_path()
        self.show()

    def _add_controls(self) -> None:
        gui, t = self._server.gui, self._result.trajectory.t
        gui.configure_theme(show_logo=False, show_share_button=False)
        end = float(t[-1])
        self._time = gui.add_slider("time, s", 0.0, end, step=max(end / 1000.0, 1e-9), initial_value=0.0)
        self._play = gui.add_button("play")
        self._speed = gui.add_dropdown("speed", SPEEDS, initial_value="1")
        self._power = gui.add_slider(
            "deviations x 10^",
            0.0,
            round(largest_power(self._result, self._robot), 9),
            step=STEP,
            initial_value=round(math.log10(first_factor(self._result, self._robot)), 9),
            hint="exaggeration; 0 is as they are",
        )
        self._playing = False
        self._play.on_click(lambda _: setattr(self, "playing", not self.playing))
        self._time.on_update(lambda _: self.show())
        self._power.on_update(lambda _: self._magnify())
        parts: dict[str, list[Any]] = {
            "reality": [*self._frames["reality"].values(), self._path],
            "program": [*self._frames["program"].values(), self._program_path],
            "springs": [self._springs] if self._springs is not None else [],
            "tolerance": [self._ellipsoid] if self._ellipsoid is not None else [],
            "joint reactions": [self._arrows] if self._arrows is not None else [],
        }
        for name, handles in parts.items():
            if handles:
                self._add_switch(name, handles)
        summary = "  \n".join(_plain(line) for line in (*self._result.summary_lines()[:1], *self.notes))
        gui.add_markdown(summary)
        self._move_path()

    def _add_switch(self, name: str, handles: list[Any]) -> None:
        box = self._server.gui.add_checkbox(name, True)

        def switch(_: object) -> None:
            for handle in handles:
                handle.visible = box.value

        box.on_update(switch)

    def _run(self) -> None:
        """Advance the time while it plays."""
        end, last = float(self._result.trajectory.t[-1]), monotonic()
        while not self._closed.wait(1.0 / RATE):
            now = monotonic()
            if self._playing:
                ahead = self._time.value + (now - last) * float(self._speed.value)
                self._time.value = 0.0 if ahead > end else ahead  # its listeners draw
            last = now


def _segments(path: Array) -> Array:
    """A line through points (K, 3) as segments (K - 1, 2, 3)."""
    return np.stack([path[:-1], path[1:]], axis=1)


def _plain(text: str) -> str:
    """A text that Markdown and HTML leave as it is."""
    return "".join(letter if letter.isalnum() or letter in " .,:;+-=/" else f"&#{ord(letter)};" for letter in text)
