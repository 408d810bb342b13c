"""Frequency response functions about a static equilibrium: from actuator forces and wrenches to what moves.

H(w) = Y (-w^2 M + i w D + K)^-1 F about a static equilibrium, displacements per unit force; velocities and
accelerations are i w and -w^2 times that.  ``h1`` estimates the same from signals over time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..arrays import Array
from ..description import RobotLike
from ..errors import ArrayError, InputError
from ..identifiers import check_kind
from ..optional import optional_import
from ..progress import StageReport, tells_at_prompt
from ..results.kinds import Kind, SavedColumns, declare
from ..results.stored import Stored
from ..robot.coordinates import force_unit_of, unit_of
from ..runtime.arrays import numbers_in
from ..shown import Plotting, Shown
from ..tabular import Rows, TableColumn, Tabular
from .at_rest import system_at_rest
from .holding import PoseLike
from .modal import ROUND_OFF
from .options import StateKeywords, prepared, warn_of
from .ports import PortKind, checked_kind, input_matrix, output_matrices, per_time, units_of_outputs
from .tangent_system import LinearSystem

Complex = NDArray[np.complex128]


@dataclass(frozen=True, kw_only=True)
class Response(Plotting, Shown, Tabular, SavedColumns, plot="plot_response"):
    """Frequency responses about a static equilibrium.

    Attributes:
        robot: the robot's name.
        frequencies: (F,), Hz.
        H: complex, (F, outputs, inputs): output per input, e^(+i w t); units as of ``unit``.
        inputs, outputs: names, see ``ports``.
        kind: of the outputs: displacement, velocity or acceleration.
        output_units: of the outputs as displacements; none in files of earlier versions.
        coordinates, q: names, and the static equilibrium, (n,).
        notes: lines about what was assumed.
    """

    robot: Annotated[str, Stored(otherwise="")]
    frequencies: Annotated[Array, Stored(("F",), "Hz")]
    H: Annotated[Complex, Stored(("F", "outputs", "inputs"), "output per input", of=complex, unknown=True)]
    inputs: Annotated[tuple[str, ...], Stored(("inputs",), of=str)]
    outputs: Annotated[tuple[str, ...], Stored(("outputs",), of=str)]
    kind: Annotated[str, Stored(of=str)]
    output_units: Annotated[tuple[str, ...], Stored(("outputs",), of=str, otherwise=())] = ()
    coordinates: Annotated[tuple[str, ...], Stored(("n",), of=str)]
    q: Annotated[Array, Stored(("n",), "m, rad", unknown=True)]
    notes: Annotated[tuple[str, ...], Stored(otherwise=())]

    def of(self, output: str, source: str) -> Complex:
        """Return one response, (F,); InputError if there is none of these names."""
        for label, name, known in (("output", output, self.outputs), ("input", source, self.inputs)):
            if name not in known:
                raise InputError(f"{label}: {name!r} is not in this response; it has {', '.join(known)}")
        return self.H[:, self.outputs.index(output), self.inputs.index(source)]

    @property
    def magnitude(self) -> Array:
        """Magnitudes, (F, outputs, inputs), in the units of ``unit``; in decibels 20 log10 of them."""
        return np.abs(self.H)

    @property
    def phase(self) -> Array:
        """Phases, (F, outputs, inputs), rad, without jumps over the frequencies."""
        return np.unwrap(np.angle(self.H), axis=0)

    def unit(self, output: str, source: str) -> str:
        """Return its unit, such as "m/s per N"."""
        own = dict(zip(self.outputs, self.output_units, strict=False)).get(output, unit_of(output))
        return f"{per_time(own, self.kind)} per {force_unit_of(source)}"

    def as_rows(self) -> Rows:
        """Return a row per frequency: the complex response of every output to every input, "tcp.x from tcp.fx"."""
        columns = [
            TableColumn(f"{y} from {x}", self.unit(y, x), self.of(y, x)) for y in self.outputs for x in self.inputs
        ]
        return Rows("frequency", "Hz", self.frequencies, columns, {"robot": self.robot, "kind": self.kind})

    def as_dict(self) -> dict[str, Any]:
        """Return plain values, for JSON; complex numbers as [real, imaginary]."""
        pairs = [(y, x) for y in self.outputs for x in self.inputs]
        return {
            "robot": self.robot,
            "kind": self.kind,
            "frequencies": self.frequencies.tolist(),
            "responses": [
                {
                    "output": y,
                    "input": x,
                    "unit": self.unit(y, x),
                    "H": [[z.real, z.imag] for z in self.of(y, x).tolist()],
                }
                for y, x in pairs
            ],
            "notes": list(self.notes),
        }

    def lines(self) -> list[str]:
        """Return the peak of every response, for people."""
        low, high = self.frequencies[0], self.frequencies[-1]
        lines = [f"{self.robot}: {self.kind}, {len(self.frequencies)} frequencies from {low:g} to {high:g} Hz", ""]
        lines.append(f"{'output':<24}{'input':<24}{'peak':>12}{'at [Hz]':>12}  unit")
        for y in self.outputs:
            for x in self.inputs:
                size = np.abs(self.of(y, x))
                k = int(size.argmax())
                lines.append(f"{y:<24}{x:<24}{size[k]:>12.4g}{self.frequencies[k]:>12.5g}  {self.unit(y, x)}")
        return lines + [f"note: {note}" for note in self.notes]

    def columns(self) -> dict[str, Array]:
        """Return columns of a table by name, (F,) each: frequency, OUTPUT/INPUT.real and OUTPUT/INPUT.imag."""
        columns = {"frequency": self.frequencies}
        for y in self.outputs:
            for x in self.inputs:
                columns |= {f"{y}/{x}.real": self.of(y, x).real, f"{y}/{x}.imag": self.of(y, x).imag}
        return columns


declare(Kind("response", Response, is_bare=True, is_finite=False))


@tells_at_prompt("responding")
def response(
    robot: RobotLike,
    inputs: Sequence[str],
    outputs: Sequence[str],
    frequencies: ArrayLike,
    pose: PoseLike | None = None,
    *,
    kind: PortKind = "displacement",
    progress: StageReport | None = None,
    **options: Unpack[StateKeywords],
) -> Response:
    """Return frequency responses about the static equilibrium at a pose.

    Args:
        robot: a Robot, the name of a built-in one, or the path of a description; prescribed coordinates stay.
        inputs: drives ("joint1.gamma", that are not locked) and components of wrenches ("tcp.fz"); see ``ports``.
        outputs: coordinates ("joint1.x"), components of a frame's motion ("tcp.x", "tcp.rz") and internal states
            ("joint1.x.friction.z").
        frequencies: (F,), Hz, at least 0.
        pose: see ``holding.pose_of``.
        kind: "displacement", "velocity" or "acceleration".
        progress: called with a line of text when a stage of building begins.
        **options: drives, kp, kd, fixed, loads, parameters and kernel, see ``StateOptions``.

    Raises:
        InputError: an argument cannot be used, or the response is infinite at a frequency.
        IntegrationError: there is no static equilibrium near the pose.
    """
    check_kind("inputs", inputs, isinstance(inputs, Sequence), "a sequence of names")
    check_kind("outputs", outputs, isinstance(outputs, Sequence), "a sequence of names")
    checked_kind(kind)
    hertz = checked_frequencies(frequencies)
    arm = prepared(robot, progress, **options)
    kernel = arm.kernel
    system, _ = system_at_rest(kernel, arm.coordinates(pose), arm.fixation, arm.loads)
    warn_of(system.notes)
    forces = input_matrix(kernel, (system.q, system.v, system.inputs), inputs, arm.fixation)
    H = _solved(system, forces, output_matrices(kernel, system.q, system.v, outputs)[0], hertz)
    H *= {"displacement": 1.0, "velocity": 2j * np.pi, "acceleration": -4.0 * np.pi**2}[kind] * np.power(
        hertz, {"displacement": 0, "velocity": 1, "acceleration": 2}[kind]
    )[:, np.newaxis, np.newaxis]
    return Response(
        robot=arm.robot.name,
        frequencies=hertz,
        H=H,
        inputs=tuple(inputs),
        outputs=tuple(outputs),
        kind=kind,
        output_units=units_of_outputs(kernel, outputs),
        coordinates=kernel.coordinates,
        q=system.q,
        notes=system.notes,
    )


def h1(
    t: ArrayLike, force: ArrayLike, motion: ArrayLike, *, segment: int | None = None
) -> tuple[Array, Complex, Array]:
    """Return the estimator H1 = S_fx / S_ff of a response from signals, by Welch's method with a Hann window.

    Noise in the motion does not bias it; noise in the force does.

    Args:
        t: times at equal distances, (T,), s.
        force, motion: signals, (T,).
        segment: samples of each averaged part, half of it overlapping; default a sixteenth of all.

    Returns:
        Frequencies (Hz), H1 (complex) and the coherence (0 to 1), all of one shape.

    Raises:
        ArrayError: signals of different lengths, or not finite.
        InputError: times that are not equally far apart, a segment that does not fit, SciPy is not installed.
    """
    with optional_import("SciPy", "H1 of signals needs"):
        from scipy import signal
    signals = {"t": t, "force": force, "motion": motion}
    times, f, x = (numbers_in(name, values, "finite numbers (T,)") for name, values in signals.items())
    if not (times.ndim == 1 and times.shape == f.shape == x.shape and len(times) > 2):
        raise ArrayError(f"t, force, motion: shapes {times.shape}, {f.shape}, {x.shape}; allowed: one shape (T,)")
    steps = np.diff(times)
    step = float(steps.mean())
    if not (step > 0.0 and np.abs(steps - step).max() <= 1e-6 * step):
        raise InputError("t: times are not equally far apart; allowed: a constant step")
    size = max(len(times) // 16, 8) if segment is None else segment
    if not 2 <= size <= len(times):
        raise InputError(f"segment: {segment!r}; allowed: from 2 to the {len(times)} samples")
    options: dict[str, Any] = {"fs": 1.0 / step, "nperseg": size}
    hertz, cross = signal.csd(f, x, **options)
    _, power = signal.welch(f, **options)
    _, coherence = signal.coherence(f, x, **options)
    return hertz, cross / power, coherence


def checked_frequencies(values: ArrayLike) -> Array:
    """Return frequencies, (F,), Hz; ArrayError where they are none."""
    try:
        hertz = np.atleast_1d(np.array(values, dtype=np.float64))
    except (TypeError, ValueError):
        hertz = np.zeros(0)
    if hertz.ndim != 1 or not hertz.size or not np.isfinite(hertz).all() or (hertz < 0.0).any():
        raise ArrayError("frequencies: expected finite numbers of shape (F,), Hz, at least 0")
    return hertz


def transfer_function(A: Array, B: Array, C: Array, D: Array, hertz: Array) -> Complex:
    """Return C (i w 1 - A)^-1 B + D at frequencies, Hz, (F, outputs, inputs).

    Raises:
        InputError: it is infinite at one of them.
    """
    H = np.empty((len(hertz), *D.shape), dtype=np.complex128)
    for k, w in enumerate(2.0 * np.pi * hertz):
        Z = 1j * w * np.eye(len(A)) - A
        try:
            H[k] = C @ np.linalg.solve(Z, B) + D
        except np.linalg.LinAlgError:
            H[k] = np.inf
        if not np.isfinite(H[k]).all():
            raise InputError(
                f"bode: infinite at {hertz[k]:g} Hz (a rigid-body or undamped mode); allowed: other frequencies"
            )
    return H


def _solved(system: LinearSystem, whole: Array, outputs: Array, hertz: Array) -> Complex:
    """Return rows Z^-1 forces at all frequencies, rows and columns of Z scaled to one size.

    Internal states stand behind the coordinates; those that stick, and that no input drives, hold as springs.

    Args:
        system: about a static equilibrium.
        whole: forces of the inputs, (n + m, inputs).
        outputs: by coordinates and states, (outputs, n + m).
        hertz: frequencies, (F,).
    """
    n, of_laws = system.kernel.n, outputs[:, system.internal_states.places]
    forces, rows = system.basis.T @ whole[:n], outputs[:, :n] @ system.basis
    if not system.independent:
        return np.zeros((len(hertz), len(rows), forces.shape[1]), dtype=np.complex128)
    sticks = system.internal_states.stick & ~system.internal_states.rates_by(whole).any(axis=1)
    rows, of_laws = rows + of_laws[:, sticks] @ system.internal_states.by_v[sticks], of_laws[:, ~sticks]
    system = system.condensed(sticks)
    internal_states, driven = system.internal_states, system.internal_states.rates_by(whole)
    size = 1.0 / np.sqrt(np.diagonal(system.M))
    M, D, K = (matrix * np.outer(size, size) for matrix in (system.M, system.D, system.K))
    heft, largest = system.hefts(), float(np.linalg.norm(K, 2))
    speed = np.sqrt(largest) or 1.0  # by which internal states are as large as coordinates
    right = np.vstack([size[:, np.newaxis] * forces, heft[:, np.newaxis] * driven])
    result = np.empty((len(hertz), len(rows), forces.shape[1]), dtype=np.complex128)
    for k, w in enumerate(2.0 * np.pi * hertz):
        Z = K - w * w * M + 1j * w * D
        if internal_states.names:
            acts = internal_states.acts * np.outer(size, speed / heft)
            led = (internal_states.by_q + 1j * w * internal_states.by_v) * np.outer(heft, size)
            own = (1j * w * np.eye(len(heft)) - internal_states.by_z) * np.outer(heft, speed / heft)
            Z = np.block([[Z, acts], [-led, own]])
        values = np.linalg.svd(Z, compute_uv=False)
        if values[-1] <= ROUND_OFF * len(Z) * max(values[0], largest):
            raise InputError(
                f"response: infinite at {hertz[k]:g} Hz (a rigid-body or undamped mode); allowed: other frequencies"
            )
        x = np.linalg.solve(Z, right)
        result[k] = (rows * size) @ x[: len(size)]
        if of_laws.any():
            result[k] += (of_laws * (speed / heft)) @ x[len(size) :]
    return result
