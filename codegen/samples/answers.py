"""Samples of all functions: their inputs, and what each has to answer."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from ..kernels.equations import Equations
from ..kernels.signatures import functions
from ..program.ir import Program
from .arithmetic import SAFETY, Arithmetic, Array, spread, with_copies
from .composed import COMPOSED, FRAMED, Run, status_of
from .states import sample_inputs, sample_parameters
from .steps import clipped, one_adapted_step, one_step
from .stored import MEASURED, STATES, pack_samples

_STEP = {"float64": 2.0**-60, "float32": 2.0**-40}  # s; coordinates stay what they are to the bit, and so their sines
_SHORTEST = {"float64": 2.0**-250, "float32": 2.0**-60}  # s; whose squares are no denormal numbers yet
_LARGEST = 2.0**64  # by which steps are shortened at once
_METHODS = {"rollout": 2, "adaptive_rollout": 2, "radau_rollout": 3}  # the last of the last is iterated
_ITERATED = 256.0  # how much more than others answers of iterations differ: increments are transformed and back
_RESTING = 2  # states that steps are taken from


def samples(equations: Equations, dtype: str) -> bytes:
    """Compute inputs and answers of every function that users call, as ``read_samples`` returns them."""
    with np.errstate(all="ignore"):
        arrays = _Samples(equations, dtype).arrays()
    return pack_samples(arrays)


class _Samples:
    """Answers of programs are kept, since several functions may need one."""

    def __init__(self, equations: Equations, dtype: str) -> None:
        self.equations, self.model = equations, equations.model
        self.arithmetic = Arithmetic(dtype)
        inputs, self.certain = sample_inputs(equations, self.arithmetic)
        values = sample_parameters(np.array(list(self.model.parameters.values())), self.arithmetic.dtype)
        turned = np.zeros((len(self.model.turning), values.shape[1]), values.dtype)  # joints are as described
        values = np.concatenate([values, turned])
        self.samples: dict[str, Any] = {name: array.T for name, array in {**inputs, "p": values}.items()}
        self.inputs = {name: with_copies(array) for name, array in inputs.items()}
        self.known: dict[str, tuple[Array, Array]] = {}

    def arrays(self) -> dict[str, Any]:
        """Return all arrays of ``read_samples``."""
        setup = self.arithmetic.run(self.equations.setup, {"p": with_copies(self.samples["p"].T)}).get("h")
        if setup is None:
            setup = np.zeros((0, with_copies(self.samples["p"].T).shape[1]), self.arithmetic.dtype)
        no_turns = all(i.op not in ("sin", "cos") for i in self.equations.setup.instructions)
        self._store("setup", setup, None, self.equations.setup, certain=no_turns)
        self.samples["h"] = self.h = setup[:, 0]
        numbers = sorted({0, len(self.model.frames) // 2, len(self.model.frames) - 1})
        for function in functions(self.equations.kernels):
            name, calls = function.name, self.equations.calls.get(function.kernel, (function.kernel,))
            programs = [self.equations.programs[program] for program in calls]
            if function.kind == "gradient":
                continue  # its programs are compared as kernels
            if function.is_rollout and self.model.constraints:
                continue  # steps of Newton's method close loops: they go far from here, and not by the same bits
            if function.is_rollout:
                self._store_steps(name, one_step if function.kind == "rollout" else one_adapted_step, programs)
            elif function.is_framed:
                k = self.run(function.kernel)[0]
                answers = np.stack([FRAMED[name](self.model, k, number) for number in numbers])
                self.samples["frames"] = np.array(numbers)
                self._store(name, answers, None, *programs)
            elif function.kernel in self.equations.calls:
                self._store_composed(name, programs)
            else:
                self._store(name, *self.run(name), *programs)
        return self.samples

    def run(self, name: str, **changed: Array) -> tuple[Array, Array]:
        """Answer (size, lanes) and status (lanes,) of a program, with some of its inputs changed."""
        if name not in self.known or changed:
            inputs = {**self.inputs, **changed, "h": self.h}
            outputs = self.arithmetic.run(self.equations.programs[name], inputs)
            pivot = outputs.get("pivot")
            answer = outputs.get("out", np.zeros((0, inputs["q"].shape[1]), self.arithmetic.dtype))
            status = np.zeros(answer.shape[1], np.int64) if pivot is None else status_of(pivot)
            if changed:
                return answer, status
            self.known[name] = answer, status
        return self.known[name]

    def _store_composed(self, name: str, programs: list[Program]) -> None:
        known, status, places, identity, exact = COMPOSED[name](self.model, self.run, self.inputs)
        self._store(name, known, status, *programs, certain=exact and self.certain)
        if places is not None:
            self.samples[f"{name} places"] = places
        if identity is not None:
            for key, array in zip(("unknown", "matrix", "right", "within"), identity, strict=True):
                self.samples[f"{name} {key}"] = array

    def _store(
        self, name: str, answers: Array, status: Array | None, *programs: Program, certain: bool | None = None
    ) -> None:
        """Put answers (..., lanes) among the samples, lanes first."""
        states = len(STATES)
        self.samples[name] = np.moveaxis(answers[..., :states], -1, 0)
        self.samples[f"{name} near"] = np.moveaxis(SAFETY * spread(answers), -1, 0).astype(np.float64)
        self.samples[f"{name} status"] = np.zeros(states, np.int64) if status is None else status[:states]
        certain = self.certain if certain is None else certain
        self.samples[f"{name} bits"] = certain and all(map(self.arithmetic.has_no_choice, programs))

    def _with_inputs(self, u: Array) -> Run:
        """Return ``run``, with the inputs of drives among the gains of stages, as integrations put them there."""
        beside = self.model.beside

        def run(name: str, **changed: Array) -> tuple[Array, Array]:
            if name == "stage_factors" and beside:
                changed["kp"] = changed["kp"].copy()
                changed["kp"][list(beside.values())] = u[list(beside)]
            return self.run(name, **changed)

        return run

    def _store_steps(self, name: str, step: Callable[..., tuple[Array, Array]], programs: list[Program]) -> None:
        u = clipped(self.inputs["u"], with_copies(self._efforts()))
        q, dt, run = self.inputs["q"], self._step(u), self._with_inputs(u)
        ways = [step(method, run, q, np.zeros_like(q), u, dt) for method in range(_METHODS[name])]
        n, lanes = q.shape
        answers, iterated = np.stack([way[0].reshape(2 * n, lanes) for way in ways]), name == "radau_rollout"
        self._store(name, answers, None, *programs, certain=False if iterated else None)
        if iterated:
            near = self.samples[f"{name} near"]
            size = float(np.finfo(self.arithmetic.dtype).eps) * np.abs(self.samples[name][: len(near)])
            turned = np.moveaxis(self._second_order(u, dt), -1, 0)[:, np.newaxis]
            self.samples[f"{name} near"] = _ITERATED * np.fmax(near, size) + turned
        for suffix in ("", " near"):
            self.samples[name + suffix] = np.moveaxis(self.samples[name + suffix][:_RESTING], 0, 1)
        self.samples[f"{name} status"] = np.stack([way[1][:_RESTING] for way in ways])
        self.samples["dt"] = dt

    def _second_order(self, u: Array, dt: Any) -> Array:
        """Return how much of coordinates and velocities after a step comes of accelerations that change in it, (2n, k).

        Of a number whose acceleration vanishes where the step begins, as of a filter's state, that is all there is.
        """
        q, still = self.inputs["q"], np.zeros_like(self.inputs["q"])
        a = self.run("forward_dynamics", v=still, u=u)[0]
        change = np.abs(self.run("forward_dynamics", q=q, v=dt * a, u=u)[0] - a)[:, :MEASURED]
        change = np.where(np.isfinite(change), change, 0.0).astype(np.float64)
        return np.concatenate([2.0 * float(dt) ** 2 * change, 2.0 * float(dt) * change])

    def _step(self, u: Array) -> Any:
        """Return the length of steps, s, so short that accelerations at both ends are one within rounding.

        Radau's step is compared with one of Euler's: stiff dampers on light links tell them apart in 1e-18 s.
        """
        name = str(self.arithmetic.dtype)
        dt, q, still = _STEP[name], self.inputs["q"], np.zeros_like(self.inputs["q"])
        a = self.run("forward_dynamics", v=still, u=u)[0]
        within = 2.0 * SAFETY * np.maximum(spread(a), np.finfo(a.dtype).eps * np.abs(a[:, :MEASURED]))
        while dt > _SHORTEST[name]:
            end = self.run("forward_dynamics", q=q, v=q.dtype.type(dt) * a, u=u)[0]
            changes = np.where(within > 0.0, np.abs(end - a)[:, :MEASURED], 0.0)[:, :_RESTING]
            ratio = float(np.nanmax(changes / within[:, :_RESTING], initial=0.0))
            if not ratio > 1.0:
                break
            dt = max(dt * 2.0 ** -math.ceil(math.log2(min(ratio, _LARGEST))), _SHORTEST[name])
        return q.dtype.type(dt)

    def _efforts(self) -> Array:
        """Return efforts of drives (n, states): half of what the last resting state has, infinite in others."""
        states: Array = self.samples["u"].T
        efforts: Array = np.full_like(states, np.inf)
        efforts[:, _RESTING - 1] = 0.5 * np.abs(states[:, _RESTING - 1])
        free = [*self.model.prescribed, *(i for k in self.model.turning for i in self.model.bodies[k].indices)]
        efforts[free] = np.inf
        self.samples["effort"] = efforts.T[:_RESTING]
        return efforts
