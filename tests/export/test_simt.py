"""One text for accelerators, run on the processor as C++, C and OpenCL to the kernel's bits, and its cubins."""

from __future__ import annotations

import ctypes
import importlib.util
import itertools
import json
import re
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen.cli.entry import main
from eomgen.codegen.c.scalar_types import SCALARS
from eomgen.codegen.kernels.equations import derive
from eomgen.codegen.program import orders
from eomgen.codegen.program.ir import Graph, evaluate_lanes, finish
from eomgen.codegen.program.operations import CALLS, OPERATIONS
from eomgen.codegen.simt.kernels import CONTROLLED, DEFAULT, derive_kernels, refusal
from eomgen.codegen.simt.parts import _cost, _parts, split_columns
from eomgen.codegen.simt.registers import (
    FAR,
    PLACES,
    SINE,
    SPILL,
    TURN,
    Places,
    Schedule,
    _statements,
    most_alive,
    scheduled,
    spills,
)
from eomgen.codegen.simt.setup import setup_values
from eomgen.codegen.simt.sources import render_simt
from eomgen.codegen.simt.statements import Writer
from eomgen.description import as_robot, builtin_robots
from eomgen.description.load import robot_from_toml
from eomgen.device.texts import FunctionText
from eomgen.errors import InputError, UnknownNameError
from eomgen.robot.model import build_model
from tests.support import simt
from tests.support.figures import Figures
from tests.support.joint_table import joint_table, link_table
from tests.support.point_bounds import bounds_at
from tests.support.random_robots import random_robot
from tests.support.refusals import refused

pytestmark = pytest.mark.usefixtures("unoptimised")
DTYPES = ("float64", "float32")
BUILTIN = tuple(zip(sorted(builtin_robots()), itertools.cycle(DTYPES), strict=False))  # each with one number of bits
TOP = f"""
name = "top"
{link_table("body", 1.0, (0.1, 0.0, 0.0), (0.1, 0.2, 0.25))}
{joint_table("joint1", "base", "body", "free")}
"""
ROUNDED = {"exp", "log", "atan2"}  # operations whose last bits are the device's
CLOSING = ("settling", "cut_poses")  # what assembles loops


def at_rest(kernel: Any, arrays: list[Any], home: Any) -> list[Any]:
    """Put states of a closed mechanism where loops are closed, near home, at rest; drives and accelerations stay."""
    q, *others = arrays
    rest = [np.zeros_like(others[0]), *others[1:]] if others else []
    return [kernel.assemble((np.asarray(home) + 0.1 * q).astype(q.dtype)), *rest]


def compare(robot: Any, folder: Path, dtype: str, kernels: tuple[str, ...] = (), language: str = "c++") -> None:
    """Compare kernels with the compiled kernel's functions, to the bit."""
    model = build_model(robot)
    source = render_simt(model, kernels, dtype)
    made, names = simt.Compiled(source, folder, language), tuple(json.loads(source.meta)["kernels"])
    kernel = simt.built(robot, (*names, *CLOSING) if model.constraints else names, dtype)
    size = 0.03 if any(body.modes for body in model.bodies) else 0.3  # links bend as far as second order reaches
    for name in names:
        arrays, numbers = simt.states(made.meta, name, size=size), simt.scalars(made.meta, name)
        if model.constraints:
            arrays = at_rest(kernel, arrays, model.home)
        assert simt.same_bits(made.run(name, *arrays, **numbers), simt.expected(kernel, name, arrays)), name
        assert not made.status.any(), name


@pytest.mark.parametrize("dtype", DTYPES)
def test_text_has_the_bits_of_the_kernel(tmp_path: Path, dtype: str) -> None:
    compare(as_robot("one_link"), tmp_path, dtype)


@pytest.mark.parametrize("dtype", DTYPES)
def test_text_for_hip_and_cuda_has_the_bits_of_the_kernel(tmp_path: Path, dtype: str) -> None:
    """Threads run one by one on the processor, by the macros that HIP and CUDA share."""
    compare(as_robot("one_link"), tmp_path, dtype, ("forward_dynamics", "frame_poses", "rk4_rollout"), "hip")


