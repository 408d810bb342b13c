"""All kernels of a robot's text for accelerators in the languages that run here, beside the robot's C, to the bit.

What the C says of one state, its status included, is taken from its functions as they are, whatever the kernel.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eomgen.codegen.kernels.signatures import OWN_KERNELS, shapes
from eomgen.codegen.simt.kernels import CONTROLLED, FRAMES, ROLLOUTS, derive_kernels, refusal
from eomgen.codegen.simt.sources import render_simt
from eomgen.errors import ArrayError, LoopError, SingularError
from eomgen.kernel.complete import Kernel
from eomgen.robot.model import Model, build_model
from eomgen.robot.value import Robot
from tests.support import simt
from tests.support.random_robots import State, span, with_internal_states

ROUNDED = {"exp", "log", "atan2"}  # operations whose last bits are the device's
CLOSING = ("settling", "cut_poses", "constraint", "constraint_jacobian")  # what assembles loops
PRODUCTS = ("tangent", "adjoint")  # of Jacobians with vectors
DIFFERENTIATED = ("inverse_dynamics", "forward_dynamics", "tree_inverse_dynamics", "constrained_dynamics")
MOST = 20_000  # numbers of a state that a kernel may write; of Christoffel symbols n^3
CLOSE = {"float64": 1e-13, "float32": 1e-5}  # by the largest number of a result
HELD = tuple(name for name in ROLLOUTS if name not in CONTROLLED)  # under held drives; others have tests of their own
ALL = ("c++", "opencl")
Array = NDArray[Any]


@dataclass(frozen=True)
class Answer:
    """What a kernel of the text said in a language beside the robot's C.

    kernel, language: their names.
    difference: the largest one by the largest number of the result; 0 where all bits are the same.
    statuses: whether the same states fail.
    close: how large it may be: 0, or rounding of functions of laws that are the device's.
    failed: how many of the states failed.
    """

    kernel: str
    language: str
    difference: float
    statuses: bool
    close: float
    failed: int

    @property
    def is_right(self) -> bool:
        """Whether the difference is no larger, and statuses are the same."""
        return self.statuses and self.difference <= self.close


def chosen_kernels(model: Model) -> tuple[str, ...]:
    """Name the kernels that a text may have of a model: its own ones, and products with Jacobians of its dynamics."""
    size, known = shapes(model), [*FRAMES, *HELD, *OWN_KERNELS]
    known += [f"{name}_{product}" for name in DIFFERENTIATED for product in PRODUCTS]
    able = [name for name in known if refusal(model, name) is None]
    return tuple(name for name in able if name not in OWN_KERNELS or _written(size, name) <= MOST)


def refusals(model: Model) -> dict[str, str]:
    """Say of every kernel of its own that a text has not of a model why that is."""
    size, found = shapes(model), dict[str, str]()
    for name in (*FRAMES, *HELD, *OWN_KERNELS):
        text = refusal(model, name)
        if text is not None:
            found[name] = text
        elif name in OWN_KERNELS and _written(size, name) > MOST:
            found[name] = f"writes {_written(size, name):,} numbers of a state, and was left out"
    return found


def _written(size: Mapping[str, tuple[int, ...]], name: str) -> int:
    return math.prod(size[OWN_KERNELS[name].writes])


@dataclass(frozen=True)
class Near:
    """A state of a closed mechanism, (n,) each, near which others are assembled."""

    q: Array
    v: Array


class Subject:
    """A robot's text and its C, compiled.

    made: kernels of the text as C++.
    kernel: the robot's C.
    states: arrays of states by their names.
    names: of all kernels that are compared.
    """

    def __init__(
        self, robot: Robot, dtype: str, folder: Path, kernels: Sequence[str] = (), near: Near | None = None
    ) -> None:
        self.robot, self.model = robot, build_model(robot)
        self.names = tuple(kernels) or chosen_kernels(self.model)
        self.source, self.folder = render_simt(self.model, self.names, dtype), folder
        self.made = simt.Compiled(self.source, folder)
        own = (*self.names, *CLOSING) if self.model.constraints else self.names
        self.kernel = simt.built(robot, own, dtype)
        programs = {x.name: x.program for x in derive_kernels(self.model, self.names, dtype).kernels}
        self.rounded = {name for name, x in programs.items() if any(y.op in ROUNDED for y in x.instructions)}
        self.states = _states(self, near)

    def arrays(self, name: str) -> list[Array]:
        """Return what a kernel reads of the states; what they do not have is drawn."""
        reads, drawn = self.made.meta["kernels"][name]["reads"], simt.states(self.made.meta, name, seed=len(name))
        made = {label: np.array(self.states.get(label, x), x.dtype) for label, x in zip(reads, drawn, strict=True)}
        if name in ROLLOUTS and "forces" in made:
            made["forces"][:] = 0.0  # as in rollouts of kernels
        return list(made.values())

    def answers(self, languages: Sequence[str] = ALL) -> Iterator[Answer]:
        """Run all kernels in these languages beside the C."""
        for name in self.names:
            arrays, numbers = self.arrays(name), simt.scalars(self.made.meta, name)
            wanted, failed = expected(self.kernel, name, arrays)
            for language in languages:
                found, status = self._run(language, name, arrays, numbers)
                yield Answer(
                    name,
                    language,
                    difference(found, wanted, ~failed),
                    bool(np.array_equal(status != 0, failed)),
                    CLOSE[str(self.kernel.dtype)] if name in self.rounded and language != "c++" else 0.0,
                    int(failed.sum()),
                )

    @cached_property
    def opencl(self) -> simt.Compiled:
        """Kernels of the text by OpenCL; compiled when they are asked for."""
        return simt.Compiled(self.source, self.folder, "opencl")

    def _run(
        self, language: str, name: str, arrays: Sequence[Array], numbers: Mapping[str, float]
    ) -> tuple[Any, Array]:
        if language == "cuda":
            return self._on_cuda(name, arrays, numbers)
        made = self.opencl if language == "opencl" else self.made
        return made.run(name, *arrays, **numbers), made.status

    def _on_cuda(self, name: str, arrays: Sequence[Array], numbers: Mapping[str, float]) -> tuple[Any, Array]:
        """Run a method of the kernel's device, whose checks say of states one by one whether they are well."""
        device = self.kernel.device("cuda")
        method, status = getattr(device, name), np.zeros(len(arrays[0]), np.int32)
        device.checks = False
        made = method(*map(device.put, arrays), **numbers)
        found = tuple(map(device.get, made)) if isinstance(made, tuple) else device.get(made)
        device.checks = True
        for k in range(len(status)):
            try:
                method(*(device.put(x[k : k + 1]) for x in arrays), **numbers)
            except (ArrayError, LoopError, SingularError) as error:
                status[k] = "out of numbers that are finite" not in str(error)  # which C says by no status
        return found, status


