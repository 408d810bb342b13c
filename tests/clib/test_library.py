"""The C library without a robot: its tables, warnings, and programs written by hand whose numbers are known."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from functools import cache
from itertools import product
from pathlib import Path
from typing import Any

import cffi
import mpmath as mp
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

import eomgen
from eomgen.codegen.c.contexts import kept_of_a_step
from eomgen.codegen.c.library import library_files, library_types
from eomgen.codegen.c.tableaus import render_tableaus
from eomgen.kernel.stepping.alternation import COST, Alternation, Turn
from eomgen.kernel.stepping.methods import ADAPTIVE, TABLE
from eomgen.robot.model import build_model
from tests.support.method_rows import BS3, RODAS4
from tests.support.optional import needs
from tests.support.soak import soaked

LIBRARY = Path(eomgen.__path__[0], "clib")
HERE = Path(__file__).parent
EXAMPLE = Path(__file__).parents[2] / "examples" / "pendulum.c"
WARNINGS = ("-std=c99", "-Wall", "-Wextra", "-Wconversion", "-pedantic", "-Werror")
COMPILERS = ("gcc", "clang", "zig")  # the last one is clang, too
KNOWN = tuple(f"-DEOM_{x}" for x in ("POSITIONS=3", "RATES=4", "INPUTS=3", "M=0", "ROTATIONS=0", "RADAU=1"))
OPTIONS: tuple[tuple[str, ...], ...] = ((), ("-DEOM_SINGLE",), KNOWN)
WIDTHS = {"-DEOM_VECTOR_BYTES=0": 1, "-mno-avx": 2, "-mavx2": 4, "-mavx512f": 8}
METHODS = ("rk4", "implicit", "rosenbrock", "tsit5", "radau")
WITHIN = {"rk4": 1e-12, "implicit": 2e-4, "rosenbrock": 1e-8, "tsit5": 2e-9, "radau": 2e-9}  # rad, rad/s
Array = NDArray[np.float64]


def compiler_of(name: str) -> list[str]:
    """Words that call a compiler of COMPILERS, where it is installed."""
    if name == "zig":
        needs("ziglang", extra="compiler")
    elif shutil.which(name) is None:
        pytest.skip(f"{name} is not installed")
    return [sys.executable, "-m", "ziglang", "cc"] if name == "zig" else [name]


def table(name: str) -> Array:
    """Numbers of a table of methods.h, (rows, numbers), zeros where rows are shorter."""
    text = library_files()["clib/methods.h"]
    found = re.search(rf"\b{name}(?:\[[^\]]*\])* = (\{{.*?\}});|\b{name} = (.*?);", text, re.S)
    assert found, name
    inner = found.group(1) or found.group(2)
    rows = re.findall(r"\{([^{}]*)\}", inner) or [inner]
    numbers = [[float(x) for x in re.findall(r"-?\d+\.\d+(?:e[-+]?\d+)?", row)] for row in rows]
    width = max(map(len, numbers))
    return np.array([row + [0.0] * (width - len(row)) for row in numbers])


def test_tables_are_those_of_the_methods() -> None:
    """What C integrates with are the coefficients whose order conditions are tested."""
    rendered = {f"clib/{file}": text for file, text in render_tableaus().items()}
    assert {file: library_files()[file] for file in rendered} == rendered, "run: make methods"


def test_tables_of_radau_are_those_of_its_conditions() -> None:
    """Collocation at Radau's points, by powers; eigenvalues of the inverse of its matrix; an error of order 5."""
    nodes = table("eom_radau_shares")[0]
    count, powers = len(nodes), np.arange(1, len(nodes) + 1)
    collocation = np.polynomial.Polynomial([0.0] * (count - 1) + [1.0]) * np.polynomial.Polynomial([-1.0, 1.0]) ** count
    assert np.abs(collocation.deriv(count - 1)(nodes)).max() <= 1e-11
    with mp.workdps(30):  # in double precision the inverse alone is as inexact as what is compared
        integrals = mp.matrix([[mp.mpf(x) ** k / k for k in powers.tolist()] for x in nodes])
        of_powers = integrals * mp.matrix([[mp.mpf(x) ** (k - 1) for k in powers.tolist()] for x in nodes]) ** -1
    a = np.array(of_powers.tolist(), dtype=np.float64)
    for order in range(1, 2 * count):  # of quadrature, which makes it one of order 9 with collocation
        assert a[-1] @ nodes ** (order - 1) == pytest.approx(1.0 / order, abs=1e-14)
    real, pairs = table("eom_radau_real")[0, 0], table("eom_radau_pairs")
    blocks = np.zeros((count, count))
    blocks[0, 0] = real
    for k, (alpha, beta) in enumerate(pairs):
        blocks[1 + 2 * k : 3 + 2 * k, 1 + 2 * k : 3 + 2 * k] = [[alpha, -beta], [beta, alpha]]
    ahead, back = table("eom_radau_ahead"), table("eom_radau_back")
    assert np.abs(ahead @ back - np.eye(count)).max() <= 1e-14
    assert np.abs(back @ blocks @ ahead - np.linalg.inv(a)).max() <= 1e-12
    inside = table("eom_radau_inside")
    assert np.abs((nodes[:, None] ** powers) @ inside - np.eye(count)).max() <= 1e-12
    row = next(x for x in TABLE if x.name == "radau")
    assert np.abs(np.sum(row.within[1:], axis=1) - a[-1]).max() <= 1e-14
    first, *wrong = row.error
    assert first == pytest.approx(1.0 / real, rel=1e-15)
    embedded = a[-1] + np.array(wrong)
    for order in range(1, count + 1):
        assert embedded @ nodes ** (order - 1) + first * (order == 1) == pytest.approx(1.0 / order, abs=1e-14)
    assert np.abs(real * np.array(wrong) @ np.linalg.inv(a) - table("eom_radau_error")[0]).max() <= 1e-12