def test_rollouts_under_controllers_have_the_bits_of_the_kernel(tmp_path: Path) -> None:
    """Each state with gains and a target of its own, on driven coordinates."""
    compare(as_robot("one_link"), tmp_path, "float64", CONTROLLED)


def test_steps_of_numbers_that_are_known_have_the_bits_of_the_kernel(tmp_path: Path) -> None:
    """Held drives add nothing to steps, so that pivots of the last joint's rails are known before."""
    robot = random_robot(3, joints=(2, 4), tree=True, rods=False)
    compare(robot, tmp_path, "float64", ("implicit_rollout",))


def test_robots_without_drives_have_no_controllers() -> None:
    robot = replace(as_robot("one_link"), driven=())
    with pytest.raises(InputError, match="kernels: 'rk4_pd_rollout' is for robots with driven coordinates"):
        render_simt(build_model(robot), ("rk4_pd_rollout",))


def test_closed_mechanisms_accelerate_as_the_kernel_says(tmp_path: Path) -> None:
    """Assembled states have the same bits, others say that loops are open."""
    source = render_simt(build_model(as_robot("four_bar")), ("forward_dynamics",))
    made, kernel = (
        simt.Compiled(source, tmp_path, "c"),
        eomgen.build("four_bar", kernels=("forward_dynamics", *CLOSING)),
    )
    q = kernel.assemble(np.array([[0.5, 0.2, 1.2], [0.6, 0.2, 1.2]]))
    v, u = np.zeros(q.shape), np.linspace(0.0, 1.0, q.size).reshape(q.shape)
    assert simt.same_bits(made.run("forward_dynamics", q, v, u), kernel.forward_dynamics(q, v, u))
    assert not made.status.any()
    made.run("forward_dynamics", q + 0.1, v, u)
    assert said(made) == ["loops are open", "loops are open"]


def said(made: simt.Compiled) -> list[str]:
    """Say what statuses mean: reasons, or names of coordinates."""
    text = FunctionText("", "", made.meta)
    return [text.reasons(int(status)) or " ".join(text.vanished(int(status))) for status in made.status]


@pytest.mark.parametrize("language", ["c++", pytest.param("opencl", marks=pytest.mark.soak)])
def test_status_names_far_angles(tmp_path: Path, language: str) -> None:
    made = simt.Compiled(render_simt(build_model(as_robot("one_link")), ("mass_matrix",)), tmp_path, language)
    q = np.array([[0.0, 2.0], [0.0, 2e6], [0.0, np.nan]])
    made.run("mass_matrix", q)
    assert made.status.tolist() == [0, 1 << 30, 1 << 30]
    assert said(made)[1] == "an angle is farther than 1e+06 rad; allowed: angles up to there"


def test_status_names_a_coordinate_that_nothing_resists(tmp_path: Path) -> None:
    """Where beta is pi/2 the axes of alpha and gamma are one."""
    robot = robot_from_toml(TOP)
    made = simt.Compiled(render_simt(build_model(robot), ("forward_dynamics",)), tmp_path)
    q = np.array([[0.0, 0.0, 0.0, 0.1, 0.2, 0.3], [0.0, 0.0, 0.0, 0.1, np.pi / 2, 0.3]])
    made.run("forward_dynamics", q, np.zeros((2, 6)), np.zeros((2, 6)))
    assert re.fullmatch(r"joint1\.(alpha|beta|gamma)", said(made)[1])
    assert made.status[0] == 0
    with pytest.raises(InputError, match=r"switches charts of 3-DOF rotations \(joint1\); allowed: forward_dynamics"):
        render_simt(build_model(robot), ("rk4_rollout",))


