"""The C library without a robot: its tables, a pendulum written by hand, its warnings."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from fractions import Fraction
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

import eomgen
from eomgen.codegen.c.library import library_files, library_types
from eomgen.codegen.kernels.steps.methods import RK4, TSIT5, W643
from tests.support.soak import soaked

LIBRARY = Path(eomgen.__path__[0], "clib")
HERE = Path(__file__).parent
EXAMPLE = Path(__file__).parents[2] / "examples" / "pendulum.c"
WARNINGS = ("-std=c99", "-Wall", "-Wextra", "-Wconversion", "-pedantic", "-Werror")
COMPILERS = ("gcc", "clang", "zig")  # the last one is clang, too
OPTIONS: tuple[tuple[str, ...], ...] = ((), ("-DEOM_SINGLE",), ("-DEOM_N=3", "-DEOM_M=0", "-DEOM_ROTATIONS=0"))
WIDTHS = {"-DEOMGEN_VECTOR=0": 1, "-mno-avx": 2, "-mavx2": 4, "-mavx512f": 8}
METHODS = ("rk4", "implicit", "rosenbrock", "tsit5", "radau")
WITHIN = {"rk4": 1e-12, "implicit": 2e-4, "rosenbrock": 1e-8, "tsit5": 2e-9, "radau": 2e-9}  # rad, rad/s
Array = NDArray[np.float64]


def compiler_of(name: str) -> list[str]:
    """Words that call a compiler of COMPILERS, where it is installed."""
    if name == "zig":
        pytest.importorskip("ziglang")
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
    ahead, back, weight, wrong = W643.transformed()
    n = len(weight)
    assert np.array_equal(table("eom_tsit5_a"), TSIT5.a[:, : table("eom_tsit5_a").shape[1]])
    assert np.array_equal(table("eom_tsit5_error")[0], TSIT5.error)
    assert np.array_equal(table("eom_tsit5_works"), TSIT5.between)
    assert table("eom_rosenbrock_diagonal")[0, 0] == W643.diagonal
    assert np.array_equal(table("eom_rosenbrock_a"), ahead[:, : n - 1])
    assert np.array_equal(table("eom_rosenbrock_c"), back[:, : n - 1])
    assert np.array_equal(table("eom_rosenbrock_b")[0], weight)
    assert np.array_equal(table("eom_rosenbrock_error")[0], wrong)
    assert np.array_equal(table("eom_rosenbrock_works")[0], W643.b)
    doubted = table("eom_work_errors")
    assert np.array_equal(doubted[:2], [[*(W643.b - W643.embedded), 0.0], TSIT5.error])
    explicit = table("eom_explicit_a")
    classical, tsitouras = explicit[:7], explicit[7:]
    assert np.array_equal(classical[:5, :4], [*RK4.a, RK4.b])
    assert not classical[5:].any()
    assert np.array_equal(tsitouras[:6, :6], TSIT5.a[:-1, :-1])
    assert np.array_equal(tsitouras[6, :6], TSIT5.b[:-1])


def test_tables_of_radau_are_those_of_its_conditions() -> None:
    """Collocation at Radau's points, by powers; eigenvalues of the inverse of its matrix; an error of order 5."""
    nodes = table("eom_radau_shares")[0]
    count, powers = len(nodes), np.arange(1, len(nodes) + 1)
    collocation = np.polynomial.Polynomial([0.0] * (count - 1) + [1.0]) * np.polynomial.Polynomial([-1.0, 1.0]) ** count
    assert np.abs(collocation.deriv(count - 1)(nodes)).max() <= 1e-11
    a = (nodes[:, None] ** powers / powers) @ np.linalg.inv(nodes[:, None] ** (powers - 1))
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
    assert np.abs(table("eom_radau_works").sum(axis=1) - a[-1]).max() <= 1e-14
    first, *wrong = table("eom_work_errors")[2][: count + 1]
    assert first == pytest.approx(1.0 / real, rel=1e-15)
    embedded = a[-1] + np.array(wrong)
    for order in range(1, count + 1):
        assert embedded @ nodes ** (order - 1) + first * (order == 1) == pytest.approx(1.0 / order, abs=1e-14)
    assert np.abs(real * np.array(wrong) @ np.linalg.inv(a) - table("eom_radau_error")[0]).max() <= 1e-12


