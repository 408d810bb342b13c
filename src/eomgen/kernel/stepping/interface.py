"""Rollouts as methods of kernels: integration over many steps in C, and its derivatives."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike

from ...errors import ArrayError, InputError
from ...names import listed, show
from ...runtime.calls import Calls
from ...runtime.internal_states import behind, cut_apart, joined_inputs, padded, taken_apart
from ...runtime.many_steps import rollout
from ...runtime.raw import Array
from ...runtime.rollouts import Control, Inputs, Rollout
from ..functions import KernelWithMethods
from .adaptive import adaptive_rollout
from .gradients import NAMES, Loss, rollout_gradient
from .methods import StepMethod
from .options import InputStepOptions, StepOptions, method_for
from .reading_inputs import InputsLike
from .saturation import Saturate, efforts_of
from .sensitivities import rollout_sensitivity

LossApart = Callable[[Array, Array, Array, Array], tuple[Any, ArrayLike, ArrayLike, ArrayLike]]
LABELS = ("dq", "dv", "dz")


class Rollouts(KernelWithMethods):
    """Motions of a kernel over many steps."""

    def rollout(  # noqa: PLR0913
        self,
        q0: ArrayLike,
        v0: ArrayLike,
        u: ArrayLike | None = None,
        dt: float | None = None,
        steps: int | None = None,
        *,
        method: StepMethod | None = None,
        every: int = 1,
        kp: ArrayLike | None = None,
        kd: ArrayLike | None = None,
        target: ArrayLike | None = None,
        duration: float | None = None,
        samples: int | None = None,
        rtol: float = 1e-6,
        atol: ArrayLike | None = None,
        loads: InputsLike | Sequence[InputsLike] | None = None,
        works: bool = False,
        saturate: Saturate = None,
        z: ArrayLike | None = None,
    ) -> Rollout:
        """Integrate in C, one state or many at a time; external wrenches are some of the ``loads``.

        Loops are closed after every step, to the nearest state in the metric of the kinetic energy that is closed to
        1e-10 m or rad; where they are open at the beginning, the first step closes them.

        Two methods take ``steps`` of length ``dt``.  "rk4" is the classical Runge-Kutta method: fourth order, stable
        while dt is below about 2.8 over the highest natural frequency.  "implicit" takes springs, dampers and the
        controller at the end of a step: first order, and stable whatever their stiffness; where c D + c^2 K of a law is
        negative, as its force falls, the law counts as it is at the beginning; theory section "Stiff joints without
        small steps".  Springs between points are taken so along their lines, and across them as they are at a
        step's beginning.

        Three methods choose their steps so that the error of each stays within tolerances, and give ``samples`` at
        equal times of a ``duration``; each of many states has separate steps, and the same bits as alone.  "tsit5" is
        explicit, of fifth order.  "rosenbrock" is linearly implicit, of fourth order, and stable whatever springs and
        dampers there are.  "radau" is fully implicit, of ninth order, as stable, and for narrower tolerances; it has no
        derivatives.  Theory section "Steps that the error chooses".

        Joints with 3-DOF rotation (``raw.turning``) pass beta = +-pi/2 in other angles; results are as described,
        each angle next to its value before.  A joint with gains on its coordinates stays in the described angles.

        Args:
            q0, v0: states, (n,) or (N, n).
            u: drives, N or N m (of prescribed coordinates accelerations, as in ``forward_dynamics``), held over a
                step, or from a sample to the next: (n,); for one state (steps, n); for many (N, n), (N, steps, n) or
                (1, steps, n).
            dt: length of a step, s.
            steps: their number.
            method: "rk4", "implicit", "rosenbrock", "tsit5" or "radau"; without it "rosenbrock" with a ``duration``,
                else "rk4".
            every: one of so many steps is stored.
            kp, kd: gains of a joint controller that adds kp (target - q) - kd v: a number for all principal
                coordinates (for the motor where one has a motor), or (n,) with 0 at deviations, at principal
                coordinates behind a motor, and at what is prescribed.
            target: coordinates that the controller aims at, shapes as for ``u``.
            duration: of a motion with error control, s.
            samples: of it, beside the beginning; 1 by default.
            rtol, atol: tolerances: the error of a step is at most atol + rtol times the size of each number.  atol is a
                number or (2n,), first of q, then of v; by default rtol times the size of each coordinate: 1, or what
                10 m/s^2 make of its springs where that is less.
            loads: with error control, what else acts, over time, for all states or a list with that of each:
                InputSignals of ``eomgen.kernel.stepping.input_signals``, or a mapping from "drive", "wrench" and
                "prescribed" to what ``integrate`` takes by these names, where that is data, or has some
                (``load_data``).  Prescribed coordinates begin where their motions do; no joint may have 3-DOF rotation.
            works: whether works are integrated, too: attribute ``works``.  Needs generalized_force, and, of prescribed
                coordinates, inverse_dynamics (with loops residual); not where joints have 3-DOF rotation.
            saturate: True: all that drives do at a coordinate (u, controller, drives of loads) is clipped at +- the
                effort of its description (``efforts``); or efforts by coordinate, or (n,), infinite where there is
                none.  What is clipped does not answer to the state in the matrix of an implicit step.
            z: internal states at the beginning, (m,) or (N, m), 0 by default; the result has them as attribute ``z``.

        Returns:
            q and v, (steps // every + 1, n) or (N, steps // every + 1, n), the states at the beginning first; with
            error control (samples + 1, n) or (N, samples + 1, n).  Attributes of the tuple say what the steps were:
            ``steps``, ``rejected``, ``largest`` and ``smallest`` (s), of many states (N,).  ``works``, J, (samples + 1,
            4) or (N, samples + 1, 4), are those of drives, of what moves prescribed coordinates, of wrenches, and what
            dampers and friction take.

        Raises:
            SingularError: M cannot be inverted in a state that is reached.
            IntegrationStopped: a state is not finite any more, or its accelerations, whatever ``checks`` says, or no
                step is short enough for the tolerances; it names the coordinate and the step or time, and keeps what
                was stored.
            InputError: another argument is wrong, or does not belong to the method.
        """
        control = Control(kp, kd, target, efforts_of(self.calls, saturate))
        inputs = joined_inputs(self.calls, z, Inputs(q0, v0, u, control))
        options = InputStepOptions(
            method_for(method, duration), dt, steps, every, duration, samples, rtol, atol, loads, works
        )
        take = adaptive_rollout if options.is_adaptive else rollout
        return taken_apart(self.calls, lambda: take(self.calls, inputs, options))

    def rollout_gradient(  # noqa: PLR0913
        self,
        q0: ArrayLike,
        v0: ArrayLike,
        u: ArrayLike | None = None,
        dt: float | None = None,
        steps: int | None = None,
        *,
        loss: Loss | LossApart,
        parameters: Sequence[str] = (),
        method: StepMethod | None = None,
        every: int = 1,
        kp: ArrayLike | None = None,
        kd: ArrayLike | None = None,
        target: ArrayLike | None = None,
        duration: float | None = None,
        samples: int | None = None,
        rtol: float = 1e-6,
        atol: ArrayLike | None = None,
        loads: InputsLike | Sequence[InputsLike] | None = None,
        saturate: Saturate = None,
        out: Mapping[str, Array] | None = None,
        z: ArrayLike | None = None,
    ) -> tuple[Any, dict[str, Any]]:
        """Return the gradient of a function of a rollout's states, exact for its steps, by their adjoints.

        Adaptive steps count as constant: how their lengths change is left out.  Contacts, friction and stops
        are as smooth as their laws are.  Loops are closed after every step, and differentiated with that.  What is kept
        on the way grows with the square root of the number of steps where they are many.

        Args:
            q0, v0, u, dt, steps, method, every, kp, kd, target, duration, samples, rtol, atol: as of ``rollout``.
            loss: ``loss(t, q, v)`` returns a value and its derivatives by q and v, of their shapes; t are times, s,
                (samples,), q and v states as of ``rollout``.
            parameters: names of run-time parameters that the gradient is taken by as well.
            loads: as of ``rollout``, but with all methods; an implicit step takes them at its end.  Wrenches need the
                kernel external_force_parameter_adjoint, in points and axes of links frame_pose_parameter_adjoint; a
                model that drives know needs inverse_dynamics_adjoint, and has no loops.
            saturate: as of ``rollout``; drives that are clipped have the slope 0, those at their effort 1.
            out: arrays to write derivatives to, by the names that they are returned by; others are new.  Not with z.
            z: internal states as of ``rollout``: it is ``loss(t, q, v, z)`` then, which returns a derivative by z, too,
                and one of the derivatives that are returned is "z".

        Returns:
            The value, and derivatives by name: "q" and "v" by the states at the beginning, "u", and with a controller
            "target", "kp" and "kd", in the shapes of the arguments (gains: (n,)); a number for each parameter.  With
            ``loads`` "loads": a dictionary, or one for each of a list, with "drive.torque", "drive.program",
            "prescribed.tracks[k]" and "wrench[k]", derivatives by the coefficients of signals (``Signal.by_samples``
            gives those by samples), "drive.gains.kp", "drive.gains.kd" and "drive.model.bandwidth".
            Wrenches by name are counted in the order of their mapping.

        Raises:
            UnknownNameError: no such parameter, or the kernel was built without the method's gradient.
            InputError: as of ``rollout``; another result of a loss; joints with 3-DOF rotation; a robot so stiff
                that derivatives of tsit5's steps are not those of the motion.
            SingularError, IntegrationStopped: as of ``rollout``; a mechanism begins in a singular pose.
        """
        control = Control(kp, kd, target, efforts_of(self.calls, saturate))
        inputs = joined_inputs(self.calls, z, Inputs(q0, v0, u, control))
        options = StepOptions(method_for(method, duration), dt, steps, every, duration, samples, rtol, atol)
        more: dict[str, Any] = {"parameters": parameters, "loads": loads, "out": out}
        if not self.internal_states:
            return rollout_gradient(self.calls, inputs, options, loss=cast("Loss", loss), **more)
        _refuse_out(out)
        joined = _joined_loss(self.calls, cast("LossApart", loss))
        value, gradients = rollout_gradient(self.calls, inputs, options, loss=joined, **more)
        return value, _gradients_apart(self.calls, gradients)

    def rollout_sensitivity(  # noqa: PLR0913
        self,
        q0: ArrayLike,
        v0: ArrayLike,
        u: ArrayLike | None = None,
        dt: float | None = None,
        steps: int | None = None,
        *,
        parameters: Sequence[str] = (),
        along: Mapping[str, ArrayLike] | None = None,
        method: StepMethod | None = None,
        every: int = 1,
        kp: ArrayLike | None = None,
        kd: ArrayLike | None = None,
        target: ArrayLike | None = None,
        duration: float | None = None,
        samples: int | None = None,
        rtol: float = 1e-6,
        atol: ArrayLike | None = None,
        loads: InputsLike | Sequence[InputsLike] | None = None,
        saturate: Saturate = None,
        out: Sequence[Array] | None = None,
        z: ArrayLike | None = None,
    ) -> tuple[tuple[Array, ...], tuple[Array, ...]]:
        """Return derivatives of a rollout's states along few directions, exact for its steps: they carry them forwards.

        Adaptive steps count as constant, as of ``rollout_gradient``.  Every direction costs some rollouts,
        whatever the number of samples is.

        Args:
            q0, v0, u, dt, steps, method, every, kp, kd, target, duration, samples, rtol, atol: as of ``rollout``.
            parameters: names of run-time parameters, a direction each.
            along: directions in front of those: rates by names "q", "v" and "u", (directions, n) each, those of drives
                (directions, rows, n) where they change with the rows of u; rates left out are zero.
            loads: as of ``rollout_gradient``; wrenches need external_force_tangent and
                external_force_parameter_tangent, in points and axes of links those of frame_pose, and a model that
                drives know inverse_dynamics_tangent.
            saturate: as of ``rollout_gradient``.
            out: q, v, dq and dv to write to.  Not with z.
            z: internal states as of ``rollout``; ``along`` may have rates of them then, "z", (directions, m).

        Returns:
            q and v as of ``rollout``, then dq and dv, (samples, directions, n); of many states (N, samples, directions,
            n), all along the same directions.  With z they are q, v and z, then dq, dv and dz.

        Raises:
            UnknownNameError: no such parameter, or the kernel was built without the method's sensitivity.
            InputError: as of ``rollout``; no direction; joints with 3-DOF rotation; a robot that is too stiff.
            SingularError, IntegrationStopped: as of ``rollout``.
        """
        control = Control(kp, kd, target, efforts_of(self.calls, saturate))
        inputs = joined_inputs(self.calls, z, Inputs(q0, v0, u, control))
        options = StepOptions(method_for(method, duration), dt, steps, every, duration, samples, rtol, atol)
        if self.internal_states:
            _refuse_out(out)
            along = None if along is None else _joined_directions(self.calls, along)
        states, rates = rollout_sensitivity(
            self.calls, inputs, options, parameters=parameters, along=along, loads=loads, out=out
        )
        if not self.internal_states:
            return states, rates
        return (states[0], *cut_apart(states[1], self.n)), (rates[0], *cut_apart(rates[1], self.n))


def _refuse_out(out: object) -> None:
    """Refuse arrays to write to where there are internal states."""
    if out is not None:
        raise InputError("out: results with z are new arrays; allowed: without out")


def _joined_loss(calls: Calls, loss: LossApart) -> Callable[[Array, Array, Array], tuple[Any, Array, Array]]:
    """Return a loss of velocities that have internal states behind them, of one that takes these as z.

    Args:
        loss: (t, q, v, z) -> its value, and derivatives by q, v and z, in their shapes.
    """

    def joined(t: Array, q: Array, v: Array) -> tuple[Any, Array, Array]:
        apart = q, *cut_apart(v, calls.n)
        answer = loss(t, *apart)
        if not isinstance(answer, tuple) or len(answer) != 1 + len(LABELS):
            raise InputError(f"loss: it returned {show(answer)}; allowed: (value, {', '.join(LABELS)})")
        value, *by = answer
        arrays = []
        for label, array, of in zip(LABELS, by, apart, strict=True):
            if np.shape(array) != of.shape:
                raise ArrayError(f"loss: {label} has {_shape_or_type(array)}; expected shape {of.shape}")
            arrays.append(np.asarray(array))
        by_q, by_v, by_z = arrays
        return value, by_q, np.concatenate([by_v, by_z], axis=-1)

    return joined


def _gradients_apart(calls: Calls, gradients: Mapping[str, Any]) -> dict[str, Any]:
    """Return gradients of coordinates alone, and that by internal states at the beginning, as ``z``."""
    n = calls.n
    apart = {name: np.ascontiguousarray(x[..., :n]) if name in NAMES else x for name, x in gradients.items()}
    return apart | {"z": np.ascontiguousarray(gradients["v"][..., n:])}


def _joined_directions(calls: Calls, along: Mapping[str, ArrayLike]) -> dict[str, ArrayLike]:
    """Return directions of a sensitivity as rates of the arrays of the C.

    Args:
        along: rates by names "q", "v" and "u", (directions, n) each, and "z", (directions, m).

    Raises:
        ArrayError: another shape of those of states.
    """
    if not isinstance(along, Mapping):
        raise InputError(f"along: {show(along)}; allowed: arrays by {listed(('q', 'v', 'u', 'z'))}")
    joined = {name: padded(calls, name, x) if name == "u" else x for name, x in along.items() if name != "z"}
    if not {"v", "z"}.isdisjoint(along):
        n, m = calls.n, len(calls.internal_states)
        count = len(np.atleast_2d(along.get("z", along.get("v"))))  # type: ignore[arg-type]
        given = {"v": along.get("v", np.zeros((count, n), calls.dtype)), "z": along.get("z", np.zeros((count, m)))}
        for name, size in (("v", n), ("z", m)):
            if np.shape(given[name]) != (count, size):
                what = f"({count}, {size})" if {"v", "z"} <= along.keys() else f"(directions, {size})"
                raise ArrayError(f"along: {name} has shape {np.shape(given[name])}; expected {what}")
        joined["v"] = behind(calls, ("v", given["v"], n), ("z", given["z"], m))
    return joined


def _shape_or_type(value: Any) -> str:
    """Say what an argument is: its shape, or its type where it has none."""
    try:
        return f"shape {np.shape(value)}"
    except ValueError:
        return type(value).__name__