def test_parameters_are_those_of_the_call(tmp_path: Path) -> None:
    made = simt.Compiled(render_simt(build_model(as_robot("one_link")), ("inverse_dynamics",)), tmp_path)
    kernel = eomgen.build("one_link", kernels=("inverse_dynamics",))
    kernel.parameters["gravity.y"] = -1.6
    parameters = {**made.meta["parameters"], "gravity.y": -1.6}
    made.h = setup_values(made.meta["setup"], list(parameters.values()), made.dtype)
    arrays = simt.states(made.meta, "inverse_dynamics")
    assert simt.same_bits(made.run("inverse_dynamics", *arrays), kernel.inverse_dynamics(*arrays))


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("name", ["one_link", "worn_arm", "four_bar"])
def test_metadata_has_the_values_precomputed_from_the_described_parameters(name: str, dtype: str) -> None:
    """As the setup program, evaluated by NumPy, gives them."""
    model = build_model(as_robot(name))
    h, setup = json.loads(render_simt(model, (), dtype).meta)["h"], derive_kernels(model, (), dtype).setup
    p = np.array([*model.parameters.values(), *[0.0] * len(model.turning)], dtype)
    wanted = evaluate_lanes(setup, {"p": p[:, np.newaxis]}, dtype).get("h", np.zeros((1, 1), dtype))
    assert np.array_equal(np.array(h, dtype), wanted[:, 0])
    assert np.isfinite(h).all()


@pytest.mark.parametrize("language", ["c++", "hip", pytest.param("opencl", marks=pytest.mark.soak)])
def test_tiles_are_transposed_and_back(tmp_path: Path, language: str) -> None:
    """By NumPy, and by functions of the text."""
    source = render_simt(build_model(as_robot("one_link")), ("mass_matrix",), tile=4)
    made, x, sizes = simt.Compiled(source, tmp_path, language), np.arange(30.0).reshape(10, 3), np.uint64([10, 3])
    tiles = made.to_tiles(x)
    assert tiles.shape == (3, 3, 4)
    assert tiles[1, 2, 3] == x[7, 2]
    assert np.array_equal(made.from_tiles(tiles, 10), x)
    there, back = np.zeros_like(tiles), np.zeros_like(x)
    made.launch("one_link_to_tiles", x.size, *sizes, x, there)
    made.launch("one_link_from_tiles", x.size, *sizes, tiles, back)
    assert np.array_equal(there, tiles)
    assert np.array_equal(back, x)


def every_operation() -> Any:
    """Return a program with every operation, with angles that are no coordinates, and pivots."""
    graph = Graph()
    x, y, z = (graph.input("q", i) for i in range(3))
    outputs: dict[tuple[str, int], Any] = {}
    for place, op in enumerate(CALLS):
        args = (x * x + 1.0, y, z)[: OPERATIONS[op].arity]
        outputs["out", place] = graph.call(op, *args)
    sine, cosine = graph.sincos(x * y)
    values = [-(x / y), sine * cosine - z, -2.5 * z - x, graph.sincos(z)[1], y, graph.constant(0.25)]
    outputs |= {("out", len(CALLS) + i): value for i, value in enumerate(values)}
    outputs |= {("pivot", 0): x * x, ("pivot", 1): y * y}
    return finish(graph, "mass_matrix", outputs)


def test_all_operations_have_a_text() -> None:
    program = every_operation()
    lines = "\n".join(Writer(program, scheduled(program, PLACES["float64"]), SCALARS["float64"]).lines())
    for operation in CALLS.values():
        assert f"{operation.function}(" in lines
    assert lines.count("EOM_TURN(") == 2
    assert "EOM_CHECK(" in lines


@pytest.mark.parametrize("name", orders.ORDERS)
def test_orders_place_every_value_once_behind_its_arguments(name: str) -> None:
    program = derive(build_model(as_robot("one_link")), "forward_dynamics_jacobian")
    plain = orders.ORDERS[name](program)
    for order in (plain, orders.sunk(program, plain), orders.sunk(program, plain, 1)):
        assert sorted(order) == orders.as_derived(program)
        place = {value: time for time, value in enumerate(order)}
        for value in order:
            assert all(place[arg] < place[value] for arg in program.instructions[value].args if arg in place)


