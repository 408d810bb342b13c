"""Time derivatives of programs, beside differences of the programs themselves in arithmetic of 60 digits."""

from __future__ import annotations

import itertools
import os
import subprocess
import sys
import textwrap
from collections.abc import Callable, Mapping, Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

import mpmath
import numpy as np
import pytest

import eomgen
from eomgen.codegen.kernels.derivatives.whole import whole_program
from eomgen.codegen.kernels.derived import MOTION, ORDERS, jet_series
from eomgen.codegen.kernels.equations import derive
from eomgen.codegen.kernels.signatures import KERNELS, available
from eomgen.codegen.program.forward_mode import tangent
from eomgen.codegen.program.ir import Graph, Program, evaluate, finish
from eomgen.codegen.program.passes import run_passes
from eomgen.codegen.program.rotations import find_rotations
from eomgen.codegen.program.taylor import jet
from eomgen.robot.model import Model, build_model
from eomgen.robot.value import Robot
from tests.codegen.program.test_reverse_mode import every_operation, robot_of
from tests.support.bending_robots import bent
from tests.support.bristles import stateful_arm
from tests.support.random_robots import random_robot, seeds
from tests.support.soak import soaked

OTHERS = ("z", "u", "forces")  # arrays beside motions
OF_MOTIONS = ("inverse_dynamics", "forward_dynamics", "energy", "mass_matrix", "residual", "kinematics")
MATRICES = ("forward_dynamics_jacobian", "christoffel", "residual_jacobian")
NUMBERS = {"sqrt": mpmath.sqrt, "exp": mpmath.exp, "log": mpmath.log, "atan2": mpmath.atan2}
DIGITS, STEP = 60, "1e-10"
STENCILS = (  # central differences of an even order of accuracy, by the order of the derivative: numbers at -3 h to 3 h
    (0, 0, 0, 1, 0, 0, 0),
    ("-1/60", "3/20", "-3/4", 0, "3/4", "-3/20", "1/60"),
    ("1/90", "-3/20", "3/2", "-49/18", "3/2", "-3/20", "1/90"),
    ("1/8", -1, "13/8", 0, "-13/8", 1, "-1/8"),
    ("-1/6", 2, "-13/2", "28/3", "-13/2", 2, "-1/6"),
)


def turned(x: Any) -> tuple[Any, Any]:
    return mpmath.sin(x), mpmath.cos(x)


def differences(
    program: Program,
    series: Mapping[str, Sequence[Sequence[float]]],
    constant: Mapping[str, Sequence[float]],
    order: int,
) -> list[dict[tuple[str, int], Any]]:
    """Time derivatives of the outputs, order 0 first, where each array moves by its Taylor polynomial."""
    with mpmath.workdps(DIGITS):
        h, found = mpmath.mpf(STEP), []
        values = []
        for k in range(-3, 4):
            t = k * h
            inputs: dict[str, Any] = {name: list(map(mpmath.mpf, x)) for name, x in constant.items()}
            for name, rows in series.items():
                inputs[name] = [
                    sum(mpmath.mpf(float(x)) * t**i / mpmath.factorial(i) for i, x in enumerate(column))
                    for column in zip(*rows, strict=True)
                ]
            values.append(evaluate(program, inputs, turned, NUMBERS))
        for stencil in STENCILS[: order + 1]:
            weights = [mpmath.mpf(Fraction(w).numerator) / Fraction(w).denominator for w in stencil]
            power = h ** len(found)
            found.append(
                {key: sum(w * x[key] for w, x in zip(weights, values, strict=True)) / power for key in values[0]}
            )
        return found


def agree(
    program: Program,
    series: Mapping[str, Sequence[Sequence[float]]],
    constant: Mapping[str, Sequence[float]],
    order: int,
) -> None:
    """The jet of a program and differences of it agree to 1e-12 of the largest number of each order."""
    names = jet_series(sorted(series), order)
    made = run_passes(jet(program, names, order, "jet"))
    inputs: dict[str, Any] = dict(constant)
    for name, arrays in names.items():
        inputs |= dict(zip(arrays, series[name], strict=True))
    found, exact = evaluate(made, inputs), differences(program, series, constant, order)
    size = 1 + max(place for array, place in program.outputs if array == "out")
    for k, wanted in enumerate(exact):
        largest = max(abs(float(x)) for (array, _), x in wanted.items() if array == "out")
        for (array, place), x in wanted.items():
            if array == "out":
                assert abs(found["out", k * size + place] - float(x)) <= 1e-12 * max(largest, 1.0), (k, place)
            elif k == 0:
                assert found[array, place] == pytest.approx(float(x), rel=1e-12)


