"""Matrices of loop joints and bushings: a joint of six coordinates has the same forces, and is computed otherwise."""

from __future__ import annotations

import json
import pickle
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from eomgen.codegen.closed_form.trace import closed_form
from eomgen.codegen.forces.joint_stiffness import CoordinateMatrix
from eomgen.codegen.forces.scalar_functions import Functions
from eomgen.codegen.kernels.equations import derive
from eomgen.codegen.program.ir import Graph, evaluate, finish
from eomgen.description.load import robot_from_toml
from eomgen.errors import DescriptionError, InputError
from eomgen.export.fmu.variables import UNITS, parameter_unit
from eomgen.export.mujoco import left_out
from eomgen.pipeline.costs import RobotInfo
from eomgen.robot import Bushing, JointDamping, JointStiffness, Loop, Placement, Robot, record_of, robot_hash, robot_of
from eomgen.robot.elements.matrices import matrix_of
from eomgen.robot.model import build_model
from eomgen.robot.parameter_names import number_of
from eomgen.robot.value import COORDINATES, Coordinate
from eomgen.state.springs import any_spring, fastest_rates, line_rates
from tests.support.builds import Build
from tests.support.closeness import close
from tests.support.every_element import TREE
from tests.support.random_robots import random_state, seeds
from tests.support.small_robots import free_body
from tests.support.soak import across

Array = NDArray[np.float64]
KERNELS = ("inverse_dynamics", "forward_dynamics", "energy", "residual_jacobian", "mass_matrix", "generalized_force")
FORMS = ["matrices", "ratio", "loss_factor", "damping alone"]


def elements(seed: int, form: str) -> tuple[JointStiffness | None, JointDamping]:
    rng = np.random.default_rng(seed)
    K, D = (np.asarray(rows.T @ rows) for rows in rng.normal(size=(2, 7, 6)))
    stiffness = JointStiffness.of((20.0 * K).tolist(), preload=rng.normal(size=6).tolist())
    damping = JointDamping.of(D.tolist())
    if form == "damping alone":
        return None, damping
    return stiffness, damping if form == "matrices" else JointDamping(**{form: 0.3}, at_hz=2.0)


def on_joint(stiffness: JointStiffness | None, damping: JointDamping) -> Robot:
    """A body on a joint with all six coordinates."""
    body = free_body()
    joint = replace(body.joints[0], type="fixed", stiffness=stiffness, damping=damping)
    return replace(body, name="on_joint", joints=(joint,))


def on_bushing(stiffness: JointStiffness | None, damping: JointDamping) -> Robot:
    body = free_body()
    mount = Bushing("mount", ("base", "body"), stiffness=stiffness, damping=damping)
    held = replace(body.joints[0], type="fixed")
    return replace(body, name="on_bushing", joints=(held,), elements=(mount,))


def on_loop(stiffness: JointStiffness | None, damping: JointDamping) -> Robot:
    body = free_body()
    free = dict.fromkeys(COORDINATES, Coordinate())
    loop = Loop("mount", ("base", "body"), "fixed", coordinates=free, stiffness=stiffness, damping=damping)
    return replace(body, name="on_loop", joints=(replace(body.joints[0], type="fixed"),), loops=(loop,))


@pytest.mark.parametrize(("form", "made"), across(FORMS, (on_bushing, on_loop)))
@pytest.mark.parametrize("seed", seeds(2700, 1, 4))
def test_they_are_those_of_a_joint(seed: int, form: str, made: type[Robot], built: Build) -> None:
    parts = elements(seed, form)
    robot, joint = made(*parts), on_joint(*parts)  # type: ignore[arg-type]
    kernel, other = built(robot, *KERNELS), built(joint, *KERNELS)
    single, states = (
        built(robot, "generalized_force", dtype="float32"),
        [random_state(joint, seed + i) for i in range(5)],
    )
    for s in states:
        assert close(kernel.inverse_dynamics(s.q, s.v, s.a), other.inverse_dynamics(s.q, s.v, s.a), 1e-9)
        assert close(kernel.forward_dynamics(s.q, s.v, s.u), other.forward_dynamics(s.q, s.v, s.u), 1e-8)
        assert close(kernel.energy(s.q, s.v), other.energy(s.q, s.v), 1e-9)
        for found, wanted in zip(*(x.residual_jacobian(s.q, s.v, s.a) for x in (kernel, other)), strict=True):
            assert close(found, wanted, 1e-8)
    q, v = (np.array([getattr(s, x) for s in states]) for x in "qv")
    forces = other.generalized_force(q, v)
    assert close(kernel.generalized_force(q, v), forces, 1e-9)
    assert close(single.generalized_force(q.astype(np.float32), v.astype(np.float32)), forces, 1e-3)
    there = 0.0 * q[0]
    assert close(np.array(fastest_rates(kernel, there)), np.array(fastest_rates(other, there)), 1e-9)
    assert any_spring(kernel) == any_spring(other) == (form != "damping alone")
    assert line_rates(kernel, there)[1].any()