def test_model_of_registers_counts_what_does_not_fit() -> None:
    """Of (a + b) + (c + d), three sums, two values live at once; four products that wait for each other need four."""
    graph = Graph()
    x = [graph.input("q", i) for i in range(4)]
    products = [a * a for a in x]
    total: Any = 0.0
    for product in reversed(products):
        total = total + product
    program = finish(graph, "mass_matrix", {("out", 0): total})
    statements = tuple(_statements(program, orders.as_derived(program), 0))
    assert most_alive(statements) == 4
    assert spills(statements, 4) == (0, 0)
    assert spills(statements, 3) == (1, 1)
    assert spills(statements, 2) == (2, 2)
    assert scheduled(program, PLACES["float64"]).alive == 2


def test_sines_are_taken_again_behind_a_gap() -> None:
    graph = Graph()
    q = graph.input("q", 0)
    sine, _ = graph.sincos(q)
    value: Any = sine
    for i in range(1, 9):
        value = value * graph.input("q", i)
    program = finish(graph, "mass_matrix", {("out", 0): value + sine})
    for gap, turns in ((0, 1), (4, 2), (40, 1)):
        statements = list(_statements(program, orders.as_derived(program), gap))
        assert sum(statement.op == TURN for statement in statements) == turns
    assert PLACES.keys() == set(DTYPES)


@pytest.mark.parametrize(
    ("name", "robot", "words"),
    [
        ("rollout", "one_link", "steps whose number is not bounded"),
        ("kinematics", "one_link", "frame_poses, frame_jacobians"),
        ("constraint", "one_link", "is for robots with rigid"),
        ("rk4_rollout", "four_bar", "assembles loops after every step"),
        ("forward_dynamics_adjoint", "four_bar", "of a closed mechanism checks"),
        ("inverse_dynamics", "four_bar", "of a closed mechanism .*; allowed: forward_dynamics, constrained_dynamics"),
    ],
)
def test_what_is_no_straight_line_is_refused_by_name(name: str, robot: str, words: str) -> None:
    refused(InputError, rf"kernels: '{name}' .*{words}", render_simt, build_model(as_robot(robot)), (name,))


def test_wrong_choices_are_refused(tmp_path: Path) -> None:
    with pytest.raises(UnknownNameError, match="kernels: 'mass_matrx' is unknown; did you mean 'mass_matrix'"):
        eomgen.export_simt("one_link", tmp_path, kernels=("mass_matrx",))
    for options, message in (
        ({"kernels": "energy"}, "kernels: 'energy'; allowed: a sequence of names"),
        ({"dtype": "half"}, "dtype: 'half' is unknown; allowed: float64, float32"),
        *(({"tile": tile}, r"tile: .*; allowed: 1, 2, 4, .* 256") for tile in (0, 3, True, 512, 2.5)),
        *(({"contract": contract}, r"contract: .*; allowed: True or False") for contract in (None, 1, "on")),
    ):
        refused(InputError, message, eomgen.export_simt, "one_link", tmp_path, **options)
    assert list(tmp_path.iterdir()) == []


