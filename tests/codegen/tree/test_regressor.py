"""The regressor: against inverse dynamics, against bodies with one parameter each, against Pinocchio."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

import eomgen
from eomgen.codegen.kernels.derivation import Derivation
from eomgen.codegen.kernels.equations import derive
from eomgen.codegen.program.ir import Program, evaluate, finish
from eomgen.codegen.tree.recursion import inertial_rows
from eomgen.codegen.tree.regressor import INERTIAL, described_values, regressor_names
from eomgen.codegen.tree.spatial import PseudoInertia, congruence, mat3, vec3
from eomgen.errors import InputError, UnknownNameError
from eomgen.robot.geometry import ZERO
from eomgen.robot.model import Model, build_model
from eomgen.robot.value import Link, Robot
from tests.support.bending_robots import bent
from tests.support.builds import Build
from tests.support.description_samples import example_urdfs, load_without_mimics
from tests.support.optional import needs
from tests.support.random_motors import with_motors
from tests.support.random_robots import (
    Array,
    random_robot,
    random_state,
    seeds,
    some_prescribed,
    with_offsets,
    with_random_loops,
)

TOLERANCE = 1e-12  # relative, max-norm
TYPES = ("revolute", "prismatic", "fixed", "free")
PLACES = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
PINOCCHIO = ("m", "mx", "my", "mz", "ixx", "ixy", "iyy", "ixz", "iyz", "izz")
KINDS: dict[str, Callable[[int], Robot]] = {
    "trees": lambda seed: random_robot(seed, joints=(2, 4), tree=True, types=TYPES),
    "offsets": lambda seed: with_offsets(random_robot(seed, joints=(1, 3), types=TYPES), seed),
    "motors": lambda seed: with_motors(random_robot(seed, joints=(1, 3), types=TYPES[:2]), seed),
    "prescribed": lambda seed: some_prescribed(random_robot(seed, joints=(2, 3)), seed),
    "loops": lambda seed: with_random_loops(random_robot(seed, joints=(3, 3), tree=True), seed, ("revolute",)),
}


def run(program: Program, model: Model, **state: Array) -> Array:
    """What a program writes in one state, with the description's parameters."""
    found = evaluate(program, {**state, "p": list(model.parameters.values())})
    return np.array([found["out", i] for i in range(len(found))], float)


def regressor(model: Model, **state: Array) -> Array:
    return run(derive(model, "regressor"), model, **state).reshape(model.size, -1)


def motion(model: Model, seed: int) -> dict[str, Array]:
    q, v, a = np.random.default_rng(seed).uniform(-1.0, 1.0, (3, model.size))
    return {"q": q, "v": v, "a": a}


def unit_inertia(key: str) -> PseudoInertia:
    """A body of which one parameter is 1."""
    inertia = np.zeros((3, 3))
    if key in PLACES:
        i, j = PLACES[key]
        inertia[i, j] = inertia[j, i] = 1.0
    second = 0.5 * np.trace(inertia) * np.eye(3) - inertia
    return PseudoInertia(mat3(second.tolist()), vec3([float(key == f"m{x}") for x in "xyz"]), float(key == "m"))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", seeds(5200, 2, 20))
def test_with_the_description_s_parameters_it_is_inverse_dynamics(kind: str, seed: int) -> None:
    """Without what laws take, which is inverse dynamics of links without inertia."""
    robot = KINDS[kind](seed)
    model = build_model(replace(robot, loops=()))
    assert derive(build_model(robot), "regressor").outputs == derive(model, "regressor").outputs  # of the open tree
    state, none = motion(model, seed), {"gravity.x": 0.0, "gravity.y": 0.0, "gravity.z": 0.0}
    drives = run(derive(model, "inverse_dynamics"), model, **state)
    weightless = replace(model, parameters={**model.parameters, **none})
    laws = -run(derive(model, "generalized_force"), weightless, q=state["q"], v=state["v"])
    found = regressor(model, **state) @ described_values(model)
    assert np.abs(found + laws - drives).max() <= TOLERANCE * max(np.abs(drives).max(), np.abs(laws).max())


@pytest.mark.parametrize("seed", seeds(5250, 2, 20))
def test_links_that_bend(seed: int) -> None:
    """Other masses, centres and inertias of all links and of what stands on nodes: modes need what they did before."""
    robot = bent(random_robot(seed, joints=(2, 3), tree=True, types=TYPES), seed, modes=(0, 1, 2)).robot
    rng, model = np.random.default_rng(seed), build_model(robot)

    def heavier(link: Link) -> Link:
        inertia = np.add(link.inertia, rng.uniform(0.0, 0.3, 6) * [1.0, 1.0, 1.0, 0.1, 0.1, 0.1])
        com = tuple((link.com + rng.uniform(-0.2, 0.2, 3)).tolist())
        return replace(link, mass=link.mass + float(rng.uniform(0.1, 1.0)), com=com, inertia=tuple(inertia.tolist()))

    other = build_model(replace(robot, links=tuple(map(heavier, robot.links))))
    state = motion(model, seed)
    before, after = (run(derive(x, "inverse_dynamics"), x, **state) for x in (model, other))
    found = regressor(model, **state) @ np.subtract(described_values(other), described_values(model))
    assert np.abs(after - before).max() > 1e-3
    assert np.abs(found - (after - before)).max() <= TOLERANCE * max(np.abs(after).max(), np.abs(before).max())


