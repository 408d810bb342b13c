"""Write the measurements of docs/friction.md: costs of friction with an internal state, and errors of methods.

    python -m benchmarks.friction [--rounds ROUNDS] [--print]

Times are processor times of one call, the least of rounds in which all runs take turns on one core.
"""

from __future__ import annotations

import argparse
import math
import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

import eomgen
from eomgen.arrays import Array
from eomgen.bench.beside import processor_name
from eomgen.codegen.package.compile import find_compiler
from eomgen.description.load import robot_from_toml
from eomgen.errors import EomgenWarning, InternalError
from eomgen.integration.solve import integrate
from eomgen.kernel.stepping.input_signals import DriveData, Signal, Track
from eomgen.robot.value import Friction, Robot

from .bars import Bar, conclusion

PAGE = Path(__file__).parents[1] / "docs" / "friction.md"
BEGIN, END = "<!-- begin of measurements -->\n", "<!-- end of measurements -->"
KERNELS = ("forward_dynamics", "energy", "mass_matrix", "inverse_dynamics", "residual_jacobian")
ROLLOUTS = ("adaptive_rollout", "radau_rollout")

COMMON = {"coulomb": 3.0, "static": 4.0, "stribeck": 0.05, "viscous": 1.0}  # N m, rad/s, N m s/rad
WITHOUT, COARSE, BRISTLES = "without a state", "without a state, smoothing 1e-3 rad/s", "LuGre"
LAWS = {
    WITHOUT: Friction(**COMMON, shape="gaussian"),
    COARSE: Friction(**COMMON, shape="gaussian", smoothing=1e-3),
    BRISTLES: Friction(**COMMON, bristle_stiffness=3e4, bristle_damping=20.0, fade=0.05),
}
ARM_TOLERANCES, ARM_SPAN = (1e-4, 1e-6, 1e-8), 1.0  # s
REQUIRED = 1.6  # times that of friction without a state

COULOMB, STATIC, STRIBECK, VISCOUS, STIFFNESS, DAMPING = 1.0, 1.5, 1e-3, 0.4, 1e5, math.sqrt(1e5)
SPRING, PULL, SPAN, SAMPLES = 2.0, 0.1, 20.0, 200  # N/m, m/s, s
BLOCK = f"""
name = "block"
gravity = [0.0, -9.81, 0.0]
[[links]]
name = "body"
mass = 1.0
[[joints]]
name = "slide"
type = "prismatic"
parent = "base"
child = "body"
[joints.z]
stiffness = {SPRING}
[joints.z.friction]
model = "lugre"
coulomb = {COULOMB}
static = {STATIC}
stribeck = {STRIBECK}
viscous = {VISCOUS}
bristle_stiffness = {STIFFNESS}
bristle_damping = {DAMPING!r}
"""
IN_C, IN_PYTHON = ("tsit5", "rosenbrock", "radau", "auto"), ("scipy:Radau", "scipy:DOP853")
TOLERANCES = (1e-4, 1e-6, 1e-8)
LONG = 1.0  # s of processor time: such runs are taken twice


@dataclass(frozen=True)
class Run:
    """A motion that is timed: what a table says of it, and a call that returns positions, steps and evaluations."""

    label: str
    rtol: float
    call: Callable[[], tuple[Array, int, int]]


@dataclass(frozen=True)
class Timed:
    """A run's positions at samples, steps, evaluations (0: not counted) and least processor time, s."""

    run: Run
    q: Array
    steps: int
    evaluations: int
    seconds: float


def timed(runs: Sequence[Run], rounds: int) -> list[Timed]:
    """Return the runs with their least processor times of rounds in turns."""
    least, found = [math.inf] * len(runs), [run.call() for run in runs]
    for k in range(rounds):
        for i, run in enumerate(runs):
            if k > 1 and least[i] > LONG:
                continue
            began = time.process_time()
            run.call()
            least[i] = min(least[i], time.process_time() - began)
    return [Timed(run, *what, seconds) for run, what, seconds in zip(runs, found, least, strict=True)]


def arm_with(friction: Friction) -> Robot:
    """Return the UR5 with friction in its six joints."""
    arm = eomgen.load_robot("ur5")
    joints = []
    for joint in arm.joints:
        if joint.coordinates:
            joint = replace(
                joint,
                coordinates={**joint.coordinates, "gamma": replace(joint.coordinates["gamma"], friction=friction)},
            )
        joints.append(joint)
    return replace(arm, joints=tuple(joints))


def arm_runs() -> list[Run]:
    """Return the arm's motion to a pose by a PD law, with each law and tolerance."""
    runs: list[Run] = []
    for name, friction in LAWS.items():
        kernel = eomgen.build(arm_with(friction), kernels=("forward_dynamics", "adaptive_rollout"))
        n = len(kernel.coordinates)
        q = np.array([0.0, -1.0, 1.0, -0.5, 0.3, 0.2])
        gains: dict[str, Any] = {"kp": np.full(n, 2000.0), "kd": np.full(n, 100.0), "target": q + 0.5}
        if kernel.internal_states:
            gains["z"] = np.zeros(len(kernel.internal_states))

        def move(
            rtol: float, kernel: eomgen.Kernel = kernel, q: Array = q, more: dict[str, Any] = gains
        ) -> tuple[Array, int, int]:
            motion = kernel.rollout(
                q, 0.0 * q, 0.0 * q, duration=ARM_SPAN, samples=20, rtol=rtol, method="rosenbrock", **more
            )
            return motion[0], int(motion.steps), 0

        runs += [Run(name, rtol, lambda rtol=rtol, move=move: move(rtol)) for rtol in ARM_TOLERANCES]  # type: ignore[misc]
    return runs


