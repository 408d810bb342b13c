"""Drives of a scenario by feed-forward, with a PD law about the motion of the drives that goes with it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ..arrays import Array
from ..errors import DescriptionError, InputError
from ..kernel.complete import Kernel
from ..kernel.stepping.input_signals import Gains, Signal
from ..motion.point_to_point import Program
from ..motion.splines import Spline
from ..robot.coordinates import index_of
from ..robot.value import Robot
from ..scenario.value import Scenario, Section
from .controls import actuators
from .sampled_drive import SampledDrive

SAMPLES, LONGEST = 1000, 1e-3  # steps of a feed-forward at least, and the longest, s
MOST = 200_000  # steps
BREAKS, FEWEST = 64, 8  # pieces between jumps of a motion's time derivatives at most, and the steps of one at least
KINK = 6  # the highest time derivative whose jumps splines through samples would smooth


class FeedforwardStart(NamedTuple):
    """Drives by feed-forward, coordinates and velocities with which they begin, (n,) each, and notes about them."""

    drive: SampledDrive
    begin: tuple[Array, Array]
    notes: tuple[str, ...]


class Reference(NamedTuple):
    """A reference trajectory and the names of the coordinates that it moves."""

    program: Program
    driven: Sequence[str]


def feedforward_start(
    robot: Robot, scenario: Scenario, control: Section, kernel: Kernel, motion: Reference, gains: Gains
) -> FeedforwardStart:
    """Return the drives of a scenario's feed-forward, which knows of no wrenches and payloads.

    Args:
        robot, scenario: as of ``run_scenario``.
        control: with the feed-forward's options.
        kernel: of the robot.
        motion: the reference trajectory.
        gains: of feedback at these.

    Raises:
        DescriptionError, or another InputError: there is no feed-forward of the robot or the motion; names the control.
        IntegrationError: as of ``stable_inversion``.
    """
    from ..control.elastic_feedforward import feedforward

    step = max(min(scenario.output_step or np.inf, scenario.duration / SAMPLES, LONGEST), scenario.duration / MOST)
    pieces = _pieces(motion.program, scenario.duration, step)
    before = [np.append(t[:-1], np.nextafter(t[-1], 0.0)) for t in pieces[:-1]]  # a jump
    options = {key: control.get(key) for key in ("outputs", "tolerance")}
    undisturbed = replace(scenario, wrenches=(), payloads=())
    try:
        made = feedforward(robot, undisturbed, t=np.concatenate([*before, pieces[-1]]), **options)
    except DescriptionError:
        raise
    except InputError as error:
        scenario.fail("control", str(error))
    acting = actuators(kernel, motion.driven)
    index = np.asarray(index_of(kernel.coordinates, made.driven), dtype=np.intp)
    kp, kd, ratio = np.zeros(index.size), np.zeros(index.size), np.ones(index.size)
    for place, one, *both in zip(acting.index, acting.ratios, gains.kp, gains.kd, strict=True):
        kp[index == place], kd[index == place] = both
        ratio[index == place] = one
    forces = _through(pieces, made.u[:, index])
    places = _through(pieces, made.q[:, index] / ratio) if kp.any() or kd.any() else None
    drive = SampledDrive(forces, index, places, ratio, Gains(kp, kd))
    notes = tuple(f"feed-forward: {x.removeprefix('note: ').strip()}" for x in (*made.ways(), *made.notes))
    return FeedforwardStart(drive, (made.q[0], made.v[0]), notes)


def _pieces(program: Program, duration: float, step: float) -> list[Array]:
    """Return times of samples between jumps of a motion's time derivatives, (T,) each; the next begins where one ends.

    Of a motion with more jumps than BREAKS, a measured one say, there is one piece.
    """
    jumps = getattr(program, "jumps", None)
    inside = [] if jumps is None else [x.t for x in jumps(KINK) if 1e-9 * duration < x.t < (1.0 - 1e-9) * duration]
    ends = [0.0, *inside, duration] if len(inside) < BREAKS else [0.0, duration]
    return [np.linspace(a, b, max(FEWEST, int(np.ceil((b - a) / step - 1e-9))) + 1) for a, b in pairwise(ends)]


def _through(pieces: Sequence[Array], samples: Array) -> Signal:
    """Return the signal of splines through samples, (T, columns), each over a piece of times."""
    rows = np.split(samples, np.cumsum([t.size for t in pieces])[:-1])
    signals = [Spline(t, x, at_rest=False).as_signal() for t, x in zip(pieces, rows, strict=True)]
    knots = np.concatenate([signals[0].knots[:1], *(signal.knots[1:] for signal in signals)])
    return Signal(knots, np.concatenate([signal.coefficients for signal in signals]))
