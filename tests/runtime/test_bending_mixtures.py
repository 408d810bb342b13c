"""Compiled kernels of robots with flexible links and all other parts, and links that are deflected too far."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen import Kernel
from eomgen.analysis import linearize
from eomgen.errors import IntegrationStopped, LoopError, SingularError
from eomgen.kernel.stepping.methods import ADAPTIVE
from eomgen.pipeline.costs import RobotInfo
from eomgen.robot.model import build_model
from eomgen.robot.value import Link, Robot, deflection_range
from eomgen.runtime.flexible_links import bent_too_far
from tests.support.bending_mixtures import Mixture, answer, mixture
from tests.support.bending_robots import bent
from tests.support.builds import Build
from tests.support.methods import method_of
from tests.support.random_robots import Array, State, random_robot, seeds
from tests.support.refusals import refused

pytestmark = pytest.mark.usefixtures("unoptimised")
READS = {
    "mass_matrix": "q",
    "bias_force": "qv",
    "generalized_force": "qv",
    "residual": "qvau",
    "inverse_dynamics": "qva",
    "forward_dynamics": "qvu",
    "coriolis_matrix": "qv",
    "energy": "qv",
    "reactions": "qva",
    "center_of_mass": "q",
    "centroidal_momentum": "qv",
    "frame_velocities": "qv",
    "frame_accelerations": "qva",
}
OF_TREE = ("inverse_dynamics", "reactions")  # which a mechanism has for its open tree, too
KERNELS = (
    *(*READS, "kinematics", "residual_jacobian", "forward_dynamics_jacobian"),
    *("forward_dynamics_tangent", "forward_dynamics_adjoint", "rollout", "adaptive_rollout", "radau_rollout"),
    *(f"{method}_{way}" for method in ("explicit", "implicit", "rosenbrock") for way in ("gradient", "sensitivity")),
)
LOOPS = ("constraint", "constraint_jacobian", "constraint_bias", "cut_poses", "constrained_dynamics")
STATES = 5
GRADIENTS: dict[str, dict[str, Any]] = {
    "rk4": {"dt": 1e-3, "steps": 8},
    "implicit": {"dt": 1e-3, "steps": 8},
    "rosenbrock": {"duration": 8e-3, "samples": 4},
    "tsit5": {"duration": 8e-3, "samples": 4},
}


def subject(seed: int, built: Build, **options: Any) -> tuple[Mixture, Kernel, list[State]]:
    """Build a robot, and draw states of it; of a mechanism with loops one that is closed."""
    for number in range(seed, seed + 10_000, 1000):
        mixed = mixture(number)
        kernel = built(mixed.robot, *KERNELS, *(LOOPS if mixed.robot.loops else ()), **options)
        states = [mixed.state(number + i) for i in range(STATES)]
        if not mixed.robot.loops:
            return mixed, kernel, states
        for s in states:
            try:
                q = kernel.assemble(s.q)
                closed = replace(s, q=q, v=kernel.project_velocity(q, s.v))
            except (LoopError, SingularError):  # it closes where a link bends farther than its modes reach
                continue
            return mixed, kernel, [replace(closed, v=x * closed.v) for x in np.linspace(-1.0, 1.0, STATES)]
    raise AssertionError(seed)


def off(found: Any, expected: Any) -> float:
    """Return the greatest deviation by the greatest number."""
    one, other = np.asarray(found), np.asarray(expected)
    return float(np.abs(one - other).max(initial=0.0) / max(1e-9, np.abs(other).max(initial=0.0)))


@pytest.mark.soak
@pytest.mark.parametrize("seed", seeds(0, 0, 24))
def test_batches_and_float32(seed: int, built: Build) -> None:
    """States of a batch have the bits of each alone; single precision is near double."""
    mixed, kernel, states = subject(seed, built)
    single = built(mixed.robot, *READS, *(LOOPS if mixed.robot.loops else ()), dtype="float32")
    of = {label: np.array([getattr(s, label) for s in states]) for label in ("q", "v", "a", "u", "z")}
    for name, reads in READS.items():
        more = {"cut": True} if mixed.robot.loops and name in OF_TREE else {}
        call, rough = (partial(method_of(x, name), **more) for x in (kernel, single))
        arrays = [of[label] for label in reads]
        z = {"z": of["z"]} if name in kernel.raw.libraries.meta.get("stateful", ()) else {}
        together = call(*arrays, **z)
        alone = [call(*(x[i] for x in arrays), **{key: x[i] for key, x in z.items()}) for i in range(STATES)]
        assert np.array_equal(together, alone), name
        if name != "forward_dynamics" and not mixed.robot.loops:
            less = {key: x.astype(np.float32) for key, x in z.items()}
            assert off(rough(*(x.astype(np.float32) for x in arrays), **less), together) < 1e-3, name


@pytest.mark.soak
@pytest.mark.parametrize("seed", seeds(100, 0, 24))
def test_derivatives_of_accelerations(seed: int, built: Build) -> None:
    """Tangents and adjoints are products with whole Jacobians; of trees these are differences'."""
    mixed, kernel, (s, *_) = subject(seed, built)
    rng = np.random.default_rng(seed)
    apart = (s.z,) if kernel.internal_states else ()
    arguments, weights = (s.q, s.v, s.u, *apart), rng.normal(size=kernel.n)
    whole = kernel.calls.run("forward_dynamics_jacobian", None, arguments[:3], z=s.z if apart else None, whole=True)
    blocks = [x[: kernel.n, : kernel.n] for x in whole]
    blocks += [whole[1][: kernel.n, kernel.n :]] if apart else []
    rates = [rng.normal(size=x.shape) for x in arguments]
    if mixed.robot.loops:
        rates[0] = kernel.project_velocity(s.q, rates[0])
    along = sum(block @ rate for block, rate in zip(blocks, rates, strict=True))
    assert off(kernel.jvp("forward_dynamics", arguments, tuple(rates)), along) < 1e-9
    for found, block in zip(kernel.vjp("forward_dynamics", arguments, weights), blocks, strict=True):
        expected = weights @ block
        assert np.abs(found - expected).max() < 1e-9 * max(1.0, float(np.abs(expected).max()))
    if not mixed.robot.loops and "drives" not in mixed.parts:  # whose limits are corners
        h = 1e-6
        ends = [
            kernel.forward_dynamics(*(x + sign * h * d for x, d in zip(arguments, rates, strict=True)))
            for sign in (1.0, -1.0)
        ]
        assert off((ends[0] - ends[1]) / (2.0 * h), along) < 1e-5


