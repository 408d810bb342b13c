"""Closed mechanisms: null spaces, differences on the closed states, another cut of the same, singular poses."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen.analysis import compliance_map, deflection, linearize, modes, modes_along, response
from eomgen.analysis.options import KERNELS
from eomgen.description.load import robot_from_toml
from eomgen.errors import EomgenWarning, InputError, LoopError
from eomgen.pipeline.mechanisms import mechanism_kernels
from eomgen.robot.value import Robot
from tests.loops.test_elastic_cuts import linkages
from tests.support.builds import Build
from tests.support.commands import command
from tests.support.random_robots import Array
from tests.support.soak import soaked

pytestmark = pytest.mark.usefixtures("unoptimised")

SIX = """
x = { stiffness = 1e4, damping = 3.0, cubic = 1e6 }
y = { stiffness = 1.5e4, damping = 1.0 }
z = { stiffness = 2e4, damping = 2.0 }
alpha = { stiffness = 1e3, damping = 0.1 }
beta = { stiffness = 2e3, damping = 0.2 }
gamma = { stiffness = 5.0, damping = 0.01, preload = 0.2 }
"""
HOLD = 2e4  # N/m


def kernels(robot: eomgen.Robot) -> tuple[str, ...]:
    """Names of the kernels of analyses, and the mass matrix and forward dynamics that they are compared with."""
    return (*KERNELS, *mechanism_kernels(robot), "mass_matrix", "forward_dynamics")


def slopes_of(function: Callable[[Array], Array], x: Array, h: float = 1e-5) -> Array:
    """Derivatives by central differences."""
    return np.array([(function(x + h * e) - function(x - h * e)) / (2 * h) for e in np.eye(len(x))]).T


def null_space(J: Array) -> Array:
    """Orthonormal columns, by singular values."""
    _, S, Vt = np.linalg.svd(J)
    return Vt[int((1e-9 * S[0] < S).sum()) :].T


@pytest.mark.soak
def test_drives_that_hold_a_mechanism_leave_no_mode() -> None:
    """An empty table with a note, and nothing is wrong; so of a robot without loops whose joints are all rigid."""
    for name in ("four_bar", "ur5"):
        with pytest.warns(EomgenWarning, match="nothing can move"):
            found = modes(name)
        assert found.shapes.shape == (0, len(found.coordinates))
        assert any("nothing can move" in line for line in found.lines())
        assert "0 modes" in command("modes", name)
    with pytest.warns(EomgenWarning, match="nothing can move"):
        path = modes_along("four_bar", [{"joint1": 1.0}, {"joint1": 1.3}])
    assert path.values("frequencies").shape == (2, 0)
    assert path.modes[1].q[0] == pytest.approx(1.3)
    with pytest.warns(EomgenWarning, match="nothing can move"):
        still = response("four_bar", ["tcp.fx"], ["tcp.x"], [1.0])
    assert not still.H.any()
    rigid = deflection("four_bar")
    assert rigid.rank == 0
    assert not rigid.deflection.any()


@pytest.mark.soak
def test_platform_on_legs_that_yield(built: Build) -> None:
    """Eigenvalues of what NumPy makes of null spaces and of differences of forces on the closed states."""
    robot = eomgen.load_robot("gough")
    kernel = built(robot, *kernels(robot))
    drives = [i for i, name in enumerate(kernel.coordinates) if name.startswith("leg")]
    loads = {"platform": [20.0, -10.0, 30.0, 4.0, 5.0, 6.0]}
    found = modes(robot, drives="pd", kp=HOLD, kd=3.0, kernel=kernel, loads=loads)
    names = [kernel.coordinates[i] for i in drives]
    home = np.array([robot.home.get(name, 0.0) for name in kernel.coordinates])
    assert [found.q[i] for i in drives] == pytest.approx([home[i] for i in drives], abs=1e-9)
    rest = found.q
    held = _drives(kernel, rest, drives, loads)

    def lacking(place: Array) -> Array:
        """What the legs' springs do not hold, as the leg coordinates feel it."""
        q = rest.copy()
        q[drives] += place
        q = kernel.assemble(q, fixed=names)
        zero = np.zeros(kernel.n)
        force = kernel.residual(q, zero, zero, zero)
        force -= kernel.frame_jacobian(q, "platform").T @ np.array(loads["platform"])
        force[drives] += HOLD * (q[drives] - rest[drives]) - held
        return _ways(kernel, q, drives).T @ force

    assert np.abs(lacking(np.zeros(6))).max() < 1e-7
    K = slopes_of(lacking, np.zeros(6), 1e-4)
    ways = _ways(kernel, rest, drives)
    M = ways.T @ kernel.mass_matrix(rest) @ ways
    D = 3.0 * np.eye(6)
    A = np.block([[np.zeros((6, 6)), np.eye(6)], [-np.linalg.solve(M, K), -np.linalg.solve(M, D)]])
    expected = np.linalg.eigvals(A)
    expected = np.sort_complex(expected[expected.imag > 0.0])
    assert np.sort_complex(found.eigenvalues) == pytest.approx(expected, rel=1e-6)