def test_the_rule_of_gauss_is_exact_for_polynomials_of_degree_9() -> None:
    nodes, weights = (table(f"eom_gauss_{name}")[0] for name in ("nodes", "weights"))
    for degree in range(10):
        assert weights @ nodes**degree == pytest.approx(1.0 / (degree + 1), rel=1e-14)
    assert abs(weights @ nodes**10 - float(Fraction(1, 11))) > 1e-8


@pytest.fixture(scope="module")
def reference() -> Array:
    """The pendulum's motion by SciPy, (11, 2)."""
    m, length, g, d = 1.5, 0.8, 9.81, 0.05

    def rate(_: float, y: Array) -> list[float]:
        return [y[1], (-m * g * length * np.sin(y[0]) - d * y[1]) / (m * length**2)]

    times = np.linspace(0.0, 1.0, 11)
    solved = solve_ivp(rate, (0.0, 1.0), [1.2, 0.3], "DOP853", times, rtol=1e-13, atol=1e-14)
    return np.asarray(solved.y.T)


SANITIZED = ("-fsanitize=address,undefined", "-fno-sanitize-recover=all")


OSCILLATOR = """
#include <cmath>
#include "eom.h"
static int accelerations(const double *, const double *q, const double *, const double *u, double *a)
{
    a[0] = u[0] - q[0];
    return 0;
}
int main()
{
    double h = 0.0, q = 1.0, v = 0.0, u = 0.0, q_out[2], v_out[2], state[EOM_STATE_ROOM(1, 0, 1, 1, 0, 0, 0)];
    eom_sizes sizes = {};
    eom_robot robot = {};
    eom_drive drive = {};
    eom_workspace work = {};
    sizes.positions = sizes.rates = sizes.inputs = sizes.hoisted = sizes.factors = 1;
    robot.sizes = &sizes;
    robot.forward_dynamics = accelerations;
    drive.u = &u;
    work.state = state;
    const long long failed =
        eom_integrate_fixed(&robot, &h, &q, &v, &drive, NULL, 0.0, 1e-3, 1000, 1000, 0, q_out, v_out, work);
    return (failed == -1 && std::fabs(q_out[1] - std::cos(1.0)) < 1e-12) ? 0 : 2;
}
"""


def test_programs_in_cpp_call_the_library(tmp_path: Path) -> None:
    if shutil.which("g++") is None:
        pytest.skip("there is no g++")
    (tmp_path / "oscillator.cpp").write_text(OSCILLATOR, encoding="ascii")
    parts = (("gcc", *WARNINGS, LIBRARY / "integrate.c"), ("g++", "-Wall", "-Wextra", "-Werror", "oscillator.cpp"))
    for command in parts:
        subprocess.run([*map(str, command), f"-I{LIBRARY}", "-c"], check=True, cwd=tmp_path)
    subprocess.run(["g++", "oscillator.o", "integrate.o", "-o", "oscillator", "-lm"], check=True, cwd=tmp_path)
    assert subprocess.run(["./oscillator"], check=False, cwd=tmp_path).returncode == 0


