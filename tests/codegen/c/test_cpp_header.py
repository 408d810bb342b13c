"""The header for C++17: every function against the Python kernel, rollouts, failures."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import eomgen
from eomgen.codegen.c.names import TAKEN, identifiers, safe
from eomgen.codegen.c.projects import project
from eomgen.codegen.c.projects.project import project_files, quoted, view
from eomgen.codegen.kernels.signatures import KERNELS
from eomgen.errors import LoopError, SingularError
from eomgen.names import kind_of
from eomgen.pipeline.options import Options
from eomgen.pipeline.stages import make_source
from eomgen.robot.coordinates import MODE
from eomgen.robot.model import build_model
from eomgen.robot.value import Robot
from eomgen.runtime.bound import frame_number
from eomgen.runtime.raw import RawFunction
from tests.support.bristles import servo_arm
from tests.support.c_project import COMPILERS, NO_EIGEN, PREAMBLE, WARNINGS, need_eigen, package_of, program, run
from tests.support.makers import MAKERS
from tests.support.random_robots import random_robot
from tests.support.refusals import refused
from tests.support.small_robots import held_body
from tests.support.soak import soaked
from tests.support.text_files import text_file

MAY_VANISH = ("bias_force", "christoffel", "coriolis_matrix", "external_force", "spring_stiffness")

BUILT_IN = [name for name in eomgen.builtin_robots() if name not in MAKERS]


def sprung() -> Robot:
    return eomgen.load_robot("balanced_arm")


def looped() -> Robot:
    return eomgen.load_robot("bennett")


def tree() -> Robot:
    robot = random_robot(31, joints=(3, 3), tree=True, max_coordinates=3, name="namespace")
    return replace(robot, tunable=(f"links.{robot.links[0].name}.mass",))


def kernel_of(robot: Robot, *kernels: str, dtype: str = "float64") -> eomgen.Kernel:
    """The kernel of ``package_of``, from the cache."""
    return eomgen.build(robot, kernels=kernels or "all", dtype=dtype, flags=("-O0",))


def literals(numbers: NDArray[np.floating]) -> str:
    suffix = "f" if numbers.dtype == np.float32 else ""
    return "{{" + ", ".join(float(x).hex() + suffix for x in numbers.ravel()) + "}}"


def all_functions(name: str, kernel: eomgen.Kernel, states: dict[str, NDArray[np.floating]]) -> str:
    """A program that calls every function in every way with two states, and prints what comes."""
    lines = [PREAMBLE.format(name=name, space=safe(name))]
    groups = ("coordinate", "joint", "link", "parameter", "spring", "constraint")
    for key, names in zip(groups, (*(getattr(kernel, f"{key}s") for key in groups),), strict=True):
        for text in names:
            index = f"arm::{key}s::{safe(text.replace('.', '_'))}"
            lines.append(f'static_assert(arm::{key}_names[{index}] == "{text}");')
    for text in kernel.frames:
        index = f"static_cast<std::size_t>(arm::Frame::{safe(text)})"
        lines.append(f'static_assert(arm::frame_names[{index}] == "{text}");')
    lines.append(f'static_assert(arm::index_of(arm::coordinate_names, "{kernel.coordinates[-1]}") == {kernel.n} - 1);')
    lines.append('static_assert(!arm::index_of(arm::frame_names, "nowhere"));')
    lines += ["int main()", "{", "const arm::Setup setup;", 'show("parameters", arm::Parameters{}.values);']
    for label, array in states.items():
        for part, values in (("", array[0]), ("_two", array)):
            lines.append(f"const std::array<arm::real, {values.size}> {label}{part}{literals(values)};")
    for function in kernel.raw.functions.values():
        lines += calls(function, kernel.raw.shapes[function.writes], kernel.frames[-1])
    return "\n".join([*lines, "return 0;", "}", ""])


def calls(called: RawFunction, writes: Sequence[int], frame: str) -> list[str]:
    """Lines that call one function in every way; statuses other than 0 say where the ways differ."""
    function, reads, shape, size = called.name, called.reads, view(writes), int(np.prod(writes))
    frame = f", arm::Frame::{frame}" if called.is_framed else ""
    one = ", ".join(reads) + frame
    mixed = ", ".join([f"{reads[0]}_two.data()", *reads[1:]]) + frame  # the first state for all but the first array
    two = ", ".join(f"{{{label}_two.data(), {label}.size()}}" for label in reads) + frame
    check = "if (!{}) return 1;" if function in KERNELS and KERNELS[function].solves else "{};"
    by_value = [f"if (found(arm::{function}(setup, {one})) != written) return 2;"]
    matrix = f"arm::EigenMatrix<{shape}> matrix;"
    if size > project.BY_VALUE:
        by_value, matrix = [], f"static std::array<arm::real, {size}> more; auto matrix = arm::map<{shape}>(more);"
    lines = [
        f"static std::array<arm::real, {size}> written;",
        check.format(f"arm::{function}(setup, {one}, written)"),
        f'show("{function}", written);',
        *by_value,
        f"static std::array<arm::real, 2 * {size}> batch;",
        check.format(f"arm::{function}_batch(setup, 2, {two}, batch.data())"),
        f'show("{function}_batch", batch);',
        check.format(f"arm::{function}_batch(setup, 2, {mixed}, batch.data())"),
        f'show("{function}_mixed", batch);',
        "#if EOMGEN_EIGEN",
        matrix,
        check.format(f"arm::{function}(setup, {one}, matrix)"),
        f"if (matrix != arm::map<{shape}>(written)) return 3;",
        "#endif",
    ]
    return ["{", *lines, "}"]


@pytest.mark.parametrize(
    ("make", "dtype", "compiler", "eigen"),
    [
        pytest.param(sprung, "float64", "gcc", True, marks=pytest.mark.soak),
        pytest.param(looped, "float64", "clang", False, marks=pytest.mark.soak),
        pytest.param(looped, "float64", "gcc", True, marks=pytest.mark.soak),
        (tree, "float32", "clang", True),
        pytest.param(tree, "float64", "gcc", False, marks=pytest.mark.soak),
    ],
    ids=lambda x: getattr(x, "__name__", str(x)),
)
def test_every_function_gives_what_the_kernel_gives(
    make: object, dtype: str, compiler: str, eigen: bool, tmp_path: Path
) -> None:
    """To the bit, from std::array and Eigen, for one state and for batches."""
    compare(make(), dtype, compiler, eigen, tmp_path)  # type: ignore[operator]


@pytest.mark.soak
@pytest.mark.parametrize("number", range(len(BUILT_IN)))
def test_headers_of_the_built_in_robots(number: int, tmp_path: Path) -> None:
    name, compiler = BUILT_IN[number], [*COMPILERS][number % 2]
    count = compare(
        eomgen.load_robot(name), ("float64", "float32")[number % 3 == 0], compiler, number % 4 < 2, tmp_path
    )
    print(f"{name}: {count} numbers of C++ are those of the Python kernel, {compiler}")


def test_functions_take_internal_states_and_forces_beside_drives(tmp_path: Path) -> None:
    kernels = ("forward_dynamics", "residual_tangent", "energy", "mass_matrix", "kinematics")
    compare(servo_arm(), "float64", "gcc", False, tmp_path, *kernels)


def compare(robot: Robot, dtype: str, compiler: str, eigen: bool, tmp_path: Path, *kernels: str) -> int:
    """Compare every function of the header with the kernel; the value is how many numbers there were."""
    package, kernel = package_of(robot, tmp_path, *kernels, dtype=dtype), kernel_of(robot, *kernels, dtype=dtype)
    generator = np.random.default_rng(7)
    functions, shapes = kernel.raw.functions, kernel.raw.shapes
    labels = {label for function in functions.values() for label in function.reads}
    states = {label: generator.uniform(-0.4, 0.4, (2, *shapes[label])).astype(kernel.dtype) for label in sorted(labels)}
    modes = [i for i, x in enumerate(kernel.coordinates) if kind_of(x).startswith(MODE)]
    states["q"][:, modes] *= 0.01  # deflections are small
    if kernel.constraints:
        states |= closed_states(robot, kernel)
    code = all_functions(robot.name, kernel, states)
    made = program(compiler, code, [package], tmp_path, *(need_eigen() if eigen else (NO_EIGEN,)))
    answers = {}
    for line in run(made).splitlines():
        name, *numbers = line.split()
        answers[name] = np.array([float.fromhex(x) for x in numbers], kernel.dtype)
    assert np.array_equal(answers.pop("parameters"), np.array([*kernel.parameters.values()], kernel.dtype))
    assert len(answers) == 3 * len(functions)
    count = 0
    for name, function in functions.items():
        frame = (frame_number(kernel.frames, kernel.frames[-1]),) if function.is_framed else ()
        one, two = ([states[label][:states_here] for label in function.reads] for states_here in (1, 2))
        mixed = [two[0], *(x[0] for x in one[1:])]
        for end, arrays in (("", [x[0] for x in one]), ("_batch", two), ("_mixed", mixed)):
            expected = kernel.calls.run(name, None, arrays, frame, whole=True).ravel()
            count += expected.size
            assert np.array_equal(answers[name + end], expected), name + end
            assert np.any(expected != 0) or name in MAY_VANISH, name
    return count


def closed_states(robot: Robot, kernel: eomgen.Kernel) -> dict[str, NDArray[np.floating]]:
    """Return two motions at home that keep the loops closed to the dtype's round-off, by the accelerations' size.

    Those without drives do by the size of the open tree's accelerations, which is 1e4 of theirs in Andrews' mechanism.
    """
    q = np.array([build_model(robot).home] * 2, dtype=kernel.dtype)
    v = np.array([[0.1], [-0.2]], dtype=kernel.dtype) * np.arange(1, kernel.n + 1, dtype=kernel.dtype)
    for _ in range(3):
        change = kernel.calls.run("settling", None, (q, v))
        q, v = q + change[:, : kernel.n], v + change[:, kernel.n : 2 * kernel.n]
    a = kernel.calls.run("constrained_dynamics", None, (q, v, np.zeros_like(q)))[:, : kernel.n]
    J, bias = (
        f.astype(np.float64) for f in (kernel.functions.constraint_jacobian(q), kernel.functions.constraint_bias(q, v))
    )
    left = np.einsum("sij,sj->si", J, a.astype(np.float64)) + bias
    a = (a - np.einsum("sij,sj->si", np.linalg.pinv(J, rcond=1e-4), left)).astype(kernel.dtype)
    return {"q": q, "v": v, "a": np.ascontiguousarray(a)}


REPORT = """
#include <cmath>
static void report(const char *what, const arm::Status &status)
{
    const std::string_view coordinate = arm::coordinate_names[status.coordinate()];
    std::printf("%s %d %.*s %zu %zu\\n", what, int(bool(status)),
                static_cast<int>(coordinate.size()), coordinate.data(), status.state(), status.step());
}
"""
OPEN = """
static void report_constraint(const char *what, const arm::Status &status)
{
    const std::string_view constraint = arm::constraint_names[status.constraint()];
    std::printf("%d %.*s ", int(status.reason()), static_cast<int>(constraint.size()), constraint.data());
    report(what, status);
}
int main()
{
    const arm::Setup setup;
    const std::array<double, 3> home{{HOME}};
    std::array<double, 3> zero{}, out{}, v{};
    std::array<double, 9> qs{}, q_out{}, v_out{};
    for (int i = 0; i < 9; ++i) qs[static_cast<std::size_t>(i)] = home[static_cast<std::size_t>(i % 3)];
    qs[8] += 0.1;
    v[0] = 1.0;
    report_constraint("good", arm::forward_dynamics(setup, home, zero, zero, out));
    report_constraint("batch", arm::forward_dynamics_batch(setup, 3, qs.data(), zero, zero, v_out.data()));
    report_constraint("rate", arm::forward_dynamics(setup, home, v, zero, out));
    std::printf("value %d\\n", int(arm::forward_dynamics(setup, home, v, zero).has_value()));
    qs[6] = 0.0 * HUGE_VAL;
    arm::Drive drive{};
    drive.u = zero.data();
    report_constraint("rollout", arm::rollout_batch(
        setup, 3, qs.data(), zero, drive, 1e-3, 2, 2, arm::Method::rk4, q_out.data(), v_out.data()));
    return 0;
}
"""


def printed(robot: Robot, kernels: Sequence[str], code: str, folder: Path) -> tuple[eomgen.Kernel, list[list[str]]]:
    """Kernels of a robot, and words of the lines that a program with its header prints."""
    package = package_of(robot, folder, *kernels)
    text = PREAMBLE.format(name=robot.name, space=robot.name) + code
    lines = run(program("gcc", text, [package], folder, NO_EIGEN)).splitlines()
    return kernel_of(robot, *kernels), [line.split() for line in lines]


@pytest.mark.soak
def test_loops_that_are_open_are_reported(tmp_path: Path) -> None:
    """Which component of which loop, and whether it is open or opening, as the Python kernel's error says."""
    robot = eomgen.load_robot("four_bar")
    home = np.array(build_model(robot).home)
    code = REPORT + OPEN.replace("{{HOME}}", literals(home))
    kernel, lines = printed(robot, ("forward_dynamics", "rollout"), code, tmp_path)
    still, qs = np.zeros(3), np.stack([home] * 3)
    qs[2, 2] += 0.1
    refused(LoopError, r"is open in state 2: joint4\.x is left", kernel.forward_dynamics, qs, still, still)
    refused(LoopError, r"is opening: joint4\.x is left", kernel.forward_dynamics, home, [1.0, 0.0, 0.0], still)
    assert [" ".join(line) for line in lines] == [
        "0 joint4.x good 1 joint1.gamma 0 0",
        "2 joint4.x batch 0 joint1.gamma 2 0",
        "3 joint4.x rate 0 joint1.gamma 0 0",
        "value 0",
        "1 joint4.x rollout 0 joint1.gamma 2 0",
    ]