def begin(s: State) -> tuple[tuple[Array, Array, Array], dict[str, Array]]:
    """Return q, slow v and u where a motion begins, and its internal states by their argument."""
    return (s.q, 0.3 * s.v, s.u), {"z": 0.3 * s.z} if s.z.size else {}


def samples_of(motion: Any) -> tuple[Array, ...]:
    """Return q and v of a motion, and z of one with internal states."""
    return (*motion, motion.z) if hasattr(motion, "z") else tuple(motion)


def ends(motion: Any) -> tuple[Array, Array]:
    """Return q at the end of a motion, and v with internal states behind it."""
    q, *rates = (x[-1] for x in samples_of(motion))
    return q, np.concatenate(rates)


@pytest.mark.soak
@pytest.mark.parametrize("seed", seeds(200, 0, 24))
def test_motions_by_all_methods(seed: int, built: Build) -> None:
    """All methods find one motion, and a motion that is resumed half way is the whole one."""
    _, kernel, (*_, s) = subject(seed, built)
    state, z = begin(s)
    adaptive = {"tsit5": 1e-8, "rosenbrock": 1e-7, "radau": 1e-8}
    found = {x: kernel.rollout(*state, method=x, rtol=r, duration=0.02, samples=2, **z) for x, r in adaptive.items()}  # type: ignore[arg-type]
    for method in ("rk4", "implicit"):
        found[method] = kernel.rollout(*state, method=method, dt=1e-5, steps=2000, every=1000, **z)  # type: ignore[arg-type]
    q_end, rates_end = ends(found["tsit5"])
    for method, motion in found.items():
        limit, (q, rates) = 1e-2 if method == "implicit" else 1e-5, ends(motion)
        assert off(q, q_end) < limit, method
        assert off(rates, rates_end) < limit, method
    (qs, vs), u = found["rk4"], state[2]
    middle = {"z": found["rk4"].z[1]} if z else {}
    again = kernel.rollout(qs[1], vs[1], u, method="rk4", dt=1e-5, steps=1000, every=1000, **middle)
    for one, other in zip(ends(again), ends(found["rk4"]), strict=True):
        assert np.array_equal(one, other)


