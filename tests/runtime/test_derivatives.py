"""Derivatives that kernels give in C, by states and parameters, at corners of laws, and of steps where one is slack."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen.description.load import robot_from_toml
from eomgen.errors import ArrayError, InputError, LoopError, SingularError, UnknownNameError
from eomgen.robot.value import Coordinate, Robot, Spring
from tests.loops.test_closing import parallelogram
from tests.support.builds import Build
from tests.support.refusals import refused
from tests.support.rollout_cases import CLOSED, KERNELS, Case, frozen
from tests.support.soak import across, soaked

pytestmark = pytest.mark.usefixtures("unoptimised")
ENDINGS = ("tangent", "adjoint", "parameter_tangent", "parameter_adjoint", "hessian")
FUNCTIONS = ("inverse_dynamics", "forward_dynamics", "energy", "frame_pose", "frame_jacobian")
DERIVED = tuple(f"{name}_{ending}" for name in FUNCTIONS for ending in ENDINGS)


@pytest.fixture(scope="module")
def kernel() -> eomgen.Kernel:
    """Built when it is called: nothing but what a test asks for."""
    return eomgen.build("one_link")


def arguments(kernel: eomgen.Kernel, name: str, *lead: int) -> tuple[Any, ...]:
    """States, and a frame where the function takes one."""
    rng = np.random.default_rng(3)
    arrays = [rng.uniform(-0.5, 0.5, (*lead, kernel.n)) for _ in range({"energy": 2}.get(name, 3))]
    return (arrays[0], kernel.frames[-1]) if name.startswith("frame_") else tuple(arrays)


@pytest.mark.parametrize("name", soaked(FUNCTIONS, ("forward_dynamics",)))
def test_derivatives_agree_with_each_other_and_with_differences(name: str, kernel: eomgen.Kernel) -> None:
    """In states with two leading axes, as NumPy's rules have it."""
    args, rng = arguments(kernel, name, 2, 3), np.random.default_rng(5)
    arrays = [x for x in args if not isinstance(x, str)]
    function, rest = getattr(kernel, name), args[len(arrays) :]
    rates = [rng.uniform(-1.0, 1.0, x.shape) for x in arrays]
    value = function(*args)
    weights = rng.uniform(-1.0, 1.0, value.shape)
    inner = tuple(range(2, value.ndim))
    along, gradient = kernel.jvp(name, args, rates), kernel.vjp(name, args, weights)
    assert along.shape == value.shape
    assert [x.shape for x in gradient] == [x.shape for x in arrays]
    wanted = (along * weights).sum(axis=inner)
    found = sum((x * rate).sum(axis=-1) for x, rate in zip(gradient, rates, strict=True))
    np.testing.assert_allclose(found, wanted, rtol=1e-9, atol=1e-9 * np.abs(weights * along).max())
    h, size = 1e-6, np.abs(value).max() + np.abs(along).max()
    there, before = (function(*(x + s * h * d for x, d in zip(arrays, rates, strict=True)), *rest) for s in (1, -1))
    np.testing.assert_allclose(along, (there - before) / (2 * h), atol=1e-8 * size)
    second = kernel.hessian(name, args, weights)
    assert second.shape == (2, 3, *(2 * [len(arrays) * kernel.n]))
    np.testing.assert_array_equal(second, np.swapaxes(second, -1, -2))
    ends = []
    for s in (1, -1):
        moved = [x + s * h * d for x, d in zip(arrays, rates, strict=True)]
        ends.append(np.concatenate(kernel.vjp(name, (*moved, *rest), weights), axis=-1))
    turned = np.einsum("...ij,...j->...i", second, np.concatenate(rates, axis=-1))
    np.testing.assert_allclose(turned, (ends[0] - ends[1]) / (2 * h), atol=1e-8 * (1 + np.abs(ends[0]).max()))


def test_one_state_and_many_have_the_same_bits(kernel: eomgen.Kernel) -> None:
    args = arguments(kernel, "inverse_dynamics", 19)
    weights = np.random.default_rng(1).uniform(-1.0, 1.0, (19, kernel.n))
    together = kernel.vjp("inverse_dynamics", args, weights, tuple(kernel.parameters))
    hessians = kernel.hessian("inverse_dynamics", args, weights)
    for i in (0, 7, 18):
        alone = kernel.vjp("inverse_dynamics", [x[i] for x in args], weights[i], tuple(kernel.parameters))
        for whole, own in zip(together, alone, strict=True):
            np.testing.assert_array_equal(whole[i], own)
        np.testing.assert_array_equal(hessians[i], kernel.hessian("inverse_dynamics", [x[i] for x in args], weights[i]))