ROLLOUTS = """
int main()
{
    arm::Parameters parameters;
    parameters[arm::parameters::joints_joint1_x_stiffness] = 2e3;
    const arm::Setup setup(parameters);
    const std::array<double, 2> q{{0.01, 0.3}}, v{{0.0, -0.2}}, u{{1.0, 2.0}};
    const std::array<double, 4> qs{{0.01, 0.3, 0.02, -0.4}};
    constexpr std::size_t states = arm::rollout_states(40, 10);
    static_assert(states == 5);
    std::array<double, 2 * states> q_out{}, v_out{};
    if (!arm::rollout(setup, q, v, u, 1e-3, 40, 10, arm::Method::rk4, q_out.data(), v_out.data())) return 1;
    show("rk4", q_out);
    const std::array<double, 2> kp{{0.0, 30.0}}, kd{{0.0, 4.0}}, target{{0.0, 1.0}};
    arm::Drive drive{};
    drive.u = u.data();
    drive.kp = kp.data();
    drive.kd = kd.data();
    drive.target = target.data();
    std::array<double, 4 * states> all_q{}, all_v{};
    const arm::Status status = arm::rollout_batch(
        setup, 2, qs.data(), v, drive, 1e-3, 40, 10, arm::Method::implicit, all_q.data(), all_v.data());
    if (!status) return 2;
    show("implicit", all_q);
    show("rates", all_v);
    return 0;
}
"""