def _ways(kernel: eomgen.Kernel, q: Array, drives: list[int]) -> Array:
    ways = null_space(kernel.functions.constraint_jacobian(q))
    return np.asarray(ways @ np.linalg.inv(ways[drives]))


def _drives(kernel: eomgen.Kernel, q: Array, drives: list[int], loads: dict[str, list[float]]) -> Array:
    zero = np.zeros(kernel.n)
    force = kernel.residual(q, zero, zero, zero)
    for frame, wrench in loads.items():
        force -= kernel.frame_jacobian(q, frame).T @ np.array(wrench)
    return np.asarray(_ways(kernel, q, drives).T @ force)


@pytest.mark.soak
def test_elastic_joints_that_are_cut_or_not(built: Build) -> None:
    """Modes, deflection and stiffness of one linkage, its elastic joint in the tree or between both ends of a loop."""
    results = []
    for robot in linkages(SIX):
        kernel = built(robot, *kernels(robot))
        pose = {"motor.gamma": 1.0, "pin.gamma": -0.5}
        pose |= {"pivot.gamma": 1.44} if "pivot.gamma" in kernel.coordinates else {"hinge.gamma": 1.94}
        loads = {"coupler": [3.0, -20.0, 1.0, 0.1, 0.2, 0.3]}
        options = {"frame": "coupler", "kernel": kernel, "loads": loads}
        results.append((modes(robot, pose, **options), deflection(robot, pose, **options)))
    (mine, bent), (other, bowed) = results
    assert len(mine.eigenvalues) == len(other.eigenvalues) == 2
    assert np.sort_complex(mine.eigenvalues) == pytest.approx(np.sort_complex(other.eigenvalues), rel=1e-6)
    assert np.abs(mine.frame_shapes) == pytest.approx(np.abs(other.frame_shapes), rel=1e-4, abs=1e-6)
    assert bent.pose == pytest.approx(bowed.pose, abs=1e-8)
    assert bent.compliance == pytest.approx(bowed.compliance, rel=1e-6, abs=1e-12)


@pytest.mark.parametrize("name", soaked(["four_bar", "bennett", "elastic"], ["elastic"]))
def test_about_a_motion_the_closed_accelerations_are_differenced(name: str, built: Build) -> None:
    """A, B and C about a motion: differences of forward dynamics and frames over the independent coordinates."""
    robot = linkages(SIX)[1] if name == "elastic" else eomgen.load_robot(name)
    kernel, rng = built(robot, *kernels(robot)), np.random.default_rng(5)
    link = robot.links[1].name
    home = np.array([robot.home.get(x, 0.0) for x in kernel.coordinates])
    if name == "elastic":
        home = kernel.assemble([1.0, -0.5, *[0.0] * 5, 1.94], fixed=["motor.gamma"])
        home[2:] += 1e-4
    q = kernel.assemble(home)
    v = kernel.project_velocity(q, rng.uniform(-1.0, 1.0, kernel.n))
    u = rng.uniform(-2.0, 2.0, kernel.n)
    outputs = [f"{link}.{part}" for part in ("x", "y", "rz")] + [kernel.coordinates[-1]]
    inputs = [kernel.coordinates[0]]
    about = {"v": v, "kernel": kernel, "outputs": outputs, "kind": "velocity"}
    found = linearize(robot, q, u=u, fixed=[], inputs=inputs, drives="free", **about)
    m = len(found.states) // 2
    names = list(found.states[:m])
    index = [kernel.coordinates.index(x) for x in names]
    start = np.concatenate([found.q[index], v[index]])

    def state(y: Array) -> tuple[Array, Array]:
        place, rates = found.q.copy(), v.copy()
        place[index], rates[index] = y[:m], y[m:]
        place = kernel.assemble(place, fixed=names)
        return place, kernel.project_velocity(place, rates, fixed=names)

    def slopes(y: Array, force: Array = u) -> Array:
        place, rates = state(y)
        a = kernel.forward_dynamics(place, rates, force)
        return np.concatenate([y[m:], a[index]])

    def seen(y: Array) -> Array:
        place, rates = state(y)
        J = kernel.frame_jacobian(place, link)
        return np.concatenate([(J @ rates)[[0, 1, 5]], rates[-1:]])

    A, C = (slopes_of(f, start) for f in (slopes, seen))
    one = np.eye(kernel.n)[kernel.coordinates.index(inputs[0])]
    assert found.a == pytest.approx(kernel.forward_dynamics(q, v, u), abs=1e-8)
    assert pytest.approx(A, rel=1e-5, abs=1e-5 * np.abs(A).max()) == found.A
    assert pytest.approx(C, rel=1e-5, abs=1e-6) == found.C
    assert found.B[:, 0] == pytest.approx(slopes(start, u + one) - slopes(start), abs=1e-7)
    if name == "elastic":
        return
    again = linearize(robot, q, a=found.a, **about)
    driven = [x in ("joint1.gamma",) for x in kernel.coordinates]
    assert again.u[np.logical_not(driven)] == pytest.approx(0.0)
    assert kernel.forward_dynamics(q, v, again.u) == pytest.approx(found.a, abs=1e-7)
    alike = linearize(robot, q, u=again.u, **about)
    assert pytest.approx(alike.A, rel=1e-7, abs=1e-7) == again.A


