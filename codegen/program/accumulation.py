"""Jacobians of straight-line programs: the values between inputs and outputs are eliminated one by one.

The derivatives of every value by its arguments weigh the edges of a graph.  Eliminating a value leaves an edge from
each of its arguments to each of its users, with the product of both weights, added to the edge that is there; what is
left at the end is the Jacobian.  Forward differentiation takes the values in their order, reverse differentiation the
other way; the order of least products (H. Markowitz, "The Elimination Form of the Inverse and its Application to Linear
Programming", Management Science 3, 1957) goes through narrow places of the program first, so that what passes them is
differentiated by what stands there alone.

Source: A. Griewank, A. Walther, "Evaluating Derivatives", 2nd ed., SIAM 2008, chapters 9 and 10.
"""

from __future__ import annotations

import heapq
from collections.abc import Hashable, Mapping, Sequence
from typing import Any

from .forward_mode import local_slopes
from .ir import Graph, Node, Value

Partials = Mapping[Hashable, Value]
TAIL = 60  # so many values that are left at the end are tried from the last to the first, too


class _Weighed:
    """A graph of values and what each depends on at once, by numbers in an order in which nothing uses a later one.

    ``users`` and ``arguments`` say for each edge whether its weight is 1 or -1, which costs no product.
    """

    def __init__(self, edges: Sequence[Mapping[int, bool]], inner: set[int]) -> None:
        self.arguments = [dict(partials) for partials in edges]
        self.inner = set(inner)
        self.users = _users(edges)

    def copy(self) -> _Weighed:
        return _Weighed(self.arguments, self.inner)

    def products(self, value: int) -> int:
        """Count products that eliminating a value takes."""
        arguments = self.arguments[value]
        plain = sum(1 for user in self.users[value] if self.arguments[user][value])
        return (len(arguments) - sum(arguments.values())) * (len(self.users[value]) - plain)

    def rank(self, value: int) -> tuple[int, int]:
        """Rank a value, the least next: by its products and the edges that come and go; the last of equal ones."""
        arguments, users = self.arguments[value], self.users[value]
        new = sum(1 for user in users for argument in arguments if argument not in self.arguments[user])
        return self.products(value) + new - len(arguments) - len(users), -value

    def eliminate(self, value: int) -> set[int]:
        """Eliminate a value; its arguments and users."""
        arguments, users = self.arguments[value], self.users[value]
        for user in users:
            edges = self.arguments[user]
            is_unit = edges.pop(value)
            for argument, also in arguments.items():
                edges[argument] = is_unit and also and argument not in edges
                self.users[argument].add(user)
        for argument in arguments:
            self.users[argument].discard(value)
        self.arguments[value], self.users[value] = {}, set()
        self.inner.discard(value)
        return users | arguments.keys()

    def least_products(self, rest: int) -> tuple[list[int], int]:
        """Eliminate values by their ranks until ``rest`` are left; their order, and the products that it takes."""
        ranks = {value: self.rank(value) for value in self.inner}
        waiting = sorted(ranks.values())
        order, total = list[int](), 0
        while len(self.inner) > rest:
            rank = heapq.heappop(waiting)
            value = -rank[1]
            if value not in self.inner or ranks[value] != rank:
                continue
            order.append(value)
            total += self.products(value)
            for near in self.eliminate(value) & self.inner:
                now = self.rank(near)
                if now != ranks[near]:
                    ranks[near] = now
                    heapq.heappush(waiting, now)
        return order, total

    def from_the_last(self) -> tuple[list[int], int]:
        """Collect all that is left, from the last to the first."""
        order, total = sorted(self.inner, reverse=True), 0
        for value in order:
            total += self.products(value)
            self.eliminate(value)
        return order, total


def jacobian(
    graph: Graph,
    outputs: Sequence[Hashable],
    inputs: Sequence[Hashable],
    replaced: Mapping[Hashable, Partials],
) -> list[list[Value]]:
    """Differentiate outputs by inputs, (outputs, inputs), behind the values of the graph.

    Args:
        outputs, inputs: values by their index in the graph, or by keys of ``replaced``.
        replaced: derivatives of values by others, both by their keys, in the place of those of their operations:
            of unknowns of a system, say.  A key that is no index stands for a value that is not computed.
    """
    order, partials = _depending(graph, outputs, set(inputs), replaced)
    place = {key: number for number, key in enumerate(order)}
    edges: list[dict[int, Value]] = [
        {place[argument]: weight for argument, weight in partials[key].items() if argument in place} for key in order
    ]
    inner = {place[key] for key in order}.difference(place[key] for key in inputs if key in place)
    ends = []
    for key in outputs:  # a separate place: other values may use the output
        ends.append(len(edges))
        edges.append({place[key]: 1.0} if key in place else {})
    _accumulate(graph, edges, _cheapest_order(edges, inner))
    return [[edges[end].get(place[key], 0.0) if key in place else 0.0 for key in inputs] for end in ends]


def _depending(
    graph: Graph, outputs: Sequence[Hashable], inputs: set[Hashable], replaced: Mapping[Hashable, Partials]
) -> tuple[list[Hashable], dict[Hashable, Partials]]:
    """Return values that depend on inputs and that outputs need, arguments first, with their derivatives."""
    partials: dict[Hashable, Partials] = {}
    order: list[Hashable] = []
    moving: set[Hashable] = set()
    waiting: list[tuple[Hashable, bool]] = [(key, False) for key in reversed(outputs)]
    while waiting:
        key, is_complete = waiting.pop()
        if is_complete:
            if key in inputs or any(argument in moving for argument in partials[key]):
                moving.add(key)
                order.append(key)
        elif key not in partials:
            if key in inputs:
                partials[key] = {}
            elif key in replaced:
                partials[key] = _without_zeros(replaced[key])
            else:
                assert isinstance(key, int)
                partials[key] = _without_zeros(local_slopes(graph, key))
            waiting.append((key, True))
            waiting += [(argument, False) for argument in partials[key]]
    return order, partials


def _without_zeros(partials: Mapping[Any, Value]) -> Partials:
    return {argument: x for argument, x in partials.items() if isinstance(x, Node) or x != 0.0}


def _cheapest_order(edges: Sequence[Mapping[int, Value]], inner: set[int]) -> list[int]:
    """Order values so that elimination takes few products."""
    is_unit = [{i: not isinstance(x, Node) and abs(x) == 1.0 for i, x in partials.items()} for partials in edges]
    start = _Weighed(is_unit, inner)
    order, _ = start.least_products(TAIL)
    tails = start.copy().from_the_last(), start.least_products(0)
    return order + min(tails, key=lambda tail: tail[1])[0]


def _users(edges: Sequence[Mapping[int, Any]]) -> list[set[int]]:
    """Return per value those that use it."""
    users: list[set[int]] = [set() for _ in edges]
    for value, arguments in enumerate(edges):
        for argument in arguments:
            users[argument].add(value)
    return users


def _accumulate(graph: Graph, edges: list[dict[int, Value]], order: Sequence[int]) -> None:
    """Eliminate values in this order: write the products and sums, and leave the edges between the others."""
    users = _users(edges)
    for value in order:
        arguments, edges[value] = edges[value], {}
        for user in sorted(users[value]):
            weight = edges[user].pop(value)
            for argument, other in arguments.items():
                total = graph.add(edges[user].pop(argument, 0.0), graph.mul(weight, other))
                if isinstance(total, Node) or total != 0.0:
                    edges[user][argument] = total
                    users[argument].add(user)
                else:
                    users[argument].discard(user)
        for argument in arguments:
            users[argument].discard(value)
