"""Bounds of rounding errors: no computed number is farther off, and the worst roundings reach them at a point."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen.codegen.kernels.equations import Equations, derive_equations
from eomgen.codegen.kernels.signatures import KERNELS
from eomgen.codegen.program.ir import Graph, Node, Program, evaluate, finish
from eomgen.errors import InputError, UnknownNameError
from eomgen.precision import RoundingBound, intervals, rounding_bound, rounding_bounds
from eomgen.precision.adjoints import Bounds, bound_outputs
from eomgen.precision.programs import output_values, with_setup
from eomgen.precision.ranges import chosen_ranges
from eomgen.precision.values import ProgramIntervals, program_intervals
from eomgen.robot.model import build_model
from tests.oracles.roundings import CALLS, exact, mp, worst_error
from tests.support.geared_arms import two_link_arm
from tests.support.refusals import refused

pytestmark = pytest.mark.quick

Array = np.ndarray[Any, Any]
REACHED = 1e-5  # of a bound may be left
QUICK = (
    ("one_link", "inverse_dynamics"),
    ("four_bar", "constraint_jacobian"),
    ("ur5", "mass_matrix"),
    ("worn_arm", "generalized_force"),
)
MORE = (
    *(("ur5", name) for name in ("inverse_dynamics", "kinematics", "energy", "regressor", "residual_jacobian")),
    *(("worn_arm", name) for name in ("inverse_dynamics", "energy", "reactions", "christoffel")),
    *(("puma560_elastic", name) for name in ("inverse_dynamics", "kinematics")),
    *(("four_bar", name) for name in ("tree_inverse_dynamics", "constraint")),
    *(("flexible_arm", name) for name in ("mass_matrix", "inverse_dynamics")),
)


@cache
def derived(robot: str, kernel: str, dtype: str = "float64") -> Equations:
    return derive_equations(build_model(eomgen.load_robot(robot)), (kernel,), dtype)


def whole(robot: str, kernel: str, dtype: str = "float64") -> Program:
    equations = derived(robot, kernel, dtype)
    return with_setup(equations.programs[kernel], equations.setup)


def states(robot: str, kernel: str, count: int, dtype: str = "float64") -> dict[str, Array]:
    """Inputs (size, count) in the usual ranges, half of them at the ends, where most errors are large."""
    model, rng = derived(robot, kernel).model, np.random.default_rng(5)
    ranges = chosen_ranges(model, KERNELS[kernel].reads, {}, dtype)
    found = {}
    for array, rows in ranges.items():
        lower, upper = (np.array(ends, np.float64).reshape(-1, 1) for ends in zip(*rows, strict=True))
        at = rng.uniform(0.0, 1.0, (len(rows), count))
        at[:, ::2] = np.clip(np.round(at[:, ::2]), 1e-3, 1.0 - 1e-3)
        found[array] = np.clip((lower + at * (upper - lower)).astype(dtype), lower, upper).astype(dtype)
    return found


def violations(bound: RoundingBound, errors: Array) -> list[str]:
    """Name outputs (outputs, states) of which an error is beyond the bound."""
    beyond = (errors > bound.bound[:, np.newaxis]).any(axis=1)
    return [name for name, is_beyond in zip(bound.outputs, beyond, strict=True) if is_beyond]


def float32_errors(robot: str, kernel: str, count: int) -> Array:
    """Least errors of single precision (outputs, states): beside double precision, less the bound of that."""
    program, narrow = whole(robot, kernel, "float32"), states(robot, kernel, count, "float32")
    wide = {name: row.astype(np.float64) for name, row in narrow.items()}
    bound = rounding_bound(robot, kernel)
    single, double = (output_values(program, x, x["q"].dtype.name, len(bound.outputs)) for x in (narrow, wide))
    return np.abs(single - double) - 1.01 * bound.bound[:, np.newaxis]


def check_float32(robot: str, kernel: str, count: int) -> None:
    bound, errors = rounding_bound(robot, kernel, dtype="float32"), float32_errors(robot, kernel, count)
    assert not violations(bound, errors)
    assert (errors > 0.0).any()


@pytest.mark.parametrize(("robot", "kernel"), QUICK)
def test_single_precision_stays_within_its_bound(robot: str, kernel: str) -> None:
    check_float32(robot, kernel, 1000)


@pytest.mark.soak
@pytest.mark.parametrize(("robot", "kernel"), [*QUICK, *MORE])
def test_single_precision_stays_within_its_bound_in_many_states(robot: str, kernel: str) -> None:
    for _ in range(4):
        check_float32(robot, kernel, 25000)


def check_exact(robot: str, kernel: str, count: int) -> None:
    """Compare double precision with long arithmetic, setup and program each by itself."""
    equations, inputs = derived(robot, kernel), states(robot, kernel, count)
    bound = rounding_bound(robot, kernel)
    computed = output_values(whole(robot, kernel), inputs, "float64", len(bound.outputs))
    errors = np.zeros((len(bound.outputs), count))
    h = exact(equations.setup, {"p": inputs["p"][:, 0]})
    constants = [h["h", place] for place in range(len(h))]
    for state in range(count):
        row: Mapping[str, Any] = {name: [mp.mpf(float(x)) for x in array[:, state]] for name, array in inputs.items()}
        true = _long(equations.programs[kernel], {**row, "h": constants})
        for (array, place), value in true.items():
            if array == "out":
                errors[place, state] = float(abs(value - mp.mpf(float(computed[place, state]))))
    assert not violations(bound, errors)
    assert (errors > 0.0).any()


def _long(program: Program, inputs: Mapping[str, Any]) -> dict[tuple[str, int], Any]:
    return evaluate(program, inputs, lambda x: (mp.sin(x), mp.cos(x)), CALLS)


@pytest.mark.parametrize(("robot", "kernel"), QUICK[:2])
def test_double_precision_stays_within_its_bound(robot: str, kernel: str) -> None:
    check_exact(robot, kernel, 100)


@pytest.mark.soak
@pytest.mark.parametrize(("robot", "kernel"), [*QUICK, *MORE])
def test_double_precision_stays_within_its_bound_in_more_states(robot: str, kernel: str) -> None:
    check_exact(robot, kernel, 200)


def at_point(program: Program, inputs: Mapping[str, Array], dtype: str = "float64") -> ProgramIntervals:
    ends = {name: [(np.array([float(x)]), np.array([float(x)])) for x in row[:, 0]] for name, row in inputs.items()}
    return program_intervals(program, dtype, ends)


def reached(bound: float, error: float) -> bool:
    """Whether the worst roundings stay within a bound and leave next to nothing of it."""
    return bound * (1.0 - REACHED) <= error <= bound


def check_reached(robot: str, kernel: str) -> int:
    program, inputs = whole(robot, kernel), states(robot, kernel, 1)
    found = at_point(program, inputs)
    outputs = sorted({index for index in program.outputs.values() if found.obstacles[index] < 0})
    bounds: Bounds = bound_outputs(found, outputs)
    column = {name: row[:, 0] for name, row in inputs.items()}
    for place in np.argsort(-bounds.plain)[:6]:
        for fused, limit in ((False, bounds.plain[place]), (True, bounds.fused[place])):
            error = worst_error(program, column, outputs[place], fused=fused)
            assert reached(float(limit), error), (outputs[place], fused, error / limit)
    return len(outputs)


@pytest.mark.parametrize(("robot", "kernel"), [("one_link", "inverse_dynamics"), ("four_bar", "mass_matrix")])
def test_worst_roundings_reach_the_bound_at_a_point(robot: str, kernel: str) -> None:
    assert check_reached(robot, kernel) > 0


@pytest.mark.soak
@pytest.mark.parametrize(
    ("robot", "kernel"),
    [*(("ur5", x) for x in ("inverse_dynamics", "mass_matrix", "energy")), ("worn_arm", "inverse_dynamics")],
)
def test_worst_roundings_reach_bounds_of_larger_programs(robot: str, kernel: str) -> None:
    assert check_reached(robot, kernel) > 0


def test_a_rounding_that_is_left_out_is_noticed() -> None:
    program, inputs = whole("one_link", "inverse_dynamics"), states("one_link", "inverse_dynamics", 1)
    output = program.outputs["out", 0]
    error = worst_error(program, {name: row[:, 0] for name, row in inputs.items()}, output)
    noticed = 0
    for index in range(len(program.instructions)):
        found = at_point(program, inputs)
        before = float(bound_outputs(found, [output]).plain[0])
        found.rounding[index] = np.zeros(1)
        after = float(bound_outputs(found, [output]).plain[0])
        assert reached(before, error)
        if before - after > 2.0 * REACHED * before:
            noticed += not reached(after, error)
            assert error > after
    assert noticed > 5


@pytest.mark.parametrize("name", ["sqrt", "exp", "log"])
def test_intervals_of_growing_functions_hold_the_exact_ends(name: str) -> None:
    """And are wider by a few units in the last place alone."""
    ends = np.array([1e-3, 0.1, 0.7, 1.5, 7.0, 300.0])
    lower, upper = getattr(intervals, name)((ends[:-1], ends[1:]))
    for computed, x, sign in ((lower, ends[:-1], 1.0), (upper, ends[1:], -1.0)):
        beyond = [float(sign * (CALLS[name](mp.mpf(one)) - mp.mpf(y))) for one, y in zip(x, computed, strict=True)]
        assert min(beyond) > 0.0
        assert (beyond <= 2e-15 * np.abs(computed)).all()


def graph_program(write: Any) -> Program:
    graph = Graph()
    value = write(graph, *(graph.input("q", i) for i in range(3)))
    return finish(graph, "made", {("out", 0): value})


def enclosed(write: Any, *ends: tuple[float, float]) -> tuple[Program, ProgramIntervals]:
    program = graph_program(write)
    rows = [(np.array([lower]), np.array([upper])) for lower, upper in (*ends, *[(0.0, 0.0)] * 3)]
    return program, program_intervals(program, "float64", {"q": rows})


REFUSED = {
    "division by what is in": lambda g, x, y, z: x / y,
    "square root of what is in": lambda g, x, y, z: g.call("sqrt", x),
    "logarithm of what is in": lambda g, x, y, z: g.call("log", x),
    "atan2 of": lambda g, x, y, z: g.call("atan2", x, y),
    "step at the sign": lambda g, x, y, z: g.call("step", x + y),
    "choose at the sign": lambda g, x, y, z: g.choose(x * y, x, y),
    "may be no number of float64": lambda g, x, y, z: g.call("exp", 1e3 * x),
}


@pytest.mark.parametrize("words", REFUSED)
def test_what_has_no_bound_is_refused_by_name(words: str) -> None:
    program, found = enclosed(REFUSED[words], (-1.0, 2.0), (-1.0, 3.0))
    obstacle = found.obstacles[program.outputs["out", 0]]
    assert obstacle >= 0
    assert words in found.reasons[obstacle]
    assert "[" in found.reasons[obstacle]


def beside_its_sine(graph: Graph, x: Node, y: Node, z: Node) -> Any:
    """Write cos a - a sin a, whose slopes by a add up where those of a rotation would not."""
    angle = x + y
    sine, cosine = graph.sincos(angle)
    return cosine - angle * sine


KEPT = {
    "an angle beside its own sine": (beside_its_sine, (1.56, 1.561), (0.005, 0.0051)),
    "a step of an input": (lambda g, x, y, z: g.call("step", x) * y, (-1.0, 1.0), (1.0, 2.0)),
    "a choice by an input": (lambda g, x, y, z: g.choose(x, y * y, y), (-1.0, 1.0), (1.0, 2.0)),
    "a size": (lambda g, x, y, z: g.call("abs", x * y), (-3.0, 3.0), (1.0, 2.0)),
    "the larger of two": (lambda g, x, y, z: g.call("max", x * y, y * y), (-3.0, 3.0), (1.0, 2.0)),
    "a square in a root": (lambda g, x, y, z: g.call("sqrt", x * x + 1.0), (-3.0, 3.0)),
    "an angle off its cut": (lambda g, x, y, z: g.call("atan2", x, y), (-3.0, 3.0), (1.0, 2.0)),
    "an exponential": (lambda g, x, y, z: g.call("exp", x * y), (-3.0, 3.0), (1.0, 2.0)),
}


@pytest.mark.parametrize("case", KEPT)
def test_signs_and_functions_are_bounded_where_they_can_be(case: str) -> None:
    write, *ends = KEPT[case]
    program, found = enclosed(write, *ends)
    output = program.outputs["out", 0]
    bound = float(bound_outputs(found, [output]).plain[0])
    rng, errors = np.random.default_rng(1), []
    for _ in range(30):
        q = [*(rng.uniform(*pair) for pair in ends), *[0.0] * 3]
        errors.append(worst_error(program, {"q": q}, output))
    assert 0.0 < max(errors) <= bound
    assert bound < 100.0 * max(errors)


def test_a_product_of_two_sums_is_fused_in_one_use_or_the_other() -> None:
    def write(graph: Graph, x: Node, y: Node, z: Node) -> Any:
        product = x * y
        return (product + z) * (z - product)

    program, found = enclosed(write, (0.6, 0.6), (1.7, 1.7), (2.1, 2.1))
    output, q = program.outputs["out", 0], {"q": [0.6, 1.7, 2.1]}
    bounds = bound_outputs(found, [output])
    for fused, limit in ((False, bounds.plain[0]), (True, bounds.fused[0])):
        assert reached(float(limit), worst_error(program, q, output, fused=fused))
    assert bounds.fused[0] > 1.05 * bounds.plain[0]


def test_ranges_are_narrowed_by_their_names() -> None:
    wide = rounding_bound("ur5", "gravity")
    joints = dict.fromkeys(build_model(eomgen.load_robot("ur5")).coordinates, (0.1, 0.1))
    narrow = rounding_bound("ur5", "gravity", joints)
    assert (narrow.bound <= wide.bound).all()
    assert narrow.bound.sum() < 0.5 * wide.bound.sum()
    assert set(narrow.ranges.values()) == {(0.1, 0.1)}
    assert rounding_bound("ur5", "gravity", {"q": (0.1, 0.1)}).bound.tolist() == narrow.bound.tolist()


def test_parameters_have_ranges_too() -> None:
    name = "joints.joint1.x.stiffness"
    usual, stiffer = (rounding_bound("one_link", "inverse_dynamics", x) for x in ({}, {name: (1e4, 1e9)}))
    assert stiffer.bound[0] > 10.0 * usual.bound[0]
    assert stiffer.ranges[name] == (1e4, 1e9)


def test_unknown_names_and_ends_that_are_no_range_are_refused() -> None:
    refused(InputError, "composed of 'constrained_drives'", rounding_bound, "four_bar", "inverse_dynamics")
    refused(UnknownNameError, "kernel 'dynamics'", rounding_bound, "one_link", "dynamics")
    refused(UnknownNameError, "range of 'joint9'", rounding_bound, "one_link", "gravity", {"joint9": (0.0, 1.0)})
    refused(InputError, "the least first", rounding_bound, "one_link", "gravity", {"q": (1.0, 0.0)})
    refused(InputError, "not two numbers", rounding_bound, "one_link", "gravity", {"q": (1.0,)})
    refused(InputError, "dtype 'float16'", rounding_bound, "one_link", "gravity", dtype="float16")


def test_solutions_are_bounded_where_no_pivot_may_vanish() -> None:
    assert np.isfinite(rounding_bound("one_link", "forward_dynamics").bound).all()
    narrow = dict.fromkeys(("q", "v", "u"), (0.5, 0.5 + 1e-06))
    assert (rounding_bound("ur5", "forward_dynamics", narrow).relative < 1e-8).all()
    wide = rounding_bound("ur5", "forward_dynamics")
    assert np.isinf(wide.bound).all()
    assert set(wide.refused) == set(wide.outputs)
    assert all("division by what is in [" in reason for reason in wide.refused.values())
    assert "joint1.gamma and 5 outputs more: no bound: div " in str(wide)


def test_the_callers_ranges_are_never_narrowed() -> None:
    """Deflections of gears are +-0.01 by default, and anything where the caller gives the motors a range."""
    arm = two_link_arm()
    given = {"joint1.motor": (-300.0, 300.0), "joint1.gamma": (-3.0, 3.0)}
    usual = rounding_bound(arm, "inverse_dynamics")
    assert usual.ranges["deflection:joint1"] == usual.ranges["deflection:joint2"] == (-0.01, 0.01)
    wide = rounding_bound(arm, "inverse_dynamics", given)
    assert {name: wide.ranges[name] for name in given} == given
    assert "deflection:joint1" not in wide.ranges
    assert wide.bound[0] > 5.0 * usual.bound[0]
    everywhere = rounding_bound(arm, "inverse_dynamics", {"q": (-1.5, 1.5)})
    assert {everywhere.ranges[name] for name in build_model(arm).coordinates} == {(-1.5, 1.5)}
    assert not [name for name in everywhere.ranges if name.startswith("deflection:")]


@pytest.mark.parametrize("kernel", ["inverse_dynamics", "generalized_force"])
def test_states_anywhere_in_the_callers_ranges_are_within_the_bound(kernel: str) -> None:
    """Motors anywhere, whose gears are deflected by radians."""
    arm, ranges = two_link_arm(), {"q": (-3.0, 3.0)}
    equations = derive_equations(build_model(arm), (kernel,))
    program, rng = with_setup(equations.programs[kernel], equations.setup), np.random.default_rng(2)
    bound = rounding_bound(arm, kernel, ranges)
    inputs = {name: rng.uniform(-x, x, (4, 40)) for name, x in (("q", 3.0), ("v", 3.0), ("a", 10.0))}
    inputs["p"] = np.repeat([[float(x)] for x in equations.model.parameters.values()], 40, axis=1)
    computed, errors = output_values(program, inputs, "float64", 4), np.zeros((4, 40))
    for state in range(40):
        true = exact(program, {name: rows[:, state] for name, rows in inputs.items()})
        for (_, place), value in true.items():
            errors[place, state] = float(abs(value - mp.mpf(float(computed[place, state]))))
    assert not violations(bound, errors)
    assert (errors > rounding_bound(arm, kernel).bound[:, np.newaxis]).any()  # of deflections of +-0.01


def test_deflections_are_ranges_of_gears() -> None:
    arm = two_link_arm()
    bounds = [
        rounding_bound(arm, "inverse_dynamics", ranges, dtype="float32").bound[2]
        for ranges in ({"deflection:joint2": (-1e-3, 1e-3)}, {}, {"deflection:joint2": (-10.0, 10.0)})
    ]
    assert bounds[0] < bounds[1] < 0.3 * bounds[2]
    found = rounding_bound(arm, "inverse_dynamics", {"deflection:joint2": (-1e-3, 1e-3)})
    assert found.ranges["deflection:joint2"] == (-1e-3, 1e-3)
    assert found.ranges["deflection:joint1"] == (-0.01, 0.01)
    assert found.size[2] < 0.95 * rounding_bound(arm, "inverse_dynamics").size[2]
    both = rounding_bound(arm, "inverse_dynamics", {"q": (-1.5, 1.5), "deflection:joint1": (-0.01, 0.01)})
    assert both.ranges["joint1.gamma"] == (-1.5, 1.5)
    assert both.ranges["joint1.motor"][1] == pytest.approx(151.0)
    with pytest.raises(UnknownNameError, match="range of 'deflection:joint3'"):
        rounding_bound(arm, "inverse_dynamics", {"deflection:joint3": (0.0, 1.0)})


def test_premises_are_told() -> None:
    found = rounding_bounds("one_link", ["gravity"])
    assert "rounding at generation adds at most 1e-12 relative and is not counted" in str(found)
    assert len(found.as_dict()["kernels"]["gravity"]["premises"]) == 3


def test_all_kernels_are_bounded_or_left_out_by_name() -> None:
    found = rounding_bounds("one_link")
    assert {"forward_dynamics", "inverse_dynamics", "mass_matrix"} <= found.kernels.keys()
    assert found.left_out["rollout"].startswith("composed of ")
    assert "regressor of one_link" in "\n".join(found.lines())
    assert found.as_dict()["kernels"]["energy"]["outputs"]


@pytest.mark.soak
@pytest.mark.parametrize(("robot", "kernel"), [("ur5", "inverse_dynamics"), ("ur5", "mass_matrix")])
def test_bounds_are_near_what_happens(robot: str, kernel: str) -> None:
    bound, errors = rounding_bound(robot, kernel, dtype="float32"), float32_errors(robot, kernel, 2000)
    largest = errors.max(axis=1)
    ratios = bound.bound[largest > 0.0] / largest[largest > 0.0]
    assert np.median(ratios) < 100.0