def motion_of(model: Model, order: int, seed: int) -> dict[str, list[np.ndarray]]:
    """Time derivatives of q, v, a, z, u and forces beside drives; those of q, v and a are of one motion."""
    rng, n = np.random.default_rng(seed), len(model.coordinates)
    derivatives = [rng.uniform(-1.0, 1.0, model.size) for _ in range(order + 3)]
    drives = [rng.uniform(-5.0, 5.0, model.size) for _ in range(order + 1)]
    beside = [states[0] for states in model.drives.values()]
    return {
        **{name: [x[:n] for x in derivatives[i : i + order + 1]] for i, name in enumerate(MOTION[:3])},
        "z": [x[n:] for x in derivatives[1 : order + 2]],
        "u": [x[:n] for x in drives],
        "forces": [x[beside] for x in drives],
    }


def check(robot: Robot, name: str, order: int, seed: int) -> None:
    model = build_model(robot)
    agree(derive(model, name), motion_of(model, order, seed), {"p": list(model.parameters.values())}, order)


@pytest.mark.parametrize("seed", seeds(0, 1, 40))
def test_random_robots(seed: int) -> None:
    """Kernels in turns, to an order that changes with the seed; laws of forces, springs, motors, drives among them."""
    for name in (OF_MOTIONS[seed % 6], OF_MOTIONS[(seed + 1) % 6]):
        check(robot_of(seed), name, 1 + seed % 4, seed)


def agree_along(robot: Robot, name: str, seed: int) -> None:
    """The jet of first order has the rates that forward differentiation has, to round-off."""
    model = build_model(robot)
    program, moving = whole_program(model, name, lambda part: derive(model, part)), motion_of(model, 1, seed)
    rates = {**dict(itertools.pairwise(MOTION[:4])), **{name: f"{name}1" for name in OTHERS}}
    along = run_passes(tangent(program, rates, "along"))
    made = run_passes(jet(program, jet_series(["q", "v", "a", *OTHERS], 1), 1, "jet"))
    inputs = {"p": list(model.parameters.values()), "q": moving["q"][0], "v": moving["v"][0], "a": moving["a"][0]}
    inputs |= {"jerk": moving["a"][1], **{f"{x}{k or ''}": moving[x][k] for x in OTHERS for k in (0, 1)}}
    found, wanted = evaluate(made, inputs), evaluate(along, inputs)
    size = 1 + max(place for array, place in program.outputs if array == "out")
    largest = max(1.0, *(abs(x) for (array, _), x in wanted.items() if array == "out"))
    for (array, place), x in wanted.items():
        if array == "out":
            assert found[array, size + place] == pytest.approx(x, rel=0.0, abs=1e-12 * largest), place


ALONG: Mapping[str, Callable[[int], Robot]] = {
    "trees": robot_of,
    "bending": lambda seed: bent(random_robot(seed, joints=(2, 2), max_size=4, tree=True), seed).robot,
    "closed": lambda seed: eomgen.load_robot("four_bar"),
    "internal states": lambda seed: stateful_arm(),
}


@pytest.mark.parametrize(
    ("kind", "seed"),
    soaked([(kind, seed) for kind in ALONG for seed in range(6)], [("trees", 1), ("internal states", 0)]),
)
def test_the_first_order_is_the_rate_of_forward_differentiation(kind: str, seed: int) -> None:
    robot = ALONG[kind](seed)
    for name in ("inverse_dynamics", "forward_dynamics"):
        agree_along(robot, name, seed)


@pytest.mark.soak
@pytest.mark.parametrize("name", ["inverse_dynamics", "forward_dynamics"])
def test_internal_states(name: str) -> None:
    check(stateful_arm(), name, 2, 4)


@pytest.mark.soak
@pytest.mark.parametrize("seed", range(12))
def test_matrices_of_random_robots(seed: int) -> None:
    robot = random_robot(seed, joints=(2, 3), max_size=4, tree=True)
    check(robot, MATRICES[seed % 3], 1 + seed % 2, seed)


@pytest.mark.soak
@pytest.mark.parametrize("seed", range(8))
def test_random_robots_that_bend(seed: int) -> None:
    robot = bent(random_robot(seed, joints=(2, 3), max_size=6, tree=True), seed).robot
    for name in ("inverse_dynamics", "forward_dynamics"):
        check(robot, name, 2, seed)


@pytest.mark.parametrize(
    "name",
    [
        *("constrained_drives", "constrained_dynamics", "constraint_bias"),
        pytest.param("tree_forward_dynamics_jacobian", marks=pytest.mark.soak),
    ],
)
def test_closed_mechanisms(name: str) -> None:
    check(eomgen.load_robot("four_bar"), name, 2, 3)


