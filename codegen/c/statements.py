"""Program -> statements of C, one per value; a value that one other value uses is written into it.

Large programs are split into several functions that hand values on in an array on the stack, because compilers need
more than linear time for a long function.
"""

from __future__ import annotations

import heapq
import re
from collections import Counter
from collections.abc import Container, Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

from ..kernels.entries import Signature
from ..program.ir import FIRST, GATE, Program, first_values, needed, users
from ..program.operations import ANGULAR
from ..program.shares import GIVEN
from .scalar_types import Scalar

CHUNK = 900  # values per function
INLINE = 72  # longest expression, in characters, that is written into another one
_BRACKETS = re.compile(r"\([^()]*\)")
ARRAYS = ("h", "p", "q", "v", "a", "u", "wrench", *ANGULAR.values(), GIVEN)  # that no signature lists, in this order
NO_STOPS: Mapping[int, int] = MappingProxyType({})
NO_NAMES: Mapping[str, str] = MappingProxyType({})
FILL = 16  # from so many zeros on an output is cleared in a loop


@dataclass(frozen=True)
class Function:
    """A program as C: per chunk its statements, the size of the array that chunks share, arrays that are not read.

    ``angles`` are the expressions whose sines and cosines are taken before all else, ``shared`` the statements of
    values that they use more than once; ``gated`` is the first chunk that is left out where the gate is shut, or None.
    """

    name: str
    arrays: tuple[str, ...]
    shared: tuple[str, ...]
    angles: tuple[str, ...]
    chunks: tuple[tuple[str, ...], ...]
    workspace: int
    unused: tuple[tuple[str, ...], ...]
    outputs: tuple[str, ...]
    gated: int | None = None

    @property
    def contiguous_angles(self) -> str:
        """Address of the first angle, if the angles stand side by side in an array already; or nothing."""
        places = [re.fullmatch(r"(\w+)\[(\d+)\]", angle) for angle in self.angles]
        if not places or not all(places):
            return ""
        angles = [(place[1], int(place[2])) for place in places if place]
        array, first = angles[0]
        return f"{array} + {first}" if angles == [(array, first + i) for i in range(len(angles))] else ""


def write_function(
    program: Program,
    scalar: Scalar,
    signature: Signature | None = None,
    *,
    turning: bool = True,
    stops: Mapping[int, int] = NO_STOPS,
    ending: str = "",
    chunk: int = 0,
    names: Mapping[str, str] = NO_NAMES,
) -> Function:
    """Write a program as statements of C.

    Args:
        signature: of the program's kernel; None of a part of one, and of the setup.
        turning: take all sines and cosines at once in front (``turn`` of ``clib/lanes.h``), not one by one.
        stops: of a run (``program.shares``), which ends there if nothing is wanted of what comes behind.
        ending: statement that ends the function where a gate is shut.
        chunk: values per function; 0: CHUNK.
        names: what stands at places of outputs, such as "out[7]", for comments.
    """
    arrays = tuple(a for a in ARRAYS if a in program.inputs()) if signature is None else ("h", *signature.reads)
    writer = _Writer(program, scalar, turning, stops, ending, chunk or CHUNK, names)
    chunks = writer.chunks()
    texts = ["\n".join(chunk) for chunk in chunks]
    unused = [[a for a in arrays if not reads(text, a)] for text in texts]
    if len(chunks) == 1:
        unused[0] = [a for a in unused[0] if not reads("\n".join(writer.shared + writer.angles), a)]
    outputs = tuple(dict.fromkeys(key[0] for key in program.outputs if key[0] not in FIRST))
    return Function(
        program.name,
        arrays,
        tuple(writer.shared),
        tuple(writer.angles),
        tuple(tuple(chunk) for chunk in chunks),
        workspace(writer.slots),
        tuple(tuple(names) for names in unused),
        outputs,
        writer.gated if len(chunks) > 1 else None,
    )


def reads(text: str, array: str) -> bool:
    """True if any of the statements reads the array."""
    return re.search(rf"\b{array}\[", text) is not None


def trig_values(program: Program) -> set[int]:
    """Return sines and cosines, and what they alone need: values without statements."""
    needs = [0] * len(program.instructions)  # statements and outputs that need a value
    for index in program.outputs.values():
        needs[index] += 1
    values: set[int] = set()
    for index in range(len(program.instructions) - 1, -1, -1):
        op, args, _ = program.instructions[index]
        if op in ANGULAR or (needs[index] == 0 and args):
            values.add(index)
        else:
            for arg in args:
                needs[arg] += 1
    return values


