"""Run-time parameters: an assignment takes effect without recompiling, and equals another description."""

from __future__ import annotations

import pickle
import threading
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any
from unittest import mock

import numpy as np
import pytest

import eomgen
from eomgen.description.load import robot_from_toml
from eomgen.errors import DescriptionError, InputError, UnknownNameError
from eomgen.kernel import Kernel
from eomgen.robot.parameter_names import parameters
from eomgen.robot.value import Placement, Robot
from tests.support.builds import Build
from tests.support.joint_table import frame_table, joint_table, link_table
from tests.support.other_numbers import changed
from tests.support.random_robots import random_placement, random_robot, random_state, seeds
from tests.support.refusals import refused

pytestmark = [pytest.mark.usefixtures("unoptimised"), pytest.mark.filterwarnings("ignore::eomgen.errors.EomgenWarning")]
TOLERANCE = 1e-11
CALLED = (
    "mass_matrix",
    "bias_force",
    "generalized_force",
    "external_force",
    "residual",
    "inverse_dynamics",
    "forward_dynamics",
    "coriolis_matrix",
    "christoffel",
    "energy",
    "reactions",
    "kinematics",
)  # by ``results``


def everything_tunable(robot: Robot) -> Robot:
    return replace(robot, tunable=tuple(".".join(item.path) for item in parameters(robot)))


def results(kernel: eomgen.Kernel, robot: Robot) -> dict[str, np.ndarray]:
    """What every kernel gives in one state."""
    s = random_state(robot, 11)
    wrench = np.random.default_rng(12).uniform(-5, 5, (len(kernel.links), 6))
    frames = {f"pose of {name}": kernel.frame_pose(s.q, name) for name in kernel.frames}
    frames |= {f"jacobian of {name}": kernel.frame_jacobian(s.q, name) for name in kernel.frames}
    return {
        "mass_matrix": kernel.mass_matrix(s.q),
        "bias_force": kernel.bias_force(s.q, s.v),
        "generalized_force": kernel.generalized_force(s.q, s.v),
        "external_force": kernel.functions.external_force(s.q, wrench),
        "residual": kernel.residual(s.q, s.v, s.a, s.u),
        "inverse_dynamics": kernel.inverse_dynamics(s.q, s.v, s.a),
        "forward_dynamics": kernel.forward_dynamics(s.q, s.v, s.u),
        "coriolis_matrix": kernel.coriolis_matrix(s.q, s.v),
        "christoffel": kernel.christoffel(s.q),
        "energy": kernel.energy(s.q, s.v),
        "reactions": kernel.reactions(s.q, s.v, s.a),
        **frames,
    }


def assert_same(found: Mapping[str, np.ndarray], expected: Mapping[str, np.ndarray], size: float) -> None:
    for name, value in expected.items():
        limit = 1e-9 if name == "forward_dynamics" else TOLERANCE
        assert np.abs(found[name] - value).max() <= limit * max(size, np.abs(value).max()), name


@pytest.mark.parametrize("seed", seeds(600, 1, 3))
def test_all_numbers_as_parameters(seed: int, built: Build) -> None:
    """Masses, centres, inertias, placements, springs, rotors, gravity: one kernel, two descriptions."""
    plain = random_robot(seed, joints=(2, 3), max_size=6, tree=True)
    plain = replace(
        plain, frames=(replace(plain.frames[0], placement=Placement.from_rpy((0.1, 0.2, 0.3), (0.4, 0.5, 0.6))),)
    )
    robot = everything_tunable(plain)
    kernel = built(robot, *CALLED)
    assert sorted(kernel.parameters) == sorted(robot.tunable)
    size = float(np.abs(results(kernel, robot)["inverse_dynamics"]).max())
    assert_same(results(kernel, robot), results(built(plain, *CALLED), robot), size)

    rng = np.random.default_rng(seed)
    other = {name: value * rng.uniform(0.9, 1.1) + rng.uniform(0, 0.05) for name, value in kernel.parameters.items()}
    before = results(kernel, robot)
    kernel.parameters.update(other)
    assert dict(kernel.parameters) == other
    after = results(kernel, robot)
    assert_same(after, results(built(changed(robot, other), *CALLED), robot), size)
    assert all(
        not np.array_equal(before[name], after[name])
        for name in before
        if name != "pose of base" and "jacobian" not in name
    )


