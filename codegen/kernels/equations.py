"""Model -> Equations: one program per kernel, every intermediate bound as it arises."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from eomgen.errors import InputError
from eomgen.robot.elements import KINDS, Spring
from eomgen.robot.model import Model

from ..program.ir import Program, finish
from ..program.passes import hoist_parameters, on_demand, run_passes
from ..program.shares import Shares
from .accelerations import implicit_step, step_has_rows
from .bodies import share_among_bodies
from .closed import led_by_modes
from .derivation import Derivation
from .derivatives.modal_slopes import bends
from .derivatives.programs import derive_derivative
from .derivatives.whole import by_columns
from .interface import describe_kernels
from .signatures import KERNELS, SIGNATURES, available, knows_turns
from .stages import PAIR_STAGES, STAGES, derive_pair_stage, derive_stage, stage_has_rows
from .writers import DESCRIPTION_FRAMES, VARIANTS, WRITERS

DIVISION = 8  # a division takes about as long as so many products
SOLUTIONS = 6  # of a matrix that is factored once: stages of a step
NEEDS = {
    "loops": "[[loops]]",
    "springs": "[[springs]]",
    "elements": " or ".join(f"[[{table}]]" for table, kind in KINDS.items() if kind is not Spring),
    "constraints": "rigid [[loops]] or [[couplings]]",
    "cuts": "rigid [[loops]]",
    "laws": "forces in cut joints or couplings",
    "followers": "rigid [[couplings]] whose followers are no coordinates",
    "drives": "coordinates with a table drive",
    "sensors": "sensors (eomgen.control.Measurement)",
}
SMALL = ("springs", "elements", "laws", "drives")  # needs of kernels that come with any
STRAIGHT_COLUMNS = 12000  # up to so many operations all columns are written out, above it is a loop over them


class _Writes(Protocol):
    """Derive programs by their names, which solve for rows."""

    def __call__(self, d: Derivation, *, by_leaders: bool) -> dict[str, Program]: ...


def _derive_step(d: Derivation, *, by_leaders: bool) -> dict[str, Program]:
    """Derive the program of a linearly implicit step, by its name."""
    return {"implicit_step": run_passes(finish(d.graph, "implicit_step", implicit_step(d, by_leaders=by_leaders)))}


WITH_ROWS: Mapping[str, tuple[_Writes, Callable[[Derivation], bool]]] = {
    "implicit_step": (_derive_step, step_has_rows),
    **dict.fromkeys(STAGES, (derive_stage, stage_has_rows)),
    **dict.fromkeys(PAIR_STAGES, (derive_pair_stage, stage_has_rows)),
}


@dataclass(frozen=True)
class Equations:
    """The programs of a model: ``kernels`` are those a user may call, ``programs`` what is written out in C.

    ``setup`` computes what depends on parameters alone; ``calls`` holds, by name, the kernels that are no programs but
    templates, with the programs that their C calls; ``choices`` says which variant was taken where there are several;
    ``shares`` are what a program of frames is written out as, by its name; ``interface`` is what users see, of
    ``describe_kernels``; ``dtype`` is that of the numbers that the C computes with.
    """

    model: Model
    kernels: tuple[str, ...]
    setup: Program
    programs: Mapping[str, Program]
    calls: Mapping[str, tuple[str, ...]]
    choices: Mapping[str, str]
    shares: Mapping[str, Shares]
    interface: Mapping[str, Any]
    dtype: str = "float64"


def why_missing(kernel: str, model: Model) -> str:
    """Say what a robot would have to have for a kernel that is not among those available for it."""
    return f"is for robots with {NEEDS[KERNELS[kernel].needs]}, and {model.name} has none"


def derive_equations(model: Model, kernels: Sequence[str] = (), dtype: str = "float64") -> Equations:
    """Derive a model's equations: one program per kernel, with every pass run.

    Args:
        dtype: of the numbers that the C computes with; loops are solved for its precision.
        kernels: names of KERNELS; all that there are for the model if empty, but derivatives and what is there by
            request alone.  Those of point-to-point springs and of forces in cut joints come with any: they are small,
            and integrations choose method and step by them.

    Raises:
        InputError: a kernel of loops or springs is asked for, but the robot has none.
    """
    known = available(model)
    for name in kernels:
        if name not in known:
            raise InputError(f"kernels: {name!r} {why_missing(name, model)}")
    usual = [name for name in known if not (KERNELS[name].derivative_of or KERNELS[name].by_request)]
    wanted = kernels or usual
    small = {name for name in usual if KERNELS[name].needs in SMALL}
    public = tuple(name for name in known if name in wanted or name in small)
    interface = describe_kernels(model, public, dtype)
    raw: dict[str, Program] = {}
    derived: dict[str, Program] = {}  # what several derivatives are of
    calls: dict[str, tuple[str, ...]] = {}
    choices: dict[str, str] = {}
    for name in public:
        signature = KERNELS[name]
        if signature.closed and model.constraints:
            calls[name] = signature.closed
        elif name in VARIANTS and signature.calls:
            if candidates := _candidates(model, name, dtype=dtype):
                raw[name], choices[name] = _cheapest(candidates)
                continue
            calls[name] = signature.calls
        elif signature.calls:
            calls[name] = signature.calls
        elif signature.columns_of and _takes_columns(model, signature.columns_of, raw):
            calls[name] = (signature.columns_of,)
            words = signature.columns_of.replace("_", " ").capitalize()
            choices[name] = f"a loop in C, one {words} per unit velocity"
        if model.drives and "residual_jacobian" in calls.get(name, ()):
            calls[name] = (*calls[name], "drive_jacobian")
        for program in calls.get(name, (name,)):
            if program in raw:
                continue
            if program in WITH_ROWS:
                raw |= _derived_with_rows(model, program, dtype)
            elif program in VARIANTS:
                raw[program], choices[program] = derive_cheapest(model, program, dtype=dtype)
            else:
                raw[program] = derive(model, program, dtype, derived)
    setup, programs = hoist_parameters(list(raw.values()), len(model.parameters) + len(model.turning))
    written = dict(zip(raw, programs, strict=True))
    shares = {name: share_among_bodies(model, written[name]) for name in public if KERNELS[name].kind == "frames"}
    return Equations(model, public, setup, written, calls, choices, shares, interface, dtype)


def _takes_columns(model: Model, kernel: str, known: Mapping[str, Program]) -> bool:
    """Whether all columns of a kernel written out would be too long."""
    return columns_cost(model, known.get(kernel) or derive(model, kernel)) > STRAIGHT_COLUMNS


def columns_cost(model: Model, column: Program) -> int:
    """Count operations of n calls of a program: an upper bound for all its columns written out."""
    return len(model.coordinates) * sum(column.count().values())


def derive(model: Model, kernel: str, dtype: str = "float64", known: dict[str, Program] | None = None) -> Program:
    """Derive the program of one entry of WRITERS or VARIANTS, or of a derivative.

    Args:
        known: programs of this model and dtype by name; those that are derived on the way are added.
    """
    known = {} if known is None else known
    if kernel not in known:
        known |= _derived(model, kernel, dtype, known)
    return known[kernel]


def _derived(model: Model, kernel: str, dtype: str, known: dict[str, Program]) -> dict[str, Program]:
    """Derive the program, with those that come with it."""
    if kernel in VARIANTS:
        candidates = _candidates(model, kernel, dtype=dtype)
        if not candidates:
            return {kernel: by_columns(model, kernel, lambda name: derive(model, name, dtype, known))}
        return {kernel: _cheapest(candidates)[0]}
    if kernel in WITH_ROWS:
        return _derived_with_rows(model, kernel, dtype)
    if SIGNATURES[kernel].derivative_of:
        return {kernel: derive_derivative(model, kernel, lambda name: derive(model, name, dtype, known))}
    regrouped, turned = kernel not in DESCRIPTION_FRAMES, knows_turns(kernel, model)
    states = SIGNATURES[kernel].states
    derivation = Derivation(model, regrouped=regrouped, dtype=dtype, turned=turned, states=states)
    return {kernel: run_passes(finish(derivation.graph, kernel, WRITERS[kernel](derivation)))}


def _derived_with_rows(model: Model, kernel: str, dtype: str) -> dict[str, Program]:
    """Derive what solves for the rows of a step; of robots that bend by their leaders' matrix, too: what costs less."""
    write, has_rows = WITH_ROWS[kernel]

    def fresh() -> Derivation:
        return Derivation(model, dtype=dtype, turned=kernel not in WRITERS or knows_turns(kernel, model))

    programs, d = write(fresh(), by_leaders=False), fresh()
    if not (bends(d) and led_by_modes(d) and has_rows(d)):
        return programs
    return min((programs, write(fresh(), by_leaders=True)), key=_cost_of_step)


