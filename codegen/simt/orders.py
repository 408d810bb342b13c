"""Orders of a program's statements: who is computed when decides how many values live at once."""

from __future__ import annotations

import heapq
from collections.abc import Callable, Mapping

from ..program.ir import Program

FREE = ("const", "input")  # values that cost no register: numbers, and what is read where it is used

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
    return _depth_first(program, lambda arg: 0)


def by_registers(program: Program) -> Order:
    """Do the same, the argument first that needs more registers (Sethi and Ullman 1970)."""
    need = [0] * len(program.instructions)
    for index, (op, args, _) in enumerate(program.instructions):
        if op not in FREE:
            ranked = sorted((need[arg] for arg in set(args)), reverse=True)
            need[index] = max([1, *(number + place for place, number in enumerate(ranked))])
    return _depth_first(program, need.__getitem__)


def _depth_first(program: Program, weight: Callable[[int], int]) -> Order:
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
    return [value for value in order if program.instructions[value].op not in FREE]


def from_the_end(program: Program) -> Order:
    """List statements backwards: next is always what adds least to the values that live."""
    return _Backwards(program).order()[::-1]


def from_the_beginning(program: Program) -> Order:
    """List statements forwards: next is always what adds least to the values that live."""
    return _Forwards(program).order()


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


def sunk(program: Program, order: Order, slack: int = 0) -> Order:
    """Move statements right before their first use, where their arguments live until there anyway.

    Args:
        slack: arguments that may live longer for it.
    """
    users, is_computed = users_of(program), computed(program)
    key = {value: place for place, value in enumerate(order)}
    written = set(program.outputs.values())
    for value in reversed(order):
        if value in written or not users[value]:
            continue
        first = min(key[user] for user in users[value])
        longer = 0
        for arg in program.instructions[value].args:
            if is_computed[arg] and not any(user != value and key[user] >= first for user in users[arg]):
                longer += 1
        if longer <= slack:
            key[value] = first
    return sorted(order, key=lambda value: (key[value], value))


ORDERS: Mapping[str, Callable[[Program], Order]] = {
    "as derived": as_derived,
    "by outputs": by_outputs,
    "by registers": by_registers,
    "from the end": from_the_end,
    "from the beginning": from_the_beginning,
}
SUNK: Mapping[str, int | None] = {"": None, ", sunk": 0, ", sunk further": 1}  # and their slack