@pytest.mark.soak
def test_one_parameter_at_a_time(built: Build) -> None:
    """Each of them reaches the kernels, and reaches what it should."""
    rng = np.random.default_rng(3)
    robot = random_robot(603, joints=(2, 2), types=("revolute",), max_coordinates=3)
    last = robot.joints[-1]
    joint = replace(last, placement=Placement.from_rpy((0.1, 0.0, 0.3), (np.pi / 2, 0.2, 0.0)))
    robot = replace(
        robot, joints=(*robot.joints[:-1], joint), frames=(replace(robot.frames[0], placement=random_placement(rng)),)
    )
    robot = everything_tunable(robot)
    kernel = built(robot, *CALLED)
    reference = results(kernel, robot)
    for name, value in list(kernel.parameters.items()):
        kernel.parameters[name] = value + 0.125
        assert kernel.parameters[name] == value + 0.125
        found = results(kernel, robot)
        differs = {key for key in found if not np.array_equal(found[key], reference[key])}
        if name.startswith("frames."):
            expected = {"pose of tcp"} if ".rpy." in name else {"pose of tcp", "jacobian of tcp"}
            assert differs == expected, name
        elif name.startswith("gravity."):
            assert {"generalized_force", "reactions", "energy"} <= differs, name
            assert "mass_matrix" not in differs, name
        elif name.endswith((".stiffness", ".damping")):
            forces = {"generalized_force", "residual", "inverse_dynamics", "forward_dynamics"}
            assert differs == forces | ({"energy"} if name.endswith("stiffness") else set()), name
        elif name.endswith((".mass", ".armature", ".com.x")):
            assert "forward_dynamics" in differs or "reactions" in differs, name
        kernel.parameters[name] = value
        assert all(np.array_equal(x, reference[key]) for key, x in results(kernel, robot).items()), name


def test_springs_dampers_and_gravity_are_always_parameters(built: Build) -> None:
    kernel = built(eomgen.load_robot("one_link"))
    assert dict(kernel.parameters) == {
        "gravity.x": 0.0,
        "gravity.y": -9.81,
        "gravity.z": 0.0,
        "joints.joint1.x.stiffness": 1e4,
    }
    kernel.parameters["gravity.x"] = 2.0
    kernel.parameters["gravity.y"] = 0.0
    kernel.parameters["joints.joint1.x.stiffness"] = 50.0
    q = np.array([0.1, 0.7])
    expected = [2.0 - 50.0 * 0.1, -0.5 * np.sin(0.7) * 2.0]  # m = 1, half its length 0.5
    assert np.allclose(kernel.generalized_force(q, 0 * q), expected, rtol=1e-14)


TOML = f"""
name = "tuned"
tunable = ["links.*.mass", "links.link1.com", "joints.joint1.gamma.armature", "frames.tcp.placement.rpy.2"]
{link_table("link1", 2.0, inertia=(0.1, 0.1, 0.1))}
{joint_table("joint1", "base", "link1", "revolute")}
{frame_table("tcp", "link1")}
placement = {{ xyz = [0.0, 0.1, 0.0], rpy = [0.0, 0.0, 0.5] }}
"""


def test_tunable_of_a_description(built: Build) -> None:
    """Patterns are expanded; what the description does not give starts at zero."""
    kernel = built(robot_from_toml(TOML))
    names = [name for name in kernel.parameters if not name.startswith("gravity")]
    assert names == [
        "links.link1.mass",
        "links.link1.com.x",
        "links.link1.com.y",
        "links.link1.com.z",
        "joints.joint1.gamma.armature",
        "frames.tcp.placement.rpy.2",
    ]
    assert kernel.parameters["joints.joint1.gamma.armature"] == 0.0
    assert kernel.mass_matrix([0.0]) == pytest.approx(0.1)
    kernel.parameters["joints.joint1.gamma.armature"] = 0.25
    kernel.parameters["links.link1.com.x"] = 0.5
    assert kernel.mass_matrix([0.0]) == pytest.approx(0.1 + 0.25 + 2.0 * 0.25)
    kernel.parameters["frames.tcp.placement.rpy.2"] = 0.0
    assert np.allclose(kernel.frame_pose([0.0], "tcp")[:3, :3], np.eye(3), atol=1e-15)


def refusal(call: Callable[[], Any], error: type[Exception] = InputError) -> str:
    caught = refused(error, "", call)
    return str(caught)