@pytest.mark.parametrize("made", [on_bushing, on_loop])
@pytest.mark.parametrize("form", FORMS)
def test_implicit_steps_are_those_of_a_joint(form: str, made: type[Robot]) -> None:
    """Rank-one rows make the block that a joint's coordinates have; where they are those of the step's beginning."""
    parts, dt = elements(5, form), 0.02
    robot, joint = made(*parts), on_joint(*parts)  # type: ignore[arg-type]
    s, found = random_state(joint, 3), []
    for one in (robot, joint):
        model = build_model(one)
        given = {"q": s.q, "v": s.v, "a": s.a, "u": s.u, "added": np.zeros(6), "dt": [dt, dt * dt]}
        numbers = evaluate(derive(model, "implicit_step"), {**given, "p": list(model.parameters.values())})
        found.append(np.array([numbers["out", i] for i in range(6)]))
    assert close(*found, 1e-8)


@pytest.mark.parametrize(("method", "made"), across(("implicit", "rosenbrock", "radau"), (on_bushing, on_loop)))
def test_rollouts_are_those_of_a_joint(method: str, made: type[Robot], built: Build) -> None:
    """Also where stiffness is so large that nothing but its place in the matrix keeps steps stable."""
    stiffness, damping = elements(6, "ratio")
    assert stiffness is not None
    stiff = JointStiffness({key: 1e4 * x for key, x in stiffness.entries.items()})
    robot, joint = made(stiff, damping), on_joint(stiff, damping)  # type: ignore[arg-type]
    names = {"implicit": "rollout", "rosenbrock": "adaptive_rollout", "radau": "radau_rollout"}
    ends, q0 = [], np.array([1e-3, -2e-3, 1e-3, 2e-3, 1e-3, -1e-3])
    steps = {"dt": 1e-3, "steps": 50} if method == "implicit" else {"duration": 0.05, "samples": 1, "rtol": 1e-6}
    for one in (robot, joint):
        kernel = built(one, "mass_matrix", "forward_dynamics", names[method])
        q, v = kernel.rollout(q0, 0.0 * q0, np.zeros(6), method=method, **steps)
        ends.append(np.concatenate([q[-1], v[-1]]))
    assert np.abs(ends[1]).max() > 1e-8
    assert np.abs(ends[0] - ends[1]).max() < 1e-3 * np.abs(ends[1]).max()


