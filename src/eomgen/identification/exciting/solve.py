"""Motions that excite, from the robot to the samples.

limits -> random motions -> noise and sizes -> the best of them, made better by gradients -> ExciteResult
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ...arrays import Array, Index
from ...codegen.kernels.groups import EXCITATION, INVERSE_DYNAMICS
from ...description import RobotLike, as_robot
from ...errors import InputError
from ...kernel.complete import Kernel
from ...limits import LARGEST, SMALLEST, is_usable
from ...motion.exceeding import excess_notes, excesses
from ...names import component_name, joint_of, kind_of, listed, show
from ...pipeline.building import build
from ...progress import StageReport, no_report, tells_at_prompt
from ...robot.coordinates import force_unit_of
from ...robot.model import build_model
from ...robot.value import Robot
from ..dynamics.solve import without_sought
from ..estimating import FIRST, least_samples
from ..identifiable import TERMS, BaseParameters, combinations
from ..relations import tree_relations
from .allowed import Amounts, Limits, RequestedLimits, amounts, limits_of, these
from .constraints import Course, extremes, held_by
from .fourier import waves
from .result import Compared, ExciteResult
from .searching import Search, improved
from .weighted_columns import (
    CONDITION,
    CRITERIA,
    DETERMINANT,
    ExcitationCriterion,
    WeightedColumns,
    criterion_of,
    information,
    singular_values,
)

KERNELS = EXCITATION
RANDOMS = 20  # random motions with which the optimum is compared; searches begin with the best of them
TRIES = 5  # times as many as are drawn where limits leave little
PER_WAVE = 20  # samples of a period of the highest harmonic, at least
MOST_HARMONICS = 50
MOST_NUMBERS = 20_000_000  # of all columns at all samples
NOISE = 0.01  # of the drives' rms in random motions, where nothing is said
USUAL = 0.1  # of a drive's rms: what friction and rotors are expected to take where the description has none
SLOW = 0.05  # of a coordinate's greatest rate: over which Coulomb friction turns round in gradients


@tells_at_prompt("exciting")
def excite(  # noqa: PLR0913
    robot: RobotLike,
    *,
    duration: float = 10.0,
    harmonics: int = 5,
    step: float = 5e-3,
    criterion: ExcitationCriterion = "D",
    terms: Sequence[str] = TERMS,
    ranges: Mapping[str, Sequence[float]] | None = None,
    rates: Amounts | None = None,
    accelerations: Amounts | None = None,
    drives: Amounts | None = None,
    boxes: Mapping[str, ArrayLike] | None = None,
    half_spaces: Sequence[tuple[str, ArrayLike, float]] = (),
    clear_of: Sequence[tuple[str, ArrayLike, float]] = (),
    noise: Amounts | None = None,
    starts: int = 3,
    seed: int = 0,
    kernel: Kernel | None = None,
    progress: StageReport | None = None,
) -> ExciteResult:
    """Return a motion that excites the parameters of a robot, so that ``identify`` finds them as well as limits allow.

    Principal coordinates move along Fourier series that begin and end at rest.  Deviations are 0, links and
    transmissions rigid: what moves is ``robot.rigid()``.  All limits hold along the whole period; drives within theirs
    whichever way Coulomb friction acts.

    Args:
        robot: a Robot, the name of a built-in one, or the path of a description.
        duration: of the period, s.
        harmonics: N of the series; the highest frequency is N / duration.
        step: between samples, s; those of a period are a whole number.
        criterion: "D", the determinant of the information, or "condition", the condition number of the base regressor.
        terms: what is sought, as of ``identify``.
        ranges: ends of coordinates, by the coordinate's or the joint's name, in place of the joints' limits, m or rad.
        rates, accelerations, drives: greatest ones, per s, per s^2, N or N m: one number, or by name.  Rates and drives
            left out are the robot's limits, where it has some.
        boxes: lower and upper corner, (2, 3), by the frame or link whose origin is to stay between them, m, base frame.
        half_spaces: frame, normal and distance d: the frame stays where normal . p >= d, the normal as a unit vector.
        clear_of: frame, point and distance, m: the frame keeps that far from the point.
        noise: standard deviations of drives, N or N m: one number, or by name; the weights of their rows.
        starts: searches, each from another random motion.
        seed: of the random numbers; the same seed, the same motion.
        kernel: of ``moving_robot(robot)`` with KERNELS; built if None.
        progress: called with a line of text when a stage begins.

    Raises:
        InputError: the robot has loops, a free joint or joints without drives, no parameter shows, an option cannot be
            used, or limits leave no room.
        UnknownNameError: there is no coordinate, frame or link of a name.
    """
    robot, report = as_robot(robot), progress or no_report
    samples = _samples(duration, harmonics, step)
    if criterion not in CRITERIA:
        raise InputError(f"criterion: {show(criterion)}; allowed: {', '.join(CRITERIA)}")
    _whole("starts", starts, 1, RANDOMS)
    _whole("seed", seed, 0)
    names = moving_coordinates(robot)
    if kernel is None:
        kernel = build(moving_robot(robot), kernels=KERNELS, progress=report)
    index = np.array([kernel.coordinates.index(name) for name in names], dtype=np.intp)
    requested = RequestedLimits(
        ranges=ranges,
        rates=rates,
        accelerations=accelerations,
        drives=drives,
        boxes=boxes,
        half_spaces=half_spaces,
        clear_of=clear_of,
    )
    limits = limits_of(robot, names, tuple(kernel.frames), requested)
    deviation = amounts("noise", noise, names)
    moving = np.isin(kernel.coordinates, names)
    base = combinations(kernel, terms, moving, moving, tree_relations(moving_robot(robot)))
    base = replace(base, relations=None)  # none of its coordinates follows from others
    if samples * len(names) * len(base) > MOST_NUMBERS:
        most = MOST_NUMBERS // (len(names) * len(base))
        raise InputError(f"step: {step:g} s makes {samples} samples; allowed: {most} of {len(base)} parameters")
    rubbing = _rubbing(robot, limits)
    search = Search(limits, duration, harmonics, held_by(limits, kernel, rubbing), kernel.n, index)
    report("drawing random motions")
    drawn = _drawn(search, np.random.default_rng(seed))
    weighted, notes = _weighted_columns(kernel, base, search, deviation, drawn)
    t = np.asarray(np.arange(samples + 1) * (duration / samples), dtype=np.float64)
    rows = np.asarray(waves(t, duration, harmonics) @ search.combined)

    def singular(x: Array) -> Array:
        return singular_values(weighted.columns(search.course(rows, x)))

    values_of = [singular(x) for x in drawn]
    order = sorted(range(len(drawn)), key=lambda k: criterion_of(criterion, values_of[k]))
    best, start = drawn[order[0]], order[0]
    least, status = criterion_of(criterion, values_of[start]), "no search betters the best random motion"
    for number, k in enumerate(order[:starts], 1):
        report(f"search {number} of {min(starts, len(drawn))}")
        x, ended = improved(search, weighted, criterion, drawn[k])
        value = criterion_of(criterion, singular(x))
        if value < least:
            best, start, least, status = x, k, value, ended
    course, values = search.course(rows, best), singular(best)
    G = information(weighted.columns(course))
    q, v, a = (x[:, index] for x in course)
    u = _drives(robot, kernel, course)[:, index]
    beyond = excesses(robot.rigid(), names, t=t, q=q, v=v, u=u)
    return ExciteResult(
        robot=robot.name,
        series=search.series(best),
        t=t,
        q=q,
        v=v,
        a=a,
        u=u,
        base=base,
        noise=weighted.noise,
        sizes=weighted.sizes,
        deviations=weighted.sizes * np.sqrt(np.diagonal(np.linalg.pinv(G, hermitian=True))),
        criterion=criterion,
        condition=_compared(CONDITION, values, values_of[start], values_of),
        deviation=_compared(DETERMINANT, values, values_of[start], values_of),
        **_limited(search, rubbing, best),
        randoms=len(drawn),
        starts=min(starts, len(drawn)),
        seed=seed,
        status=status,
        notes=(*_about(robot, names), *limits.notes, *notes, *excess_notes("the motion", beyond)),
    )


def moving_robot(robot: Robot) -> Robot:
    """Return the robot whose equations the search takes: rigid, and without Coulomb friction."""
    return without_sought(robot.rigid(), ("dry",))


def moving_coordinates(robot: Robot) -> tuple[str, ...]:
    """Return names of the principal coordinates, each of which needs a drive or a prescribed motion.

    Raises:
        InputError: the robot has loops, couplings, a free joint, none of these coordinates, or one without a drive.
    """
    if robot.loops or robot.own_couplings:
        raise InputError(f"excite: {robot.name} has loops or couplings; allowed: robots without, as of identify")
    free = [joint.name for joint in robot.joints if joint.is_free]
    if free:
        raise InputError(f"excite: {robot.name} moves freely at {listed(free)}; allowed: robots with a fixed base")
    names = tuple(
        component_name(joint.name, joint.principal) for joint in robot.joints if joint.principal in joint.coordinates
    )
    if not names:
        raise InputError(f"excite: {robot.name} has no joint that turns or slides; allowed: robots that have one")
    model = build_model(robot.rigid())
    driven = {model.coordinates[i] for i in (*model.driven, *model.prescribed)}
    loose = [name for name in names if name not in driven]
    if loose:
        raise InputError(f"excite: {listed(loose)} without a drive; allowed: drives at all principal coordinates")
    return names


def _samples(duration: float, harmonics: int, step: float) -> int:
    """Return samples of a period, without its end."""
    for label, value in (("duration", duration), ("step", step)):
        if not (is_usable(value) and value > 0.0):
            raise InputError(f"{label}: {show(value)}; allowed: seconds, from {SMALLEST:g} to {LARGEST:g}")
    _whole("harmonics", harmonics, 2, MOST_HARMONICS)
    samples = round(min(duration / step, 1e12))
    least = max(PER_WAVE * harmonics, least_samples(FIRST))
    if samples < least:
        raise InputError(
            f"step: {step:g} s makes {samples} samples of {duration:g} s, too few for {harmonics} harmonics; allowed:"
            f" at most {duration / least:.4g} s, or fewer harmonics, or a longer duration"
        )
    if samples > MOST_NUMBERS:
        raise InputError(f"step: {step:g} s makes {samples} samples; allowed: up to {MOST_NUMBERS}")
    return samples


def _whole(label: str, value: Any, least: int, most: int | None = None) -> None:
    if isinstance(value, bool) or not isinstance(value, int) or value < least or (most is not None and value > most):
        span = f"from {least} on" if most is None else f"{least} to {most}"
        raise InputError(f"{label}: {show(value)}; allowed: a whole number {span}")


def _rubbing(robot: Robot, limits: Limits) -> Array:
    """Return Coulomb friction of the coordinates that move, at most, (m,), N or N m.

    Raises:
        InputError: a drive's limit is no more than that.
    """
    rigid, coulomb = robot.rigid(), np.zeros(len(limits.names))
    for i, name in enumerate(limits.names):
        friction = rigid.joint(joint_of(name)).coordinates[kind_of(name)].friction
        if friction is not None:
            coulomb[i] = max(friction.coulomb, friction.static or 0.0)
        if coulomb[i] >= limits.drives[i]:
            unit = force_unit_of(name)
            raise InputError(
                f"drives: {name}: {limits.drives[i]:g} {unit}; allowed: more than its Coulomb friction,"
                f" {coulomb[i]:g} {unit}"
            )
    return coulomb


def _drawn(search: Search, rng: np.random.Generator) -> list[Array]:
    """Return random motions within limits."""
    poses, draws = search.poses(rng), list[Array]()
    for _ in range(TRIES * RANDOMS):
        x = search.random(rng, poses)
        if x is not None:
            draws.append(x)
        if len(draws) == RANDOMS:
            break
    if not draws:
        raise InputError("limits: no motion about a random pose is within all of them; allowed: limits that leave room")
    return draws


def _weighted_columns(
    kernel: Kernel, base: BaseParameters, search: Search, noise: Array, drawn: Sequence[Array]
) -> tuple[WeightedColumns, list[str]]:
    """Return weighted, with noise and sizes from random motions where nothing is said; notes about that."""
    whole = [search.course(search.coarse, x) for x in drawn]
    forces = _rms([np.asarray(kernel.inverse_dynamics(*course)) for course in whole], search.index)
    speeds, slopes = (_rms([course[order] for course in whole], search.index) for order in (1, 2))
    forces = np.maximum(forces, 1e-3 * forces.max()) if forces.any() else np.ones_like(forces)
    open_ones = np.isinf(noise)
    deviation = np.where(open_ones, NOISE * forces, noise)
    unknown = np.flatnonzero(open_ones).tolist()
    about = these(search.limits.names, unknown)
    notes = [f"noise of the drives of {about} is assumed: {NOISE:.0%} of their rms in random motions"]
    sizes = _sizes(kernel, base, dict(zip(search.limits.names, zip(forces, speeds, slopes, strict=True), strict=True)))
    turning = SLOW * search.limits.rates
    return WeightedColumns(kernel, base, search.index, deviation, sizes, turning), notes if unknown else []


def _rms(values: Sequence[Array], index: Index) -> Array:
    """Return the median over motions of the rms over time, (m,)."""
    return np.asarray(np.median([np.sqrt((x[:, index] ** 2).mean(axis=0)) for x in values], axis=0))


def _sizes(kernel: Kernel, base: BaseParameters, scales: Mapping[str, tuple[float, float, float]]) -> Array:
    """Return sizes that are expected of the combinations, (b,), from the description and the drives of random motions.

    Args:
        kernel: with the regressor.
        base: the combinations.
        scales: rms of drive, velocity and acceleration by coordinate.
    """
    links = 10 * len(kernel.joints)
    bodies = np.abs(kernel.regressor_values[:links]).reshape(-1, 10)
    mass = np.where(bodies[:, 0] > 0.0, bodies[:, 0], (bodies[:, 0].mean() or 1e-3) if links else 0.0)
    square = bodies[:, [4, 7, 9]].sum(axis=1) / 2.0 / mass  # mean of the squared distance from the frame's origin
    square = np.maximum(square, 1e-3 * square.max(initial=0.0) or 1e-6)
    spread = np.repeat(np.stack([mass, mass * np.sqrt(square), mass * square], axis=1), (1, 3, 6), axis=1).ravel()
    by_name = dict(zip(kernel.regressor_names, spread.tolist(), strict=False))
    rotors = dict(zip(kernel.regressor_names[links:], kernel.regressor_values[links:].tolist(), strict=True))
    for name, (force, rate, acceleration) in scales.items():
        usual = USUAL * force
        by_name |= {component_name(name, "viscous"): usual / max(rate, 1e-9)}
        by_name |= dict.fromkeys((component_name(name, "dry"), component_name(name, "offset")), usual)
        rotor = component_name(name, "armature")
        if rotor in rotors:
            by_name[rotor] = rotors[rotor] or usual / max(acceleration, 1e-9)
    least = min(by_name.values())
    sizes = np.array([by_name.get(name) or rotors.get(name) or least for name in base.parameters])
    return np.asarray(np.sqrt(base.matrix**2 @ sizes**2))


def _compared(kind: str, best: Array, start: Array, randoms: Sequence[Array]) -> Compared:
    """Return a figure of the motion, of its start, and the median of random ones, from their singular values."""
    optimum, begun = (float(np.exp(criterion_of(kind, x))) for x in (best, start))
    return Compared(optimum, begun, float(np.exp(np.median([criterion_of(kind, x) for x in randoms]))))


def _limited(search: Search, rubbing: Array, x: Array) -> dict[str, Any]:
    """Return limits by name, and what the motion reaches.

    Drives with the Coulomb friction that they may have to overcome.
    """
    course, limits, reached = search.course(search.fine, x), list[Array](), list[Array]()
    friction = {f"{name} drive": force for name, force in zip(search.limits.names, rubbing.tolist(), strict=True)}
    names, units = list[str](), list[str]()
    for held in search.held:
        more = np.array([friction.get(name, 0.0) for name in held.names])
        least, greatest = extremes(held, course)
        limits.append(np.stack([held.low - more, held.high + more], axis=1))
        reached.append(np.stack([least - more, greatest + more], axis=1))
        names += held.names
        units += held.units
    return {
        "limited": tuple(names),
        "units": tuple(units),
        "limits": np.concatenate(limits),
        "extremes": np.concatenate(reached),
    }


def _drives(robot: Robot, kernel: Kernel, course: Course) -> Array:
    """Return drives of a motion, Coulomb friction included, (T, n)."""
    rigid = replace(robot.rigid(), tunable=())
    if rigid == replace(moving_robot(robot), tunable=()):
        return np.asarray(kernel.inverse_dynamics(*course))
    return np.asarray(build(rigid, kernels=INVERSE_DYNAMICS).inverse_dynamics(*course))


def _about(robot: Robot, names: tuple[str, ...]) -> list[str]:
    """Return notes about what does not move."""
    if set(build_model(robot).coordinates) == set(names):
        return []
    motors = [joint.name for joint in robot.joints if joint.motor is not None]
    held = "principal coordinates move, all others are 0" + ("; links do not bend" if robot.modal_coordinates else "")
    return [held + (f"; transmissions are rigid, drives are the joints': {listed(motors)}" if motors else "")]