@pytest.mark.parametrize("binding", ["direct", "python"])
def test_what_cannot_be_assigned(binding: str, built: Build) -> None:
    kernel = built(robot_from_toml(TOML))
    parameters = kernel.parameters if binding == "direct" else Kernel(kernel.raw.libraries).parameters
    before = dict(parameters)

    def assign(name: Any, value: Any) -> Callable[[], None]:
        return lambda: parameters.__setitem__(name, value)

    message = refusal(assign("links.link1.mas", 1.0), UnknownNameError)
    assert "'links.link1.mas' is not a run-time parameter of tuned; did you mean 'links.link1.mass'?" in message
    assert "tunable" in message
    assert "not a run-time parameter" in refusal(assign("links.link1.inertia.xx", 1.0), UnknownNameError)
    assert "not a run-time parameter" in refusal(lambda: parameters["joints.joint2.x.stiffness"], UnknownNameError)
    assert "not a run-time parameter" in refusal(assign(3, 1.0), UnknownNameError)
    assert (
        refusal(assign("links.link1.mass", -1.0))
        == "parameters: links.link1.mass = -1.0 is negative; at least 0 is allowed"
    )
    assert "is negative" in refusal(assign("joints.joint1.gamma.armature", -1e-9))
    for bad in (np.nan, np.inf, -np.inf):
        assert refusal(assign("links.link1.com.x", bad)) == f"parameters: links.link1.com.x = {bad!r} is not finite"
    for bad in ("1.0", None, 1j, True, np.zeros(1), [1.0]):
        assert "is not a number" in refusal(assign("links.link1.com.x", bad))
    assert "cannot be removed" in refusal(lambda: parameters.pop("links.link1.mass"))
    with pytest.raises(InputError):  # all or nothing
        parameters.update({"links.link1.mass": 9.0, "links.link1.com.x": np.nan})
    assert dict(parameters) == before
    parameters.update({})
    for number in (3, np.float32(-0.5), np.int64(3), -0.0, 1e300):
        parameters["links.link1.com.x"] = number
        assert parameters["links.link1.com.x"] == number


def test_kernels_do_not_share_parameters(built: Build) -> None:
    robot = eomgen.load_robot("one_link")
    one, other = built(robot), built(robot)
    q = np.array([0.0, 0.3])
    before = other.generalized_force(q, q)
    one.parameters["gravity.y"] = 0.0
    assert other.parameters["gravity.y"] == -9.81
    assert np.array_equal(other.generalized_force(q, q), before)
    assert built(robot).parameters["gravity.y"] == -9.81
    assert not np.array_equal(one.generalized_force(q, q), before)


def test_single_precision_parameters(built: Build) -> None:
    kernel = built(eomgen.load_robot("one_link"), dtype="float32")
    assert kernel.parameters["gravity.y"] == float(np.float32(-9.81))
    kernel.parameters["gravity.y"] = 0.0
    assert (kernel.generalized_force([0.0, 0.3], [0.0, 0.0]) == 0.0).all()


def test_threads_that_assign_different_parameters(built: Build) -> None:
    """None of the assignments is lost."""
    kernel = built(everything_tunable(random_robot(603, joints=(3, 3), types=("revolute",))))
    names = list(kernel.parameters)[:8]

    def assign(name: str) -> None:
        for i in range(300):
            kernel.parameters[name] = float(i)

    threads = [threading.Thread(target=assign, args=(name,)) for name in names]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert [kernel.parameters[name] for name in names] == [299.0] * len(names)


def test_threads_that_call_while_parameters_change(built: Build) -> None:
    """A call sees the parameters of before or of after, never a mixture."""
    robot = everything_tunable(random_robot(603, joints=(3, 3), types=("revolute",)))
    kernel, s = built(robot), random_state(robot, 1)
    q, v, a = (np.tile(x, (50, 1)) for x in (s.q, s.v, s.a))
    first = dict(kernel.parameters)
    second = {name: value + 0.25 for name, value in first.items()}
    kernel.parameters.update(second)
    expected = [kernel.inverse_dynamics(q[:1], v[:1], a[:1])]
    kernel.parameters.update(first)
    expected.append(kernel.inverse_dynamics(q[:1], v[:1], a[:1]))
    assert not np.array_equal(*expected)
    stop, wrong, seen = threading.Event(), [], set()

    def call() -> None:
        while not stop.is_set():
            for state, count in (((q, v, a), 50), ((s.q, s.v, s.a), 1)):
                found = kernel.inverse_dynamics(*state)
                which = [i for i, x in enumerate(expected) if np.array_equal(found, np.tile(x, (count, 1)).squeeze())]
                seen.update(which)
                if not which:
                    wrong.append(found)

    threads = [threading.Thread(target=call) for _ in range(4)]
    for thread in threads:
        thread.start()
    for _ in range(200):
        kernel.parameters.update(second)
        kernel.parameters.update(first)
    stop.set()
    for thread in threads:
        thread.join()
    assert not wrong
    assert seen