@pytest.mark.soak
def test_compliance_over_a_plane(built: Build) -> None:
    """Where the platform can be the map has what a deflection at that pose has; elsewhere nothing."""
    robot = eomgen.load_robot("gough")
    kernel = built(robot, *kernels(robot))
    corner, first, second = [0.0, 0.0, 1.05], [0.02, 0.0, 0.0], [0.0, 5.0, 0.0]
    options: dict[str, Any] = {"frame": "platform", "drives": "pd", "kp": 1e6, "kernel": kernel}
    found = compliance_map(robot, corner, first, second, (2, 2), **options)
    assert np.isfinite(found.softest).tolist() == [[True, False], [True, False]]
    sagged = found.points[1, 0] + found.deflection[1, 0, :3]
    assert kernel.frame_pose(found.q[1, 0], "platform")[:3, 3] == pytest.approx(sagged, abs=1e-9)
    pose = dict(zip(kernel.coordinates, found.q[1, 0].tolist(), strict=True))
    again = deflection(robot, pose, **options)  # about a pose that is off by the sag, micrometres
    assert again.compliance == pytest.approx(found.compliance[1, 0], rel=1e-3, abs=1e-9)


def test_input_that_is_refused() -> None:
    robot = eomgen.load_robot("four_bar")
    zero = np.zeros(3)
    undriven = replace(robot, driven=())
    opens = r"loop joint4 opens at v: joint4\.[xy] is left with \S+ m/s; allowed"
    for call, words in (
        (lambda: linearize(robot, v=[1.0, 0.0, 0.0], a=zero), opens),
        (lambda: linearize(robot, v=zero, a=[1.0, 0.0, 0.0]), r"loop joint4 opens at a: .*m/s\^2; allowed: th"),
        (lambda: linearize(undriven, v=zero, a=zero), "drives at no coordinate cannot make this motion"),
        (lambda: modes(robot, fixed=["joint1.gamma", "joint2.gamma"], pose=[1.0, 0.0, 0.0]), "loop joint4"),
    ):
        with pytest.raises(LoopError, match=words):
            call()


def test_what_only_couplings_lead_is_not_loose() -> None:
    """Two arms, the second behind the first by a rigid or an elastic gear: none of them is held by constant forces."""
    text = 'name = "pair"\ndriven = ["first.gamma"]\n'
    for name in ("first", "second"):
        text += f'[[links]]\nname = "{name}_arm"\nmass = 2.0\ncom = [0.3, 0.0, 0.0]\n'
        text += "inertia = { xx = 0.01, yy = 0.02, zz = 0.02 }\n"
        text += f'[[joints]]\nname = "{name}"\nparent = "base"\nchild = "{name}_arm"\ntype = "revolute"\n'
    gear = '[[couplings]]\nname = "gear"\nof = "second.gamma"\nto = { "first.gamma" = -2.0 }\n'
    elastic = robot_from_toml(text + gear + "stiffness = 400.0\n")
    found = modes(elastic, {"first": 0.3})
    assert found.notes == ()
    inertia = 0.02 + 2.0 * 0.3**2
    assert found.frequencies == pytest.approx([np.sqrt(400.0 / inertia) / (2 * np.pi)], rel=1e-9)
    assert found.q == pytest.approx([0.3, -0.6], abs=1e-9)
    rigid = modes(robot_from_toml(text + gear), {"first": 0.3}, drives="pd", kp=50.0)
    assert rigid.frequencies == pytest.approx([np.sqrt(50.0 / (inertia * 5.0)) / (2 * np.pi)], rel=1e-9)
    assert rigid.q == pytest.approx([0.3], abs=1e-9)


STIFF = """
x = { stiffness = 3e9, damping = 3e3, clearance = 1e-5 }
y = { stiffness = 3e9, damping = 1e3 }
z = { stiffness = 3e9, damping = 2e3 }
alpha = { stiffness = 1e8, damping = 100.0 }
beta = { stiffness = 2e8, damping = 200.0 }
gamma = { damping = 0.01 }
"""


