"""Orders of a program's statements: who is computed when decides how many values live at once."""

from __future__ import annotations

import heapq
from collections.abc import Callable, Mapping

from .ir import Program, reordered

FREE = ("const", "input")  # values that cost no register: numbers, and what is read where it is used
LONG_LIFE = 100  # statements after which a vector register, of which there are 16 or 32, hardly holds a value
# Parts of a program that may be computed when they are asked for
ON_DEMAND = (0.0, 0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.4)

Order = list[int]


def users_of(program: Program) -> list[list[int]]:
    """List, per value, the values that use it."""
    users: list[list[int]] = [[] for _ in program.instructions]
    for index, instruction in enumerate(program.instructions):
        for arg in set(instruction.args):
            users[arg].append(index)
    return users


def computed(program: Program) -> list[bool]:
    """Say of every value whether a statement computes it."""
    return [instruction.op not in FREE for instruction in program.instructions]


def as_derived(program: Program) -> Order:
    """Keep the order of the derivation."""
    return [index for index, is_computed in enumerate(computed(program)) if is_computed]


def by_outputs(program: Program) -> Order:
    """Put every value right before the first output that needs it, in the order of the outputs."""
    return _computed_of(program, depth_first(program))


def by_registers(program: Program) -> Order:
    """Do the same, the argument first that needs more registers (Sethi and Ullman 1970)."""
    need = [0] * len(program.instructions)
    for index, (op, args, _) in enumerate(program.instructions):
        if op not in FREE:
            ranked = sorted((need[arg] for arg in set(args)), reverse=True)
            need[index] = max([1, *(number + place for place, number in enumerate(ranked))])
    return _computed_of(program, depth_first(program, need.__getitem__))


def _computed_of(program: Program, order: Order) -> Order:
    return [value for value in order if program.instructions[value].op not in FREE]


def depth_first(program: Program, weight: Callable[[int], int] = lambda arg: 0) -> Order:
    """Walk from every output to what it needs, heavier arguments first; of equal ones in their order."""
    order: Order = []
    placed = [False] * len(program.instructions)
    for output in program.outputs.values():
        waiting = [(output, False)]
        while waiting:
            value, is_ready = waiting.pop()
            if is_ready:
                order.append(value)
            elif not placed[value]:
                placed[value] = True
                waiting.append((value, True))
                args = sorted(program.instructions[value].args, key=lambda arg: -weight(arg))
                waiting += [(arg, False) for arg in args[::-1] if not placed[arg]]
    return order


class _Greedy:
    """Places statements one by one, those first that change the number of living values least."""

    def __init__(self, program: Program) -> None:
        self.users, self.computed = users_of(program), computed(program)
        self.args = [[a for a in set(x.args) if self.computed[a]] for x in program.instructions]
        self.users = [[u for u in users if self.computed[u]] for users in self.users]
        size = len(program.instructions)
        self.placed, self.ready, self.stamp = [False] * size, [False] * size, [0] * size
        self.waiting: list[tuple[int, int, int, int]] = []
        self.since = [0] * size  # when a statement became ready: the latest goes first
        self.left = [0] * size  # neighbours that have to be placed before

    def cost(self, value: int) -> int:
        """Return by how many the living values grow."""
        raise NotImplementedError

    def place(self, value: int) -> set[int]:
        """Note that a statement is placed, and return those whose cost changes."""
        raise NotImplementedError

    def neighbours(self, value: int) -> list[int]:
        """List what may be placed after a statement."""
        raise NotImplementedError

    def order(self) -> Order:
        """Return statements in the order in which they are placed."""
        order: Order = []
        for value, is_computed in enumerate(self.computed):
            if is_computed and self.left[value] == 0:
                self.ready[value], self.since[value] = True, value
                self._push(value)
        while self.waiting:
            _, _, value, stamp = heapq.heappop(self.waiting)
            if self.placed[value] or stamp != self.stamp[value]:
                continue
            self.placed[value] = True
            order.append(value)
            touched = self.place(value)
            for other in self.neighbours(value):
                self.left[other] -= 1
                if self.left[other] == 0:
                    self.ready[other], self.since[other] = True, len(self.computed) + len(order)
                    touched.add(other)
            for other in sorted(touched):
                if self.ready[other] and not self.placed[other]:
                    self._push(other)
        return order

    def _push(self, value: int) -> None:
        self.stamp[value] += 1
        heapq.heappush(self.waiting, (self.cost(value), -self.since[value], value, self.stamp[value]))


