"""Screws: closed forms, SymPy's Lagrangian, Pinocchio's helical joints, cylindrical pairs, and what is refused."""

from __future__ import annotations

import pickle
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sympy as sp

import eomgen
from eomgen.codegen.closed_form.trace import closed_form
from eomgen.description.load import robot_from_toml
from eomgen.description.recorded import robot_from_record
from eomgen.errors import DescriptionError, EomgenWarning, InputError
from eomgen.export.fmu.variables import parameter_unit
from eomgen.export.live.geometry import geometry_of
from eomgen.names import NAME_LENGTH
from eomgen.robot import record_of, robot_hash
from eomgen.robot.elements.joint_stiffness import JointStiffness
from eomgen.robot.model import build_model
from eomgen.robot.value import Coordinate, Coupling, Joint, Link, Loop, Motor, Placement, Robot
from tests.oracles.pinocchio_models import PinocchioOracle
from tests.support.builds import Build
from tests.support.optional import needs
from tests.support.random_robots import Array, random_link, random_robot, seeds, with_offsets
from tests.support.refusals import refused

pytestmark = pytest.mark.quick

MASS, TURNING, PITCH = 1.5, 3e-3, 0.05  # kg, kg m^2, m
DYNAMICS = ("inverse_dynamics", "mass_matrix", "forward_dynamics", "bias_force", "reactions", "kinematics", "energy")
NUT = f"""
name = "nut"
tunable = ["joints.spindle.pitch"]

[[links]]
name = "nut"
mass = {MASS}
com = [0.0, 0.0, 0.0]
inertia = {{ xx = 2e-3, yy = 2e-3, zz = {TURNING} }}

[[joints]]
name = "spindle"
parent = "base"
child = "nut"
type = "screw"
pitch = {PITCH}
"""
CLOSE = 1e-11


def near(found: Any, expected: Any, tolerance: float = CLOSE) -> None:
    size = max(1.0, float(np.abs(expected).max(initial=0.0)))
    assert np.shape(found) == np.shape(expected)
    assert np.abs(np.asarray(found) - expected).max(initial=0.0) <= tolerance * size


def screws(seed: int, *, rigid: bool = True) -> Robot:
    """A random tree in which a share of the joints, and at least one, are screws."""
    rng = np.random.default_rng([seed, 65])
    counts = () if rigid else (1, 3, 1)
    choices: dict[str, Any] = {"rigid": True} if rigid else {"counts": counts, "types": ("revolute",)}
    robot = random_robot(seed, joints=(3, 5), tree=bool(seed % 2), rods=False, name=f"screws{seed}", **choices)
    moving = [joint.name for joint in robot.joints if joint.principal]
    chosen = {x for x in moving if rng.random() < 0.5} | {moving[0] if moving else robot.joints[0].name}
    joints = []
    for joint in robot.joints:
        if joint.name in chosen:
            kept = {name: x for name, x in joint.coordinates.items() if name not in ("z", "gamma")}
            own = next(iter(joint.coordinates.values()))
            pitch = float(rng.choice([-1.0, 1.0]) * rng.uniform(0.05, 2.0))
            joint = replace(joint, type="screw", pitch=pitch, coordinates={**kept, "gamma": own, "z": Coordinate()})
        joints.append(joint)
    tunable = tuple(f"joints.{joint.name}.pitch" for joint in joints if joint.pitch is not None)
    return replace(robot, joints=tuple(joints), tunable=tunable)


def states(kernel: eomgen.Kernel, count: int = 5, seed: int = 1) -> tuple[Array, Array, Array, Array]:
    q, v, a, u = np.random.default_rng(seed).uniform(-1.5, 1.5, (4, count, kernel.n))
    return q, v, a, u


def by_pitch(kernel: eomgen.Kernel, name: str, function: str, args: tuple[Array, ...]) -> Array:
    """Central difference of order four by a pitch."""
    value, step = kernel.parameters[name], 1e-3
    at = [getattr(kernel.replaced(parameters={name: value + k * step}), function)(*args) for k in (-2, -1, 1, 2)]
    return np.asarray((at[0] - 8 * at[1] + 8 * at[2] - at[3]) / (12 * step))