@pytest.mark.soak
def test_rollouts(tmp_path: Path) -> None:
    kernel, lines = printed(eomgen.load_robot("one_link"), ("rollout",), ROLLOUTS, tmp_path)
    answers = [[float.fromhex(x) for x in line[1:]] for line in lines]
    kernel.parameters["joints.joint1.x.stiffness"] = 2e3
    v, u, how = [0.0, -0.2], [1.0, 2.0], {"dt": 1e-3, "steps": 40, "every": 10}
    first = kernel.rollout([0.01, 0.3], v, u, method="rk4", **how)[0]  # type: ignore[arg-type]
    pd = {"kp": [0.0, 30.0], "kd": [0.0, 4.0], "target": [0.0, 1.0]}
    both = kernel.rollout([[0.01, 0.3], [0.02, -0.4]], v, u, method="implicit", **how, **pd)  # type: ignore[arg-type]
    for answer, expected in zip(answers, (first, *both), strict=True):
        assert np.array_equal(answer, expected.ravel())


FAILURES = """
int main()
{
    const arm::Setup setup;
    std::array<double, 6> q{}, zero{}, out{};
    std::array<double, 18> qs{}, q_out{}, v_out{};
    q[arm::coordinates::free_beta] = qs[6 + arm::coordinates::free_beta] = 1.5707963267948966;
    report("one", arm::forward_dynamics(setup, q, zero, zero, out));
    report("good", arm::forward_dynamics(setup, zero, zero, zero, out));
    report("batch", arm::forward_dynamics_batch(setup, 3, qs.data(), zero, zero, v_out.data()));
    std::printf("value %d\\n", int(arm::forward_dynamics(setup, q, zero, zero).has_value()));
    std::printf("jacobian %d\\n", int(arm::forward_dynamics_jacobian(setup, q, zero, zero).has_value()));
    q[arm::coordinates::free_beta] = 0.0;
    std::array<double, 6> u{};
    arm::Drive drive{};
    drive.u = u.data();
    report("rollout", arm::rollout_batch(
        setup, 2, qs.data(), zero, drive, 1e-3, 2, 2, arm::Method::rk4, q_out.data(), v_out.data()));
    return 0;
}
"""


