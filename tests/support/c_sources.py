"""The text of a robot's C, and what its binary may hold."""

from __future__ import annotations

import subprocess
from dataclasses import replace
from pathlib import Path

from eomgen.codegen.c.source import Source
from eomgen.codegen.c.sources import render
from eomgen.codegen.kernels.equations import derive_equations
from eomgen.robot.model import build_model
from eomgen.robot.value import Robot
from tests.support.random_robots import random_robot


def elastic_tree() -> Robot:
    """A tree with more coordinates than are solved in straight lines, and parameters of every kind."""
    robot = random_robot(5, joints=(4, 4), tree=True, types=("revolute", "prismatic", "free"), max_coordinates=4)
    tunable = (
        f"links.{robot.links[0].name}.mass",
        f"links.{robot.links[-1].name}.com.x",
        "joints.joint2.placement.xyz.0",
    )
    return replace(robot, name="elastic_tree", tunable=tunable)


def write_source(source: Source, folder: Path) -> None:
    """Write header, code and the library that they include into a folder."""
    for place, text in source.files.items():
        (folder / place).parent.mkdir(exist_ok=True)
        (folder / place).write_text(text, encoding="ascii")


def source_of(robot: Robot, dtype: str = "float64") -> Source:
    return render(derive_equations(build_model(robot)), dtype)


def check_symbols(library: Path, source: Source) -> None:
    """Nothing global is written, nothing is called but libm, and every global name begins with the robot's."""
    listed = subprocess.run(["nm", library], capture_output=True, text=True, check=True).stdout
    found = [line.split()[-2:] for line in listed.splitlines()]
    libm = {
        "sin",
        "cos",
        "sincos",
        "sinf",
        "cosf",
        "sincosf",
        "sqrt",
        "sqrtf",
        "exp",
        "expf",
        "log",
        "logf",
        "atan2",
        "atan2f",
    }
    libm |= {"round", "roundf", "pow"}
    compilers_own = {"memset", "memcpy", "memmove", "_GLOBAL_OFFSET_TABLE_", "__stack_chk_fail"}
    sections = subprocess.run(["objdump", "-t", library], capture_output=True, text=True, check=True).stdout
    constant = {line.split()[-1] for line in sections.splitlines() if " .data.rel.ro" in line}  # but for relocation
    for kind, name in found:
        assert kind in "TtUrR" or name in constant, (kind, name)  # no data, no bss
        assert name in libm | compilers_own if kind == "U" else kind != "T" or name.startswith(f"{source.name}_")
