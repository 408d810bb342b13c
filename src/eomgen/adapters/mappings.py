"""Kernels as differentiable functions of arrays: which there are, and their exact first derivatives."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

from numpy.typing import NDArray

from ..errors import InputError, UnknownNameError
from ..runtime.kernel import Kernel
from . import rules

Array = NDArray[Any]


@dataclass(frozen=True)
class Entry:
    """A function of FUNCTIONS.

    reads: arrays that it reads.
    result: name of its result.
    kernels: what it and its derivatives take.
    rule: how its derivatives follow from these.
    calls: the kernel's function whose result it is, or a part of whose result; by default that of its own name.
    """

    reads: tuple[str, ...]
    result: str
    kernels: tuple[str, ...]
    rule: rules.Rule
    calls: str = ""


_CONSTRAINED = ("constrained_dynamics", "constrained_dynamics_tangent")
FUNCTIONS: Mapping[str, Entry] = MappingProxyType(
    {
        "residual": Entry(
            ("q", "v", "a", "u"),
            "r",
            ("residual", "residual_jacobian"),
            rules.ResidualRule("residual_jacobian"),
        ),
        "inverse_dynamics": Entry(
            ("q", "v", "a"),
            "u",
            ("inverse_dynamics", "residual_jacobian"),
            rules.ByKernel("residual_jacobian"),
        ),
        "forward_dynamics": Entry(
            ("q", "v", "u"),
            "a",
            ("forward_dynamics", "forward_dynamics_jacobian"),
            rules.ByKernel("forward_dynamics_jacobian"),
        ),
        "mass_matrix": Entry(("q",), "M", ("mass_matrix", "christoffel"), rules.MatrixRule()),
        "bias_force": Entry(
            ("q", "v"), "b", ("bias_force", "generalized_force", "residual_jacobian"), rules.BiasRule()
        ),
        "generalized_force": Entry(("q", "v"), "Q", ("generalized_force", "residual_jacobian"), rules.ForceRule()),
        "external_force": Entry(
            ("q", "wrench"), "Q", ("external_force", "external_force_tangent"), rules.TangentRule()
        ),
        "energy": Entry(("q", "v"), "E", ("energy", "energy_tangent"), rules.EnergyRule()),
        "frame_pose": Entry(("q",), "A", ("kinematics",), rules.PoseRule()),
        "frame_jacobian": Entry(("q",), "J", ("kinematics",), rules.FrameJacobianRule()),
        "constraint": Entry(("q",), "g", ("constraint", "constraint_jacobian"), rules.ByKernel("constraint_jacobian")),
        "constraint_jacobian": Entry(
            ("q",), "G", ("constraint_jacobian", "constraint_jacobian_tangent"), rules.TangentRule()
        ),
        "constraint_forces": Entry(
            ("q", "v", "u"), "f", _CONSTRAINED, rules.ConstrainedRule("constraints", 1), "constrained_dynamics"
        ),
    }
)
CLOSED: Mapping[str, Entry] = MappingProxyType(  # in their place where a robot has loops or rigid couplings
    {
        "forward_dynamics": Entry(
            ("q", "v", "u"), "a", _CONSTRAINED, rules.ConstrainedRule("vector", 0), "constrained_dynamics"
        ),
        "inverse_dynamics": Entry(
            ("q", "v", "a"),
            "u",
            ("constrained_drives", "constrained_drives_tangent"),
            rules.ConstrainedRule("vector", 0),
            "constrained_drives",
        ),
    }
)
CUT: Mapping[str, Entry] = MappingProxyType(  # and where these are meant to be open
    {
        "forward_dynamics": Entry(
            ("q", "v", "u"),
            "a",
            ("tree_forward_dynamics", "tree_forward_dynamics_jacobian"),
            rules.ByKernel("tree_forward_dynamics_jacobian"),
            "tree_forward_dynamics",
        ),
        "inverse_dynamics": Entry(
            ("q", "v", "a"),
            "u",
            ("tree_inverse_dynamics", "residual_jacobian"),
            rules.ByKernel("residual_jacobian"),
            "tree_inverse_dynamics",
        ),
    }
)
FRAMES = tuple(name for name, entry in FUNCTIONS.items() if entry.rule.framed)


def kernels_for(*names: str, closed: bool = False, cut: bool = False) -> tuple[str, ...]:
    """Names of the kernels that these functions and their derivatives need, for ``eomgen.build(robot, kernels=...)``.

    Args:
        names: of FUNCTIONS.
        closed: of a robot with loops or rigid couplings.
        cut: of one whose loops are meant to be open.

    Raises:
        UnknownNameError: not one of FUNCTIONS.
    """
    return tuple(dict.fromkeys(kernel for name in names for kernel in _entry(name, closed or cut, cut).kernels))


def _entry(name: str, closed: bool, cut: bool) -> Entry:
    if name not in FUNCTIONS:
        raise UnknownNameError(f"function: {name!r} is unknown; allowed: {', '.join(FUNCTIONS)}")
    others: Mapping[str, Entry] = (CUT if cut else CLOSED) if closed else {}
    return others.get(name, FUNCTIONS[name])


class DifferentiableFunction:
    """A kernel's function with its derivatives, on NumPy arrays; the parameters are those that the kernel has now.

    Attributes:
        kernel: with parameters of its own.
        name: one of FUNCTIONS.
        frame: of frame_pose and frame_jacobian.
        rule: how derivatives follow.
        calls: the kernel's function that has the result, or a part of it.
        reads, result: names of what it takes and of what it gives.
        inputs: shapes of what it takes; output: that of its result.
        idle: what the kernel's function reads behind that, which is 0 here.
        free: of bias_force and generalized_force the kernel without any force; else None.

    Raises:
        UnknownNameError: no function or frame of that name, or a kernel that it takes was not built.
        InputError: a frame is missing or not wanted.
    """

    def __init__(self, kernel: Kernel, name: str, frame: str | None = None, *, cut: bool = False) -> None:
        entry = _entry(name, bool(kernel.constraints), cut)
        missing = [needed for needed in entry.kernels if needed not in kernel.operations]
        if missing:
            raise UnknownNameError(
                f"{name}: {kernel.name} was built without {', '.join(missing)}; allowed: kernels={entry.kernels!r}"
            )
        if entry.rule.framed != (frame is not None):
            wanted = f"one of {', '.join(kernel.frames)}" if entry.rule.framed else "none"
            raise InputError(f"frame: {name} got {frame!r}; allowed: {wanted}")
        self.kernel, self.name, self.frame, self.rule = kernel.together(*entry.kernels), name, frame, entry.rule
        self._extra = () if frame is None else (kernel.frame_index(frame),)
        self.reads, self.result, self.calls = entry.reads, entry.result, entry.calls or name
        shapes = kernel.raw.shapes
        self.inputs: tuple[tuple[int, ...], ...] = tuple(shapes[label] for label in entry.reads)
        called = kernel.raw.functions[self.calls].reads
        self.idle: tuple[str, ...] = tuple(label for label in called if label not in entry.reads)
        self.output: tuple[int, ...] = shapes[entry.rule.writes or kernel.raw.functions[self.calls].writes]
        self.free = rules.without_forces(self.kernel) if entry.rule.needs_free else None

    def value(self, *arrays: Array) -> Array:
        """The kernel's result, for one state or a batch."""
        written = self.kernel.calls.run(self.calls, None, (*arrays, *rules.nothing(self)), self._extra)
        return self.rule.part(self, written)

    def derivatives(self, *arrays: Array) -> tuple[Array, ...]:
        """Exact derivatives by every argument: (output shape, input shape), behind the batch's axis."""
        return self.rule.derivatives(self, *arrays)

    def patterns(self) -> tuple[Array, tuple[Array, ...]]:
        """Sparsity of the result and its derivatives: True where they may differ from zero, shapes as of one state."""
        whole, blocks = self.rule.patterns(self)
        return whole, tuple(blocks)