def arm_table(rounds: int) -> list[str]:
    """Return times of the arm's motion, a row for each tolerance, and what is required of them."""
    runs = timed(arm_runs(), rounds)
    by = {(x.run.label, x.run.rtol): x for x in runs}
    lines = [
        "| relative tolerance |" + "".join(f" {name}: steps | ms |" for name in LAWS) + f" {BRISTLES} by {WITHOUT} |"
    ]
    lines.append("|---:" * (2 * len(LAWS) + 2) + "|")
    bars = []
    for rtol in ARM_TOLERANCES:
        ratio = by[BRISTLES, rtol].seconds / by[WITHOUT, rtol].seconds
        bars.append(Bar(f"{BRISTLES} at a relative tolerance of {rtol:.0e}", ratio, REQUIRED, at_most=True))
        cells = "".join(f" {by[name, rtol].steps} | {1e3 * by[name, rtol].seconds:.3g} |" for name in LAWS)
        lines.append(f"| {rtol:.0e} |{cells} {ratio:.2f} {bars[-1].brackets} |")
    return [*lines, "", conclusion(bars, ".2f")]


class Ramp:
    """The force of a spring whose end moves at PULL: SPRING PULL t, N."""

    def __call__(self, t: float, q: Array, v: Array) -> list[float]:
        return [SPRING * PULL * t]

    def load_data(self) -> DriveData:
        """Return it as a time-signal input."""
        line = Signal(np.array([0.0, SPAN]), np.array([[[0.0], [SPRING * PULL]]]))
        return DriveData(torque=Track(line, np.array([0])))


def exact() -> Array:
    """Return positions at samples: the published equations by DOP853 at 1e-12, with which Radau IIA agrees."""

    def rates(t: float, y: Array) -> list[float]:
        x, v, z = y
        level = COULOMB + (STATIC - COULOMB) * math.exp(-min((v / STRIBECK) ** 2, 700.0))
        rate = v - STIFFNESS * abs(v) * z / level
        return [v, SPRING * (PULL * t - x) - STIFFNESS * z - DAMPING * rate - VISCOUS * v, rate]

    times, tolerances = np.linspace(0.0, SPAN, SAMPLES + 1), {"rtol": 1e-12, "atol": [1e-14, 1e-14, 1e-17]}
    return np.asarray(solve_ivp(rates, (0.0, SPAN), np.zeros(3), "DOP853", times, **tolerances).y[0])


def block_runs(kernel: eomgen.Kernel) -> list[Run]:
    """Return the published experiment by each method and tolerance."""

    def move(method: Any, rtol: float) -> tuple[Array, int, int]:
        motion = integrate(
            kernel, [0.0], [0.0], SPAN, drive=Ramp(), method=method, rtol=rtol, output_step=SPAN / SAMPLES
        )
        return motion.q[:, 0], int(motion.info["steps"]), int(motion.info["evaluations"])

    return [
        Run(method, rtol, lambda method=method, rtol=rtol: move(method, rtol))  # type: ignore[misc]
        for method in (*IN_C, *IN_PYTHON)
        for rtol in TOLERANCES
    ]


def block_table(rounds: int) -> list[str]:
    """Return errors, steps and times of the published experiment, a row for each method and tolerance."""
    kernel = eomgen.build(robot_from_toml(BLOCK), kernels=(*KERNELS, *ROLLOUTS))
    expected, narrow = exact(), block_runs(kernel)[0]
    closest = integrate(
        kernel, [0.0], [0.0], SPAN, drive=Ramp(), method="radau", rtol=1e-11, output_step=SPAN / SAMPLES
    ).q[:, 0]
    if not np.abs(closest - expected).max() < 1e-8:
        raise InternalError(f"Radau IIA and DOP853 differ by {np.abs(closest - expected).max():.3g} m ({narrow.label})")
    lines = ["| method | relative tolerance | largest error, m | steps | evaluations | ms |", "|---|" + "---:|" * 5]
    for x in timed(block_runs(kernel), rounds):
        method = f"`{x.run.label}`"
        error, ms = float(np.abs(x.q - expected).max()), 1e3 * x.seconds
        lines.append(f"| {method} | {x.run.rtol:.0e} | {error:.1e} | {x.steps} | {x.evaluations} | {ms:.3g} |")
    return lines


def report(rounds: int) -> str:
    """Return both tables, and what they were measured on."""
    machine = f"{processor_name()}, {find_compiler().version.splitlines()[0]}"
    lines = [
        f"Measured by `python -m benchmarks.friction` on {machine}:",
        "processor times of one call, the least of rounds in which all take turns on one core.",
        "",
        f"{ARM_SPAN:g} s of the UR5 to another pose by a PD law, with friction in its six joints, by `rosenbrock`; in",
        "brackets what is required:",
        "",
        *arm_table(rounds),
        "",
        f"{SPAN:g} s of the published experiment at {SAMPLES} samples, by `integrate`, which also looks for contacts",
        "and computes energies and drives at samples; errors are those of the position, beside scipy:DOP853 at a",
        "relative tolerance of 1e-12:",
        "",
        *block_table(rounds),
    ]
    return "\n".join(lines) + "\n"


def main() -> None:
    """Measure, and write the figures into the page or print them."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.friction")
    parser.add_argument("--rounds", type=int, default=40, help="rounds in turns (40)")
    parser.add_argument("--print", action="store_true", help="print the tables, write nothing")
    options = parser.parse_args()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", EomgenWarning)
        text = report(options.rounds)
    if options.print:
        print(text, end="")
        return
    page = PAGE.read_text(encoding="utf-8")
    before, rest = page.split(BEGIN)
    PAGE.write_text(before + BEGIN + text + END + rest.split(END, 1)[1], encoding="utf-8")


if __name__ == "__main__":
    main()
