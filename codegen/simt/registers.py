"""A model of registers: statements in an order, what they hold, and what does not fit (Belady's rule).

Compilers for accelerators keep a thread's values in at most 255 registers of 32 bits, and others in memory.  Here the
value goes whose next use is farthest, which is the best that can be done; what a compiler does is about as much.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from ..program.ir import Program
from ..program.operations import ANGULAR
from ..program.orders import FREE, ORDERS, SUNK, Order, computed, sunk

SPILL, FAR = 4, 20  # operations of an access to the first cache and to the second; see docs/simt.md
SINE = 25  # operations of a sine with its cosine
GAPS = (1000, 400, 120)  # statements after which sines of coordinates may be taken again
TRIED = 3  # orders in which that is tried
SHARE = 10  # sines may take one of so many operations so that nothing is stored
LONG = 30000  # values of a program from which on few orders are tried
TURN = "turn"  # operation of statements beside those of programs, and checks
CHECKS = ("pivot", "violation")  # outputs that stand in pairs, a number and its scale


@dataclass(frozen=True)
class Places:
    """How many values of a thread have a place.

    room: in registers: 255 of 32 bits, less some 65 of addresses, of inputs that compilers read ahead, and of sines.
    near: in 512 bytes of the first cache, the part of one of the 256 threads that share one with so many registers.
    """

    room: int
    near: int


PLACES: Mapping[str, Places] = {"float64": Places(95, 64), "float32": Places(190, 128)}


@dataclass(frozen=True)
class Statement:
    """A statement of a kernel.

    op: of the program; TURN for a sine and cosine of one angle; of CHECKS for a number beside its scale.
    index: of the value; of an angle; of a pair of numbers.
    defines: names of values that it computes.
    uses: names of values that it takes; numbers and inputs by their indices.
    """

    op: str
    index: int
    defines: tuple[int, ...]
    uses: tuple[int, ...]


@dataclass(frozen=True)
class Schedule:
    """Statements in an order, and what the model says of them.

    order: its name.
    sines_again: sines that are computed once more instead of being kept.
    alive: values that live at once, at most.
    places: how many values fit where.
    stores, loads: of values that do not fit into registers.
    """

    order: str
    statements: tuple[Statement, ...]
    sines_again: int
    alive: int
    places: Places
    stores: int
    loads: int

    @property
    def operations(self) -> int:
        """Return the operations for which accesses to memory and sines that are taken again stand."""
        far = max(self.stores - self.places.near, 0)
        accesses = (self.stores + self.loads) * (SPILL * (self.stores - far) + FAR * far) // max(self.stores, 1)
        return accesses + SINE * self.sines_again

    @property
    def cost(self) -> tuple[int, int]:
        """Return operations, then values that live at once: least is best."""
        return self.operations, self.alive


def scheduled(program: Program, places: Places) -> Schedule:
    """Choose the order of a program's statements that needs least registers by the model.

    Where values do not fit in any order, sines of coordinates that were taken long ago are taken again in the best
    ones, if that costs less, or little: what compilers store is more than the model says, unless it says nothing.
    """
    plain = [(name, order, _modelled(name, program, order, 0, places)) for name, order in _orders(program)]
    plain.sort(key=lambda candidate: candidate[2].cost)
    best = plain[0][2]
    if best.stores == 0:
        return best
    again = [_modelled(name, program, order, gap, places) for name, order, _ in plain[:TRIED] for gap in GAPS]
    little = sum(computed(program)) // SHARE
    fitting = [schedule for schedule in again if schedule.stores == 0 and schedule.operations <= little]
    return min(fitting or (best, *again), key=lambda schedule: schedule.cost)


def _orders(program: Program) -> Iterator[tuple[str, Order]]:
    """Yield orders by their names; few of long programs."""
    for name in list(ORDERS)[:2] if len(program.instructions) > LONG else ORDERS:
        plain = ORDERS[name](program)
        for ending, slack in SUNK.items():
            yield name + ending, plain if slack is None else sunk(program, plain, slack)


def _modelled(name: str, program: Program, order: Order, gap: int, places: Places) -> Schedule:
    """Say what registers hold in an order; where all values fit at once nothing leaves them."""
    statements = tuple(_statements(program, order, gap))
    alive = most_alive(statements)
    stores, loads = spills(statements, places.room) if alive > places.room else (0, 0)
    turns = [statement.index for statement in statements if statement.op == TURN]
    return Schedule(name, statements, len(turns) - len(set(turns)), alive, places, stores, loads)


def _statements(program: Program, order: Order, gap: int) -> Iterator[Statement]:
    """Write statements in an order; sines of coordinates again where they are older than a gap, with further names."""
    instructions, size = program.instructions, len(program.instructions)
    pairs: dict[int, list[int]] = {}  # sines and cosines of each angle
    for index in order:
        op, args, _ = instructions[index]
        if op in ANGULAR:
            pairs.setdefault(args[0], []).append(index)
    taken: dict[int, int] = {}  # when an angle was taken last
    round_of: dict[int, int] = {}
    checks = _checks(program)
    missing = {place: {x for x in pair if instructions[x].op not in FREE} for place, pair in checks.items()}
    waiting: dict[int, list[tuple[str, int]]] = {}
    for place, values in missing.items():
        for value in values:
            waiting.setdefault(value, []).append(place)

    def name(value: int) -> int:
        op, args, _ = instructions[value]
        return value + size * round_of.get(args[0], 0) if op in ANGULAR else value

    def turn(angle: int) -> Statement:
        return Statement(TURN, angle, tuple(name(x) for x in pairs[angle]), (angle,))

    for place, pair in checks.items():
        if not missing[place]:
            yield Statement(*place, (), pair)
    for time, index in enumerate(order):
        op, args, _ = instructions[index]
        if op in ANGULAR:
            if args[0] not in taken:
                taken[args[0]] = time
                yield turn(args[0])
        else:
            for arg in args:
                angle = instructions[arg].args[0] if instructions[arg].op in ANGULAR else None
                if angle is not None and instructions[angle].op == "input":
                    if gap and time - taken[angle] > gap:
                        round_of[angle] = round_of.get(angle, 0) + 1
                        yield turn(angle)
                    taken[angle] = time
            yield Statement(op, index, (index,), tuple(name(arg) for arg in args))
        for place in waiting.get(index, ()):
            missing[place].discard(index)
            if not missing[place]:
                yield Statement(*place, (), tuple(name(x) for x in checks[place]))


def _checks(program: Program) -> dict[tuple[str, int], tuple[int, int]]:
    """Return, per pair of numbers that are checked, both values."""
    outputs = program.outputs
    pairs = sorted({(array, place // 2) for array, place in outputs if array in CHECKS})
    return {(array, i): (outputs[array, 2 * i], outputs[array, 2 * i + 1]) for array, i in pairs}


def _uses(statements: Sequence[Statement]) -> dict[int, list[int]]:
    """Return when each value that a statement computes is used."""
    uses: dict[int, list[int]] = {}
    defined = {name for statement in statements for name in statement.defines}
    for time, statement in enumerate(statements):
        for name in set(statement.uses) & defined:
            uses.setdefault(name, []).append(time)
    return uses


def most_alive(statements: Sequence[Statement]) -> int:
    """Count values that live at once, at most; numbers and inputs are read where they are used."""
    last: dict[int, int] = {}
    for time, statement in enumerate(statements):
        for name in statement.uses:
            last[name] = time
    ending = [0] * len(statements)
    for statement in statements:
        for name in statement.defines:
            if name in last:
                ending[last[name]] += 1
    alive = most = 0
    for time, statement in enumerate(statements):
        alive -= ending[time]
        alive += sum(name in last for name in statement.defines)
        most = max(most, alive)
    return most


def spills(statements: Sequence[Statement], room: int) -> tuple[int, int]:
    """Count stores and loads of values where ``room`` of them fit, and the one goes whose next use is farthest."""
    uses = _uses(statements)
    place = dict.fromkeys(uses, 0)
    held: set[int] = set()
    stored: set[int] = set()
    stores = loads = 0
    farthest: list[tuple[int, int]] = []  # (-next use, value); outdated entries stay

    def hold(name: int, time: int) -> None:
        while place[name] < len(uses[name]) and uses[name][place[name]] <= time:
            place[name] += 1
        if place[name] == len(uses[name]):
            held.discard(name)
        else:
            held.add(name)
            heapq.heappush(farthest, (-uses[name][place[name]], name))

    for time, statement in enumerate(statements):
        args = {name for name in statement.uses if name in uses}
        wanted = args - held
        loads += len(wanted)
        held |= wanted
        for name in sorted(args):
            hold(name, time)
        for name in statement.defines:
            if name in uses:
                hold(name, time)
        while len(held) > room:
            when, name = heapq.heappop(farthest)
            if name in held and -when == uses[name][place[name]]:
                held.discard(name)
                if name not in stored:
                    stored.add(name)
                    stores += 1
    return stores, loads