@pytest.mark.soak
def test_a_singular_mass_matrix_is_reported(tmp_path: Path) -> None:
    """Coordinate and state are those of the Python kernel's error."""
    kernels = ("forward_dynamics", "forward_dynamics_jacobian", "rollout")
    kernel, lines = printed(held_body(), kernels, REPORT + FAILURES, tmp_path)
    answers = {line[0]: " ".join(line[1:]) for line in lines}
    q = np.zeros((3, 6))
    q[1, 4] = np.pi / 2
    caught = refused(SingularError, "", kernel.forward_dynamics, q, np.zeros(6), np.zeros(6))
    assert "at free.alpha and free.gamma in state 1; free.beta is at +-pi/2" in str(caught)
    pivot = r"free\.(alpha|beta|gamma)"  # where elimination fails: C has no null vectors
    for name, state in (("batch", 1), ("one", 0), ("rollout", 1)):
        assert re.fullmatch(rf"0 {pivot} {state} 0", answers[name])
    assert (answers["good"][0], answers["value"], answers["jacobian"]) == ("1", "0", "0")


OPENED = ("inverse_dynamics", "reactions", "loop_reactions")  # where loops may be open at the accelerations


def test_only_what_is_said_to_solve_can_fail() -> None:
    for robot in (sprung(), looped()):
        code = make_source(robot, Options()).code
        seen = set()
        for name, body in re.findall(rf"^int {robot.name}_(\w+)\([^;{{]*\)\n{{(.*?)^}}", code, re.M | re.S):
            fails = set(re.findall(r"return ([^;]+);", body)) != {"0"}
            opened = bool(robot.loops) and name.removesuffix("_under_load") in OPENED
            assert fails == (opened or (name in KERNELS and KERNELS[name].solves)), name
            seen.add(name)
        assert {"mass_matrix", "forward_dynamics", "forward_dynamics_jacobian", "energy"} <= seen


