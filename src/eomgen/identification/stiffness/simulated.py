"""Measured motions as rollouts under their drives, with derivatives by parameters and by states at the beginning."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from ...arrays import Array
from ...errors import ArrayError, InputError, LoopError, SingularError
from ...kernel.complete import Kernel
from ...kernel.stepping.input_signals import DriveData, Gains, Index, InputSignals, Signal, Track, Waves
from ...motion.files import MeasuredMotion
from ...motion.smoothing import noise_deviation
from ...motion.splines import spline_signal
from ...names import component_name, listed
from ...optional import optional_import
from ...robot.coordinates import index_of
from ...robot.model import Model
from ...runtime.singular import inertias
from .closed_starts import ClosedStarts
from .levenberg_marquardt import Residuals

METHOD: Final = "rosenbrock"
LEAST_NOISE = 1e-9  # of a coordinate's rms: less noise than that of the integration is not asked for
ACCURACY = 0.02, 1e-10, 1e-6  # of the steps: share of the noise, least and most of the motion
AT_START = 9  # samples through which a parabola gives the velocity at the beginning


@dataclass(frozen=True)
class Run:
    """A measured motion and what simulates it.

    Attributes:
        source: the file.
        times: s from the beginning, (T,).
        q: measured coordinates, (T, k).
        places: of these among the kernel's, (k,).
        noise: their standard deviations, (k,), m or rad.
        start: q, v and z of the state at the beginning, (n,), (n,) and (m,).
        loads: drives and prescribed motions.
        rtol, atol: of the steps; atol is (2 n + m,).
    """

    source: str
    times: Array
    q: Array
    places: Index
    noise: Array
    start: tuple[Array, Array, Array]
    loads: InputSignals
    rtol: float
    atol: Array

    def led(self, kernel: Kernel, bandwidth: float) -> Run:
        """Return it with gains that lead the model along the measured motion, rad/s; as it is with 0."""
        if not bandwidth:
            return self
        inertia = inertias(kernel.mass_matrix(self.start[0]))[self.places]
        program = Track(_splines(self.times, self.q, 3), self.places)
        gains = Gains(inertia * bandwidth**2, 2.0 * inertia * bandwidth)
        drive = replace(self.loads.drive, program=program, gains=gains)
        return replace(self, loads=replace(self.loads, drive=drive))

    def roughly(self) -> Run:
        """Return it with the widest tolerances."""
        rtol = ACCURACY[2]
        return replace(self, rtol=rtol, atol=self.atol * (rtol / self.rtol))

    @property
    def sizes(self) -> Array:
        """Standard deviations of the measured coordinates over time, (k,)."""
        return np.asarray(np.std(self.q, axis=0))

    def with_noise(self, noise: Array) -> Run:
        """Return it with other standard deviations, and steps as exact as these ask for."""
        noise = np.maximum(noise, np.maximum(LEAST_NOISE * self.sizes, 1e-15))
        rtol = accuracy(noise, self.sizes)
        return replace(self, noise=noise, rtol=rtol, atol=self.atol * (rtol / self.rtol))


def accuracy(noise: Array, sizes: Array) -> float:
    """Return a relative tolerance of steps that is well below the noise of coordinates of these sizes."""
    share, least, most = ACCURACY
    return float(np.clip(share * (noise / np.maximum(sizes, 1e-300)).min(), least, most))


def run_of(kernel: Kernel, model: Model, motion: MeasuredMotion) -> Run:
    """Return a motion of a robot as what simulates it.

    Raises:
        InputError: a drive is not known, or a prescribed coordinate or none at all was measured.
    """
    names, n, times = kernel.coordinates, kernel.n, motion.t - motion.t[0]
    driven = [names[i] for i in model.driven]
    open_drives = [name for name in driven if name not in motion.driven]
    if open_drives:
        columns = listed([component_name(name, "drive") for name in open_drives])
        raise InputError(f"{motion.source}: has no {columns}; allowed: drives of all driven coordinates")
    still = [name for name in kernel.prescribed if name not in motion.measured]
    if still:
        raise InputError(f"{motion.source}: has no {listed(still)}; allowed: all coordinates with prescribed motions")
    measured = [name for name in motion.measured if name not in kernel.prescribed]
    if not measured:
        raise InputError(f"{motion.source}: has no coordinates; allowed: one at least that is not prescribed")
    places = np.array(index_of(names, measured))
    q, z = motion.q[:, places], np.zeros(len(kernel.internal_states))
    if motion.v is None:
        first, slope, _ = np.polynomial.polynomial.polyfit(times[:AT_START], motion.q[:AT_START], 2)
        start = first, slope, z
    else:
        start = motion.q[0].copy(), motion.v[0].copy(), z
    noise = noise_deviation(q)
    rtol = accuracy(noise, np.std(q, axis=0))
    drive = DriveData(torque=Track(Signal.through(times, motion.u), np.arange(n)))
    prescribed = _prescribed(kernel, motion, times) if kernel.prescribed else None
    atol = _tolerances(kernel, motion, times, rtol)
    run = Run(motion.source, times, q, places, noise, start, InputSignals(drive, prescribed=prescribed), rtol, atol)
    return run.with_noise(noise)


def _prescribed(kernel: Kernel, motion: MeasuredMotion, times: Array) -> Waves:
    """Return the measured motions of prescribed coordinates as splines."""
    columns = motion.q[:, index_of(kernel.coordinates, kernel.prescribed)]
    count = len(kernel.prescribed)
    return Waves(np.zeros((count, 4)), [Track(_splines(times, columns, 5), np.arange(count))])


def _splines(times: Array, columns: Array, degree: int) -> Signal:
    """Return splines through samples, (T, k)."""
    with optional_import("SciPy", "fit needs"):
        from scipy.interpolate import make_interp_spline
    return spline_signal(make_interp_spline(times, columns, k=degree))


def _tolerances(kernel: Kernel, motion: MeasuredMotion, times: Array, rtol: float) -> Array:
    """Return absolute tolerances of steps, (2 n + m,): of what was measured in units of its motion."""
    sizes = np.array(kernel.calls.raw.libraries.meta["sizes"], np.float64)
    atol, n = rtol * sizes, kernel.n
    velocities = np.gradient(motion.q, times, axis=0) if motion.v is None else motion.v
    for offset, columns in ((0, motion.q), (n, velocities)):
        rms = np.sqrt(np.mean((columns - columns.mean(axis=0)) ** 2, axis=0))
        for i in index_of(kernel.coordinates, motion.measured):
            if rms[i] > 0.0:
                atol[offset + i] = min(atol[offset + i], rtol * rms[i])
    return atol


@dataclass(frozen=True)
class Simulation:
    """Runs of a kernel as functions of parameters, then of the states at the beginning of each run.

    Attributes:
        kernel: whose parameters are set.
        names: of the parameters.
        runs: of the motions.
        closing: of a closed mechanism, what its state follows from; None of a tree.
    """

    kernel: Kernel
    names: tuple[str, ...]
    runs: Sequence[Run]
    closing: ClosedStarts | None = None

    @staticmethod
    def of(kernel: Kernel, names: tuple[str, ...], runs: Sequence[Run], guess: Array) -> Simulation:
        """Return the simulation of runs, which begin with loops closed.

        Args:
            kernel, names, runs: as of the attributes.
            guess: of coordinates that were not measured, (n,).

        Raises:
            LoopError: loops do not close near what was measured.
        """
        if not kernel.constraints:
            return Simulation(kernel, names, runs)
        closing, closed = None, list[Run]()
        for run in runs:
            q = guess.copy()
            q[run.places] = run.q[0]
            measured = [kernel.coordinates[i] for i in run.places]
            q = np.asarray(kernel.assemble(q))
            closing = closing or ClosedStarts.near(kernel, q, measured)
            closed.append(replace(run, start=(*closing.state(q, run.start[1]), run.start[2])))
        return Simulation(kernel, names, closed, closing)

    @property
    def moving(self) -> Index:
        """Indices of the numbers of q, v (from n on) and z (from 2 n on) at the beginning of a run that are free."""
        kernel, n = self.kernel, self.kernel.n
        free = [i for i, name in enumerate(kernel.coordinates) if name not in kernel.prescribed]
        if self.closing is not None:
            free = [i for i in free if i in self.closing.independent]
        states = range(2 * n, 2 * n + len(kernel.internal_states))
        return np.array([*free, *(n + i for i in free), *states], dtype=np.intp)

    def values(self) -> Array:
        """Return the parameters as they are, and the states at the beginning."""
        starts = [np.concatenate(run.start)[self.moving] for run in self.runs]
        return np.concatenate([[self.kernel.parameters[name] for name in self.names], *starts])

    def columns(self) -> list[slice]:
        """Return where samples of each coordinate of each run stand among residuals."""
        ends = np.cumsum([0, *(len(run.times) for run in self.runs for _ in run.places)])
        return [slice(begin, end) for begin, end in zip(ends[:-1].tolist(), ends[1:].tolist(), strict=True)]

    def __call__(self, values: Array) -> Residuals | None:
        """Return residuals with these values; None where a motion does not reach its end."""
        count, width = len(self.names), self.moving.size
        try:
            self.kernel.parameters.update(dict(zip(self.names, values[:count].tolist(), strict=True)))
        except InputError:
            return None
        errors, blocks = [], []
        for k, run in enumerate(self.runs):
            begin = count + k * width
            try:
                q, by = self._simulated(run, values[begin : begin + width])
            except (ArrayError, InputError, LoopError, SingularError):  # the motion does not reach its end
                return None
            if not (np.isfinite(q).all() and np.isfinite(by).all()):
                return None
            errors.append(((run.q - q) / run.noise).T.ravel())
            block = np.zeros((errors[-1].size, values.size))
            scaled = (by / run.noise[:, np.newaxis]).transpose(1, 0, 2).reshape(errors[-1].size, -1)
            block[:, begin : begin + width], block[:, :count] = scaled[:, :width], scaled[:, width:]
            blocks.append(block)
        return Residuals(np.concatenate(errors), np.concatenate(blocks))

    def _simulated(self, run: Run, start: Array) -> tuple[Array, Array]:
        """Return simulated coordinates, (T, k), and derivatives by the start, then by parameters, (T, k, width + p)."""
        n, moving = self.kernel.n, self.moving
        state = np.concatenate(run.start)
        state[moving] = start
        units, is_state = np.eye(state.size)[moving], moving >= 2 * n
        (q, v, z), (by_q, by_v, by_z) = (np.split(x, (n, 2 * n), axis=-1) for x in (state, units))
        if self.closing is not None:
            q, v = self.closing.state(q, v)
            by_q[~is_state], by_v[~is_state] = self.closing.slopes(q, v, moving[~is_state])
        has_states = bool(self.kernel.internal_states)
        (q, *_), (by, *_) = self.kernel.rollout_sensitivity(
            q,
            v,
            duration=float(run.times[-1]),
            samples=len(run.times) - 1,
            parameters=self.names,
            along={"q": by_q, "v": by_v} | ({"z": by_z} if has_states else {}),
            method=METHOD,
            rtol=run.rtol,
            atol=run.atol,
            loads=run.loads,
            z=z,
        )
        return q[:, run.places], by[:, :, run.places].transpose(0, 2, 1)