@pytest.mark.parametrize(("method", "dtype"), across(("implicit", "rosenbrock", "radau"), ("float64", "float32")))
def test_matrices_may_lose_their_rank(method: str, dtype: str, built: Build) -> None:
    """Parameters may be 0, or those of one direction alone: the rows of the others are none."""
    parts, q0 = elements(6, "matrices"), np.array([0.1, -0.2, 0.1, 0.2, 0.1, -0.1], dtype)
    names = {"implicit": "rollout", "rosenbrock": "adaptive_rollout", "radau": "radau_rollout"}
    name, ends = names[method], []
    steps = {"dt": 1e-3, "steps": 50} if method == "implicit" else {"duration": 0.05, "samples": 1, "rtol": 1e-4}
    one = 3.0 * np.outer(np.arange(1.0, 7.0), np.arange(1.0, 7.0))
    for made, prefix in ((on_joint, "joints.free"), (on_bushing, "bushings.mount"), (on_loop, "loops.mount")):
        kernel = built(made(*parts), name, dtype=dtype)
        numbers = {x: 0.0 for x in kernel.parameters if x.startswith(prefix)}
        alone = {f"{prefix}.stiffness.{key}": x for key, x in JointStiffness.of(one.tolist()).entries.items()}
        for changes in (numbers, numbers | alone):
            kernel.parameters.update(changes)
            q, v = kernel.rollout(q0, 0.0 * q0, 0.0 * q0, method=method, **steps)
            ends.append(np.concatenate([q[-1], v[-1]]))
    tolerance = 1e-9 if dtype == "float64" else 1e-4
    for first, other in ((0, 2), (0, 4), (1, 3), (1, 5)):
        assert close(ends[other], ends[first], tolerance)
    assert not close(ends[0], ends[1], 1e-3)


@pytest.mark.parametrize("rank", range(7))
@pytest.mark.parametrize("seed", seeds(2740, 1, 6))
def test_directions_make_the_matrix(seed: int, rank: int) -> None:
    """Sums of d l l^T, of matrices without full rank too; slopes are never negative."""
    rng = np.random.default_rng(seed)
    rows = rng.normal(size=(rank, 6)) * 10.0 ** rng.uniform(-3, 3, 6)
    K = rows.T @ rows
    graph = Graph()
    pairs = {(i, j): graph.input("k", 6 * i + j) for i in range(6) for j in range(i, 6)}
    directions = CoordinateMatrix(pairs).directions(Functions(graph.call))
    values = [x for row, d in directions for x in (d, *(row.get(i, 0.0) for i in range(6)))]
    program = finish(graph, "directions", {("out", i): value for i, value in enumerate(values)})
    numbers = evaluate(program, {"k": K.ravel().tolist()})
    found = np.array([float(numbers["out", i]) for i in range(len(values))]).reshape(-1, 7)
    assert (found[:, 0] >= 0.0).all()
    sizes = np.sqrt(np.maximum(np.diag(K), 1e-300))
    made = np.einsum("k,ki,kj->ij", found[:, 0], found[:, 1:], found[:, 1:])
    assert np.abs((made - K) / np.outer(sizes, sizes)).max() < 1e-7


def test_forces_are_told(built: Build) -> None:
    """``element_forces`` and ``cut_forces`` have what the matrices add, and reactions hold it."""
    parts = elements(7, "matrices")
    assert parts[0] is not None
    K, D = np.array(matrix_of(parts[0].entries, COORDINATES)), np.array(matrix_of(parts[1].entries, COORDINATES))
    preload = np.array([parts[0].preload[name] for name in COORDINATES])
    s = random_state(on_joint(*parts), 2)
    bushing, loop = built(on_bushing(*parts), "element_forces"), built(on_loop(*parts), "cut_forces", "loop_reactions")
    wanted = np.column_stack([s.q, K @ s.q + D @ s.v + preload])
    assert close(bushing.element_forces(s.q, s.v), wanted, 1e-9)
    assert close(loop.cut_forces(s.q, s.v), wanted, 1e-9)
    assert bushing.element_rows == tuple(f"mount.{name}" for name in COORDINATES)
    assert loop.cut_laws == bushing.element_rows


def test_closed_form_has_those_of_loops() -> None:
    stiffness = JointStiffness({"x.x": 9.0, "x.gamma": 2.0, "gamma.gamma": 4.0})
    body, damping = free_body(), JointDamping(ratio=0.1, at_hz=1.0)
    loop = Loop("pin", ("base", "body"), "fixed", coordinates=dict.fromkeys(COORDINATES, Coordinate()))
    joint = replace(body.joints[0], type="fixed", coordinates=dict.fromkeys(("x", "gamma"), Coordinate()))
    robot = replace(body, joints=(joint,), loops=(replace(loop, stiffness=stiffness, damping=damping),))
    model, s = build_model(robot), random_state(robot, 3)
    arrays = {"q": s.q, "v": s.v, "a": s.a, "u": s.u, "p": list(model.parameters.values())}
    found = np.array(list(evaluate(derive(model, "residual"), arrays).values()))
    assert close(found, closed_form(model).function("residual")(s.q, s.v, s.a, s.u), 1e-9)


