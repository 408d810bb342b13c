"""Single precision: what it costs a robot and where it comes from, and instructions in double precision that help."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen.codegen.c.scalar_types import SCALARS
from eomgen.codegen.c.statements import write_function
from eomgen.codegen.kernels.equations import Equations, derive_equations
from eomgen.codegen.program.ir import Graph, Node, Program, finish
from eomgen.codegen.program.mixed import in_double, with_wide
from eomgen.codegen.program.numeric import evaluate_lanes
from eomgen.errors import InputError, UnknownNameError
from eomgen.pipeline.single_precision import with_notes
from eomgen.pipeline.stages import Options, load_kernel, make_package, make_source
from eomgen.progress import no_report
from eomgen.robot.model import build_model
from eomgen.robot.value import Robot
from eomgen.rounding import Float32Advice, Float32Errors, float32_advice, rounding_bound
from eomgen.rounding.adjoints import bound_outputs
from eomgen.rounding.advice_result import vanishing
from eomgen.rounding.enclosures import enclose
from eomgen.rounding.mixing import mixed
from eomgen.rounding.whole import with_setup
from tests.oracles.pinocchio_models import PinocchioOracle
from tests.oracles.roundings import worst_error
from tests.support.geared_arms import two_link_arm
from tests.support.random_robots import random_robot, seeds
from tests.support.refusals import refused

pytestmark = pytest.mark.quick

INVERSE = "inverse_dynamics"
WITHIN = 1e-5
REACHED = 1e-5  # of a bound may be left


def at_point(program: Program, inputs: Mapping[str, Any], output: int) -> float:
    """The bound of an output at one point."""
    rows = {name: [(np.array([float(x)]), np.array([float(x)])) for x in row] for name, row in inputs.items()}
    return float(bound_outputs(enclose(program, "float32", rows), [output]).plain[0])


def difference(graph: Graph, x: Node, y: Node, z: Node) -> Any:
    """Write k (x / 64 - y)^3 with a friction's root, and a stop: what cancels, sines, signs and choices."""
    deflection = 0.015625 * x - y
    sine, cosine = graph.sincos(deflection + z)
    pressed = graph.call("max", deflection * sine, 0.25 * y)
    force = 1024.0 * deflection * (1.0 + deflection * deflection) + cosine / graph.call("sqrt", z * z + 0.5)
    return graph.choose(z, force - pressed, pressed) + sine * x


def made() -> Program:
    graph = Graph()
    value = difference(graph, *(graph.input("q", i) for i in range(3)))
    return finish(graph, "made", {("out", 0): value})


@pytest.mark.parametrize("seed", range(12))
def test_worst_roundings_reach_the_bound_at_a_point(seed: int) -> None:
    """Whatever is in double precision: a conversion that was left out would leave a part of the bound, or go beyond."""
    rng, plain = np.random.default_rng(seed), made()
    free = [i for i, x in enumerate(plain.instructions) if x.args and i not in plain.outputs.values()]
    program = with_wide(plain, rng.choice(free, seed, replace=False).tolist())
    q = [float(np.float32(x)) for x in (80.0, 1.2 + 0.1 * rng.uniform(), rng.uniform(0.1, 1.0))]
    output = program.outputs["out", 0]
    bound, error = at_point(program, {"q": q}, output), worst_error(program, {"q": q}, output, dtype="float32")
    assert bound * (1.0 - REACHED) <= error <= bound


def test_double_precision_takes_what_it_is_chosen_for() -> None:
    plain = made()
    cancelling = next(i for i, x in enumerate(plain.instructions) if x.op == "sub")
    above = {i for i, x in enumerate(plain.instructions) if x.op in ("add", "mul") and cancelling in x.args}
    product = plain.instructions[cancelling].args[0]
    program = with_wide(plain, {cancelling, product, *above})
    double = in_double(program)
    assert {x for x in double if x in program.wide} == program.wide - {
        i for i, x in enumerate(program.instructions) if not x.args
    }
    q = {"q": [77.3, 1.2, 0.5]}
    less, more = (at_point(x, q, x.outputs["out", 0]) for x in (program, plain))
    assert less < more
    text = "\n".join(write_function(program, SCALARS["float32"]).chunks[0])
    assert re.search(r"const double t\d+ = 0\.015625\*\(double\)q\[0\] - \(double\)q\[1\];", text)
    assert re.search(r"\(float\)\(t\d+\*t\d+ \+ 1\.0\)", text)
    assert "out[0] = " in text


