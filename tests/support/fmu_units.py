"""Units that fmpy runs, with the kernel of their robot: what they compute, its derivatives, and what is declared."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from eomgen.description.load import load_robot
from eomgen.export.fmu.pack import export_fmu
from eomgen.kernel.complete import Kernel
from eomgen.robot.value import Robot
from eomgen.runtime.raw import Array
from tests.support.bristles import (
    bent,
    bristle_arm,
    bristle_gear,
    bristle_linkage,
    servo_arm,
    stateful_arm,
    stateful_linkage,
)
from tests.support.builds import Build
from tests.support.fmu_host import Host, fmpy
from tests.support.random_motors import motor_state
from tests.support.soak import soaked

VERSIONS = soaked((2, 3), (3,))  # what differs between both is little
FIXED = ("rk4", "implicit")
COMPUTED = ("der(q.", "a.", "der(z.", "constraint.", "pose.", "reaction.", "energy.")
AXIS = Path(__file__).parents[2] / "examples" / "servo_axis.toml"
BUILTIN = ("one_link", "worn_arm", "geared_arm", "shaken_arm")
WITH_STATES: dict[str, Callable[[], Robot]] = {  # robots whose laws have internal states
    "arm": bristle_arm,
    "linkage": bristle_linkage,
    "gear": bristle_gear,
    "laws": stateful_arm,
    "loop": stateful_linkage,
    "servo": servo_arm,
    "axis": lambda: load_robot(AXIS),
}


def robot_of(name: str) -> Robot:
    """Return a built-in robot, or one whose laws have internal states."""
    return WITH_STATES[name]() if name in WITH_STATES else load_robot(name)


class Unit:
    """An exported unit, unpacked; ``host`` instantiates it."""

    def __init__(self, robot: Robot, folder: Path, version: int, built: Build, **options: Any) -> None:
        step = {"step": 1e-3} if options.get("method", "rk4") in FIXED else {}
        options = {"method": "rk4", "flags": ("-O0", "-Werror"), **step, **options}
        self.robot, self.folder, self._built = robot, folder / "unpacked", built
        self.path = export_fmu(robot, folder / f"{robot.name}.fmu", version, **options)
        fmpy.extract(str(self.path), str(self.folder))

    @cached_property
    def kernel(self) -> Kernel:
        """The robot's kernel."""
        return self._built(self.robot)

    def host(self, **options: Any) -> Host:
        """Return an instance."""
        return Host(self.folder, **options)


Export = Callable[..., Unit]


@dataclass(frozen=True)
class Point:
    """A state, drives and wrenches; z: internal states, None where there are none."""

    q: Array
    v: Array
    u: Array
    wrench: Array
    z: Array | None = None

    @property
    def states(self) -> Array:
        return np.concatenate([self.q, self.v, *([] if self.z is None else [self.z])])

    @property
    def all(self) -> Array:
        return np.concatenate([self.states, self.u, self.wrench.ravel()])


def point_of(unit: Unit, seed: int, size: float = 1.0) -> Point:
    """Return a random point; of robots of ``WITH_STATES`` one whose internal states are as large as they get."""
    kernel, rng = unit.kernel, np.random.default_rng(seed + 9)
    wrench = rng.uniform(-5.0, 5.0, (len(kernel.links), 6))
    if unit.robot.name in [make().name for make in WITH_STATES.values()]:
        q, v, u, z = bent(kernel, seed)
        return Point(q, v, u, wrench, z)
    state = motor_state(unit.robot, seed)
    z = size * state.z if kernel.internal_states else None
    return Point(size * state.q, size * state.v, state.u, wrench, z)


def names_of(host: Host, *kinds: str) -> list[str]:
    """Return the variables of kinds, in their order."""
    return [name for kind in kinds for name in host.names(kind)]


def states(host: Host) -> list[str]:
    return names_of(host, "q.", "v.", "z.")


def knowns(host: Host) -> list[str]:
    """Return states and inputs."""
    return names_of(host, "q.", "v.", "z.", "u.", "wrench.")


def outputs(host: Host) -> list[str]:
    """Return what is computed."""
    return names_of(host, *COMPUTED)


def expected(kernel: Kernel, p: Point) -> Array:
    """Return the kernel's values of ``outputs``."""
    a = kernel.forward_dynamics(p.q, p.v, p.u, p.z, wrench=p.wrench)
    found = [p.v, a]
    if p.z is not None:
        found.append(kernel.internal_state_derivatives(p.q, p.v, p.z, p.u))
    for frame in kernel.frames:
        if frame != "base":
            pose = kernel.frame_pose(p.q, frame)
            found += [pose[:3, 3], pose[:3, :3].ravel()]
    reactions = kernel.reactions(p.q, p.v, a, wrench=p.wrench, z=p.z)
    return np.concatenate([*found, reactions.ravel(), kernel.energy(p.q, p.v, z=p.z)])


def close(found: Array, wanted: Array, tolerance: float) -> None:
    scale = max(1.0, float(np.abs(wanted).max()))
    assert float(np.abs(found - wanted).max()) <= tolerance * scale