@pytest.mark.soak
@pytest.mark.parametrize("name", ["forward_dynamics", "energy", "frame_pose"])
def test_by_parameters(name: str, kernel: eomgen.Kernel) -> None:
    """The Jacobian's columns are differences, and the reverse sweep's weighted rows of it."""
    args, names = arguments(kernel, name, 4), tuple(kernel.parameters)
    function = getattr(kernel, name)
    value = function(*args)
    found = kernel.parameter_jacobian(name, args, names)
    assert found.shape == (*value.shape, len(names))
    np.testing.assert_array_equal(found, kernel.parameter_jacobian(name, args))
    weights = np.random.default_rng(2).uniform(-1.0, 1.0, value.shape)
    by = kernel.vjp(name, args, weights, names)[-1]
    wanted = (found * weights[..., None]).sum(axis=tuple(range(1, value.ndim)))
    np.testing.assert_allclose(by, wanted, rtol=1e-10, atol=1e-12)
    for k, parameter in enumerate(names):
        x = kernel.parameters[parameter]
        h = 1e-5 * max(1.0, abs(x))
        there, before = (function_of(kernel, name, args, parameter, x + s * h) for s in (1, -1))
        np.testing.assert_allclose(found[..., k], (there - before) / (2 * h), atol=1e-7 * (1 + np.abs(value).max()))
        rates = [np.zeros_like(y) for y in args if not isinstance(y, str)]
        np.testing.assert_allclose(
            kernel.jvp(name, args, rates, parameters={parameter: 1.0}), found[..., k], rtol=1e-12
        )


def function_of(kernel: eomgen.Kernel, name: str, args: tuple[Any, ...], parameter: str, value: float) -> np.ndarray:
    """A function's result with another value of a parameter."""
    return np.asarray(getattr(kernel.replaced(parameters={parameter: value}), name)(*args))


def test_hessians_of_chosen_parameters_and_names(kernel: eomgen.Kernel) -> None:
    args = arguments(kernel, "energy")
    one, two = tuple(kernel.parameters)[:2]
    both = kernel.parameter_jacobian("energy", args, (two, one))
    np.testing.assert_array_equal(both[:, 0], kernel.parameter_jacobian("energy", args, (two,))[:, 0])
    assert kernel.parameter_jacobian("energy", args, ()).shape == (2, 0)


@pytest.mark.soak
def test_closed_mechanisms(built: Build) -> None:
    """Derivatives where loops are closed, and an open state is refused as by the function itself."""
    kernel = eomgen.build("four_bar")
    q = kernel.assemble([0.5, 0.2, 1.2])
    v, rng = kernel.project_velocity(q, [1.0, 0.0, 0.0]), np.random.default_rng(0)
    u, weights = rng.uniform(-1.0, 1.0, (2, kernel.n))
    by = kernel.forward_dynamics_jacobian(q, v, u)
    for found, matrix in zip(kernel.vjp("forward_dynamics", (q, v, u), weights), by, strict=True):
        np.testing.assert_allclose(found, weights @ matrix, rtol=1e-7, atol=1e-7 * np.abs(by).max())
    refused(LoopError, "loop joint4 is open", kernel.vjp, "forward_dynamics", (q + 0.1, v, u), weights)


def test_what_is_wrong_is_named(kernel: eomgen.Kernel) -> None:
    q, v, a = arguments(kernel, "inverse_dynamics")
    refused(UnknownNameError, "without derivatives of 'inverse'", kernel.vjp, "inverse", (q, v, a), a)
    refused(InputError, r"energy: got 3 arguments; allowed: \(q, v\)", kernel.jvp, "energy", (q, v, a), (q, v))
    refused(InputError, "tangents: got 1; allowed: one for each of q, v", kernel.jvp, "energy", (q, v), (q,))
    refused(ArrayError, r"cotangent: expected float64 of shape \(2,\)", kernel.vjp, "energy", (q, v), np.zeros(3))
    refused(ArrayError, r"cotangent.*\[1\] is nan", kernel.vjp, "energy", (q, v), [0.0, np.nan])
    refused(UnknownNameError, "parameters: 'mass' is unknown", kernel.vjp, "energy", (q, v), [1.0, 0.0], ("mass",))
    refused(InputError, "every name once", kernel.vjp, "energy", (q, v), [1.0, 0.0], 2 * tuple(kernel.parameters)[:1])
    with pytest.raises(InputError, match=r"'gravity\.x'; allowed: a sequence of names"):
        kernel.parameter_jacobian("energy", (q, v), "gravity.x")
    refused(UnknownNameError, "frame: 'hand' is unknown", kernel.jvp, "frame_pose", (q, "hand"), (q,))
    refused(InputError, r"frame_pose: got 1 arguments; allowed: \(q, frame\)", kernel.jvp, "frame_pose", (q,), (q,))


