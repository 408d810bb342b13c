"""What forces add to a robot: to its kernels, their derivatives, its closed form, and implicit steps."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

import eomgen
from eomgen.codegen.c.operation_counts import operations
from eomgen.codegen.closed_form.trace import closed_form
from eomgen.codegen.kernels.equations import derive_equations
from eomgen.robot.model import build_model
from eomgen.robot.value import Robot
from tests.oracles.complex_step import complex_steps
from tests.support.builds import Build
from tests.support.closeness import close
from tests.support.methods import method_of
from tests.support.programs import answer
from tests.support.random_robots import Array, State

NAMES = ("inverse_dynamics", "generalized_force", "forward_dynamics", "energy", "residual_jacobian", "mass_matrix")
JACOBIANS = ("residual_jacobian", "forward_dynamics", "forward_dynamics_jacobian")


def stacked(states: Sequence[State], labels: str = "qv") -> list[Array]:
    """Return arrays of several states, (states, n) each."""
    return [np.array([getattr(s, x) for s in states]) for x in labels]


def check_forces(
    robot: Robot, bare: Robot, states: Sequence[State], forces: Sequence[Array], energies: Sequence[float], built: Build
) -> tuple[eomgen.Kernel, eomgen.Kernel]:
    """Compare a robot with one without its forces: one state at a time, several at once, and in single precision.

    Returns:
        The kernels of both robots.
    """
    kernel, other = built(robot, *NAMES), built(bare, *NAMES)
    for s, force, energy in zip(states, forces, energies, strict=True):
        assert close(kernel.inverse_dynamics(s.q, s.v, s.a), other.inverse_dynamics(s.q, s.v, s.a) - force)
        assert close(kernel.forward_dynamics(s.q, s.v, s.u), other.forward_dynamics(s.q, s.v, s.u + force), 1e-8)
        assert close(kernel.energy(s.q, s.v), other.energy(s.q, s.v) + [0.0, energy])
    arrays = stacked(states)
    assert close(kernel.generalized_force(*arrays), other.generalized_force(*arrays) + forces)
    check_single_precision(kernel, robot, arrays, built)
    return kernel, other


def check_same(kernel: eomgen.Kernel, other: eomgen.Kernel, states: Sequence[State], tolerance: float = 1e-11) -> None:
    """Compare kernels of one robot that is described in two ways, one state at a time and several at once."""
    for s in states:
        assert close(kernel.inverse_dynamics(s.q, s.v, s.a), other.inverse_dynamics(s.q, s.v, s.a), tolerance)
        assert close(kernel.forward_dynamics(s.q, s.v, s.u), other.forward_dynamics(s.q, s.v, s.u), 1e-8)
        assert close(kernel.energy(s.q, s.v), other.energy(s.q, s.v), tolerance)
    arrays = stacked(states)
    assert close(kernel.generalized_force(*arrays), other.generalized_force(*arrays), tolerance)


def check_oracle(kernel: eomgen.Kernel, oracle: Any, s: State) -> None:
    """Compare forces, accelerations and energies with those of an oracle."""
    n, z, still = kernel.n, {"z": s.z} if s.z.size else {}, 0.0 * s.z
    q, v, a, u = (np.concatenate(x) for x in ((s.q, still), (s.v, s.z), (s.a, s.rates), (s.u, still)))
    expected = oracle.inverse_dynamics(q, v, a)[:n]
    assert close(kernel.inverse_dynamics(s.q, s.v, s.a, **z), expected)
    assert close(kernel.residual(s.q, s.v, s.a, s.u, **z), expected - s.u)
    assert close(kernel.generalized_force(s.q, s.v, **z), oracle.generalized_force(q, v)[:n])
    allowed = max(1e-11, 100 * np.finfo(float).eps * np.linalg.cond(kernel.mass_matrix(s.q)))
    assert close(kernel.forward_dynamics(s.q, s.v, s.u, **z), oracle.forward_dynamics(q, v, u)[:n], allowed)
    assert close(kernel.energy(s.q, s.v, **z), oracle.energy(q, v))


def check_batches(kernel: eomgen.Kernel, states: Sequence[State], **counts: int) -> None:
    """Compare functions of several states at once with those of one at a time; they read as many of q, v and a."""
    arrays, z = stacked(states, "qva"), np.array([s.z for s in states])
    for name, count in counts.items():
        call, apart = method_of(kernel, name), name in kernel.raw.libraries.meta.get("stateful", ())
        rows = zip(zip(*arrays[:count], strict=True), z, strict=True)
        one = np.array([call(*state, **({"z": x} if apart else {})) for state, x in rows])
        assert close(np.asarray(call(*arrays[:count], **({"z": z} if apart else {}))), one, 1e-12)


def check_single_precision(
    kernel: eomgen.Kernel, robot: Robot, arrays: Sequence[Array], built: Build, tolerance: float = 1e-4
) -> None:
    """Compare forces in single precision with a kernel's of double precision."""
    few = [x.astype(np.float32) for x in arrays]
    found = built(robot, "generalized_force", dtype="float32").generalized_force(*few)
    assert found.dtype == np.float32
    assert close(found, kernel.generalized_force(*(x.astype(float) for x in few)), tolerance)