def test_wide_values_are_never_written() -> None:
    plain = made()
    program = with_wide(plain, range(len(plain.instructions)))
    assert not program.wide & set(program.outputs.values())
    assert in_double(program)


@cache
def arm() -> Robot:
    return two_link_arm((4e4, 2e4))


@cache
def equations(dtype: str, within: float | None = None) -> Equations:
    found = derive_equations(build_model(arm()), (INVERSE,), dtype)
    return found if within is None else mixed(found, within, {})


def torques(dtype: str, states: Mapping[str, Any], within: float | None = None) -> Any:
    """Inverse dynamics of the arm, (outputs, states)."""
    found = equations(dtype, within)
    program = with_setup(found.programs[INVERSE], found.setup)
    values = np.array([*found.model.parameters.values(), *[0.0] * len(found.model.turning)])
    inputs = {**states, "p": np.repeat(values[:, None], states["q"].shape[1], axis=1)}
    given = {name: row.astype(dtype) for name, row in inputs.items()}
    return evaluate_lanes(program, given, dtype)["out"].astype(np.float64)


def gripping(count: int) -> dict[str, Any]:
    """States in which gears are deflected by a milliradian at most, as they are."""
    rng = np.random.default_rng(4)
    q = rng.uniform(-3.0, 3.0, (4, count))
    q[1::2] = 100.0 * (q[::2] + rng.uniform(-1e-3, 1e-3, (2, count)))
    states = {"q": q, "v": rng.uniform(-3.0, 3.0, (4, count)), "a": rng.uniform(-10.0, 10.0, (4, count))}
    return {name: row.astype(np.float32).astype(np.float64) for name, row in states.items()}


def test_a_few_operations_in_double_take_the_error_of_elastic_gears() -> None:
    states = gripping(300)
    exact = torques("float64", states)
    single, some = (np.abs(torques("float32", states, x) - exact).max(axis=1) for x in (None, WITHIN))
    program = equations("float32", WITHIN).programs[INVERSE]
    share = len(in_double(program)) / sum(bool(x.args) for x in program.instructions)
    assert 0.0 < share < 0.4
    at = [build_model(arm()).coordinates.index(f"joint{i}.gamma") for i in (1, 2)]
    assert (some[at] < 0.05 * single[at]).all()
    assert (some <= single).all()


@pytest.mark.parametrize("robot", [two_link_arm((4e4, 2e4)), "geared_arm"])
def test_bounds_are_within_what_is_asked_for(robot: Robot | str) -> None:
    """The second robot has clearance in a gear: signs and choices of what is in double precision are, too."""
    errors = [float32_advice(robot, (INVERSE,), within=x).kernels[INVERSE] for x in (None, WITHIN)]
    assert errors[0].relative.max() > WITHIN >= errors[1].relative.max()
    assert errors[0].in_double == 0 < errors[1].in_double < errors[1].operations
    assert (errors[1].observed <= errors[1].bound + 1e-13 * errors[1].size).all()
    assert f"{errors[1].in_double} of {errors[1].operations} operations in double" in errors[1].summary()


@pytest.mark.soak
@pytest.mark.parametrize("seed", seeds(0, 10, 100))
def test_errors_of_random_gears_shrink(seed: int) -> None:
    rng = np.random.default_rng(seed)
    one, other = (10.0 ** rng.uniform(3.5, 5.5, 2)).tolist()
    plain, some = (
        float32_advice(two_link_arm((one, other)), (INVERSE,), within=x).kernels[INVERSE] for x in (None, 1e-6)
    )
    assert 0.0 < some.relative_observed.max() < 0.1 * plain.relative_observed.max()
    assert some.relative.max() < 0.1 * plain.relative.max()


