"""Taylor rules of operations: a coefficient of the result from those of the arguments, x = x_0 + x_1 t + ...

A rule takes (graph, series of the arguments, series of the result up to order k - 1, k).

Source: A. Griewank, A. Walther, "Evaluating Derivatives", 2nd ed., SIAM 2008, chapter 13.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

Value = Any  # a number, or a value of a graph
Series = list[Value]  # coefficients of powers of time, from that of order 0 on


def convolved(x: Series, y: Series, k: int, first: int = 0, last: int | None = None) -> Value:
    """Return the sum of x_i y_(k - i) for i from first to last, k by default."""
    total: Value = 0.0
    for i in range(first, (k if last is None else last) + 1):
        total = total + x[i] * y[k - i]
    return total


def squared(x: Series, k: int, first: int = 0) -> Value:
    """Return the sum of x_i x_(k - i) for i from first to k - first."""
    twice: Value = 0.0
    for i in range(first, (k + 1) // 2):
        twice = twice + x[i] * x[k - i]
    total = twice + twice
    return total + x[k // 2] * x[k // 2] if k % 2 == 0 and k // 2 >= first else total


def _rates(x: Series, k: int) -> Series:
    """Return i x_i for i up to k: coefficients of t x'."""
    return [float(i) * x[i] for i in range(k + 1)]


def shares(x: Series, k: int) -> Series:
    """Return i x_i / k for i up to k: the last one is x_k itself, and whoever needs the others shares them."""
    return [i / k * x[i] for i in range(k + 1)]


def product(graph: Any, x: Sequence[Series], z: Series, k: int) -> Value:
    """Return a coefficient of x y."""
    return squared(x[0], k) if x[0] is x[1] else convolved(x[0], x[1], k)


def quotient(graph: Any, x: Sequence[Series], z: Series, k: int) -> Value:
    """Return a coefficient of x / y."""
    return (x[0][k] - convolved(z, x[1], k, 0, k - 1)) * (1.0 / x[1][0])


def square_root(graph: Any, x: Sequence[Series], z: Series, k: int) -> Value:
    """Return a coefficient of the square root."""
    return (x[0][k] - squared(z, k, 1)) * (0.5 / z[0])


def exponential(graph: Any, x: Sequence[Series], z: Series, k: int) -> Value:
    """Solve t z' = z t x'."""
    return convolved(shares(x[0], k), z, k, 1)


def logarithm(graph: Any, x: Sequence[Series], z: Series, k: int) -> Value:
    """Solve x t z' = t x'."""
    lower = convolved(_rates(z, k - 1), x[0], k, 1, k - 1)
    return (x[0][k] - 1.0 / k * lower) / x[0][0]


def angle(graph: Any, x: Sequence[Series], z: Series, k: int) -> Value:
    """Solve (x^2 + y^2) t z' = x t y' - y t x' for z = atan2(y, x)."""
    y, x_ = x
    squares = [squared(x_, i) + squared(y, i) for i in range(k)]
    turned = convolved(_rates(y, k), x_, k, 1) - convolved(_rates(x_, k), y, k, 1)
    lower = convolved(_rates(z, k - 1), squares, k, 1, k - 1)
    return 1.0 / k * (turned - lower) / squares[0]
