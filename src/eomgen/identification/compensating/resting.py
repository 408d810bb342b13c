"""Corrections in static equilibrium: at each sample the drives hold the tool where the rigid one's would be."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ...arrays import Array
from ...errors import IntegrationError
from ...motion.splines import Spline
from ...progress import Progress
from ...robot.coordinates import index_of
from ...simulation.assembly import names_in_scenarios
from ...simulation.initial import initial_state
from ...simulation.loads import loaded_parameters
from ...state.equilibrium import static_equilibrium
from .bounds import within_limits
from .reach import Reach, in_tool_axes, tool_error
from .setting import Setting, places_of

MOST_PLACES = 250  # of the path that are looked at; a spline leads from each to the next
ROUNDS = 12
CHANGE = 1e-6  # m or rad, of differences
EXACT = 1e-10  # m, weighted


@dataclass(frozen=True, eq=False)
class _Still:
    """Reference held at one sample, with its velocities and accelerations there; (m,) each."""

    start: Array
    v: Array
    a: Array

    def at(self, t: ArrayLike) -> tuple[Array, Array, Array]:
        """Return coordinates, velocities and accelerations; see ``Program``."""
        del t
        return self.start, self.v, self.a


def at_rest(setting: Setting, accelerations: bool, report: Progress) -> tuple[Array, Array]:
    """Return corrections of the reference's samples, and those that they were without limits, (T, m) each.

    Args:
        setting: the task.
        accelerations: whether inertia forces along the reference bend the robot, too, as if they were loads at rest.
        report: told how far it has come.

    Raises:
        IntegrationError: there is no static equilibrium at a sample; says when.
    """
    stride = -(-(setting.t.size - 1) // MOST_PLACES)
    chosen = np.unique(np.append(np.arange(0, setting.t.size, stride), setting.t.size - 1))
    states = _States(setting, accelerations)
    corrections = np.zeros((2, chosen.size, len(setting.index)))
    guess, change = states.q0, np.zeros(len(setting.index))
    for k, i in enumerate(chosen.tolist()):
        report(k / chosen.size, f"static equilibria, {setting.t[i]:.3g} s")
        change, wanted, guess = states.corrected(i, change, guess)
        corrections[:, k] = change, wanted
    taken, wanted = (Spline(setting.t[chosen], x, at_rest=False).at(setting.t)[0] for x in corrections)
    return within_limits(setting, taken), wanted


class _States:
    """Static equilibria of a task."""

    def __init__(self, setting: Setting, accelerations: bool) -> None:
        self._setting, self._accelerations = setting, accelerations
        assembly, scenario = setting.assembly, setting.scenario
        kernel = assembly.kernel
        n = len(kernel.coordinates)
        q0, v0, loose = initial_state(setting.robot, scenario, assembly)
        self.q0, self._z = q0[:n], v0[n:] if kernel.internal_states else None  # internal states stay
        places = names_in_scenarios(setting.robot)
        held = scenario.initial.held if scenario.initial else ()
        self._held = sorted({*loose, *(places[name] for name in held)})
        self._free = np.array([name not in {*self._held, *kernel.prescribed} for name in kernel.coordinates])
        self._given = index_of(kernel.coordinates, kernel.prescribed)

    def corrected(self, i: int, change: Array, guess: Array) -> tuple[Array, Array, Array]:
        """Return the correction of sample i, what it were without limits, (m,) each, and its static equilibrium, (n,).

        Args:
            i: of the reference's samples.
            change: where the correction is looked for, (m,).
            guess: a static equilibrium that is near, (n,).
        """
        setting = self._setting
        t = float(setting.t[i])
        best: tuple[float, Array, Array, Array] | None = None
        for _ in range(ROUNDS):
            taken = self._taken(i, change)
            try:
                guess, slopes = self._rest(i, taken, guess)
            except IntegrationError as error:
                raise IntegrationError(f"{error}; at t = {t:.4g} s of the program") from None
            reach = Reach(slopes[np.newaxis], setting.weights)
            error_here = self._error(i, guess)
            left = float(np.linalg.norm(reach.reached(error_here)))
            if best is not None and left >= 0.99 * best[0]:
                break
            step = reach.undoing(error_here)[0]
            best = (left, taken, taken + step, guess)
            if left <= EXACT:
                break
            guess, change = guess.copy(), taken + step
            places, ratios = places_of(setting.assembly.kernel, setting)
            guess[places[:, 0]] += ratios * step[places[:, 1]]
        assert best is not None
        return best[1:]

    def _taken(self, i: int, change: Array) -> Array:
        """Return as much of a correction as keeps limits of place."""
        setting = self._setting
        here = replace(setting, original=setting.original[i : i + 1], rates=np.full_like(setting.rates, np.inf))
        return np.asarray(within_limits(here, change[np.newaxis])[0])

    def _error(self, i: int, q: Array) -> Array:
        setting = self._setting
        pose = np.asarray(setting.assembly.kernel.frame_pose(q, setting.frame))
        return tool_error(setting.want[2 * i : 2 * i + 1], pose[np.newaxis])

    def _rest(self, i: int, change: Array, guess: Array) -> tuple[Array, Array]:
        """Return the static equilibrium of a corrected sample, (n,), and the tool's motion by it, (6, m)."""
        setting, t = self._setting, float(self._setting.t[i])
        kernel = setting.assembly.kernel
        kernel.parameters.update(loaded_parameters(setting.robot, setting.scenario, t))
        q, v, a = self._moving(i, guess)
        places, ratios = places_of(kernel, setting)
        led = ~self._free[places[:, 0]]  # which nothing holds, in clearance say: they go with the reference
        q[places[led, 0]] = (ratios * (setting.original[i] + change)[places[:, 1]])[led]

        def drives(correction: Array) -> Any:
            return self._forces(i, correction, v, a)

        q = static_equilibrium(kernel, q, u=drives(change), fixed=self._held, z=self._z)[0]
        free, zero = np.flatnonzero(self._free), np.zeros_like(q)
        states = np.tile(q, (free.size + 1, 1))
        states[np.arange(1, free.size + 1), free] += CHANGE
        left = np.asarray(kernel.inverse_dynamics(states, zero, zero, cut=True, z=self._z)) - drives(change)(states)
        stiffness = (left[1:] - left[0])[:, free].T / CHANGE
        by_program = np.empty((free.size, change.size))
        for j in range(change.size):
            moved = change.copy()
            moved[j] += CHANGE
            by_program[:, j] = (drives(moved)(q) - drives(change)(q))[free] / CHANGE
        moves = np.zeros((len(kernel.coordinates), change.size))
        moves[places[led, 0], places[led, 1]] = ratios[led]
        moves[free] = np.linalg.solve(stiffness, by_program)
        slopes = (np.asarray(kernel.frame_jacobian(q, setting.frame)) @ moves)[np.newaxis] * setting.movable
        return q, in_tool_axes(slopes, setting.want[2 * i : 2 * i + 1])[0]

    def _moving(self, i: int, guess: Array) -> tuple[Array, Array, Array]:
        """Return the state at sample i with its prescribed coordinates.

        With inertia forces it has the velocities and accelerations of the reference.
        """
        setting, t = self._setting, float(self._setting.t[i])
        assembly = setting.assembly
        q, v, a = guess.copy(), np.zeros_like(guess), np.zeros_like(guess)
        if assembly.prescribed is not None:
            q[self._given], rates, accelerations = assembly.prescribed(t)
            if self._accelerations:
                v[self._given], a[self._given] = rates, accelerations
        if self._accelerations:
            assert assembly.program is not None
            _, rates, accelerations = assembly.program.at(t)
            places, ratios = places_of(assembly.kernel, setting)
            v[places[:, 0]], a[places[:, 0]] = (ratios * x[places[:, 1]] for x in (rates, accelerations))
        return q, v, a

    def _forces(self, i: int, change: Array, v: Array, a: Array) -> Any:
        """Return forces that act at sample i with a correction, less what accelerates the masses.

        They are a function of q, (n,) or (N, n).
        """
        setting, t = self._setting, float(self._setting.t[i])
        assembly, kernel = setting.assembly, setting.assembly.kernel
        v_m, a_m = v[setting.index], a[setting.index]
        drive: Any = replace(assembly.drive, motion=_Still(setting.original[i] + change, v_m, a_m))  # type: ignore[type-var]
        if not self._accelerations:
            drive = drive.standstill()
        zero = np.zeros_like(v)

        def forces(q: Array) -> Array:
            u = drive(t, q, np.broadcast_to(v, q.shape))
            if self._accelerations:
                pairs = ((v, a), (zero, zero))
                moving, still = (kernel.inverse_dynamics(q, x, y, cut=True, z=self._z) for x, y in pairs)
                u = u - (np.asarray(moving) - np.asarray(still))
            if assembly.wrenches is None:
                return np.asarray(u)
            if q.ndim == 1:
                return np.asarray(u + kernel.functions.external_force(q, assembly.wrenches(t, q, zero)))
            return np.asarray(
                u + kernel.functions.external_force(q, np.array([assembly.wrenches(t, x, zero) for x in q]))
            )

        return forces