def split(program: Program, apart: Container[int], chunk: int = 0) -> dict[int, int]:
    """Return the index of the function that computes each value, but those ``apart``; one begins behind a gate."""
    size = chunk or CHUNK
    computed = [i for i, instruction in enumerate(program.instructions) if instruction.args and i not in apart]
    early = first_values(program)
    here = [index for index in computed if early[index]]
    behind = 0 if len(computed) <= size else -(-len(here) // size)
    function_of = {index: order // size for order, index in enumerate(here)}
    return function_of | {
        index: behind + order // size for order, index in enumerate(i for i in computed if not early[i])
    }


def handed_on(program: Program, chunk_of: Mapping[int, int]) -> dict[int, int]:
    """Return values that a later function reads, and their places in the array that functions share.

    A place has other values behind the last function that reads one: what the array takes of a cache counts.
    """
    last = {
        arg: chunk  # chunks ascend
        for index, chunk in chunk_of.items()
        for arg in program.instructions[index].args
        if chunk_of.get(arg, chunk) != chunk
    }
    slots: dict[int, int] = {}
    taken: list[tuple[int, int]] = []  # the last function that reads a place, and the place
    free: list[int] = []
    for index, chunk in chunk_of.items():
        if index not in last:
            continue
        while taken and taken[0][0] < chunk:
            heapq.heappush(free, heapq.heappop(taken)[1])
        slots[index] = heapq.heappop(free) if free else len(taken)
        heapq.heappush(taken, (last[index], slots[index]))
    return slots


def workspace(slots: Mapping[int, int]) -> int:
    """Return the length of the array that functions share."""
    return 1 + max(slots.values(), default=-1)


class _Writer:
    """Writes the statements of one program."""

    def __init__(
        self,
        program: Program,
        scalar: Scalar,
        turning: bool,
        stops: Mapping[int, int],
        ending: str,
        chunk: int,
        names: Mapping[str, str],
    ) -> None:
        self.names = names
        self.program, self.scalar, self.stops, self.ending = program, scalar, stops, ending
        self.count = users(program)
        self.stores: dict[int, list[str]] = {}
        for (array, position), index in program.outputs.items():
            self.stores.setdefault(index, []).append(f"{FIRST.get(array, array)}[{position}]")
        apart = trig_values(program) if turning else set()
        self.turns: dict[int, str] = {}  # sines and cosines that are taken in front
        self.shared, self.angles = self._take_turns(apart)
        self.chunk_of = split(program, apart, chunk)
        if stops:  # a run is short, and what ends it ends a function
            self.chunk_of = dict.fromkeys(self.chunk_of, 0)
        self.last = max(self.chunk_of.values(), default=0)
        early = first_values(program)
        self.behind = next((index for index in self.chunk_of if not early[index]), None)  # first value behind the gate
        self.gated = None if self.behind is None else self.chunk_of[self.behind]
        self.slots = handed_on(program, self.chunk_of)

    def _take_turns(self, apart: Container[int]) -> tuple[list[str], list[str]]:
        """Return statements of values that angles use more than once, and the angles as expressions."""
        instructions = self.program.instructions
        places: dict[int, int] = {}
        for index, (op, args, _) in enumerate(instructions):
            if index in apart and op in ANGULAR:
                place = places.setdefault(args[0], len(places))
                self.turns[index] = f"{ANGULAR[op]}[{place}]"
        wanted = [index for index, is_wanted in enumerate(needed(instructions, places)) if is_wanted]
        uses = Counter([*places, *(arg for index in wanted for arg in instructions[index].args)])
        text: dict[int, str] = {}
        shared = []
        for index in wanted:
            args = instructions[index].args
            text[index] = self._write(index, [text[arg] for arg in args]) if args else self._leaf(index)
            if args and uses[index] > 1:
                shared.append(f"const {self.scalar.name} s{index} = {text[index]};")
                text[index] = f"s{index}"
        return shared, [text[index] for index in places]

    def chunks(self) -> list[list[str]]:
        """Write the statements of each chunk."""
        lines: list[list[str]] = [[] for _ in range(self.last + 1)]
        lines[0].extend(self._constant_outputs())
        text: dict[int, str] = {}
        note = ""
        known: list[dict[int, str]] = [{} for _ in lines]
        chunk_of, notes = self.chunk_of, self.program.notes
        for index, instruction in enumerate(self.program.instructions):
            if index in self.stops:
                lines[0].append(f"if (last <= {self.stops[index]}) {{ return; }}")
            chunk = chunk_of.get(index)
            note = notes.get(index, note)
            if index == self.behind and self.last == 0:
                lines[0].append(
                    f"if (!eom_any_positive{'_lanes' if self.scalar.spread else ''}({GATE}[0])) {{ {self.ending} }}"
                )
            if chunk is None:
                if index in self.turns or not instruction.args:
                    text[index] = self._leaf(index)
                continue
            expression = self._write(
                index,
                [
                    text[arg] if chunk_of.get(arg, chunk) == chunk else self._handed(arg, known[chunk], lines[chunk])
                    for arg in instruction.args
                ],
            )
            if self._is_inlined(index, expression):
                text[index] = expression
                continue
            if note:  # the last one counts: the steps before it wrote nothing
                lines[chunk].append(f"/* {note} */")
                note = ""
            if index in self.stores and self.count[index] == len(self.stores[index]):
                lines[chunk].extend(self._stored(self.stores[index], expression))
                continue
            lines[chunk].append(f"const {self.scalar.name} t{index} = {expression};")
            text[index] = f"t{index}"
            if index in self.slots:
                lines[chunk].append(f"w[{self.slots[index]}] = t{index};")
            if index in self.stores:
                lines[chunk].extend(self._stored(self.stores[index], f"t{index}"))
        return lines

    def _constant_outputs(self) -> Iterator[str]:
        """Write outputs that are numbers or inputs, zeros in a loop where there are many."""
        zeros: dict[str, int] = {}
        for index, places in self.stores.items():
            if index not in self.chunk_of and self._leaf(index) == self.scalar.literal(0.0):
                for place in places:
                    array = place.split("[")[0]
                    zeros[array] = zeros.get(array, 0) + 1
        filled = {array for array, number in zeros.items() if number >= FILL}
        for array in sorted(filled):
            positions = [position for name, position in self.program.outputs if name == array]
            first, size = min(positions), 1 + max(positions)  # in front of a run's places stand those of others
            zero = self.scalar.whole(self.scalar.literal(0.0))
            rest = " /* all but the following */" if self.names else ""
            yield f"for (size_t i = {first}{'U' if first else ''}; i < {size}U; ++i) {{ {array}[i] = {zero}; }}{rest}"
        for index, places in self.stores.items():
            if index not in self.chunk_of:
                leaf = self._leaf(index)
                kept = [p for p in places if leaf != self.scalar.literal(0.0) or p.split("[")[0] not in filled]
                if kept:
                    yield from self._stored(kept, self._whole(index, leaf))

    def _stored(self, places: Sequence[str], value: str) -> list[str]:
        """Write statements that store one value at each of the places; an expression is computed once."""
        again = value if re.fullmatch(r"[\w.]+", value) else places[0]
        notes = [f" /* {self.names[place]} */" if place in self.names else "" for place in places]
        sources = (value, *[again] * len(places))
        return [f"{place} = {x};{note}" for place, x, note in zip(places, sources, notes, strict=False)]

    def _leaf(self, index: int) -> str:
        instruction = self.program.instructions[index]
        if index in self.turns:
            return self.turns[index]
        if instruction.op == "const":
            return self.scalar.constant(instruction.leaf)
        return f"{instruction.leaf[0]}[{instruction.leaf[1]}]"

    def _handed(self, arg: int, known: dict[int, str], lines: list[str]) -> str:
        """Write an argument from an earlier chunk, which is loaded once."""
        if arg not in known:
            lines.append(f"const {self.scalar.name} t{arg} = w[{self.slots[arg]}];")
            known[arg] = f"t{arg}"
        return known[arg]

    def _is_inlined(self, index: int, expression: str) -> bool:
        return (
            self.count[index] == 1
            and index not in self.stores
            and index not in self.slots
            and len(expression) <= INLINE
            and self.program.instructions[index].op not in ANGULAR
        )

    def _whole(self, index: int, text: str) -> str:
        """Write a value where one number for all states has to become a vector of it."""
        instruction = self.program.instructions[index]
        is_number = instruction.op == "const" or (instruction.op == "input" and instruction.leaf[0] in ("h", "p"))
        return self.scalar.whole(text) if is_number else text

    def _write(self, index: int, args: Sequence[str]) -> str:
        """Write a value as an expression of its arguments' texts."""
        op, places, _ = self.program.instructions[index]
        if op in ANGULAR:
            return f"{op}{self.scalar.suffix}({args[0]})"
        operation = self.program.operations[op]
        if operation.function:
            whole = [self._whole(arg, text) for arg, text in zip(places, args, strict=True)]
            return f"{operation.function}{'_lanes' if self.scalar.spread else ''}({', '.join(whole)})"
        first, others = args[0], args[1:]
        if " " in operation.form:
            return operation.form.format(first, *map(_term, others))
        return operation.form.format(_factor(first, leading=len(args) > 1), *map(_factor, others))


def _is_sum(text: str) -> bool:
    return " " in text and " " in _outside_brackets(text)


def _is_product(text: str) -> bool:
    outside = _outside_brackets(text)
    return "*" in outside or "/" in outside


def _outside_brackets(text: str) -> str:
    while "(" in text:
        text = _BRACKETS.sub("", text)
    return text


def _term(text: str) -> str:
    """Write a right summand, in brackets where its sum or sign would be read otherwise."""
    return f"({text})" if _is_sum(text) or text.startswith("-") else text


def _factor(text: str, *, leading: bool = False) -> str:
    """Write a factor; a product on the right keeps its brackets, because rounding depends on the order."""
    if _is_sum(text) or (not leading and (text.startswith("-") or _is_product(text))):
        return f"({text})"
    return text