def _states(subject: Subject, near: Near | None) -> dict[str, Array]:
    """Draw states of a robot: principal coordinates far, others near; on closed loops, moving, where it has some."""
    model, kernel, rng = subject.model, subject.kernel, np.random.default_rng(42)
    near_bending = 0.2 if any(body.modes for body in model.bodies) else 1.0  # as far as modes of second order reach
    spans = [near_bending * span(subject.robot, name) for name in model.coordinates]
    drawn = []
    for _ in range(simt.COUNT):
        q, *others = rng.uniform(-1.0, 1.0, (4, len(spans)))
        drawn.append(with_internal_states(subject.robot, State(q * spans, *(2.0 * x for x in others)), rng))
    labels = ("q", "v", "a", "u", "z", "forces")
    states = {label: np.stack([getattr(s, label) for s in drawn]).astype(kernel.dtype) for label in labels}
    if model.constraints:
        q, v = states["q"], states["v"]
        guess = (np.asarray(model.home) if near is None else near.q) + 0.1 * np.clip(q, -1.0, 1.0)
        q[:] = kernel.assemble(guess.astype(kernel.dtype))
        v[:] = kernel.project_velocity(q, v if near is None else (near.v + 0.1 * v).astype(kernel.dtype))
    return states


def expected(kernel: Kernel, name: str, arrays: Sequence[Array]) -> tuple[Any, Array]:
    """Return what the robot's C says of states, one by one, and which ones failed."""
    if name in ROLLOUTS:
        return _rolled(kernel, name, arrays), np.zeros(len(arrays[0]), bool)
    function = kernel.raw.functions[FRAMES[name][0] if name in FRAMES else name]
    frames: Sequence[tuple[int, ...]] = [(k,) for k in range(len(kernel.frames))] if name in FRAMES else [()]
    count, shape, view = len(arrays[0]), kernel.raw.shapes[function.writes], kernel.raw.view
    h = kernel.parameters.setup.pointer(function.library)
    made, failed = np.zeros((count, len(frames), *shape), kernel.dtype), np.zeros(count, bool)
    rows = [np.ascontiguousarray(x) for x in arrays]
    for k in range(count):
        for place, frame in enumerate(frames):
            status = function.code(h, *(view(x[k]) for x in rows), *frame, view(made[k, place]))
            failed[k] |= status != 0
    if name == "frame_poses":
        return made.reshape(count, len(frames), -1, 4)[:, :, :3], failed  # without the row 0, 0, 0, 1
    return made if name in FRAMES else made[:, 0], failed


def _rolled(kernel: Kernel, name: str, arrays: Sequence[Array]) -> tuple[Array, ...]:
    """Return where the kernel's steps lead: q, v and, where there are some, internal states."""
    q, v, *z, u = arrays[: 4 if kernel.internal_states else 3]
    given = {"z": z[0]} if z else {}
    made = kernel.rollout(q, v, u, dt=simt.STEP, steps=3, method=name.removesuffix("_rollout"), **given)
    return tuple(x[:, -1] for x in (*made, *([made.z] if z else [])))


def difference(found: Any, wanted: Any, well: Array) -> float:
    """Return the largest difference of states that are well, by the largest number that is expected."""
    if isinstance(wanted, tuple):
        return max(difference(x, y, well) for x, y in zip(found, wanted, strict=True))
    one, other = found[well].ravel(), wanted[well].ravel()
    if simt.same_bits(one, other):
        return 0.0
    if not np.array_equal(np.isfinite(one), np.isfinite(other)):
        return math.inf
    finite = np.isfinite(other)
    size = np.abs(other[finite]).max(initial=0.0)
    return float(np.abs(one[finite] - other[finite]).max(initial=0.0) / (size or 1.0)) or math.inf