@pytest.mark.soak
def test_stiff_cuts_with_play_come_to_rest(built: Build) -> None:
    """A stiff cut joint falls to the end of its play, or floats where nothing pulls; so does it in the tree.

    Round-off of the angles moves it more than what its springs' own size allows for.
    """
    here, there = linkages(STIFF)
    mine = built(here, *kernels(here), "cut_forces", "cut_jacobian")
    other = built(there, *kernels(there))
    names = other.coordinates
    deviations = [name for name in names if "hinge" in name and name != "hinge.gamma"]
    q = other.assemble([1.0, -0.5, *[0.0] * 5, 1.94], deviations)
    angles = dict(zip(names, q.tolist(), strict=True))
    poses = angles, {"motor.gamma": q[0], "pin.gamma": q[1], "pivot.gamma": angles["hinge.gamma"] + q[0] + q[1]}
    found, soft = [], []
    for robot, kernel, pose, name in ((here, mine, poses[1], "cut.x"), (there, other, poses[0], "hinge.x")):
        found.append(modes(robot, pose, kernel=kernel))
        assert not found[-1].notes
        kernel.parameters["gravity.y"] = 0.0
        with pytest.warns(EomgenWarning, match=f"{name} floats in its clearance"):
            soft.append(deflection(robot, pose, kernel=kernel, frame="coupler"))
    first, second = (np.sort_complex(entry.eigenvalues) for entry in found)
    assert len(first) == 2
    assert first == pytest.approx(second, rel=1e-5)
    assert soft[0].compliance == pytest.approx(soft[1].compliance, rel=1e-4, abs=1e-14)


@pytest.mark.soak
def test_a_hexapod_with_elastic_joints_has_modes() -> None:
    """The built-in one, at default settings: its platform rests on the end of a ball joint's play."""
    text = command("modes", "hexapod_elastic")
    assert "hexapod_elastic: 72 modes" in text
    assert "floats" not in text
    said = command("modes", "hexapod_elastic", "--set", "gravity.z=0")
    assert "note: ball1.z floats in its clearance: no stiffness there" in said


# Singular poses


def parallelogram() -> Robot:
    """Cranks of 0.5 m a metre apart and a coupler of 1 m, all on one line at q = 0; springs about there."""
    text = 'name = "parallelogram"\ngravity = [0.0, 0.0, 0.0]\n'
    for name, length in (("left", 0.5), ("coupler", 1.0), ("right", 0.5)):
        inertia = "{ xx = 0.001, yy = 0.02, zz = 0.02 }"
        text += f'[[links]]\nname = "{name}"\nmass = 1.0\ncom = [{length / 2}, 0.0, 0.0]\ninertia = {inertia}\n'
    for parent, child, x in (("base", "left", 0.0), ("left", "coupler", 0.5), ("base", "right", 1.0)):
        text += f'[[joints]]\nname = "{child}_pin"\nparent = "{parent}"\nchild = "{child}"\ntype = "revolute"\n'
        text += f"placement = {{ xyz = [{x}, 0.0, 0.0] }}\ngamma = {{ stiffness = 50.0 }}\n"
    return robot_from_toml(
        text + '[[loops]]\nname = "closing"\nlinks = ["coupler", "right"]\ntype = "revolute"\n'
        "placements = [{ xyz = [1.0, 0.0, 0.0] }, { xyz = [0.5, 0.0, 0.0] }]\n"
    )


@pytest.mark.parametrize("analysis", [modes, deflection])
def test_a_flat_parallelogram_is_refused(analysis: object) -> None:
    """It may go on as a parallelogram or as its opposite: two motions to first order, of which neither is a sum."""
    robot = parallelogram()
    free = {"fixed": [], **({"drives": "free"} if analysis is modes else {"drives": "pd", "kp": 10.0})}
    with pytest.raises(InputError, match=r"loop closing is singular: the rank of the constraints drops to 1, .* the 2"):
        analysis(robot, np.zeros(3), **free)


def test_the_same_loop_beside_it_has_one_mode() -> None:
    """Flat loops are redundant in every pose, three of five constraints here: no reason to refuse."""
    robot, rests = parallelogram(), (0.6, -0.6, 0.6)
    tables = (
        {"gamma": replace(x.coordinates["gamma"], preload=-50.0 * q)} for x, q in zip(robot.joints, rests, strict=True)
    )
    leaning = (replace(x, coordinates=table) for x, table in zip(robot.joints, tables, strict=True))
    found = modes(replace(robot, joints=tuple(leaning)), rests, fixed=[], drives="free")
    assert len(found.eigenvalues) == 1
    assert abs(found.eigenvalues[0]) > 1.0
