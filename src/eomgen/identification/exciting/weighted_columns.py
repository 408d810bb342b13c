"""Information of a motion about base parameters: weighted columns, criteria and exact gradients."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from ...arrays import Array, Index
from ...kernel.complete import Kernel
from ...names import component_name
from ..identifiable import FRICTION, BaseParameters
from .constraints import Course

DETERMINANT, CONDITION = "D", "condition"
ExcitationCriterion = Literal["D", "condition"]
CRITERIA = {
    DETERMINANT: "determinant of the information",
    CONDITION: "condition number",
}
POWER = 8  # of the norms that stand for the greatest and least eigenvalue, smoothly
LEAST = 1e-14  # of the greatest eigenvalue: what round-off leaves of directions that show nothing


@dataclass(frozen=True, eq=False)
class WeightedColumns:
    """Columns of base parameters, in units of the parameters' expected sizes and of the drives' noise.

    Attributes:
        kernel: with the regressor and its adjoint.
        base: the combinations.
        index: numbers of the coordinates whose drives are known, (m,).
        noise: standard deviations of their drives, (m,), N or N m.
        sizes: that are expected of the combinations, (b,), SI units.
        turning: rates over which Coulomb friction turns round, for gradients, (m,).
    """

    kernel: Kernel
    base: BaseParameters
    index: Index
    noise: Array
    sizes: Array
    turning: Array

    def columns(self, course: Course, *, smooth: bool = False) -> Array:
        """Return weighted columns, (T, m, b).

        Args:
            course: the motion.
            smooth: whether Coulomb friction turns round over ``turning`` instead of at once.
        """
        q, v, a = course
        Y = np.asarray(self.kernel.functions.regressor(q, v, a))[:, self.index]
        columns = np.zeros((*Y.shape[:2], len(self.base)))
        inner, outer = self._inertial
        columns[..., inner] = Y[..., outer]
        for term, column, row in self._rubbing:
            columns[:, row, column] = self._friction(term, v[:, self.index[row]], row, smooth=smooth)[0]
        return np.asarray(columns / self.noise[:, np.newaxis] * self.sizes)

    def gradient(self, course: Course, weights: Array) -> Course:
        """Return derivatives of the sum of weighted smooth columns by the course, weights (T, m, b)."""
        q, v, a = course
        scaled = weights / self.noise[:, np.newaxis] * self.sizes
        whole = np.zeros((len(q), self.kernel.n, len(self.kernel.regressor_names)))
        inner, outer = self._inertial
        whole[:, self.index[:, np.newaxis], outer] = scaled[..., inner]
        by_q, by_v, by_a = self.kernel.vjp(self.kernel.functions.regressor, (q, v, a), whole)
        for term, column, row in self._rubbing:
            i = self.index[row]
            by_v[:, i] += scaled[:, row, column] * self._friction(term, v[:, i], row, smooth=True)[1]
        return by_q, by_v, by_a

    def _friction(self, term: str, v: Array, row: int, *, smooth: bool) -> tuple[Array, Array]:
        """Return a term's factor at rates, and its slope."""
        if term == "viscous":
            return v, np.ones_like(v)
        if term == "offset":
            return np.ones_like(v), np.zeros_like(v)
        if not smooth:
            return np.sign(v), np.zeros_like(v)
        root = np.hypot(v, self.turning[row])
        return v / root, self.turning[row] ** 2 / root**3

    @cached_property
    def _inertial(self) -> tuple[Index, Index]:
        """Numbers of the combinations that begin with an inertial parameter, and of its regressor's columns."""
        known = {name: k for k, name in enumerate(self.kernel.regressor_names)}
        names = [self.base.parameters[j] for j in self.base.chosen]
        inner = [i for i, name in enumerate(names) if name in known]
        return np.array(inner, dtype=np.intp), np.array([known[names[i]] for i in inner], dtype=np.intp)

    @cached_property
    def _rubbing(self) -> list[tuple[str, int, int]]:
        """Combinations that begin with friction: the term, the number of each, and its row."""
        names = [self.base.parameters[j] for j in self.base.chosen]
        rows = [self.kernel.coordinates[i] for i in self.index]
        terms = {component_name(name, term): (term, row) for row, name in enumerate(rows) for term in FRICTION}
        return [(terms[name][0], i, terms[name][1]) for i, name in enumerate(names) if name in terms]


def information(columns: Array) -> Array:
    """Return the matrix of information, (b, b), from weighted columns (T, m, b)."""
    W = columns.reshape(-1, columns.shape[-1])
    return np.asarray(W.T @ W)


def singular_values(columns: Array) -> Array:
    """Return singular values of weighted columns (T, m, b), the greatest first."""
    R = np.linalg.qr(columns.reshape(-1, columns.shape[-1]), mode="r")
    return np.asarray(np.linalg.svd(R, compute_uv=False))


def criterion_of(kind: str, singular: Array) -> float:
    """Return a criterion's value, the less the better.

    Log of the mean standard deviation over sizes, or of the condition.
    """
    if kind == CONDITION:
        return float(np.log(singular[0]) - np.log(max(singular[-1], LEAST * singular[0])))
    return float(-np.log(np.maximum(singular, LEAST * singular[0])).mean())


def smooth_criterion(kind: str, G: Array) -> tuple[float, Array]:
    """Give a criterion that has a gradient everywhere, by the matrix of information (b, b), and that gradient, (b, b).

    The condition number's greatest and least eigenvalues are those of norms of the power POWER.
    """
    values, vectors = np.linalg.eigh(G)
    values = np.maximum(values, LEAST * values[-1])
    if kind == CONDITION:
        up, down = (values / values[-1]) ** POWER, (values[0] / values) ** POWER
        logarithm = np.log(values[-1] / values[0]) + np.log(up.sum()) / POWER + np.log(down.sum()) / POWER
        slopes = 0.5 * (up / up.sum() - down / down.sum()) / values
        return float(0.5 * logarithm), np.asarray((vectors * slopes) @ vectors.T)
    return float(-0.5 * np.log(values).mean()), np.asarray((vectors * (-0.5 / values / len(values))) @ vectors.T)
