"""Robots with internal states: z is an array of its own, and results have the numbers of augmented arrays."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen.codegen.kernels.signatures import OWN_KERNELS
from eomgen.errors import ArrayError, InputError
from eomgen.runtime.arrays import DERIVATIVE
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
    """A state of a kernel, split and augmented."""

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
        self.whole = {
            name: np.concatenate([x, self.z if name == "v" else 0 * self.z], axis=-1) for name, x in self.apart.items()
        }


@pytest.fixture(scope="module", params=soaked(ROBOTS, ("linkage",)))
def kernel(request: pytest.FixtureRequest, built: Build) -> eomgen.Kernel:
    return built(ROBOTS[request.param]())


def equal(narrow: Any, wide: Any, axes: int) -> bool:
    """Whether a result is the part of coordinates of another, to the bit; its last axes are by coordinates."""
    n = narrow.shape[-1]
    part = wide[(..., *(slice(n),) * axes)]
    return narrow.shape == part.shape and bool((narrow == part).all())


@pytest.mark.parametrize("lead", [*(pytest.param(x, marks=pytest.mark.soak) for x in ((), (3,))), (2, 2)])
def test_all_methods_take_coordinates_alone(kernel: eomgen.Kernel, lead: tuple[int, ...]) -> None:
    s = State(kernel, lead)
    axes = {"mass_matrix": 2, "gravity": 1, "christoffel": 3, "bias_force": 1, "nonlinear_effects": 1}
    axes |= {"coriolis_matrix": 2, "generalized_force": 1, "inverse_dynamics": 1, "residual": 1}
    axes |= {"constraint_jacobian": 1}
    calls = dict.fromkeys(PLAIN, "q") | dict.fromkeys(MOVING, "qv") | WITH_Z
    calls |= LOOPED if kernel.constraints else {}
    whole = kernel.augmented
    for name, reads in calls.items():
        method, apart = method_of(kernel, name), {"z": s.z} if name in WITH_Z else {}
        narrow = method(*(s.apart[x] for x in reads), **apart)
        assert equal(narrow, method_of(whole, name)(*(s.whole[x] for x in reads)), axes.get(name, 0)), name
        out = np.empty_like(narrow)
        assert method(*(s.apart[x] for x in reads), **apart, out=out) is out, name
        assert (out == narrow).all(), name
    q, v, u = (s.apart[x] for x in "qvu")
    wide = whole.forward_dynamics(*(s.whole[x] for x in "qvu"))
    assert equal(kernel.forward_dynamics(q, v, u, s.z), wide, 1)
    assert (kernel.internal_state_derivatives(q, v, s.z, u) == wide[..., len(kernel.coordinates) :]).all()
    frame = kernel.links[-1]
    assert equal(kernel.frame_jacobian(q, frame), whole.frame_jacobian(s.whole["q"], frame), 1)
    still, wide = np.zeros(kernel.n), np.zeros(whole.n)
    found, expected = (
        kernel.frame_acceleration(q, v, still, frame),
        whole.frame_acceleration(*(s.whole[x] for x in "qv"), wide, frame),
    )
    assert (found == expected).all()
    regressor = kernel.functions.regressor(*(s.apart[x] for x in "qva"))
    assert (
        regressor == whole.functions.regressor(*(s.whole[x] for x in "qva"))[..., : len(kernel.coordinates), :]
    ).all()
    load = {frame: [1.0, 2.0, 3.0, 0.1, 0.2, 0.3]}
    for name, reads in (("inverse_dynamics", "qva"), ("residual", "qvau"), ("reactions", "qva")):
        narrow = method_of(kernel, name)(*(s.apart[x] for x in reads), wrench=load, z=s.z)
        wide = method_of(whole, name)(*(s.whole[x] for x in reads), wrench=load)
        assert equal(narrow, wide, int(name != "reactions")), name
    under = kernel.forward_dynamics(q, v, u, s.z, wrench=load)
    assert equal(under, whole.forward_dynamics(*(s.whole[x] for x in "qvu"), wrench=load), 1)
    if kernel.constraints:
        assert equal(
            kernel.loop_reactions(q, v, s.apart["a"], z=s.z), whole.loop_reactions(*(s.whole[x] for x in "qva")), 0
        )
        forces = kernel.constraint_forces(q, v, u, z=s.z)
        assert (forces == whole.constraint_forces(*(s.whole[x] for x in "qvu"))).all()
        assert equal(
            kernel.assemble(q + 1e-3),
            whole.assemble(s.whole["q"] + np.r_[1e-3 * np.ones(q.shape[-1]), 0 * s.z.reshape(-1, s.z.shape[-1])[0]]),
            1,
        )
        assert equal(kernel.project_velocity(q, v + 1.0), whole.project_velocity(s.whole["q"], s.whole["v"] + 1.0), 1)
    if kernel.couplings:
        forces = kernel.functions.coupling_forces(q, v, s.apart["a"], z=s.z)
        assert (forces == whole.functions.coupling_forces(*(s.whole[x] for x in "qva"))).all()
        followers = kernel.followers(q, v)
        assert all(
            (a == b).all()
            for name, pair in whole.followers(*(s.whole[x] for x in "qv")).items()
            for a, b in zip(pair, followers[name], strict=True)
        )


def test_blocks_and_inverse_kinematics(built: Build) -> None:
    kernel = built(bristled_arm())
    s = State(kernel)
    for blocks in (kernel.blocks(s.apart["q"]), kernel.augmented.blocks(s.whole["q"])):
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
    s, n, whole = State(kernel), 4, kernel.augmented
    weights = np.random.default_rng(0).normal(size=(n,))
    wide = np.r_[weights, 0.0, 0.0]
    args, augmented = tuple(s.apart[x] for x in "qv"), tuple(s.whole[x] for x in "qv")
    for narrow, full in zip(
        kernel.vjp("bias_force", args, weights), whole.vjp("bias_force", augmented, wide), strict=True
    ):
        assert equal(narrow, full, 1)
    rates = s.whole["q"], np.r_[args[1], 0.0, 0.0]
    assert equal(kernel.jvp("bias_force", args, args), whole.jvp("bias_force", augmented, rates), 1)
    second, places = kernel.hessian("bias_force", args, weights), [0, 1, 2, 3, 6, 7, 8, 9]
    assert (second == whole.hessian("bias_force", augmented, wide)[np.ix_(places, places)]).all()
    by_numbers = kernel.parameter_jacobian("mass_matrix", args[:1])
    assert (by_numbers == whole.parameter_jacobian("mass_matrix", augmented[:1])[:n, :n]).all()
    assert kernel.parameter_jacobian("mass_matrix", args[:1], []).shape == (n, n, 0)
    turned = kernel.vjp("frame_jacobian", (args[0], "tcp"), np.ones((6, n)))[0]
    ones = np.concatenate([np.ones((6, n)), np.zeros((6, 2))], axis=1)
    assert (turned == whole.vjp("frame_jacobian", (augmented[0], "tcp"), ones)[0][:n]).all()
    names = ["joints.j2.beta.friction.bristle_stiffness"]
    *gradient, by_number = kernel.vjp("energy", (*args, s.z), [1.0, 2.0], names)
    by_q, by_v, by_number_too = whole.vjp("energy", augmented, [1.0, 2.0], names)
    assert all((x == y).all() for x, y in zip(gradient, (by_q[:n], by_v[:n], by_v[n:]), strict=True))
    assert (by_number == by_number_too).all()
    found = kernel.jvp("energy", (*args, s.z), (*args, s.z))
    assert (found == whole.jvp("energy", augmented, augmented)).all()
    second = kernel.hessian("energy", (*args, s.z), [1.0, 1.0])
    places += [10, 11]
    assert (second == whole.hessian("energy", augmented, [1.0, 1.0])[np.ix_(places, places)]).all()
    by_numbers = kernel.parameter_jacobian("energy", (*args, s.z), names)
    assert (by_numbers == whole.parameter_jacobian("energy", augmented, names)).all()
    narrow = kernel.forward_dynamics_jacobian(*args, s.apart["u"], s.z)
    full = whole.forward_dynamics_jacobian(*augmented, s.whole["u"])
    assert all(equal(x, y, 2) for x, y in zip(narrow, full, strict=True))
    narrow = kernel.residual_jacobian(*args, s.apart["a"], z=s.z)
    full = whole.residual_jacobian(*augmented, s.whole["a"])
    assert all(equal(x, y, 2) for x, y in zip(narrow, full, strict=True))
    q, v, a, jerk, z, rate = *args, s.apart["a"], s.apart["u"], s.z, 2.0 * s.z
    series = s.whole["q"], s.whole["v"], np.r_[a, rate], s.whole["u"]
    jets = kernel.jet("inverse_dynamics", (q, v, a, jerk, (z, rate)), 1), whole.jet("inverse_dynamics", series, 1)
    assert all(equal(x, y, 1) for x, y in zip(*jets, strict=True))
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
        s, n = State(kernel), len(kernel.coordinates)
        shift = np.r_[np.zeros(n), 1e-3 * np.ones(len(kernel.internal_states))]
        for function in kernel.raw.functions.values():
            values = [s.whole.get(x) for x in function.reads]
            steps = any(part in function.name for part in ("rollout", "gradient", "sensitivity"))
            if steps or DERIVATIVE.search(function.name) or "v" not in function.reads or any(x is None for x in values):
                continue
            other = [x + shift if label == "v" else x for x, label in zip(values, function.reads, strict=True)]
            one, two = (kernel.augmented.calls.run(function.name, None, x) for x in (values, other))
            differs = (one != two)[..., : n if one.shape[-1:] == (kernel.augmented.n,) else None].any()
            (changed if differs else same).add(function.name)
    stateful = {name for name, signature in OWN_KERNELS.items() if signature.states}
    assert changed <= stateful
    assert not stateful & (same - changed - {"tree_reactions", "drive_jacobian"})
    plain, expected = (
        {name.removeprefix("tree_").removesuffix("_under_load") for name in x} for x in (changed, stateful)
    )
    assert expected - plain == {"drive_jacobian"}  # of drives within their limits it is constant


def test_float32(built: Build) -> None:
    kernel = built(bristled_arm(), "inverse_dynamics", "mass_matrix", dtype="float32")
    s = State(kernel)
    narrow = kernel.inverse_dynamics(*(s.apart[x] for x in "qva"), z=s.z)
    assert narrow.dtype == np.float32
    assert equal(narrow, kernel.augmented.inverse_dynamics(*(s.whole[x] for x in "qva")), 1)
    with pytest.raises(ArrayError, match="z: expected float32 of shape"):
        kernel.inverse_dynamics(*(s.apart[x] for x in "qva"), z=np.zeros(2) + 1e-3)


@pytest.mark.parametrize("method", soaked(["implicit", "rosenbrock"], ["implicit"]))
def test_gradients_and_sensitivities_of_rollouts(method: str, built: Build) -> None:
    """With z apart they are those of whole arrays, to the bit, and those of differences."""
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

    def whole_loss(t: Any, q: Any, v: Any) -> Any:
        value, by_q, by_v, by_z = loss(t, q[:, :n], v[:, :n], v[:, n:])
        return value, np.hstack([by_q, 0.0 * by_z]), np.hstack([by_v, by_z])

    value, gradient = kernel.rollout_gradient(q, v, u, z=s.z, loss=loss, parameters=[name], **options)
    wide = [s.whole[x] for x in "qvu"]
    other, whole = kernel.augmented.rollout_gradient(*wide, loss=whole_loss, parameters=[name], **options)
    assert value == other
    assert gradient.keys() == whole.keys() | {"z"}
    assert all((gradient[x] == whole[x][:n]).all() for x in "qvu")
    assert (gradient["z"] == whole["v"][n:]).all()
    assert gradient[name] == whole[name]
    for k, h in ((0, 1e-9), (1, 1e-9)) if method == "implicit" else ():  # others choose their steps
        ends = []
        for sign in (1.0, -1.0):
            z = s.z + sign * h * np.eye(2)[k]
            motion = kernel.rollout(q, v, u, z=z, **options)
            ends.append(loss(None, motion[0], motion[1], motion.z)[0])
        assert gradient["z"][k] == pytest.approx((ends[0] - ends[1]) / (2.0 * h), rel=2e-3, abs=1e-4)
    along = {"z": np.eye(2)[:1], "q": np.eye(n)[1:2]}
    states, rates = kernel.rollout_sensitivity(q, v, u, z=s.z, along=along, parameters=[name], **options)
    directions = {"q": np.eye(6)[1:2], "v": np.r_[np.zeros(n), 1.0, 0.0][np.newaxis]}
    ends_of, rates_of = kernel.augmented.rollout_sensitivity(*wide, along=directions, parameters=[name], **options)
    for narrow, full in ((states, ends_of), (rates, rates_of)):
        assert (narrow[0] == full[0][..., :n]).all()
        assert (narrow[1] == full[1][..., :n]).all()
        assert (narrow[2] == full[1][..., n:]).all()


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
        (ArrayError, r"z: expected float64 of shape \(2,\)", {"z": np.eye(3)}),
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
    (q, v, a), wide = (s.apart[x] for x in "qva"), s.whole["v"]
    calls: dict[str, Callable[[], Any]] = {
        r"inverse_dynamics: .* z is missing; allowed: z, \(\.\.\., 2\), of .*j1\.gamma\.friction\.z": lambda: (
            kernel.inverse_dynamics(q, v, a)
        ),
        r"forward_dynamics: .* z is missing": lambda: kernel.forward_dynamics(q, v, a),
        r"v: expected float64 of shape \(4,\).*, got shape \(6,\)": lambda: kernel.bias_force(q, wide),
        r"q: expected float64 of shape \(4,\).*, got shape \(6,\)": lambda: kernel.energy(s.whole["q"], wide, z=s.z),
        r"q: expected float64 of shape \(4,\).*, got shape \(3,\)": lambda: kernel.mass_matrix(q[:3]),
        r"z: expected float64 of shape \(2,\)": lambda: kernel.energy(q, v, z=[0.0]),
        r"z: j2\.beta\.friction\.z is nan": lambda: kernel.energy(q, v, z=[0.0, np.nan]),
        r"v: 3 states, but 2 in other arrays": lambda: kernel.energy(np.tile(q, (2, 1)), v, z=np.zeros((3, 2))),
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