@pytest.mark.parametrize("pitch", [PITCH, -PITCH, 3.0, -1e-4])
def test_a_nut_falls_along_its_spindle_as_in_closed_form(pitch: float, built: Build) -> None:
    """gamma'' = -m g h / (J + m h^2), h the lead per radian; the energy of its motion is constant."""
    kernel = built(robot_from_toml(NUT), "forward_dynamics", "energy", "rollout", "kinematics")
    kernel = kernel.replaced(parameters={"joints.spindle.pitch": pitch})
    assert (kernel.coordinates, kernel.follower_names) == (("spindle.gamma",), ("spindle.z",))
    h = pitch / (2 * np.pi)
    expected = -MASS * 9.81 * h / (TURNING + MASS * h * h)
    near(kernel.forward_dynamics([0.7], [-3.0], [0.0]), np.array([expected]))
    near(kernel.followers([0.7], [2.0])["spindle.z"], (0.7 * h, 2.0 * h), 1e-15)
    near(kernel.frame_pose([0.7], "nut")[2, 3], 0.7 * h, 1e-15)
    q, v = kernel.rollout([0.1], [1.0], [0.0], 1e-3, 500)
    near(q[-1], np.array([0.1 + 0.5 + expected / 8]), 1e-9)
    total = kernel.energy(q, v).sum(axis=1)
    near(total, np.full(len(total), total[0]), 1e-9)


def test_an_arm_with_a_screw_has_the_equations_of_sympys_lagrangian(built: Build) -> None:
    robot = arm()
    kernel = built(robot, "inverse_dynamics", "mass_matrix", "energy")
    q, v, a = sp.symbols("q:3"), sp.symbols("v:3"), sp.symbols("a:3")
    h, kinetic, potential, A = PITCH / (2 * sp.pi), sp.Integer(0), sp.Integer(0), sp.eye(4)
    for joint, link, qi in zip(robot.joints, robot.links, q, strict=True):
        turn, shift = sp.eye(4), sp.eye(4)
        turn[:3, :3] = sp.rot_axis3(-qi) if joint.type != "prismatic" else sp.eye(3)
        shift[2, 3] = {"revolute": 0, "screw": h * qi, "prismatic": qi}[joint.type]
        placed = sp.eye(4)
        placed[:3, :3], placed[:3, 3] = sp.Matrix(joint.placement.rotation), sp.Matrix(joint.placement.xyz)
        A = A * placed * turn * shift
        rate = sum((A.diff(x) * y for x, y in zip(q, v, strict=True)), sp.zeros(4))
        xx, yy, zz, *_ = link.inertia
        about = sp.diag(yy + zz - xx, xx + zz - yy, xx + yy - zz) / 2
        c = sp.Matrix(link.com)
        H = sp.zeros(4)
        H[:3, :3], H[:3, 3], H[3, :3], H[3, 3] = about + link.mass * c * c.T, link.mass * c, link.mass * c.T, link.mass
        kinetic += (rate * H * rate.T).trace() / 2
        potential += 9.81 * link.mass * (A * c.col_join(sp.Matrix([1])))[2]
    momenta = [kinetic.diff(x) for x in v]
    rows = [
        sum(p.diff(x) * y + p.diff(y) * z for x, y, z in zip(q, v, a, strict=True)) - (kinetic - potential).diff(qi)
        for p, qi in zip(momenta, q, strict=True)
    ]
    residual = sp.lambdify((*q, *v, *a), rows)
    energies = sp.lambdify((*q, *v), [kinetic, potential])
    for state in zip(*states(kernel)[:3], strict=True):
        near(kernel.inverse_dynamics(*state), np.array(residual(*np.concatenate(state)), float))
        near(kernel.energy(*state[:2]), np.array(energies(*np.concatenate(state[:2])), float))