@pytest.fixture(scope="module")
def shaken_reference() -> Array:
    """Cart and angle at 0.5 s, their velocities, by SciPy; the torque jumps at 0.25 s."""
    m, length, g, d = 1.5, 0.8, 9.81, 0.05

    def rate(t: float, y: Array) -> list[float]:
        torque = 2.0 + t if y[2] < 0.5 else -3.0 + 0.5 * (t - 0.25)
        u = torque + (3.0 * (0.1 + 0.3 * t - y[0] / 2.0) + 0.2 * (0.3 - y[1] / 2.0)) / 2.0
        u += length * (np.cos(y[0]) + 2.0 * np.sin(y[0]))
        acceleration = -0.05 * 7.0**2 * np.sin(7.0 * t)
        moments = u - m * g * length * np.sin(y[0]) - d * y[1] - m * length * np.cos(y[0]) * acceleration
        return [y[1], moments / (m * length**2), 0.0]

    y = [0.4, -0.2]
    for piece, span in enumerate([(0.0, 0.25), (0.25, 0.5)]):
        y = solve_ivp(rate, span, [*y[:2], float(piece)], "DOP853", rtol=1e-13, atol=1e-14).y[:, -1].tolist()
    return np.array([0.05 * np.sin(3.5), y[0], 0.35 * np.cos(3.5), y[1]])


@pytest.mark.soak
@pytest.mark.parametrize(("method", "order", "within"), [("rk4", 4, 1e-8), ("implicit", 1, 2e-2)])
def test_fixed_steps_under_inputs(method: str, order: int, within: float, make: Make, shaken_reference: Array) -> None:
    """Steps converge to SciPy's motion at their order under a prescribed motion, a torque, control and a wrench."""
    shaken, number = make("shaken_pendulum", WHOLE, *SANITIZED), METHODS.index(method)
    errors = [np.abs(numbers(shaken, number, steps) - shaken_reference) for steps in (100, 200)]
    assert errors[1].max() <= within
    assert errors[1][[0, 2]].max() <= 1e-15
    assert 0.8 * 2**order <= errors[0].max() / errors[1].max() <= 1.25 * 2**order


def test_the_example_runs(tmp_path: Path) -> None:
    """The page's pendulum: undamped, so its energy stays."""
    text = said(program(EXAMPLE, tmp_path, WHOLE))
    page = (Path(__file__).parents[2] / "docs" / "library.md").read_text(encoding="utf-8")
    assert EXAMPLE.read_text(encoding="utf-8") in page
    assert text in page
    rows = np.array([[float(x) for x in re.findall(r"-?\d+\.\d+", line)] for line in text.splitlines()[1:]])
    energy = 0.5 * 0.8 * rows[:, 2] ** 2 - 9.81 * np.cos(rows[:, 1])
    assert energy == pytest.approx(energy[0], abs=1e-7)


def optimisation(compiler: str, level: str) -> str:
    """Return the level for gcc, which warns of more when it optimises; Clang's warnings are those of its front end."""
    return level if compiler == "gcc" else "-O0"


