"""Integration of a scenario in pieces, between the times at which something sets in, jumps or ends.

No step of an integrator crosses such a time, and none is missed.  For the energy balance C computes work integrals
along with a piece; where Python integrates, the trajectory is sampled at the nodes of a quadrature, too.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any

import numpy as np

from ..arrays import Array
from ..errors import EomgenError, IntegrationStopped
from ..integration.contacts import Contact
from ..integration.plan import IntegratorPlan
from ..integration.reference_motions import GlobalError, ReferenceMotions, error_of
from ..integration.resting import rests
from ..integration.solve import integrate_by, system_of
from ..integration.steps import Record, output_times
from ..integration.system import System
from ..integration.trajectory import Trajectory
from ..integration.until import Until
from ..kernel.complete import Kernel
from ..kernel.stepping.reading_inputs import signals_of
from ..progress import Progress
from ..robot.value import Robot
from ..runtime.internal_states import cut_apart
from ..scenario.value import Scenario
from ..state.vectors import MotionFunction
from .balance import SUBINTERVALS, TERMS, EnergyBalance, integrated, with_nodes, works
from .contents import ARRAYS
from .loads import loaded_parameters
from .stream import MotionStream

Function = Callable[[float, Array, Array], Array]

ERRORS = ("q_error", "v_error")  # of samples
GREATEST = ("gap", "gap_rate", "redundant", "friction_smoothing")  # numbers of ``info`` that do not add up
SHARPNESS = 1e-9  # of the duration: how far from a time that separates two pieces both are told apart
MOST_KNOTS = 200  # of a table without jumps at which a piece ends; of more, some


@dataclass(frozen=True)
class Loads:
    """Loads of a motion: drives and wrenches (t, q, v) -> (n,), (links, 6), and the motion of prescribed coordinates.

    ends: times at which the drives' reference may jump, s.
    """

    drive: Function
    wrench: Function | None
    prescribed: MotionFunction | None
    ends: tuple[float, ...] = ()


@dataclass(frozen=True)
class SegmentOptions:
    """Options of the integration of a motion's pieces, all of them by one method.

    progress: called with a fraction from 0 to 1 and a line of text.  stream: gets the samples.  balance: whether the
    motion is sampled for that, too.  until: terminal event, if any.  references: of the
    motion, where its global error is estimated.
    """

    plan: IntegratorPlan
    progress: Progress
    stream: MotionStream | None = None
    balance: bool = True
    until: Until | None = None
    references: ReferenceMotions | None = None


@dataclass(frozen=True)
class SegmentedMotion:
    """A trajectory, its energy balance, and the wrenches, (T, links, 6), or None without any.

    ``stop`` says why it ends before the duration does, if it does.  ``global_error`` is there where it was asked for.
    """

    trajectory: Trajectory
    balance: EnergyBalance | None
    wrench: Array | None
    stop: IntegrationStopped | None = None
    global_error: GlobalError | None = None


@dataclass(frozen=True)
class _Between:
    """A function of time and state whose times are clamped between two bounds, so that it does not see a jump there.

    Its time-signal input is that of the function.
    """

    function: Function
    first: float
    last: float
    batched: bool = field(default=False)

    def __call__(self, t: float, q: Array, v: Array) -> Array:
        return self.function(min(max(t, self.first), self.last), q, v)

    def load_data(self) -> Any:
        """Return the function's time-signal input for integrations in C; None where only Python knows it."""
        return signals_of(self.function)