def test_derivatives_are_there_on_request_alone(built: Build) -> None:
    kernel = built(eomgen.load_robot("one_link"), "energy", "energy_adjoint")
    q = np.zeros(2)
    assert len(kernel.vjp("energy", (q, q), [1.0, 1.0])) == 2
    refused(UnknownNameError, "without the kernel energy_hessian", kernel.hessian, "energy", (q, q), [1.0, 1.0])
    refused(UnknownNameError, "without the kernel energy_tangent", kernel.jvp, "energy", (q, q), (q, q))


MASS = 2.0
LAWS = {  # of slides side by side: numbers, where the law has a corner, the rate there, and the side that counts
    "sides": ("{ stiffness = 100.0, stiffness_negative = 300.0 }", 0.0, 0.0, -1.0),
    "upper": ("{ stops = { upper = 0.1, stiffness = 1e4, damping = 10.0, smoothing = 1e-3 } }", 0.1, 0.3, -1.0),
    "lower": ("{ stops = { lower = -0.1, stiffness = 1e4, damping = 10.0, smoothing = 1e-3 } }", -0.1, -0.3, 1.0),
    "play": ("{ stiffness = 1e4, clearance = 0.01, restitution_damping = 0.5, smoothing = 1e-3 }", 0.01, 0.3, -1.0),
    "wear": ("{ stiffness = 1e4, clearance = 0.01, smoothing = 1e-3 }", 0.011, 0.3, -1.0),
    "curve": ("{ curve = [[-0.1, -50.0], [0.0, 0.0], [0.1, 100.0]] }", 0.0, 0.0, -1.0),
    "rubs": ("{ friction = { coulomb = 2.0, smoothing = 0.01 } }", 0.0, 0.0, -1.0),
}
DYNAMICS = ("inverse_dynamics", "forward_dynamics")
SECOND = tuple(f"{name}{end}" for name in DYNAMICS for end in ("", "_tangent", "_adjoint", "_hessian"))
EXACT = ("residual_jacobian", "forward_dynamics_jacobian")
BODY = """
[[links]]
name = "{0}_body"
mass = {1}
com = [0.0, 0.0, 0.0]
inertia = {{ xx = 0.1, yy = 0.2, zz = 0.3 }}
[[joints]]
name = "{0}"
parent = "base"
child = "{0}_body"
type = "{2}"
"""


def slides() -> Robot:
    """A slide for every law, all of them on the base."""
    bodies = "".join(BODY.format(name, MASS, "prismatic") + f"z = {law[0]}\n" for name, law in LAWS.items())
    return robot_from_toml(f'name = "slides"\ngravity = [0.0, 0.0, 0.0]\n{bodies}')


def floating() -> Robot:
    return robot_from_toml(f'name = "floating"\n{BODY.format("root", MASS, "free")}')


def test_where_a_law_has_a_corner_all_derivatives_are_those_of_one_side(built: Build) -> None:
    """Of contacts that are open, of a slack side's stiffness, of the piece before a knot; the same whoever is asked."""
    kernel = built(slides(), *SECOND, *EXACT)
    _, q, v, side = (np.array(x) for x in zip(*LAWS.values(), strict=True))
    n, still, h = kernel.n, np.zeros(kernel.n), 1e-7
    q, v, side = q.astype(float), v.astype(float), side.astype(float)
    beside = kernel.inverse_dynamics(q + h * side, v, still)
    by_q = (beside - kernel.inverse_dynamics(q, v, still)) / (h * side)
    other = kernel.inverse_dynamics(q - h * side, v, still)
    across = (kernel.inverse_dynamics(q, v, still) - other) / (h * side)
    corners = np.abs(across - by_q) > 10.0
    assert corners.tolist() == [name in ("sides", "upper", "lower") for name in LAWS], "whose slopes differ"
    ones = np.ones(n)
    K, D, _ = kernel.residual_jacobian(q, v, still)
    np.testing.assert_allclose(np.diagonal(K), by_q, rtol=1e-3, atol=1e-2)
    state = (q, v, still)
    for name, sign, share in (("inverse_dynamics", 1.0, 1.0), ("forward_dynamics", -1.0, 1.0 / MASS)):
        by = (np.eye(n) @ K, D)
        for place, slope in enumerate(by):
            wanted = sign * share * slope
            rates = [ones if place == i else still for i in range(3)]
            np.testing.assert_allclose(kernel.jvp(name, state, rates), wanted @ ones, rtol=1e-12, atol=1e-9)
            np.testing.assert_allclose(kernel.vjp(name, state, ones)[place], ones @ wanted, rtol=1e-12, atol=1e-9)
    a = kernel.forward_dynamics_jacobian(q, v, still)
    np.testing.assert_allclose(a[0], -K / MASS, rtol=1e-12, atol=1e-9)
    np.testing.assert_allclose(a[1], -D / MASS, rtol=1e-12, atol=1e-9)