@pytest.mark.soak
@pytest.mark.parametrize(("compiler", "flags"), [*product(COMPILERS, OPTIONS)])
def test_no_compiler_warns(compiler: str, flags: tuple[str, ...], tmp_path: Path) -> None:
    command = [*compiler_of(compiler), *WARNINGS, optimisation(compiler, "-O2"), *flags, "-c", WHOLE]
    done = subprocess.run([*command, "-o", str(tmp_path / "x.o")], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(
    ("compiler", "vector", "flags"),
    soaked(
        product(COMPILERS, WIDTHS, OPTIONS),
        {(COMPILERS[0], "-mavx2", OPTIONS[0])},
    ),
)
def test_no_compiler_warns_of_lanes(compiler: str, vector: str, flags: tuple[str, ...], tmp_path: Path) -> None:
    """Without a robot, in every width, whose symbols say it."""
    command = compiler_of(compiler)
    source, made = str(LIBRARY / "integrate_lanes.c"), tmp_path / "x.o"
    command = [*command, *WARNINGS, optimisation(compiler, "-O1"), vector, *flags, "-c", source, "-o", str(made)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    names = subprocess.run(["nm", str(made)], capture_output=True, text=True, check=True).stdout
    width = WIDTHS[vector]
    prefix, width = ("eomf", width * 2 if width > 1 else 1) if "-DEOM_SINGLE" in flags else ("eom", width)
    public = {line.split()[-1] for line in names.splitlines() if " T " in line}
    expected = {f"{prefix}_integrate_{kind}_batch_x{width}" for kind in ("fixed", "adaptive")}
    assert public == (set() if flags == KNOWN else expected)


@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_types_that_cffi_reads_have_the_compilers_sizes(dtype: str, tmp_path: Path) -> None:
    """The declarations for cffi lay structures out as the headers do."""
    prefix = "eomf" if dtype == "float32" else "eom"
    names = ["eom_spline", "eom_track", "eom_tracking", "eom_computed_torque", "eom_prescribed", "eom_wrench"]
    names += ["eom_progress", *(f"{prefix}_{x}" for x in ("drive", "inputs", "tolerance", "record", "slopes", "rates"))]
    ffi = cffi.FFI()
    ffi.cdef(library_types(dtype))
    prints = "".join(f'    printf("%d\\n", (int)sizeof({name}));\n' for name in names)
    assert printed(prints, tmp_path) == [ffi.sizeof(name) for name in names]


def program(source: Path, folder: Path, *flags: str, compiler: str = "gcc") -> Path:
    """The program of a file, compiled without warnings."""
    made = folder / source.stem
    command = [compiler, *WARNINGS, "-O0", f"-I{LIBRARY}", str(source), *flags, "-o", str(made), "-lm"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return made


def said(made: Path, *words: object, **options: Any) -> str:
    """What a program prints."""
    return subprocess.run([str(made), *map(str, words)], capture_output=True, text=True, check=True, **options).stdout


def numbers(made: Path, *words: object) -> Array:
    return np.array(said(made, *words).split(), dtype=np.float64)


Make = Callable[..., Path]


@pytest.fixture(scope="module")
def make(tmp_path_factory: pytest.TempPathFactory) -> Make:
    """Programs of this folder's files, each with its flags once."""
    return cache(lambda name, *flags: program(HERE / f"{name}.c", tmp_path_factory.mktemp(name), *flags))


WHOLE = str(LIBRARY / "integrate.c")


CHECKED = pytest.mark.parametrize(
    "flags", [(), pytest.param(SANITIZED, marks=pytest.mark.soak)], ids=["plain", "checked"]
)


@CHECKED
@pytest.mark.parametrize("method", METHODS)
def test_a_pendulum_written_by_hand(method: str, flags: tuple[str, ...], make: Make, reference: Array) -> None:
    """Every method goes where SciPy goes, dense output with it, and nothing is written behind its room."""
    motion = numbers(make("pendulum", WHOLE, *flags), METHODS.index(method)).reshape(-1, 2)
    assert np.abs(motion - reference).max() <= WITHIN[method]


def test_a_new_method_is_a_row(tmp_path: Path, reference: Array) -> None:
    """Published pairs, explicit and Rosenbrock, with no C of their own; the pendulum's matrix is its Jacobian."""
    library = tmp_path / "clib"
    shutil.copytree(LIBRARY, library)
    for file, text in render_tableaus((*TABLE, BS3, RODAS4)).items():
        (library / file).write_text(text)
    made = program(HERE / "pendulum.c", tmp_path, str(library / "integrate.c"))
    for number, within in ((len(METHODS), 1e-7), (len(METHODS) + 1, 2e-9)):
        assert np.abs(numbers(made, number).reshape(-1, 2) - reference).max() <= within


def test_a_method_with_too_many_stages_is_refused() -> None:
    long = replace(BS3, a=(*BS3.a, *[(0.0,)] * 4))
    with pytest.raises(ValueError, match="bs3: allowed: 6 stages; workspaces"):
        render_tableaus((long,))


@CHECKED
@pytest.mark.parametrize("method", METHODS[2:])
def test_calls_of_few_steps_go_on_to_the_bit(method: str, flags: tuple[str, ...], make: Make) -> None:
    """By what steps leave to the next call, in room that held other numbers before."""
    made, number = make("pendulum", WHOLE, *flags), METHODS.index(method)
    whole = said(made, number)
    assert [said(made, number, most) for most in (1, 7)] == [whole, whole]


def printed(text: str, folder: Path) -> list[int]:
    """Whole numbers that a program with these statements prints."""
    source = folder / "printed.c"
    source.write_text(f'#include "eom.h"\n#include <stdio.h>\nint main(void)\n{{\n{text}    return 0;\n}}\n')
    return [int(x) for x in said(program(source, folder)).split()]


KEPT = {
    "explicit_gradient": "EOM_EXPLICIT",
    "implicit_gradient": "EOM_IMPLICIT_EULER",
    "rosenbrock_gradient": "EOM_ROSENBROCK",
}


@pytest.mark.parametrize("name", ["one_link", "four_bar"])
def test_packages_keep_as_many_numbers_as_the_library(name: str, tmp_path: Path) -> None:
    """Callers of packages allocate what is kept of steps; classical and Tsitouras' steps share their room."""
    model = build_model(eomgen.load_robot(name))
    sizes = ", ".join(f"EOM_KEPT_NUMBERS({model.size}, {len(model.constraints)}, {x})" for x in KEPT.values())
    kept = kept_of_a_step(model)
    assert printed(f'    printf("%d %d %d", {sizes});\n', tmp_path) == [kept[name] for name in KEPT]


PRECISIONS = {"float64": (), "float32": ("-DEOM_SINGLE",)}


WAYS = {"linked": (WHOLE,), "included": ("-DINCLUDED",)}


NEAR = {"float64": 1e-13, "float32": 1e-5}  # adjoint and tangent, beside the larger of both


@pytest.mark.parametrize(("way", "dtype"), soaked(product(WAYS, PRECISIONS), {("included", "float32")}))
def test_derivatives_of_a_pendulum(way: str, dtype: str, make: Make) -> None:
    """Adjoint and tangent agree, differences with both; nothing outside the rooms asked for is touched."""
    text = said(make("pendulum_derivatives", *SANITIZED, *PRECISIONS[dtype], *WAYS[way]))
    found = np.array([[float(x) for x in line.split()[2:]] for line in text.splitlines()]).reshape(4, 2, 5)
    whole, along, back, slope, same = np.moveaxis(found, -1, 0)  # by methods, without and with inputs
    assert same.all()  # with what is kept of steps, and without
    assert np.abs(along - back).max() <= NEAR[dtype] * np.abs(along).max()
    if dtype == "float64":
        assert np.abs(whole - slope).max() <= 1e-8
    assert np.abs(whole - back).min() > 1.0  # what the tangent leaves out matters, and so do inputs
    assert np.abs(whole[:, 0] - whole[:, 1]).min() > 1.0


@pytest.mark.soak
@pytest.mark.parametrize("dtype", PRECISIONS)
def test_bits_are_those_of_the_library_included(dtype: str, make: Make) -> None:
    one, other = (said(make("pendulum_derivatives", "-O2", *PRECISIONS[dtype], *flags)) for flags in WAYS.values())
    assert one == other


@pytest.mark.parametrize("flags", [(*x, *y) for x in PRECISIONS.values() for y in WAYS.values()])
def test_clang_warns_of_nothing(flags: tuple[str, ...], tmp_path: Path) -> None:
    said(program(HERE / "pendulum_derivatives.c", tmp_path, *flags, compiler=compiler_of("clang")[0]))


@pytest.mark.parametrize("seed", range(4))
def test_switching_chooses_as_python_does(seed: int, make: Make) -> None:
    """Random turns, in which the worth of both methods changes, lead to the same methods for as many steps."""
    rng = np.random.default_rng(seed)
    model, turns = Alternation(), []
    expected = [(model.method, model.steps)]
    for k in range(300):
        stiff = (k // 60) % 2 == 1
        steps = int(rng.integers(1, model.steps + 1))
        length = rng.uniform(0.5, 1.5) * (0.2 if stiff and model.method == "tsit5" else 1.0)
        cost, time = COST[model.method], float(steps * length)
        turns.append((steps, cost, time))
        model.took(Turn(steps, time, 0, cost * steps))
        expected.append((model.method, model.steps))
    text = said(make("switching"), input="".join(f"{steps} {cost} {time!r}\n" for steps, cost, time in turns))
    found = [tuple(map(int, line.split())) for line in text.splitlines()]
    assert found == [(ADAPTIVE[method], steps) for method, steps in expected]
    assert {method for method, _ in expected} == {"rosenbrock", "tsit5"}
    assert max(steps for _, steps in expected) > 24 * 8


UPPER, FOREARM = 0.8, 0.5  # m


STATES = np.array([[0.0, 0.0, 0.0], [0.7, 0.2, -1.1], [-2.9, -0.1, 0.4]])  # rad, m, rad


def frame_of(q: Array, frame: int) -> tuple[Array, Array]:
    """Pose, (4, 4), and Jacobian, (6, 3), of a frame: of the base, at the upper link's end, at the forearm's."""
    angle, reach = (0.0, q[0], q[0] + q[2])[frame], (0.0, UPPER, UPPER + q[1])[frame]
    along, across = np.array([np.cos(q[0]), np.sin(q[0])]), np.array([-np.sin(q[0]), np.cos(q[0])])
    tip = np.array([np.cos(angle), np.sin(angle)]) * (FOREARM if frame == 2 else 0.0)
    tip_across = np.array([-tip[1], tip[0]])
    pose, jacobian = np.eye(4), np.zeros((6, 3))
    pose[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    pose[:2, 3] = reach * along + tip
    if frame >= 1:
        jacobian[:2, 0], jacobian[5, 0] = reach * across + tip_across, 1.0
    if frame == 2:
        jacobian[:2, 1], jacobian[:2, 2], jacobian[5, 2] = along, tip_across, 1.0
    return pose, jacobian


@pytest.mark.parametrize("way", soaked(["0", "16", "32", "follows"], ["0", "32"]))
def test_an_arm_written_by_hand(way: str, make: Make) -> None:
    """Poses and Jacobians of all frames, by lanes to the bit; of a forearm that follows both axes are one column."""
    follows = way == "follows"
    flags = ("-DFOLLOWS",) if follows else (f"-DEOM_VECTOR_BYTES={way}", *(("-mavx",) if way == "32" else ()))
    states = STATES[:, :2] if follows else STATES
    found = numbers(make("arm", "-ffp-contract=off", *SANITIZED, *flags), UPPER, FOREARM, *states.ravel().tolist())
    for frame, rows in enumerate(found.reshape(3, len(states), -1)):
        for q, row in zip(states, rows, strict=True):
            pose, jacobian = frame_of(np.append(q, q[0]) if follows else q, frame)
            if follows:
                jacobian = np.stack([jacobian[:, 0] + jacobian[:, 2], jacobian[:, 1]], axis=1)
            assert row[:16].reshape(4, 4) == pytest.approx(pose, abs=1e-15)
            assert row[16:-1].reshape(6, -1) == pytest.approx(jacobian, abs=1e-15)
            assert row[-1] == 1.0


R, L = 0.3, 0.7  # m


@pytest.mark.parametrize("method", METHODS[2:])
def test_steps_into_states_without_accelerations(method: str, make: Make) -> None:
    """They are tried again, shorter; a motion that leads there ends at them, and one that begins there takes none."""
    bounded, number, stiffness = make("bounded", WHOLE), ADAPTIVE[method], (2.0 * np.pi) ** 2
    reason, _, rejected, t, q, v = numbers(bounded, number, stiffness, 0.9, 0.0, 0.5)
    assert (reason, t) == (1, 2.0)
    assert rejected > 0
    assert (q, v) == pytest.approx((0.9, 0.0), abs=1e-6)
    reason, steps, _, t, q, v = numbers(bounded, number, 0.0, 0.0, 1.0, 0.1)
    assert (reason, t, q, v) == (4, pytest.approx(1.0), pytest.approx(1.0), pytest.approx(1.0))
    assert t < 1.0
    assert steps > 0
    assert numbers(bounded, number, 0.0, 1.5, -1.0, 0.1).tolist() == [4, 0, 0, 0.0, 1.5, -1.0]


def slider_crank(angle: float, v: float, a: float) -> Array:
    """Coordinates, velocities and accelerations of crank, rod and slider, (3, 3)."""
    rod = -np.arcsin(R * np.sin(angle) / L)
    slope = -R * np.cos(angle) / (L * np.cos(rod))
    by_angle = -R * np.sin(angle) - L * np.sin(rod) * slope
    bend = (R * np.sin(angle) + L * np.sin(rod) * slope**2) / (L * np.cos(rod))
    bend_slider = -R * np.cos(angle) - L * np.cos(rod) * slope**2 - L * np.sin(rod) * bend
    q = [angle, rod, R * np.cos(angle) + L * np.cos(rod)]
    rates = [v, slope * v, by_angle * v]
    return np.array([q, rates, [a, slope * a + bend * v**2, by_angle * a + bend_slider * v**2]])


@pytest.fixture(scope="module")
def crank(make: Make) -> Path:
    return make("crank", *SANITIZED)


@pytest.mark.parametrize("angle", [0.0, 0.7, 2.0, -2.9])
def test_dependent_coordinates_follow(angle: float, crank: Path) -> None:
    """Rod and slider move as the crank's kinematics says, and the constraint is met."""
    wanted = slider_crank(angle, 1.3, -0.4)
    out = numbers(crank, "dependent", angle, 1.3, -0.4, wanted[0, 1] + 0.05, wanted[0, 2] - 0.04, 8)
    assert out[:9].reshape(3, 3) == pytest.approx(wanted, abs=1e-11)
    slopes = out[9:15].reshape(2, 3)
    assert slopes[:, 0] == pytest.approx(slider_crank(angle, 1.0, 0.0)[1, 1:], abs=1e-11)
    assert not slopes[:, 1:].any()
    assert np.abs(out[15:]).max() <= 1e-11


def test_guesses_that_are_not_followed(crank: Path) -> None:
    """One that is too far is left with its violation; no steps leave it as it is."""
    assert np.abs(numbers(crank, "dependent", 0.7, 0.0, 0.0, 1.4, 3.0, 8)[15:]).max() > 1e-3
    assert numbers(crank, "dependent", 0.7, 0.0, 0.0, -0.2, 0.9, 0)[1:3].tolist() == [-0.2, 0.9]


@pytest.mark.parametrize(
    ("what", "values", "status"),
    [
        ("constraints", (0.0, 1e-10, 0.0, -1e-10, 0.0), 0),
        ("constraints", (2e-9, 0.0, 0.0, 0.0, 0.0), 4),
        ("constraints", (0.0, -2e-9, 0.0, 0.0, 100.0), 5),  # violations are not the smaller for speed
        ("constraints", (0.0, 0.0, 2e-9, 0.0, 0.0), 6),
        ("constraints", (0.0, 0.0, 2e-9, 0.0, -3.0), 0),  # rates are
        ("constraints", (0.0, 0.0, 0.0, "nan", 0.0), 7),
        ("drives", (5.0, -5.0, 0.0, 0.0, 0.0, 0.0), 0),
        ("drives", (5.0, -5.0 + 1e-8, 0.0, 0.0, 0.0, 0.0), 9),
        ("drives", (5.0, -5.0 + 1e-8, 0.0, 0.0, 0.0, 20.0), 0),
        ("drives", (0.0, 0.0, 2e-9, 0.0, 0.0, 0.0), 12),
        ("drives", (0.0, 0.0, 2e-9, -3.0, 0.0, 0.0), 0),
        ("drives", (5.0, 0.0, 1.0, 0.0, 1.0, 0.0), 4),  # the violation comes first
    ],
)
def test_violations_and_drives_that_do_not_make_the_motion(
    what: str, values: tuple[object, ...], status: int, crank: Path
) -> None:
    assert int(said(crank, what, *values)) == status


def test_no_compiler_warns_of_single_precision(tmp_path: Path) -> None:
    """Both files compile by themselves in single precision, by both compilers."""
    files = ("precision.h", "state_one.h", "constraint_checks.h", "dependent_coordinates.h")
    text = "#include <math.h>\n" + "".join(f'#include "{name}"\n' for name in files) + "int main(void) { return 0; }\n"
    (tmp_path / "x.c").write_text(text)
    for compiler in filter(shutil.which, ("gcc", "clang")):
        program(tmp_path / "x.c", tmp_path, "-DEOM_SINGLE", compiler=compiler)
