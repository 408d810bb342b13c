"""Equations as Python on arrays: the kernels' numbers under NumPy and JAX, for many states, and their derivatives."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen.codegen.arrays.sources import render_arrays
from eomgen.codegen.forces.bushings import Bushings
from eomgen.codegen.forces.joint_stiffness import JointStiffnesses
from eomgen.codegen.program.operations import OPERATIONS
from eomgen.description.load import robot_from_toml
from eomgen.errors import InputError
from eomgen.robot.model import build_model
from eomgen.robot.value import Robot
from tests.oracles.force_laws import with_drives, with_laws
from tests.support.bending_exports import BENDING
from tests.support.every_element import robot_with
from tests.support.optional import needs
from tests.support.random_robots import random_robot
from tests.support.refusals import refused
from tests.support.turning_loops import OFFSET, STAND, held_pendulum

pytestmark = [pytest.mark.quick, pytest.mark.usefixtures("unoptimised")]

NAMES = ("inverse_dynamics", "forward_dynamics", "mass_matrix", "bias_force", "generalized_force", "energy", "residual")
WITHOUT_EOMGEN = """
import sys, json
sys.modules["eomgen"] = None
import numpy, one_link_arrays
robot = one_link_arrays.make(numpy)
print(json.dumps(robot.forward_dynamics([0.1, 0.2], [0.3, 0.4], [0.0, 1.0], {"gravity.y": -1.6}).tolist()))
"""


def made(robot: Robot, xp: Any = np, **options: Any) -> Any:
    """Functions of the rendered text."""
    module: dict[str, Any] = {}
    exec(render_arrays(build_model(robot)), module)
    return module["make"](xp, **options)


def close(found: Any, expected: Any, allowed: float = 1e-13) -> None:
    found, expected = np.asarray(found), np.asarray(expected)
    assert found.shape == expected.shape
    assert np.abs(found - expected).max() <= allowed * np.abs(expected).max(initial=1e-300)


def compare(robot: Robot) -> None:
    """All functions for many states, with other parameters, beside the kernel's."""
    kernel, functions = eomgen.build(robot), made(robot)
    rng, beside = np.random.default_rng(1), {"z": len(kernel.internal_states), "forces": kernel.calls.inputs - kernel.n}
    x = {name: rng.uniform(-0.3, 0.3, (7, kernel.n)) for name in "qvau"}
    x |= {name: rng.uniform(-0.3, 0.3, (7, size)) for name, size in beside.items()}
    p = {"gravity.z": -3.0} | {name: 1.5 * value for name, value in kernel.parameters.items() if ".modes." in name}
    kernel.parameters.update(p)
    reads = {name: kernel.raw.functions[name].reads for name in NAMES}
    scale = np.linalg.cond(kernel.mass_matrix(x["q"])).max()
    for name in NAMES:
        arrays = [x[array] for array in reads[name]]
        expected = kernel.calls.run(name, None, arrays, whole=True)
        close(getattr(functions, name)(*arrays, p=p), expected, 1e-13 * (scale if name == "forward_dynamics" else 1.0))
    wrench = rng.uniform(-1.0, 1.0, (7, len(kernel.links), 6))
    close(functions.external_force(x["q"], wrench), kernel.functions.external_force(x["q"], wrench))
    poses = functions.frame_poses(x["q"])
    for i, frame in enumerate(kernel.frames):
        close(poses[:, i], kernel.frame_pose(x["q"], frame)[:, :3])


def test_one_link_with_numpy_alone(tmp_path: Path) -> None:
    eomgen.export_arrays("one_link", tmp_path / "one_link_arrays.py")
    command = [sys.executable, "-c", WITHOUT_EOMGEN]
    result = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr
    kernel = eomgen.build("one_link")
    kernel.parameters["gravity.y"] = -1.6
    close(eval(result.stdout), kernel.forward_dynamics([0.1, 0.2], [0.3, 0.4], [0.0, 1.0]))


def with_forces(seed: int) -> Robot:
    """A random tree with forces of every kind, every other one with servo drives."""
    robot = with_laws(random_robot(seed, joints=(2, 4), tree=True, max_coordinates=3), seed)
    return with_drives(robot, seed) if seed % 2 else robot


BUILTIN = ("one_link", "worn_arm", "ur5", "puma560", "puma560_elastic", "shaken_arm", "two_arms")
ROBOTS: dict[str, Callable[[], Robot]] = {
    **{name: partial(eomgen.load_robot, name) for name in BUILTIN},
    **{x.__name__: lambda x=x: robot_from_toml(robot_with(x)) for x in (JointStiffnesses, Bushings)},
    **BENDING,
    **{f"random {seed}": partial(with_forces, seed) for seed in range(8)},
}
SOAKED = [pytest.param(name, marks=pytest.mark.soak(most=8)) for name in ROBOTS if name not in ("one_link", "tree")]