def check_slopes(robot: Robot, s: State, tolerance: float = 1e-10, of: Robot | None = None) -> None:
    """Compare derivatives of the residual's program with complex steps, of another robot's residual if one is given."""
    size = build_model(robot).size
    check_columns(answer(robot, "residual_jacobian", s).reshape(3, size, size), of or robot, s, tolerance)


def check_columns(slopes: Array, robot: Robot, s: State, tolerance: float = 1e-11) -> None:
    """Compare derivatives of a residual's rows by q, by v and z, and by a, (3, n + m, n + m), with complex steps."""
    n = s.q.size
    for block, names in zip(slopes, ("q", "vz", "a"), strict=True):
        wanted = np.hstack([complex_steps(robot, s, name) for name in names if getattr(s, name).size])
        assert close(block[:n, : wanted.shape[1]], wanted, tolerance)


def check_jacobians(robot: Robot, states: Sequence[State], built: Build) -> None:
    """Compare compiled derivatives of the residual with complex steps, and those of forward dynamics with them."""
    kernel = built(robot, *JACOBIANS)
    n, run = kernel.n, kernel.calls.run
    for s in states:
        check_columns(run(kernel.residual_jacobian, None, (s.q, s.v, s.a), z=s.z, whole=True), robot, s)
    a = kernel.forward_dynamics(s.q, s.v, s.u, s.z)
    by_q, by_v, M = run(kernel.residual_jacobian, None, (s.q, s.v, a), z=s.z, whole=True)[:, :n]
    blocks = run(kernel.forward_dynamics_jacobian, None, (s.q, s.v, s.u), z=s.z, whole=True)[:, :n]
    for block, wanted in zip(blocks, (-by_q, -by_v, np.eye(n, kernel.calls.rates)), strict=True):
        assert close(M[:, :n] @ block, wanted, 1e-9)


def check_closed_form(robot: Robot, s: State, tolerance: float = 1e-11) -> None:
    """Compare SymPy's residual and energies with those of the programs."""
    function = closed_form(build_model(robot)).function("residual", "kinetic", "potential")
    residual, *energies = function(s.q, s.v, s.a, s.u, z=s.z)
    assert close(answer(robot, "residual", s), residual, tolerance)
    assert close(answer(robot, "energy", s), np.array(energies, float), tolerance)


def implicit_step(robot: Robot, s: State, dt: float) -> Array:
    """Return accelerations, then derivatives of internal states, of an implicit step by its program, (n + m,)."""
    return answer(robot, "implicit_step", s, added=np.zeros(s.u.size + s.forces.size), dt=np.array([dt, dt * dt]))


def check_step(
    robot: Robot, bare: Robot, s: State, dt: float, push: Callable[[Array], Array], tolerance: float = 1e-6
) -> None:
    """Compare an implicit step with that of a robot without the forces, under what they push at its end.

    Args:
        push: The forces' values, (n,), by the step's acceleration.
    """
    a, model = implicit_step(robot, s, dt), build_model(robot)
    u = np.where(np.isin(np.arange(s.u.size), model.prescribed), s.u, s.u + push(a))
    assert close(a, implicit_step(bare, replace(s, u=u), dt), tolerance)


def products(robot: Robot, kernel: str = "inverse_dynamics") -> int:
    """Return how many products a kernel takes."""
    return operations(derive_equations(build_model(robot), (kernel,)))[kernel]["mul"]