@pytest.mark.parametrize("made", [on_bushing, on_loop])
def test_entries_are_parameters_checked_as_a_whole(made: type[Robot], built: Build) -> None:
    parts = elements(8, "matrices")
    robot = made(*parts)  # type: ignore[arg-type]
    kernel = built(robot, "generalized_force")
    prefix = "bushings.mount" if made is on_bushing else "loops.mount"
    p = kernel.parameters
    bound = np.sqrt(p[f"{prefix}.stiffness.x.x"] * p[f"{prefix}.stiffness.beta.beta"])
    before = dict(p)
    for table in ("stiffness", "damping"):
        with pytest.raises(InputError, match=rf"{prefix}\.{table}\.x\.beta.*negative energy"):
            p[f"{prefix}.{table}.x.beta"] = 2.0 * bound
    assert dict(p) == before
    p.update({name: 4.0 * x for name, x in before.items() if name.startswith(prefix)})
    s = random_state(on_joint(*parts), 2)
    other = built(on_joint(*parts), "generalized_force")
    idle = built(replace(free_body(), joints=(replace(free_body().joints[0], type="fixed"),)), "generalized_force")
    weight = idle.generalized_force(s.q, s.v)
    assert close(kernel.generalized_force(s.q, s.v) - weight, 4.0 * (other.generalized_force(s.q, s.v) - weight), 1e-8)
    for name in p:
        if name.startswith(prefix):
            assert number_of(name) is not None
            assert parameter_unit(robot, name) in UNITS
    asked = replace(robot, tunable=(f"{prefix}.stiffness.preload.x",))
    assert f"{prefix}.stiffness.preload.x" in build_model(asked).parameters


