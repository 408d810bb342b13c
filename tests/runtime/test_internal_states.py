"""Robots with internal states: z is an array of its own, and results are those of coordinates."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen.codegen.kernels.signatures import OWN_KERNELS
from eomgen.errors import ArrayError, InputError
from eomgen.runtime.raw import DERIVED
from tests.support.bristled import bristled_arm, served_arm
from tests.support.bristles import bristle_gear, bristle_linkage
from tests.support.builds import Build
from tests.support.methods import method_of
from tests.support.refusals import refused
from tests.support.soak import soaked

pytestmark = pytest.mark.usefixtures("unoptimised")

ROBOTS: dict[str, Callable[[], eomgen.Robot]] = {
    "arm": bristled_arm,
    "linkage": bristle_linkage,
    "gear": bristle_gear,
    "servo": served_arm,
}
PLAIN = ("mass_matrix", "gravity", "euler_cosines", "christoffel", "center_of_mass")
MOVING = ("bias_force", "nonlinear_effects", "coriolis_matrix", "frame_velocities", "centroidal_momentum")
WITH_Z = {"generalized_force": "qv", "energy": "qv", "inverse_dynamics": "qva", "reactions": "qva", "residual": "qvau"}
LOOPED = {"constraint": "q", "constraint_jacobian": "q", "constraint_bias": "qv", "cut_poses": "q"}


class State:
    """A state of a kernel, or many."""

    def __init__(self, kernel: eomgen.Kernel, lead: tuple[int, ...] = (), seed: int = 1) -> None:
        rng, n = np.random.default_rng(seed), len(kernel.coordinates)
        near = np.asarray(kernel.home, np.float64)
        self.apart = {name: 0.1 * rng.normal(size=(*lead, n)) for name in "qvau"}
        self.z = 1e-5 * rng.normal(size=(*lead, len(kernel.internal_states)))
        self.apart["q"] += near
        if kernel.constraints:
            self.apart["q"] = np.broadcast_to(kernel.assemble(near), (*lead, n)).copy()
            self.apart["v"] *= 0.0
            self.apart["a"] *= 0.0
        self.apart = {name: x.astype(kernel.dtype) for name, x in self.apart.items()}
        self.z = self.z.astype(kernel.dtype)


@pytest.fixture(scope="module", params=soaked(ROBOTS, ("linkage",)))
def kernel(request: pytest.FixtureRequest, built: Build) -> eomgen.Kernel:
    return built(ROBOTS[request.param]())


def close(found: Any, expected: Any, rel: float = 1e-6) -> None:
    """Assert that two arrays differ by no more than a part of the greatest number."""
    expected = np.asarray(expected)
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=rel * max(1e-9, np.abs(expected).max(initial=0.0)))


def slopes(call: Callable[..., Any], args: tuple[Any, ...], k: int, h: float = 1e-6) -> Any:
    """Return differences of a result by the k-th argument, behind its axes."""
    columns = []
    for step in h * np.eye(args[k].size):
        ahead, behind = (call(*args[:k], args[k] + s * step, *args[k + 1 :]) for s in (1.0, -1.0))
        columns.append((ahead - behind) / (2.0 * h))
    return np.stack(columns, axis=-1)


@pytest.mark.parametrize("lead", [*(pytest.param(x, marks=pytest.mark.soak) for x in ((), (3,))), (2, 2)])
def test_all_methods_take_coordinates_and_states_apart(kernel: eomgen.Kernel, lead: tuple[int, ...]) -> None:
    """Results have the bits of single states, in new arrays and in given ones."""
    s, n = State(kernel, lead), kernel.n
    axes = {"mass_matrix": 2, "gravity": 1, "christoffel": 3, "bias_force": 1, "nonlinear_effects": 1}
    axes |= {"coriolis_matrix": 2, "generalized_force": 1, "inverse_dynamics": 1, "residual": 1}
    calls = dict.fromkeys(PLAIN, "q") | dict.fromkeys(MOVING, "qv") | WITH_Z
    calls |= LOOPED if kernel.constraints else {}
    for name, reads in calls.items():
        method, apart = method_of(kernel, name), {"z": s.z} if name in WITH_Z else {}
        together = method(*(s.apart[x] for x in reads), **apart)
        assert together.shape[together.ndim - axes.get(name, 0) :] == (n,) * axes.get(name, 0), name
        for place in np.ndindex(lead):
            alone = method(*(s.apart[x][place] for x in reads), **{key: x[place] for key, x in apart.items()})
            assert (alone == together[place]).all(), name
        out = np.empty_like(together)
        assert method(*(s.apart[x] for x in reads), **apart, out=out) is out, name
        assert (out == together).all(), name
    q, v, a, u = (s.apart[x] for x in "qvau")
    rates = kernel.calls.run("forward_dynamics", None, (q, v, u), z=s.z, whole=True)
    assert rates.shape == (*lead, n + len(kernel.internal_states))
    assert (kernel.forward_dynamics(q, v, u, s.z) == rates[..., :n]).all()
    assert (kernel.internal_state_derivatives(q, v, s.z, u) == rates[..., n:]).all()
    frame = kernel.links[-1]
    assert kernel.frame_jacobian(q, frame).shape == (*lead, 6, n)
    assert kernel.functions.regressor(q, v, a).shape[-2] == n
    load = {frame: [1.0, 2.0, 3.0, 0.1, 0.2, 0.3]}
    force = kernel.functions.external_force(q, load)
    if not kernel.constraints:
        M, drives = kernel.mass_matrix(q), kernel.inverse_dynamics(q, v, a, z=s.z)
        acting = np.einsum("...ij,...j->...i", M, a) - drives
        if not kernel.calls.arrays.has_drives:  # whose currents act in generalized_force
            close(kernel.generalized_force(q, v, z=s.z) - kernel.bias_force(q, v), acting, 1e-12)
        close(kernel.inverse_dynamics(q, v, a, wrench=load, z=s.z), drives - force, 1e-12)
        exerted = kernel.functions.drive_forces(q, v, u, s.z)
        for forces, more in ((exerted, {}), (exerted + force, {"wrench": load})):
            found = kernel.forward_dynamics(q, v, u, s.z, **more)
            close(np.einsum("...ij,...j->...i", M, found), acting + forces, 1e-9)
    if kernel.constraints:
        under = kernel.forward_dynamics(q, v, u, s.z, wrench=load)
        close(kernel.forward_dynamics(q, v, u + force, s.z), under, 1e-12)
        assert kernel.constraint_forces(q, v, u, z=s.z).shape == (*lead, len(kernel.constraints))
        assert kernel.loop_reactions(q, v, a, z=s.z).shape[: len(lead)] == lead
        assert kernel.project_velocity(q, v + 1.0).shape == (*lead, n)


def test_blocks_and_inverse_kinematics(built: Build) -> None:
    kernel = built(bristled_arm())
    s = State(kernel)
    blocks = kernel.blocks(s.apart["q"])
    assert (blocks.mass["j1", "j2"] == kernel.mass_matrix(s.apart["q"])[:1, 1:]).all()
    assert set(blocks.mass) == {("j1", "j1"), ("j1", "j2"), ("j2", "j1"), ("j2", "j2")}
    pose = kernel.frame_pose(s.apart["q"], "tcp")
    q = kernel.inverse_kinematics(pose, q0=s.apart["q"] + [0.1, 0.0, 0.0, 0.1])
    assert q == pytest.approx(s.apart["q"], abs=1e-9)
    linkage = built(bristle_linkage())
    home = linkage.assemble(linkage.home)
    moved = linkage.assemble(home + [0.1, 0.0, 0.0], ["joint1.gamma"])
    frame = linkage.links[1]
    again = linkage.inverse_kinematics(
        linkage.frame_pose(moved, frame)[:3, 3], frame, q0=home, moving=linkage.coordinates
    )
    assert again == pytest.approx(moved, abs=1e-8)
    assert linkage.assemble(home, roots=2).shape[-1] == 3


def test_derivatives(built: Build) -> None:
    """Of functions that no internal state acts on, and of others, where z is one more argument."""
    kernel = built(bristled_arm())
    s, n = State(kernel), 4
    q, v, a, u = (s.apart[x] for x in "qvau")
    args, energy = (q, v), (q, v, s.z)
    weights = np.random.default_rng(0).normal(size=(n,))
    by = [slopes(kernel.bias_force, args, k) for k in (0, 1)]
    for found, matrix in zip(kernel.vjp("bias_force", args, weights), by, strict=True):
        close(found, weights @ matrix)
    close(kernel.jvp("bias_force", args, args), by[0] @ q + by[1] @ v)
    second = kernel.hessian("bias_force", args, weights)
    gradient = lambda q, v: np.concatenate(kernel.vjp("bias_force", (q, v), weights))  # noqa: E731
    close(second, np.hstack([slopes(gradient, args, k) for k in (0, 1)]))
    assert kernel.parameter_jacobian("mass_matrix", (q,), []).shape == (n, n, 0)
    turned = kernel.vjp("frame_jacobian", (q, "tcp"), np.ones((6, n)))[0]
    close(turned, slopes(lambda q: kernel.frame_jacobian(q, "tcp").sum(), (q,), 0))
    names = ["joints.j2.beta.friction.bristle_stiffness"]
    run = lambda q, v, z: kernel.energy(q, v, z=z)  # noqa: E731
    by = [slopes(run, energy, k, h) for k, h in enumerate((1e-6, 1e-6, 1e-4))]  # of z it is of second order
    *gradients, by_number = kernel.vjp("energy", energy, [1.0, 2.0], names)
    for found, matrix in zip(gradients, by, strict=True):
        close(found, [1.0, 2.0] @ matrix)
    by_numbers = kernel.parameter_jacobian("energy", energy, names)
    close(by_numbers, [[0.0], [0.5 * s.z[1] ** 2]], 1e-12)
    close(by_number, [1.0, 2.0] @ by_numbers, 1e-12)
    close(kernel.jvp("energy", energy, energy), sum(matrix @ x for matrix, x in zip(by, energy, strict=True)))
    gradient = lambda *x: np.concatenate(kernel.vjp("energy", x, [1.0, 1.0]))  # noqa: E731
    close(kernel.hessian("energy", energy, [1.0, 1.0]), np.hstack([slopes(gradient, energy, k) for k in (0, 1, 2)]))
    for k, found in enumerate(kernel.forward_dynamics_jacobian(q, v, u, s.z)):
        close(found, slopes(lambda *x: kernel.forward_dynamics(*x, s.z), (q, v, u), k, 1e-8), 1e-4)
    for k, found in enumerate(kernel.residual_jacobian(q, v, a, z=s.z)):
        close(found, slopes(lambda *x: kernel.inverse_dynamics(*x, z=s.z), (q, v, a), k, 1e-8), 1e-4)
    value, rate = kernel.jet("inverse_dynamics", (q, v, a, u, (s.z, 2.0 * s.z)), 1)
    close(value, kernel.inverse_dynamics(q, v, a, z=s.z), 1e-12)
    close(rate, kernel.jvp("inverse_dynamics", (q, v, a, s.z), (v, a, u, 2.0 * s.z)), 1e-12)
    for call in (
        lambda: kernel.vjp("energy", args, [1.0, 1.0]),
        lambda: kernel.jvp("energy", args, args),
        lambda: kernel.hessian("energy", args, [1.0, 1.0]),
        lambda: kernel.parameter_jacobian("energy", args),
    ):
        refused(InputError, r"energy: got 2 arguments; allowed: \(q, v, z\)", call)


@pytest.mark.soak
def test_what_depends_on_states_is_known(built: Build) -> None:
    """Functions whose results change with z are those that the table names, reactions in loops among them."""
    changed, same = set[str](), set[str]()
    for name in ROBOTS:
        kernel = built(ROBOTS[name]())
        s = State(kernel)
        given = s.apart | {"z": s.z, "forces": np.zeros(len(kernel.calls.arrays.drives))}
        for function in kernel.raw.functions.values():
            values = [given.get(x) for x in function.reads]
            steps = any(part in function.name for part in ("rollout", "gradient", "sensitivity"))
            if steps or function.kind in DERIVED or "v" not in function.reads or any(x is None for x in values):
                continue
            if "z" not in function.reads:
                same.add(function.name)
                continue
            other = [x + 1e-3 if label == "z" else x for x, label in zip(values, function.reads, strict=True)]
            one, two = (kernel.calls.run(function.name, None, x) for x in (values, other))
            (changed if (one != two).any() else same).add(function.name)
    stateful = {name for name, signature in OWN_KERNELS.items() if signature.states}
    assert changed <= stateful
    assert not stateful & (same - changed - {"tree_reactions", "drive_jacobian", "settling"})
    plain, expected = (
        {name.removeprefix("tree_").removesuffix("_under_load") for name in x} for x in (changed, stateful)
    )
    assert expected - plain == {"drive_jacobian", "settling"}  # constant within limits; a change of the state


def test_float32(built: Build) -> None:
    kernel = built(bristled_arm(), "inverse_dynamics", "mass_matrix", dtype="float32")
    s = State(kernel)
    narrow = kernel.inverse_dynamics(*(s.apart[x] for x in "qva"), z=s.z)
    assert narrow.dtype == np.float32
    double = built(bristled_arm(), "inverse_dynamics")
    close(narrow, double.inverse_dynamics(*(s.apart[x].astype(float) for x in "qva"), z=s.z.astype(float)), 1e-5)
    with pytest.raises(ArrayError, match="z: expected float32 of shape"):
        kernel.inverse_dynamics(*(s.apart[x] for x in "qva"), z=np.zeros(2) + 1e-3)


@pytest.mark.parametrize("method", soaked(["implicit", "rosenbrock"], ["implicit"]))
def test_gradients_and_sensitivities_of_rollouts(method: str, built: Build) -> None:
    """Gradients are those of differences, and of sensitivities."""
    kernel = built(bristled_arm())
    s, n = State(kernel), 4
    q, v, u = (s.apart[x] for x in "qvu")
    options: dict[str, Any] = {"method": method}
    options |= {"dt": 1e-4, "steps": 20} if method == "implicit" else {"duration": 2e-3, "samples": 4, "rtol": 1e-8}
    name = "joints.j2.beta.friction.bristle_stiffness"
    weights = np.random.default_rng(5).normal(size=3) * [1.0, 1.0, 1e3]

    def loss(t: Any, q: Any, v: Any, z: Any) -> Any:
        value = sum(w * (x[-1] ** 2).sum() for w, x in zip(weights, (q, v, z), strict=True))
        return value, *(
            np.concatenate([0.0 * x[:-1], 2.0 * w * x[-1:]]) for w, x in zip(weights, (q, v, z), strict=True)
        )

    value, gradient = kernel.rollout_gradient(q, v, u, z=s.z, loss=loss, parameters=[name], **options)
    assert gradient.keys() == {*"qvuz", name}
    ended = kernel.rollout(q, v, u, z=s.z, **options)
    assert value == pytest.approx(loss(None, *ended, ended.z)[0], rel=1e-12 if method == "implicit" else 1e-10)
    for k, h in ((0, 1e-9), (1, 1e-9)) if method == "implicit" else ():  # others choose their steps
        ends = []
        for sign in (1.0, -1.0):
            z = s.z + sign * h * np.eye(2)[k]
            motion = kernel.rollout(q, v, u, z=z, **options)
            ends.append(loss(None, motion[0], motion[1], motion.z)[0])
        assert gradient["z"][k] == pytest.approx((ends[0] - ends[1]) / (2.0 * h), rel=2e-3, abs=1e-4)
    along = {"z": np.eye(2)[:1], "q": np.eye(n)[1:2]}
    states, rates = kernel.rollout_sensitivity(q, v, u, z=s.z, along=along, parameters=[name], **options)
    by = loss(None, *states)[1:]
    wanted = (gradient["z"][:1] + gradient["q"][1:2], [gradient[name]])
    found = np.concatenate([sum(np.einsum("sn,sdn->d", x, y) for x, y in zip(by, rates, strict=True))])
    np.testing.assert_allclose(found, np.concatenate(wanted), rtol=1e-9, atol=1e-12)


def test_what_rollouts_refuse(built: Build) -> None:
    kernel = built(bristled_arm())
    s = State(kernel)
    q, v = (s.apart[x] for x in "qv")
    options: dict[str, Any] = {"method": "implicit", "dt": 1e-4, "steps": 2, "z": s.z}
    for error, said, loss in (
        (InputError, r"allowed: \(value, dq, dv, dz\)", lambda t, q, v, z: (0.0, q, v)),
        (ArrayError, r"loss: dz has shape \(3, 4\); expected shape \(3, 2\)", lambda t, q, v, z: (0.0, q, v, v)),
    ):
        refused(error, said, kernel.rollout_gradient, q, v, loss=loss, **options)
    new = {"loss": lambda t, q, v, z: (0.0, q, v, z), "out": {}}
    refused(InputError, "out: results with z are new arrays", kernel.rollout_gradient, q, v, **new, **options)
    for error, said, along in (
        (ArrayError, r"along: z has shape \(3, 3\); expected \(directions, 2\)", {"z": np.eye(3)}),
        (ArrayError, r"along: z has shape \(2,\)", {"z": [1.0, 0.0]}),
        (ArrayError, r"along: v has shape \(1, 4\); expected \(2, 4\)", {"z": np.eye(2), "v": np.ones((1, 4))}),
        (InputError, r"along: .* allowed: arrays by", [1.0]),
    ):
        refused(error, said, kernel.rollout_sensitivity, q, v, along=along, **options)
    plain, options = built(eomgen.load_robot("one_link")).rollout_sensitivity, {**options, "z": [0.0]}
    refused(InputError, "z: no force law of one_link has internal states", plain, [0.0], [0.0], **options)


def test_what_cannot_be_is_refused(built: Build) -> None:
    kernel = built(bristled_arm())
    s = State(kernel)
    (q, v, a), wide = (s.apart[x] for x in "qva"), np.zeros(6)
    calls: dict[str, Callable[[], Any]] = {
        r"inverse_dynamics: .* z is missing; allowed: z, \(\.\.\., 2\), of .*j1\.gamma\.friction\.z": lambda: (
            kernel.inverse_dynamics(q, v, a)
        ),
        r"forward_dynamics: .* z is missing": lambda: kernel.forward_dynamics(q, v, a),
        r"v: expected float64 of shape \(4,\).*, got shape \(6,\)": lambda: kernel.bias_force(q, wide),
        r"q: expected float64 of shape \(4,\).*, got shape \(6,\)": lambda: kernel.energy(wide, wide, z=s.z),
        r"q: expected float64 of shape \(4,\).*, got shape \(3,\)": lambda: kernel.mass_matrix(q[:3]),
        r"z: expected float64 of shape \(2,\)": lambda: kernel.energy(q, v, z=[0.0]),
        r"z: j2\.beta\.friction\.z is nan": lambda: kernel.energy(q, v, z=[0.0, np.nan]),
        r"z: 3 states, but 2 in other arrays": lambda: kernel.energy(np.tile(q, (2, 1)), v, z=np.zeros((3, 2))),
        r"v: expected .*, got list": lambda: kernel.bias_force(q, [1.0, [2.0]]),
        r"v: j1\.gamma is nan": lambda: kernel.bias_force(q, np.nan * v),
        r"out: expected float64 of shape \(4,\)": lambda: kernel.bias_force(q, v, out=np.zeros(6)),
    }
    for said, call in calls.items():
        refused(ArrayError, said, call)
    plain = built(eomgen.load_robot("one_link"), "energy", "inverse_dynamics")
    for call in (
        lambda: plain.energy([0.0], [0.0], z=[0.0]),
        lambda: plain.inverse_dynamics([0.0], [0.0], [0.0], z=[0.0]),
    ):
        refused(InputError, "z: no force law of one_link has internal states", call)


def test_forces_of_drives_without_a_servo_drive_are_what_they_are_given(built: Build) -> None:
    """Of as many states as the arrays have; z where no law has a state is refused."""
    kernel = built(bristled_arm())
    q, u = np.zeros((3, len(kernel.coordinates))), np.arange(float(len(kernel.coordinates)))
    found = kernel.functions.drive_forces(q, q, u, np.zeros((3, len(kernel.internal_states))))
    assert np.array_equal(found, np.tile(u, (3, 1)))
    plain = built(eomgen.load_robot("one_link"))
    with pytest.raises(InputError, match="z: no force law of one_link has internal states"):
        plain.functions.drive_forces([0.0, 0.0], [0.0, 0.0], [1.0, 0.0], [0.0])