@pytest.mark.soak
@pytest.mark.parametrize("seed", seeds(300, 0, 24))
def test_gradients_of_motions_are_their_sensitivities(seed: int, built: Build) -> None:
    """By drives, states and parameters, those of modes among them; those of Runge-Kutta's steps are differences'."""
    mixed, kernel, (*_, s) = subject(seed, built)
    state, z = begin(s)
    rng, loops = np.random.default_rng(seed), mixed.robot.loops
    along = {"u": rng.normal(size=(2, kernel.n))}
    if not loops:
        along |= {"q": rng.normal(size=(2, kernel.n)), "v": rng.normal(size=(2, kernel.n))}
        along |= {key: rng.normal(size=(2, x.size)) for key, x in z.items()}
    parameters = tuple(x for x in kernel.parameters if ".modes." in x)[:4] + tuple(kernel.parameters)[:3]
    for method, options in GRADIENTS.items():
        asked: dict[str, Any] = {"method": method, "parameters": parameters, **z, **options}
        samples, slopes = kernel.rollout_sensitivity(*state, along=along, **asked)
        weights = [rng.normal(size=x.shape) for x in samples]
        loss = partial(lambda w, *_: (0.0, *w), weights)
        _, by = kernel.rollout_gradient(*state, loss=loss, **asked)
        found = sum(np.einsum("sn,sdn->d", *pair) for pair in zip(weights, slopes, strict=True))
        wanted = [sum((by[x][None] * rates)[i].sum() for x, rates in along.items()) for i in range(2)]
        assert off(found, [*wanted, *(by[x] for x in parameters)]) < 1e-8, method
        if method == "rk4" and not loops and "drives" not in mixed.parts:
            h = 1e-6
            names = {"q": "q0", "v": "v0"}  # of arguments
            given = dict(zip("qvu", state, strict=True)) | z
            moved = [{names.get(k, k): x + sign * h * along[k][0] for k, x in given.items()} for sign in (1.0, -1.0)]
            found = [kernel.rollout(**x, method="rk4", **options) for x in moved]
            for one, other, slope in zip(*(samples_of(x) for x in found), slopes, strict=True):
                assert off((one - other) / (2.0 * h), slope[:, 0]) < 1e-5


def free_link(seed: int, *, second: bool = True) -> tuple[Robot, Link]:
    """Draw a link in space that bends by up to three modes, with nothing on it."""
    robot = random_robot(seed, (1, 1), types=("free",), armature=False, forces=False, rods=False, name="free_link")
    robot = replace(robot, links=robot.links[:1], joints=robot.joints[:1], frames=())
    (link,) = bent(robot, seed, (1, 2, 3), second=second).plain.links
    assert link.modes is not None
    link = replace(link, modes=replace(link.modes, nodes=()))
    return replace(robot, links=(link,)), link


def beyond(robot: Robot, link: Link) -> np.ndarray:
    """Return a state of a free link, (n,), in which its first mode is just beyond its range."""
    model = build_model(robot)
    q = np.zeros(model.size)
    for sign in (1.0, -1.0):
        q[model.coordinates.index(f"{link.name}.mode1")] = 1.01 * sign * deflection_range(link)[0]
        if np.linalg.eigvalsh(answer(robot, "mass_matrix", q=q).reshape(model.size, -1))[0] < 0.0:
            return q
    raise AssertionError(q)


@pytest.mark.parametrize("seed", seeds(0, 3, 40))
def test_ranges_end_where_the_mass_matrix_is_singular(seed: int) -> None:
    """Of a free link, which moves in all ways: a hair before it is positive for both signs, a hair behind for one."""
    robot, link = free_link(seed)
    model, ends = build_model(robot), deflection_range(link)
    assert any(map(math.isfinite, ends))
    for k, end in enumerate(ends):
        amplitudes = [end * x for x in (0.3, 0.999, 1.001)] if math.isfinite(end) else [1.0, 10.0, 100.0]
        least = []
        for amplitude in amplitudes:
            q = np.zeros((2, model.size))
            q[:, model.coordinates.index(f"{link.name}.mode{k + 1}")] = amplitude, -amplitude
            M = [answer(robot, "mass_matrix", q=x).reshape(model.size, -1) for x in q]
            least.append(min(float(np.linalg.eigvalsh(x)[0]) for x in M))
        assert [x > 0.0 for x in least] == [True, True, not math.isfinite(end)]


def test_linear_modes_reach_any_deflection() -> None:
    """Theirs is the energy of particles; a rigid link has no mode."""
    _, link = free_link(0, second=False)
    assert link.modes is not None
    assert set(deflection_range(link)) == {math.inf}
    assert deflection_range(replace(link, modes=None)) == ()


def test_info_has_the_range() -> None:
    info = RobotInfo(build_model(eomgen.load_robot("flexible_arm")), {}, (), {}, {})
    (line,) = (line for line in info.lines() if "modes of upper" in line)
    assert line.startswith("  modes of upper, each by itself, have positive inertia up to 0.0752, 0.0185 (")
    ends = info.as_dict()["bending"]["upper"]["deflection_range"]
    assert ends == pytest.approx([0.0752, 0.0185], rel=5e-3)