def check_derivatives(unit: Unit, point: Array, sizes: Array | float, seed: int, within: float = 2e-7) -> None:
    """Assert that directional derivatives are differences of fourth order of the unit's own outputs.

    Args:
        unit: The unit.
        point: Values of ``knowns``.
        sizes: Steps of the differences.
        seed: Of the directions.
        within: Allowed deviation of a kind of outputs, relative to its largest one or 1.
    """
    host, twin, rng = unit.host().start(), unit.host(), np.random.default_rng(seed)
    names, unknown, n = knowns(host), outputs(host), len(states(host))
    host.to_continuous_time()
    host.set_states(point[:n])
    host.set(names[n:], point[n:])

    def at(x: Array) -> Array:
        twin.set(names, x)
        return twin.get(unknown)

    for i in range(3):
        h = sizes * rng.uniform(-1.0, 1.0, len(names))
        if i == 2:  # the wrenches' rotation with the links alone
            h[len(host.names("q.")) :] = 0.0
        near, far = (at(point + k * h) - at(point - k * h) for k in (1.0, 2.0))
        wanted, found, first = (8.0 * near - far) / 12.0, host.derivative(unknown, names, h), 0
        for group in filter(None, map(host.names, COMPUTED)):
            part = slice(first, first + len(group))
            scale = max(float(np.max(sizes)), float(np.abs(wanted[part]).max()))
            assert np.abs(found[part] - wanted[part]).max() <= within * scale, group[0]
            first = part.stop


def check_dependencies(unit: Unit, p: Point) -> int:
    """Assert that declared dependencies are those of the derivatives that are not zero, and return their number."""
    names = knowns(unit.host())
    host = unit.host().start(names, p.all)
    structure = [*host.description.outputs, *host.description.derivatives]
    unknown = [x.variable.name for x in structure]
    columns = {name: host.derivative(unknown, [name], [1.0]) for name in names}
    declared = 0
    for row, entry in enumerate(structure):
        if entry.dependencies is not None:
            declared += 1
            named = {x.name for x in entry.dependencies}
            assert {name for name in names if columns[name][row] != 0.0} <= named, entry.variable.name
            if not entry.variable.name.startswith(("pose.", "energy.")):
                assert len(named) == 1
    return declared


def check_steps(unit: Unit, p: Point, step: float, duration: float, calls: int = 5) -> None:
    """Assert that co-simulation is the rollout without wrenches, and with them what DOP853 integrates."""
    kernel = unit.kernel
    for wrench, tolerance in ((0.0 * p.wrench, 1e-12), (p.wrench, 1e-9)):
        host = unit.host(stepping=True)
        host.start([*knowns(host), "solver.step"], [*p.states, *p.u, *wrench.ravel(), step])
        for k in range(calls):
            host.step(k * duration / calls, duration / calls)
        if wrench.any():
            wanted = direct(kernel, p, duration)
        else:
            wanted = rolled(kernel, p, dt=step, steps=round(duration / step))
        found = host.get(states(host))
        print(f"{kernel.name}: {np.abs(found - wanted).max():.1e} from {'DOP853' if wrench.any() else 'the rollout'}")
        close(found, wanted, tolerance)
        assert abs(host.get(["time"])[0] - duration) <= 1e-15
        host.unit.terminate()
        host.unit.freeInstance()


def rolled(kernel: Kernel, p: Point, **options: Any) -> Array:
    """Return the states at the end of a rollout without wrenches."""
    motion = kernel.rollout(p.q, p.v, p.u, z=p.z, **options)
    return np.concatenate([x[-1] for x in (*motion, *([] if p.z is None else [motion.z]))])


def direct(kernel: Kernel, p: Point, duration: float) -> Array:
    """Return the states at the end of the motion by DOP853 with tight tolerances, from the kernel."""
    n = kernel.n

    def rates(_: float, x: Array) -> Array:
        q, v, z = x[:n], x[n : 2 * n], None if p.z is None else x[2 * n :]
        found = [v, kernel.forward_dynamics(q, v, p.u, z, wrench=p.wrench)]
        return np.concatenate([*found, *([] if z is None else [kernel.internal_state_derivatives(q, v, z, p.u)])])

    return np.asarray(solve_ivp(rates, (0.0, duration), p.states, method="DOP853", rtol=1e-12, atol=1e-13).y[:, -1])


def exchanged(unit: Unit, x0: Array, inputs: Array, duration: float, **options: Any) -> Array:
    """Return states, (states, samples), that SciPy's DOP853 integrates out of the unit's rates by model exchange."""
    host = unit.host()
    host.start(knowns(host)[: x0.size + inputs.size], [*x0, *inputs])
    host.to_continuous_time()

    def rates(t: float, x: Array) -> Array:
        host.unit.setTime(t)
        host.set_states(x)
        return host.rates()

    found: Array = solve_ivp(rates, (0.0, duration), x0, method="DOP853", **options).y
    host.unit.terminate()
    host.unit.freeInstance()
    return found
