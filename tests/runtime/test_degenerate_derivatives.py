"""Derivatives in states where they are one-sided, or where there are none: of which side, or what is refused."""

from __future__ import annotations

import numpy as np
import pytest

import eomgen
from eomgen.description.load import robot_from_toml
from eomgen.errors import SingularError
from eomgen.robot.value import Robot
from tests.loops.test_singular_poses import parallelogram
from tests.support.builds import Build

pytestmark = pytest.mark.usefixtures("unoptimised")

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
NAMES = ("inverse_dynamics", "forward_dynamics")
KERNELS = tuple(f"{name}{end}" for name in NAMES for end in ("", "_tangent", "_adjoint", "_hessian"))
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
placement = {{ xyz = [0.0, 0.0, 0.0], rpy = [0.0, 0.0, 0.0] }}
"""


def slides() -> Robot:
    """A slide for every law, all of them on the base."""
    bodies = "".join(BODY.format(name, MASS, "prismatic") + f"z = {law[0]}\n" for name, law in LAWS.items())
    return robot_from_toml(f'name = "slides"\ngravity = [0.0, 0.0, 0.0]\n{bodies}')


def floating() -> Robot:
    return robot_from_toml(f'name = "floating"\n{BODY.format("root", MASS, "free")}')


def test_where_a_law_has_a_corner_all_derivatives_are_those_of_one_side(built: Build) -> None:
    """Of contacts that are open, of a slack side's stiffness, of the piece before a knot; the same whoever is asked."""
    kernel = built(slides(), *KERNELS, *EXACT)
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
    kernel = built(slides(), *KERNELS, *EXACT)
    q, v, side = (np.array([law[i] for law in LAWS.values()], dtype=float) for i in (1, 2, 3))
    n, still, h = kernel.n, np.zeros(kernel.n), 1e-7
    found = kernel.hessian("inverse_dynamics", (q, v, still), np.ones(n))
    here, beside = (np.diagonal(kernel.residual_jacobian(x, v, still)[0]) for x in (q, q + h * side))
    np.testing.assert_allclose(np.diagonal(found)[:n], (beside - here) / (h * side), rtol=1e-3, atol=1.0)
    assert np.isfinite(kernel.hessian("forward_dynamics", (q, v, still), np.ones(n))).all()


ENDS = ("", "_tangent", "_adjoint", "_hessian", "_parameter_tangent", "_parameter_adjoint")


def refused(kernel: eomgen.Kernel, q: np.ndarray, match: str) -> None:
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
        with pytest.raises(SingularError, match=match) as caught:
            print(what, call())
        assert (" in state" in str(caught.value)) == (what == "jvp of many"), "a single state has no number"


def test_angles_at_their_poles_are_named(built: Build) -> None:
    kernel = built(floating(), *(f"forward_dynamics{end}" for end in ENDS), "forward_dynamics_jacobian")
    q = np.array([0.0, 0.0, 0.0, 0.1, np.pi / 2, 0.2])
    refused(kernel, q, r"root.alpha and root.gamma.*; root.beta is at \+-pi/2")


@pytest.mark.soak
def test_a_dead_mechanism_is_named(built: Build) -> None:
    kernel = built(
        parallelogram(),
        *(f"forward_dynamics{end}" for end in ENDS),
        *("forward_dynamics_jacobian", "constraint_jacobian", "mass_matrix"),
    )
    refused(kernel, np.zeros(3), r"loop hinge is at a singular pose.*allowed: poses beside it")


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
