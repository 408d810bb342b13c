"""Kernels as differentiable functions of arrays: which there are, and their exact first derivatives."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

from numpy.typing import NDArray

from ..errors import InputError, UnknownNameError
from ..runtime.calls import TREE
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
    passes_loops: whether forces in the loops of a robot are part of it; then there is one of the open tree, too.
    """

    reads: tuple[str, ...]
    result: str
    kernels: tuple[str, ...]
    rule: rules.Rule
    passes_loops: bool = False


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
            passes_loops=True,
        ),
        "forward_dynamics": Entry(
            ("q", "v", "u"),
            "a",
            ("forward_dynamics", "forward_dynamics_jacobian"),
            rules.ByKernel("forward_dynamics_jacobian"),
            passes_loops=True,
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
    }
)
CLOSED = ("inverse_dynamics", "forward_dynamics", "forward_dynamics_jacobian")  # that there are of the tree, too
FRAMES = tuple(name for name, entry in FUNCTIONS.items() if entry.rule.framed)


def kernels_for(*names: str) -> tuple[str, ...]:
    """Names of the kernels that these functions and their derivatives need, for ``eomgen.build(robot, kernels=...)``.

    Raises:
        UnknownNameError: not one of FUNCTIONS.
    """
    return tuple(dict.fromkeys(kernel for name in names for kernel in _entry(name).kernels))


def _entry(name: str) -> Entry:
    if name not in FUNCTIONS:
        raise UnknownNameError(f"function: {name!r} is unknown; allowed: {', '.join(FUNCTIONS)}")
    return FUNCTIONS[name]


def _of_tree(entry: Entry) -> Entry:
    """The entry of the same function of a robot with its loops cut."""
    kernels = tuple(f"{TREE}{name}" if name in CLOSED else name for name in entry.kernels)
    by = entry.rule.kernel
    return replace(entry, kernels=kernels, rule=rules.ByKernel(f"{TREE}{by}" if by in CLOSED else by))


class DifferentiableFunction:
    """A kernel's function with its derivatives, on NumPy arrays; the parameters are those that the kernel has now.

    Attributes:
        kernel: with parameters of its own.
        name: one of FUNCTIONS.
        frame: of frame_pose and frame_jacobian.
        rule: how derivatives follow.
        reads, result: names of what it takes and of what it gives.
        inputs: shapes of what it takes; output: that of its result.
        free: of bias_force and generalized_force the kernel without any force; else None.

    Raises:
        UnknownNameError: no function or frame of that name, or a kernel that it takes was not built.
        InputError: a frame is missing or not wanted; the robot has loops that are not to be open.
    """

    def __init__(self, kernel: Kernel, name: str, frame: str | None = None, *, cut: bool = False) -> None:
        entry = _entry(name)
        if entry.passes_loops and kernel.loops:
            kernel.refuse_loops(name, cut=cut)
            name, entry = f"{TREE}{name}", _of_tree(entry)
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
        self.reads, self.result = entry.reads, entry.result
        shapes = kernel.raw.shapes
        self.inputs: tuple[tuple[int, ...], ...] = tuple(shapes[label] for label in entry.reads)
        self.output: tuple[int, ...] = shapes[kernel.raw.functions[name].writes]
        self.free = rules.without_forces(self.kernel) if entry.rule.needs_free else None

    def value(self, *arrays: Array) -> Array:
        """The kernel's result, for one state or a batch."""
        return self.kernel.calls.run(self.name, None, arrays, self._extra)

    def derivatives(self, *arrays: Array) -> tuple[Array, ...]:
        """Exact derivatives by every argument: (output shape, input shape), behind the batch's axis."""
        return self.rule.derivatives(self, *arrays)

    def patterns(self) -> tuple[Array, tuple[Array, ...]]:
        """Sparsity of the result and its derivatives: True where they may differ from zero, shapes as of one state."""
        whole, blocks = self.rule.patterns(self)
        return whole, tuple(blocks)
