"""The textbook Newton-Euler algorithm equals the kernels; ``bench`` has its rows; operation counts hold their line.

Nothing here asserts a time.
"""

from __future__ import annotations

import json
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import eomgen
from eomgen.bench.beside import CALLS, COUNTERPARTS, STATES, bench, compare
from eomgen.bench.textbook import Yardstick, compile_yardstick, instrument, newton_euler
from eomgen.codegen.kernels.signatures import KERNELS
from eomgen.codegen.package.compile import WARNINGS
from eomgen.pipeline.options import KERNEL_NAMES
from eomgen.robot.model import build_model
from eomgen.robot.value import COORDINATES, Coordinate, Robot
from eomgen.runtime.calls import Calls
from tests.support.builds import Build
from tests.support.random_robots import random_robot, random_state, seeds
from tests.support.soak import soaked

Array = NDArray[np.float64]
EPS = float(np.finfo(np.float64).eps)
DATA = Path(__file__).parents[2] / "benchmarks" / "data"
TYPES = ("revolute", "prismatic", "fixed", "free")


def some_robot(seed: int) -> Robot:
    """Chains and trees, with and without springs, dampers and armatures."""
    return random_robot(seed, tree=seed % 2 == 1, types=TYPES, forces=seed % 3 > 0, armature=seed % 4 > 0)


def six(robot: Robot) -> Robot:
    """The same robot with six active coordinates in every joint."""
    return robot.with_coordinates(
        {
            joint.name: {name: Coordinate() for name in COORDINATES if name not in joint.coordinates}
            for joint in robot.joints
        }
    )


def run(yardstick: Yardstick, name: str, *arrays: Array, shape: tuple[int, ...]) -> Array:
    out = np.full(shape, np.nan)
    assert yardstick.run(name, arrays, out) == 0
    return out


def relative(found: Array, expected: Array) -> float:
    return float(np.max(np.abs(found - expected)) / np.max(np.abs(expected)))


def check_equal(kernel: eomgen.Kernel, robot: Robot, seed: int, states: int = 5) -> None:
    yardstick = compile_yardstick(build_model(robot), ("-O0",))
    n = kernel.n
    for i in range(states):
        state = random_state(robot, 100 * seed + i)
        drive = run(yardstick, "inverse_dynamics", state.q, state.v, state.a, shape=(n,))
        assert relative(drive, kernel.inverse_dynamics(state.q, state.v, state.a)) < 1e-11
        matrix = run(yardstick, "mass_matrix", state.q, shape=(n, n))
        assert relative(matrix, kernel.mass_matrix(state.q)) < 1e-11
        expected = kernel.forward_dynamics(state.q, state.v, state.u)
        found = run(yardstick, "forward_dynamics", state.q, state.v, state.u, shape=(n,))
        assert relative(found, expected) < max(1e-11, 100 * float(np.linalg.cond(matrix)) * EPS)


@pytest.mark.soak
@pytest.mark.parametrize("seed", seeds(0, 1, 12))
def test_textbook_equals_kernels_on_random_robots(seed: int, built: Build) -> None:
    robot = some_robot(seed)
    check_equal(built(robot, *COUNTERPARTS), robot, seed)


@pytest.mark.parametrize("name", soaked(("one_link", "puma560", "puma560_elastic", "ur5"), ("one_link", "puma560")))
def test_textbook_equals_kernels_on_built_in_robots(name: str, built: Build) -> None:
    robot = eomgen.load_robot(name)
    check_equal(built(robot, *COUNTERPARTS), robot, 7)


@pytest.mark.soak
@pytest.mark.parametrize("compiler", ["gcc", "clang"])
def test_textbook_compiles_without_a_warning(compiler: str, tmp_path: Path) -> None:
    if shutil.which(compiler) is None:
        pytest.skip(f"there is no {compiler} here")
    for seed in (0, 1, 2, 5, 9):
        source = tmp_path / f"robot{seed}.c"
        source.write_text(newton_euler(build_model(some_robot(seed))), encoding="ascii")
        for level in ("-O0", "-O2"):
            command = [compiler, level, *WARNINGS, "-Werror", "-c", str(source), "-o", str(tmp_path / "robot.o")]
            said = subprocess.run(command, capture_output=True, text=True, check=False)
            assert said.returncode == 0, said.stderr


def test_counting_counts_what_a_hand_counts() -> None:
    """Newton-Euler on the UR5, all six joints placed: the sum of the products in the source, by hand."""
    robot = eomgen.load_robot("ur5")
    yardstick = compile_yardstick(build_model(robot), ("-O0",))
    state = random_state(robot, 1)
    found = yardstick.operations("inverse_dynamics", (state.q, state.v, state.a), np.zeros(6))
    pose, origin, axes, spin, body, back = 12, 18, 27, 2, 51, 24
    code = newton_euler(build_model(robot))
    own = 6 * code.count("return l->stiffness * q") + 6 * code.count("l->damping * v;")
    assert found["mul"] == 6 * (pose + origin + axes + spin + body) + 5 * back + own
    assert found["sincos"] == 6
    assert found["div"] == 0