def test_command_writes_the_text(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["generate", "one_link", "--simt", "--kernels", "mass_matrix", "--dtype", "float32", "-o", str(tmp_path)]
    assert main([*words, "--tile", "8"]) == 0
    meta = json.loads((tmp_path / "one_link_simt.json").read_text())
    assert (meta["dtype"], meta["tile"], list(meta["kernels"])) == ("float32", 8, ["mass_matrix"])
    assert sorted(path.name for path in tmp_path.iterdir()) == [f"one_link_simt.{x}" for x in ("h", "json")]
    capsys.readouterr()
    assert main([*words, "--contract"]) == 0
    meta = json.loads((tmp_path / "one_link_simt.json").read_text())
    assert (meta["contract"], meta["flags"]["cuda"]) == (True, "--fmad=true")
    assert "#define EOM_CONTRACT 1" in (tmp_path / "one_link_simt.h").read_text()
    capsys.readouterr()
    for wrong in ("--cmake", "--ros2", "--wheel", "--native", "--levels=v1", "--report=x.html"):
        assert main([*words, wrong]) != 0
        assert "--simt stands without --cmake" in capsys.readouterr().err
    assert main(["generate", "one_link", "--tile", "8"]) != 0
    assert "--tile: given without --simt; allowed: with --simt" in capsys.readouterr().err
    assert main(["generate", "one_link", "--contract"]) != 0
    assert "--contract: given without --simt; allowed: with --simt" in capsys.readouterr().err


def wide() -> Any:
    """Return a program that writes one row of 7 columns."""
    graph = Graph()
    return finish(graph, "residual_jacobian", {("out", i): graph.input("q", i) * 2.0 for i in range(7)})


def test_columns_go_apart_where_registers_ask_for_it() -> None:
    """Parts write every number once, and hold less at once; where all fits there is one."""
    program = derive(build_model(as_robot("one_link")), "forward_dynamics_jacobian")
    assert len(split_columns(program, 2, Places(100, 64))) == 1
    halves = tuple((part, scheduled(part, Places(5, 4))) for part in _parts(program, 2, 2))
    written = [key for part, _ in halves for key in part.outputs]
    assert sorted(written) == sorted(program.outputs)
    whole = scheduled(program, Places(5, 4))
    assert whole.stores > 0
    assert max(plan.alive for _, plan in halves) < whole.alive
    written = [place % 7 for part in _parts(wide(), 7, 3) for _, place in part.outputs]
    assert written == [0, 1, 2, 3, 4, 5, 6]
    assert _cost(split_columns(program, 2, Places(5, 4))) == min(_cost(halves), _cost(((program, whole),)))


def test_what_lies_far_costs_more() -> None:
    """Of 6 values of which 4 are near, 12 accesses cost two thirds as near ones, the rest as far ones."""
    plan = Schedule("as derived", (), 1, 8, Places(2, 4), 6, 6)
    assert plan.operations == 8 * SPILL + 4 * FAR + SINE
    assert Schedule("as derived", (), 0, 8, Places(8, 4), 0, 0).operations == 0


def test_sines_are_taken_again_so_that_nothing_is_stored() -> None:
    """Angles of a long program whose sines are used at both of its ends: one register less than they need."""
    graph = Graph()
    sines = [graph.sincos(graph.input("q", i))[0] for i in range(4)]
    value: Any = sines[0] + sines[1] + sines[2] + sines[3]
    for i in range(4, 1600):
        value = value * graph.input("q", i)
    for sine in sines:
        value = value * sine
    program = finish(graph, "mass_matrix", {("out", 0): value})
    assert scheduled(program, Places(5, 4)).sines_again == 0
    plan = scheduled(program, Places(4, 4))
    assert (plan.stores, plan.sines_again > 0) == (0, True)
    assert plan.alive <= 4


@pytest.mark.soak
@pytest.mark.parametrize(("name", "dtype"), BUILTIN)
def test_controllers_of_built_in_robots_have_the_bits_of_the_kernel(tmp_path: Path, name: str, dtype: str) -> None:
    robot = as_robot(name)
    if reason := refusal(build_model(robot), CONTROLLED[0]):
        pytest.skip(f"{CONTROLLED[0]} {reason}")
    compare(robot, tmp_path, dtype, CONTROLLED)


@pytest.mark.soak
@pytest.mark.parametrize(("name", "dtype"), BUILTIN)
def test_all_kernels_of_built_in_robots_have_the_bits_of_the_kernel(tmp_path: Path, name: str, dtype: str) -> None:
    compare(as_robot(name), tmp_path, dtype)


@pytest.mark.soak
@pytest.mark.parametrize("seed", range(30))
def test_all_kernels_of_random_robots_have_the_bits_of_the_kernel(tmp_path: Path, seed: int) -> None:
    robot = random_robot(np.random.default_rng(seed))
    derivatives = ("inverse_dynamics_tangent", "forward_dynamics_adjoint")
    usual = tuple(name for name in (*DEFAULT, *CONTROLLED) if refusal(build_model(robot), name) is None)
    compare(robot, tmp_path, DTYPES[seed % 2], (*usual, *derivatives))


def runs_under_opencl(robot: Any, folder: Path, dtype: str) -> None:
    """Compare kernels on the first device of OpenCL with those of C++."""
    model = build_model(robot)
    source = render_simt(model, (), dtype)
    device, made = simt.Compiled(source, folder, "opencl"), simt.Compiled(source, folder)
    programs = {kernel.name: kernel.program for kernel in derive_kernels(model, (), dtype).kernels}
    for name, program in programs.items():
        arrays, numbers = simt.states(made.meta, name), simt.scalars(made.meta, name)
        found, wanted = device.run(name, *arrays, **numbers), made.run(name, *arrays, **numbers)
        assert np.array_equal(device.status, made.status), name  # states of closed mechanisms are open here
        if any(x.op in ROUNDED for x in program.instructions):
            assert np.allclose(found, wanted, rtol=1e-10 if dtype == "float64" else 1e-3), name
        else:
            assert simt.same_bits(found, wanted), name


@pytest.mark.soak
@pytest.mark.parametrize(("name", "dtype"), BUILTIN)
def test_all_kernels_have_the_same_bits_under_opencl(tmp_path: Path, name: str, dtype: str) -> None:
    runs_under_opencl(as_robot(name), tmp_path, dtype)


def contracted(robot: str, name: str, dtype: str, folder: Path) -> float:
    """Return the largest difference that one operation for products and sums makes, by both bounds of rounding.

    Numbers with and without are each within a bound of the exact ones.
    """
    source = render_simt(build_model(as_robot(robot)), (name,), dtype, contract=True)
    assert json.loads(source.meta)["flags"]["c"] == "-ffp-contract=fast"
    made = simt.Compiled(source, folder, "c++ fused")
    kernel = eomgen.build(robot, dtype=dtype)
    arrays = simt.states(made.meta, name, count=200)
    plain, bound = simt.expected(kernel, name, arrays), sum(bounds_at(robot, name, dtype, arrays))
    found = made.run(name, *arrays)
    assert not simt.same_bits(found, plain)
    apart = np.abs(found.astype(np.float64) - plain).max(axis=0)
    assert (apart[bound == 0.0] == 0.0).all()
    return float((apart[bound > 0.0] / bound[bound > 0.0]).max())


@pytest.mark.skipif(not simt.has_fused_products(), reason="this processor has no fused products and sums")
@pytest.mark.parametrize("dtype", DTYPES)
def test_contraction_stays_within_bounds_of_rounding(tmp_path: Path, dtype: str) -> None:
    assert 1e-3 < contracted("one_link", "inverse_dynamics", dtype, tmp_path) <= 1.0


@pytest.mark.soak
@pytest.mark.skipif(not simt.has_fused_products(), reason="this processor has no fused products and sums")
@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize(
    ("robot", "name"),
    [
        *itertools.product(("ur5", "panda"), ("inverse_dynamics", "mass_matrix")),
        ("worn_arm", "residual"),
    ],
)
def test_contraction_of_arms_stays_within_bounds_of_rounding(
    tmp_path: Path, robot: str, name: str, dtype: str, figures: Figures
) -> None:
    figures.at_most("difference by bounds", contracted(robot, name, dtype, tmp_path), 1.0)


@pytest.mark.soak
@pytest.mark.parametrize("dtype", DTYPES)
def test_contraction_under_opencl_stays_within_bounds_of_rounding(tmp_path: Path, dtype: str) -> None:
    name, robot = "inverse_dynamics", as_robot("ur5")
    exact, source = (render_simt(build_model(robot), (name,), dtype, contract=contract) for contract in (False, True))
    made, again = (simt.Compiled(x, tmp_path, "opencl") for x in (source, replace(exact, code=source.code)))
    kernel, arrays = eomgen.build(robot, dtype=dtype), simt.states(made.meta, name, count=200)
    plain, bound = simt.expected(kernel, name, arrays), sum(bounds_at("ur5", name, dtype, arrays))
    assert simt.same_bits(again.run(name, *arrays), plain)  # by the flag, which stands above the text's choice
    found = made.run(name, *arrays)
    assert not simt.same_bits(found, plain)
    assert (np.abs(found.astype(np.float64) - plain) <= bound).all()


PROCESSORS = ("sm_80", "sm_90", "sm_120")
KERNELS = ("inverse_dynamics", "mass_matrix", "forward_dynamics", "residual", "frame_poses", "rk4_rollout")
_FIGURES = re.compile(r"Function properties for (\w+)\n.*?(\d+) bytes spill stores, .*\n.*?Used (\d+) registers")


@cache
def library() -> Any:
    """Return NVRTC of the package nvidia-cuda-nvrtc-cu12; None where it is not installed."""
    try:
        spec = importlib.util.find_spec("nvidia.cuda_nvrtc")
    except ModuleNotFoundError:
        return None
    places = [Path(place) for place in spec.submodule_search_locations or ()] if spec else []
    found = [path for place in places for path in place.glob("lib/libnvrtc.so.*")]
    return ctypes.CDLL(str(found[0])) if found else None


def figures(text: str, processor: str) -> dict[str, tuple[int, int]]:
    """Return, per kernel, registers and bytes that are stored for want of them."""
    nvrtc, program = library(), ctypes.c_void_p()
    if nvrtc is None:
        pytest.skip("nvidia-cuda-nvrtc-cu12 is not installed")
    assert nvrtc.nvrtcCreateProgram(ctypes.byref(program), text.encode(), b"kernels.cu", 0, None, None) == 0
    words = [f"--gpu-architecture={processor}", "--fmad=false", "--std=c++17", "--ptxas-options=-v"]
    status = nvrtc.nvrtcCompileProgram(program, len(words), (ctypes.c_char_p * len(words))(*map(str.encode, words)))
    size = ctypes.c_size_t()
    nvrtc.nvrtcGetProgramLogSize(program, ctypes.byref(size))
    log = ctypes.create_string_buffer(size.value)
    nvrtc.nvrtcGetProgramLog(program, log)
    assert status == 0, log.value.decode()[-2000:]
    nvrtc.nvrtcDestroyProgram(ctypes.byref(program))
    return {name: (int(used), int(stored)) for name, stored, used in _FIGURES.findall(log.value.decode())}


@pytest.mark.soak
@pytest.mark.parametrize("processor", PROCESSORS)
@pytest.mark.parametrize("name", ["ur5", "panda"])
def test_nothing_is_spilled_in_single_precision(name: str, processor: str) -> None:
    source = render_simt(build_model(as_robot(name)), KERNELS, "float32")
    found = figures(source.code, processor)
    assert found.keys() >= {f"{name}_{kernel}" for kernel in KERNELS}
    assert {kernel: stored for kernel, (_, stored) in found.items() if stored} == {}


@pytest.mark.soak
@pytest.mark.parametrize("processor", PROCESSORS)
def test_registers_of_an_arm_in_double_precision(processor: str) -> None:
    source = render_simt(build_model(as_robot("ur5")), ("inverse_dynamics", "forward_dynamics", "mass_matrix"))
    for kernel, (used, stored) in figures(source.code, processor).items():
        assert stored == 0, kernel
        assert used <= 168, kernel


@pytest.mark.soak
@pytest.mark.parametrize("processor", PROCESSORS)
def test_nothing_is_spilled_by_36_coordinates_in_single_precision(processor: str) -> None:
    source = render_simt(build_model(as_robot("puma560_elastic")), ("forward_dynamics", "inverse_dynamics"), "float32")
    assert [stored for _, stored in figures(source.code, processor).values()] == [0] * 4


@pytest.mark.soak
def test_derivatives_in_parts_spill_less() -> None:
    """In double precision: 1.7 kB whole."""
    model = build_model(as_robot("ur5"))
    source = render_simt(model, ("forward_dynamics_jacobian",))
    functions = json.loads(source.meta)["kernels"]["forward_dynamics_jacobian"]["functions"]
    found = figures(source.code, "sm_90")
    assert len(functions) > 1
    assert sum(found[function][1] for function in functions) <= 700
