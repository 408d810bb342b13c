"""Model -> programs of the kernels that one thread computes of one state, straight from the first value to the last."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from eomgen.errors import InputError, UnknownNameError
from eomgen.names import nearest_or_all, show
from eomgen.robot.model import Model

from ..kernels.derivatives.whole import whole_program
from ..kernels.derived import FRAMED, METHODS
from ..kernels.equations import STRAIGHT_COLUMNS, columns_cost, derive, why_missing
from ..kernels.groups import DEVICE
from ..kernels.signatures import CLOSED_PROGRAMS, FRAME_KERNEL, KERNELS, available, shapes, signatures_of
from ..kernels.writers import VARIANTS, WRITERS
from ..program.ir import FIRST, GATE, Graph, Instruction, Program, Value, copied, finish, select, verify
from ..program.passes import hoist_parameters
from .frames import frame_jacobians
from .unit_velocities import christoffel_by_columns

FRAMES: Mapping[str, tuple[str, str, str]] = {  # kernels of all frames: functions of one, arrays, texts
    f"{function}s": (function, array, f"{signature.text.removesuffix('.')}; of all frames.")
    for function, signature in KERNELS[FRAME_KERNEL].functions.items()
    for array in [FRAMED[function]]
}
[EXPLICIT], [IMPLICIT] = METHODS["explicit"][2], METHODS["implicit"][2]  # programs that steps call
ROLLOUTS: Mapping[str, tuple[str, str]] = {  # steps of fixed length: programs that they call, texts
    "rk4_rollout": (EXPLICIT, "Steps of the classical Runge-Kutta method of order 4, drives held."),
    "implicit_rollout": (IMPLICIT, "Steps of the linearly implicit Euler method, drives held."),
    "rk4_pd_rollout": (EXPLICIT, "As rk4_rollout, under kp (target - q) - kd v beside the drives."),
    "implicit_pd_rollout": (IMPLICIT, "As implicit_rollout, under kp (target - q) - kd v beside the drives."),
}
COLUMNS = ("derivatives", "jacobians")  # arrays that are matrices of n columns
CONTROLLED = ("rk4_pd_rollout", "implicit_pd_rollout")  # rollouts with joint controllers on driven coordinates
DEFAULT = (*DEVICE, *FRAMES, *(name for name in ROLLOUTS if name not in CONTROLLED))
CLOSED = {name: program for name, program in CLOSED_PROGRAMS.items() if KERNELS[name].solves}
PARTS = tuple(dict.fromkeys((*CLOSED.values(), *CLOSED_PROGRAMS.values())))  # what there is, whatever is violated


@dataclass(frozen=True)
class ThreadKernel:
    """A kernel by which one thread computes one state.

    name: of the kernel.
    text: what it computes.
    program: its values; outputs are "out", and numbers in pairs that are checked beside each other: "pivot" for each
        coordinate that is solved for, "violation" for each constraint and for its rate.
    reads: shapes of the arrays that it reads.
    writes: shapes of those that it writes.
    scalars: numbers that it takes, the same for all states.
    has_columns: whether it writes matrices of n columns, which several functions may share.
    """

    name: str
    text: str
    program: Program
    reads: Mapping[str, tuple[int, ...]]
    writes: Mapping[str, tuple[int, ...]]
    scalars: tuple[str, ...] = ()
    has_columns: bool = False


@dataclass(frozen=True)
class ThreadKernels:
    """Kernels of a model, and ``setup``, which computes what depends on parameters alone: the array h of all."""

    model: Model
    setup: Program
    kernels: tuple[ThreadKernel, ...]


def derive_kernels(model: Model, names: Sequence[str] = (), dtype: str = "float64") -> ThreadKernels:
    """Derive kernels of a model by their names; those of DEFAULT that it has without any.

    Raises:
        UnknownNameError: there is no such kernel.
        InputError: a kernel is none of straight statements, or of something that the robot does not have.
    """
    chosen = tuple(dict.fromkeys(names)) or tuple(name for name in DEFAULT if refusal(model, name) is None)
    for name in chosen:
        if reason := refusal(model, name):
            raise InputError(f"kernels: {show(name)} {reason}")
    known: dict[str, Program] = {}

    def derived(kernel: str) -> Program:
        return derive(model, kernel, dtype, known)

    raw = [_program(model, name, derived) for name in chosen]
    setup, programs = hoist_parameters(raw, len(model.parameters) + len(model.turning))
    made = (_kernel(model, name, chosen, program) for name, program in zip(chosen, programs, strict=True))
    return ThreadKernels(model, setup, tuple(made))


def refusal(model: Model, name: str) -> str | None:
    """Say why there is no such kernel for a model; None where there is one.

    Raises:
        UnknownNameError: there is none of this name.
    """
    if name in FRAMES:
        return None if model.frames else "is for robots with frames"
    if name in ROLLOUTS:
        if name in CONTROLLED and not model.driven:
            return "is for robots with driven coordinates"
        return _refused_rollout(model)
    if name not in KERNELS.compiled:
        raise UnknownNameError(
            f"kernels: {show(name)} is unknown{nearest_or_all(name, [*FRAMES, *ROLLOUTS, *KERNELS.compiled])}"
        )
    signature = KERNELS[name]
    if name not in available(model):
        return why_missing(name, model)
    if signature.kind == "frames":
        return f"takes a frame's number; allowed: {', '.join(FRAMES)}"
    if signature.kind == "gradient":
        return "has steps and loops"
    checks_loops = bool(model.constraints) and KERNELS.get(signature.derivative_of or name, signature).closed != ()
    if checks_loops and name not in CLOSED:
        parts = ", ".join((*CLOSED, *(x for x in PARTS if x in available(model))))
        return f"of a closed mechanism checks and assembles loops state by state; allowed: {parts}"
    if name in VARIANTS and signature.kind == "composed" and not _has_variant(model, name):
        return f"of {model.name} solves in a loop; allowed: {' and '.join(signature.calls)}"
    if signature.derivative_of or name in WRITERS or name in VARIANTS:
        return None
    return "is no straight-line program, or steps whose number is not bounded"


def _refused_rollout(model: Model) -> str | None:
    if model.constraints:
        return f"of {model.name} assembles loops after every step, as often as it takes; allowed: {CLOSED[EXPLICIT]}"
    if model.turning:
        names = ", ".join(model.bodies[k].joint for k in model.turning)
        return f"of {model.name} switches charts of 3-DOF rotations ({names}); allowed: {EXPLICIT}"
    return None


def _has_variant(model: Model, name: str) -> bool:
    """Whether a kernel with variants is a program for a model, and no loop."""
    from ..kernels.derivation import Derivation

    derivation = Derivation(model)
    return any(
        (variant.most is None or model.size <= variant.most)
        and (variant.prescribes or not model.prescribed)
        and variant.suits(derivation)
        for variant in VARIANTS[name].values()
    )


def _program(model: Model, name: str, derived: Callable[[str], Program]) -> Program:
    """Derive the program of a kernel, without gates."""
    if name in ROLLOUTS:
        program = derived(ROLLOUTS[name][0])
        values = program.instructions if name in CONTROLLED else [_still(x) for x in program.instructions]
        return verify(select(name, values, program.outputs, {}, program.operations))
    if name in FRAMES:
        function, array, _ = FRAMES[name]
        if array == "jacobians":
            return frame_jacobians(model, derived(FRAME_KERNEL))
        return whole_program(model, function, derived)
    if name in CLOSED and model.constraints:
        return _with_violations(name, without_gate(derived(CLOSED[name])), model)
    columns = KERNELS[name].columns_of
    if columns and columns_cost(model, derived(columns)) > STRAIGHT_COLUMNS:
        return christoffel_by_columns(name, model, without_gate(derived(columns)))
    return without_gate(derived(name))


def _still(instruction: Instruction) -> Instruction:
    """Return a value without what controllers add to a step: drives are held."""
    is_added = instruction.op == "input" and instruction.leaf[0] == "added"
    return Instruction("const", (), 0.0) if is_added else instruction


def without_gate(program: Program) -> Program:
    """Return a program that computes what is behind its gate, too, and chooses: threads side by side do both anyway."""
    if (GATE, 0) not in program.outputs:
        return program
    graph = Graph()
    nodes = copied(graph, program)
    outputs = {key: nodes[index] for key, index in program.outputs.items() if key[0] not in (GATE, *FIRST)}
    gate = nodes[program.outputs[GATE, 0]]
    chosen: dict[tuple[str, int], Value] = dict(outputs)
    for (array, place), index in program.outputs.items():
        if array in FIRST:
            chosen[FIRST[array], place] = graph.choose(gate, outputs[FIRST[array], place], nodes[index])
    return verify(finish(graph, program.name, chosen))


def _with_violations(name: str, program: Program, model: Model) -> Program:
    """Keep accelerations of a closed mechanism, and compare what its loops violate, as ``check_constraints`` does."""
    rates, m, graph = model.size, len(model.constraints), Graph()
    nodes = copied(graph, program)
    outputs: dict[tuple[str, int], Value] = {
        key: nodes[index] for key, index in program.outputs.items() if key[0] == "pivot" or key < ("out", rates)
    }
    fastest: Value = 1.0

    def size_of(x: Value) -> Value:
        return graph.call("max", x, -x)

    for i in range(len(model.coordinates)):
        fastest = graph.call("max", fastest, size_of(graph.input("v", i)))
    for r in range(2 * m):
        outputs["violation", 2 * r] = size_of(nodes[program.outputs["out", rates + m + r]])
        outputs["violation", 2 * r + 1] = 1.0 if r < m else fastest
    return verify(finish(graph, name, outputs))


def _kernel(model: Model, name: str, chosen: Sequence[str], program: Program) -> ThreadKernel:
    """Describe a kernel beside its program."""
    known = shapes(model, [x for x in chosen if x in KERNELS.compiled])
    if name in FRAMES:
        _, array, text = FRAMES[name]
        found = {"q": known["q"]}, {"out": known[array]}
        return ThreadKernel(name, text, program, *found, has_columns=array in COLUMNS)
    if name in ROLLOUTS:
        reads = {x: known[x] for x in signatures_of(model)[ROLLOUTS[name][0]].reads if x not in ("added", "dt")}
        writes = {f"{x}_out": known[x] for x in ("q", "v", "z") if x in reads}
        if name in CONTROLLED:
            reads |= dict.fromkeys(("kp", "kd", "target"), (len(model.driven),))
        return ThreadKernel(name, ROLLOUTS[name][1], program, reads, writes, ("step", "steps"))
    signature = signatures_of(model)[name]
    reads = {array: known[array] for array in signature.reads}
    writes, has_columns = {"out": known[signature.writes]}, signature.writes in COLUMNS
    return ThreadKernel(name, signature.text, program, reads, writes, has_columns=has_columns)