@pytest.mark.soak
@pytest.mark.parametrize("seed", seeds(0, 6, 100))
def test_bounds_and_errors_of_random_robots_shrink(seed: int) -> None:
    robot = random_robot(seed)
    errors = [float32_advice(robot, (INVERSE, "mass_matrix"), within=x) for x in (None, 1e-6)]
    for name in (INVERSE, "mass_matrix"):
        plain, some = (found.kernels[name] for found in errors)
        assert (some.observed <= some.bound + 1e-13 * some.size).all()
        assert some.relative[np.isfinite(some.relative)].max() <= plain.relative[np.isfinite(plain.relative)].max()
        counts = ~vanishing(plain.size)
        assert (some.relative_observed[counts] <= plain.relative_observed[counts] + 2.0**-22).all()  # last places


def test_compiled_code_has_the_numbers_of_the_program() -> None:
    """Every package is compared with its samples to the bit before it is used; errors shrink as they do there."""
    options = Options((INVERSE,), "float32", within=WITHIN, flags=("-Werror",))
    kernel = load_kernel(make_package(arm(), options), arm().name)
    states = gripping(40)
    given = [np.ascontiguousarray(states[name].T.astype(np.float32)) for name in ("q", "v", "a")]
    computed, program = kernel.inverse_dynamics(*given).T, torques("float32", states, WITHIN)
    exact = torques("float64", states)
    unit = 2.0**-22 * np.abs(exact).max(axis=1, keepdims=True)  # sines are 2.5 units off at most
    assert (np.abs(computed - program) <= unit).all()
    assert np.abs(computed - exact).max() < 0.05 * np.abs(torques("float32", states) - exact).max()


@pytest.mark.soak
@pytest.mark.parametrize(
    ("robot", "kernel"), [("ur5", "mass_matrix"), ("worn_arm", "energy"), ("puma560_elastic", "mass_matrix")]
)
def test_larger_kernels_compile_without_warnings(robot: str, kernel: str) -> None:
    """Sines in double, choices, and programs in several parts, which hand on numbers of both precisions."""
    options = Options((kernel,), "float32", within=1e-6, flags=("-Werror",))
    made = load_kernel(make_package(eomgen.load_robot(robot), options), robot)
    assert kernel in made.operations


def test_options_are_of_single_precision() -> None:
    refused(InputError, "within: given with dtype 'float64'; allowed: with 'float32'", Options, within=1e-6)
    with pytest.raises(InputError, match=r"within: 1e-09; allowed: an error by the size of results, from 1\.2e-07"):
        Options(dtype="float32", within=1e-9)
    refused(InputError, "ranges: given with dtype 'float64'", Options, ranges=(("q", 0.0, 1.0),))


def test_what_is_in_double_is_in_the_key_of_the_source() -> None:
    robot = eomgen.load_robot("one_link")
    texts = {make_source(robot, Options((INVERSE,), "float32", within=x)).code for x in (None, 3e-7, 2e-7)}
    assert len(texts) > 1
    assert replace(Options(dtype="float32"), within=1e-6) != Options(dtype="float32")


@cache
def advice(robot: str, *kernels: str) -> Float32Advice:
    return float32_advice(robot, kernels)


def within_bounds(errors: Float32Errors) -> bool:
    """Whether no error was seen beyond its bound; double precision's own is in the margin."""
    return bool((errors.observed <= errors.bound + 1e-13 * errors.size).all())


@pytest.mark.parametrize("robot", ["one_link", "geared_arm"])
def test_observed_errors_are_within_bounds(robot: str) -> None:
    for kernel in (INVERSE, "mass_matrix", "energy", "kinematics"):
        errors = advice(robot, INVERSE, "mass_matrix", "energy", "kinematics").kernels[kernel]
        assert within_bounds(errors), kernel
        assert errors.observed.max() > 0.0


