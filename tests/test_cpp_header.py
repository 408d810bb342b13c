"""The header for C++17: every function against the Python kernel, views of std::array and Eigen, names, what must not
compile."""

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
from c_project import COMPILERS, WARNINGS, need_eigen, program, run
from numpy.typing import NDArray
from random_robots import random_robot
from test_kernels import free_body

import eomgen
from eomgen.codegen import project
from eomgen.codegen.project import TAKEN, identifiers, project_files, quoted, safe, view
from eomgen.codegen.signatures import KERNELS
from eomgen.errors import SingularError
from eomgen.pipeline import Options, generate
from eomgen.robot import Robot

NO_EIGEN = "-DEOMGEN_EIGEN=0"
MAY_VANISH = ("bias_force", "christoffel", "coriolis_matrix", "external_force", "spring_stiffness")


def sprung() -> Robot:
    return eomgen.load_robot("balanced_arm")


def looped() -> Robot:
    return eomgen.load_robot("bennett")


def tree() -> Robot:
    robot = random_robot(31, joints=(3, 3), tree=True, max_coordinates=3, name="namespace")
    return replace(robot, tunable=(f"links.{robot.links[0].name}.mass",))


def package_of(robot: Robot, folder: Path, *kernels: str, dtype: str = "float64") -> Path:
    return generate(robot, folder, Options(kernels, dtype, flags=("-O0",)), cmake=True)


def kernel_of(robot: Robot, *kernels: str, dtype: str = "float64") -> eomgen.Kernel:
    """The kernel of ``package_of``, from the cache."""
    return eomgen.build(robot, kernels=kernels, dtype=dtype, flags=("-O0",))


PREAMBLE = """
#include "{name}.hpp"
#include <cstdio>
namespace arm = eomgen::{space};
template <class Numbers> void show(const char *name, const Numbers &numbers)
{{
    std::printf("%s", name);
    for (const auto &x : numbers) std::printf(" %a", static_cast<double>(x));
    std::puts("");
}}
template <class T, std::size_t N> const std::array<T, N> &found(const std::array<T, N> &x) {{ return x; }}
template <class T> const T &found(const std::optional<T> &x) {{ return x.value(); }}
"""


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
    for function, (reads, writes) in kernel._functions.items():
        lines += calls(
            function, reads, view(kernel._shapes[writes]), int(np.prod(kernel._shapes[writes])), kernel.frames[-1]
        )
    return "\n".join([*lines, "return 0;", "}", ""])


def calls(function: str, reads: Sequence[str], shape: str, size: int, frame: str) -> list[str]:
    """Lines that call one function in every way; statuses other than 0 say where the ways differ."""
    frame = f", arm::Frame::{frame}" if function.startswith("frame_") else ""
    one = ", ".join(reads) + frame
    mixed = ", ".join([f"{reads[0]}_two.data()", *reads[1:]]) + frame  # the first state for all but the first array
    two = ", ".join(f"{{{label}_two.data(), {label}.size()}}" for label in reads) + frame
    check = "if (!{}) return 1;" if KERNELS.get(function) and KERNELS[function].solves else "{};"
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
        (sprung, "float64", "gcc", True),
        (looped, "float64", "clang", False),
        (tree, "float32", "clang", True),
        (tree, "float64", "gcc", False),
    ],
    ids=lambda x: getattr(x, "__name__", str(x)),
)
def test_every_function_gives_what_the_kernel_gives(
    make: object, dtype: str, compiler: str, eigen: bool, tmp_path: Path
) -> None:
    """To the bit, from std::array and Eigen, for one state and for batches."""
    compare(make(), dtype, compiler, eigen, tmp_path)  # type: ignore[operator]