def test_second_derivatives_are_of_the_same_side(built: Build) -> None:
    kernel = built(slides(), *SECOND, *EXACT)
    q, v, side = (np.array([law[i] for law in LAWS.values()], dtype=float) for i in (1, 2, 3))
    n, still, h = kernel.n, np.zeros(kernel.n), 1e-7
    found = kernel.hessian("inverse_dynamics", (q, v, still), np.ones(n))
    here, beside = (np.diagonal(kernel.residual_jacobian(x, v, still)[0]) for x in (q, q + h * side))
    np.testing.assert_allclose(np.diagonal(found)[:n], (beside - here) / (h * side), rtol=1e-3, atol=1.0)
    assert np.isfinite(kernel.hessian("forward_dynamics", (q, v, still), np.ones(n))).all()


WITH_STATES = {  # laws with internal states: a corner at v = 0
    "rubs": 'friction = { model = "lugre", coulomb = 2.0, bristle_stiffness = 1e3, bristle_damping = 30.0 }',
    "winds": "hysteresis = { stiffness = 50.0, beta = 12.0, gamma = 8.0, n = 1.5 }",
}


def test_laws_with_states_have_derivatives_of_the_negative_side_at_rest(built: Build) -> None:
    """All of them, by velocities; bristles and springs are deflected, so that the sides differ."""
    bodies = "".join(BODY.format(name, MASS, "prismatic") + f"z = {{ {law} }}\n" for name, law in WITH_STATES.items())
    kernel = built(robot_from_toml(f'name = "resting"\ngravity = [0.0, 0.0, 0.0]\n{bodies}'), *SECOND, *EXACT)
    still, z, h = np.zeros(2), np.array([1e-3, 0.1]), 1e-7
    run = partial(kernel.calls.run, z=z, whole=True)
    here, one, other = (run("forward_dynamics", None, (still, still + x, still)) for x in (0.0, -h, h))
    along, ones = (here - one) / h, np.ones(2)
    assert (np.abs(along - (other - here) / h)[2:] > 0.1).all()
    slope = run("forward_dynamics_jacobian", None, (still, still, still))[1]
    np.testing.assert_allclose(slope @ [1.0, 1.0, 0.0, 0.0], along, rtol=1e-5, atol=1e-5)
    jvp = run("forward_dynamics_tangent", None, (still, still, z, still, still, ones, 0.0 * z, still))
    np.testing.assert_allclose(jvp, along, rtol=1e-5, atol=1e-5)
    arguments = still, still, still, z
    rows = [kernel.vjp("forward_dynamics", arguments, weights)[1] @ ones for weights in np.eye(2)]
    np.testing.assert_allclose(rows, along[:2], rtol=1e-5, atol=1e-5)


ENDS = ("", "_tangent", "_adjoint", "_hessian", "_parameter_tangent", "_parameter_adjoint")


def refused_everywhere(kernel: eomgen.Kernel, q: np.ndarray, match: str) -> None:
    """All derivatives of accelerations say what they themselves say."""
    still, name = np.zeros(kernel.n), "forward_dynamics"
    ones, state = np.ones(kernel.n), (q, np.zeros(kernel.n), np.zeros(kernel.n))
    calls = {
        "itself": lambda: kernel.forward_dynamics(*state),
        "jacobian": lambda: kernel.forward_dynamics_jacobian(*state),
        "jvp": lambda: kernel.jvp(name, state, (ones, still, still)),
        "jvp of many": lambda: kernel.jvp(name, (np.tile(q, (9, 1)), still, still), (ones, still, still)),
        "vjp": lambda: kernel.vjp(name, state, ones),
        "hessian": lambda: kernel.hessian(name, state, ones),
        "parameters": lambda: kernel.parameter_jacobian(name, state),
        "parameters back": lambda: kernel.vjp(name, state, ones, ("gravity.x",)),
    }
    for what, call in calls.items():
        caught = refused(SingularError, match, call)
        assert (" in state" in str(caught)) == (what == "jvp of many"), "a single state has no number"


