"""Model -> Equations: one program per kernel, every intermediate bound as it arises."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from eomgen.errors import InputError
from eomgen.robot.model import Model

from ..program.forward_mode import tangent
from ..program.ir import Program, finish
from ..program.passes import hoist_parameters, run_passes
from .accelerations import FACTORISED, SOLVERS
from .derivation import Derivation
from .signatures import KERNELS, RATES, SPRING_KERNELS, available
from .writers import DESCRIPTION_FRAMES, WRITERS

STRAIGHT_SOLVE = 12  # up to so many coordinates the factorisation is tried beside the elimination
DIVISION = 8  # a division takes about as long as so many products
STRAIGHT_CHRISTOFFEL = 12000  # up to so many operations the tensor is written out, above it is a loop over columns


@dataclass(frozen=True)
class Equations:
    """The programs of a model: ``kernels`` are those a user may call, ``programs`` what is written out in C.

    ``setup`` computes what depends on parameters alone; ``loops`` names the kernels whose C calls another kernel in a
    loop, because a straight-line program would be too long; ``choices`` says which way was taken where there are two.
    """

    model: Model
    kernels: tuple[str, ...]
    setup: Program
    programs: Mapping[str, Program]
    loops: frozenset[str]
    choices: Mapping[str, str]


def derive_equations(model: Model, kernels: Sequence[str] = ()) -> Equations:
    """Model -> Equations, with every pass run.

    Args:
        kernels: names of KERNELS; all that there are for the model but tangents if empty.  Those of springs between
            points come with any: they are small, and integrations choose method and step by them.

    Raises:
        InputError: a kernel of loops or springs is asked for, but the robot has none.
    """
    known = available(model)
    for name in kernels:
        if name not in known:
            what = "springs" if name in SPRING_KERNELS else "loops"
            raise InputError(f"kernels: {name!r} is for robots with [[{what}]], and {model.name} has none")
    wanted = kernels or [name for name in known if not KERNELS[name].tangent_of]
    public = tuple(name for name in known if name in wanted or name in SPRING_KERNELS)
    raw: dict[str, Program] = {}
    loops: set[str] = set()
    choices: dict[str, str] = {}

    def need(*names: str) -> None:
        for name in names:
            if name in raw:
                continue
            if name == "forward_dynamics":
                raw[name], choices[name] = derive_forward_dynamics(model)
            else:
                raw[name] = derive(model, name)

    for name in public:
        if KERNELS[name].calls:
            need(*KERNELS[name].calls)
            loops.add(name)
        elif name == "christoffel" and _columns_cost(model, raw) > STRAIGHT_CHRISTOFFEL:
            need("coriolis_matrix")
            loops.add(name)
            choices[name] = "a loop in C, one Coriolis matrix per unit velocity"
        else:
            need(name)
    setup, programs = hoist_parameters(list(raw.values()), len(model.parameters))
    return Equations(model, public, setup, dict(zip(raw, programs, strict=True)), frozenset(loops), choices)


def _columns_cost(model: Model, known: Mapping[str, Program]) -> int:
    """Operations of n Coriolis matrices: an upper bound for the written-out tensor."""
    program = known.get("coriolis_matrix") or derive(model, "coriolis_matrix")
    return model.size * sum(program.count().values())


def derive(model: Model, kernel: str) -> Program:
    """The program of one entry of WRITERS, or of forward dynamics by the solver that costs least."""
    if kernel == "forward_dynamics":
        return derive_forward_dynamics(model)[0]
    if kernel in KERNELS and KERNELS[kernel].tangent_of:
        return run_passes(tangent(derive(model, KERNELS[kernel].tangent_of), RATES, kernel))
    derivation = Derivation(model, regrouped=kernel not in DESCRIPTION_FRAMES)
    return run_passes(finish(derivation.graph, kernel, WRITERS[kernel](derivation)))


def derive_forward_dynamics(model: Model, solver: str = "") -> tuple[Program, str]:
    """The program of forward dynamics, and the name of its solver in SOLVERS.

    Args:
        solver: which one; the one that costs least if empty.
    """
    candidates = []
    for name, write in SOLVERS.items():
        derivation = Derivation(model)
        if name == FACTORISED and (derivation.model.prescribed or (not solver and model.size > STRAIGHT_SOLVE)):
            continue  # M would have to be divided by what is known; or its program would be long
        if solver in ("", name):
            program = run_passes(finish(derivation.graph, "forward_dynamics", write(derivation)))
            candidates.append((program, name))
    return min(candidates, key=lambda candidate: _cost(candidate[0]))


def _cost(program: Program) -> int:
    """Operations, a division as DIVISION of them."""
    count = program.count()
    return count["mul"] + count["add"] + DIVISION * count["div"]