@pytest.mark.soak
@pytest.mark.parametrize("number", range(len(eomgen.builtin_robots())), ids=eomgen.builtin_robots())
def test_headers_of_the_built_in_robots(number: int, tmp_path: Path) -> None:
    name, compiler = eomgen.builtin_robots()[number], [*COMPILERS][number % 2]
    count = compare(
        eomgen.load_robot(name), ("float64", "float32")[number % 3 == 0], compiler, number % 4 < 2, tmp_path
    )
    print(f"{name}: {count} numbers of C++ are those of the Python kernel, {compiler}")


def compare(robot: Robot, dtype: str, compiler: str, eigen: bool, tmp_path: Path) -> int:
    """Compare every function of the header with the kernel; the value is how many numbers there were."""
    package, kernel = package_of(robot, tmp_path, dtype=dtype), kernel_of(robot, dtype=dtype)
    generator = np.random.default_rng(7)
    labels = {label for reads, _ in kernel._functions.values() for label in reads}
    states = {
        label: generator.uniform(-0.4, 0.4, (2, *kernel._shapes[label])).astype(kernel.dtype)
        for label in sorted(labels)
    }
    code = all_functions(robot.name, kernel, states)
    made = program(compiler, code, [package], tmp_path, *(need_eigen() if eigen else (NO_EIGEN,)))
    answers = {}
    for line in run(made).splitlines():
        name, *numbers = line.split()
        answers[name] = np.array([float.fromhex(x) for x in numbers], kernel.dtype)
    assert np.array_equal(answers.pop("parameters"), np.array([*kernel.parameters.values()], kernel.dtype))
    assert len(answers) == 3 * len(kernel._functions)
    count = 0
    for function, (reads, _) in kernel._functions.items():
        frame = (kernel._frame(kernel.frames[-1]),) if function.startswith("frame_") else ()
        one, two = ([states[label][:states_here] for label in reads] for states_here in (1, 2))
        mixed = [two[0], *(x[0] for x in one[1:])]
        for end, arrays in (("", [x[0] for x in one]), ("_batch", two), ("_mixed", mixed)):
            expected = np.asarray(kernel._run(function, None, tuple(arrays), *frame)).ravel()
            count += expected.size
            assert np.array_equal(answers[function + end], expected), function + end
            assert np.any(expected != 0) or function in MAY_VANISH, function
    return count


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


def test_rollouts(tmp_path: Path) -> None:
    robot, kernels = eomgen.load_robot("one_link"), ("rollout",)
    package, kernel = package_of(robot, tmp_path, *kernels), kernel_of(robot, *kernels)
    code = PREAMBLE.format(name="one_link", space="one_link") + ROLLOUTS
    made = program("gcc", code, [package], tmp_path, NO_EIGEN)
    answers = [[float.fromhex(x) for x in line.split()[1:]] for line in run(made).splitlines()]
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
    const auto report = [](const char *what, const arm::Status &status) {
        if (status) std::printf("%s found\\n", what);
        const std::string_view name = arm::coordinate_names[status.coordinate()];
        const int length = static_cast<int>(name.size());
        if (!status) std::printf("%s %.*s %zu %zu\\n", what, length, name.data(), status.state(), status.step());
    };
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


def test_a_singular_mass_matrix_is_reported(tmp_path: Path) -> None:
    """Coordinate and state are those of the Python kernel's error."""
    robot, kernels = free_body(), ("forward_dynamics", "forward_dynamics_jacobian", "rollout")
    package, kernel = package_of(robot, tmp_path, *kernels), kernel_of(robot, *kernels)
    code = PREAMBLE.format(name=robot.name, space=robot.name) + FAILURES
    made = program("gcc", code, [package], tmp_path, NO_EIGEN)
    answers = dict(line.split(" ", 1) for line in run(made).splitlines())
    q = np.zeros((3, 6))
    q[1, 4] = np.pi / 2
    with pytest.raises(SingularError) as caught:
        kernel.forward_dynamics(q, np.zeros(6), np.zeros(6))
    found = re.search(r"(free\.\w+) in state 1", str(caught.value))
    assert found is not None
    assert answers["batch"] == f"{found[1]} 1 0"
    assert answers["one"] == f"{found[1]} 0 0"
    assert answers["rollout"] == f"{found[1]} 1 0"
    assert (answers["good"], answers["value"], answers["jacobian"]) == ("found", "0", "0")


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