def derive_cheapest(model: Model, kernel: str, chosen: str = "", dtype: str = "float64") -> tuple[Program, str]:
    """Derive the program of a kernel with several variants; return it with its variant's name in VARIANTS.

    Args:
        chosen: the variant; the one that costs least if empty.
    """
    return _cheapest(_candidates(model, kernel, chosen, dtype))


def _cheapest(candidates: Sequence[tuple[Program, str]]) -> tuple[Program, str]:
    return min(candidates, key=lambda candidate: _cost(candidate[0]))


def _candidates(model: Model, kernel: str, chosen: str = "", dtype: str = "float64") -> list[tuple[Program, str]]:
    """Derive the programs of all variants that suit the model, or of the chosen one."""
    candidates = []
    for name, variant in VARIANTS[kernel].items():
        is_long = variant.most is not None and model.size > variant.most
        if name != chosen and (chosen or is_long):
            continue
        derivation = Derivation(model, dtype=dtype, turned=knows_turns(kernel, model))
        if (variant.prescribes or not derivation.model.prescribed) and (chosen or variant.suits(derivation)):
            program = run_passes(finish(derivation.graph, kernel, variant.write(derivation)))
            candidates.append((on_demand(program) if variant.on_demand else program, name))
    return candidates


def _cost_of_step(programs: Mapping[str, Program]) -> int:
    """Count operations of programs of a step; of two the latter is for its stages."""
    return sum(_cost(program) * (SOLUTIONS if place else 1) for place, program in enumerate(programs.values()))


def _cost(program: Program) -> int:
    """Count operations, a division as DIVISION of them."""
    count = program.count()
    return count["mul"] + count["add"] + DIVISION * count["div"]
