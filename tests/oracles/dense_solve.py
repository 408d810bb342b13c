"""Accelerations of closed mechanisms by dense matrices and eigenvalues, in quadruple precision and beyond."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mpmath as mp
import numpy as np

from eomgen.codegen.kernels.equations import derive
from eomgen.codegen.program.ir import evaluate
from eomgen.robot.model import build_model
from eomgen.robot.value import Robot
from tests.support.random_robots import Array

DIGITS = 50
PROGRAMS = ("mass_matrix", "constraint_jacobian", "constraint_bias", "tree_inverse_dynamics")


class DenseSolve:
    """M a = u - h + J^T lambda with J a = -J_dot v, where J has a known rank."""

    def __init__(self, robot: Robot, rank: int) -> None:
        self.model, self.rank = build_model(robot), rank
        self.programs = {name: derive(self.model, name) for name in PROGRAMS}
        self.sizes = {"mass_matrix": self.model.size**2, "tree_inverse_dynamics": self.model.size}
        self.sizes |= {"constraint_bias": len(self.model.constraints)}

    def _found(self, name: str, number: Any, **given: Sequence[float]) -> list[Any]:
        """Numbers of a program's result."""
        turn = (lambda x: (mp.sin(x), mp.cos(x))) if number is mp.mpf else (lambda x: (np.sin(x), np.cos(x)))
        inputs = {key: [number(float(x)) for x in values] for key, values in given.items()}
        inputs["p"] = [number(x) for x in self.model.parameters.values()] + [number(0)] * len(self.model.turning)
        found = evaluate(self.programs[name], inputs, turn, {"sqrt": mp.sqrt} if number is mp.mpf else {})
        size = self.sizes.get(name, len(self.model.constraints) * self.model.size)
        return [found.get(("out", i), number(0)) for i in range(size)]

    def rates(self, q: Array, ways: Array) -> Array:
        """Rates that keep the loops closed, (n,): a sum of the ways in which they may move, by given weights."""
        n = self.model.size
        with mp.workdps(DIGITS):
            J = _matrix(self._found("constraint_jacobian", mp.mpf, q=q), n)
            vectors = mp.eigsy(J.T * J)[1]
            v = [sum(mp.mpf(float(ways[k])) * vectors[i, k] for k in range(n - self.rank)) for i in range(n)]
            return np.array([float(x) for x in v])

    def exact(self, q: Array, v: Array, u: Array) -> Array:
        """Accelerations, (n,), in DIGITS digits."""
        n = self.model.size
        with mp.workdps(DIGITS):
            M = _matrix(self._found("mass_matrix", mp.mpf, q=q), n)
            J = _matrix(self._found("constraint_jacobian", mp.mpf, q=q), n)
            bias = mp.matrix(self._found("constraint_bias", mp.mpf, q=q, v=v))
            needed = mp.matrix(self._found("tree_inverse_dynamics", mp.mpf, q=q, v=v, a=np.zeros(n)))
            sizes, vectors = mp.eigsy(J.T * J)  # the least first
            held, right = mp.zeros(n, 1), J.T * bias
            for k in range(n - self.rank, n):
                held -= vectors[:, k] * ((vectors[:, k].T * right)[0] / sizes[k])
            ways = vectors[:, : n - self.rank]
            drives = mp.matrix([mp.mpf(float(x)) for x in u])
            rest = mp.lu_solve(ways.T * M * ways, ways.T * (drives - needed - M * held))
            return np.array([float(x) for x in held + ways * rest])

    def plain(self, q: Array, v: Array, u: Array) -> Array:
        """The same in double precision, by singular values."""
        n = self.model.size
        M = np.array(self._found("mass_matrix", float, q=q)).reshape(n, n)
        J = np.array(self._found("constraint_jacobian", float, q=q)).reshape(-1, n)
        bias = np.array(self._found("constraint_bias", float, q=q, v=v))
        needed = np.array(self._found("tree_inverse_dynamics", float, q=q, v=v, a=np.zeros(n)))
        U, S, Vt = np.linalg.svd(J)
        held = -Vt[: self.rank].T @ ((U[:, : self.rank].T @ bias) / S[: self.rank])
        ways = Vt[self.rank :].T
        return np.asarray(held + ways @ np.linalg.solve(ways.T @ M @ ways, ways.T @ (u - needed - M @ held)))


def _matrix(values: Sequence[mp.mpf], columns: int) -> mp.matrix:
    return mp.matrix([values[i : i + columns] for i in range(0, len(values), columns)])
