"""Natural frequencies, damping ratios and mode shapes about a static equilibrium, at a pose and along a path.

About a static equilibrium small motions obey M e'' + D e' + K e = 0 with the exact derivatives of the residual.  With
e = phi exp(s t) that is a quadratic eigenproblem, solved in the scaled state (L^T e, L^T e'), M = L L^T.  Internal
states stand behind, as sqrt(w) z; those that stick (``state.internal_states``) are springs, each with an eigenvalue 0.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Unpack

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Index
from ..description import RobotLike
from ..errors import InputError
from ..identifiers import check_kind
from ..optional import optional_import
from ..progress import StageReport, tells_at_prompt
from ..robot.model import tool_of
from .at_rest import system_at_rest
from .holding import PoseLike
from .modal_result import Modes, TrackedModes
from .options import HeldRobot, StateKeywords, prepared, warn_of
from .tangent_system import LinearSystem, Tangent

Complex = NDArray[np.complex128]


ROUND_OFF = 1e-14  # of the greatest stiffness over mass: what is taken to be zero
STILL = 1e-9  # of a whole motion: coordinates that move less do not move in it


@tells_at_prompt("linearising")
def modes(
    robot: RobotLike,
    pose: PoseLike | None = None,
    *,
    frame: str | None = None,
    progress: StageReport | None = None,
    **options: Unpack[StateKeywords],
) -> Modes:
    """Return modes about the static equilibrium at a pose.

    Args:
        robot: a Robot, the name of a built-in one, or the path of a description; prescribed coordinates stay.
        pose: see ``holding.pose_of``.
        frame: to look at; default as in ``simulate``.
        progress: called with a line of text when a stage of building begins.
        **options: drives, kp, kd, fixed, loads, parameters and kernel, see ``StateOptions``.

    Raises:
        InputError: an argument cannot be used.
        IntegrationError: there is no static equilibrium near the pose.
    """
    arm = prepared(robot, progress, **options)
    frame = tool_of(arm.robot, frame)
    system, state = system_at_rest(arm.kernel, arm.coordinates(pose), arm.fixation, arm.loads)
    warn_of(system.notes)
    return modes_of(system, state.tangent, arm, frame)


@tells_at_prompt("linearising")
def modes_along(
    robot: RobotLike,
    poses: Sequence[PoseLike] | Array,
    *,
    frame: str | None = None,
    progress: StageReport | None = None,
    **options: Unpack[StateKeywords],
) -> TrackedModes:
    """Return modes at poses along a path, each mode followed by its shape; other arguments and errors as ``modes``.

    A mode goes on as the one whose shape is most like it (modal assurance criterion in the metric of M), as far
    as all can have one.

    Raises:
        InputError: no pose, or SciPy is not installed.
    """
    check_kind("poses", poses, hasattr(poses, "__len__"), "a sequence of poses")
    if not len(poses):
        raise InputError("poses: none; allowed: one or more")
    arm = prepared(robot, progress, **options)
    frame = tool_of(arm.robot, frame)
    entries, metrics = [], []
    for pose in poses:
        system, state = system_at_rest(arm.kernel, arm.coordinates(pose), arm.fixation, arm.loads)
        entries.append(modes_of(system, state.tangent, arm, frame))
        metrics.append(state.tangent.M)
    warn_of(dict.fromkeys(note for entry in entries for note in entry.notes))
    return TrackedModes(tuple(entries), _tracked(entries, metrics))


def modes_of(system: LinearSystem, tangents: Tangent, arm: HeldRobot, frame: str) -> Modes:
    """Return the modes of a linear system at rest, whose derivatives are ``tangents``; ``frame`` is a frame's name."""
    sticks = system.internal_states.stick
    eigenvalues, scaled, undamped, resolution = _solved(system.condensed())
    scaled, live = scaled[: len(system.independent)], scaled[len(system.independent) :]
    shapes = scaled.T @ system.basis.T
    states = np.empty((len(shapes), sticks.size), dtype=np.complex128)
    states[:, ~sticks], states[:, sticks] = live.T, scaled.T @ system.internal_states.by_v[sticks].T
    strained = _shares(shapes, tangents.K + np.diag(arm.fixation.kp))
    strained[eigenvalues == 0.0] = 0.0
    return Modes(
        robot=arm.robot.name,
        coordinates=system.kernel.coordinates,
        q=system.q,
        eigenvalues=eigenvalues,
        shapes=shapes,
        frame=frame,
        frame_shapes=shapes @ system.kernel.frame_jacobian(system.q, frame).T,
        undamped=undamped,
        resolution=resolution,
        internal_states=system.internal_states.names,
        states=states,
        zeros=tuple(np.array(system.internal_states.names, dtype=np.str_)[sticks].tolist()),
        notes=system.notes,
        strain_energy=strained,
        kinetic_energy=_shares(shapes, tangents.M),
    )