def test_a_state_beyond_it_names_link_and_modes(built: Build) -> None:
    """Alone, in a batch and in a rollout; behind a joint that feels it."""
    robot, link = free_link(3)
    kernel, q = built(robot, "mass_matrix", "forward_dynamics", "rollout"), beyond(robot, link)
    zero, place = np.zeros(kernel.n), kernel.coordinates.index(f"{link.name}.mode1")
    said = rf": link {link.name} bends farther than modes of second order reach \({link.name}\.mode1"
    shown = rf" = {q[place]:.4g}, {link.name}\.mode2 = 0.*; allowed: .*, or a link that is cut in two$"
    refused(SingularError, "cannot be inverted" + said + shown, kernel.forward_dynamics, q, zero, zero)
    refused(SingularError, "inverted in state 1" + said + shown, kernel.forward_dynamics, [zero, q], zero, zero)
    refused(SingularError, "inverted in step 0" + said + shown, kernel.rollout, q, zero, dt=1e-4, steps=2)
    assert np.isfinite(kernel.forward_dynamics(0.5 * q, zero, zero)).all()


@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_no_method_moves_a_state_beyond_it(dtype: str, built: Build) -> None:
    """Its matrix is indefinite; where one leaves the range, others have the bits that they have alone."""
    robot, link = free_link(3)
    kernel = built(
        robot, "mass_matrix", "forward_dynamics", "rollout", "adaptive_rollout", "radau_rollout", dtype=dtype
    )
    q, zero = beyond(robot, link).astype(kernel.dtype), np.zeros(kernel.n, kernel.dtype)
    inside, out = (0.2 * q).astype(kernel.dtype), zero.copy()
    out[kernel.coordinates.index(f"{link.name}.mode1")] = 1e3 * q[kernel.coordinates.index(f"{link.name}.mode1")]
    for method in ("implicit", "rk4", *ADAPTIVE):
        how: dict[str, Any] = {"duration": 1e-2, "samples": 2, "rtol": 1e-4}
        if method not in ADAPTIVE:
            how = {"dt": 1e-4, "steps": 100}
        said = f"inverted.*: link {link.name} bends farther than modes of second order reach"
        refused(SingularError, said, kernel.rollout, q, zero, zero, method=method, **how)
        refused(SingularError, said, kernel.rollout, np.stack([inside, q]), zero, zero, method=method, **how)
        if method in ADAPTIVE:
            alone = kernel.rollout(inside, zero, zero, method=method, **how)
            with pytest.raises(IntegrationStopped, match="of state 1; it ends at t") as stop:
                kernel.rollout(
                    np.stack([inside, inside, inside]), np.stack([zero, out, zero]), zero, method=method, **how
                )
            for found, expected in zip(stop.value.stored, alone, strict=True):
                assert np.array_equal(found[[0, 2]], [expected, expected])


def test_only_what_is_the_cause_is_named() -> None:
    """Of two links the one that bends too far, both where each does; nothing of a matrix that is regular or empty."""
    names = ("a.gamma", "a.mode1", "b.gamma", "b.mode1")

    def mass(q: np.ndarray) -> np.ndarray:
        return np.diag([1.0 - q[1] ** 2, 1.0, 1.0 - q[3] ** 2, 1.0])

    q = np.array([0.0, 2.0, 0.0, 0.1])
    said = bent_too_far(mass, q, names, 1e-11)
    assert said.startswith("link a bends farther than modes of second order reach (a.mode1 = 2); allowed: ")
    said = bent_too_far(mass, np.array([0.0, 2.0, 0.0, 3.0]), names, 1e-11)
    assert said.startswith("links a and b bend farther than modes of second order reach (a.mode1 = 2, b.mode1 = 3)")
    assert bent_too_far(mass, 0.1 * q, names, 1e-11) is None
    assert bent_too_far(lambda q: -np.eye(4), q, names, 1e-11) is None
    assert bent_too_far(lambda q: None, q, names, 1e-11) is None
    assert bent_too_far(mass, q, ("a.gamma", "a.x", "b.gamma", "b.x"), 1e-11) is None


@pytest.mark.soak
def test_a_linear_system_about_it_says_the_same() -> None:
    """About a motion that passes there."""
    robot, link = free_link(3)
    q = beyond(robot, link)
    with pytest.raises(SingularError, match=rf"inverted: link {link.name} bends farther than modes of second order"):
        linearize(robot, q, v=0.0 * q, a=0.0 * q)