BUSHING = """[[bushings]]
name = "mount"
links = ["base", "fore"]
stiffness = { matrix = [[9.0, 0.0, 0.0, 0.0, 2.0, 0.0], [0.0, 8.0, 0.0, 0.0, 0.0, 0.0], \
[0.0, 0.0, 7.0, 0.0, 0.0, 0.0], \
[0.0, 0.0, 0.0, 1.0, 0.0, 0.0], [2.0, 0.0, 0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 0.0, 0.0, 1.0]], \
at = { xyz = [0.0, 0.0, 0.1] } }
damping = { ratio = 0.1, at_hz = 5.0 }
"""
LOOP = """[[loops]]
name = "clamp"
links = ["base", "fore"]
type = "revolute"
x = {}
y = {}
beta = {}
stiffness = { matrix = [[9.0, 0.0, 2.0], [0.0, 8.0, 0.0], [2.0, 0.0, 1.0]] }
damping = { loss_factor = 0.1, at_hz = 5.0 }
"""
REFUSED = {
    "bushing: three rows": (
        BUSHING,
        "[[9.0, 0.0, 0.0, 0.0, 2.0, 0.0], [0.0, 8.0, 0.0, 0.0, 0.0, 0.0], ",
        "[",
        ["bushings.mount.stiffness.matrix"],
    ),
    "bushing: units": (BUSHING, "2.0", "4.0", ["bushings.mount.stiffness.matrix", "x.beta", "up to 3", "units?"]),
    "bushing: isotropic": (
        BUSHING,
        "ratio = 0.1, at_hz = 5.0",
        "linear = 1.0",
        ["bushings.mount.damping", "'linear'", "ratio"],
    ),
    "bushing: no stiffness": (BUSHING.replace("stiffness = {", "#"), "", "", ["bushings.mount.damping", "stiffness"]),
    "bushing: rows alone": (
        BUSHING,
        "{ ratio = 0.1, at_hz = 5.0 }",
        "[[1.0], [2.0]]",
        ["bushings.mount.damping", "six numbers", "matrix = "],
    ),
    "loop: free row": (
        LOOP,
        "[[9.0, 0.0, 2.0], [0.0, 8.0, 0.0], [2.0, 0.0, 1.0]]",
        str(np.diag([9.0, 8.0, 1.0, 1.0, 1.0, 1.0]).tolist()),
        ["loops.clamp.stiffness.matrix", "gamma is free and has no table", "gamma = {}"],
    ),
    "loop: isotropic": (
        LOOP,
        "loss_factor = 0.1, at_hz = 5.0",
        "angular = 1.0",
        ["loops.clamp.damping", "'angular'", "ratio"],
    ),
    "loop: no table": (LOOP, "beta = {}\n", "", ["loops.clamp.stiffness.matrix", "3 rows", "2, for x, y, or six"]),
    "loop: no stiffness": (LOOP.replace("stiffness = {", "#"), "", "", ["loops.clamp.damping", "stiffness"]),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_is_wrong_is_refused(case: str) -> None:
    text, old, new, said = REFUSED[case]
    assert old in text
    with pytest.raises(DescriptionError) as caught:
        robot_from_toml(TREE.format(hip="", knee="", beside=text.replace(old, new)), source="my.toml")
    assert all(word in str(caught.value) for word in ["my.toml", *said]), caught.value


def test_they_are_read_kept_and_named() -> None:
    robot = robot_from_toml(TREE.format(hip="", knee="", beside=BUSHING + LOOP))
    (mount,), (clamp,) = robot.elements, robot.loops
    K = np.diag([9.0, 8.0, 7.0, 1.0, 1.0, 1.0])
    K[0, 4] = K[4, 0] = 2.0
    assert mount.stiffness == JointStiffness.of(K.tolist(), at=Placement((0.0, 0.0, 0.1)))
    assert mount.damping == JointDamping(ratio=0.1, at_hz=5.0)
    assert clamp.stiffness == JointStiffness({"x.x": 9.0, "x.beta": 2.0, "y.y": 8.0, "beta.beta": 1.0})
    assert robot_of(json.loads(json.dumps(record_of(robot)))) == robot == pickle.loads(pickle.dumps(robot))
    changed = robot.with_value("bushings.mount.stiffness.y.y", 6.0).with_value("loops.clamp.stiffness.x.beta", 1.0)
    assert changed.elements[0].law()["stiffness.y.y"] == 6.0
    assert changed.loops[0].stiffness.entries["x.beta"] == 1.0
    assert robot_hash(changed) != robot_hash(robot)
    with pytest.raises(DescriptionError, match="units"):
        robot.with_value("bushings.mount.stiffness.x.beta", 100.0)
    info = RobotInfo(build_model(robot), {}, (), {}, {})
    lines = info.lines()
    assert any(line.startswith("bushing mount from base to fore") for line in lines)
    assert sum("principal 7, 8, 9 N/m and" in line for line in lines) == 1
    assert any(line.split() == ["x", "9", "0", "2"] for line in lines)
    assert {"bushings.mount: left out", "loops.clamp.stiffness: left out", "loops.clamp.damping: left out"} <= {
        *left_out(robot)
    }
    six = str(np.diag([9.0, 8.0, 5.0, 0.0, 1.0, 0.0]).tolist())
    struck = LOOP.replace("[[9.0, 0.0, 2.0], [0.0, 8.0, 0.0], [2.0, 0.0, 1.0]]", six)
    noted = robot_from_toml(TREE.format(hip="", knee="", beside=struck))
    assert noted.notes == ("loops.clamp.stiffness: rows of coordinates that do not move are left out: z",)
    assert robot.rigid().loops[0].stiffness is None
    assert robot.rigid().loops[0].damping is None
    for element, message in (
        (Bushing("b", ("base", "fore"), stiffness=JointStiffness({"x.x": 1.0, "x.y": 1.0})), "root of the product"),
        (Bushing("b", ("base", "fore"), damping=JointDamping(1.0)), "isotropic"),
        (Bushing("b", ("base", "fore"), damping=JointDamping(ratio=0.1, at_hz=1.0)), "no table stiffness"),
    ):
        with pytest.raises(DescriptionError, match=message):
            build_model(replace(robot, elements=(element,)))
    with pytest.raises(DescriptionError, match="isotropic"):
        build_model(replace(robot, loops=(replace(clamp, damping=JointDamping(1.0)),)))