def test_counting_knows_doubles_from_integers(tmp_path: Path) -> None:
    code = """
    double work(const double *x, int n) {
        double sum = -x[0];
        for (int i = 1; i < 2 * n - n; ++i) sum += x[i] * 2.0 - x[i - 1] / (i > 1 ? x[i] : sin(x[0]));
        return sum;
    }
    """
    text = instrument(code)
    text += """
    #include <stdio.h>
    int main(void) {
        const double x[4] = { 1.0, 2.0, 3.0, 4.0 };
        operations_clear();
        work(x, 4);
        printf("%ld %ld %ld %ld", operations[0], operations[1], operations[2], operations[3]);
        return 0;
    }
    """
    (tmp_path / "count.c").write_text(text, encoding="ascii")
    program = tmp_path / "count"
    subprocess.run(["cc", str(tmp_path / "count.c"), "-o", str(program), "-lm"], check=True)
    assert subprocess.run([program], capture_output=True, text=True, check=True).stdout == "3 7 3 1"


@pytest.fixture(scope="module")
def tiny() -> Robot:
    return random_robot(3, joints=(2, 2), max_coordinates=2, forces=False, name="tiny")


@pytest.mark.soak
def test_bench_has_a_row_for_every_kernel(tiny: Robot) -> None:
    said: list[str] = []
    result = bench(tiny, repeat=2, progress=said.append)
    names = [row.kernel.name for row in result.rows]
    expected = [
        name
        for name in KERNEL_NAMES
        if name not in ("kinematics", "rollout", "adaptive_rollout")
        and KERNELS[name].needs in ("", "rigid")
        and not (KERNELS[name].derivative_of or KERNELS[name].by_request)
    ] + [
        "frame_pose",
        "frame_jacobian",
    ]
    assert sorted(names) == sorted(expected)
    for row in result.rows:
        assert row.kernel.least > 0
        assert row.kernel.median >= row.kernel.least
        assert (row.counterpart is not None) == (row.kernel.name in COUNTERPARTS)
        if row.counterpart is not None:
            assert row.ratio is not None
            assert row.ratio > 0
            assert row.counterpart.operations["mul"] > 0
    assert result.error < 1e-11
    assert any("mass_matrix" in line for line in said)


def test_bench_prints_a_table_and_json(tiny: Robot) -> None:
    result = bench(tiny, repeat=1, kernels=("mass_matrix", "energy"))
    text = "\n".join(result.lines())
    assert text.isascii()
    for word in ("tiny", "mass_matrix", "composite bodies", "energy", "ratio"):
        assert word in text
    assert "mass_matrix called from Python with one state: " in text
    values = json.loads(json.dumps(result.as_dict()))
    assert (values["note"], "open tree" in text) == ("", False)
    assert len(values["call"]) == 2
    assert (values["robot"], values["rounds"], values["states"]) == ("tiny", 1, STATES)
    assert values["coordinates"] == build_model(tiny).size
    assert 0.0 <= values["error"] < 1e-11
    assert min(values["call"]) > 0.0
    assert [row["kernel"]["name"] for row in values["rows"]] == ["mass_matrix", "energy"]
    assert values["rows"][0]["kernel"]["operations"]["mul"] >= 0
    table = {line[:26].strip(): line[26:].split() for line in result.lines()}
    for row in result.rows:
        for one in filter(None, (row.kernel, row.counterpart)):
            counts = [one.operations[key] for key in ("mul", "add", "div", "sincos")]
            assert [float(x) for x in table[one.name][:6]] == pytest.approx([*counts, one.median, one.least], abs=0.051)
    [against] = [row for row in result.rows if row.counterpart is not None]
    assert table["composite bodies"][6] == f"{against.ratio:.2f}"
    system = Path("/proc/cpuinfo")
    if system.exists() and "model name" in system.read_text():
        assert f": {result.processor}\n" in system.read_text()