def test_kernels_of_one_code_have_parameters_of_their_own(built: Build) -> None:
    """Threads that each have another stiffness get what a kernel alone gets, to the bit."""
    robot = eomgen.load_robot("one_link")
    kernel = built(robot, "inverse_dynamics", "forward_dynamics", "rollout")
    name = "joints.joint1.x.stiffness"
    stiffnesses = np.linspace(5e3, 2e4, 16)
    others = [kernel.replaced(parameters={name: k}) for k in stiffnesses]
    again = others[3].replaced()
    others[3].parameters[name] = 1.0
    assert again.parameters[name] == stiffnesses[3]
    others[3].parameters[name] = stiffnesses[3]
    assert kernel.parameters[name] == 1e4
    q, v = np.array([1e-3, 0.3]), np.array([0.0, 0.4])

    def motion(one: eomgen.Kernel) -> np.ndarray:
        return one.rollout(q, v, np.zeros(2), 1e-4, 3000)[0]

    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(motion, others))
    for k, found in zip(stiffnesses, together, strict=True):
        kernel.parameters[name] = float(k)
        assert (motion(kernel) == found).all()
    spring = kernel.inverse_dynamics(q, 0 * q, 0 * q) - others[0].inverse_dynamics(q, 0 * q, 0 * q)
    assert spring[0] == pytest.approx((stiffnesses[-1] - stiffnesses[0]) * q[0], rel=1e-10)
    refused(eomgen.UnknownNameError, "joint1", kernel.replaced, parameters={"joints.joint1.x.stifness": 1.0})


def test_absent_parameters_are_asked_for_quickly(built: Build) -> None:
    """No message with the nearest name is made for ``get`` and ``in``."""
    kernel = built(eomgen.load_robot("one_link"), "inverse_dynamics")
    assert kernel.parameters.get("joints.joint1.x.clearance", 7.0) == 7.0
    assert kernel.parameters.get("joints.joint1.x.stiffness", 7.0) == 1e4
    assert "joints.joint1.x.clearance" not in kernel.parameters
    with mock.patch("eomgen.runtime.parameters.nearest_or_all", side_effect=AssertionError):
        kernel.parameters.get("nothing")


AXIS = f"""
name = "axis"
{link_table("body", 1.0, inertia=(0.01, 0.01, 0.01))}
{joint_table("joint1", "base", "body", "revolute")}
"""
WOUND = {"stiffness": 300.0, "A": 1.0, "beta": 50.0, "gamma": 20.0, "n": 1.0, "share": 0.3}
BRISTLES = {"coulomb": 1.0, "static": 1.5, "gaussian": 0.1, "bristle_stiffness": 1e4, "bristle_damping": 30.0}
BRISTLES |= {"fade": 0.05}
COULOMB = {"coulomb": 1.0, "static": 1.5, "stribeck": 0.1}
STOPS = {"stiffness": 1e4, "lower": -0.5, "upper": 0.5}
LAWS = {"hysteresis": WOUND, "friction": BRISTLES, "stops": STOPS}
WORDS = {"hysteresis": 'model = "bouc_wen"', "friction": 'model = "lugre"'}


def _robot(laws: Mapping[str, Mapping[str, float]], words: Mapping[str, str] = WORDS) -> eomgen.Robot:
    tables = []
    for law, numbers in laws.items():
        named = {"gaussian": "stribeck"}
        said = [f"{named.get(key, key)} = {value!r}" for key, value in numbers.items()]
        tables.append(f"{law} = {{ {', '.join([*filter(None, [words.get(law)]), *said])} }}")
    return robot_from_toml(f"{AXIS}gamma = {{ {', '.join(tables)} }}\n")


