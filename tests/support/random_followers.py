"""Random rigid couplings in trees, and what they make of a robot's own coordinates, by linear algebra alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from eomgen.robot.coordinates import coordinate_names
from eomgen.robot.model import build_model
from eomgen.robot.value import Coupling, Robot
from tests.support.random_robots import Array


def with_followers(robot: Robot, seed: int, share: float = 0.5, *, tuned: bool = False) -> Robot:
    """The robot with about a share of its coordinates coupled to others, in chains, and to several at once.

    tuned: ratios and offsets are run-time parameters.
    """
    rng = np.random.default_rng([seed, 77])
    model = build_model(robot)
    given = {model.coordinates[i] for i in model.prescribed}
    order = [*sorted(given), *rng.permutation([name for name in model.coordinates if name not in given]).tolist()]
    couplings: list[Coupling] = []
    for place, name in enumerate(order[1:], 1):
        if name in given or (rng.random() > share and (couplings or name != order[-1])):
            continue
        count = int(rng.choice([0, 1, 1, 1, 2]))
        leaders = rng.choice(order[:place], min(count, place), replace=False).tolist()
        ratios = {leader: float(rng.choice([-1.0, 1.0, *rng.uniform(-1.5, 1.5, 3)])) for leader in leaders}
        offset = None if rng.random() < 0.4 else float(rng.uniform(-0.3, 0.3))
        couplings.append(Coupling(f"gear{len(couplings)}", name, ratios, offset))
    couplings = [couplings[i] for i in rng.permutation(len(couplings))]
    mapped = replace(robot, couplings=tuple(couplings)).followers
    couplings = [x for x in couplings if x.of in mapped]  # motors, and joints that have one, do not follow
    names = [f"couplings.{x.name}.{key}" for x in couplings for key, value in x.numbers().items() if value is not None]
    return replace(robot, couplings=tuple(couplings), tunable=(*robot.tunable, *(names if tuned else ())))


@dataclass(frozen=True)
class Reduction:
    """q = S lead + c of all coordinates of a tree, (n,), by those that follow no others; ``names`` are the latter's."""

    S: Array
    c: Array
    names: tuple[str, ...]

    @classmethod
    def of(cls, robot: Robot, couplings: Sequence[Coupling]) -> Reduction:
        """Solve (1 - R) q = lead + offsets, with the couplings' rows in R."""
        every = list(coordinate_names(robot))
        R, offsets = np.zeros((len(every),) * 2), np.zeros(len(every))
        for x in couplings:
            offsets[every.index(x.of)] = x.offset or 0.0
            for name, ratio in x.to.items():
                R[every.index(x.of), every.index(name)] = ratio
        followers = {x.of for x in couplings}
        lead = [i for i, name in enumerate(every) if name not in followers]
        inverse = np.linalg.inv(np.eye(len(every)) - R)
        return cls(inverse[:, lead], inverse @ offsets, tuple(every[i] for i in lead))

    def positions(self, q: Array) -> Array:
        """All coordinates, (..., n)."""
        return np.asarray(q @ self.S.T + self.c)

    def motions(self, x: Array) -> Array:
        """All velocities or accelerations, (..., n)."""
        return np.asarray(x @ self.S.T)

    def forces(self, x: Array) -> Array:
        """Forces on those that follow no others, (..., lead)."""
        return np.asarray(x @ self.S)

    def matrix(self, x: Array) -> Array:
        """S^T X S of matrices, (..., lead, lead)."""
        return np.asarray(np.swapaxes(self.S, 0, 1) @ x @ self.S)