VIEWS = """
#include <cmath>
template <class Call> bool refuses(Call call)
{
    try {
        call();
    } catch (const std::invalid_argument &) {
        return true;
    }
    return false;
}
int main()
{
    using Eigen::Dynamic;
    const arm::Setup setup;
    const Eigen::Vector2d q(0.2, 0.5), v(0.3, -0.1);
    const std::array<double, 2> q_array{{0.2, 0.5}};
    const double q_c[2] = {0.2, 0.5};
    const std::array<double, 4> expected = arm::mass_matrix(setup, q);
    int bad = 0;
    const auto expect = [&](const char *what, bool good) {
        if (!good) std::printf("%s\\n", what);
        bad += !good;
    };
    // views are where the numbers are
    expect("vector", arm::In<2>(q).data() == q.data());
    expect("array", arm::In<2>(q_array).data() == q_array.data() && arm::mass_matrix(setup, q_array) == expected);
    expect("C array", arm::In<2>(q_c).data() == q_c && arm::mass_matrix(setup, q_c) == expected);
    expect("pointer", arm::mass_matrix(setup, arm::In<2>::at(q_c)) == expected);
    const Eigen::Ref<const Eigen::Vector2d> reference(q);
    expect("reference", arm::In<2>(reference).data() == q.data());
    const Eigen::VectorXd any = q;
    expect("vector of any size", arm::mass_matrix(setup, any) == expected);
    Eigen::Matrix<double, Dynamic, Dynamic, Eigen::RowMajor> rows(3, 2);
    rows.row(1) = q.transpose();
    expect("row", arm::In<2>(rows.row(1)).data() == &rows(1, 0) && arm::mass_matrix(setup, rows.row(1)) == expected);
    // outputs
    Eigen::Matrix2d by_columns;
    arm::mass_matrix(setup, q, by_columns);
    Eigen::Matrix<double, 2, 2, Eigen::RowMajor> by_rows, coriolis;
    arm::mass_matrix(setup, q, by_rows);
    expect("symmetric", by_columns == by_rows && by_rows == (arm::map<2, 2>(expected)));
    std::array<double, 4> numbers{};
    arm::coriolis_matrix(setup, q, v, coriolis);
    arm::coriolis_matrix(setup, q, v, arm::map<2, 2>(numbers));
    expect("map", coriolis == (arm::map<2, 2>(numbers)) && coriolis(0, 1) == numbers[1] && numbers[1] != numbers[2]);
    Eigen::Matrix<double, 6, 2, Eigen::RowMajor> three;
    arm::residual_jacobian(setup, q, v, v, three);
    arm::coriolis_matrix(setup, q, v, three.topRows<2>());
    expect("block", (three.topRows<2>() == coriolis) && (three.bottomRows<2>() == by_rows));
    Eigen::Matrix<double, Dynamic, Dynamic, Eigen::RowMajor> plain(2, 2);
    arm::coriolis_matrix(setup, q, v, plain);
    expect("matrix of any size", plain == coriolis);
    Eigen::Matrix<double, 4, 4, Eigen::RowMajor> pose;
    arm::frame_pose(setup, q, arm::Frame::tcp, pose);
    expect("pose", std::abs(pose(0, 3) - (0.2 + std::cos(0.5))) < 1e-15);
    // sizes that are known at run time alone
    Eigen::VectorXd longer(3);
    expect("longer vector", refuses([&] { (void)arm::mass_matrix(setup, longer); }));
    expect("larger matrix", refuses([&] { arm::coriolis_matrix(setup, q, v, rows); }));
    Eigen::Matrix<double, Dynamic, Dynamic, Eigen::RowMajor> wide(2, 5);
    expect("gaps between rows", refuses([&] { arm::coriolis_matrix(setup, q, v, wide.leftCols(2)); }));
    expect("batch", refuses([&] { arm::mass_matrix_batch(setup, 1, longer, numbers.data()); }));
    static_assert(noexcept(arm::mass_matrix(setup, q, by_rows)) && noexcept(arm::mass_matrix(setup, q_array)));
    static_assert(!noexcept(arm::mass_matrix(setup, any)));
    return bad;
}
"""
KERNELS_OF_VIEWS = ("mass_matrix", "coriolis_matrix", "residual_jacobian", "kinematics", "forward_dynamics")


