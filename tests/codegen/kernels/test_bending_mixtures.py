"""Robots whose links bend, with laws, motors, drives, prescribed coordinates, springs, bushings and loops at once.

Equations of bodies alone are compared with Lagrange's in ``tree/test_bending_trees.py``; here kernels' programs are
compared with each other, whatever parts a robot has.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from eomgen.codegen.kernels.steps.tolerances import coordinate_sizes
from eomgen.errors import InputError
from eomgen.robot.elements import Bushing
from eomgen.robot.model import Model, build_model
from eomgen.robot.parameter_names import parameters
from eomgen.robot.value import Placement
from tests.oracles.complex_step import complex_jacobian
from tests.support.added_forces import check_columns
from tests.support.bending_mixtures import PARTS, arrays, mixture
from tests.support.programs import answer, by_solvers
from tests.support.random_robots import Array, State, seeds

LIMIT = 1e-11  # relative to the largest number of a result, or to 1


def close(found: Array, expected: Array, limit: float = LIMIT) -> None:
    assert np.abs(found - expected).max(initial=0.0) <= limit * max(1.0, float(np.abs(expected).max(initial=0.0)))


def slopes_of_residual(model: Model, s: State) -> Array:
    """Return derivatives of the residual and of internal states' rows by q, by v and z, and by a, (3, n + m, n + m)."""
    return answer(model.robot, "residual_jacobian", s).reshape(3, model.size, model.size)


def check_rows_of_states(slopes: Array, model: Model, s: State) -> None:
    """Rows of internal states are minus their rates times their inertias, which the derivatives by a have."""
    n, given = len(s.q), arrays(s, "q", "v", "z", "u")
    kernel = "tree_forward_dynamics" if model.constraints else "forward_dynamics"
    for block, labels in zip(slopes, ("q", "vz"), strict=False):
        rates = np.hstack([complex_jacobian(model.robot, kernel, given, x)[n:] for x in labels if given[x].size])
        close(block[n:, : rates.shape[1]], -np.diag(slopes[2])[n:, np.newaxis] * rates)


@pytest.mark.parametrize("seed", seeds(0, 4, 120))
def test_mass_matrices_and_derivatives(seed: int) -> None:
    """M is symmetric and positive, and what inverse dynamics takes per acceleration; slopes are complex steps'."""
    mixed = mixture(seed)
    robot, s = mixed.robot, mixed.state(seed)
    model = build_model(robot)
    n, slopes = len(model.coordinates), slopes_of_residual(model, s)
    M, by_a = answer(robot, "mass_matrix", q=s.q).reshape(n, n), slopes[2]
    assert np.array_equal(M, M.T)
    assert np.linalg.eigvalsh(M)[0] > 0.0
    whole = np.diag(np.diag(by_a))
    whole[:n, :n] = M
    close(whole, by_a)
    assert (np.diag(by_a) > 0.0).all()  # states of drives, which store nothing, too
    needed, still = (answer(robot, "inverse_dynamics", s, a=a) for a in (s.a, 0.0 * s.a))
    close(needed - still, M @ s.a)
    if not model.drives:  # whose slopes are apart
        check_columns(slopes, robot, s, LIMIT)
        if model.internal_states:
            check_rows_of_states(slopes, model, s)


@pytest.mark.parametrize("seed", seeds(200, 3, 100))
def test_accelerations_by_all_solvers(seed: int) -> None:
    """Those that inverse dynamics answers with the drives; of loops those that keep them closed."""
    mixed = mixture(seed, tuple(x for x in PARTS if x != "drives")[seed % 2 :: 2])
    robot, s = mixed.robot, mixed.state(seed)
    model = build_model(robot)
    n, given = len(model.coordinates), list(model.prescribed)
    if not model.constraints:
        u = answer(robot, "inverse_dynamics", s)
        u[given] = s.a[given]
        M = answer(robot, "mass_matrix", q=s.q).reshape(n, n)
        for a in by_solvers(robot, "forward_dynamics", q=s.q, v=s.v, z=s.z, u=u).values():
            close(a[:n], s.a, 1e-13 * float(np.linalg.cond(M)))
        return
    J = answer(robot, "constraint_jacobian", q=s.q).reshape(-1, n)
    bias = answer(robot, "constraint_bias", q=s.q, v=s.v)
    free = np.setdiff1d(np.arange(n), given)
    for values in by_solvers(robot, "constrained_dynamics", **arrays(s, "q", "v", "z", "u")).values():
        a, multipliers = values[:n], values[model.size : model.size + len(J)]
        close(J @ a, -bias, 1e-9)
        residual = answer(robot, "residual", s, a=a)
        pushed = J.T @ multipliers
        assert np.abs((residual - pushed)[free]).max() < 1e-9 * max(1.0, np.abs(pushed).max())