def run_segments(
    kernel: Kernel, robot: Robot, scenario: Scenario, loads: Loads, q: Array, v: Array, options: SegmentOptions
) -> SegmentedMotion:
    """Integrate from q and v at t = 0 to the scenario's duration; errors as ``integrate``.

    All pieces are integrated by the one plan.

    A motion that cannot go on is returned as far as whole output steps were reached; it is raised where there are none.
    """
    grid, stream = output_times(scenario.duration, scenario.output_step), options.stream
    record = None if stream is None else _recorder(kernel, loads, grid, stream)
    if stream is not None:
        stream.append(grid[:1], q[np.newaxis], *cut_apart(v[np.newaxis], kernel.n))
    pieces: list[dict[str, Array]] = []
    done = np.zeros(len(TERMS))
    info: dict[str, float] = {}
    energy: float | None = None
    contacts: list[Contact] = []
    stop: IntegrationStopped | None = None
    for begin, end in pairwise(bounds(scenario, loads, grid)):
        kernel.parameters.update(loaded_parameters(robot, scenario, begin))
        try:
            piece, motion, stop = _piece(kernel, scenario, loads, (q, v), (begin, end), grid, record, options)
        except EomgenError as error:
            if stream is not None:
                stream.flush()  # nothing is lost
            if not (isinstance(error, IntegrationStopped) and pieces):
                raise
            stop = error
            break
        if energy is not None and scenario.payloads:
            velocities, z = cut_apart(v, kernel.n) if kernel.internal_states else (v, None)
            done[TERMS.index("payloads")] += float(kernel.energy(q, velocities, z=z).sum()) - energy
        piece["work"] = np.concatenate([[done], done + np.cumsum(piece["work"], axis=0)])
        done = piece["work"][-1].copy()
        q, v, energy = motion.q[-1].copy(), motion.v[-1].copy(), float(motion.energy[-1].sum())
        keep = np.isin(piece["t"], grid)
        ended = "ended_at" in motion.info
        last = end == scenario.duration or stop is not None or ended  # else the next piece begins with this sample
        keep[-1] = last and (keep[-1] or ended)
        pieces.append({name: values[keep] for name, values in piece.items()})
        info = joined_info(info, motion.info)
        contacts += motion.contacts
        if stop is not None or ended:
            break
    if stream is not None:
        stream.flush()
    whole: dict[str, Any] = {name: np.concatenate([piece[name] for piece in pieces]) for name in pieces[0]}
    if stop is not None:
        whole = _good_rows(whole)
    work, wrench = whole.pop("work"), whole.pop("wrench", None)
    estimate = None
    if options.references is not None:
        estimate = error_of(kernel, np.hstack([whole.pop(name) for name in ERRORS]), options.references)
    sticking = rests(kernel, whole["t"], whole["q"], *cut_apart(whole["v"], kernel.n))
    taken = options.plan.leading(info, float(whole["t"][-1]))
    about: dict[str, Any] = {"method": taken, "info": info, "contacts": tuple(contacts), "rests": sticking}
    trajectory = Trajectory(**whole, coordinates=kernel.coordinates, **about)
    return SegmentedMotion(
        trajectory, EnergyBalance(work, trajectory.energy) if options.balance else None, wrench, stop, estimate
    )


def joined_info(before: Mapping[str, float], piece: Mapping[str, float]) -> dict[str, float]:
    """Return a trajectory's ``info`` over two pieces: of ``margin`` the least, with its time."""
    joined = {
        key: max(before.get(key, 0), x) if key in GREATEST else before.get(key, 0) + x for key, x in piece.items()
    }
    if "margin" in piece:
        nearest = min((each for each in (before, piece) if "margin" in each), key=lambda each: each["margin"])
        joined |= {key: nearest[key] for key in ("margin", "margin_at")}
    return joined


def _good_rows(whole: dict[str, Array]) -> dict[str, Array]:
    """Return the rows before the first with a number that results do not take: the motion has diverged there."""
    largest = {item.name: item.largest for item in ARRAYS}
    good = np.ones(len(whole["t"]), dtype=bool)
    for name, values in whole.items():
        good &= (np.abs(values) <= largest[name]).reshape(good.size, -1).all(axis=1)
    count = good.size if good.all() else max(int(good.argmin()), 1)
    return {name: values[:count] for name, values in whole.items()}


def _recorder(kernel: Kernel, loads: Loads, grid: Array, stream: MotionStream) -> Record:
    """Return a function that passes the samples of the grid on, prescribed coordinates as they are prescribed."""
    prescribed = [kernel.coordinates.index(name) for name in kernel.prescribed]

    def record(times: Array, states: Array) -> None:
        chosen = grid[np.minimum(np.searchsorted(grid, times), grid.size - 1)] == times
        t, q, v = times[chosen], states[chosen, : kernel.n].copy(), states[chosen, kernel.n :].copy()
        if loads.prescribed is not None:
            for i, at in enumerate(t.tolist()):
                q[i, prescribed], v[i, prescribed], _ = loads.prescribed(at)
        if t.size:
            stream.append(t, q, *cut_apart(v, kernel.n))

    return record


