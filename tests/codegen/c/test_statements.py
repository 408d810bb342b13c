"""A program's text in C: compiled, split into functions, and counted, it is what the program is, and no longer."""

from __future__ import annotations

import ast
import json
import re
import subprocess
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from importlib import resources
from pathlib import Path
from typing import Any

import cffi
import numpy as np
import pytest

import eomgen
from eomgen.codegen.arrays.statements import write_statements
from eomgen.codegen.c import contexts, definitions, statements
from eomgen.codegen.c.lanes import pack
from eomgen.codegen.c.scalar_types import SCALARS
from eomgen.codegen.c.sources import render
from eomgen.codegen.c.statements import write_function
from eomgen.codegen.kernels import acceleration_slopes
from eomgen.codegen.kernels.equations import derive, derive_equations
from eomgen.codegen.kernels.signatures import KERNELS, PARTS, available
from eomgen.codegen.package.compile import FLAGS
from eomgen.codegen.program.ir import Graph, Node, Program, evaluate, finish
from eomgen.codegen.program.operations import CALLS
from eomgen.codegen.program.passes import run_passes
from eomgen.description.load import robot_from_toml
from eomgen.robot.model import Model, build_model
from eomgen.robot.value import Robot
from tests.oracles.force_laws import with_laws
from tests.support.bending_mixtures import PARTS as PARTS_OF_MIXTURES
from tests.support.bending_mixtures import mixture
from tests.support.bristles import stateful_arm
from tests.support.builds import Build
from tests.support.every_element import ROBOTS, robot_of
from tests.support.linkages import bricard
from tests.support.many_robots import many_robot
from tests.support.methods import method_of
from tests.support.random_robots import random_robot, random_state

DOUBLE = SCALARS["float64"]
CALLED = """
static double eom_sqrt(double x) { return sqrt(x); }
static double eom_abs(double x) { return fabs(x); }
static double eom_max(double x, double y) { return x < y ? y : x; }
static double eom_heaviside(double x) { return x > 0.0 ? 1.0 : 0.0; }
static double eom_select(double gate, double x, double y) { return gate > 0.0 ? x : y; }
static double eom_exp(double x) { return exp(x); }
static double eom_log(double x) { return log(x); }
static double eom_atan2(double y, double x) { return atan2(y, x); }
"""


def test_evaluation_equals_compiled_code(tmp_path: Path) -> None:
    """To the bit: brackets, signs and literals mean in C what the program means."""
    rng = np.random.default_rng(5)
    programs = [run_passes(float_program(rng, 60)) for _ in range(60)]
    code, declarations = ["#include <math.h>", CALLED], []
    for k, program in enumerate(programs):
        (lines,) = write_function(program, DOUBLE, turning=False).chunks
        head = f"void f{k}(const double *q, const double *v, double *out)"
        code.append(f"{head}\n{{\n    (void)q; (void)v;\n    " + "\n    ".join(lines) + "\n}")
        declarations.append(f"{head};")
    (tmp_path / "f.c").write_text("#include <stddef.h>\n" + "\n".join(code), encoding="ascii")
    command = ["cc", "-shared", "-fPIC", *FLAGS, str(tmp_path / "f.c"), "-o", str(tmp_path / "f.so"), "-lm"]
    subprocess.run(command, check=True)
    ffi = cffi.FFI()
    ffi.cdef("\n".join(declarations))
    lib = ffi.dlopen(str(tmp_path / "f.so"))
    for k, program in enumerate(programs):
        q, v, out = rng.uniform(-2, 2, 3), rng.uniform(-2, 2, 1), np.zeros(8)
        pointers = [ffi.from_buffer("double[]", x) for x in (q, v, out)]
        getattr(lib, f"f{k}")(*pointers)
        expected = evaluate(program, {"q": q.tolist(), "v": v.tolist()})
        assert np.array_equal(out, list(expected.values()), equal_nan=True)


