"""Kernels that assemble a mechanism, its home with loops assembled, and its mobility there."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..codegen.kernels.groups import ASSEMBLY, INERTIA, MECHANISM, kernel_group
from ..errors import BuildError, LoopError
from ..loops.redundant import redundancy
from ..progress import StageReport, no_report
from ..robot.model import build_model
from ..robot.value import Robot
from .building import build

BRANCHES = 8  # ways to close that are looked for


def assembly_kernels(robot: Robot) -> tuple[str, ...]:
    """Return names of the kernels that ``Kernel.assemble`` calls; none without loops and couplings."""
    if not build_model(robot).constraints:
        return ()
    return kernel_group(robot, ASSEMBLY)


def mechanism_kernels(robot: Robot) -> tuple[str, ...]:
    """Add what moves the mechanism along its loops: charts, residual, mass matrix, the constraint's bias."""
    kernels = assembly_kernels(robot)
    return (*kernels, *kernel_group(robot, MECHANISM)) if kernels else ()


def assembled_home(robot: Robot, progress: StageReport = no_report) -> tuple[float, ...]:
    """Return the description's home, (n,), m or rad, assembled; compiles ``assembly_kernels`` where there are some.

    Raises:
        LoopError: a loop or a coupling stays open, or closes turned over alone.
    """
    home, kernels = build_model(robot).home, assembly_kernels(robot)
    if not kernels:
        return home
    kernel = build(robot, kernels=kernels, flags=("-O0",), progress=progress)
    return tuple(kernel.assemble(home).tolist())


@dataclass(frozen=True)
class Mobility:
    """A rigid mechanism at home, its loops closed.

    Attributes:
        freedoms: degrees of freedom, prescribed coordinates at rest.
        rank: of the constraint.
        redundant, undetermined: names of constraints, see ``loops.Redundancy``.
        branches: in how many ways it closes near home with its drives held, up to BRANCHES; home is the nearest.
        note: why nothing of this is known; empty where it is.
    """

    freedoms: int = 0
    rank: int = 0
    redundant: tuple[str, ...] = ()
    undetermined: tuple[str, ...] = ()
    branches: int = 0
    note: str = ""

    def as_dict(self) -> dict[str, Any]:
        """Return plain values, for JSON."""
        return {**vars(self), "redundant": list(self.redundant), "undetermined": list(self.undetermined)}

    def lines(self) -> list[str]:
        """Say what is known, for people."""
        if self.note:
            return [f"mobility: not known: {self.note}"]
        many = f"{BRANCHES} ways or more" if self.branches >= BRANCHES else f"{self.branches} ways"
        ways = "one way" if self.branches == 1 else many
        text = f"mobility at home: {self.freedoms}; {self.rank} independent constraints"
        redundant = f", {len(self.redundant)} redundant ({', '.join(self.redundant)})" if self.redundant else ""
        if not self.branches:
            return [f"{text}{redundant}", "branch: its drives do not hold it"]
        return [f"{text}{redundant}", f"branch: with its drives held it closes in {ways}, home is the nearest"]


def mobility_of(robot: Robot, *, progress: StageReport = no_report) -> Mobility | None:
    """Analyse a rigid mechanism's mobility; None without a loop or coupling.  Compiles a few kernels."""
    rigid = robot.rigid() if robot.is_closed else robot
    model = build_model(rigid)
    if not model.constraints:
        return None
    try:
        kernel = build(rigid, kernels=kernel_group(rigid, INERTIA, ASSEMBLY), flags=("-O0",), progress=progress)
        driven = [model.coordinates[i] for i in model.driven]
        home = kernel.assemble(np.array(model.home))
        constraints = redundancy(kernel, home)
        ways = len(kernel.assemble(home, driven, roots=BRANCHES)) if len(driven) >= constraints.mobility else 0
    except (BuildError, LoopError) as error:
        return Mobility(note=str(error).splitlines()[0])
    return Mobility(constraints.mobility, constraints.rank, constraints.redundant, constraints.undetermined, ways)