@pytest.mark.parametrize("compiler", soaked(COMPILERS, list(COMPILERS)[:1]))
def test_views_of_eigen_copy_nothing(compiler: str, tmp_path: Path) -> None:
    package = package_of(eomgen.load_robot("one_link"), tmp_path, *KERNELS_OF_VIEWS)
    code = PREAMBLE.format(name="one_link", space="one_link") + VIEWS
    assert run(program(compiler, code, [package], tmp_path, *need_eigen())) == ""


WRONG = {
    "arm::mass_matrix(setup, Eigen::Vector3d(), M);": "a vector of another size",
    "arm::mass_matrix(setup, 2.0 * q, M);": "evaluate it first",
    "arm::mass_matrix(setup, Eigen::Matrix3d().row(0), M);": "gaps between the numbers",
    "arm::mass_matrix(setup, Eigen::Vector2f(), M);": "numbers of another type than real",
    "Eigen::Matrix2d by_columns; arm::coriolis_matrix(setup, q, q, by_columns);": "use Eigen::RowMajor",
    "arm::mass_matrix(setup, q, Eigen::Matrix3d());": "another number of rows",
    "Eigen::Vector4d four; arm::mass_matrix(setup, q, four);": "a vector where a matrix belongs",
    "Eigen::Matrix3d big; arm::mass_matrix(setup, q, big.block<2, 2>(0, 0));": "gaps between the rows",
    "std::array<double, 3> three{}; arm::mass_matrix(setup, three, M);": "no matching function",
    "(void)arm::frame_pose(setup, q, 7);": "no matching function",
    "(void)arm::map<2>(std::array<double, 2>{});": "deleted",
    "arm::forward_dynamics(setup, q, q, q, q2);": "nodiscard",
    "arm::mass_matrix(setup, q);": "nodiscard",
}