@pytest.mark.soak
def test_split_functions_equal_whole_ones(built: Build, empty_cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Functions of a few statements that hand values on, against one function per kernel: the same to the bit."""
    robot = random_robot(7, joints=(2, 2), types=("revolute", "prismatic"), max_coordinates=2)
    kernels = []
    for name, size in (("whole", 10**9), ("split", 25)):
        for module in (statements, definitions, contexts):
            monkeypatch.setattr(module, "CHUNK", size)
        kernels.append(built(replace(robot, name=name), "all"))
    s = random_state(robot, 1)
    whole, split = kernels
    for name in available(build_model(robot)):
        own = not (KERNELS[name].derivative_of or KERNELS[name].by_request)
        if own and not {"kinematics", "rollout", "adaptive_rollout", "wrench"} & {name, *KERNELS[name].reads}:
            arrays = [getattr(s, letter) for letter in KERNELS[name].reads]
            assert np.array_equal(method_of(whole, name)(*arrays), method_of(split, name)(*arrays)), name
    for frame in whole.frames:
        assert np.array_equal(whole.frame_pose(s.q, frame), split.frame_pose(s.q, frame))
        assert np.array_equal(whole.frame_jacobian(s.q, frame), split.frame_jacobian(s.q, frame))
    package = next(path for path in (empty_cache / "packages").iterdir() if (path / "split.c").exists())
    assert "split_forward_dynamics_jacobian_part6(" in (package / "split.c").read_text()


def operators(text: str) -> Iterator[str]:
    """Operations of an expression, which reads the same in Python: the sign of a number is part of the number."""
    for node in ast.walk(ast.parse(text, mode="eval")):
        if isinstance(node, ast.BinOp):
            yield {ast.Mult: "mul", ast.Div: "div", ast.Add: "add", ast.Sub: "add"}[type(node.op)]
        elif isinstance(node, ast.UnaryOp) and not isinstance(node.operand, ast.Constant):
            yield "add"
        elif isinstance(node, ast.Call):
            called = {operation.function: operation.cost for operation in CALLS.values()}
            cost = called.get(ast.unparse(node.func))
            yield f"sincos {ast.unparse(node if cost else node.args[0])}" if cost in (None, "sincos") else cost


def counted(lines: Sequence[str]) -> dict[str, int]:
    """Operations in the statements of a function of C."""
    found: list[str] = []
    for line in lines:
        if " = " in line and not line.startswith(("for ", "/*")):
            found.extend(operators(line.rstrip(";").rsplit(" = ", 1)[1].replace("sinf(", "sin(")))
    angles = {name for name in found if name.startswith("sincos")}
    return {"mul": found.count("mul"), "add": found.count("add"), "div": found.count("div"), "sincos": len(angles)}


@pytest.mark.parametrize("laws", [True, pytest.param(False, marks=pytest.mark.soak)])
def test_operations_are_those_of_the_text(laws: bool) -> None:
    """What a kernel reports is what its C does."""
    robot = random_robot(8, joints=(3, 3), tree=True, max_size=9)
    robot = with_laws(robot, 8) if laws else robot
    equations = derive_equations(build_model(robot))
    reported = json.loads(render(equations).meta)["operations"]
    for name, program in equations.programs.items():
        function = write_function(program, DOUBLE)
        lines = [line for chunk in function.chunks for line in chunk]
        lines += [f"angle = sin({angle});" for angle in function.angles]
        assert counted(lines) == program.count(), name
        if name not in {*PARTS, *equations.shares}:
            assert reported[name] == program.count(), name
    setup = [line for chunk in write_function(equations.setup, DOUBLE, turning=False).chunks for line in chunk]
    assert counted(setup) == reported["parameters"]


def test_operations_of_a_loop(built: Build) -> None:
    """A tensor C in a loop counts what it calls."""
    robot = random_robot(9, joints=(4, 4), types=("free",), tree=True, armature=False)
    kernel = built(robot, "christoffel", "coriolis_matrix")
    for key, number in kernel.operations["coriolis_matrix"].items():
        assert kernel.operations["christoffel"][key] == 24 * number


def float_program(rng: np.random.Generator, length: int) -> Program:
    """A random program for floats: no division by zero, sums and products of moderate size."""
    graph = Graph()
    nodes: list[Any] = [graph.input("q", i) for i in range(3)] + [graph.input("v", 0), 0.7, -1.3, 1.0]
    for _ in range(length):
        op = str(rng.choice(["add", "sub", "mul", "neg", "sin", "div", *CALLS]))
        x, y = (nodes[int(i)] for i in rng.integers(max(0, len(nodes) - 12), len(nodes), 2))
        if op == "sin" and isinstance(x, Node):
            nodes.extend(graph.sincos(x))
        elif op == "neg":
            nodes.append(graph.neg(x))
        elif op in ("sqrt", "log"):
            nodes.append(graph.call(op, graph.add(graph.mul(x, x), 0.5)))
        elif op == "exp":
            nodes.append(graph.call(op, graph.neg(graph.mul(x, x))))
        elif op in CALLS:
            nodes.append(graph.call(op, *(x, y, nodes[0])[: CALLS[op].arity]))
        elif op == "div":
            nodes.append(graph.div(x, graph.add(graph.mul(y, y), 1.0)))
        elif op != "sin":
            nodes.append(getattr(graph, op)(x, y))
    return finish(graph, "random", {("out", i): node for i, node in enumerate(nodes[-8:])})


def branches() -> Model:
    """Twelve joints on several branches: many zeros."""
    return build_model(random_robot(3, joints=(12, 12), tree=True, types=("revolute",), max_coordinates=1, name="tree"))


def test_what_repeats_is_kept_once() -> None:
    model = branches()
    program = derive(model, "mass_matrix")
    packing = pack(program)
    assert len(packing.places) == model.size**2
    assert packing.size == len(set(program.outputs.values())) <= model.size * (model.size + 1) / 2
    for place, number in enumerate(packing.places):
        assert packing.program.outputs["out", number] == program.outputs["out", place]
    assert sorted(packing.program.outputs) == [("out", number) for number in range(packing.size)]
    assert packing.program.instructions == program.instructions


@pytest.mark.parametrize("kernel", ["inverse_dynamics", "mass_matrix"])
def test_few_or_different_results_stay_where_they_are(kernel: str) -> None:
    assert pack(derive(build_model(eomgen.load_robot("one_link")), kernel)) is None


def test_other_arrays_stay_as_they_are() -> None:
    graph = Graph()
    x = graph.input("q", 0)
    repeated = {("out", i): x for i in range(100)}
    packing = pack(finish(graph, "made_up", {**repeated, ("pivot", 0): x, ("pivot", 1): 2.0 * x}))
    assert packing.places == (0,) * 100
    assert [key for key in packing.program.outputs if key[0] == "pivot"] == [("pivot", 0), ("pivot", 1)]


def test_composed_kernels_find_every_result_in_its_place(monkeypatch: pytest.MonkeyPatch) -> None:
    """A kernel that another one calls is there with all its places, and as what its batch writes from."""
    model = branches()
    monkeypatch.setattr(acceleration_slopes, "MOST_PRODUCTS", -1)  # a solution in loops, as of long ones
    alone = render(derive_equations(model, ("residual_jacobian",))).batch_code
    assert "tree_residual_jacobian_packed(" in alone
    assert "tree_residual_jacobian_lanes(" not in alone
    called = render(derive_equations(model, ("residual_jacobian", "forward_dynamics_jacobian"))).batch_code
    assert re.search(r"static int tree_residual_jacobian_lanes\([^)]*\)\n\{\n    lanes packed\[\d+\];", called)
    only = render(derive_equations(model, ("forward_dynamics_jacobian",))).batch_code
    assert "tree_residual_jacobian_packed(" not in only
    assert "tree_residual_jacobian_lanes(" in only


def mixed(seed: int) -> Robot:
    """Return a robot whose links bend, with laws, motors, drives, springs and loops."""
    return mixture(seed, PARTS_OF_MIXTURES).robot


MOST = 25  # bytes per operation
SUITE: Mapping[str, Callable[[], Robot]] = {  # robots with one instance each of all that a description can have
    **{name: partial(eomgen.load_robot, name) for name in eomgen.builtin_robots()},
    **{f"many{number}": partial(many_robot, number) for number in (3, 27 * 11, 27 * 29, 100)},
    **{f"mixture{seed}": partial(mixed, seed) for seed in range(3)},
    "every": partial(robot_of, *ROBOTS),
    "states": stateful_arm,
    "linkage": bricard,
}


@pytest.mark.parametrize("name", SUITE)
def test_code_is_as_long_as_its_operations(name: str) -> None:
    """Values that several others use are written once, those of angles too, in C and in Python."""
    model = build_model(SUITE[name]())
    program = derive(model, "inverse_dynamics")
    for scalar in (DOUBLE, DOUBLE.lanes()):
        function = write_function(program, scalar)
        lines = [*function.shared, *function.angles, *(line for chunk in function.chunks for line in chunk)]
        assert sum(map(len, lines)) <= MOST * len(program.instructions)
    lines = write_statements(program, "out", model.size).lines
    assert sum(map(len, lines)) <= MOST * len(program.instructions)


@pytest.mark.parametrize(("few", "many"), [(1, 4), (3, 6), pytest.param(4, 8, marks=pytest.mark.soak)])
def test_code_of_a_sliding_load_grows_with_the_square_of_the_modes(few: int, many: int) -> None:
    gantry = (resources.files("eomgen") / "robots" / "gantry.toml").read_text("utf-8")

    def size(count: int) -> int:
        robot = robot_from_toml(gantry.replace("{ y = 3, z = 1 }", f"{{ y = {count}, z = {count} }}"))
        return sum(map(len, render(derive_equations(build_model(robot), ("inverse_dynamics",))).codes.values()))

    assert size(many) <= (many / few) ** 2 * size(few)


def test_operations_of_angles_are_written_once() -> None:
    """Angles by a recurrence, each of two before it: their statements and the C count the program's operations."""
    graph = Graph()
    angles = [graph.input("q", 0), graph.input("q", 1)]
    for _ in range(30):
        angles.append(graph.add(graph.mul(2.0, angles[-1]), angles[-2]))
    outputs = {("out", i): graph.sincos(angle)[i % 2] for i, angle in enumerate(angles)}
    program = finish(graph, "recurrence", outputs)
    function = write_function(program, DOUBLE)
    lines = [*function.shared, *(line for chunk in function.chunks for line in chunk)]
    assert counted([*lines, *(f"angle = sin({angle});" for angle in function.angles)]) == program.count()
