"""Which instructions of programs in single precision are worth double precision, by what they add to bounds.

A value adds the same to a bound whether the operation that makes it or a conversion rounds it, so that keeping it in
double takes its users into double, too.  Values are chosen one by one: the one that takes most off the outputs that are
still beyond what is wanted, by the operations that it brings into double.  What is chosen is then bounded anew, and
more is chosen where signs and choices, which round nothing in single precision, convert what they take.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..codegen.kernels.equations import Equations
from ..codegen.kernels.signatures import KERNELS
from ..codegen.program.ir import Program
from ..codegen.program.mixed import in_double, with_wide
from ..errors import InputError
from .adjoints import contributions
from .advice_result import vanishing
from .bounds import Ranges, enclosed, output_sizes
from .intervals import Array
from .whole import with_origins

PASSES = 4  # until nothing more is chosen: bounds of what is in double precision are worked out anew
AS_GOOD = 2.0  # times what results and stored parameters in single precision leave
LEAST = 2.0**-23  # what is wanted at least: the rounding of a result alone is half of it


def check_within(within: float | None, dtype: str) -> None:
    """Check what is wanted of results.

    Raises:
        InputError: it is no number from ``LEAST`` to 1, or numbers are not those of single precision.
    """
    if within is None:
        return
    if isinstance(within, bool) or not isinstance(within, (int, float)) or not LEAST <= within < 1.0:
        raise InputError(f"within: {within!r}; allowed: an error by the size of results, from {LEAST:.1e} to 1")
    if dtype != "float32":
        raise InputError(f"within: given with dtype {dtype!r}; allowed: with 'float32'")


def mixable(equations: Equations) -> tuple[str, ...]:
    """Name the kernels that are programs of their own, solve no equations, and that no other kernel calls."""
    called = {name for names in equations.calls.values() for name in names}
    return tuple(
        name
        for name in equations.kernels
        if name in equations.programs
        and name not in called
        and name not in equations.shares
        and not KERNELS[name].solves
        and not KERNELS[name].derivative_of
    )


def mixed(equations: Equations, within: float, ranges: Ranges) -> Equations:
    """Return equations whose programs keep some values in double precision, so that results are within a bound.

    Args:
        equations: in float32.
        within: largest error by an output's size in the ranges, of those that have a bound.  Where single precision of
            results and stored parameters alone leaves more, twice that.
        ranges: as of ``rounding_bound``.
    """
    setup = with_wide(equations.setup, _inner(equations.setup))
    programs = dict(equations.programs)
    made = replace(equations, setup=setup)
    for name in mixable(equations):
        programs[name] = with_wide(programs[name], _chosen(made, name, within, ranges))
    return replace(made, programs=programs)


def _inner(program: Program) -> list[int]:
    """Return the values of a program that are not written; they are computed once, when parameters change."""
    return [index for index, (_, args, _) in enumerate(program.instructions) if args]


def _chosen(equations: Equations, kernel: str, within: float, ranges: Ranges) -> list[int]:
    """Choose the values of a kernel's program that are kept in double precision."""
    plain = equations.programs[kernel]
    chosen: set[int] = set()
    for _ in range(PASSES):
        program = replace(plain, wide=frozenset(chosen))
        made = enclosed(replace(equations, programs={kernel: program}), kernel, ranges, "float32", ("p",))
        size = output_sizes(made)
        wanted = within * np.where(vanishing(size), size.max(initial=0.0), size)
        places = [place for place in made.with_bounds if wanted[place] > 0.0]
        parts = contributions(made.found, [made.places[place] for place in places]) / wanted[places]
        beyond = parts.sum(axis=0) > 1.0
        origins = with_origins(program, equations.setup)[1]
        more = _greedy(made.program, parts[:, beyond], [ours for ours, _ in origins]) if beyond.any() else []
        if not more:
            break
        chosen |= {origins[index][1] for index in more}
    return sorted(chosen)


def _greedy(program: Program, parts: Array, ours: Sequence[bool]) -> list[int]:
    """Choose values until the parts, (instructions, outputs), of all others add up to 1 at most.

    Where what cannot be chosen is more than that already, until they add up to ``AS_GOOD`` times that.

    Args:
        program: the kernel's, from the parameters on, with what is in double precision already.
        parts: what each value adds to each output's bound, by what is wanted of that.
        ours: whether a value is the kernel's, and not one of the setup, which is stored.
    """
    choice = _Choice(program, ours)
    left, chosen = parts.sum(axis=0), list[int]()
    goal = np.maximum(1.0, AS_GOOD * parts[~choice.free].sum(axis=0))
    while (left > goal).any():
        beyond = left > goal
        gains = np.where(choice.free, np.minimum(parts[:, beyond], left[beyond]).sum(axis=1), 0.0)
        best = int(np.argmax(gains / np.maximum(choice.cost, 0.5)))
        if gains[best] <= 0.0:
            break
        left = left - parts[best]
        chosen.append(best)
        choice.take(best)
    return chosen


class _Choice:
    """Values that may be chosen, and the operations that each of them brings into double precision."""

    def __init__(self, program: Program, ours: Sequence[bool]) -> None:
        self.instructions = program.instructions
        written = set(program.outputs.values())
        self.users: list[list[int]] = [[] for _ in self.instructions]
        for index, (_, args, _) in enumerate(self.instructions):
            for arg in set(args):
                self.users[arg].append(index)
        self.double = set(in_double(program))
        self.free = np.array(
            [
                ours[index] and op != "input" and index not in written and index not in program.wide
                for index, (op, _, _) in enumerate(self.instructions)
            ]
        )
        self.cost = np.array([len(self._brought(index)) for index in range(len(self.users))], np.float64)

    def _brought(self, index: int) -> set[int]:
        """Return operations that are not in double precision yet, and are where a value is chosen."""
        near = (index, *self.users[index])
        return {x for x in near if self.instructions[x].args and x not in self.double}

    def take(self, index: int) -> None:
        """Choose a value."""
        brought = self._brought(index)
        self.double |= brought
        self.free[index] = False
        for value in {x for operation in brought for x in (operation, *self.instructions[operation].args)}:
            self.cost[value] = len(self._brought(value))
