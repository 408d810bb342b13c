"""Analyses of robots with internal states, against differences of their equations of motion and their motions."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg

import eomgen
from eomgen.analysis.at_rest import rest
from eomgen.analysis.compliance import compliance_map
from eomgen.analysis.frequency import response
from eomgen.analysis.holding import fixation_of
from eomgen.analysis.matrices import linearize
from eomgen.analysis.modal import modes, modes_along
from eomgen.analysis.statics import deflection, joint_stiffness_matrix
from eomgen.description.load import robot_from_toml
from eomgen.errors import ArrayError, EomgenWarning, InputError, UnknownNameError
from eomgen.loops.equilibrium import closed_equilibrium
from eomgen.state.equilibrium import static_equilibrium
from tests.support.bristled import ARM, bristled_arm, served_arm
from tests.support.bristles import FRICTION, GEARED, bristle_gear, bristle_linkage
from tests.support.builds import Build
from tests.support.joint_table import joint_table, link_table
from tests.support.random_robots import Array
from tests.support.soak import soaked

pytestmark = [
    pytest.mark.usefixtures("unoptimised"),
    pytest.mark.filterwarnings("ignore::eomgen.errors.EomgenWarning"),
]

STATE = "j1.gamma.friction.z"
POSE = {"j1": 0.3, "j2": 0.4}
BENT = {"j1.gamma.friction.z": 3e-5, "j2.beta.friction.z": -2e-5}


def by_differences(kernel: eomgen.Kernel, x: Array, u: Array) -> Array:
    """Return derivatives of (v, a, z') by (q, v, z)."""
    n = len(kernel.coordinates)

    def rates(x: Array) -> Array:
        q, v, z = np.split(x, [n, 2 * n])
        return np.concatenate([v, kernel.forward_dynamics(q, v, u, z), kernel.internal_state_derivatives(q, v, z, u)])

    h = np.repeat([1e-6, 1e-6, 1e-9], [n, n, x.size - 2 * n])
    return np.array([(rates(x + h[i] * e) - rates(x - h[i] * e)) / (2 * h[i]) for i, e in enumerate(np.eye(x.size))]).T


@pytest.mark.parametrize("moving", [True, False])
def test_linear_systems_are_differences(moving: bool, built: Build) -> None:
    """In motion with bent bristles, and at rest with unbent ones, where both directions are alike."""
    robot = bristled_arm()
    kernel = built(robot)
    q, v = np.array([0.3, 1e-5, -1e-4, 0.4]), np.array([0.2, 0.01, -0.05, 0.3])
    if moving:
        z = np.array([3e-5, -2e-5])
        system = linearize(robot, q, v=v, u=np.array([1.0, 0.0, 0.0, 2.0]), kernel=kernel, z=z)
        x = np.concatenate([q, v, z])
        assert system.z == pytest.approx(z)
    else:
        system = linearize(robot, POSE, kernel=kernel)
        x = np.concatenate([system.q, 0 * v, [0.0, 0.0]])
    names = (*kernel.coordinates, *(f"{name}.rate" for name in kernel.coordinates), *kernel.internal_states)
    assert system.states == names
    expected = by_differences(kernel, x, system.u)
    size = np.abs(expected).max(axis=1, keepdims=True)
    assert (np.abs(system.A - expected) <= 2e-5 * size).all()
    assert system.a == pytest.approx(kernel.forward_dynamics(x[:4], x[4:8], system.u, x[8:]), abs=1e-8)
    M = kernel.mass_matrix(system.q)
    assert system.B[4:8] == pytest.approx(np.linalg.inv(M)[:, [0, 3]], rel=1e-9, abs=1e-9)
    assert not system.B[8:].any()
    assert not system.C[:, 4:].any()
    assert system.C[:, :4] == pytest.approx(kernel.frame_jacobian(system.q, "tcp"), abs=1e-12)
    rates = linearize(robot, q, v=v, u=system.u, kernel=kernel, kind="velocity") if moving else None
    assert rates is None or (rates.C[:, 4:8] == system.C[:, :4]).all()
    discrete = system.discretize(1e-3)
    assert pytest.approx(scipy.linalg.expm(1e-3 * system.A), rel=1e-9, abs=1e-12) == discrete.A
    assert discrete.states == names


def test_bent_bristles_at_rest_have_the_mean_of_both_directions(built: Build) -> None:
    robot = bristled_arm()
    kernel = built(robot)
    system = linearize(robot, POSE, kernel=kernel, z=BENT)
    sides = []
    for sign in (1.0, -1.0):
        v = sign * 1e-300 * np.ones(4)
        sides.append(linearize(robot, system.q, v=v, u=system.u, kernel=kernel, z=BENT).A)
    assert np.abs(sides[0] - sides[1]).max() > 0.1
    assert pytest.approx(0.5 * (sides[0] + sides[1]), rel=1e-9, abs=1e-6) == system.A
    assert (system.A[8:, 4:8] == [[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]]).all()
    assert not system.A[8:, 8:].any()
    assert any("kept at 3e-05, -2e-05" in note for note in system.notes)


@pytest.mark.parametrize("drives", ["free", "pd", "locked"])
def test_modes_are_eigenvalues_of_the_linear_system(drives: str, built: Build) -> None:
    """Bristles at rest are springs, and each has an eigenvalue of 0, by name; those of locked joints are left out."""
    robot = bristled_arm()
    kernel = built(robot)
    options = {"drives": drives, "kernel": kernel} | ({"kp": 1e3, "kd": 2.0} if drives == "pd" else {})
    found, system = modes(robot, POSE, **options), linearize(robot, POSE, **options)
    states = kernel.internal_states[1:] if drives == "locked" else kernel.internal_states
    assert found.zeros == found.internal_states == states
    assert system.states[-len(states) :] == states
    s = found.eigenvalues
    whole = np.concatenate([s, s[s.imag > 0.0].conj(), np.zeros(len(states))])
    expected = np.linalg.eigvals(system.A)
    assert whole.size == expected.size
    for value in expected:
        assert np.abs(whole - value).min() < 1e-5 * max(1.0, abs(value)) + 2e-3 * (abs(value) < 1e-2)
    for k, value in enumerate(s):
        moved = found.shapes[k][[kernel.coordinates.index(name.rpartition(".friction")[0]) for name in states]]
        assert found.states[k] == pytest.approx(moved), value  # they stick: z goes as the coordinate does
    text = "\n".join(found.lines())
    assert "j2.beta.friction.z" in text
    assert "eigenvalue of 0" in text
    assert found.as_dict()["zeros"] == list(states)
    assert found.as_rows() is not None


def test_presliding_holds_a_joint(built: Build) -> None:
    """A joint that nothing but bristles holds swings by sigma_0 and the mass matrix; a rigid robot has none of them."""
    robot = bristled_arm()
    kernel = built(robot)
    found = modes(robot, POSE, drives="free", kernel=kernel)
    system = linearize(robot, POSE, kernel=kernel)
    stiff = -kernel.mass_matrix(system.q) @ system.A[4:8, :4] + np.diag([1e4, 0.0, 2e3, 0.0])
    squares = scipy.linalg.eigh(0.5 * (stiff + stiff.T), kernel.mass_matrix(system.q), eigvals_only=True)
    assert np.sign(found.undamped) * found.undamped**2 == pytest.approx(squares / (2.0 * np.pi) ** 2, rel=1e-6)
    rigid = linearize(robot.rigid(), POSE)
    assert rigid.states == ("j1.gamma", "j2.gamma", "j1.gamma.rate", "j2.gamma.rate")


def test_responses_are_those_of_the_linear_system(built: Build) -> None:
    robot = bristled_arm()
    kernel = built(robot)
    hertz = np.array([0.0, 0.5, 5.0, 40.0])
    inputs = ("j1.gamma", "tcp.fz")
    options = {"drives": "pd", "kp": 1e3, "kd": 2.0, "kernel": kernel, "z": BENT}
    for kind in ("displacement", "velocity", "acceleration"):
        outputs = ("tcp.x", "j2.beta", *(kernel.internal_states if kind != "acceleration" else ()))
        found = response(robot, inputs, outputs, hertz, POSE, kind=kind, **options)
        system = linearize(robot, POSE, inputs=inputs, outputs=outputs, kind=kind, **options)
        assert found.H[1:] == pytest.approx(system.bode(frequencies=hertz[1:]).H, rel=1e-6, abs=1e-12)
        near = system.bode(frequencies=[1e-4]).H  # bristles hold as springs down to rest
        assert found.H[0] == pytest.approx(near[0], rel=1e-3, abs=1e-3 * max(1e-4, np.abs(near).max()))


@pytest.mark.parametrize("moving", [True, False])
def test_internal_states_are_outputs(moving: bool, built: Build) -> None:
    """A state as an output is itself, its rate as a velocity; a locked coordinate's does not change."""
    robot = bristled_arm()
    kernel = built(robot)
    motion = {"v": [0.2, 0.01, -0.05, 0.3], "u": [1.0, 0.0, 0.0, 2.0]} if moving else {}
    q = [0.3, 1e-5, -1e-4, 0.4]
    options = {
        "inputs": ["j1.gamma", "tcp.fx"],
        "outputs": kernel.internal_states,
        "kernel": kernel,
        "z": BENT,
        **motion,
    }
    itself, rate = (linearize(robot, q, kind=kind, **options) for kind in ("displacement", "velocity"))
    assert (np.eye(10)[8:] == itself.C).all()
    assert not itself.D.any()
    assert (itself.A[8:] == rate.C).all()
    assert (itself.B[8:] == rate.D).all()
    assert itself.output_units == kernel.internal_state_units == ("rad", "rad")
    assert itself.bode(outputs="j2.beta.friction.z").unit("j2.beta.friction.z", "tcp.fx") == "rad per N"
    with pytest.raises(InputError, match=r"kind: 'acceleration' of j1\.gamma\.friction\.z, an internal state; allowed"):
        linearize(robot, q, kind="acceleration", **options)
    with pytest.raises(UnknownNameError, match=r"output: 'j1\.friction\.z' .* an internal state \(j1\.gamma\.fric"):
        linearize(robot, q, **{**options, "outputs": ["j1.friction.z"]})
    if not moving:
        locked = linearize(robot, q, fixed=["j1.gamma"], drives="locked", **options | {"inputs": ["tcp.fx"]})
        assert not locked.C[0].any()


def test_rates_of_a_servo_drives_states_have_its_input(built: Build) -> None:
    robot = served_arm()
    kernel = built(robot)
    options = {"inputs": ["j2.gamma"], "outputs": kernel.internal_states, "kernel": kernel}
    rate = linearize(robot, POSE, kind="velocity", **options)
    assert rate.D.any()
    hertz = [0.5, 30.0]
    for kind in ("displacement", "velocity"):
        found = response(
            robot, options["inputs"], kernel.internal_states, hertz, POSE, kind=kind, kernel=kernel, drives="free"
        )
        system = linearize(robot, POSE, kind=kind, **options)
        assert pytest.approx(system.bode(frequencies=hertz).H, rel=1e-6, abs=1e-12) == found.H
        assert found.output_units == kernel.internal_state_units


def test_statics_leave_states_as_they_are(built: Build) -> None:
    """Forces of bent bristles deflect; the stiffness about the state is that of springs alone."""
    robot = bristled_arm()
    kernel = built(robot)
    plain, bent = (deflection(robot, POSE, kernel=kernel, z=z) for z in (None, BENT))
    force = 2e3 * BENT["j2.beta.friction.z"]
    beta = kernel.coordinates.index("j2.beta")
    assert bent.q[beta] - plain.q[beta] == pytest.approx(-force / 1e3, rel=1e-3)
    assert bent.u[0] - plain.u[0] == pytest.approx(1e4 * BENT["j1.gamma.friction.z"], rel=1e-3)
    assert bent.compliance == pytest.approx(plain.compliance, rel=1e-3, abs=1e-7)
    assert any("'j2.beta.friction.z': kept at 0;" in note for note in plain.notes)
    matrix = joint_stiffness_matrix(robot, "j2", POSE, kernel=kernel)
    assert matrix.matrix == pytest.approx(np.diag([1e5, 1e3]))
    grid = compliance_map(robot, [0.5, 0.1, 0.0], [0.1, 0, 0], [0, 0.1, 0], (2, 2), pose=POSE, kernel=kernel)
    assert grid.q.shape == (2, 2, 4)
    assert np.isfinite(grid.softest).all()


@pytest.mark.soak
def test_equilibria(built: Build) -> None:
    robot = bristled_arm()
    kernel = built(robot)
    z = np.array([*BENT.values()])
    q, u = static_equilibrium(kernel, [0.3, 0.0, 0.0, 0.4], fixed=["j1.gamma"], z=BENT)
    assert q.shape == u.shape == (4,)
    assert kernel.forward_dynamics(q, 0 * q, u, z) == pytest.approx(0 * q, abs=1e-9)
    assert not kernel.internal_state_derivatives(q, 0 * q, z, u).any()
    seen: list[tuple[int, ...]] = []

    def push(x: Array) -> Array:
        seen.append(x.shape)
        return 0.1 * np.ones_like(x)

    static_equilibrium(kernel, [0.3, 0.0, 0.0, 0.4], fixed=["j1.gamma"], u=push)
    assert {shape[-1] for shape in seen} == {4}
    linkage = built(bristle_linkage())
    bent = np.array([4e-4, -3e-4])
    closed = closed_equilibrium(linkage, linkage.home, z=bent, fixed=["joint1.gamma"])
    forces = linkage.inverse_dynamics(closed, np.zeros(3), np.zeros(3), z=bent)
    assert not forces[1:].any()
    free = closed_equilibrium(linkage, linkage.home, z=bent, u=lambda x: np.zeros_like(x))
    assert linkage.forward_dynamics(free, np.zeros(3), np.zeros(3), bent) == pytest.approx(np.zeros(3), abs=1e-7)
    geared = built(bristle_gear())
    q, u = static_equilibrium(geared, [0.3], z=[1e-4, 2e-4], fixed=["j1.gamma"])
    assert geared.forward_dynamics(q, [0.0], u, [1e-4, 2e-4]) == pytest.approx([0.0], abs=1e-9)


@pytest.mark.parametrize("closed", soaked([True, False], [True]))
def test_loops_and_followers_move_as_their_linear_system_says(closed: bool, built: Build) -> None:
    """A small push: the motion of the whole equations is that of A, also of bristles in followers."""
    robot = bristle_linkage() if closed else bristle_gear()
    kernel = built(robot)
    n = len(kernel.coordinates)
    options = {"kernel": kernel, "fixed": [kernel.coordinates[0]], "drives": "free"}
    system = linearize(robot, dict(zip(kernel.coordinates, kernel.home, strict=True)), **options)
    assert len(system.states) == 2 + len(kernel.internal_states)
    lead = kernel.coordinates.index(system.states[0])
    x0, duration = np.array([0.0, 1e-5, 0.0, 0.0]), 0.02
    v = np.zeros(n)
    v[lead] = 1e-5
    v = kernel.project_velocity(system.q, v, [system.states[0]]) if closed else v
    span = {"duration": duration, "samples": 4, "method": "tsit5", "rtol": 1e-9}
    motion = kernel.rollout(system.q, v, system.u, z=np.zeros(2), **span)
    for k, t in enumerate(np.linspace(0.0, duration, 5)):
        expected = scipy.linalg.expm(t * system.A) @ x0
        found = np.r_[motion[0][k][lead] - system.q[lead], motion[1][k][lead], motion.z[k]]
        assert found == pytest.approx(expected, rel=2e-3, abs=1e-3 * np.abs(expected[2:]).max() + 1e-12), t
    found = modes(robot, system.q, **options)
    assert found.zeros == kernel.internal_states
    about = linearize(robot, system.q, v=v, u=system.u, kernel=kernel, z=[1e-4, -1e-4])
    assert about.A.shape == (4, 4)
    assert about.A[2:, 2:].any()


def test_modes_along_a_path(built: Build) -> None:
    robot = bristled_arm()
    tracks = modes_along(robot, [POSE, {"j1": 0.35, "j2": 0.45}], kernel=built(robot), drives="pd", kp=1e3, kd=1.0)
    assert (tracks.tracks[1] == tracks.tracks[0]).all()


def test_results_are_kept(built: Build, tmp_path: object) -> None:
    robot = bristled_arm()
    system = linearize(robot, POSE, kernel=built(robot), z=BENT)
    system.save(tmp_path / "system.npz")
    again = eomgen.load_result(tmp_path / "system.npz")
    assert again.internal_states == system.internal_states
    assert (again.z == system.z).all()
    assert system.as_dict()["state"]["z"] == BENT
    assert any("internal states: j1.gamma.friction.z" in line for line in system.lines())


def test_what_cannot_be_is_refused(built: Build) -> None:
    robot = bristled_arm()
    kernel = built(robot)
    for call, kind, words in (
        (
            lambda: modes(robot, POSE, kernel=kernel, z={"j1.friction": 0.0}),
            UnknownNameError,
            r"z: 'j1\.friction' is unknown",
        ),
        (lambda: linearize(robot, POSE, kernel=kernel, z=[0.0]), ArrayError, r"z: expected float64 of shape \(2,\)"),
        (
            lambda: static_equilibrium(kernel, np.zeros(4), z=[0.0, np.nan]),
            ArrayError,
            r"z: j2\.beta\.friction\.z is nan",
        ),
        (lambda: modes(robot, POSE, kernel=kernel, fixed=[STATE]), UnknownNameError, f"fixed: '{STATE}' is unknown"),
        (
            lambda: static_equilibrium(kernel, np.zeros(4), fixed=[STATE]),
            UnknownNameError,
            f"fixed: '{STATE}' is unknown",
        ),
        (lambda: modes("one_link", z=[0.0]), InputError, "z: no force law of one_link has internal states"),
    ):
        with pytest.raises(kind, match=words):
            call()
    with pytest.warns(EomgenWarning, match="a robot is at rest whatever they are"):
        deflection(robot, POSE, kernel=kernel)


def test_fixation_keeps_states(built: Build) -> None:
    robot = bristled_arm()
    kernel = built(robot)
    fixation = fixation_of(robot, kernel, z=BENT)
    state = rest(kernel, np.array([0.3, 0.0, 0.0, 0.4]), fixation)
    assert state.q.shape == state.u.shape == (4,)
    by_q, by_v, _ = state.tangent.whole
    assert by_q.shape == (6, 4 + 2)
    assert not by_q[:, 4:].any()
    assert by_v[:4, 4:].any()


def test_branches_and_servo_drives(built: Build) -> None:
    """Branches and drives live in modes and responses as in A, however little energy their states store."""
    robot = served_arm()
    kernel = built(robot)
    system = linearize(robot, POSE, kernel=kernel)
    assert len(system.states) == 8 + len(kernel.internal_states)
    found = modes(robot, POSE, drives="free", kernel=kernel)
    s = found.eigenvalues
    whole = np.concatenate([s, s[s.imag > 0.0].conj(), np.zeros(len(found.zeros))])
    expected = np.linalg.eigvals(system.A)
    assert whole.size <= expected.size
    for value in expected:
        assert np.abs(whole - value).min() < 1e-5 * max(10.0, abs(value)), value
    for value in s:
        assert np.abs(expected - value).min() < 1e-5 * max(10.0, abs(value)), value
    assert set(found.zeros) == {"j1.gamma.friction.z", "j2.beta.friction.z"}
    hertz, inputs, outputs = [0.0, 0.7, 8.0, 90.0], ["j2.gamma", "tcp.fy"], ["j2.gamma", "tcp.x"]
    H = response(robot, inputs, outputs, hertz, POSE, drives="free", fixed=["j1.gamma"], kernel=kernel).H
    about = linearize(robot, POSE, inputs=inputs, outputs=outputs, fixed=["j1.gamma"], kernel=kernel)
    assert H[1:] == pytest.approx(about.bode(frequencies=hertz[1:]).H, rel=1e-6, abs=1e-12)
    assert H[0, 0, 0] == pytest.approx(1.0, abs=1e-6)  # the integral leaves no error of the reference
    fixed = linearize(robot, POSE, drives="locked", kernel=kernel)
    assert fixed.states[4:] == ("j2.x.maxwell.0.z", "j2.x.maxwell.1.z", "j2.beta.friction.z")
    notes = " ".join(modes(robot, POSE, kernel=kernel).notes)
    assert "'j2.beta.friction.z': kept at 0" in notes
    assert "maxwell" not in notes


def test_branches_have_their_complex_stiffness(built: Build) -> None:
    """1 / (k + i w (c + c_i k_i / (k_i + i w c_i)) - m w^2) of a mass on a spring with branches."""
    text = f"""
name = "branched"
gravity = [0.0, 0.0, 0.0]
{link_table("body", 2.0, inertia=(0.1, 0.1, 0.1))}
{joint_table("j", "base", "body", "fixed")}
x = {{ stiffness = 1e4, damping = 3.0, maxwell = [{{ stiffness = 4e3, damping = 50.0 }}, \
{{ stiffness = 2e3, damping = 5.0 }}] }}
"""
    robot = robot_from_toml(text)
    hertz = np.geomspace(0.1, 1e3, 30)
    w = 2.0 * np.pi * hertz
    stiffness = 1e4 + 3j * w - 2.0 * w**2
    stiffness = stiffness + sum(1j * w * c * k / (k + 1j * w * c) for k, c in ((4e3, 50.0), (2e3, 5.0)))
    found = response(robot, ["body.fx"], ["j.x"], hertz)
    assert found.H[:, 0, 0] == pytest.approx(1.0 / stiffness, rel=1e-10)
    assert response(robot, ["body.fx"], ["j.x"], [0.0]).H[0, 0, 0] == pytest.approx(1e-4, rel=1e-12)
    with pytest.raises(InputError, match=r"z: j\.x\.maxwell\.1\.z = 0\.1, which settles to 0 at rest"):
        modes(robot, z={"j.x.maxwell.1.z": 0.1})
    first, second = np.poly1d([1.0, 80.0]), np.poly1d([1.0, 400.0])
    roots = (np.poly1d([2.0, 3.0, 1e4]) * first * second + np.poly1d([4e3, 0]) * second + np.poly1d([2e3, 0]) * first).r
    expected = sorted((s for s in roots if s.imag >= 0.0), key=abs)
    assert sorted(modes(robot).eigenvalues, key=abs) == pytest.approx(expected, rel=1e-9)


def test_bristles_of_couplings_and_loop_joints(built: Build) -> None:
    """Their states are in A as differences of the equations have it, also bent, and between equal rates."""
    friction = 'friction = { model = "lugre", coulomb = 0.3, bristle_stiffness = 300.0, bristle_damping = 0.5 }'
    head, gear = GEARED.replace(f"gamma = {{ {FRICTION} }}", "").split('to = { "j1.gamma" = -2.0 }')
    robot = robot_from_toml(f'{head}to = {{ "j1.gamma" = 1.0 }}\nstiffness = 500.0\ndamping = 0.1\n{friction}{gear}')
    kernel = built(robot)
    assert kernel.internal_states == ("gear.friction.z",)
    for z in (0.0, 4e-4):
        system = linearize(robot, kernel=kernel, z=[z], fixed=["j1.gamma"])
        assert system.states[4:] == kernel.internal_states
        assert system.A[4] == pytest.approx([0.0, 0.0, -1.0, 1.0, 0.0], abs=1e-12)
        x = np.concatenate([system.q, np.zeros(2), [z]])
        expected = by_differences(kernel, x, system.u)[:4]
        assert (np.abs(system.A[:4] - expected) <= 1e-4 * np.abs(expected).max(axis=1, keepdims=True)).all()
        moved = np.concatenate([system.q, [0.1, -0.2], [z]])
        about = linearize(robot, system.q, v=[0.1, -0.2], u=system.u, kernel=kernel, z=[z])
        expected = by_differences(kernel, moved, system.u)
        assert (np.abs(about.A - expected) <= 1e-4 * np.abs(expected).max(axis=1, keepdims=True)).all()
    assert modes(robot, kernel=kernel, drives="free", fixed=["j1.gamma"]).zeros == kernel.internal_states


def test_bristles_of_a_transmission_move_beside_a_locked_motor(built: Build) -> None:
    """With its motor locked a joint winds its transmission up, whose hysteresis is a state of the system."""
    motor = (
        "[joints.motor]\ninertia = 1e-4\nratio = 50.0\nstiffness = 1e4\ndamping = 5.0\n"
        'hysteresis = { model = "bouc_wen", stiffness = 2e3, beta = 50.0, gamma = 20.0, n = 1.0, share = 0.5 }\n'
    )
    head, rest_of_it = ARM.split("bristle_damping = 30.0, viscous = 0.5, fade = 0.05 } }\n")
    robot = robot_from_toml(f"{head}bristle_damping = 30.0, viscous = 0.5, fade = 0.05 }} }}\n{motor}{rest_of_it}")
    system = linearize(robot, drives="locked", kernel=built(robot))
    assert "j1.motor.hysteresis.z" in system.states
    assert "j1.gamma.friction.z" in system.states