def test_the_closed_form_is_that_of_the_tree_with_a_constraint(built: Build) -> None:
    form, kernel = closed_form(build_model(arm())), built(arm(), "inverse_dynamics")
    S = np.array([[1.0, 0.0, 0.0], [0.0, PITCH / (2 * np.pi), 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    residual = form.function("residual")
    for q, v, a, u in zip(*states(kernel), strict=True):
        near(kernel.inverse_dynamics(q, v, a), S.T @ residual(S @ q, S @ v, S @ a, 0 * (S @ u)))


def arm() -> Robot:
    """A turning base, a screw across its axis, and a slide."""
    placements = (
        Placement((0.1, 0.0, 0.2)),
        Placement((0.3, 0.1, 0.0), ((1.0, 0.0, 0.0), (0.0, 0.0, -1.0), (0.0, 1.0, 0.0))),
        Placement((0.0, 0.2, 0.1), ((0.0, 0.0, 1.0), (0.0, 1.0, 0.0), (-1.0, 0.0, 0.0))),
    )
    types = (("revolute", ("gamma",), None), ("screw", ("z", "gamma"), PITCH), ("prismatic", ("z",), None))
    links = tuple(Link(f"l{i}", 1.0 + i, (0.1, 0.05 * i, 0.2), (0.1, 0.12, 0.09, 0.0, 0.0, 0.0)) for i in range(3))
    parents = ("base", "l0", "l1")
    joints = tuple(
        Joint(f"j{i}", parents[i], f"l{i}", kind, placements[i], coordinates=dict.fromkeys(own, Coordinate()), pitch=p)
        for i, (kind, own, p) in enumerate(types)
    )
    return Robot("screw_arm", (0.0, 0.0, -9.81), links, joints, tunable=("joints.j1.pitch",))


@pytest.mark.parametrize("seed", seeds(0, 2, 60))
def test_random_robots_have_the_kernels_of_pinocchios_helical_joints(seed: int, built: Build) -> None:
    needs("pinocchio")
    robot = screws(seed)
    if seed % 3 == 1:
        robot = with_offsets(robot, seed)
        upright = (replace(x, offset=(*x.offset[:3], None, None, x.offset[5])) for x in robot.joints)
        robot = replace(robot, joints=tuple(upright))  # a helical joint moves along the axis about which it turns
    kernel, oracle = built(robot, *DYNAMICS, "external_force"), PinocchioOracle(robot)
    rng = np.random.default_rng(seed)
    for q, v, a, u in zip(*states(kernel, seed=seed), strict=True):
        near(kernel.mass_matrix(q), oracle.mass_matrix(q))
        near(kernel.inverse_dynamics(q, v, a), oracle.inverse_dynamics(q, v, a))
        near(kernel.bias_force(q, v), oracle.bias_force(q, v))
        limit = 1e3 * np.linalg.cond(oracle.mass_matrix(q)) * np.finfo(float).eps
        near(kernel.forward_dynamics(q, v, u), oracle.forward_dynamics(q, v, u), max(limit, CLOSE))
        near(kernel.energy(q, v), oracle.energy(q, v))
        if seed % 3 != 1:  # else in axes before the last offset
            near(kernel.reactions(q, v, a), oracle.reactions(q, v, a))
        near(kernel.frame_pose(q, "tcp"), oracle.frame_pose(q, "tcp"))
        near(kernel.frame_jacobian(q, "tcp"), oracle.frame_jacobian(q, "tcp"))
        wrench = rng.normal(size=(len(kernel.links), 6))
        near(kernel.functions.external_force(q, wrench), oracle.external_force(q, wrench))


@pytest.mark.parametrize("seed", seeds(0, 1, 20))
def test_derivatives_batches_and_single_precision(seed: int, built: Build) -> None:
    robot = screws(seed, rigid=bool(seed % 2))
    kernel = built(robot)
    (q, *_), (v, *_), (a, *_), (u, *_) = arrays = states(kernel, 9, seed)
    names = [name for name in kernel.parameters if name.endswith(".pitch")]
    assert names
    for function, args in (("inverse_dynamics", (q, v, a)), ("forward_dynamics", (q, v, u)), ("energy", (q, v))):
        exact = kernel.parameter_jacobian(function, args, names)
        for place, name in enumerate(names):
            near(exact[..., place], by_pitch(kernel, name, function, args), 1e-6)
    step = 1e-6
    blocks = zip(kernel.forward_dynamics_jacobian(q, v, u), np.eye(3), strict=True)
    for block, (i, j, k) in blocks:
        for column, e in enumerate(step * np.eye(kernel.n)):
            ahead, back = (kernel.forward_dynamics(q + s * i * e, v + s * j * e, u + s * k * e) for s in (1, -1))
            near(block[:, column], (ahead - back) / (2 * step), 1e-6)
    rates = kernel.jet("inverse_dynamics", (q, v, a, u))
    near(rates[0], kernel.inverse_dynamics(q, v, a))
    near(rates[1], kernel.jvp("inverse_dynamics", (q, v, a), (v, a, u)), 1e-10)
    Q, V, _, U = arrays
    assert np.array_equal(
        kernel.forward_dynamics(Q, V, U), [kernel.forward_dynamics(*x) for x in zip(Q, V, U, strict=True)]
    )
    single = built(robot, "inverse_dynamics", dtype="float32")
    few = [x.astype(np.float32) for x in (q, v, a)]
    near(single.inverse_dynamics(*few).astype(float), kernel.inverse_dynamics(*(x.astype(float) for x in few)), 1e-4)


@pytest.mark.parametrize("extra", ["", "deviations", "motor", "matrix", "z"])
def test_a_screw_is_a_cylindrical_pair_with_a_rigid_coupling(extra: str, built: Build) -> None:
    """Constraint forces and multipliers of a closed mechanism stand in the place of followers there."""
    robot = arm()
    (first, screw, last), given = robot.joints, {"z": Coordinate(), "gamma": Coordinate()}
    if extra == "deviations":
        given = {**given, "x": Coordinate(2e3, 5.0), "y": Coordinate(2e3), "alpha": Coordinate(50.0, 0.1)}
    if extra == "z":
        given["z"] = Coordinate(stiffness=300.0, damping=2.0)
    screw = replace(screw, coordinates=given)
    if extra == "motor":
        screw = replace(screw, motor=Motor(1e-3, 5.0, Coordinate(stiffness=40.0, damping=0.1)))
    if extra == "matrix":
        entries = {"z.z": 50.0, "gamma.gamma": 4.0, "z.gamma": 3.0}
        screw = replace(screw, stiffness=JointStiffness(entries=entries))
    robot = replace(robot, joints=(first, screw, last), tunable=())
    ratio = {"j1.gamma": PITCH / (2 * np.pi)}
    coupled = Coupling("nut", "j1.z", ratio, is_constraint=True)
    pair = replace(robot, joints=(first, replace(screw, type="revolute", pitch=None), last), couplings=(coupled,))
    kernel = built(robot, *DYNAMICS, "coupling_forces")
    whole = built(pair, *DYNAMICS, "residual", "constraint_forces")
    place, lead = whole.coordinates.index("j1.z"), [whole.coordinates.index(name) for name in kernel.coordinates]
    assert whole.n == kernel.n + 1
    assert not kernel.constraints
    S = np.zeros((whole.n, kernel.n))
    S[lead, range(kernel.n)] = 1.0
    S[place, kernel.coordinates.index("j1.gamma")] = ratio["j1.gamma"]
    for q, v, a, u in zip(*states(kernel), strict=True):
        Q, V, A, U = S @ q, S @ v, S @ a, np.zeros(whole.n)
        U[lead] = u
        near(kernel.mass_matrix(q), S.T @ whole.mass_matrix(Q) @ S)
        near(kernel.inverse_dynamics(q, v, a), S.T @ whole.residual(Q, V, A, 0 * U))
        near(S @ kernel.forward_dynamics(q, v, u), whole.forward_dynamics(Q, V, U), 1e-8)
        forces = kernel.functions.coupling_forces(q, v, kernel.forward_dynamics(q, v, u))
        near(forces, whole.constraint_forces(Q, V, U), 1e-8)
        near(kernel.reactions(q, v, a), whole.reactions(Q, V, A, cut=True))
        near(kernel.energy(q, v), whole.energy(Q, V))


def test_a_screw_moves_a_closed_loop(built: Build) -> None:
    """A lead screw pushes a crank by a rod; against the robot in which z is a coordinate, and its coupling a row."""
    robot = crank()
    kernels = ("forward_dynamics", "inverse_dynamics", "constraint_forces", "constraint", "cut_poses", "mass_matrix")
    kernel, whole = built(robot), built(robot.with_constraints(), *kernels)
    assert kernel.coordinates == ("spindle.gamma", "bearing.gamma", "rod.gamma", "crank.gamma")
    assert kernel.constraints == ("pin.x", "pin.y", "pin.z", "pin.alpha", "pin.beta")
    assert whole.constraints == (*kernel.constraints, "spindle_z")
    q = kernel.assemble([0.4, -0.4, 0.2, 2.0], fixed=["spindle.gamma"])
    here = kernel.followers(q)["spindle.z"][0]
    Q = np.insert(q, whole.coordinates.index("spindle.z"), here)
    near(whole.functions.constraint(Q), np.zeros(6), 1e-9)
    v = np.linalg.svd(kernel.functions.constraint_jacobian(q))[2][-1]
    V = np.insert(v, 0, kernel.followers(q, v)["spindle.z"][1])
    u = np.array([0.2, 0.0, 0.0, 0.0])
    near(np.delete(whole.forward_dynamics(Q, V, np.insert(u, 0, 0.0)), 0), kernel.forward_dynamics(q, v, u), 1e-7)
    name, step = "joints.spindle.pitch", 2e-9  # which leaves the loop closed enough
    ends = [kernel.replaced(parameters={name: 0.4 + s * step}).forward_dynamics(q, v, u) for s in (1.0, -1.0)]
    (exact,) = kernel.parameter_jacobian("forward_dynamics", (q, v, u), [name]).T
    near(exact, (ends[0] - ends[1]) / (2 * step), 1e-5)


def crank() -> Robot:
    """A nut on a spindle, a carriage that does not turn with it, a rod on that, and a crank that closes the loop."""
    rng = np.random.default_rng(3)
    links = tuple(random_link(rng, name, rods=False) for name in ("nut", "carriage", "rod", "crank"))
    across = ((1.0, 0.0, 0.0), (0.0, 0.0, -1.0), (0.0, 1.0, 0.0))
    hinge = {"gamma": Coordinate()}
    joints = (
        Joint("spindle", "base", "nut", "screw", coordinates={"z": Coordinate(), **hinge}, pitch=0.4),
        Joint("bearing", "nut", "carriage", "revolute", coordinates=hinge),
        Joint("rod", "carriage", "rod", "revolute", Placement((0.0, 0.0, 0.1), across), coordinates=hinge),
        Joint("crank", "base", "crank", "revolute", Placement((0.5, 0.0, 0.0), across), coordinates=hinge),
    )
    ends = (Placement((0.6, 0.0, 0.0)), Placement((0.3, 0.0, 0.0)))
    loop = Loop("pin", ("rod", "crank"), "revolute", ends)
    return Robot("crank", (0.0, 0.0, -9.81), links, joints, loops=(loop,), tunable=("joints.spindle.pitch",))


def test_records_and_changed_values_keep_screws() -> None:
    robot = robot_from_toml(NUT)
    assert robot.couplings == (Coupling("spindle_z", "spindle.z", {"spindle.gamma": PITCH / (2 * np.pi)}, pitch=PITCH),)
    record = record_of(robot)
    assert robot_from_record(record, "") == robot == pickle.loads(pickle.dumps(robot))
    steep = robot.with_value("joints.spindle.pitch", -0.2)
    assert steep.couplings[0].to == {"spindle.gamma": -0.2 / (2 * np.pi)}
    assert robot_hash(steep) != robot_hash(robot)
    assert steep.rigid().followers.keys() == {"spindle.z"}
    assert parameter_unit(robot, "joints.spindle.pitch") == "m"
    assert robot.with_constraints().rigid().couplings[0].is_constraint
    refused(DescriptionError, "which has no parts", robot.with_value, "couplings.spindle_z.offset", 1.0)


REFUSED = (
    ("pitch = 0.05", "pitch = 0", "joints.spindle.pitch: got 0.0; allowed: a finite number that is not 0"),
    ("pitch = 0.05", "", "joints.spindle.pitch: the key 'pitch' is missing; allowed: m per revolution, for 'screw'"),
    ('"screw"', '"revolute"', "joints.spindle.pitch: a revolute joint has no pitch"),
    ("pitch = 0.05", 'pitch = 0.05\nz = { role = "locked" }', "joints.spindle.z: it is locked, and z follows gamma"),
    (
        "pitch = 0.05",
        'pitch = 0.05\nprescribed = ["z"]',
        "joints.spindle.z: it follows gamma; allowed: a prescribed gamma",
    ),
    (
        "pitch = 0.05",
        'pitch = 0.05\n[[couplings]]\nname = "spindle_z"\nof = "spindle.gamma"\nto = {}',
        "which is taken",
    ),
    ("pitch = 0.05", 'pitch = 0.05\n[[couplings]]\nname = "c"\nof = "spindle.z"\nto = {}', "follows from the coupling"),
    ("pitch = 0.05", 'pitch = "1"', "joints.spindle.pitch: got '1'; allowed: a finite number"),
    ('pitch"]', 'pitch.x"]', "no parameter has this name"),
)


def test_long_names_of_screws_are_told_apart() -> None:
    """Couplings have names as long as joints' at most."""
    text = NUT.replace("spindle", "s" * NAME_LENGTH)
    robot = robot_from_toml(text)
    assert robot.couplings[0].name == "s" * (NAME_LENGTH - 2) + "_z"
    (joint,) = robot.joints
    twin = replace(joint, name="s" * (NAME_LENGTH - 1) + "t", parent="nut", child="other")
    links = (*robot.links, replace(robot.links[0], name="other"))
    error = refused(DescriptionError, "is taken", build_model, replace(robot, joints=(joint, twin), links=links))
    assert "another name of either" in str(error)


@pytest.mark.parametrize(("old", "new", "message"), REFUSED)
def test_screws_without_meaning_are_refused(old: str, new: str, message: str) -> None:
    assert old in NUT
    error = refused(DescriptionError, None, robot_from_toml, NUT.replace(old, new))
    assert message in str(error)


def test_a_screw_is_no_loop_joint() -> None:
    text = NUT + '\n[[loops]]\nname = "cut"\nlinks = ["base", "nut"]\ntype = "screw"\n'
    error = refused(DescriptionError, None, robot_from_toml, text)
    assert "loops.cut.type: got 'screw'" in str(error)
    assert "cylindrical" in str(error)


def test_mujoco_has_a_soft_screw_and_urdf_none(tmp_path: Path) -> None:
    robot = robot_from_toml(NUT)
    refused(
        InputError, "MuJoCo has no equal for couplings.spindle_z: soft", eomgen.export_mjcf, robot, tmp_path / "a.xml"
    )
    needs("mujoco")
    with pytest.warns(EomgenWarning, match="couplings.spindle_z: soft in MuJoCo"):
        path = eomgen.export_mjcf(robot, tmp_path / "a.xml", approximate=True)
    (coupling,) = eomgen.load_robot(path).couplings
    assert (coupling.of, dict(coupling.to)) == ("spindle.z", {"spindle.gamma": PITCH / (2 * np.pi)})
    text = """<robot name="r"><link name="a"/><link name="b"><inertial><mass value="1"/></inertial></link>
    <joint name="j" type="screw"><parent link="a"/><child link="b"/></joint></robot>"""
    file = tmp_path / "r.urdf"
    file.write_text(text, encoding="utf-8")
    error = refused(DescriptionError, None, eomgen.load_robot, file)
    assert "type is 'screw'; allowed: revolute, continuous, prismatic, fixed, floating, planar" in str(error)


def test_pages_draw_a_screw_as_a_drum_on_a_rod() -> None:
    robot = robot_from_toml(NUT)
    geometry, _ = geometry_of(robot, ("spindle.gamma",), np.zeros((1, 1)))
    assert [x["slides"] for x in geometry["drums"]] == [False]
    assert [x["links"] for x in geometry["rods"]] == [["base", "nut"]]
