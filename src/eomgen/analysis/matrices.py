"""The equations of motion about a state as matrices A, B, C, D, for controllers and for libraries of linear systems."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any, Unpack

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array
from ..description import RobotLike
from ..errors import InputError, UnknownNameError
from ..names import component_name, nearest_or_all, show
from ..progress import StageReport, tells_at_prompt
from ..results.kinds import Kind, Saved, declare
from ..results.stored import Stored
from ..robot.coordinates import MOTIONS
from ..robot.model import tool_of
from ..runtime.arrays import names_in
from ..shown import Shown
from .at_rest import system_at_rest
from .discrete import DiscreteStateSpace, zero_order_hold
from .frequency import Response, checked_frequencies, transfer_function
from .holding import Fixation, PoseLike
from .in_motion import moving_system
from .options import StateKeywords, prepared, warn_of
from .ports import PortKind, checked_kind, input_matrix, output_matrices, units_of_outputs
from .tangent_system import LinearSystem

NO_STATES = np.zeros(0)
NO_STATES.flags.writeable = False


@dataclass(frozen=True, kw_only=True)
class StateSpace(Shown, Saved):
    """x' = A x + B w, y = C x + D w: small changes about a static equilibrium, or about a motion at one time.

    Attributes:
        robot: the robot's name.
        A, B, C, D: (2m + p, 2m + p), (2m + p, inputs), (outputs, 2m + p), (outputs, inputs); SI units, rad.
        states: names, 2m + p: the m independent coordinates, their rates ("joint1.gamma.rate"), then p internal states
            ("joint1.gamma.friction.z"), those of locked coordinates left out.
        inputs, outputs: names, see ``ports``.
        kind: of the outputs: displacement, velocity or acceleration.
        output_units: of the outputs as displacements; none in files of earlier versions.
        coordinates: names of all coordinates, n.
        q, v, a, u: the state about which it is, (n,) each; u of servo drives as ``Kernel.inputs`` has it, where it was
            given or a static equilibrium says it, else the force.
        internal_states, z: names of all internal states, and the states about which it is, (m,).
        notes: lines about what was assumed.
    """

    robot: Annotated[str, Stored(otherwise="")]
    A: Annotated[Array, Stored(("states", "states"), "SI", unknown=True)]
    B: Annotated[Array, Stored(("states", "inputs"), "SI", unknown=True)]
    C: Annotated[Array, Stored(("outputs", "states"), "SI", unknown=True)]
    D: Annotated[Array, Stored(("outputs", "inputs"), "SI", unknown=True)]
    states: Annotated[tuple[str, ...], Stored(("states",), of=str)]
    inputs: Annotated[tuple[str, ...], Stored(("inputs",), of=str)]
    outputs: Annotated[tuple[str, ...], Stored(("outputs",), of=str)]
    kind: Annotated[str, Stored(of=str)]
    output_units: Annotated[tuple[str, ...], Stored(("outputs",), of=str, otherwise=())] = ()
    coordinates: Annotated[tuple[str, ...], Stored(("n",), of=str)]
    q: Annotated[Array, Stored(("n",), "m, rad", unknown=True)]
    v: Annotated[Array, Stored(("n",), "m/s, rad/s", unknown=True)]
    a: Annotated[Array, Stored(("n",), "m/s^2, rad/s^2", unknown=True)]
    u: Annotated[Array, Stored(("n",), "N, N m", unknown=True)]
    internal_states: Annotated[tuple[str, ...], Stored(("s",), of=str, otherwise=())] = ()
    z: Annotated[Array, Stored(("s",), "m, rad", unknown=True, otherwise=NO_STATES)] = field(
        default_factory=lambda: NO_STATES
    )
    notes: Annotated[tuple[str, ...], Stored(otherwise=())]

    @property
    def matrices(self) -> tuple[Array, Array, Array, Array]:
        """(A, B, C, D), as scipy.signal.StateSpace(*...) and control.ss(*...) take them."""
        return self.A, self.B, self.C, self.D

    def bode(
        self,
        inputs: str | Sequence[str] | None = None,
        outputs: str | Sequence[str] | None = None,
        frequencies: ArrayLike | None = None,
    ) -> Response:
        """Return frequency responses, with ``magnitude`` and ``phase``; ``eomgen.pictures.plot_response`` draws them.

        Args:
            inputs, outputs: names of those that are wanted; all if not given.
            frequencies: (F,), Hz; by default 400 from a tenth of the slowest eigenvalue to ten times the fastest.

        Raises:
            UnknownNameError: there is no such input or output.
            InputError: a frequency is none, or the response is infinite there.
        """
        of_in, of_out = _chosen("input", inputs, self.inputs), _chosen("output", outputs, self.outputs)
        hertz = checked_frequencies(_spread(self.A) if frequencies is None else frequencies)
        x, y = (
            [known.index(name) for name in names] for known, names in ((self.inputs, of_in), (self.outputs, of_out))
        )
        return Response(
            robot=self.robot,
            frequencies=hertz,
            H=transfer_function(self.A, self.B[:, x], self.C[y], self.D[np.ix_(y, x)], hertz),
            inputs=of_in,
            outputs=of_out,
            kind=self.kind,
            output_units=tuple(self.output_units[i] for i in y) if self.output_units else (),
            coordinates=self.coordinates,
            q=self.q,
            notes=self.notes,
        )

    def discretize(self, dt: float) -> DiscreteStateSpace:
        """Return the system in discrete time, exact for inputs that are constant over dt, s (zero-order hold).

        Raises:
            InputError: dt is not a time above 0, or SciPy is not installed.
        """
        A, B = zero_order_hold(self.A, self.B, dt)
        names = {"states": self.states, "inputs": self.inputs, "outputs": self.outputs}
        return DiscreteStateSpace(robot=self.robot, A=A, B=B, C=self.C, D=self.D, dt=float(dt), kind=self.kind, **names)

    def as_dict(self) -> dict[str, Any]:
        """Return plain values, for JSON."""
        state = {name: dict(zip(self.coordinates, getattr(self, name).tolist(), strict=True)) for name in "qvau"}
        if self.internal_states:
            state["z"] = dict(zip(self.internal_states, self.z.tolist(), strict=True))
        return {
            "robot": self.robot,
            **{name: getattr(self, name).tolist() for name in "ABCD"},
            **{name: list(getattr(self, name)) for name in ("states", "inputs", "outputs", "notes")},
            "kind": self.kind,
            "state": state,
        }

    def lines(self) -> list[str]:
        """Return sizes, names and eigenvalues for people."""
        moving = sum(name not in self.internal_states for name in self.states) // 2
        lines = [
            f"{self.robot}: {len(self.states)} states, {len(self.inputs)} inputs, {len(self.outputs)} outputs",
            f"  states: {', '.join(self.states[:moving])}, and their rates",
            *([f"  internal states: {', '.join(behind)}"] if (behind := self.states[2 * moving :]) else []),
            f"  inputs: {', '.join(self.inputs)}",
            f"  outputs: {', '.join(self.outputs)} ({self.kind})",
        ]
        if self.states:
            roots = np.linalg.eigvals(self.A)
            worst = roots[int(np.argmax(roots.real))]
            lines.append(f"  eigenvalue furthest to the right: {worst.real:.5g} {worst.imag:+.5g}i 1/s")
        return lines + [f"note: {note}" for note in self.notes]


def _chosen(label: str, wanted: str | Sequence[str] | None, known: tuple[str, ...]) -> tuple[str, ...]:
    """Return the names that are wanted, all of them known."""
    if wanted is None:
        return known
    names = [wanted] if isinstance(wanted, str) else names_in(f"{label}s", wanted)
    for name in names:
        if name not in known:
            raise UnknownNameError(f"{label}: {show(name)} is not in this system{nearest_or_all(name, known)}")
    return tuple(names)


def _spread(A: Array) -> Array:
    """Return frequencies about the eigenvalues of A, Hz; from 0.1 to 100 where it has none but zeros."""
    sizes = np.abs(np.linalg.eigvals(A)) / (2.0 * np.pi) if A.size else np.zeros(0)
    sizes = sizes[sizes > 1e-6 * sizes.max(initial=0.0)]
    low, high = (0.1 * sizes.min(), 10.0 * sizes.max()) if sizes.size else (0.1, 100.0)
    return np.asarray(np.geomspace(low, high, 400))


declare(Kind("state_space", StateSpace, is_bare=True, is_finite=False))


@tells_at_prompt("linearising")
def linearize(  # noqa: PLR0913
    robot: RobotLike,
    pose: PoseLike | None = None,
    *,
    v: ArrayLike | None = None,
    a: ArrayLike | None = None,
    u: ArrayLike | None = None,
    inputs: Sequence[str] | None = None,
    outputs: Sequence[str] | None = None,
    kind: PortKind = "displacement",
    frame: str | None = None,
    progress: StageReport | None = None,
    **options: Unpack[StateKeywords],
) -> StateSpace:
    """Return A, B, C and D about the static equilibrium at a pose, or about a motion set by v and a, or by v and u.

    Args:
        robot: a Robot, the name of a built-in one, or the path of a description; prescribed coordinates do
            not change.
        pose: see ``holding.pose_of``; with v it is the state itself, nothing is brought to rest.
        v: rates, (n,); in a mechanism with loops those that keep them closed.
        a: accelerations, (n,), or
        u: drives, (n,), from which they follow (of prescribed coordinates, and of locked ones, the acceleration is 0).
            Of a motion with loops that v and a give the least ones, at the coordinates that have a drive.
        inputs: see ``ports.input_matrix``; default: the drives that can move something.
        outputs: see ``ports.output_matrices``; default: the frame's six components.
        kind: of the outputs: "displacement", "velocity" or, at rest, "acceleration".
        frame: of the default outputs; as in ``simulate`` by default.
        progress: called with a line of text when a stage of building begins.
        **options: drives, kp, kd, fixed, loads, parameters and kernel, see ``StateOptions``; drives are free
            here if nothing else is said.

    Raises:
        InputError: an argument cannot be used.
        IntegrationError: there is no static equilibrium near the pose.
        LoopError: v or a open a loop, or these drives cannot make the motion.
    """
    checked_kind(kind)
    options.setdefault("drives", "free")
    arm = prepared(robot, progress, **options)
    kernel, fixation, frame = arm.kernel, arm.fixation, tool_of(arm.robot, frame)
    q = arm.coordinates(pose)
    if v is None:
        if a is not None or u is not None:
            raise InputError("a and u belong to a motion; allowed: with v")
        system, _ = system_at_rest(kernel, q, fixation, arm.loads)
    else:
        system = moving_system(arm, q, v, a, u)
    warn_of(system.notes)
    if inputs is None:
        inputs = [name for i, name in enumerate(kernel.coordinates) if fixation.driven[i] and not fixation.locked[i]]
    if outputs is None:
        outputs = [component_name(frame, component) for component in MOTIONS]
    return state_space(system, fixation, arm.robot.name, inputs, outputs, kind)


def state_space(
    system: LinearSystem, fixation: Fixation, robot: str, inputs: Sequence[str], outputs: Sequence[str], kind: str
) -> StateSpace:
    """Return the matrices of a linear system with these inputs and outputs; ``robot`` is the robot's name.

    Raises:
        InputError: a name is unknown, or accelerations are asked for about a motion.
    """
    kernel, m = system.kernel, len(system.independent)
    n = kernel.n
    moving = bool(system.v[:n].any() or system.a.any())
    whole, laws = input_matrix(kernel, (system.q, system.v, system.inputs), inputs, fixation), system.internal_states
    p = len(laws.names)
    forces = np.linalg.solve(system.M, system.basis.T @ whole[:n])
    lower = -np.linalg.solve(system.M, np.hstack([system.K, system.D, laws.acts]))
    A = np.vstack([np.eye(m, 2 * m + p, m), lower, np.hstack([laws.by_q, laws.by_v, laws.by_z])])
    B = np.vstack([np.zeros_like(forces), forces, laws.rates_by(whole)])
    by_q, by_q_rate = output_matrices(kernel, system.q, system.v, outputs)
    rows, rates = by_q[:, :n] @ system.basis, by_q_rate[:, :n] @ system.basis + by_q[:, :n] @ system.basis_rate
    D = np.zeros((len(outputs), len(inputs)))
    of_laws = by_q[:, laws.places]
    if kind == "displacement":
        C = np.hstack([rows, np.zeros_like(rows), of_laws])
    elif kind == "velocity":
        C = np.hstack([rates, rows, np.zeros_like(of_laws)]) + of_laws @ A[2 * m :]
        D = of_laws @ B[2 * m :]
    elif states := [name for name in outputs if name in kernel.internal_states]:
        raise InputError(f"kind: 'acceleration' of {states[0]}, an internal state; allowed: displacement, velocity")
    elif moving:
        raise InputError("kind: 'acceleration' about a motion; allowed: displacement, velocity (accelerations at rest)")
    else:
        C, D = rows @ lower, rows @ forces
    return StateSpace(
        robot=robot,
        A=A,
        B=B,
        C=C,
        D=D,
        states=(*system.independent, *(f"{name}.rate" for name in system.independent), *laws.names),
        inputs=tuple(inputs),
        outputs=tuple(outputs),
        kind=kind,
        output_units=units_of_outputs(kernel, outputs),
        coordinates=kernel.coordinates,
        q=system.q,
        v=system.v[:n],
        a=system.a,
        u=system.u,
        internal_states=kernel.internal_states,
        z=system.v[n:],
        notes=system.notes,
    )
