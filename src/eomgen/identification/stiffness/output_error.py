"""Numbers of laws from measured motions and known drives, by the output-error method.

The robot is simulated under the drives of the file, and its parameters, with the states at the beginning, are those
with which it comes closest to the measured coordinates: least squares of white noise of these.  Nothing is
differentiated and nothing filtered, so that noise stays as it is, and internal states need not be measured: z at the
beginning is found as q and v there are.  Derivatives are those of the steps themselves, by sensitivities in C.

A motion with wrong numbers may be far from the measured one.  So the model is led along it at first, by gains that
fade away: while they are high, errors are those of forces, of which there is but one least square near by.
L. Ljung, "System Identification", 2nd ed. (1999), section 7.2, has predictors of which this is one.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ...arrays import Array
from ...codegen.kernels.groups import FIT_OF_MOTIONS
from ...errors import DescriptionError, InputError, UnknownNameError
from ...kernel.complete import Kernel
from ...motion.files import MeasuredMotion, measured_motion
from ...names import listed
from ...optional import optional_import
from ...pipeline.building import build
from ...pipeline.mechanisms import mechanism_kernels
from ...progress import StageReport
from ...robot.internal_states.drives import DRIVE
from ...robot.laws import law_conflict
from ...robot.model import build_model
from ...robot.parameter_names import expand_tunable, leasts
from ...robot.value import Robot
from ..estimating import SOLVED, evenly_sampled
from ..relations import refuse_followers
from .beams import beam_notes
from .levenberg_marquardt import BLOCKS, Certainty, Descent, certainty, descend
from .result import Estimate, FitResult, FittedNumber
from .simulated import LEAST_NOISE, Simulation, run_of

KEPT = ("fade", "smoothing", "A")  # numbers of laws with internal states that are looked for by their names alone
LED = (0.1, 0.01)  # bandwidths of the first descents, per step of the samples
STEPS = 30, 100  # of each of these, and of the last descent
ENOUGH = 2.0  # times the noise: errors at which the first descents end
ROUGH = 0.05  # of the noise: changes of the motion below which the first descents end
FINE = 0.01  # and the last one
SCALINGS, SCALED = 6, 0.7  # times that noise is taken from the residuals, and the logarithm of what counts as the same
UNEXPLAINED = 0.5  # of the motion's rms, from which on the fit is doubted


def numbers_sought(robot: Robot, patterns: Sequence[str] | None) -> tuple[str, ...]:
    """Return names of the parameters that patterns name; by default those of laws that have states, but for drives.

    Raises:
        UnknownNameError: a pattern names no parameter.
    """
    if patterns is None:
        laws = tuple(f"{x.prefix}.{x.law}." for x in build_model(robot).states if x.law != DRIVE)
        own = [name for name, value in robot.numbers() if value is not None and name.startswith(laws)]
        return tuple(name for name in own if name.rpartition(".")[2] not in KEPT)
    try:
        return expand_tunable(robot, patterns)
    except DescriptionError as error:
        raise UnknownNameError(f"parameters: {error}") from None


def output_error_kernels() -> tuple[str, ...]:
    """Return names of the kernels that such a fit calls."""
    return FIT_OF_MOTIONS


def fit_numbers(
    robot: Robot,
    motions: Sequence[MeasuredMotion | Path | str],
    names: Sequence[str],
    *,
    confidence: float,
    bandwidth: float,
    kernel: Kernel | None,
    progress: StageReport,
) -> FitResult:
    """Return parameters of a robot from measured motions.

    Args:
        robot: with constraints.
        motions: measured ones, or the paths of files.
        names: of the parameters.
        confidence: of intervals.
        bandwidth: rad/s, with which the model is led along the motions to the end.
        kernel: of that robot; built if None.
        progress: is told of steps.

    Raises:
        InputError: laws of a robot with rigid loops or couplings have states, the parameters are none, or a motion
            cannot be used.
        LoopError: loops do not close near the beginning of a motion.
    """
    model = build_model(robot)
    if model.constraints and model.internal_states:
        some = ", ".join(model.constraints[:3]) + (", ..." if len(model.constraints) > 3 else "")
        raise InputError(
            f"fit: {robot.name} has rigid loops or couplings ({some}) and laws with internal states; allowed for"
            " parameters: one of both"
        )
    if not names:
        raise InputError("parameters: none; allowed: one at least, by name, as numbers of drives are always")
    if kernel is None:
        tunable = tuple(dict.fromkeys((*robot.tunable, *names)))
        names_of = (*output_error_kernels(), *mechanism_kernels(robot))
        kernel = build(replace(robot, tunable=tunable), kernels=tuple(dict.fromkeys(names_of)), progress=progress)
    refuse_followers(robot, kernel)
    missing = [name for name in names if name not in kernel.parameters]
    if missing:
        raise UnknownNameError(f"kernel: has no parameters {listed(missing)}; allowed: one in which they are tunable")
    own = copy(kernel)
    measured = [evenly_sampled(measured_motion(robot, motion, kernel.coordinates)) for motion in motions]
    shortest = min(even.step for even in measured)
    runs = [run_of(own, model, even.motion) for even in measured]
    simulation = Simulation.of(own, tuple(names), runs, np.array(model.home))
    found = _Fit(robot, simulation, 1.0 / shortest, bandwidth, progress).result(confidence)
    return replace(found, notes=(*found.notes, *(note for even in measured for note in even.notes)))


@dataclass(frozen=True)
class _Fit:
    """A robot, its simulation, the rate of its samples, per s, and the bandwidth of the last descent, rad/s."""

    robot: Robot
    simulation: Simulation
    rate: float
    bandwidth: float
    progress: StageReport

    def result(self, confidence: float) -> FitResult:
        """Return the parameters that bring the simulation onto the motions."""
        simulation, values = self.simulation, self.simulation.values()
        names, described = simulation.names, values.copy()
        rough = replace(simulation, runs=[run.roughly() for run in simulation.runs])
        for share in LED:
            wide = share * self.rate
            if wide > self.bandwidth:
                led = self._descended(rough, values, wide, STEPS[0], ROUGH, ENOUGH)
                values = values if led is None else led.values
        descent = self._descended(simulation, values, self.bandwidth, STEPS[1], FINE)
        for _ in range(SCALINGS):
            if descent is None or _is_scaled(spreads := _spreads(simulation, descent)):
                break
            simulation = _rescaled(simulation, spreads)
            descent = self._descended(simulation, descent.values, self.bandwidth, STEPS[1], FINE)
        if descent is None:
            raise InputError(
                f"fit: the simulation of {self.robot.name} does not reach the end of the motion with these numbers;"
                " allowed: numbers nearer to it, or a bandwidth that leads the model along it"
            )
        sizes = [size for run in simulation.runs for size in (run.sizes / run.noise).tolist()]
        sure = certainty(descent.residuals, descent.values, simulation.columns(), np.array(sizes))
        share = float(np.sqrt(descent.residuals.cost / max(_power(simulation), 1e-300)))
        with optional_import("SciPy", "fit needs"):
            from scipy.stats import t as student
        quantile = float(student.ppf(0.5 + confidence / 2.0, sure.freedoms))
        numbers, blind = [], []
        for place, name in enumerate(names):
            value, error = float(descent.values[place]), float(sure.errors[place])
            if np.isfinite(error):
                ends = value - quantile * error, value + quantile * error
                estimate = Estimate(value, error, *ends, float(described[place]), 0.0, share)
                numbers.append(FittedNumber(name, estimate))
            else:
                blind.append(name)
        problems = []
        if not descent.is_converged:
            problems.append(f"{descent.steps} steps did not come to an end; begin with the values that were found")
        if not _is_scaled(_spreads(simulation, descent)):
            problems.append(f"noise and residuals do not become consistent in {SCALINGS} descents")
        warnings = (*self._warnings(numbers, blind, share), *problems)
        notes = (
            *self._notes(simulation, descent, sure),
            *beam_notes(self.robot, {number.name: number.estimate for number in numbers}),
        )
        status = "; ".join(problems) or SOLVED
        return FitResult(self.robot.name, confidence, (), warnings, notes, (), tuple(numbers), status)

    def _descended(
        self, simulation: Simulation, values: Array, bandwidth: float, most: int, small: float, enough: float = 0.0
    ) -> Descent | None:
        """Return the end of a descent with a bandwidth; None where its beginning has no motion."""

        def tell(step: int, error: float) -> None:
            self.progress(f"bandwidth {bandwidth:.3g} rad/s, step {step}: errors {error:.3g} times the noise")

        led = replace(simulation, runs=[run.led(simulation.kernel, bandwidth) for run in simulation.runs])
        least = np.full(values.size, -np.inf)
        lowest = leasts(self.robot, simulation.names)
        for place, name in enumerate(simulation.names):
            least[place] = lowest.get(name, -np.inf)
        return descend(led, values, least, most, small=small, enough=enough, tell=tell)

    def _warnings(self, numbers: Sequence[FittedNumber], blind: Sequence[str], share: float) -> tuple[str, ...]:
        """Say what cannot be seen, and what is doubtful."""
        warnings = []
        if blind:
            warnings.append(f"the motion and its drives do not determine {listed(blind)}, or not one beside another")
        for number in numbers:
            if number.estimate.low <= 0.0 <= number.estimate.high:
                warnings.append(f"{number.name}: its interval holds zero, so the motion does not determine it")
        values = {number.name: number.estimate.value for number in numbers}
        for prefix, law in {x.prefix: x.numbers for x in build_model(self.robot).states}.items():
            found = {name.removeprefix(f"{prefix}."): x for name, x in values.items() if name.startswith(f"{prefix}.")}
            conflict = law_conflict({**law, **found})
            if conflict is not None:
                warnings.append(f"no description takes what was found: {prefix}.{conflict[0]}: {conflict[1]}")
        if share > UNEXPLAINED:
            warnings.append(f"{100 * share:.0f} % of the motion stays unexplained; are the drives known?")
        return tuple(warnings)

    def _notes(self, simulation: Simulation, descent: Descent, sure: Certainty) -> tuple[str, ...]:
        """Say how the fit was made."""
        internal_states, width = simulation.kernel.internal_states, simulation.moving.size
        led = f", led along the motion with {self.bandwidth:g} rad/s" if self.bandwidth else ""
        notes = [
            f"simulated under the drives of the motion, straight lines between samples{led}; positions alone are"
            " compared; states at the beginning are fitted, too"
        ]
        for k in range(len(simulation.runs) if internal_states else 0):
            start = descent.values[len(simulation.names) + k * width :][:width][-len(internal_states) :]
            found = ", ".join(f"{name} {z:.3g}" for name, z in zip(internal_states, start.tolist(), strict=True))
            notes.append(f"internal states at the beginning of {simulation.runs[k].source}: {found}")
        if not sure.is_white:
            notes.append(f"what the simulation leaves is no white noise: intervals come from {BLOCKS} blocks of time")
        return tuple(notes)


def _spreads(simulation: Simulation, descent: Descent) -> Array:
    """Return the rms of residuals over the noise, of each coordinate of each run; 1 where these are round-off."""
    spreads = [np.sqrt(np.mean(descent.residuals.errors[place] ** 2)) for place in simulation.columns()]
    noise = np.concatenate([run.noise / np.maximum(run.sizes, 1e-300) for run in simulation.runs])
    return np.where(noise <= LEAST_NOISE * 1.001, np.maximum(spreads, 1.0), np.maximum(spreads, 1e-6))


def _is_scaled(spreads: Array) -> bool:
    """Return whether residuals are about as large as the noise that they were weighted by."""
    return bool((np.abs(np.log(spreads)) <= SCALED).all())


def _rescaled(simulation: Simulation, spreads: Array) -> Simulation:
    """Return the simulation with what its residuals say of the noise of each coordinate."""
    each = np.split(spreads, np.cumsum([run.places.size for run in simulation.runs])[:-1])
    runs = [run.with_noise(run.noise * spread) for run, spread in zip(simulation.runs, each, strict=True)]
    return replace(simulation, runs=runs)


def _power(simulation: Simulation) -> float:
    """Return the sum of squares of the motions over their noise."""
    return float(sum(len(run.times) * ((run.sizes / run.noise) ** 2).sum() for run in simulation.runs))