def test_what_would_copy_or_overrun_does_not_compile(tmp_path: Path) -> None:
    """Each wrong line is refused, for the reason that is meant; without them the rest compiles."""
    compiler = "clang++"
    if shutil.which(compiler) is None:
        pytest.skip(f"there is no {compiler}")
    package = package_of(eomgen.load_robot("one_link"), tmp_path, *KERNELS_OF_VIEWS)
    begin = '#include "one_link.hpp"\nnamespace arm = eomgen::one_link;\n#line 1\n'
    start = "const arm::Setup setup; Eigen::Vector2d q(0.1, 0.2), q2; Eigen::Matrix2d M;"
    functions = [f"void f{i}() {{ {start} (void)q2; (void)M; {line} }}" for i, line in enumerate(WRONG)]
    flags = ("-std=c++17", *WARNINGS, "-fsyntax-only", "-ferror-limit=0", "-iquote", str(package), *need_eigen())
    path = tmp_path / "wrong.cpp"
    path.write_text(begin + f"void good() {{ {start} arm::mass_matrix(setup, q, M); (void)q2; }}\n", encoding="ascii")
    run(compiler, *flags, path)
    path.write_text(begin + "\n".join(functions) + "\n", encoding="ascii")
    result = subprocess.run([compiler, *flags, path], capture_output=True, text=True, check=False)
    assert result.returncode != 0
    # an error inside the header is told by the note that names the line
    told = re.split(r"\n(?=[^\n]*: error: )", "\n" + result.stderr)
    for number, (line, reason) in enumerate(WRONG.items(), 1):
        mine = [text for text in told if re.search(rf"wrong\.cpp:{number}:", text)]
        assert any(reason in text for text in mine), (line, mine or result.stderr[:3000])


def reserved(name: str) -> Robot:
    """A robot whose names are words of C++ or names of the header."""
    robot = random_robot(5, joints=(3, 3), rigid=True, name=name)
    links = tuple(replace(x, name=new) for x, new in zip(robot.links, ("template", "NULL", "names"), strict=True))
    renamed = {old.name: new.name for old, new in zip(robot.links, links, strict=True)}
    joints = tuple(
        replace(x, name=new, child=renamed[x.child], parent=renamed.get(x.parent, x.parent))
        for x, new in zip(robot.joints, ("class", "real", "In"), strict=True)
    )
    return replace(robot, links=links, joints=joints, frames=(), tunable=())