@pytest.mark.parametrize("seed", seeds(5300, 3, 20))
def test_a_column_is_inverse_dynamics_of_a_body_with_one_parameter(seed: int) -> None:
    """The other way round: wrenches on their way back."""
    robot = random_robot(seed, joints=(2, 4), tree=seed % 2 == 0, types=TYPES)
    model = build_model(robot)
    d, state = Derivation(model, regrouped=False), motion(model, seed)
    found, nothing = regressor(model, **state), PseudoInertia((ZERO, ZERO, ZERO), ZERO, 0.0)
    outputs = {}
    for k, body in enumerate(model.bodies):
        axes = d.bound.frames[body.name][1]  # of the link in its body's frame
        for place, key in enumerate(INERTIAL):
            own = [replace(other, inertia=nothing) for other in d.bound.bodies]
            own[k] = replace(own[k], inertia=congruence(axes, unit_inertia(key)))
            bound = replace(d.bound, bodies=tuple(own), armature=tuple([0.0] * model.size))
            rows, _ = inertial_rows(replace(d.tree, bound=bound), d.v, d.a, bound.gravity)
            outputs |= {("out", i * 10 * len(own) + 10 * k + place): row for i, row in enumerate(rows)}
    program = finish(d.graph, "columns", dict(sorted(outputs.items())))
    expected = run(program, model, **state).reshape(model.size, -1)
    assert np.abs(found[:, : expected.shape[1]] - expected).max() <= TOLERANCE * np.abs(expected).max()


@pytest.mark.parametrize("name", ["ur5_robot", "panda", "kinova"])
def test_it_is_pinocchio_s(name: str) -> None:
    """Link by link in its own frame, whatever the axes of its joint are."""
    pin = needs("pinocchio")
    from tests.oracles.pinocchio_models import UrdfOracle

    paths = {path.stem: path for path in example_urdfs()}
    if name not in paths:
        pytest.skip("no example-robot-data")
    model, oracle = build_model(load_without_mimics(paths[name])), UrdfOracle(paths[name])
    place = [oracle.joints.index(body.joint) for body in model.bodies]
    state = motion(model, 1)
    own = np.array(place)
    q, v, a = (np.zeros(model.size) for _ in range(3))
    q[own], v[own], a[own] = (state[x] for x in "qva")
    expected = pin.computeJointTorqueRegressor(oracle.model, oracle.data, oracle.configuration(q), v, a)
    columns = [10 * k + PINOCCHIO.index(key) for k in place for key in INERTIAL]
    found = regressor(model, **state)[:, : len(columns)]
    assert np.abs(found - expected[np.ix_(own, columns)]).max() <= TOLERANCE * np.abs(expected).max()


def test_a_link_acts_on_coordinates_in_front_of_it_alone() -> None:
    model = build_model(random_robot(5400, joints=(4, 4), tree=True, types=("revolute",)))
    program, names = derive(model, "regressor"), regressor_names(model)
    for (_, place), value in program.outputs.items():
        row, column = divmod(place, len(names))
        if column >= 10 * len(model.bodies):
            continue
        chain = [i for k in model.ancestors(column // 10) for i in model.bodies[k].indices]
        instruction = program.instructions[value]
        assert row in chain or (instruction.op == "const" and instruction.leaf == 0.0)


def test_operations_of_the_puma() -> None:
    """SymPyBotics, which has no run-time gravity and no armatures, needs 961 and 644 for these frames."""
    count = derive(build_model(eomgen.load_robot("puma560")), "regressor").count()
    assert count["mul"] <= 498
    assert count["add"] <= 413


def test_names() -> None:
    assert INERTIAL == ("m", "mx", "my", "mz", "ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    names = regressor_names(build_model(eomgen.load_robot("puma560")))
    assert names[:10] == tuple(f"link1.{key}" for key in INERTIAL)
    assert names[60:] == tuple(f"joint{i}.gamma.armature" for i in range(1, 7))


def test_a_kernel_s_regressor(built: Build) -> None:
    """States, batches, an array to write to, and numbers that change at run time."""
    robot = eomgen.load_robot("one_link")
    joint = robot.joints[0]
    gamma = replace(joint.coordinates["gamma"], armature=0.3)
    robot = replace(robot, joints=(replace(joint, coordinates={**joint.coordinates, "gamma": gamma}),))
    robot = replace(robot, tunable=("links.link1.mass", "joints.joint1.gamma.armature"), gravity=(0.0, 0.0, 0.0))
    kernel = built(robot, "regressor", "inverse_dynamics", "generalized_force")
    states = [random_state(robot, seed) for seed in range(5)]
    q, v, a = (np.array([getattr(s, x) for s in states]) for x in "qva")
    Y = kernel.functions.regressor(q, v, a)
    assert Y.shape == (5, 2, 11)
    assert kernel.regressor_names == regressor_names(build_model(robot))
    out = np.empty((5, 2, 11))
    assert kernel.functions.regressor(q, v, a, out=out) is out
    assert np.array_equal(out, Y)
    assert np.array_equal(kernel.functions.regressor(q[3], v[3], a[3]), Y[3])
    for armature in (0.3, 2.0):
        kernel.parameters["joints.joint1.gamma.armature"] = armature
        assert kernel.regressor_values[-1] == armature
        found = Y @ kernel.regressor_values - kernel.generalized_force(q, v)
        assert np.abs(found - kernel.inverse_dynamics(q, v, a)).max() < 1e-9
    kernel.parameters["links.link1.mass"] = 3.0
    with pytest.raises(InputError, match=r"links\.link1\.mass is 3\.0 now; allowed: the description's 1\.0"):
        _ = kernel.regressor_values
    with pytest.raises(UnknownNameError, match="regressor"):
        _ = built(robot, "mass_matrix").regressor_names
