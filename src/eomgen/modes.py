"""Eigenfrequencies, damping ratios and mode shapes of a robot at rest, at a pose and along a path.

About a state of rest small motions obey M e'' + D e' + K e = 0 with the exact derivatives of the residual.  With
e = phi exp(s t) that is a quadratic eigenproblem, solved in the scaled state (L^T e, L^T e'), M = L L^T.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .errors import EomgenWarning, InputError
from .holding import Gains, Pose, hold_of, pose_of
from .kernel import Kernel
from .linear import LinearSystem, Loads, checked_loads, kernel_of
from .rest import system_at_rest
from .result import unit_of
from .robot import Robot
from .simulate import tool_of

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

FRAME_PARTS = ("x", "y", "z", "rx", "ry", "rz")
ROUND_OFF = 1e-14  # of the greatest stiffness over mass: what is taken to be zero


@dataclass(frozen=True)
class Modes:
    """Modes of small motions about a state of rest, by rising natural frequency; m of them.

    A pair of conjugate eigenvalues s is one mode, a real eigenvalue is one, too (overdamped, or divergent).

    Attributes:
        robot: the robot's name.
        coordinates: names, n.
        q: the state of rest, (n,), m or rad.
        eigenvalues: s, (m,), 1/s, with imaginary parts at least 0.
        shapes: motion of all coordinates, (m, n), complex, m or rad: phi^H M phi = 1, the phase such that phi is as
            real as can be and its largest inertial part is positive.
        frame: name of the frame that is looked at.
        frame_shapes: its displacement and rotation, (m, 6), base axes, m and rad, in the scale of ``shapes``.
        undamped: natural frequencies without dampers, Hz, of the symmetric part of K; negative where it is unstable.
        resolution: Hz; slower oscillations cannot be told from rigid-body modes, whose frequency is 0.
        notes: lines about what was assumed.
    """

    robot: str
    coordinates: tuple[str, ...]
    q: Array
    eigenvalues: Complex
    shapes: Complex
    frame: str
    frame_shapes: Complex
    undamped: Array
    resolution: float
    notes: tuple[str, ...]

    @property
    def frequencies(self) -> Array:
        """Natural frequencies abs(s) / 2 pi, (m,), Hz."""
        return np.asarray(np.abs(self.eigenvalues) / (2.0 * np.pi))

    @property
    def damped_frequencies(self) -> Array:
        """Frequencies of the oscillation, Im(s) / 2 pi, (m,), Hz."""
        return np.asarray(self.eigenvalues.imag / (2.0 * np.pi))

    @property
    def damping_ratios(self) -> Array:
        """-Re(s) / abs(s), (m,); NaN for rigid-body modes."""
        size = np.abs(self.eigenvalues)
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.asarray(-self.eigenvalues.real / np.where(size > 0.0, size, np.nan))

    def as_dict(self) -> dict[str, Any]:
        """Plain values, for JSON; complex numbers as [real, imaginary]."""
        rows = []
        for k, s in enumerate(self.eigenvalues):
            ratio = float(self.damping_ratios[k])
            rows.append(
                {
                    "frequency": float(self.frequencies[k]),
                    "damped_frequency": float(self.damped_frequencies[k]),
                    "damping_ratio": ratio if np.isfinite(ratio) else None,
                    "eigenvalue": [s.real, s.imag],
                    "shape": dict(zip(self.coordinates, _pairs(self.shapes[k]), strict=True)),
                    "frame_shape": dict(zip(FRAME_PARTS, _pairs(self.frame_shapes[k]), strict=True)),
                }
            )
        return {
            "robot": self.robot,
            "q": dict(zip(self.coordinates, self.q.tolist(), strict=True)),
            "frame": self.frame,
            "modes": rows,
            "undamped": self.undamped.tolist(),
            "resolution": self.resolution,
            "notes": list(self.notes),
        }

    def lines(self, largest: int = 3) -> list[str]:
        """A table for people: each mode with the coordinates that take the largest part in it."""
        lines = [f"{self.robot}: {len(self.eigenvalues)} modes; {self.frame} moves by this per unit of modal mass", ""]
        lines.append(f"{'mode':>4}{'f [Hz]':>12}{'damping':>10}  {f'{self.frame} [mm, mrad]':<26}coordinates")
        size = np.abs(self.shapes)
        for k, f in enumerate(self.frequencies):
            ratio = self.damping_ratios[k]
            moved = f"{1e3 * np.linalg.norm(self.frame_shapes[k][:3]):.3g}, "
            moved += f"{1e3 * np.linalg.norm(self.frame_shapes[k][3:]):.3g}"
            scaled = size[k] / max(float(size[k].max()), 1e-300)
            first = [i for i in np.argsort(-scaled, kind="stable")[:largest] if scaled[i] > 0.02]
            shape = ", ".join(f"{self.coordinates[i]} {size[k, i]:.3g} {unit_of(self.coordinates[i])}" for i in first)
            text = "rigid" if not np.isfinite(ratio) else f"{round(ratio, 12) + 0.0:.3g}"
            lines.append(f"{k + 1:>4}{f:>12.5g}{text:>10}  {moved:<26}{shape}")
        return lines + [f"note: {note}" for note in self.notes]


@dataclass(frozen=True)
class TrackedModes:
    """Modes along a path: track k is one mode that is followed from pose to pose.

    Attributes:
        modes: at each of the P poses.
        tracks: which mode of each pose it is, (P, tracks); -1 where it is none of them.
    """

    modes: tuple[Modes, ...]
    tracks: NDArray[np.intp]

    def values(self, name: str) -> Array:
        """``frequencies``, ``damped_frequencies`` or ``damping_ratios`` of all tracks, (P, tracks); NaN where none."""
        found = np.full(self.tracks.shape, np.nan)
        for row, modes, index in zip(found, self.modes, self.tracks, strict=True):
            row[index >= 0] = getattr(modes, name)[index[index >= 0]]
        return found

    def as_dict(self) -> dict[str, Any]:
        """Plain values, for JSON."""

        def plain(name: str) -> list[list[float | None]]:
            return [[float(x) if np.isfinite(x) else None for x in row] for row in self.values(name)]

        first = self.modes[0]
        return {
            "robot": first.robot,
            "coordinates": list(first.coordinates),
            "q": [modes.q.tolist() for modes in self.modes],
            "frequencies": plain("frequencies"),
            "damping_ratios": plain("damping_ratios"),
            "notes": list(dict.fromkeys(note for modes in self.modes for note in modes.notes)),
        }

    def lines(self) -> list[str]:
        """Range of every track for people."""
        first = self.modes[0]
        lines = [f"{first.robot}: modes over {len(self.modes)} poses", ""]
        lines.append(f"{'track':>5}{'first [Hz]':>12}{'least':>12}{'most':>12}{'last':>12}{'damping':>18}")
        for k, (f, ratio) in enumerate(zip(self.values("frequencies").T, self.values("damping_ratios").T, strict=True)):
            seen = ratio[np.isfinite(ratio)]
            text = f"{seen.min():.3g} to {seen.max():.3g}" if seen.size else "rigid"
            ends = f"{f[0]:>12.5g}{np.nanmin(f):>12.5g}{np.nanmax(f):>12.5g}{f[-1]:>12.5g}"
            lines.append(f"{k + 1:>5}{ends}{text:>18}")
        return lines + [f"note: {note}" for note in dict.fromkeys(n for modes in self.modes for n in modes.notes)]


def modes(
    robot: Robot,
    pose: Pose | None = None,
    *,
    drives: str = "locked",
    kp: Gains | None = None,
    kd: Gains | None = None,
    held: Iterable[str] | None = None,
    loads: Loads | None = None,
    frame: str | None = None,
    parameters: Mapping[str, float] | None = None,
    kernel: Kernel | None = None,
    progress: Callable[[str], None] | None = None,
) -> Modes:
    """Modes about the state of rest at a pose.

    Args:
        robot: any; prescribed coordinates stay.
        pose: see ``holding.pose_of``.
        drives: "locked" (principal coordinates do not move), "free" (they move under the constant forces that hold the
            pose) or "pd" (gains ``kp`` and ``kd`` hold them).
        kp, kd, held: see ``holding.hold_of``; held is needed for a robot with loops.
        loads: dead wrenches by frame or link, (6,) each: force (N), moment (N m) at its origin, base axes.
        frame: to look at; default as in ``simulate``.
        parameters: values that differ from the description's, {"gravity.z": 0.0} say.
        kernel: of the robot, float64, with ``linear.KERNELS``; built if not given.  Its parameters count.
        progress: called with a line of text when a stage of building begins.

    Raises:
        InputError: an argument cannot be used.
        IntegrationError: there is no state of rest near the pose.
    """
    kernel = kernel_of(robot, kernel, parameters, progress)
    hold = hold_of(robot, kernel, drives, kp=kp, kd=kd, held=held)
    frame, found = tool_of(robot, frame), checked_loads(kernel, loads)
    system, _ = system_at_rest(kernel, pose_of(robot, kernel, pose), hold, found)
    for note in system.notes:
        warnings.warn(note, EomgenWarning, stacklevel=2)
    return modes_of(system, robot.name, frame)


def modes_along(
    robot: Robot,
    poses: Sequence[Pose] | Array,
    *,
    drives: str = "locked",
    kp: Gains | None = None,
    kd: Gains | None = None,
    held: Iterable[str] | None = None,
    loads: Loads | None = None,
    frame: str | None = None,
    parameters: Mapping[str, float] | None = None,
    kernel: Kernel | None = None,
    progress: Callable[[str], None] | None = None,
) -> TrackedModes:
    """Modes at poses along a path, each mode followed by its shape; arguments and errors as of ``modes``.

    A mode goes on as the one whose shape is most like its own (modal assurance criterion in the metric of M), as far
    as all can have one of their own.

    Raises:
        InputError: no pose, or SciPy is not installed.
    """
    if not len(poses):
        raise InputError("poses: none given; allowed: one or more")
    kernel = kernel_of(robot, kernel, parameters, progress)
    hold = hold_of(robot, kernel, drives, kp=kp, kd=kd, held=held)
    frame, dead = tool_of(robot, frame), checked_loads(kernel, loads)
    found, metrics = [], []
    for pose in poses:
        system, _ = system_at_rest(kernel, pose_of(robot, kernel, pose), hold, dead)
        found.append(modes_of(system, robot.name, frame))
        metrics.append(system.kernel.residual_jacobian(system.q, system.v, system.a)[2])
    for note in dict.fromkeys(note for entry in found for note in entry.notes):
        warnings.warn(note, EomgenWarning, stacklevel=2)
    return TrackedModes(tuple(found), _tracked(found, metrics))


def modes_of(system: LinearSystem, robot: str, frame: str) -> Modes:
    """The modes of a linear system; ``robot`` is the robot's name, ``frame`` a frame's."""
    m = len(system.independent)
    L: Array = np.asarray(np.linalg.cholesky(system.M))
    S, B = (np.linalg.solve(L, np.linalg.solve(L, part).T).T for part in (system.K, system.D))
    state = np.block([[np.zeros((m, m)), np.eye(m)], [-S, -B]])
    # states of one size: a rate is a frequency times a deflection
    weight = float(np.sqrt(np.linalg.norm(S, 2))) or 1.0
    scale = np.concatenate([np.full(m, weight), np.ones(m)])
    s, vectors = np.linalg.eig(state * np.outer(scale, 1.0 / scale))
    rigid, zeros = _rigid(system, L)
    s[np.argsort(np.abs(s), kind="stable")[:zeros]] = 0.0
    chosen = np.flatnonzero((s.imag >= 0.0) & (s != 0.0))
    chosen = chosen[np.lexsort((s[chosen].real, s[chosen].imag, np.abs(s[chosen])))]
    scaled = vectors[:m, chosen] / np.linalg.norm(vectors[:m, chosen], axis=0)
    scaled = np.concatenate([rigid.astype(np.complex128), scaled], axis=1)
    shapes = np.linalg.solve(L.T, _turned(scaled)).T @ system.basis.T
    values = np.linalg.eigvalsh(0.5 * (S + S.T))
    values[np.argsort(np.abs(values), kind="stable")[: rigid.shape[1]]] = 0.0
    J = system.kernel.frame_jacobian(system.q, frame)
    return Modes(
        robot,
        system.kernel.coordinates,
        system.q,
        np.concatenate([np.zeros(rigid.shape[1]), s[chosen]]),
        shapes,
        frame,
        shapes @ J.T,
        np.sign(values) * np.sqrt(np.abs(values)) / (2.0 * np.pi),
        float(np.sqrt(ROUND_OFF * m) * weight / (2.0 * np.pi)),
        system.notes,
    )


def _rigid(system: LinearSystem, L: Array) -> tuple[Array, int]:
    """Rigid-body modes, columns of an orthonormal basis of the null space of S, and the number of eigenvalues of 0.

    A mode that dampers brake has one eigenvalue of 0 and one that is negative; one that nothing brakes has two of 0.
    """
    size = 1.0 / np.sqrt(np.diagonal(system.M))
    U, values, Vt = np.linalg.svd(system.K * np.outer(size, size))
    null = values <= ROUND_OFF * len(values) * values[0]
    left, right = U[:, null], Vt[null].T
    braked = left.T @ (system.D * np.outer(size, size)) @ right
    brakes = np.linalg.svd(braked, compute_uv=False)
    rank = int(np.count_nonzero(brakes > ROUND_OFF * max(float(np.abs(system.D).max() * size.max() ** 2), 1e-300)))
    basis = np.linalg.qr(L.T @ (size[:, np.newaxis] * right))[0]
    return np.asarray(basis, dtype=np.float64), 2 * right.shape[1] - rank


def _turned(scaled: Complex) -> Complex:
    """Columns with the phase that makes them most real, the largest entry positive."""
    with np.errstate(divide="ignore", invalid="ignore"):
        square = (scaled**2).sum(axis=0)
        turned = scaled * np.exp(-0.5j * np.angle(square))
    largest = np.take_along_axis(turned, np.abs(turned).argmax(axis=0)[np.newaxis], axis=0)[0]
    return np.asarray(turned * np.where(largest.real < 0.0, -1.0, 1.0))


def _tracked(found: Sequence[Modes], metrics: Sequence[Array]) -> NDArray[np.intp]:
    try:
        from scipy.optimize import linear_sum_assignment
    except ImportError:
        raise InputError('modes along a path need SciPy: pip install "eomgen[sim]"') from None
    tracks = [[k] for k in range(len(found[0].eigenvalues))]
    last = [(0, k) for k in range(len(tracks))]  # pose and mode where a track was seen
    for i in range(1, len(found)):
        now, metric = found[i], metrics[i]
        shapes = np.array([found[p].shapes[k] for p, k in last])
        values = np.array([found[p].eigenvalues[k] for p, k in last])
        overlap = np.abs(shapes.conj() @ metric @ now.shapes.T) ** 2
        own = np.abs(np.einsum("ki,ij,kj->k", shapes.conj(), metric, shapes))
        likeness = overlap / own[:, np.newaxis]
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
    return np.array(list(zip(*tracks, strict=True)), dtype=np.intp)


def _pairs(values: Complex) -> list[list[float]]:
    return [[float(z.real), float(z.imag)] for z in values]
