"""The options that all analyses about a state share, and the robot that is prepared by them, once for each analysis."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TypedDict, Unpack

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array
from ..codegen.kernels.groups import ANALYSIS, ANALYSIS_OF_LAWS, kernel_group
from ..description import RobotLike, as_robot
from ..errors import ArrayError, EomgenWarning, InputError
from ..kernel.complete import Kernel
from ..pipeline.building import build
from ..pipeline.mechanisms import mechanism_kernels
from ..progress import StageReport, no_report
from ..robot.model import build_model
from ..robot.value import Robot
from ..runtime.bound import frame_number
from ..state.internal_states import StatesLike
from .holding import Fixation, Gains, PoseLike, fixation_of, pose_of

FrameLoads = Mapping[str, ArrayLike]

KERNELS = ANALYSIS


class StateKeywords(TypedDict, total=False):
    """Keywords of the analyses about a state: the fields of ``StateOptions``."""

    drives: str
    kp: Gains | None
    kd: Gains | None
    fixed: Iterable[str] | None
    loads: FrameLoads | None
    parameters: Mapping[str, float] | None
    kernel: Kernel | None
    z: StatesLike | None


@dataclass(frozen=True, kw_only=True)
class StateOptions:
    """Options of an analysis about a state: how the robot is held, what loads it there, and with which numbers.

    Attributes:
        drives: "locked" (principal coordinates do not move), "free" (they move under the constant forces that hold the
            pose) or "pd" (gains ``kp`` and ``kd`` hold them).
        kp, kd: gains of "pd", N/m or N m/rad, and per rate: a number for all driven coordinates, or by their names;
            kd is 0 by default.
        fixed: names of the coordinates that stay in the state and, if drives are "locked", about it, instead of those
            that ``fixation_of`` finds.
        loads: dead wrenches by frame or link, (6,) each: force (N), moment (N m) at its origin, base frame.
        parameters: values that differ from the description's, {"gravity.z": 0.0} say.
        kernel: of the robot, float64, with KERNELS and ``mechanism_kernels``, and with cut_forces and
            cut_jacobian for what floats in the clearance of a loop joint; built if None.  Its parameters count.
        z: internal states at the state, (m,), or by their names, those left out 0: they stay as they are, since a robot
            with bristles is at rest whatever they are.
    """

    drives: str = "locked"
    kp: Gains | None = None
    kd: Gains | None = None
    fixed: Iterable[str] | None = None
    loads: FrameLoads | None = None
    parameters: Mapping[str, float] | None = None
    kernel: Kernel | None = None
    z: StatesLike | None = None


@dataclass(frozen=True)
class HeldRobot:
    """A robot prepared for an analysis: its kernel, what holds it, and dead wrenches by frame, (6,) each."""

    robot: Robot
    kernel: Kernel
    fixation: Fixation
    loads: Mapping[str, Array]

    def coordinates(self, pose: PoseLike | None) -> Array:
        """Return coordinates of a pose, (n,), m or rad; arguments and errors as ``pose_of``."""
        return pose_of(self.robot, self.kernel, pose)


def prepared(robot: RobotLike, progress: StageReport | None = None, **options: Unpack[StateKeywords]) -> HeldRobot:
    """Return the robot with its kernel, by the options of an analysis about a state.

    Raises:
        InputError: an option cannot be used.
    """
    settings, arm = StateOptions(**options), as_robot(robot)
    kernel = kernel_of(arm, settings.kernel, settings.parameters, progress)
    gains: dict[str, Gains | None] = {"kp": settings.kp, "kd": settings.kd}
    fixation = fixation_of(arm, kernel, settings.drives, **gains, fixed=settings.fixed, z=settings.z)
    return HeldRobot(arm, kernel, fixation, checked_loads(kernel, settings.loads))


def kernel_of(
    robot: Robot,
    kernel: Kernel | None = None,
    parameters: Mapping[str, float] | None = None,
    progress: StageReport | None = None,
) -> Kernel:
    """Return the kernel of an analysis: ``kernel``, or one that is built with these parameters.

    Raises:
        InputError: the kernel is of another robot or not float64, or parameters stand beside a kernel.
    """
    if kernel is None:
        names = (*kernel_group(robot, ANALYSIS, ANALYSIS_OF_LAWS), *mechanism_kernels(robot))
        kernel = build(robot, kernels=names, progress=progress or no_report)
        kernel.parameters.update(parameters or {})
        return kernel
    if parameters:
        raise InputError("parameters and kernel are both set; allowed: one of them (a kernel has parameters)")
    model = build_model(robot)
    if (kernel.coordinates, kernel.internal_states) != (model.coordinates, model.internal_states):
        raise InputError(
            f"kernel: {kernel.name} has not the coordinates of {robot.name}; allowed: a kernel of {robot.name}"
        )
    if kernel.dtype != np.float64:
        raise InputError(f"kernel: {kernel.name} is {kernel.dtype}; allowed: float64")
    return kernel


def checked_loads(kernel: Kernel, loads: FrameLoads | None) -> dict[str, Array]:
    """Return dead wrenches by frame, (6,) each, force (N) and moment (N m) at its origin in the base frame.

    Raises:
        UnknownNameError: no frame or link of that name.
        ArrayError: a wrench that is not six finite numbers.
    """
    wrenches = {}
    for frame, value in (loads or {}).items():
        frame_number(kernel.frames, frame)  # refuses a name that is none
        try:
            wrench = np.array(value, dtype=np.float64)
        except (TypeError, ValueError):
            wrench = np.zeros(0)
        if wrench.shape != (6,) or not np.isfinite(wrench).all():
            raise ArrayError(f"wrench at {frame}: {value!r}; allowed: six finite numbers, N and N m")
        wrenches[frame] = wrench
    return wrenches


def warn_of(notes: Iterable[str]) -> None:
    """Warn of each note with an EomgenWarning, at the line that called the analysis."""
    for note in notes:
        warnings.warn(note, EomgenWarning, stacklevel=4)  # above the function that tells at a prompt