def _shares(shapes: Complex, matrix: Array) -> Array:
    """Return what each coordinate has of the energy phi^H matrix phi / 2 of shapes (m, n), (m, n); 0 where none is."""
    parts = (shapes.conj() * (shapes @ matrix.T)).real
    whole = parts.sum(axis=1, keepdims=True)
    size = (np.abs(shapes) * (np.abs(shapes) @ np.abs(matrix).T)).sum(axis=1, keepdims=True)
    known = np.abs(whole) > STILL * size
    return np.where(known, parts / np.where(known, whole, 1.0), 0.0)


def _solved(system: LinearSystem) -> tuple[Complex, Complex, Array, float]:
    """Return eigenvalues, motions in columns, undamped frequencies and resolution; no state sticks in the system.

    Motions are those of independent coordinates and, behind them, of internal states, scaled as ``Modes`` has them.
    """
    m, laws = len(system.independent), system.internal_states
    if not m:
        return np.zeros(0, complex), np.zeros((len(laws.names), 0), complex), np.zeros(0), 0.0
    L: Array = np.asarray(np.linalg.cholesky(system.M))
    S, B = (np.linalg.solve(L, np.linalg.solve(L, matrix).T).T for matrix in (system.K, system.D))
    state = np.block([[np.zeros((m, m)), np.eye(m)], [-S, -B]])
    heft = system.hefts()
    if laws.names:
        acts = np.linalg.solve(L, laws.acts) / heft
        led = (np.linalg.solve(L, x.T).T * heft[:, np.newaxis] for x in (laws.by_q, laws.by_v))
        own = laws.by_z * np.outer(heft, 1.0 / heft)
        state = np.block([[state, np.vstack([np.zeros_like(acts), -acts])], [*led, own]])
    # states of one size: a rate is a frequency times a deflection
    weight = float(np.sqrt(np.linalg.norm(S, 2))) or 1.0
    scale = np.concatenate([np.full(m, weight), np.ones(len(state) - m)])
    s, vectors = np.linalg.eig(state * np.outer(scale, 1.0 / scale))
    rigid, zeros = _rigid(system, L, weight)
    s[np.argsort(np.abs(s), kind="stable")[:zeros]] = 0.0
    chosen = np.flatnonzero((s.imag >= 0.0) & (s != 0.0))
    chosen = chosen[np.lexsort((s[chosen].real, s[chosen].imag, np.abs(s[chosen])))]
    moved = np.concatenate([rigid.astype(np.complex128), _normalised(vectors[:, chosen], m, heft / weight)], axis=1)
    moved = _most_real(moved, m)
    values = np.linalg.eigvalsh(0.5 * (S + S.T))
    values[np.argsort(np.abs(values), kind="stable")[: rigid.shape[1]]] = 0.0
    eigenvalues = np.concatenate([np.zeros(rigid.shape[1]), s[chosen]])
    undamped = np.sign(values) * np.sqrt(np.abs(values)) / (2.0 * np.pi)
    motions = np.vstack([np.linalg.solve(L.T, moved[:m]), moved[m:]])
    return eigenvalues, motions, undamped, float(np.sqrt(ROUND_OFF * m) * weight / (2.0 * np.pi))


def _normalised(vectors: Complex, m: int, per_state: Array) -> Complex:
    """Return scaled coordinates of norm 1 over internal states, from eigenvectors; of states alone, these."""
    size = np.linalg.norm(vectors[:m], axis=0)
    behind = vectors[2 * m :] / per_state[:, np.newaxis]
    if len(behind):
        alone = size <= STILL * np.linalg.norm(vectors, axis=0)
        size = np.where(alone, np.linalg.norm(behind, axis=0), size)
        return np.asarray(np.vstack([np.where(alone, 0.0, vectors[:m]), behind]) / size)
    return np.asarray(vectors[:m] / size)