@pytest.mark.parametrize("seed", seeds(700, 2, 60))
def test_forces_at_rest_are_slopes_of_energy(seed: int) -> None:
    """Whatever stores energy: laws, transmissions, springs and bushings on nodes, modes; all that damps is silent."""
    rng = np.random.default_rng(seed)
    mixed = mixture(seed, tuple(x for x in PARTS if x != "drives" and rng.random() < 0.5))
    s = mixed.state(seed)
    still = {"q": s.q, "v": np.zeros_like(s.v), "z": np.zeros_like(s.z)}
    needed = answer(mixed.robot, "inverse_dynamics", **still, a=still["v"])
    close(needed, complex_jacobian(mixed.robot, "energy", still, "q").sum(axis=0))


@pytest.mark.parametrize("seed", seeds(800, 2, 60))
def test_wrenches_of_joints_have_what_drives_need(seed: int) -> None:
    """Along each coordinate of a joint its wrench is the drive's force less those of spring, damper and rotor."""
    mixed = mixture(seed, ("springs", "bushings", "offsets", "prescribed")[seed % 3 :])
    robot, s = mixed.robot, mixed.state(seed)
    model = build_model(robot)
    needed = answer(robot, "inverse_dynamics", **arrays(s, "q", "v", "a"))
    wrenches = answer(robot, "reactions", **arrays(s, "q", "v", "a")).reshape(-1, 6)
    poses = answer(robot, "kinematics", q=s.q)[: 12 * len(model.frames)].reshape(-1, 3, 4)
    found, expected = [], []
    for body, own in zip(model.bodies, wrenches, strict=True):
        frame = model.frames.index(body.name)
        R = poses[frame, :, :3] @ np.array(robot.joint(body.joint).axis_turn)
        wrench = np.concatenate([R @ own[:3], R @ own[3:]])
        for i in body.indices:
            rates = answer(robot, "frame_velocities", q=s.q, v=np.eye(model.size)[i]).reshape(-1, 6)
            found.append(rates[frame] @ wrench)
            c = robot.coordinates[model.coordinates[i]]
            parts = ((c.stiffness, s.q), (c.damping, s.v), (c.armature, s.a))
            expected.append(needed[i] - sum((number or 0.0) * x[i] for number, x in parts))
    assert np.abs(np.array(found) - expected).max() < LIMIT * np.abs(wrenches).max()


def test_bodies_whose_modes_have_the_same_mass() -> None:
    """Mass, centre of mass and inertia are no parameters of a link that bends: its modes would contradict them."""
    robot = mixture(1).robot
    name = next(x.name for x in robot.links if x.modes is not None)
    for key in ("mass", "com.x", "inertia.xx"):
        said = rf"tunable: 'links\.{name}\.{key}': the modes of {name} are of the same mass.*modes\.1\.stiffness"
        with pytest.raises(InputError, match=said):
            build_model(replace(robot, tunable=(f"links.{name}.{key}",)))


def test_a_pole_that_modes_alone_move_is_refused() -> None:
    """A bushing between a link and its own node, whose angles are singular at home: sizes divided by zero."""
    robot = mixture(900, ("laws", "motors", "followers")).robot
    placements = (
        Placement.from_rpy((0.0, 0.5, 0.0), (np.pi / 2, 0.0, np.pi / 2)),
        Placement((0.25, 0.03, 0.0), ((0.0, -1.0, 0.0), (0.0, 0.0, 1.0), (-1.0, 0.0, 0.0))),
    )
    mount = Bushing("mount", ("link1", "link1_node1"), placements, (10.0,) * 6, None)
    with pytest.raises(InputError, match=r"home puts bushings\.mount at beta = \+-90 degrees"):
        coordinate_sizes(build_model(replace(robot, elements=(mount,))))


@pytest.mark.parametrize("seed", seeds(400, 2, 40))
def test_every_number_that_is_a_parameter(seed: int) -> None:
    """With all numbers that may be parameters read as they run, the same equations."""
    mixed = mixture(seed)
    names = tuple(".".join(x.path) for x in parameters(mixed.robot) if x.is_set)
    assert any(".modes.1.stiffness" in name for name in names)
    robot, s = replace(mixed.robot, tunable=names), mixed.state(seed)
    for kernel in ("mass_matrix", "inverse_dynamics", "energy", "kinematics"):
        close(answer(robot, kernel, s), answer(mixed.robot, kernel, s))
