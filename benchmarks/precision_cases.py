"""Motions that are integrated to many precisions, and everybody who integrates them.

A run is a contender with one setting, a relative tolerance or a length of steps.  All of a problem have the same
state, constant drives, and times of samples, and return coordinates there.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import ArrayLike, NDArray

import eomgen
from eomgen.errors import InputError
from eomgen.integration import integrate
from eomgen.state.equilibrium import static_equilibrium

from .peers.contender import MissingPeer
from .peers.mujoco_peer import MujocoPeer

Array = NDArray[np.float64]

CHOSEN = ("rosenbrock", "tsit5", "radau")  # ours, with error control
IN_TURN = "auto"  # ours, through eomgen.integration
WITH_RADAU = ("eomgen radau", f"eomgen {IN_TURN}")  # of those below, the ones that take Radau IIA
FIXED = ("implicit", "rk4")  # ours, in steps of one length
PYTHON = ("scipy:Radau", "CVODE", "IDA", "scipy:DOP853")  # through eomgen.integration, from Python
SIMULATOR = ("discrete", "implicitfast", "RK4")  # integrators of MuJoCo
OURS = tuple(f"eomgen {method}" for method in (*CHOSEN, IN_TURN, *FIXED))
OTHERS = (*PYTHON, *(f"MuJoCo {name}" for name in SIMULATOR))
TOLERANCES = tuple(float(f"{10.0 ** (-k / 2):.1e}") for k in range(4, 21))  # relative, 1e-2 to 1e-10
ONE = 1e-6  # the tolerance at which contenders are compared, too
STEPS = tuple(2**k for k in range(14))  # in the time of a sample


class Constant:
    """Drives that do not change, and which implicit methods need not differentiate."""

    def __init__(self, u: Array) -> None:
        self.u, self.none = u, np.zeros((len(u), len(u)))

    def __call__(self, t: float, q: Array, v: Array) -> ArrayLike:
        return self.u

    def slopes(self, t: float, q: Array, v: Array) -> tuple[Array, Array]:
        return self.none, self.none


@dataclass(frozen=True)
class Problem:
    """A motion.

    Attributes:
        duration: s.
        samples: beside the beginning.
        start: the kernel -> q and u, (n,) each; it begins at rest.
        what: the motion in words.
        bars: error -> the least ratio that is required of the best of the others' time to the best of ours.
        missing: contenders that have no equal for the robot, with the reason.
        references: two of our methods with their settings, relative tolerances or steps from sample to sample; they
            have to agree on what is exact.
    """

    key: str
    title: str
    duration: float
    samples: int
    start: Callable[[eomgen.Kernel], tuple[Array, Array]]
    what: str
    bars: Mapping[float, float]
    missing: Mapping[str, str]
    references: Sequence[tuple[str, float]] = (("tsit5", 1e-12), ("radau", 1e-13))


def _home(kernel: eomgen.Kernel) -> Array:
    home = eomgen.load_robot(kernel.name).home
    return np.array([home.get(name, 0.0) for name in kernel.coordinates])


def _let_go(kernel: eomgen.Kernel) -> tuple[Array, Array]:
    """Return a state at home, no drives."""
    return _home(kernel), np.zeros(kernel.n)


def _sagged(kernel: eomgen.Kernel) -> tuple[Array, Array]:
    """Return a state at home with the springs loaded as gravity loads them while the drives hold; then no drives."""
    held = [name for name in kernel.coordinates if name.endswith(".gamma")]
    return static_equilibrium(kernel, _home(kernel), fixed=held)[0], np.zeros(kernel.n)


def _lifted(kernel: eomgen.Kernel) -> tuple[Array, Array]:
    """Return a state at home, legs that lift and tilt the platform."""
    u = np.zeros(kernel.n)
    for leg, force in enumerate((64.0, 60.0, 62.0, 58.0, 61.0, 63.0), 1):
        u[kernel.coordinates.index(f"leg{leg}.z")] = force
    return _home(kernel), u


STIFF = {1e-3: 10.0, 1e-4: 10.0, 1e-5: 10.0, 1e-6: 10.0, 1e-8: 3.0, 1e-10: 3.0}
LOOSE = dict.fromkeys(STIFF, 5.0)
ERRORS = tuple(STIFF)
_WORN = "MuJoCo has no equal for clearance with a contact behind it, nor for frictions and curves as they are here"
_CUT = "MuJoCo closes loops by constraints, which have neither the springs nor the clearance of these joints"

PROBLEMS: Mapping[str, Problem] = {
    problem.key: problem
    for problem in (
        Problem(
            "puma560_elastic",
            "elastic PUMA 560 (36 DOF)",
            2.0,
            100,
            _sagged,
            "unactuated from rest, its springs loaded by gravity",
            STIFF,
            {},
        ),
        Problem(
            "worn_arm",
            "worn arm with contacts (6 DOF)",
            1.0,
            100,
            _let_go,
            "unactuated from home: clearances, contacts, frictions, a wound gear",
            STIFF,
            dict.fromkeys((f"MuJoCo {name}" for name in SIMULATOR), _WORN),
        ),
        Problem(
            "hexapod_elastic",
            "elastic hexapod (78 DOF, closed)",
            0.5,
            50,
            _lifted,
            "from home with unloaded springs, forces of the legs that lift and tilt the platform",
            STIFF,
            dict.fromkeys((f"MuJoCo {name}" for name in SIMULATOR), _CUT),
            (("tsit5", 1e-7), ("radau", 1e-8)),  # loops are closed to no more
        ),
        Problem(
            "ur5",
            "UR5 without springs (6 DOF)",
            1.0,
            100,
            _let_go,
            "unactuated from home",
            LOOSE,
            {},
        ),
    )
}


@dataclass(frozen=True)
class Run:
    """A contender with one setting; ``call`` returns coordinates at the samples, (samples + 1, n), and the steps taken.

    Attributes:
        setting: relative tolerance, or length of a step, s.
    """

    contender: str
    setting: float
    call: Callable[[], tuple[Array, int]]

    @property
    def wanted(self) -> bool:
        """Whether it is measured however exact looser ones are, because ratios at one tolerance are made of it."""
        return self.contender.split(" ")[-1] in (*CHOSEN, IN_TURN, *PYTHON) and self.setting >= ONE


class Motion:
    """A problem with its kernel, its beginning, and what runs it."""

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self.kernel = eomgen.build(problem.key)
        self.q, self.u = problem.start(self.kernel)
        self.v = np.zeros(self.kernel.n)
        self._drive = Constant(self.u)
        self.missing = dict(problem.missing)

    def exact(self) -> tuple[Array, Array]:
        """Return coordinates at the samples by the two references."""
        first, second = (
            (self.chosen(method, setting) if method in CHOSEN else self.fixed(method, int(setting)))[0]
            for method, setting in self.problem.references
        )
        return first, second

    def chosen(self, method: str, rtol: float) -> tuple[Array, int]:
        """Integrate with our rollout, with adaptive step size."""
        p = self.problem
        rollout = self.kernel.rollout(
            self.q, self.v, self.u, method=method, duration=p.duration, samples=p.samples, rtol=rtol
        )
        return rollout[0], int(rollout.steps) + int(rollout.rejected)

    def in_turn(self, rtol: float) -> tuple[Array, int]:
        """Integrate with ours, by the methods that "auto" takes in turn."""
        p = self.problem
        times = np.linspace(0.0, p.duration, p.samples + 1)
        trajectory = integrate(
            self.kernel, self.q, self.v, p.duration, drive=self.u, method=IN_TURN, rtol=rtol, times=times
        )
        return trajectory.q, int(trajectory.info["steps"] + trajectory.info["rejected"])

    def fixed(self, method: str, every: int) -> tuple[Array, int]:
        """Integrate with ours, so many steps from sample to sample."""
        p = self.problem
        steps = every * p.samples
        arguments = (self.q, self.v, self.u, p.duration / steps, steps)
        return self.kernel.rollout(*arguments, method=method, every=every)[0], steps

    def python(self, method: str, rtol: float) -> tuple[Array, int]:
        """Integrate with SciPy's or SUNDIALS' solver; the step count is that of evaluations where there is no other."""
        p = self.problem
        times = np.linspace(0.0, p.duration, p.samples + 1)
        trajectory = integrate(
            self.kernel, self.q, self.v, p.duration, drive=self._drive, method=method, rtol=rtol, times=times
        )
        return trajectory.q, int(trajectory.info["steps"] or trajectory.info["evaluations"])

    def simulated(self, peer: MujocoPeer, every: int) -> tuple[Array, int]:
        """Integrate with MuJoCo, so many steps from sample to sample."""
        p = self.problem
        steps = every * p.samples
        return peer.rollout(self.q, self.v, self.u, p.duration / steps, steps, every), steps

    def runs(self, contenders: Sequence[str]) -> Iterator[Run]:
        """Yield every setting of these contenders; ``missing`` says of the others why not."""
        length = self.problem.duration / self.problem.samples
        for name in contenders:
            method = name.split(" ")[-1]
            if name in self.missing:
                continue
            if name in OURS and method in CHOSEN:
                yield from (Run(name, rtol, partial(self.chosen, method, rtol)) for rtol in TOLERANCES)
            elif name in OURS and method == IN_TURN:
                yield from (Run(name, rtol, partial(self.in_turn, rtol)) for rtol in TOLERANCES)
            elif name in OURS:
                yield from (Run(name, length / every, partial(self.fixed, method, every)) for every in STEPS)
            elif method in PYTHON:
                yield from (Run(name, rtol, partial(self.python, method, rtol)) for rtol in TOLERANCES)
            else:
                try:
                    peer = MujocoPeer(eomgen.load_robot(self.problem.key), method)
                except (MissingPeer, InputError) as error:
                    self.missing[name] = str(error)
                    continue
                yield from (Run(name, length / every, partial(self.simulated, peer, every)) for every in STEPS)