def _rigid(system: LinearSystem, L: Array, speed: float) -> tuple[Array, int]:
    """Return rigid-body modes and how many eigenvalues are 0.

    The modes are an orthonormal basis of the null space of S in columns, with internal states behind the coordinates.
    A mode that dampers brake has one eigenvalue of 0 and one that is negative; one that nothing brakes has two of 0.
    """
    m, laws = len(system.independent), system.internal_states
    size = 1.0 / np.sqrt(np.diagonal(system.M))
    static, braking = (matrix * np.outer(size, size) for matrix in (system.K, system.D))
    largest = float(np.abs(system.D).max() * size.max() ** 2)
    heft = system.hefts()
    if laws.names:
        acts, own = laws.acts * np.outer(size, speed / heft), laws.by_z * np.outer(heft, speed / heft)
        static = np.block([[static, acts], [-laws.by_q * np.outer(heft, size), -own]])
        braking = np.block([[braking, 0.0 * acts], [-laws.by_v * np.outer(heft, size), speed * np.eye(len(heft))]])
        largest = float(np.abs(braking).max())
    U, values, Vt = np.linalg.svd(static)
    null = values <= ROUND_OFF * len(values) * values[0]
    left, right = U[:, null], Vt[null].T
    brakes = np.linalg.svd(left.T @ braking @ right, compute_uv=False)
    rank = int(np.count_nonzero(brakes > ROUND_OFF * max(largest, 1e-300)))
    moved, zeros = L.T @ (size[:, np.newaxis] * right[:m]), 2 * right.shape[1] - rank
    if not laws.names:
        return np.asarray(np.linalg.qr(moved)[0], dtype=np.float64), zeros
    basis, sizes, turn = np.linalg.svd(moved, full_matrices=False)
    moves = sizes > STILL
    behind = (speed / heft)[:, np.newaxis] * right[m:] @ turn[moves].T / sizes[moves]
    return np.vstack([basis[:, moves], behind]), zeros


def _most_real(scaled: Complex, m: int) -> Complex:
    """Return columns with the phase that makes their first m entries most real, the largest of these positive."""
    with np.errstate(divide="ignore", invalid="ignore"):
        square = (scaled[:m] ** 2).sum(axis=0)
        turned = scaled * np.exp(-0.5j * np.angle(square))
    largest = np.take_along_axis(turned, np.abs(turned[:m]).argmax(axis=0)[np.newaxis], axis=0)[0]
    return np.asarray(turned * np.where(largest.real < 0.0, -1.0, 1.0))


def _tracked(entries: Sequence[Modes], metrics: Sequence[Array]) -> Index:
    with optional_import("SciPy", "modes along a path need"):
        from scipy.optimize import linear_sum_assignment
    tracks = [[k] for k in range(len(entries[0].eigenvalues))]
    last = [(0, k) for k in range(len(tracks))]  # pose and mode where a track was seen
    for i in range(1, len(entries)):
        now, metric = entries[i], metrics[i]
        shapes = np.array([entries[p].shapes[k] for p, k in last]).reshape(len(last), len(metric))
        values = np.array([entries[p].eigenvalues[k] for p, k in last], dtype=np.complex128)
        overlap = np.abs(shapes.conj() @ metric @ now.shapes.T) ** 2
        norms = np.abs(np.einsum("ki,ij,kj->k", shapes.conj(), metric, shapes))
        likeness = overlap / norms[:, np.newaxis]
        # of shapes that are alike the nearer eigenvalue: an overdamped pair has one shape
        apart = np.abs(values[:, np.newaxis] - now.eigenvalues)
        size = np.maximum(np.abs(values)[:, np.newaxis] + np.abs(now.eigenvalues), 1e-300)
        rows, columns = linear_sum_assignment(likeness - 0.1 * apart / size, maximize=True)
        pairs = dict(zip(rows.tolist(), columns.tolist(), strict=True))
        for row, track in enumerate(tracks):
            track.append(pairs.get(row, -1))
            if row in pairs:
                last[row] = (i, pairs[row])
        for column in sorted(set(range(len(now.eigenvalues))) - set(pairs.values())):
            tracks.append([-1] * i + [column])
            last.append((i, column))
    return np.asarray(np.array(tracks, dtype=np.intp).reshape(len(tracks), len(entries)).T)
