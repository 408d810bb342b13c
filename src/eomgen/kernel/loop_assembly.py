"""Loops of a mechanism: their constraint, assembly and projection of velocities, for one state or many at once."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError, LoopError, UnknownNameError
from ..identifiers import parameter_path
from ..names import joint_of, kind_of, listed, parameter_name, show
from ..runtime.arrays import joint_lead, names_in, place_of
from ..runtime.calls import Calls
from ..runtime.loop_errors import left_open
from ..runtime.raw import Array
from .functions import KernelWithMethods
from .kernel_methods import KernelFunctions
from .turning import BACK, ON, Places, seen, singular_joints

Mask = NDArray[np.bool_]
Place = Callable[[int], str]  # names the state of that number

CLOSED = {8: 1e-12, 4: 2e-6}  # m, or sine of an angle, by the bytes of a number: a constraint that is met
OPEN = {8: 1e-9, 4: 1e-5}  # m or rad per second and the largest rate: more is not round-off
STEP = 0.5  # m or rad, the longest step towards closure
ROUNDS = 300
RANK = {8: 1e-7, 4: 1e-3}  # singular values below this fraction of the greatest one belong to redundant constraints
GUESSES = 40  # random ones for every root that is asked for
REACH = 0.5  # m, at least: how far from the guess lengths are tried
MOST_ROOTS = 1000  # of each some guesses are tried
CHANGED = 0.01  # of a violation: what changes it by less does not keep it open
SAME = 1e-6  # m or rad: roots that differ by less are one


class LoopClosure(KernelWithMethods):
    """The constraint of closed loops, and states that meet it."""

    def loop_coordinates(self, q: ArrayLike) -> Array:
        """Return coordinates of loop joints, (loops, 6): x, y, z (m), alpha, beta, gamma (rad) as of other joints.

        They are those of frame b on a loop's second link, seen from frame a on its first, where the angles turn about
        x, then y, then z; zero in what the joint blocks, where the loops are closed.
        """
        poses = self.functions.cut_poses(q)
        R = poses[..., :3, :3]
        angles = (
            np.arctan2(-R[..., 1, 2], R[..., 2, 2]),
            np.arctan2(R[..., 0, 2], np.hypot(R[..., 0, 0], R[..., 0, 1])),
            np.arctan2(-R[..., 0, 1], R[..., 0, 0]),
        )
        return np.concatenate([poses[..., :3, 3], np.stack(angles, axis=-1)], axis=-1)

    def assemble(self, q: ArrayLike, fixed: Iterable[str] = (), *, roots: int | None = None) -> Array:
        """Assemble: return coordinates near a guess that close all loops, (n,), by the Levenberg-Marquardt method.

        Args:
            q: the guess, (n,), or many of them.
            fixed: names of coordinates that stay at their guess; prescribed ones do.
            roots: find so many ways to close the loops, or as many as there are, from random guesses about this one
                (always the same): (roots, n), the nearest first, angles within half a turn of the guess.  Where fewer
                coordinates are held than the mechanism has freedoms, they are any of infinitely many.

        Raises:
            LoopError: they do not close near the guess, or only turned over; names the loop and its violation.
            UnknownNameError: a held coordinate is none.
            InputError: the robot has no loops, or roots of many states are asked for.
        """
        calls = self.calls
        if roots is not None:
            return _roots(calls, q, fixed, roots)
        guesses, lead = calls.array("q", q, (calls.n,))
        closed, violations = _closed(calls, guesses.reshape(-1, calls.n), free_coordinates(calls, fixed))
        _refuse_violations(calls, closed, violations, lead)
        _refuse_turned_over(calls, closed, lead)
        return closed.reshape(guesses.shape)

    def project_velocity(self, q: ArrayLike, v: ArrayLike, fixed: Iterable[str] = ()) -> Array:
        """Project velocities: return those that keep loops closed, (n,), with least kinetic energy of the change.

        That is what a sudden closing of the loops makes of the guess, too.

        Args:
            q: coordinates that close the loops, (n,).
            v: the guess, (n,).
            fixed: names of coordinates whose rates stay; those of prescribed ones do.

        Raises:
            LoopError: the loops are open at q, or the rates that are held open one; names it and what remains.
            SingularError: M is not positive definite, or angles at +-pi/2 have no such rates.
            UnknownNameError, InputError: as of ``assemble``.
        """
        calls = self.calls
        n, free = calls.n, free_coordinates(calls, fixed)
        states, of_q = calls.array("q", q, (n,))
        guesses, of_v = calls.array("v", v, (n,))
        lead = joint_lead("v", of_v, of_q)
        states, moving = (np.broadcast_to(x, (*lead, n)).reshape(-1, n).copy() for x in (states, guesses))
        violations = calls.run(KernelFunctions.constraint, None, (states,))
        _refuse(
            calls, violations, OPEN[calls.dtype.itemsize], "is open", "q of kernel.assemble", lambda i: _place(i, lead)
        )
        for group in _chart_groups(calls, states, free):
            place = group.place(lead)
            turned, guess = group.turned(states[group.rows], moving[group.rows])
            velocities = closed_rates(group.calls, turned, guess, free, place)
            moving[group.rows] = group.described(turned, velocities, states[group.rows], place)[1]
        return np.asarray(moving.reshape(*lead, n))


def closed_near(calls: Calls, guess: Array, free: Mask) -> Array | None:
    """Return coordinates near a guess, (n,), that close all loops the right way round; None where there are none.

    Args:
        calls: of a robot with loops.
        guess: (n,), of the kernel's dtype.
        free: which coordinates may change, (n,).
    """
    states, gaps = _closed(calls, guess[np.newaxis], free)
    closed = np.abs(gaps).max() <= CLOSED[calls.dtype.itemsize] and (_turned_over(calls, states) < 0).all()
    return states[0] if closed else None


def tangent_directions(calls: Calls, q: Array, weights: Array) -> Array:
    """Return orthonormal y, (n, k), such that velocities ``weights * y`` keep the loops closed at q, (n,).

    Args:
        calls: of a robot with loops.
        weights: (n,); 0 where a coordinate stays.
    """
    _, S, Vt = np.linalg.svd(calls.run(KernelFunctions.constraint_jacobian, None, (q,)) * weights)
    rank = int(np.count_nonzero(RANK[calls.dtype.itemsize] * S.max(initial=0.0) < S))
    return np.asarray(Vt[rank:].T)


def closed_rates(calls: Calls, states: Array, moving: Array, free: Mask, place: Place, rest: ArrayLike = 0.0) -> Array:
    """Return rates near guesses, (N, n), that keep the loops closed; both in the coordinates that these calls know.

    Args:
        rest: of time derivatives of higher order what the constraint's has beside J times them, (N, m).
    """
    bits, moving = calls.dtype.itemsize, moving.copy()
    J = calls.run(KernelFunctions.constraint_jacobian, None, (states,))
    if free.any():
        back, scaled = _scaled(calls, states, J, free, place)
        pseudo = np.linalg.pinv(scaled, rcond=RANK[bits])
        for _ in range(2):  # the second time for round-off
            rates = np.einsum("kmn,kn->km", J, moving) + rest
            moving[:, free] -= np.einsum("kij,kjm,km->ki", back, pseudo, rates)
    rates = np.einsum("kmn,kn->km", J, moving) + rest
    size = np.maximum(1.0, np.abs(J).max(axis=(1, 2)) * np.abs(moving).max(axis=1) + np.abs(rest).max(initial=0.0))
    what, allowed = "opens at the rates that are held", "fewer held rates, or others"
    _refuse(calls, rates / size[:, np.newaxis], OPEN[bits], what, allowed, place, rates=rates)
    return moving


@dataclass(frozen=True)
class _ChartGroup:
    """States with singular angles in the same joints: their rows, these joints, and calls in turned coordinates.

    Joints with 3-DOF rotation have other angles where the described ones are singular, and none of them is fixed.
    """

    rows: NDArray[np.intp]
    joints: Places
    calls: Calls

    def place(self, lead: tuple[int, ...]) -> Place:
        """Return the naming of this group's states among all states."""
        return lambda i: _place(int(self.rows[i]), lead)

    def turned(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Convert described q and v, (N, n) each, to these coordinates."""
        return self._seen(q, v, ON, np.zeros_like(q))

    def described(self, q: Array, v: Array, near: Array, place: Place) -> tuple[Array, Array]:
        """Convert q and v to described ones, each angle next to that of a state near it, (N, n).

        Raises:
            SingularError: angles are at +-pi/2 as described, where they have no such rates.
        """
        told = self._seen(q, v, BACK, near)
        if self.joints:
            lost = np.abs(self.turned(*told)[1] - v).max(axis=1)
            bad = ~(lost <= OPEN[self.calls.dtype.itemsize] * np.maximum(1.0, np.abs(v).max(axis=1)))
            if bad.any():
                state = int(bad.argmax())
                raise self.calls.singular("project_velocity", self.joints[0][0], place(state), told[0][state])
        return told

    def _seen(self, q: Array, v: Array, places: int, near: Array) -> tuple[Array, Array]:
        if not self.joints:
            return q, v
        states = np.hstack([q, v]).astype(np.float64)[:, np.newaxis]
        expressed = np.array([seen(one, self.joints, places, x)[0] for one, x in zip(states, near, strict=True)])
        first, second = np.split(expressed.astype(self.calls.dtype), 2, axis=1)
        return np.ascontiguousarray(first), np.ascontiguousarray(second)


def _chart_groups(calls: Calls, q: Array, free: Mask) -> Iterator[_ChartGroup]:
    """Group states, (N, n), by the joints whose angles are nearly singular in them."""
    joints = {
        name: (first, origin)
        for name, (first, origin) in calls.raw.turning.items()
        if free[first if origin < 0 else origin : first + 3].all()
    }
    rows: dict[frozenset[str], list[int]] = {frozenset(): list(range(len(q)))}
    if joints:
        rows = {}
        for i, state in enumerate(q):
            rows.setdefault(singular_joints(state, joints), []).append(i)
    for names, numbers in rows.items():
        chart = calls
        if names:
            parameters = calls.parameters.copy()
            parameters.turn(names)
            chart = calls.with_parameters(parameters)
        yield _ChartGroup(np.array(numbers, dtype=np.intp), [joints[name] for name in joints if name in names], chart)


def _roots(calls: Calls, q: ArrayLike, held: Iterable[str], number: int) -> Array:
    """Return several assemblies about one guess, the nearest first; see ``Kernel.assemble``."""
    guess, lead = calls.array("q", q, (calls.n,))
    if lead or isinstance(number, bool) or not isinstance(number, (int, np.integer)) or not 1 <= number <= MOST_ROOTS:
        wrong = f"states of shape {guess.shape}" if lead else show(number)
        raise InputError(
            f"close: roots of {wrong}; allowed: a whole number from 1 to {MOST_ROOTS}, for one state of shape (n,)"
        )
    free = free_coordinates(calls, held)
    rng = np.random.default_rng(0)
    tried = np.tile(guess, (GUESSES * int(number) + 1, 1))
    turns = _turns(calls)
    spread = np.where(turns, np.pi, max(REACH, float(np.abs(guess[~turns]).max(initial=0.0))))
    tried[1:] += (rng.uniform(-1.0, 1.0, tried[1:].shape) * spread).astype(calls.dtype)
    with_effect = free & (np.abs(calls.run(KernelFunctions.constraint_jacobian, None, (tried,))).max(axis=(0, 1)) > 0.0)
    tried[:, ~with_effect] = guess[~with_effect]
    states, violations = _closed(calls, tried, with_effect)
    closed = np.abs(violations).max(axis=1) <= CLOSED[calls.dtype.itemsize]
    if not closed.any():
        _refuse_violations(calls, states[:1], violations[:1], ())
    upright = _turned_over(calls, states) < 0
    if not (closed & upright).any():
        _refuse_turned_over(calls, states[closed][:1], ())
    solutions = states[closed & upright]
    whole = 2.0 * np.pi * np.round((solutions - guess) / (2.0 * np.pi))
    solutions[:, turns & with_effect] -= whole[:, turns & with_effect].astype(calls.dtype)
    solutions = solutions[np.argsort(np.linalg.norm(solutions - guess, axis=1), kind="stable")]
    kept: list[Array] = []
    for state in solutions:
        if all(np.abs(state - other).max() > max(SAME, 10.0 * CLOSED[calls.dtype.itemsize]) for other in kept):
            kept.append(state)
    return np.array(kept[: int(number)])


def _closed(calls: Calls, guesses: Array, free: Mask) -> tuple[Array, Array]:
    """Close states, (N, n), by the Levenberg-Marquardt method; return them and their constraint violations, (N, m)."""
    q, violations = guesses.copy(), calls.run(KernelFunctions.constraint, None, (guesses,))
    for group in _chart_groups(calls, guesses, free):
        still = np.zeros_like(guesses[group.rows])
        solution, violations[group.rows] = _by_steps(group.calls, group.turned(guesses[group.rows], still)[0], free)
        q[group.rows] = group.described(solution, still, guesses[group.rows], str)[0]
    return q, violations


def _by_steps(calls: Calls, guesses: Array, free: Mask) -> tuple[Array, Array]:
    """Close guesses in the coordinates that these calls know."""
    q, enough = guesses.copy(), CLOSED[calls.dtype.itemsize]
    g = calls.run(KernelFunctions.constraint, None, (q,))
    damping = np.full(len(q), 1e-3)
    for _ in range(ROUNDS if free.any() else 0):
        todo = np.flatnonzero((np.abs(g).max(axis=1) > enough) & (damping <= 1e12))
        if not todo.size:
            break
        violation = np.linalg.norm(g[todo], axis=1)
        J = calls.run(KernelFunctions.constraint_jacobian, None, (q[todo],))[:, :, free]
        trial = q[todo]
        trial[:, free] += _damped_step(J, g[todo], damping[todo] * violation).astype(calls.dtype)
        trial_violations = calls.run(KernelFunctions.constraint, None, (trial,))
        better = np.linalg.norm(trial_violations, axis=1) < violation
        q[todo[better]], g[todo[better]] = trial[better], trial_violations[better]
        damping[todo] = np.where(better, np.maximum(0.2 * damping[todo], 1e-12), 5.0 * damping[todo])
    return q, g


def _damped_step(J: Array, g: Array, damping: Array) -> Array:
    """Return the step that makes |J step + g|^2 + damping |step|^2 least, of a state each, not longer than STEP."""
    U, S, Vt = np.linalg.svd(J.astype(np.float64), full_matrices=False)
    weight = np.divide(S, S**2 + damping[:, np.newaxis], out=np.zeros_like(S), where=1e-15 * S[:, :1] < S)
    step = -np.einsum("kri,kr,kmr,km->ki", Vt, weight, U, g, optimize=True)
    longest = np.maximum(np.abs(step).max(axis=1, keepdims=True), 1e-300)
    return np.asarray(step * np.minimum(1.0, STEP / longest))


def _scaled(calls: Calls, q: Array, J: Array, free: Mask, place: Place) -> tuple[Array, Array]:
    """Return L^-T and J L^-T of the free coordinates of states, M = L L^T."""
    M = calls.run(KernelWithMethods.mass_matrix, None, (q,))[:, free][:, :, free]
    try:
        L = np.linalg.cholesky(M)
    except np.linalg.LinAlgError:
        worst = int(np.argmin([np.linalg.eigvalsh(one)[0] for one in M]))
        raise calls.singular("project_velocity", int(np.flatnonzero(free)[0]), place(worst), q[worst]) from None
    back = np.linalg.inv(L).transpose(0, 2, 1)
    return back, J[:, :, free] @ back


def free_coordinates(calls: Calls, fixed: Iterable[str], label: str = "fixed") -> Mask:
    """Return the mask of coordinates that may change, (n,); UnknownNameError, with the label, of an unknown name."""
    if not calls.raw.libraries.meta.get("constraints"):
        allowed = "a kernel of a robot with rigid [[loops]] or [[couplings]]"
        raise InputError(f"close: {calls.raw.name} has nothing to close; allowed: {allowed}")
    kept = {*([fixed] if isinstance(fixed, str) else names_in(label, fixed))}
    for name in kept:
        if name not in calls.coordinates:
            known = ", ".join(calls.coordinates)
            raise UnknownNameError(f"{label}: {show(name)} is unknown; known: {known}")
    kept |= {*calls.prescribed}
    return np.array([name not in kept for name in calls.coordinates])


def _turns(calls: Calls) -> Mask:
    """Return the mask of coordinates that are angles, (n,)."""
    return np.array([name.rpartition(".")[2] not in ("x", "y", "z") for name in calls.coordinates])


def _turned_over(calls: Calls, q: Array) -> NDArray[np.intp]:
    """Return the first loop of every state that is closed by axes that point to opposite sides, or -1."""
    loops = np.full(len(q), -1)
    upright: Mapping[str, list[tuple[float, int, int]]] = calls.raw.libraries.meta.get("upright", {})
    if not any(upright.values()):
        return loops
    poses = calls.run(KernelFunctions.cut_poses, None, (q,))
    for loop, terms in reversed(list(enumerate(upright.values()))):
        if terms:
            loops[sum(factor * poses[:, loop, i, j] for factor, i, j in terms) <= 0.0] = loop
    return loops


def _refuse_turned_over(calls: Calls, q: Array, lead: tuple[int, ...]) -> None:
    """Refuse states that close turned over: products of axes vanish for opposite axes, too."""
    loops = _turned_over(calls, q)
    if (loops < 0).all():
        return
    state = int((loops >= 0).argmax())
    name = list(calls.raw.libraries.meta["upright"])[int(loops[state])]
    raise LoopError(
        f"{calls.raw.name}: loop {name} closes near the guess{_place(state, lead)} only turned over by half a turn;"
        " allowed: a guess in which the axes of the cut joint's frames point to the same side",
        loop=name,
        gap=float(np.pi),
    )


def _refuse_violations(calls: Calls, q: Array, violations: Array, lead: tuple[int, ...]) -> None:
    """Refuse states, (N, n), that did not close; offsets that nothing takes up are named."""
    enough = CLOSED[calls.dtype.itemsize]
    bad = ~(np.abs(violations).max(axis=1) <= enough)
    if bad.any():
        state = int(bad.argmax())
        allowed = "a guess nearer to closure, or fewer held coordinates"
        if offsets := _offsets(calls, q[state], violations[state]):
            allowed = f"a guess nearer to closure, fewer held coordinates, or other offsets: {listed(offsets)}"
        _refuse(calls, violations, enough, "does not close near the guess", allowed, lambda i: _place(i, lead))


def _offsets(calls: Calls, q: Array, violations: Array) -> list[str]:
    """Return name and value of the offsets that change the greatest of the violations, where q (n,) stays.

    Those of coordinates are not among them: their coordinates take them up.
    """
    worst, offsets = int(np.abs(violations).argmax()), []
    taken_up = {parameter_name("joints", joint_of(name), "offset", kind_of(name)) for name in calls.coordinates}
    for name, value in calls.parameters.items():
        kind, *path = parameter_path(name)
        if kind in ("joints", "loops") and path[1:2] == ["offset"] and value != 0.0 and name not in taken_up:
            other = calls.parameters.copy()
            other[name] = 0.0
            without = calls.with_parameters(other).run(KernelFunctions.constraint, None, (q[np.newaxis],))[0, worst]
            if abs(without - violations[worst]) > CHANGED * abs(violations[worst]):
                offsets.append(f"{name} = {value:g}")
    return offsets


def _refuse(
    calls: Calls, sizes: Array, limit: float, what: str, allowed: str, place: Place, rates: Array | None = None
) -> None:
    """Refuse the first state in which something is too large, naming its worst loop.

    Args:
        sizes: what is compared to the limit, (N, m).
        what, allowed: of the message.
        place: names of the states.
        rates: what the message says in its place, per second.
    """
    bad = ~(np.abs(sizes).max(axis=1) <= limit)
    if bad.any():
        state = int(bad.argmax())
        said = sizes[state] if rates is None else rates[state]
        per = "" if rates is None else "/s"
        raise left_open(calls.raw, said, f"{what}{place(state)}", allowed, per)


def _place(state: int, lead: tuple[int, ...]) -> str:
    return place_of([int(i) for i in np.unravel_index(state, lead)]) if lead else ""