class _Backwards(_Greedy):
    """From the outputs: a placed statement's value ends to live, and its arguments begin to."""

    def __init__(self, program: Program) -> None:
        super().__init__(program)
        self.left = [len(users) for users in self.users]
        self.living = [False] * len(self.computed)

    def cost(self, value: int) -> int:
        return sum(not self.living[arg] for arg in self.args[value]) - self.living[value]

    def place(self, value: int) -> set[int]:
        touched: set[int] = set()
        for arg in self.args[value]:
            if not self.living[arg]:
                self.living[arg] = True
                touched.update(self.users[arg])
                touched.add(arg)
        return touched

    def neighbours(self, value: int) -> list[int]:
        return self.args[value]


class _Forwards(_Greedy):
    """From the inputs: a placed statement's value begins to live, and arguments end to that it uses last."""

    def __init__(self, program: Program) -> None:
        super().__init__(program)
        self.left = [len(args) for args in self.args]
        self.to_come = [len(users) for users in self.users]

    def cost(self, value: int) -> int:
        return (self.to_come[value] > 0) - sum(self.to_come[arg] == 1 for arg in self.args[value])

    def place(self, value: int) -> set[int]:
        touched: set[int] = set()
        for arg in self.args[value]:
            self.to_come[arg] -= 1
            if self.to_come[arg] == 1:
                touched.update(self.users[arg])
        return touched

    def neighbours(self, value: int) -> list[int]:
        return self.users[value]


def sunk(program: Program, order: Order, slack: int = 0, first: int = 0) -> Order:
    """Move statements right before their first use, where their arguments live until there anyway.

    Args:
        slack: arguments that may live longer for it.
        first: so many statements at the beginning are moved whatever lives longer for it.
    """
    instructions, is_computed = program.instructions, computed(program)
    size, written = len(instructions), set(program.outputs.values())
    earliest, latest = [size] * size, [-1] * size  # uses of a value
    places = []
    for place in range(len(order) - 1, -1, -1):
        value, at = order[place], place
        args, use = instructions[value].args, earliest[value]
        longer = sum(is_computed[arg] and latest[arg] < use for arg in args)
        if use < size and value not in written and (longer <= slack or place < first):
            at = use
        places.append(at * size + value)
        for arg in args:
            earliest[arg] = min(at, earliest[arg])
            latest[arg] = max(at, latest[arg])
    return [place % size for place in sorted(places)]


def with_short_lives(program: Program) -> Program:
    """Return the program with its statements in an order in which few values live long.

    A recursion from the base to the tips stands in front of those that come back.  What it computes goes to where these
    ask for it, body by body, and so do values of whose arguments one alone lives longer for it.  Values before a gate
    stay there, as something before it asks for each.
    """
    plain = as_derived(program)
    candidates = (sunk(program, plain, 1, int(share * len(plain))) for share in ON_DEMAND)
    order = min(candidates, key=lambda order: long_lives(program, order))
    leaves = [index for index, is_computed in enumerate(computed(program)) if not is_computed]
    return reordered(program, [*leaves, *order], program.notes)


def long_lives(program: Program, order: Order) -> int:
    """Count values that are used more than LONG_LIFE statements after they are computed."""
    count, last = 0, [0] * len(program.instructions)
    for time in range(len(order) - 1, -1, -1):
        value = order[time]
        count += last[value] - time > LONG_LIFE
        for arg in program.instructions[value].args:
            last[arg] = last[arg] or time
    return count


ORDERS: Mapping[str, Callable[[Program], Order]] = {
    "as derived": as_derived,
    "by outputs": by_outputs,
    "by registers": by_registers,
    "from the end": lambda program: _Backwards(program).order()[::-1],
    "from the beginning": lambda program: _Forwards(program).order(),
}
SUNK: Mapping[str, int | None] = {"": None, ", sunk": 0, ", sunk further": 1}  # and their slack