@pytest.mark.parametrize("order", ORDERS)
def test_every_operation_has_its_series(order: int) -> None:
    program = every_operation("rotations")
    assert len(find_rotations(program)) == 4
    rng = np.random.default_rng(order)
    for start in ([0.7, 1.9], [1.9, 0.7]):
        agree(program, {"q": [np.array(start), *rng.uniform(-1.0, 1.0, (order, 2))]}, {}, order)


def test_what_does_not_move_costs_nothing() -> None:
    """A constant array has no series: one product per order, and factors of the second order before and behind it."""
    graph = Graph()
    x, c = graph.input("q", 0), graph.input("p", 0)
    program = finish(graph, "scaled", {("out", 0): c * x, ("out", 1): c * c})
    made = run_passes(jet(program, {"q": ("q", "v", "a")}, 2, "jet"))
    assert made.count() == {"mul": 6, "add": 0, "div": 0, "sincos": 0}
    assert evaluate(made, {"q": [2.0], "v": [3.0], "a": [5.0], "p": [7.0]}) == {
        ("out", 0): 14.0,
        ("out", 1): 49.0,
        ("out", 2): 21.0,
        ("out", 3): 0.0,
        ("out", 4): 35.0,
        ("out", 5): 0.0,
    }


def test_a_maximum_goes_with_the_larger_one() -> None:
    """Where both are equal with the second one, as in derivatives along directions."""
    graph = Graph()
    program = finish(graph, "max", {("out", 0): graph.call("max", graph.input("q", 0), graph.input("q", 1))})
    made = run_passes(jet(program, {"q": ("q", "v")}, 1, "jet"))
    for q, rate in (([1.0, 0.0], 3.0), ([0.0, 1.0], 4.0), ([1.0, 1.0], 4.0)):
        assert evaluate(made, {"q": q, "v": [3.0, 4.0]})["out", 1] == rate


@pytest.mark.parametrize(
    ("name", "kernel", "most"),
    [
        ("ur5", "inverse_dynamics", 4.5),
        ("puma560", "inverse_dynamics", 4.3),
        pytest.param("puma560_elastic", "inverse_dynamics", 4.8, marks=pytest.mark.soak),
        ("ur5", "forward_dynamics", 4.9),
        pytest.param("puma560_elastic", "forward_dynamics", 5.1, marks=pytest.mark.soak),
    ],
)
def test_operations_of_the_second_order(name: str, kernel: str, most: float) -> None:
    """As multiples of those of the value."""
    model = build_model(eomgen.load_robot(name))
    once, twice = (sum(derive(model, x).count().values()) for x in (kernel, f"{kernel}_jet2"))
    assert twice <= most * once


@pytest.mark.soak
def test_operations_of_matrices_are_those_that_the_page_states() -> None:
    model, known = build_model(eomgen.load_robot("ur5")), dict[str, Program]()
    page = " ".join((Path(__file__).parents[3] / "docs" / "derivatives.md").read_text(encoding="utf-8").split())
    once, ratios = [], []
    for name in ("christoffel", "forward_dynamics_jacobian"):
        counts = [sum(derive(model, f"{name}_jet{k}", known=known).count().values()) for k in ORDERS]
        once.append(sum(derive(model, name, known=known).count().values()))
        ratios.append([count / once[-1] for count in counts])
    one, two, three, four = (f"{max(both):.1f}" for both in zip(*ratios, strict=True))
    assert f"`ur5` {once[0]} and {once[1]}, and up to {one}, {two}, {three} and {four} times as many" in page


def test_every_function_has_time_derivatives() -> None:
    known = available(build_model(eomgen.load_robot("four_bar")))
    for name in known:
        if f"{name}_tangent" in known:
            assert {f"{name}_jet{order}" for order in ORDERS} <= set(known)
    assert KERNELS["forward_dynamics_jet2"].reads == ("q", "v", "a", "jerk", "u", "u1", "u2")
    assert KERNELS["frame_pose_jet1"].reads == ("q", "v")
    assert KERNELS["inverse_dynamics_jet4"].reads == MOTION


def test_programs_of_mechanisms_are_the_same_in_every_process() -> None:
    """Whatever order the hashes of names have there."""
    code = """
        import eomgen
        from eomgen.codegen.kernels.equations import derive
        from eomgen.robot.model import build_model
        print(derive(build_model(eomgen.load_robot("four_bar")), "inverse_dynamics_jet1").instructions)
    """
    command = [sys.executable, "-c", textwrap.dedent(code)]
    seeds = [os.environ | {"PYTHONHASHSEED": seed} for seed in "12"]
    one, other = (subprocess.run(command, env=seed, capture_output=True, check=True).stdout for seed in seeds)
    assert one == other