def test_shares_of_stages_are_sums_of_their_rows() -> None:
    for name, a in (("tsit5", TSIT5.a), ("rosenbrock", W643.alpha)):
        assert table(f"eom_{name}_shares")[0] == pytest.approx(a.sum(axis=1), abs=1e-15)


def test_the_rule_of_gauss_is_exact_for_polynomials_of_degree_9() -> None:
    nodes, weights = (table(f"eom_gauss_{name}")[0] for name in ("nodes", "weights"))
    for degree in range(10):
        assert weights @ nodes**degree == pytest.approx(1.0 / (degree + 1), rel=1e-14)
    assert abs(weights @ nodes**10 - float(Fraction(1, 11))) > 1e-8


def compiled(source: Path, folder: Path, *flags: str, compiler: str = "gcc") -> Path:
    """The program of a file and the library."""
    program = folder / "program"
    command = [compiler, *WARNINGS, "-O0", *flags, f"-I{LIBRARY}", str(source), str(LIBRARY / "integrate.c")]
    done = subprocess.run([*command, "-o", str(program), "-lm"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return program


@pytest.fixture(scope="module")
def reference() -> Array:
    """The pendulum's motion by SciPy, (11, 2)."""
    m, length, g, d = 1.5, 0.8, 9.81, 0.05

    def rate(_: float, y: Array) -> list[float]:
        return [y[1], (-m * g * length * np.sin(y[0]) - d * y[1]) / (m * length**2)]

    times = np.linspace(0.0, 1.0, 11)
    solved = solve_ivp(rate, (0.0, 1.0), [1.2, 0.3], "DOP853", times, rtol=1e-13, atol=1e-14)
    return np.asarray(solved.y.T)


SANITIZED = ("gcc", *WARNINGS, "-O0", "-fsanitize=address,undefined")


@pytest.fixture(scope="module")
def sanitized(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The library's object that looks at its memory."""
    made = tmp_path_factory.mktemp("library") / "integrate.o"
    subprocess.run([*SANITIZED, "-c", str(LIBRARY / "integrate.c"), "-o", str(made)], check=True)
    return made


def linked(source: Path, folder: Path, library: Path) -> Path:
    """The program of a file and that object."""
    program = folder / "program"
    subprocess.run([*SANITIZED, f"-I{LIBRARY}", str(source), str(library), "-o", str(program), "-lm"], check=True)
    return program


@pytest.fixture(scope="module")
def pendulum(sanitized: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return linked(HERE / "pendulum.c", tmp_path_factory.mktemp("pendulum"), sanitized)


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
    sizes.n = sizes.hoisted = sizes.factors = 1;
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


@pytest.mark.parametrize("method", METHODS)
def test_a_pendulum_written_by_hand(method: str, pendulum: Path, reference: Array) -> None:
    """Every method goes where SciPy goes, dense output with it, and nothing is written behind its room."""
    command = [str(pendulum), str(METHODS.index(method))]
    said = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    motion = np.array([[float(x) for x in line.split()] for line in said.splitlines()])
    assert np.abs(motion - reference).max() <= WITHIN[method]


@pytest.mark.parametrize("method", METHODS[2:])
def test_calls_of_few_steps_go_on_to_the_bit(method: str, pendulum: Path) -> None:
    """By what steps leave to the next call, in room that held other numbers before."""
    command = [str(pendulum), str(METHODS.index(method))]
    whole, *pieces = (
        subprocess.run([*command, *most], capture_output=True, text=True, check=True).stdout for most in ([], "1", "7")
    )
    assert pieces == [whole, whole]


@pytest.fixture(scope="module")
def shaken(sanitized: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return linked(HERE / "shaken_pendulum.c", tmp_path_factory.mktemp("shaken"), sanitized)


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
def test_fixed_steps_under_inputs(
    method: str, order: int, within: float, shaken: Path, shaken_reference: Array
) -> None:
    """Steps converge to SciPy's motion at their order under a prescribed motion, a torque, control and a wrench."""
    errors = []
    for steps in (100, 200):
        command = [str(shaken), str(METHODS.index(method)), str(steps)]
        said = subprocess.run(command, capture_output=True, text=True, check=True).stdout
        errors.append(np.abs(np.array(said.split(), dtype=np.float64) - shaken_reference))
    assert errors[1].max() <= within
    assert errors[1][[0, 2]].max() <= 1e-15
    assert 0.8 * 2**order <= errors[0].max() / errors[1].max() <= 1.25 * 2**order


def test_the_example_runs(tmp_path: Path) -> None:
    """The page's pendulum: undamped, so its energy stays."""
    said = subprocess.run([str(compiled(EXAMPLE, tmp_path))], capture_output=True, text=True, check=True).stdout
    page = (Path(__file__).parents[2] / "docs" / "library.md").read_text(encoding="utf-8")
    assert EXAMPLE.read_text(encoding="utf-8") in page
    assert said in page
    rows = np.array([[float(x) for x in re.findall(r"-?\d+\.\d+", line)] for line in said.splitlines()[1:]])
    energy = 0.5 * 0.8 * rows[:, 2] ** 2 - 9.81 * np.cos(rows[:, 1])
    assert energy == pytest.approx(energy[0], abs=1e-7)


def optimisation(compiler: str, level: str) -> str:
    """Return the level for gcc, which warns of more when it optimises; Clang's warnings are those of its front end."""
    return level if compiler == "gcc" else "-O0"


@pytest.mark.parametrize(
    ("compiler", "flags"), soaked(product(COMPILERS, OPTIONS), {*product(COMPILERS[:1], OPTIONS[:1])})
)
def test_no_compiler_warns(compiler: str, flags: tuple[str, ...], tmp_path: Path) -> None:
    command = compiler_of(compiler)
    level = optimisation(compiler, "-O2")
    command = [*command, *WARNINGS, level, *flags, "-c", str(LIBRARY / "integrate.c"), "-o", str(tmp_path / "x.o")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
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
    assert public == (set() if len(flags) == 3 else expected)


@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_types_that_cffi_reads_have_the_compilers_sizes(dtype: str, tmp_path: Path) -> None:
    """The declarations for cffi lay structures out as the headers do."""
    import cffi

    prefix = "eomf" if dtype == "float32" else "eom"
    names = ["eom_spline", "eom_track", "eom_tracking", "eom_computed_torque", "eom_prescribed", "eom_wrench"]
    names += ["eom_progress", *(f"{prefix}_{x}" for x in ("drive", "inputs", "tolerance", "record", "slopes", "rates"))]
    ffi = cffi.FFI()
    ffi.cdef(library_types(dtype))
    prints = "".join(f'    printf("%zu\\n", sizeof({name}));\n' for name in names)
    (tmp_path / "sizes.c").write_text(
        f'#include "eom.h"\n#include <stdio.h>\nint main(void)\n{{\n{prints}    return 0;\n}}\n'
    )
    command = ["gcc", f"-I{LIBRARY}", str(tmp_path / "sizes.c"), "-o", str(tmp_path / "sizes")]
    subprocess.run(command, check=True)
    said = subprocess.run([str(tmp_path / "sizes")], capture_output=True, text=True, check=True).stdout.split()
    assert [int(x) for x in said] == [ffi.sizeof(name) for name in names]