@pytest.mark.parametrize("compiler", COMPILERS)
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


def test_words_of_cpp_as_names(tmp_path: Path) -> None:
    """Robots, links and joints with such names, all in one program, with the compilers' own macros."""
    names = ("namespace", "std", "linux", "sin", "eomgen", "detail")
    folders = [package_of(reserved(name), tmp_path, "mass_matrix", "kinematics") for name in names]
    both = "".join(f'#include "{name}.hpp"\n#include "{name}_names.h"\n' for name in names)
    uses = "".join(
        f"static_assert(eomgen::{safe(name)}::links::template_ == std::size_t({name.upper()}_LINK_template_));\n"
        f'static_assert(eomgen::{safe(name)}::link_names[eomgen::{safe(name)}::links::NULL_] == "NULL");\n'
        for name in names
    )
    include = [part for folder in folders for part in ("-iquote", str(folder))]
    path = tmp_path / "names.cpp"
    path.write_text("#include <cmath>\n#include <cstdio>\n" + both + uses, encoding="ascii")
    plain = tmp_path / "names.c"
    plain.write_text("#include <math.h>\n" + both.replace(".hpp", ".h") + "int unused;\n", encoding="ascii")
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
    meta = json.loads((Path(__file__).parent.parent / "generated/one_link/one_link.json").read_text(encoding="ascii"))
    lists = project_files(meta, ("-O2", "-fno-math-errno", "-mllvm", "-x y", "-O1"))["CMakeLists.txt"]
    assert "\"SHELL:-fno-fast-math -fno-math-errno -mllvm '-x y'\"\n        $<$<NOT:$<CONFIG:Debug>>:-O1>)" in lists
    assert quoted('a"b\\c$d') == '"a\\"b\\\\c\\$d"'


def test_large_arrays_are_not_returned_by_value(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    package = package_of(eomgen.load_robot("one_link"), tmp_path, "mass_matrix", "forward_dynamics")
    monkeypatch.setattr(project, "BY_VALUE", 3)
    meta = json.loads((package / "one_link.json").read_text(encoding="ascii"))
    (package / "one_link.hpp").write_text(project_files(meta, ())["one_link.hpp"], encoding="ascii")
    path = tmp_path / "main.cpp"
    line = (
        "void f(const eomgen::one_link::Setup &s, std::array<double, 4> M) { eomgen::one_link::mass_matrix(s, {{0, 0}}"
    )
    for rest, works in ((", M); }", True), ("); (void)M; }", False)):
        path.write_text(f'#include "one_link.hpp"\n{line}{rest}', encoding="ascii")
        command = ("g++", "-std=c++17", NO_EIGEN, "-fsyntax-only", "-iquote", str(package), str(path))
        if shutil.which("g++") is None:
            pytest.skip("there is no g++")
        result = subprocess.run(command, capture_output=True, text=True, check=False)
        assert (result.returncode == 0) == works, result.stderr


def test_only_what_is_said_to_solve_can_fail(tmp_path: Path) -> None:
    for robot in (sprung(), looped()):
        code = (package_of(robot, tmp_path) / f"{robot.name}.c").read_text(encoding="ascii")
        seen = set()
        for name, body in re.findall(rf"^int {robot.name}_(\w+)\([^;{{]*\)\n{{(.*?)^}}", code, re.M | re.S):
            fails = set(re.findall(r"return ([^;]+);", body)) != {"0"}
            assert fails == (name in KERNELS and KERNELS[name].solves), name
            seen.add(name)
        assert {"mass_matrix", "forward_dynamics", "forward_dynamics_jacobian", "energy"} <= seen