CASES: dict[str, tuple[dict[str, float], str]] = {  # numbers that are set, and what is said
    "gamma": ({"hysteresis.gamma": -60.0}, r"gamma = -60\.0, where .*beta is 50; allowed: gamma from -beta to beta"),
    "beta": ({"hysteresis.beta": 10.0}, r"beta = 10\.0, where .*gamma is 20; allowed: gamma from -beta to beta"),
    "both": ({"hysteresis.beta": 70.0, "hysteresis.gamma": 70.1}, r"gamma = 70\.1; allowed: gamma from -beta"),
    "share": ({"hysteresis.share": 1.0}, r"share = 1\.0; allowed: share of less than 1"),
    "static": ({"friction.static": 0.9}, r"static = 0\.9, where .*coulomb is 1; allowed: static of at least coulomb"),
    "coulomb": ({"friction.coulomb": 0.0}, r"coulomb = 0\.0.*; allowed: coulomb of at least 1e-12, at which bristles"),
    "fade": ({"friction.fade": 1.0}, r"fade = 1\.0, where .*; allowed: bristle_damping or fade so low"),
    "damping": ({"friction.bristle_damping": 900.0}, r"bristle_damping = 900\.0, where .*allowed: bristle_damping or"),
    "stops": ({"stops.lower": 0.6}, r"lower = 0\.6, where .*stops\.upper is 0\.5; allowed: lower of at most upper"),
}


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_what_a_description_refuses_is_refused(name: str, dtype: str, built: Build) -> None:
    kernel = built(_robot(LAWS), dtype=dtype)
    numbers, said = CASES[name]
    full = {f"joints.joint1.gamma.{key}": x for key, x in numbers.items()} | {"gravity.x": 2.0}
    before = dict(kernel.parameters)
    refused(InputError, rf"parameters: joints\.joint1\.gamma\..*{said}", kernel.parameters.update, full)
    assert dict(kernel.parameters) == before
    if len(numbers) == 1:
        key, value = next(iter(full.items()))
        with pytest.raises(InputError, match="several at once"):
            kernel.parameters[key] = value
        assert dict(kernel.parameters) == before
    changed = {law: dict(values) for law, values in LAWS.items()}
    for key, x in numbers.items():
        law, _, number = key.partition(".")
        changed[law][number] = x
    refused(DescriptionError, "", _robot, changed)


def test_what_goes_together_is_set_at_once(built: Build) -> None:
    kernel = built(_robot(LAWS))
    name = "joints.joint1.gamma"
    wider = {f"{name}.hysteresis.beta": 80.0, f"{name}.hysteresis.gamma": -80.0}
    kernel.parameters.update(wider)
    kernel.parameters[f"{name}.hysteresis.share"] = np.nextafter(1.0, 0.0)
    kernel.parameters[f"{name}.friction.static"] = 1.0
    assert kernel.parameters[f"{name}.hysteresis.gamma"] == -80.0
    copied = kernel.parameters.copy()
    with pytest.raises(InputError, match="gamma from -beta to beta"):
        copied[f"{name}.hysteresis.beta"] = 79.0
    again = pickle.loads(pickle.dumps(kernel.parameters))
    assert dict(again) == dict(kernel.parameters)
    refused(InputError, "gamma from -beta to beta", again.update, {f"{name}.hysteresis.gamma": 81.0})


def test_conditions_are_those_of_descriptions(built: Build) -> None:
    """Random numbers: what an update takes is what a description takes."""
    kernels = [built(_robot(LAWS)), built(_robot({"friction": COULOMB}, {}))]
    rng, seen = np.random.default_rng(5), set[tuple[int, bool]]()
    for case in range(300):
        which = case % 4 == 0
        laws = {"friction": COULOMB} if which else LAWS
        changed = {law: dict(numbers) for law, numbers in laws.items()}
        values: dict[str, float] = {}
        for law, numbers in changed.items():
            for key in numbers:
                if key != "n" and rng.random() < 0.4:
                    factor = 10.0 ** rng.uniform(-1.0, 1.0) * (-1.0 if key == "gamma" and rng.random() < 0.5 else 1.0)
                    numbers[key] = values[f"joints.joint1.gamma.{law}.{key}"] = float(numbers[key] * factor)
        kernel = kernels[which].replaced()
        try:
            _robot(changed, {} if which else WORDS)
            allowed = True
        except DescriptionError:
            allowed = False
        try:
            kernel.parameters.update(values)
            taken = True
        except InputError:
            taken = False
        assert taken == allowed, values
        seen.add((int(which), taken))
    assert len(seen) == 4