def test_angles_at_their_poles_are_named(built: Build) -> None:
    kernel = built(floating(), *(f"forward_dynamics{end}" for end in ENDS), "forward_dynamics_jacobian")
    q = np.array([0.0, 0.0, 0.0, 0.1, np.pi / 2, 0.2])
    refused_everywhere(kernel, q, r"root.alpha and root.gamma.*; root.beta is at \+-pi/2")


@pytest.mark.soak
def test_a_dead_mechanism_is_named(built: Build) -> None:
    kernel = built(
        parallelogram(),
        *(f"forward_dynamics{end}" for end in ENDS),
        *("forward_dynamics_jacobian", "constraint_jacobian", "mass_matrix"),
    )
    refused_everywhere(kernel, np.zeros(3), r"loop hinge is at a singular pose.*allowed: poses beside it")


def test_parameters_of_many_states_name_the_one(built: Build) -> None:
    kernel = built(floating(), "forward_dynamics", "forward_dynamics_parameter_tangent")
    q = np.zeros((2, 3, 6))
    q[1, 2, 4] = np.pi / 2
    with pytest.raises(SingularError, match=r"root.gamma in state \(1, 2\);"):
        kernel.parameter_jacobian("forward_dynamics", (q, np.zeros(6), np.zeros(6)))


def test_a_rollout_from_a_dead_pose_blames_the_pose(built: Build) -> None:
    """Not the step: there are no accelerations where it begins, however it goes on."""
    beside = ("constraint_jacobian", "mass_matrix", "constraint", "cut_poses")
    kernel, still = built(parallelogram(), "rollout", "forward_dynamics", *beside), np.zeros(3)
    with pytest.raises(SingularError, match=r"rollout: parallelogram: loop hinge is at a singular pose.* in step 0$"):
        kernel.rollout(still, still, still, 1e-3, 5)
    with pytest.raises(SingularError, match=r" in step 0 of state 1"):
        kernel.rollout(np.array([[0.5, -0.5, 0.5], still]), still, still, 1e-3, 5)


def test_parameters_of_a_robot_that_turns_freely(built: Build) -> None:
    """Which of its joints are turned stands behind the parameters in C, and is none."""
    kernel = built(floating(), "forward_dynamics", "forward_dynamics_parameter_tangent")
    assert list(kernel.parameters) == ["gravity.x", "gravity.y", "gravity.z"]
    state = (np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6]), np.full(6, 0.3), np.zeros(6))
    found = kernel.parameter_jacobian("forward_dynamics", state)
    np.testing.assert_allclose(found[:3], np.eye(3), atol=1e-12)
    np.testing.assert_allclose(found[3:], 0.0, atol=1e-12)