def _piece(
    kernel: Kernel,
    scenario: Scenario,
    loads: Loads,
    state: tuple[Array, Array],
    span: tuple[float, float],
    grid: Array,
    record: Record | None,
    how: SegmentOptions,
) -> tuple[dict[str, Array], Trajectory, IntegrationStopped | None]:
    """Integrate a piece: samples at its ends and on the grid between, work from each to the next, and what stopped it.

    Raises:
        IntegrationStopped: not even the first sample is there.
    """
    begin, end = span
    edges = piece_times(span, grid)
    along = how.balance and not how.plan.no_works(kernel)
    times, apart = (with_nodes(edges), SUBINTERVALS) if how.balance and not along else (edges, 1)
    drive, wrench = between(loads, scenario, begin, end)
    stop: IntegrationStopped | None = None

    def report(fraction: float, text: str) -> None:
        how.progress(fraction * end / scenario.duration, text)

    def begin_system() -> System:
        return system_of(kernel, drive, wrench, loads.prescribed)

    def moved(state: tuple[Array, Array], times: Array, **ending: Any) -> Trajectory:
        start = state[0].copy(), state[1].copy()
        return integrate_by(how.plan, begin_system(), start, times, progress=report, works=along, **ending)

    try:
        motion = moved(state, times, record=record, until=how.until)
        if "ended_at" in motion.info:
            motion, edges = (motion, motion.t) if apart == 1 else _to_the_end(moved, motion, edges)
            times = motion.t
    except IntegrationStopped as error:
        if error.trajectory is None:
            raise
        stop, good = error, error.trajectory
        reached = int((good.t == times[: good.t.size]).sum())  # the last good state comes behind them
        edges = edges[: (reached - 1) // apart + 1]
        times = times[: apart * (edges.size - 1) + 1]
        names = ("t", "q", "v", "u", "energy", *(("works",) if along else ()))
        motion = replace(good, **{name: getattr(good, name)[: times.size] for name in names})
    wrenches = None
    if wrench is not None:
        wrenches = np.array(
            [wrench(t, x, y[: kernel.n]) for t, x, y in zip(times.tolist(), motion.q, motion.v, strict=True)]
        )
    samples = {name: getattr(motion, name)[::apart] for name in ("t", "q", "v", "u", "energy")}
    samples["t"] = edges
    if wrenches is not None:
        samples["wrench"] = wrenches[::apart]
    if motion.works is not None:
        samples["work"] = np.diff(integrated(motion.works), axis=0)
    elif how.balance:
        samples["work"] = works(kernel, times, motion.q, motion.v, motion.u, wrenches)
    else:
        samples["work"] = np.zeros((edges.size - 1, len(TERMS)))
    if how.references is not None:
        errors = how.references.extend(begin_system, edges, np.hstack([samples["q"], samples["v"]]))
        samples |= dict(zip(ERRORS, np.split(errors, [kernel.n], axis=1), strict=True))
    return samples, motion, stop


def piece_times(span: tuple[float, float], grid: Array) -> Array:
    """Return the ends of a piece and the times of the grid in between, s."""
    begin, end = span
    return np.concatenate([[begin], grid[(grid > begin) & (grid < end)], [end]])


def between(loads: Loads, scenario: Scenario, begin: float, end: float) -> tuple[Function, Function | None]:
    """Return drives and wrenches of a piece, which do not see what jumps at its ends."""
    sharp = SHARPNESS * scenario.duration
    inside = (begin + sharp if begin > 0.0 else begin, end - sharp if end < scenario.duration else end)
    wrench = None if loads.wrench is None else _Between(loads.wrench, *inside)
    return _Between(loads.drive, *inside, batched=True), wrench


def _to_the_end(moved: Callable[..., Trajectory], motion: Trajectory, edges: Array) -> tuple[Trajectory, Array]:
    """Complete a piece that ended between two edges by samples for its balance; return motion and edges.

    Args:
        moved: integrates from a state, q and v, over times.
        motion: the piece.
        edges: its ends and the times of the grid in between, s.
    """
    at = float(motion.info["ended_at"])
    whole = int(np.searchsorted(edges, at))  # edges before the end, the first one at least
    first = SUBINTERVALS * (whole - 1)
    edges = np.append(edges[:whole], at)
    last = moved((motion.q[first], motion.v[first]), with_nodes(edges[-2:]))
    names = ("t", "q", "v", "u", "energy")
    rows: dict[str, Any] = {
        name: np.concatenate([getattr(motion, name)[:first], getattr(last, name)]) for name in names
    }
    return replace(motion, **rows), edges


def bounds(scenario: Scenario, loads: Loads, grid: Array) -> list[float]:
    """Return times between the pieces, with 0 and the duration; those beside a time of the grid are put on it."""
    inner = list(loads.ends)
    spans = [(load.t0, load.t1) for load in scenario.wrenches] + [(load.t0, load.t1) for load in scenario.payloads]
    inner += [t for span in spans for t in span if t is not None]
    tables = [wrench.table for wrench in scenario.wrenches]
    if scenario.control is not None and scenario.control.type == "torque":
        tables.append(scenario.control.get("table"))
    for table in tables:
        thinned = 1 if table.hold else -(-table.t.size // MOST_KNOTS)
        inner += table.t[::thinned].tolist()
    bounds = [0.0]
    for t in sorted(inner):
        near = float(grid[np.abs(grid - t).argmin()])
        t = near if abs(near - t) <= 10.0 * SHARPNESS * scenario.duration else t
        if bounds[-1] + 10.0 * SHARPNESS * scenario.duration < t < scenario.duration:
            bounds.append(t)
    return [*bounds, scenario.duration]
