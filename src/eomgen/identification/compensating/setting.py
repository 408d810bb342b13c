"""The task of a compensation: a scenario whose path is compensated, at samples, and what its simulations say."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np

from ...arrays import Array, Index, Mask
from ...kernel.complete import Kernel
from ...motion.ends import principal_limits
from ...motion.splines import Spline
from ...progress import no_progress
from ...robot.coordinates import index_of
from ...robot.value import Robot
from ...scenario.value import Scenario
from ...simulation.assembly import Assembly, with_kernel
from ...simulation.controls import JointPD
from ...simulation.result import SimulationResult
from ...simulation.run import run_assembly


@dataclass(frozen=True, eq=False)
class Setting:
    """A path to compensate: T samples of m driven coordinates, n coordinates in all.

    Attributes:
        robot, frame: whose tool is to follow.
        scenario: with samples of its results at those of the reference and halfway between them.
        assembly: of the scenario with the reference as it was.
        t: times of the reference's samples, (T,), s.
        original: the reference there, (T, m), m or rad.
        index: places of the driven coordinates among the robot's, (m,).
        limits: of the driven coordinates, (m, 2).
        rates: greatest rates of the driven coordinates, (m,); infinite where there are none.
        weights: of the tool's errors along and about its axes, (6,), 1 and m/rad.
        before: the simulation of the reference as it was.
    """

    robot: Robot
    frame: str
    scenario: Scenario
    assembly: Assembly
    t: Array
    original: Array
    index: Index
    limits: Array
    rates: Array
    weights: Array
    before: SimulationResult

    @property
    def want(self) -> Array:
        """Poses that the tool is to take, at and between the samples, (2 T - 1, 4, 4)."""
        return self.before.program_pose

    @property
    def movable(self) -> Mask:
        """Which driven coordinates may be corrected, (m,).

        Those of free joints are only held by drives, and those without a gain do not follow their reference.
        """
        drive = self.assembly.drive
        gains = drive.kp if isinstance(drive, JointPD) else np.ones(len(self.limits))
        return np.asarray((self.limits[:, 0] < self.limits[:, 1]) & (gains > 0.0))

    def with_program(self, samples: Array) -> Assembly:
        """Return the assembly whose reference goes through samples, (T, m)."""
        program, drive = Spline(self.t, samples, at_rest=False), cast("Any", self.assembly.drive)
        return replace(self.assembly, program=program, drive=replace(drive, motion=program))

    def run(self, samples: Array | None, parameters: Mapping[str, float] | None = None) -> SimulationResult:
        """Return the simulation of a reference through samples, (T, m), or of the one as it was.

        Args:
            samples: of the reference.
            parameters: by name, of a robot that differs from the described one; drives go on to know that.

        Raises:
            IntegrationError: the motion does not come to its end.
        """
        assembly = self.assembly if samples is None else self.with_program(samples)
        if parameters:
            kernel = assembly.kernel.replaced(parameters=parameters)
            assembly = replace(with_kernel(assembly, self.robot, self.scenario, kernel), until=None)
        return simulated(self.robot, self.scenario, assembly, self.frame)


def simulated(robot: Robot, scenario: Scenario, assembly: Assembly, frame: str) -> SimulationResult:
    """Return the simulation of an assembly to the scenario's duration; errors as ``run_scenario``."""
    return run_assembly(robot, scenario, assembly, frame, no_progress, balance=False)


def setting_of(
    robot: Robot,
    frame: str,
    scenario: Scenario,
    assembly: Assembly,
    t: Array,
    rates: Mapping[str, float],
    weights: Array,
) -> Setting:
    """Return the task of an assembly whose path is compensated at samples; its first simulation is done.

    Args:
        robot, frame, scenario, assembly, t, weights: as of ``Setting``.
        rates: greatest rates by the full names of driven coordinates.
    """
    program = assembly.program
    assert program is not None
    fine = replace(scenario, output_step=float(t[-1]) / (2 * (t.size - 1)), until=None)
    assembly = replace(assembly, until=None)
    before = simulated(robot, fine, assembly, frame)
    places = {name: value for name, value in assembly.initial_q.items() if name not in assembly.driven}
    assembly = replace(assembly, initial_q=places)  # a compensated path says itself where it begins
    return Setting(
        robot=robot,
        frame=frame,
        scenario=fine,
        assembly=assembly,
        t=t,
        original=np.asarray(program.at(t)[0]),
        index=np.asarray(index_of(assembly.kernel.coordinates, assembly.driven), dtype=np.intp),
        limits=np.array([principal_limits(robot, name) for name in assembly.driven]),
        rates=np.array([rates.get(name, np.inf) for name in assembly.driven]),
        weights=weights,
        before=before,
    )


def places_of(kernel: Kernel, setting: Setting) -> tuple[Index, Array]:
    """Return coordinates that follow a reference rigidly, k of them: driven ones and their motors.

    Returns:
        places, (k, 2), among the robot's coordinates and of the driven one that each follows; and ratios, (k,).
    """
    names, driven = kernel.coordinates, setting.assembly.driven
    rows = [(place, column, 1.0) for column, place in enumerate(setting.index.tolist())]
    for motor, joint in kernel.motors.items():
        if joint in driven:
            rows.append((names.index(motor), driven.index(joint), kernel.ratio(motor)))
    return np.array([row[:2] for row in rows], dtype=np.intp), np.array([row[2] for row in rows])