@pytest.mark.soak
def test_words_of_cpp_as_names(tmp_path: Path) -> None:
    """Robots, links and joints with such names, all in one program, with the compilers' own macros."""
    names = ("namespace", "std", "linux", "sin", "eomgen_h", "detail")
    folders = [package_of(reserved(name), tmp_path, "mass_matrix", "kinematics") for name in names]
    both = "".join(f'#include "{name}.hpp"\n#include "{name}.h"\n' for name in names)
    uses = "".join(
        f"static_assert(eomgen::{safe(name)}::links::template_ == std::size_t({name.upper()}_LINK_template_));\n"
        f'static_assert(eomgen::{safe(name)}::link_names[eomgen::{safe(name)}::links::NULL_] == "NULL");\n'
        for name in names
    )
    include = [part for folder in folders for part in ("-iquote", str(folder))]
    path = text_file(tmp_path / "names.cpp", "#include <cmath>\n#include <cstdio>\n" + both + uses)
    plain = text_file(tmp_path / "names.c", "#include <math.h>\n" + both.replace(".hpp", ".h") + "int unused;\n")
    for compiler, cpp in COMPILERS.items():
        if shutil.which(compiler) and shutil.which(cpp):
            run(cpp, "-std=gnu++17", *WARNINGS, NO_EIGEN, "-fsyntax-only", *include, path)
            run(compiler, "-std=c99", *WARNINGS, "-fsyntax-only", *include, plain)


def test_identifiers_are_different() -> None:
    assert identifiers(["a.b", "a_b", "a_b_", "int", "int_"]) == [
        ("a.b", "a_b"),
        ("a_b", "a_b_"),
        ("a_b_", "a_b__"),
        ("int", "int_"),
        ("int_", "int__"),
    ]
    assert {"namespace", "template", "xor", "co_await"} <= TAKEN


def test_flags_of_the_project() -> None:
    """Those of the kernel, in their order, with the last optimisation level alone."""
    meta = json.loads((Path(__file__).parents[3] / "generated/one_link/one_link.json").read_text(encoding="ascii"))
    lists = project_files(meta, "", ("-O2", "-fno-math-errno", "-mllvm", "-x y", "-O1"))["CMakeLists.txt"]
    assert "\"SHELL:-fno-fast-math -fno-math-errno -mllvm '-x y'\"\n        $<$<NOT:$<CONFIG:Debug>>:-O1>)" in lists
    assert quoted('a"b\\c$d') == '"a\\"b\\\\c\\$d"'


def test_large_arrays_are_not_returned_by_value(tmp_path: Path) -> None:
    """A matrix of one number more than there may be, as the metadata of a large robot have it."""
    package = package_of(eomgen.load_robot("one_link"), tmp_path, "mass_matrix", "forward_dynamics")
    meta, size = json.loads((package / "one_link.json").read_text(encoding="ascii")), project.BY_VALUE + 1
    meta["shapes"][meta["kernels"]["mass_matrix"]["writes"]] = (1, size)
    (package / "one_link.hpp").write_text(project_files(meta, "", ())["one_link.hpp"], encoding="ascii")
    path = tmp_path / "main.cpp"
    line = (
        f"void f(const eomgen::one_link::Setup &s, std::array<double, {size}> M)"
        " { eomgen::one_link::mass_matrix(s, {{0, 0}}"
    )
    for rest, works in ((", M); }", True), ("); (void)M; }", False)):
        path.write_text(f'#include "one_link.hpp"\n{line}{rest}', encoding="ascii")
        command = ("g++", "-std=c++17", NO_EIGEN, "-fsyntax-only", "-iquote", str(package), str(path))
        if shutil.which("g++") is None:
            pytest.skip("there is no g++")
        result = subprocess.run(command, capture_output=True, text=True, check=False)
        assert (result.returncode == 0) == works, result.stderr
