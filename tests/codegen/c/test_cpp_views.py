"""Views and names of the header for C++17: of std::array and Eigen, what must not compile, words of C++."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import pytest

import eomgen
from eomgen.codegen.c import project
from eomgen.codegen.c.project import TAKEN, identifiers, project_files, quoted, safe
from eomgen.robot.value import Robot
from tests.support.c_project import COMPILERS, NO_EIGEN, PREAMBLE, WARNINGS, need_eigen, package_of, program, run
from tests.support.random_robots import random_robot
from tests.support.soak import soaked

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
    meta = json.loads((Path(__file__).parents[3] / "generated/one_link/one_link.json").read_text(encoding="ascii"))
    lists = project_files(meta, ("-O2", "-fno-math-errno", "-mllvm", "-x y", "-O1"))["CMakeLists.txt"]
    assert "\"SHELL:-fno-fast-math -fno-math-errno -mllvm '-x y'\"\n        $<$<NOT:$<CONFIG:Debug>>:-O1>)" in lists
    assert quoted('a"b\\c$d') == '"a\\"b\\\\c\\$d"'


def test_large_arrays_are_not_returned_by_value(tmp_path: Path) -> None:
    """A matrix of one number more than there may be, as the metadata of a large robot have it."""
    package = package_of(eomgen.load_robot("one_link"), tmp_path, "mass_matrix", "forward_dynamics")
    meta, size = json.loads((package / "one_link.json").read_text(encoding="ascii")), project.BY_VALUE + 1
    meta["shapes"][meta["kernels"]["mass_matrix"]["writes"]] = (1, size)
    (package / "one_link.hpp").write_text(project_files(meta, ())["one_link.hpp"], encoding="ascii")
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