@pytest.mark.soak
@pytest.mark.parametrize("seed", seeds(0, 8, 200))
def test_observed_errors_of_random_robots_are_within_bounds(seed: int) -> None:
    robot = random_robot(seed)
    found = float32_advice(robot, (INVERSE, "mass_matrix", "bias_force"))
    for errors in found.kernels.values():
        assert within_bounds(errors), (seed, errors.kernel)
        assert sum(errors.sources.values()) == pytest.approx(1.0) or errors.worst is None


def test_single_precision_is_within_its_bound_beside_pinocchio() -> None:
    """Pinocchio computes with the numbers of the description; single precision rounds them, too."""
    robot = eomgen.load_robot("ur5")
    oracle, errors = PinocchioOracle(robot), advice("ur5", INVERSE).kernels[INVERSE]
    equations = derive_equations(build_model(robot), (INVERSE,), "float32")
    program = with_setup(equations.programs[INVERSE], equations.setup)
    rng, p = np.random.default_rng(1), np.array(list(equations.model.parameters.values()), np.float32)
    worst = np.zeros(6)
    for _ in range(50):
        q, v, a = (rng.uniform(-x, x, 6).astype(np.float32) for x in (3.0, 3.0, 10.0))
        inputs = {"q": q[:, None], "v": v[:, None], "a": a[:, None], "p": p[:, None]}
        single = evaluate_lanes(program, inputs, "float32")["out"][:, 0]
        exact = oracle.inverse_dynamics(*(x.astype(np.float64) for x in (q, v, a)))
        worst = np.maximum(worst, np.abs(single - exact))
    assert (worst <= errors.bound + 1e-10).all()
    assert (worst > 1e-3 * errors.bound).all()


def test_a_stiff_gear_is_named_and_its_part_grows_with_it() -> None:
    """A deflection is a small difference of large angles: the spring makes a torque of its rounding."""
    bounds = []
    for stiffness in (1e3, 1e5):
        found = float32_advice(two_link_arm((2000.0, stiffness)), (INVERSE,)).kernels[INVERSE]
        bounds.append(found.bound[found.outputs.index("joint2.gamma")])
        parts = {name: part for name, part in found.sources.items() if "joints.joint2.motor.stiffness" in name}
    assert bounds[1] > 30.0 * bounds[0]
    assert found.worst in ("joint2.gamma", "joint2.motor")
    assert sum(parts.values()) > 0.5
    assert sum(found.sources.values()) == pytest.approx(1.0)
    assert next(iter(found.sources)) in parts


def test_deflections_are_ranges_of_gears() -> None:
    """A bound over all angles of a motor alone is of deflections that no gear has."""
    arm = two_link_arm()
    bounds = [
        rounding_bound(arm, INVERSE, ranges, dtype="float32").bound[2]
        for ranges in ({"deflection:joint2": (-1e-3, 1e-3)}, {}, {"deflection:joint2": (-10.0, 10.0)})
    ]
    assert bounds[0] < bounds[1] < 0.3 * bounds[2]
    found = rounding_bound(arm, INVERSE, {"deflection:joint2": (-1e-3, 1e-3)})
    assert found.ranges["deflection:joint2"] == (-1e-3, 1e-3)
    assert found.ranges["deflection:joint1"] == (-0.01, 0.01)
    everywhere = rounding_bound(arm, INVERSE, {"q": (-1.5, 1.5)})
    assert everywhere.ranges["joint1.gamma"] == (-1.5, 1.5)
    assert everywhere.ranges["joint1.motor"][1] == pytest.approx(151.0)
    assert everywhere.size.min() > 0.0
    assert found.size[2] < 0.95 * rounding_bound(arm, INVERSE).size[2]
    with pytest.raises(UnknownNameError, match="range of 'deflection:joint3'"):
        rounding_bound(arm, INVERSE, {"deflection:joint3": (0.0, 1.0)})


