"""Draw the loop of docs/howto/harmonic_drive.md from its blocks: python docs/hysteresis.py (make picture)."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import numpy as np

import eomgen
from eomgen.description.load import robot_from_toml
from eomgen.pictures.style import COLORS, PROGRAM_COLOR, canvas
from eomgen.scenario.load import scenario_from_toml

PAGE = Path(__file__).parent / "howto" / "harmonic_drive.md"
TARGET = PAGE.with_suffix(".svg")


def draw(path: Path) -> None:
    """Simulate the page's torque cycle; draw torque over torsion, and the spring alone."""
    blocks = dict(re.findall(r'^```toml title="(\w+\.toml)"\n(.*?)^```$', PAGE.read_text("utf-8"), re.DOTALL | re.M))
    robot = robot_from_toml(blocks["gear.toml"])
    cycle = eomgen.run_scenario(robot, scenario_from_toml(blocks["cycle.toml"])).trajectory
    torque = np.interp(cycle.t, [0.0, 2.0, 6.0, 10.0], [0.0, 60.0, -60.0, 60.0])
    gear = robot.joint("gear").coordinates["gamma"]
    x = np.linspace(-1.35e-3, 1.35e-3, 201)
    with canvas(4.6, 3.3, path) as figure:
        axes = figure.add_axes((0.15, 0.15, 0.82, 0.81))
        axes.plot(1e3 * cycle.of("gear.gamma"), torque, color=COLORS["m"]["x"], label="gear")
        spring = (gear.stiffness or 0.0) * x + (gear.cubic or 0.0) * x**3
        axes.plot(1e3 * x, spring, color=PROGRAM_COLOR, linestyle="--", linewidth=1.0, label="spring alone")
        axes.set_xlabel("torsion, mrad")
        axes.set_ylabel("torque, N m")
        axes.legend(loc="upper left")


if __name__ == "__main__":
    draw(Path(sys.argv[1]) if len(sys.argv) > 1 else TARGET)
