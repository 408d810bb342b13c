"""Identify five stiffnesses and two frictions of an arm from one motion, by the exact gradient of its simulation.

    python examples/identify_worn_arm.py [STEPS]

The motion is that of an arm whose numbers nobody knows, with noise; the search begins with the drawing's.  Each step of
it asks for the whole motion and the derivatives of the misfit by all seven numbers: one sweep through the steps
backwards, which costs a few simulations however many numbers there are.
"""

from __future__ import annotations

import sys
import time

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

import eomgen

Array = NDArray[np.float64]

WANTED = {  # by how much the arm differs from its drawing
    "joints.shoulder.x.stiffness": 0.7,
    "joints.shoulder.y.stiffness": 1.4,
    "joints.elbow.beta.stiffness": 0.8,
    "joints.gear.gamma.curve.1": 1.25,  # N m at a measured twist of the gear
    "joints.gear.gamma.curve.4": 1.25,
    "joints.shoulder.gamma.friction.coulomb": 1.3,
    "joints.elbow.gamma.friction.coulomb": 0.6,
}
STEP, EVERY = 5e-5, 20  # s, and one of so many steps is measured
NOISE = 1e-6  # m and rad
TILTED = {"gravity.y": -8.5, "gravity.z": -4.9}  # m/s^2: mounted askew, so that the elbow bends


def drives(kernel: eomgen.Kernel, steps: int) -> Array:
    """Torques over time, (steps, n), that move all joints."""
    t = STEP * np.arange(steps)
    u = np.zeros((steps, kernel.n))
    for size, rate, name in ((45.0, 5.0, "shoulder.gamma"), (9.0, 9.0, "elbow.gamma"), (3.0, 14.0, "gear.gamma")):
        u[:, kernel.coordinates.index(name)] = size * np.sin(rate * t) * np.cos(0.7 * rate * t + size)
    return u


def bounds(kernel: eomgen.Kernel) -> list[tuple[float, float]]:
    """Ends of the logarithms' search: Coulomb's friction is at most the static one."""
    greatest = []
    for name in WANTED:
        static = kernel.parameters.get(name.replace("coulomb", "static"), np.inf)
        greatest.append(min(1.0, float(np.log(static / kernel.parameters[name]))) if "coulomb" in name else 1.0)
    return [(-1.0, x) for x in greatest]


class Misfit:
    """Squares of what a simulation differs from a measured motion by, in units of its noise, per number.

    The search sees its logarithm, which is as steep near the end as where it begins.
    """

    def __init__(self, kernel: eomgen.Kernel, u: Array, measured: Array) -> None:
        self.kernel, self.u, self.measured = kernel, u, measured
        self.nominal = np.array([kernel.parameters[name] for name in WANTED])
        self.calls = 0

    def __call__(self, logarithms: Array) -> tuple[float, Array]:
        """The logarithm, and its gradient by the logarithms of the numbers' ratios to nominal ones."""
        self.calls += 1
        values = self.nominal * np.exp(logarithms)
        kernel = self.kernel.replaced(parameters=dict(zip(WANTED, values.tolist(), strict=True)))
        still = np.zeros(kernel.n)
        value, by = kernel.rollout_gradient(
            *(still, still, self.u, STEP, len(self.u)),
            loss=self._loss,
            parameters=tuple(WANTED),
            method="implicit",
            every=EVERY,
        )
        return np.log(value), np.array([by[name] for name in WANTED]) * values / value

    def _loss(self, t: Array, q: Array, v: Array) -> tuple[float, Array, Array]:
        apart = (q - self.measured) / NOISE
        return 0.5 * float((apart**2).mean()), apart / (NOISE * apart.size), np.zeros_like(v)


def main() -> None:
    """Simulate the unknown arm, search for its numbers, and say how near they are."""
    kernel = eomgen.build("worn_arm").replaced(parameters=TILTED)
    arm = kernel.replaced(parameters={name: ratio * kernel.parameters[name] for name, ratio in WANTED.items()})
    steps = int(sys.argv[1]) if len(sys.argv) > 1 else 8000
    still, u = np.zeros(kernel.n), drives(kernel, steps)
    q, _ = arm.rollout(still, still, u, STEP, steps, method="implicit", every=EVERY)
    misfit = Misfit(kernel, u, q + NOISE * np.random.default_rng(1).normal(size=q.shape))
    begin = time.perf_counter()
    first = misfit(np.zeros(len(WANTED)))[0]
    ends = {"maxiter": 300, "ftol": 1e-9, "gtol": 1e-5}
    found = minimize(misfit, np.zeros(len(WANTED)), jac=True, method="L-BFGS-B", bounds=bounds(kernel), options=ends)
    seconds = time.perf_counter() - begin
    before, after = np.exp([first, found.fun])
    print(f"misfit {before:.3g} -> {after:.3f} (0.5 is the noise), {misfit.calls} simulations with gradients")
    for (name, ratio), logarithm in zip(WANTED.items(), found.x, strict=True):
        print(f"{name:45s} {np.exp(logarithm):8.4f} of the drawing's, truly {ratio}")
    print(f"{seconds:.1f} s")


if __name__ == "__main__":
    main()
