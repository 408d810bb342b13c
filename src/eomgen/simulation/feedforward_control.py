"""Drives of a scenario by feed-forward, with a PD law about the motion of the drives that goes with it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from ..arrays import Array
from ..errors import DescriptionError, InputError
from ..lazily import from_above
from ..motion.splines import Spline
from ..robot.coordinates import index_of
from ..robot.value import Robot
from ..runtime.kernel import Kernel
from ..runtime.stepping.input_signals import Gains
from ..scenario.value import Scenario, Section
from .controls import actuators
from .sampled_drive import SampledDrive

SAMPLES, LONGEST = 1000, 1e-3  # steps of a feed-forward at least, and the longest, s
MOST = 200_000


class FeedforwardStart(NamedTuple):
    """Drives by feed-forward, coordinates and velocities with which they begin, (n,) each, and notes about them."""

    drive: SampledDrive
    begin: tuple[Array, Array]
    notes: tuple[str, ...]


def feedforward_start(
    robot: Robot, scenario: Scenario, control: Section, kernel: Kernel, driven: Sequence[str], gains: Gains
) -> FeedforwardStart:
    """Return the drives of a scenario's feed-forward, which knows of no wrenches and payloads.

    Args:
        robot, scenario: as of ``run_scenario``.
        control: with the feed-forward's options.
        kernel: of the robot.
        driven: coordinates of the reference trajectory.
        gains: of feedback at these.

    Raises:
        DescriptionError, or another InputError: there is no feed-forward of the robot or the motion; names the control.
        IntegrationError: as of ``stable_inversion``.
    """
    step = min(scenario.output_step or np.inf, scenario.duration / SAMPLES, LONGEST)
    t = np.linspace(0.0, scenario.duration, min(int(np.ceil(scenario.duration / step - 1e-9)), MOST) + 1)
    options = {key: control.get(key) for key in ("outputs", "tolerance")}
    undisturbed = replace(scenario, wrenches=(), payloads=())
    try:
        made: Any = from_above(".control.elastic_feedforward", "feedforward")(robot, undisturbed, t=t, **options)
    except DescriptionError:
        raise
    except InputError as error:
        scenario.fail("control", str(error))
    acting = actuators(kernel, driven)
    index = np.asarray(index_of(kernel.coordinates, made.driven), dtype=np.intp)
    kp, kd, ratio = np.zeros(index.size), np.zeros(index.size), np.ones(index.size)
    for place, one, *both in zip(acting.index, acting.ratios, gains.kp, gains.kd, strict=True):
        kp[index == place], kd[index == place] = both
        ratio[index == place] = one
    forces = Spline(t, made.u[:, index], at_rest=False).as_signal()
    places = Spline(t, made.q[:, index] / ratio, at_rest=False).as_signal() if kp.any() or kd.any() else None
    drive = SampledDrive(forces, index, places, ratio, Gains(kp, kd))
    notes = tuple(f"feed-forward: {x.removeprefix('note: ').strip()}" for x in (*made.ways(), *made.notes))
    return FeedforwardStart(drive, (made.q[0], made.v[0]), notes)
