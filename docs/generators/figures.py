"""Figures of pages: a joint's coordinates, what lemmas take away, how operations grow; a journal in its bearing."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import eomgen
from eomgen.codegen.c.operation_counts import operations
from eomgen.codegen.joint.zeros import zero_map
from eomgen.codegen.kernels.equations import derive_equations
from eomgen.pictures.journals import draw_journal
from eomgen.pictures.scene import link_poses
from eomgen.pictures.style import COLORS, PROGRAM_COLOR, TOOL_COLOR, canvas
from eomgen.robot import COORDINATES, LINEAR, build_model

ROBOT = "puma560_elastic"  # six joints with six coordinates each
SHOWN = {"x": 0.5, "y": 0.45, "z": 0.4, "alpha": 0.45, "beta": 0.5, "gamma": 0.6}  # m, rad: large enough to be seen
SLIDER_CRANK = Path(__file__).parents[2] / "examples" / "slider_crank.toml"
RPM, TURNS, STEP, EVERY = 5000.0, 3, 1e-6, 10
KERNELS = {"mass_matrix": "s", "inverse_dynamics": "o", "forward_dynamics": "^"}  # with their markers


def figures() -> dict[str, bytes]:
    """SVGs by the name of their files."""
    drawn: dict[str, Callable[[Any], None]] = {
        "joint.svg": _joint,
        "lemmas.svg": _lemmas,
        "growth.svg": _growth,
        "journal.svg": _journal,
    }
    sizes = {"joint.svg": (5.0, 4.2), "lemmas.svg": (6.4, 2.7), "growth.svg": (6.4, 3.2), "journal.svg": (7.4, 3.3)}
    found = {}
    with tempfile.TemporaryDirectory() as folder:
        for name, draw in drawn.items():
            with canvas(*sizes[name], Path(folder) / name) as figure:
                draw(figure)
            found[name] = (Path(folder) / name).read_bytes()
    return found


def _joint(figure: Any) -> None:
    """Frames after each elementary transform of eq. (3), from the parent's to the child's."""
    robot = eomgen.load_robot(ROBOT)
    first = robot.joints[0]
    joint = replace(first, placement=eomgen.Placement())
    alone = replace(robot, joints=(joint,), links=robot.links[:1], frames=(), springs=())
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0), projection="3d")
    names = [f"{joint.name}.{name}" for name in COORDINATES]
    before = np.zeros(6)
    origins = [np.zeros(3)]
    for stage in (0, *range(1, 7)):
        q = before.copy()
        q[:stage] = [SHOWN[name] for name in COORDINATES[:stage]]
        pose = link_poses(alone, names, q)[joint.child]
        origin, last = pose[:3, 3], stage in (0, 6)
        for axis, letter in enumerate("xyz"):
            ends = np.stack([origin, origin + (0.42 if last else 0.26) * pose[:3, axis]])
            style = {"color": COLORS["m"][letter], "linewidth": 2.0 if last else 0.8, "alpha": 1.0 if last else 0.45}
            axes.plot(*ends.T, **style)
            if last:
                axes.text(*ends[1], letter, color=COLORS["m"][letter])
        origins.append(origin)
        name = COORDINATES[stage - 1] if stage else ""
        if name in LINEAR:
            axes.plot(*np.stack(origins[-2:]).T, color=PROGRAM_COLOR, linestyle="--", linewidth=1.0)
            axes.text(*(0.5 * (origins[-2] + origins[-1])), f" {name}", color=PROGRAM_COLOR, fontsize=8.0)
    axes.text(
        *(origins[-1] + [0.05, 0.05, -0.22]), "then alpha about x,\nbeta about the turned y,\ngamma about the last z"
    )
    axes.text(-0.12, 0.0, -0.16, "as placed on the parent")
    axes.set_axis_off()
    axes.set_box_aspect((1.0, 1.0, 0.9), zoom=1.25)
    axes.view_init(elev=20.0, azim=-62.0)


def _lemmas(figure: Any) -> None:
    """How many of the entries of C are left after each lemma."""
    zeros = zero_map(build_model(eomgen.load_robot(ROBOT)))
    tally = zeros.christoffel
    rows, left = [("all entries, v <= w", tally.total)], tally.total
    for reason, count in tally.zeros:
        if count:
            left -= count
            rows.append((f"after {reason.partition(':')[0]}", left))
    rows += [("independent by the antisymmetry", zeros.by_antisymmetry), ("and by the coaxial swap", zeros.independent)]
    axes = figure.add_axes((0.36, 0.06, 0.56, 0.92))
    places = np.arange(len(rows))[::-1]
    colors = [PROGRAM_COLOR] + [COLORS["m"]["x"]] * (len(rows) - 3) + [COLORS["m"]["z"]] * 2
    axes.barh(places, [count for _, count in rows], color=colors, height=0.68)
    axes.set_yticks(places, [label for label, _ in rows])
    for place, (_, count) in zip(places, rows, strict=True):
        axes.text(count, place, f" {count:,}", va="center")
    axes.set_xticks([])
    axes.grid(False)
    axes.set_xlim(0.0, 1.16 * tally.total)
    for spine in axes.spines.values():
        spine.set_visible(False)


def _growth(figure: Any) -> None:
    """Multiplications and additions of kernels over the number of joints of a chain of 6-DOF joints."""
    counts = growth()
    axes = figure.add_axes((0.11, 0.15, 0.86, 0.8))
    for (kernel, marker), color in zip(KERNELS.items(), (TOOL_COLOR, *COLORS["m"].values()), strict=False):
        axes.plot(list(counts), [c[kernel] for c in counts.values()], marker=marker, color=color, markersize=4.0)
        place = (max(counts), counts[max(counts)][kernel])
        offset = (-4, -14 if kernel == "inverse_dynamics" else 6)
        axes.annotate(kernel.replace("_", " "), place, offset, textcoords="offset points", ha="right")
    axes.set_xlabel("joints with six coordinates each")
    axes.set_ylabel("multiplications and additions")
    axes.set_ylim(bottom=0.0)


def _journal(figure: Any) -> None:
    """The worn pin of a slider-crank in its bearing, and the slider's acceleration beside that without play."""
    robot = eomgen.load_robot(SLIDER_CRANK)
    radial = robot.joint("pin").radial
    assert radial is not None
    kernel, speed = eomgen.build(robot), RPM * 2.0 * np.pi / 60.0
    q = kernel.assemble(np.array([0.0, 0.17, 0.0, 0.0, np.pi]))
    v = kernel.project_velocity(q, np.array([speed, 0.0, 0.0, 0.0, 0.0]), fixed=("motor.gamma", "pin.x", "pin.y"))
    steps = round(TURNS * 2.0 * np.pi / speed / STEP)
    qs, vs = kernel.rollout(q, v, np.zeros(kernel.n), STEP, steps, every=EVERY)
    slider = kernel.forward_dynamics(qs, vs, np.zeros(kernel.n))[:, 1]
    left = figure.add_axes((0.09, 0.15, 0.36, 0.76))
    draw_journal(left, qs[:, 2:4], radial.clearance)
    left.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3, handlelength=1.4, columnspacing=1.0)
    right = figure.add_axes((0.55, 0.15, 0.43, 0.76))
    angle = qs[:, 0]
    rod = np.sqrt(0.12**2 - (0.05 * np.sin(angle)) ** 2)
    turned = (0.05 * np.cos(angle)) ** 2 - (0.05 * np.sin(angle)) ** 2
    bent = turned / rod + (0.05**2 * np.sin(angle) * np.cos(angle)) ** 2 / rod**3
    ideal = -(speed**2) * (0.05 * np.cos(angle) + bent)
    right.plot(angle / (2.0 * np.pi), slider / 1e3, color=COLORS["m"]["x"], linewidth=0.7, label="worn pin")
    right.plot(angle / (2.0 * np.pi), ideal / 1e3, color=PROGRAM_COLOR, linestyle="--", label="without play")
    right.set_xlabel("turns of the crank")
    right.set_ylabel("acceleration of the slider, km/s^2")
    right.legend(loc="upper right")


def growth() -> Mapping[int, Mapping[str, int]]:
    """Operations (multiplications and additions) by the number of joints and the kernel."""
    robot = eomgen.load_robot(ROBOT)
    found = {}
    for joints in range(1, len(robot.joints) + 1):
        part = replace(robot, joints=robot.joints[:joints], links=robot.links[:joints], frames=(), tunable=())
        counted = operations(derive_equations(build_model(part), tuple(KERNELS)))
        found[joints] = {name: counted[name]["mul"] + counted[name]["add"] for name in KERNELS}
    return found