def test_a_rollout_that_begins_at_a_dead_mechanism_has_no_gradient(built: Build) -> None:
    """Implicit steps go on from there, to one of the sides; open states are closed, and beside it there is one."""
    names = ("forward_dynamics", "constraint_jacobian", "mass_matrix", "rollout", "implicit_gradient")
    kernel = built(parallelogram(), *names)

    def loss(t: np.ndarray, q: np.ndarray, v: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        return float(q[..., -1, 0].sum()), np.zeros_like(q), np.zeros_like(v)

    still, flat, beside = np.zeros(3), np.zeros(3), np.array([0.5, -0.5, 0.5])
    drives = np.zeros((2, 3))
    with pytest.raises(SingularError, match="loop hinge is at a singular pose"):
        kernel.rollout_gradient(flat, still, drives, 1e-3, 2, loss=loss, method="implicit")
    with pytest.raises(SingularError, match=r"loop hinge is at a singular pose.* in state 1"):
        kernel.rollout_gradient(np.array([beside, flat]), still, drives, 1e-3, 2, loss=loss, method="implicit")
    for q in (beside, beside + 1e-4):
        _, by = kernel.rollout_gradient(q, still, drives, 1e-3, 2, loss=loss, method="implicit")
        assert np.isfinite(by["q"]).all()


METHODS = ("implicit", "rosenbrock")
NAMES = tuple(name for name in KERNELS if not name.startswith("explicit"))
SPRINGS = ("spring_forces", "cut_forces")
GAP = 0.015625  # half a clearance, m: places of all that becomes slack are exact in binary numbers
CART = (
    BODY.replace("{2}", "prismatic") + "z = {{ damping = 0.5 }}\n"
)  # of which one thing, that can be slack, holds each
CUT = '[[loops]]\nname = "{0}_cut"\nlinks = ["base", "{0}_body"]\ntype = "fixed"\n'
FREE = "alpha = {}\nbeta = {}\ngamma = {}\n"
COUPLING = '[[couplings]]\nname = "{0}_gear"\nof = "{0}.z"\nto = {{ "{0}_other.z" = -0.5 }}\n'
CABLE = '[[springs]]\nname = "{0}_rope"\nlinks = ["base", "{0}_body"]\npoints = [[0.0, 0.0, {1}], [0.0, 0.0, 0.0]]\n'
TENSION = "free_length = 0.5\nstiffness = 3e3\ndamping = 2.0\ntension_only = true\nsmoothing = 1e-3\n"
CURVE = f"curve = [[-0.25, -80.0], [-{GAP}, 0.0], [{GAP}, 0.0], [0.25, 60.0]]\n"
PLAY = f"stiffness = 2e3, clearance = {GAP}, restitution_damping = 0.4, smoothing = 1e-3"
STOPS = f"stops = {{ lower = -{GAP}, upper = {GAP}, stiffness = 2e3, damping = 3.0, smoothing = 1e-3 }}\n"
HELD = {  # what holds a cart, where it becomes slack, and whether a second one hangs on it
    "cable": (CABLE.format("cable", -0.5 + GAP) + TENSION, False),
    "play": (COUPLING.format("play") + PLAY.replace(", ", "\n") + "\n", True),
    "apart": (COUPLING.format("apart") + STOPS, True),
    "flat": (COUPLING.format("flat") + CURVE, True),
    "cut": (CUT.format("cut") + f"x = {{}}\ny = {{}}\nz = {{ {PLAY} }}\n" + FREE, False),
    "parted": (CUT.format("parted") + f"x = {{}}\ny = {{}}\nz = {{ {STOPS.strip()} }}\n" + FREE, False),
    "level": (CUT.format("level") + f"x = {{}}\ny = {{}}\nz = {{ {CURVE.strip()} }}\n" + FREE, False),
}
PLACES = (  # numbers that say where something closes
    *("couplings.play_gear.clearance", "couplings.apart_gear.stops.upper", "loops.cut_cut.z.clearance"),
    *("loops.pin_cut.radial.clearance", "springs.cable_rope.free_length", "couplings.play_gear.smoothing"),
)
BEARING = f"radial = {{ {PLAY}, friction = {{ coefficient = 0.2, smoothing = 0.01 }} }}\n"
JOURNAL = CART.replace("z = {{", "x = {{ damping = 0.5 }}\nz = {{").format("pin", 1.0)
JOURNAL += CUT.format("pin") + "x = {}\ny = {}\nz = {}\n" + FREE + BEARING


def carts() -> Robot:
    """A cart for each of what can be slack, some with a second one, and a journal, whose cart moves along x and z."""
    text = f'name = "carts"\ngravity = [0.0, 0.0, 0.0]\ntunable = {list(PLACES)}\n'
    for name, (held, is_pair) in HELD.items():
        text += CART.format(name, 1.0) + (CART.format(f"{name}_other", 2.0) if is_pair else "") + held
    return robot_from_toml(text + JOURNAL)


def begin(kernel: eomgen.Kernel, place: float, rate: float) -> tuple[np.ndarray, np.ndarray]:
    """Deviations of all that becomes slack at ``GAP``, and their rates; pairs share them."""
    q, v = np.zeros(kernel.n), np.zeros(kernel.n)
    for i, name in enumerate(kernel.coordinates):
        share = {"pin.z": 0.0}.get(name, 0.5 if f"{name[:-2]}_other.z" in kernel.coordinates else 1.0)
        q[i], v[i] = share * place, share * rate
    return q, v


STATES = {  # deviation and rate at the beginning
    "slack": (0.5 * GAP, 0.1),
    "within the smoothing": (GAP + 4e-4, 0.01),
    "taut": (GAP + 4e-3, 0.1),
    "taut, on the other side": (-GAP - 4e-3, -0.1),
    "gets taut": (GAP - 1e-3, 0.47),
    "gets slack": (GAP + 2e-3, -0.47),
}


def case_of(built: Build, method: str, state: tuple[float, float] = (0.0, 0.0), **options: Any) -> Case:
    """Carts with a method, drives and a loss."""
    kernel = built(carts(), *NAMES, **options)
    q, v = begin(kernel, *state)
    case = Case(kernel, method, {"q": q, "v": v, "u": np.random.default_rng(5).uniform(-1.0, 1.0, kernel.n)}, power=1)
    case.inputs, case.parameters = ("q", "v"), tuple(x for x in kernel.parameters if "gravity" not in x)
    return case


@pytest.mark.parametrize(("where", "method"), across(STATES, METHODS))
def test_on_both_sides(where: str, method: str, built: Build, monkeypatch: pytest.MonkeyPatch) -> None:
    """By coordinates and rates where motions begin, and by all numbers of what holds the carts."""
    frozen(monkeypatch)
    case = case_of(built, method, STATES[where])
    found = case.gradient()[1]
    for i, name in enumerate(case.kernel.coordinates):
        for given in case.inputs:
            wanted = case.slope(given, np.eye(case.kernel.n)[i], 1e-7)
            assert found[given][i] == pytest.approx(wanted, rel=1e-6, abs=1e-7), name
    for name in case.parameters:
        step = 1e-6 * max(abs(case.kernel.parameters[name]), 0.1)
        wanted = case.slope(name, np.ones(()), step)
        assert found[name] == pytest.approx(wanted, rel=1e-6, abs=1e-9 / step), name


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_at_slack_itself(side: float, method: str, built: Build, monkeypatch: pytest.MonkeyPatch) -> None:
    """At rest where all of it just closes: derivatives of the slack side, on which nothing pulls."""
    frozen(monkeypatch)
    case, h = case_of(built, method, (side * GAP, 0.0)), 1e-6
    case.given["u"][:] = 0.0
    value, found = case.gradient()
    assert np.isfinite([found[name] for name in case.parameters]).all()
    for i in np.flatnonzero(case.given["q"]):
        e = -side * np.eye(case.kernel.n)[i]
        for given in case.inputs:
            wanted = (case.gradient(**{given: case.given[given] + h * e})[0] - value) / h
            assert found[given] @ e == pytest.approx(wanted, rel=1e-6, abs=1e-8), case.kernel.coordinates[i]


@pytest.mark.parametrize("method", METHODS)
def test_forwards_and_backwards(method: str, built: Build) -> None:
    """Sensitivities and gradients are the same derivatives, of many states as of each alone."""
    case = case_of(built, method)
    pairs = [begin(case.kernel, *state) for state in (*STATES.values(), (GAP, 0.0))]
    q, v = (np.array([pair[i] for pair in pairs]) for i in (0, 1))
    whole = case.gradient(q=q, v=v)[1]
    total = dict.fromkeys(case.parameters, 0.0)
    for k, (case.given["q"], case.given["v"]) in enumerate(pairs):
        alone = case.gradient()[1]
        assert all(np.array_equal(alone[name], whole[name][k]) for name in case.inputs)
        case.check_sensitivities(1e-9)
        total = {x: y + alone[x] for x, y in total.items()}
    assert all(whole[x] == pytest.approx(total[x], rel=1e-12, abs=1e-12) for x in case.parameters)


@pytest.mark.soak
@pytest.mark.parametrize("where", [*STATES, "at slack"])
def test_in_single_precision(where: str, built: Build) -> None:
    """Of steps of one length; those of double precision but for round-off."""
    state = (STATES | {"at slack": (0.75 * GAP, 0.0)})[where]
    double, single = (case_of(built, "implicit", state, dtype=dtype) for dtype in ("float64", "float32"))
    single.given = {name: x.astype(np.float32) for name, x in single.given.items()}
    wanted, found = (case.gradient()[1] for case in (double, single))
    for name in ("q", "v"):
        assert found[name].dtype == np.float32
        assert np.abs(found[name] - wanted[name]).max() <= 2e-3 * np.abs(wanted[name]).max()


def test_gradients_that_are_not_finite_are_refused_by_name(built: Build) -> None:
    """Not as numbers, nor as steps that are too long."""
    case = case_of(built, "implicit", (0.5 * GAP, 0.1))
    along = {"v": np.full((1, case.kernel.n), 1.7e308)}
    message = r"rollout_sensitivity: the derivative of .* along direction 0 is -?(inf|nan)"
    refused(ArrayError, message, case.sensitivity, along=along, parameters=())
    case.loss.weights[...] = 1.7e308
    message = r"rollout_gradient: the derivative by (q|v|u) at .*\.[xz] is -?(inf|nan)"
    with np.errstate(over="ignore"):
        refused(ArrayError, message, case.gradient, parameters=())


def worn_four_bar() -> Robot:
    """A rigid loop whose cut joint has play, and a cable: rigid rows and elastic ones, of which one is slack."""
    robot = eomgen.load_robot("four_bar")
    play = Coordinate(stiffness=50.0, clearance=0.3, restitution_damping=0.1)
    cable = Spring("rope", ("base", "coupler"), ((0.0, -0.2, 0.0), (0.1, 0.0, 0.0)), 0.4, 500.0, 1.0, tension_only=True)
    pin = replace(robot.loops[0], coordinates={"gamma": play}, offset=(*(None,) * 5, -0.9))
    return replace(robot, loops=(pin,), springs=(cable,))


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    ("name", "guess"),
    [
        pytest.param("balanced_arm", (0.0, 0.5, 1.0), marks=pytest.mark.soak),
        pytest.param("balanced_arm", (0.0, 1.0, 0.4), marks=pytest.mark.soak),
        ("four_bar", (1.0, -0.5, 1.4)),
        ("four_bar", (2.8, -0.5, 2.5)),
    ],
)
def test_mechanisms(
    name: str, guess: tuple[float, ...], method: str, built: Build, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A cable beside other springs, in space; play and a cable beside rigid rows. By states, and by drives."""
    frozen(monkeypatch)
    is_closed, h = name == "four_bar", 3e-5
    robot = worn_four_bar() if is_closed else eomgen.load_robot(name)
    kernel = built(robot, *NAMES, *((*CLOSED, *SPRINGS) if is_closed else ()))
    q, v, u = np.array(guess), np.zeros(kernel.n), np.array([0.5, 0.3, -0.2])
    if is_closed:
        q = kernel.assemble(q, ["joint1.gamma"])
        v = kernel.project_velocity(q, [2.0, 0.0, 0.0], ["joint1.gamma"])
    case = Case(kernel, method, {"q": q, "v": v, "u": u}, power=1)
    found = case.gradient()[1]
    for name in case.inputs:
        slopes = ([case.slope(name, e, step) for e in np.eye(kernel.n)] for step in (h, 2.0 * h))
        wanted = np.array([4.0, -1.0]) @ list(slopes) / 3.0
        assert np.abs(found[name] - wanted).max() <= 1e-6 * np.abs(wanted).max(), name


def net() -> Robot:
    """A body that many cables to carts hold, each second one slack: its accelerations stay unknowns of the rows."""
    text = 'name = "net"\ngravity = [0.0, 0.0, 0.0]\n' + CART.replace("z = {{", "x = {{}}\ny = {{}}\nz = {{").format(
        "body", 3.0
    )
    for k in range(8):
        at, angle = f"cart{k}", 0.25 * np.pi * k
        place = f"placement = {{ xyz = [{np.cos(angle):.12g}, {np.sin(angle):.12g}, {0.3 * (-1) ** k}] }}\n"
        text += CART.format(at, 1.0).replace("z = {", f"{place}z = {{")
        ends = f'links = ["body_body", "{at}_body"]\npoints = [[0.0, 0.0, 0.0], [0.0, 0.0, 0.0]]\n'
        text += f'[[springs]]\nname = "rope{k}"\n{ends}' + TENSION.replace("0.5", "1.04" if k % 2 else "1.05")
    return robot_from_toml(text)


@pytest.mark.soak
@pytest.mark.parametrize("method", METHODS)
def test_a_body_that_many_hold(method: str, built: Build, monkeypatch: pytest.MonkeyPatch) -> None:
    frozen(monkeypatch)
    kernel, rng, h = built(net(), *NAMES, "spring_forces"), np.random.default_rng(6), 1e-6
    q, v, u = 3e-3 * rng.normal(size=kernel.n), 0.1 * rng.normal(size=kernel.n), rng.normal(size=kernel.n)
    tensions = kernel.functions.spring_forces(q, v)[:, 1]
    assert 0 < np.count_nonzero(tensions) < tensions.size
    case = Case(kernel, method, {"q": q, "v": v, "u": u}, power=1)
    found = case.gradient()[1]
    for e in rng.normal(size=(3, 2, kernel.n)):
        for name, direction in zip("qv", e, strict=True):
            assert found[name] @ direction == pytest.approx(case.slope(name, direction, h), rel=1e-6)