@pytest.mark.parametrize("name", ["one_link", "tree", *SOAKED])
def test_robots_have_the_kernels_numbers(name: str) -> None:
    compare(ROBOTS[name]())


@pytest.mark.soak
def test_axes_parameters_and_rollouts() -> None:
    functions, kernel = made(eomgen.load_robot("one_link")), eomgen.build("one_link")
    q, v, u = np.array([1e-3, 0.2]), np.zeros((3, 1, 2)), np.linspace(0.0, 1.0, 8).reshape(4, 2)
    assert functions.forward_dynamics(q, v, u).shape == (3, 4, 2)
    heavy = functions.energy(q, np.zeros(2), p={"gravity.y": np.array([-1.0, -9.81])})
    assert heavy.shape == (2, 2)
    assert heavy[1, 1] == pytest.approx(kernel.energy(q, np.zeros(2))[1])
    found = functions.rollout(q, np.zeros(2), u[0], 1e-4, 20)
    for x, y in zip(found, kernel.rollout(q, np.zeros(2), u[0], 1e-4, 20), strict=True):
        np.testing.assert_allclose(x, y, rtol=1e-12, atol=1e-15)
    single = functions.forward_dynamics(*(x.astype(np.float32) for x in (q, v[0, 0], u[0])))
    assert single.dtype == np.float32 or np.lib.NumpyVersion(np.__version__) < "2.0.0"


def test_what_is_refused(tmp_path: Path) -> None:
    functions = made(eomgen.load_robot("one_link"))
    with pytest.raises(KeyError, match=r"parameter 'mass' is unknown; allowed: gravity\.x"):
        functions.mass_matrix(np.zeros(2), p={"mass": 1.0})
    refused(ValueError, r"q: expected shape \(\.\.\., 2\), got \(3,\)", functions.mass_matrix, np.zeros(3))
    with pytest.raises(InputError, match="kernels: 'thoughts' is unknown"):
        eomgen.export_arrays("one_link", tmp_path / "x.py", kernels=("thoughts",))
    with pytest.raises(InputError, match="'adaptive_rollout' is no program"):
        eomgen.export_arrays("one_link", tmp_path / "x.py", kernels=("adaptive_rollout",))
    refused(InputError, r"a path that ends in \.py", eomgen.export_arrays, "one_link", tmp_path / "x.txt")
    assert not list(tmp_path.iterdir())


def test_every_operation_has_a_form() -> None:
    assert all(operation.form for operation in OPERATIONS.values() if operation.arity)


@pytest.mark.soak
def test_jax_compiles_maps_and_differentiates() -> None:
    jax = needs("jax")
    jnp = jax.numpy
    from eomgen.adapters.jax import native

    with jax.enable_x64(True) if hasattr(jax, "enable_x64") else jax.experimental.enable_x64():
        functions, kernel = native("one_link", ("forward_dynamics",)), eomgen.build("one_link")
        rng = np.random.default_rng(2)
        q, v, u = (rng.uniform(-0.3, 0.3, (5, 2)) for _ in range(3))
        close(jax.jit(jax.vmap(functions.forward_dynamics))(q, v, u), kernel.forward_dynamics(q, v, u))
        slopes = jax.jacfwd(functions.forward_dynamics, (0, 1, 2))(q[0], v[0], u[0])
        for x, y in zip(slopes, kernel.forward_dynamics_jacobian(q[0], v[0], u[0]), strict=True):
            close(x, y)
        end = jax.jit(lambda u: jnp.sum(functions.rollout(q[0], v[0], u, 1e-3, 10)[0][-1]))
        h = 1e-6
        rate = float(end(u[0] + [h, 0.0]) - end(u[0] - [h, 0.0])) / (2.0 * h)
        assert float(jax.grad(end)(u[0])[0]) == pytest.approx(rate, rel=1e-6)


@pytest.mark.soak
@pytest.mark.parametrize("name", ["four_bar", "delta"])
def test_closed_mechanisms_move_as_the_kernels_say(name: str) -> None:
    functions, kernel = made(eomgen.load_robot(name)), eomgen.build(name)
    home = eomgen.load_robot(name).home
    q = kernel.assemble(np.array([home.get(x, 0.0) for x in kernel.coordinates]))
    zero = np.zeros(kernel.n)
    close(functions.forward_dynamics(q, zero, zero), kernel.forward_dynamics(q, zero, zero), 1e-9)
    close(functions.constraint_jacobian(q), kernel.functions.constraint_jacobian(q))


@pytest.mark.soak
def test_joints_of_three_rotations_in_loops_stand_as_described() -> None:
    robot = held_pendulum()
    functions, kernel = made(robot), eomgen.build(robot, kernels=("forward_dynamics", "inverse_dynamics"))
    q = np.array([*np.subtract(STAND, OFFSET), 0.0, 0.0, 0.0])
    zero = np.zeros(6)
    close(functions.forward_dynamics(q, zero, zero), kernel.forward_dynamics(q, zero, zero), 1e-9)