@pytest.mark.soak
@pytest.mark.parametrize("name", ["inverse_dynamics", "frame_pose", "external_force"])
def test_what_is_called_from_python_is_what_users_call(name: str, tiny: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    """The kernel's own method, plain calls of which do not come to Python but for the first one."""
    came: list[str] = []
    run = Calls.run

    def noted(self: Calls, kernel: str, *rest: object, **how: object) -> object:
        came.append(kernel)
        return run(self, kernel, *rest, **how)  # type: ignore[arg-type]

    monkeypatch.setattr(Calls, "run", noted)
    result = bench(tiny, repeat=1, kernels=(name,))
    assert result.called == name
    assert min(result.call) > 0.0
    assert result.is_direct == eomgen.build(tiny, kernels=(name,)).functions.is_direct
    if result.is_direct:
        assert came.count(name) <= 2
        assert "cffi" not in result.lines()[-1]
    else:
        assert came.count(name) >= 2 * CALLS
        assert "through cffi" in result.lines()[-1]


def test_links_that_bend_are_timed() -> None:
    """At small deflections; the textbook's algorithm knows none, and stands beside nothing."""
    result = bench("flexible_arm", repeat=1, kernels=("forward_dynamics", "mass_matrix"), flags=("-O0",))
    assert {row.kernel.name for row in result.rows} == {"forward_dynamics", "mass_matrix"}
    assert result.error is None
    assert "no links that bend (upper.mode1, " in result.note


@pytest.mark.soak
def test_figures_of_loops_are_the_open_trees() -> None:
    result = bench("four_bar", repeat=1, kernels=("mass_matrix",))
    (note,) = [line for line in result.lines() if "open tree" in line]
    assert "'joint4'" in note
    assert result.as_dict()["note"] == note


@pytest.mark.soak
def test_closed_mechanisms_have_no_textbook_beside_them() -> None:
    """At closed states; what is of the open tree has its counterpart, and the note says which is which."""
    result = bench("four_bar", repeat=1, kernels=("forward_dynamics", "tree_forward_dynamics", "constraint_forces"))
    rows = {row.kernel.name: row for row in result.rows}
    assert not any(row.note for row in rows.values())
    assert rows["forward_dynamics"].counterpart is None
    assert rows["tree_forward_dynamics"].counterpart is not None
    assert rows["forward_dynamics"].kernel.median > 0.0
    (note,) = [line for line in result.lines() if "closed mechanism" in line]
    assert note.startswith("forward_dynamics, constraint_forces: of the closed mechanism ('joint4')")


@pytest.mark.soak
def test_what_differs_is_refused(tiny: Robot, built: Build) -> None:
    kernel, rng = built(tiny, "inverse_dynamics"), np.random.default_rng(1)
    inputs = {label: rng.uniform(-1.0, 1.0, (STATES, kernel.n)) for label in "qva"}
    heavier = replace(tiny, links=tuple(replace(link, mass=2 * link.mass) for link in tiny.links))
    assert compare(kernel, compile_yardstick(build_model(tiny), ("-O0",)), inputs) < 1e-12
    with pytest.raises(eomgen.errors.InternalError, match="differs"):
        compare(kernel, compile_yardstick(build_model(heavier), ("-O0",)), inputs)


@pytest.mark.soak
def test_bench_says_when_a_robot_has_no_inertia(tiny: Robot) -> None:
    light = tuple(replace(link, mass=0.0, com=(0.0, 0.0, 0.0), inertia=(0.0,) * 6) for link in tiny.links)
    still = tuple(
        replace(joint, coordinates={name: Coordinate() for name in joint.coordinates}) for joint in tiny.joints
    )
    result = bench(replace(tiny, links=light, joints=still), repeat=1, kernels=("forward_dynamics",))
    assert "no inertia" in result.rows[0].note
    assert "no inertia" in "\n".join(result.lines())


@pytest.mark.parametrize("repeat", [0, -1, 1.5, True])
def test_bench_refuses_a_repeat_that_is_none(tiny: Robot, repeat: int) -> None:
    with pytest.raises(eomgen.errors.InputError, match="repeat"):
        bench(tiny, repeat=repeat)


@pytest.mark.parametrize(
    ("name", "all_six", "kernel", "mul", "add"),
    [
        ("puma560_generic", False, "inverse_dynamics", 249, 228),
        ("puma560_generic", False, "mass_matrix", 135, 139),
        ("puma560_generic", False, "forward_dynamics", 455, 412),
        ("ur5_generic", False, "inverse_dynamics", 247, 227),
        ("ur5_generic", False, "mass_matrix", 126, 134),
        ("ur5_generic", False, "forward_dynamics", 437, 397),
        ("puma560_generic", True, "inverse_dynamics", 725, 622),
        ("puma560_generic", True, "mass_matrix", 2457, 1602),
        ("puma560_generic", True, "forward_dynamics", 767, 656),
    ],
)
def test_operation_counts_hold_their_line(
    name: str, all_six: bool, kernel: str, mul: int, add: int, built: Build
) -> None:
    """Robots with all ten inertial parameters in every link; counted from the emitted program."""
    robot = eomgen.load_robot(str(DATA / f"{name}.urdf"))
    kernels = ("inverse_dynamics", "mass_matrix", "forward_dynamics")
    found = built(six(robot) if all_six else robot, *kernels).operations[kernel]
    assert found["mul"] <= mul
    assert found["add"] <= add