@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_deflected_gears_are_within_their_bounds(sense: float) -> None:
    """Whichever way the motor turns, at the ends of the deflection as well."""
    arm = two_link_arm()
    joints = [replace(x, motor=replace(x.motor, ratio=sense * x.motor.ratio)) for x in arm.joints if x.motor]
    errors = float32_advice(replace(arm, joints=tuple(joints)), (INVERSE,)).kernels[INVERSE]
    assert within_bounds(errors)
    assert (errors.bound < 4.0 * errors.observed).all()


def test_numbers_that_single_precision_holds_cost_less() -> None:
    """A parameter that float32 holds exactly adds nothing by itself."""
    robot = two_link_arm()
    held = robot.with_value("links.link1.mass", 4.0)
    other = robot.with_value("links.link1.mass", 4.0 + 2.0**-23)
    tunable = [replace(x, tunable=("links.link1.mass",)) for x in (held, other)]
    first, second = (float32_advice(x, ("mass_matrix",)).kernels["mass_matrix"].bound[0] for x in tunable)
    assert 0.0 < first < second


def test_kernels_that_solve_are_observed_alone() -> None:
    errors = advice("one_link", "forward_dynamics").kernels["forward_dynamics"]
    assert np.isnan(errors.bound).all()
    assert 0.0 < errors.relative_observed.max() < 1e-4
    assert errors.units == ("m/s^2", "rad/s^2")
    assert "bound" not in errors.summary()


def test_what_is_composed_is_left_out_by_name() -> None:
    found = advice("four_bar", INVERSE, "tree_inverse_dynamics")
    assert found.left_out == {INVERSE: "composed of 'constrained_drives'"}
    assert set(found.kernels) == {"tree_inverse_dynamics"}


def test_wrong_names_and_errors_are_refused() -> None:
    refused(UnknownNameError, "kernel 'torque' is not one of this robot's", float32_advice, "one_link", ("torque",))
    refused(UnknownNameError, r"range of 'joint9\.gamma'", float32_advice, "one_link", (), {"joint9.gamma": (0.0, 1.0)})
    for within in (1e-9, 2.0, True, "1e-6"):
        with pytest.raises(InputError, match=r"within: .*allowed: an error by the size of results, from 1\.2e-07 to 1"):
            float32_advice("one_link", (), within=within)  # type: ignore[arg-type]


def test_results_say_themselves() -> None:
    found = advice("one_link", INVERSE, "mass_matrix")
    values = json.loads(json.dumps(found.as_dict()))
    outputs = values["kernels"][INVERSE]["outputs"]
    assert outputs["joint1.gamma"]["unit"] == "N m"
    assert outputs["joint1.x"]["unit"] == "N"
    assert outputs["joint1.gamma"]["bound"] >= outputs["joint1.gamma"]["observed"] > 0.0
    assert "joint1.gamma is off by at most" in str(found)
    lines = "\n".join(found.lines())
    assert "joint1.gamma, joint1.gamma, kg m^2" in lines
    assert "comes from:" in lines


def test_a_package_says_what_single_precision_costs() -> None:
    robot = eomgen.load_robot("one_link")
    source = make_source(robot, Options((INVERSE,), "float32"))
    files = {"one_link.h": source.header.encode(), "one_link.json": source.meta.encode(), "one_link.c": b""}
    noted = with_notes(robot, (INVERSE,), files, no_report)
    about = json.loads(noted["one_link.json"])["float32"]
    facts = advice("one_link", INVERSE).kernels[INVERSE].facts_of_worst()
    assert about == {INVERSE: json.loads(json.dumps(facts))}
    assert about[INVERSE]["observed"] <= about[INVERSE]["bound"]
    comment = noted["one_link.h"].decode().split("*/")[0]
    assert f" * {advice('one_link', INVERSE).kernels[INVERSE].summary()}\n" in comment
    assert json.loads(files["one_link.json"]).items() < json.loads(noted["one_link.json"]).items()
    assert noted["one_link.c"] == b""
