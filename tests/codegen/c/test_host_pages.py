"""The pages for Simulink and ros2_control: their C and C++ move the plant as the kernel says, by headers that stand in.

What the pages name of a generated package is in it.
"""

from __future__ import annotations

import re
import subprocess
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

import eomgen
from eomgen.errors import InputError
from eomgen.pipeline.generating import generate
from eomgen.pipeline.options import Options
from eomgen.runtime.levels import BASE
from tests.support.c_project import NO_EIGEN, WARNINGS, need, run
from tests.support.doc_blocks import Block, blocks_of
from tests.support.optional import needs
from tests.support.soak import soaked

DOCS = Path(__file__).parents[3] / "docs"
SIMULINK, ROS2 = ((DOCS / name).read_text(encoding="utf-8") for name in ("howto/simulink.md", "howto/ros2_control.md"))
KERNELS = ("forward_dynamics", "inverse_dynamics", "mass_matrix", "kinematics", "rollout")
FLAGS = ("-O0", "-ffp-contract=off", "-fno-math-errno", "-fno-trapping-math")

SIMSTRUC = """
typedef double real_T;
typedef int int_T;
typedef struct {
    int states, inputs, outputs, work;
    const char *error;
    double x[16], dx[16], u[16], y[16], r[256];
} SimStruct;
#define CONTINUOUS_SAMPLE_TIME 0.0
#define ssSetNumSFcnParams(S, n) ((void)(S), (void)(n))
#define ssSetNumContStates(S, n) ((S)->states = (n))
#define ssSetNumInputPorts(S, n) ((void)(S), (n))
#define ssSetInputPortWidth(S, port, n) ((void)(port), (S)->inputs = (n))
#define ssSetInputPortRequiredContiguous(S, port, on) ((void)(S), (void)(port), (void)(on))
#define ssSetInputPortDirectFeedThrough(S, port, on) ((void)(S), (void)(port), (void)(on))
#define ssSetNumOutputPorts(S, n) ((void)(S), (n))
#define ssSetOutputPortWidth(S, port, n) ((void)(port), (S)->outputs = (n))
#define ssSetNumRWork(S, n) ((S)->work = (n))
#define ssSetNumSampleTimes(S, n) ((void)(S), (void)(n))
#define ssSetSampleTime(S, i, t) ((void)(S), (void)(i), (void)(t))
#define ssSetOffsetTime(S, i, t) ((void)(S), (void)(i), (void)(t))
#define ssGetContStates(S) ((S)->x)
#define ssGetdX(S) ((S)->dx)
#define ssGetRWork(S) ((S)->r)
#define ssGetInputPortRealSignal(S, port) ((void)(port), (const real_T *)(S)->u)
#define ssGetOutputPortRealSignal(S, port) ((void)(port), (S)->y)
#define ssSetErrorStatus(S, text) ((S)->error = (text))
"""
SIMULATION = """
#include <stdio.h>
#include <stdlib.h>
int main(int count, char **number)
{
    static SimStruct block;
    mdlInitializeSizes(&block);
    mdlInitializeSampleTimes(&block);
    mdlInitializeConditions(&block);
    if (block.work > 256 || block.states > 16 || count != 1 + block.states + block.inputs) return 1;
    for (int i = 0; i < block.states; ++i) block.x[i] = strtod(number[1 + i], NULL);
    for (int i = 0; i < block.inputs; ++i) block.u[i] = strtod(number[1 + block.states + i], NULL);
    mdlDerivatives(&block);
    mdlOutputs(&block, 0);
    mdlTerminate(&block);
    for (int i = 0; i < block.states; ++i) printf("%a ", block.dx[i]);
    for (int i = 0; i < block.outputs; ++i) printf("%a ", block.y[i]);
    return block.error != NULL;
}
"""
SYSTEM_INTERFACE = """
#pragma once
#include <map>
#include <string>
#include <vector>
namespace rclcpp {
struct Time {};
struct Duration { double s; double seconds() const { return s; } };
}
namespace hardware_interface {
enum class CallbackReturn { SUCCESS, ERROR };
enum class return_type { OK, ERROR };
struct ComponentInfo { std::string name; };
struct HardwareInfo { std::map<std::string, std::string> hardware_parameters; std::vector<ComponentInfo> joints; };
struct Handle {
    Handle(const std::string &owner, const std::string &kind, double *place) : name(owner + "/" + kind), value(place) {}
    std::string name;
    double *value;
};
struct StateInterface : Handle { using Handle::Handle; };
struct CommandInterface : Handle { using Handle::Handle; };
struct SystemInterface {
    virtual ~SystemInterface() = default;
    virtual CallbackReturn on_init(const HardwareInfo &info) { info_ = info; return CallbackReturn::SUCCESS; }
    virtual std::vector<StateInterface> export_state_interfaces() = 0;
    virtual std::vector<CommandInterface> export_command_interfaces() = 0;
    virtual return_type read(const rclcpp::Time &, const rclcpp::Duration &) = 0;
    virtual return_type write(const rclcpp::Time &, const rclcpp::Duration &) = 0;
    HardwareInfo info_;
};
}
"""
VALUES = """
#pragma once
namespace hardware_interface {
constexpr char HW_IF_POSITION[] = "position", HW_IF_VELOCITY[] = "velocity", HW_IF_EFFORT[] = "effort";
}
"""
CLASS_LIST = """
#pragma once
#define PLUGINLIB_EXPORT_CLASS(TYPE, BASE) BASE *plugin() { static TYPE made; return &made; }
"""
MANAGER = """
#include "one_link_system.cpp"
#include <cstdio>
int main()
{
    using namespace hardware_interface;
    auto &plant = *plugin();
    OneLinkSystem other;
    const bool refused = other.on_init({{}, {{"nothing"}}}) == CallbackReturn::ERROR
        && OneLinkSystem().on_init({{{"steps", "0"}}, {{"joint1"}}}) == CallbackReturn::ERROR;
    if (plant.on_init({{{"steps", "2"}}, {{"joint1"}}}) != CallbackReturn::SUCCESS || !refused) return 1;
    const auto states = plant.export_state_interfaces();
    const auto commands = plant.export_command_interfaces();
    if (commands.size() != 1 || commands[0].name != "joint1/effort" || states.size() != 2) return 2;
    *commands[0].value = 4.0;
    if (plant.read({}, {0.0}) != return_type::OK) return 3;
    for (int k = 0; k < 20; ++k)
        if (plant.write({}, {1e-3}) != return_type::OK || plant.read({}, {1e-3}) != return_type::OK) return 4;
    for (const auto &state : states) std::printf("%s %a\\n", state.name.c_str(), *state.value);
}
"""


def titled(page: str, title: str) -> str:
    """The text of a page's block of that title."""
    (text,) = (block.text for block in blocks_of(page) if block.title == title)
    return text


@pytest.fixture(scope="module")
def package(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of one_link with all that both pages speak of."""
    need("gcc", "g++")
    return generate(
        "one_link", tmp_path_factory.mktemp("pages"), Options(KERNELS, flags=("-O0",), levels=(BASE,)), ros2=True
    )


def compiled_kernel(package: Path, folder: Path, name: str = "one_link") -> Path:
    run("gcc", "-std=c99", *FLAGS, *WARNINGS, "-c", package / f"{name}.c", "-o", folder / "kernel.o")
    return folder / "kernel.o"


@pytest.mark.soak
def test_the_s_function_has_the_kernels_accelerations(package: Path, tmp_path: Path) -> None:
    for name, text in {
        "one_link_sfun.c": titled(SIMULINK, "one_link_sfun.c"),
        "simstruc.h": SIMSTRUC,
        "simulink.c": SIMULATION,
    }.items():
        (tmp_path / name).write_text(text, encoding="ascii")
    made = tmp_path / "main"
    places = ("-I", tmp_path, "-I", package, "-DMATLAB_MEX_FILE")
    kernel_object = compiled_kernel(package, tmp_path)
    run("gcc", "-std=c99", *WARNINGS, *places, tmp_path / "one_link_sfun.c", kernel_object, "-o", made, "-lm")
    kernel = eomgen.build("one_link", kernels=("forward_dynamics",), flags=("-O0",))
    q, v, u = np.random.default_rng(4).uniform(-1.0, 1.0, (3, kernel.n))
    numbers = [float.fromhex(x) for x in run(made, *(float(x).hex() for x in (*q, *v, *u))).split()]
    np.testing.assert_array_equal(numbers, [*v, *kernel.forward_dynamics(q, v, u), *q, *v])


@pytest.mark.soak
def test_the_hardware_component_moves_as_the_kernel_says(package: Path, tmp_path: Path) -> None:
    headers = {
        "hardware_interface/system_interface.hpp": SYSTEM_INTERFACE,
        "hardware_interface/types/hardware_interface_type_values.hpp": VALUES,
        "pluginlib/class_list_macros.hpp": CLASS_LIST,
        "one_link_system.cpp": titled(ROS2, "one_link_system.cpp"),
        "main.cpp": MANAGER,
    }
    for name, text in headers.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text, encoding="ascii")
    made = compiled_plant(package, tmp_path)
    kernel = eomgen.build("one_link", kernels=("rollout",), flags=("-O0",))
    state = np.zeros(2), np.zeros(2)
    for _ in range(40):
        qs, vs = kernel.rollout(*state, [0.0, 4.0], 1e-3 / 2, 1, method="implicit")
        state = qs[-1], vs[-1]
    told = dict(line.split() for line in run(made).splitlines())
    assert list(told) == ["joint1/position", "joint1/velocity"]
    assert [float.fromhex(x) for x in told.values()] == [state[0][1], state[1][1]]


def test_matlab_calls_functions_that_there_are(package: Path) -> None:
    gateway = (package / "one_link_mex.c").read_text(encoding="ascii")
    functions = set(re.findall(r'^    \{"(\w+)", ', gateway, re.MULTILINE))
    tables = set(re.findall(r'strcmp\(name, "(\w+)"\) == 0\) return', gateway)) | {"defaults"}
    text = "\n".join(block.text for block in matlab_blocks())
    called = set(re.findall(r"one_link_mex\('(\w+)'", text))
    assert {"forward_dynamics", "inverse_dynamics", "frame_pose", "parameters", "defaults"} <= called
    assert called <= functions | tables
    for identifier in re.findall(r"`(eomgen:\w+)`", SIMULINK):
        assert f'"{identifier}"' in gateway
    assert "'gravity.y'" in text
    assert '"gravity.y"' in gateway


def matlab_blocks() -> list[Block]:
    return [block for block in blocks_of(SIMULINK) if block.language == "matlab"]


def test_the_page_of_ros_names_what_the_package_has(package: Path) -> None:
    table = ROS2[ROS2.index("| in `generated/one_link/ros2/`") : ROS2.index("What is tested")]
    files = [name for name in re.findall(r"`([\w/.]+)`", table) if "." in name]
    assert len(files) == 5, files
    assert all((package / "ros2" / name).is_file() for name in files)
    component = (package / "ros2/component.cpp").read_text(encoding="ascii")
    for name, default in re.findall(r"^\| `(period|steps|method)` \|.*\| `?([\w.]+)`? \|$", ROS2, re.MULTILINE):
        assert re.search(rf'declare_parameter<[\w:]+>\("{name}", "?{re.escape(default)}"?\)', component), name
    project = (package / "ros2/CMakeLists.txt").read_text(encoding="ascii")
    assert "project(eomgen_one_link_ros2 " in project
    assert "EXECUTABLE eomgen_one_link_ros2_node" in project.replace("\n    ", " ")
    for block in (block for block in blocks_of(ROS2) if block.language == "xml"):
        ElementTree.fromstring(block.text)
    assert "class OneLinkSystem : public hardware_interface::SystemInterface" in ROS2
    plugin = ElementTree.fromstring(titled(ROS2, "one_link_system.xml")).find("class")
    assert plugin.get("type") == "OneLinkSystem"
    assert f"<plugin>{plugin.get('name')}</plugin>" in titled(ROS2, "one_link.ros2_control.xml")


MEX_KERNELS = (
    "forward_dynamics",
    "inverse_dynamics",
    "mass_matrix",
    "kinematics",
    "external_force",
    "residual_jacobian",
)
OCTAVE = """
{states}
function show(name, x), printf("%s:%s:%s\\n", name, mat2str(size(x)), sprintf(" %.17g", x)); end
function fails(varargin)
  try, {name}_mex(varargin{{:}}); printf("nothing\\n"); catch e, printf("! %s\\n", e.message); end
end
show("forward_dynamics", {name}_mex("forward_dynamics", q, v, u));
show("one", {name}_mex("forward_dynamics", q, v(:, 1), u));
show("mass_matrix", {name}_mex("mass_matrix", q(:, 1)));
show("residual_jacobian", {name}_mex("residual_jacobian", q, v, u));
show("external_force", {name}_mex("external_force", q(:, 1), wrench));
show("frame_pose", {name}_mex("frame_pose", q(:, 2), "{frame}"));
p = {name}_mex("defaults");
p(strcmp({name}_mex("parameters"), "gravity.z")) = -1.5;
show("elsewhere", {name}_mex("inverse_dynamics", q, v, u, p));
printf("%s\\n", strjoin({name}_mex("coordinates")', " "));
fails("frame_pose", q, "nowhere");
fails("mass_matrix", q(1:end-1, 1));
fails("forward_dynamics", q, v, u(:, [1 1 1]));
fails("sideways", q);
fails("mass_matrix", q, p, 1);
fails("mass_matrix", single(q));
fails("mass_matrix", q, p(1));
"""


def _matlab(name: str, x: np.ndarray) -> str:
    return f"{name} = [{'; '.join(' '.join(repr(float(y)) for y in row) for row in x)}];"


@pytest.mark.parametrize("name", soaked(("one_link", "puma560_elastic", "flexible_arm"), ("one_link",)))
def test_octave_gets_the_kernels_bits(name: str, tmp_path: Path) -> None:
    need("mkoctfile", "octave")
    robot = eomgen.load_robot(name)
    kernel = eomgen.build(robot, kernels=MEX_KERNELS, flags=("-O0",))
    package = generate(robot, tmp_path, Options(MEX_KERNELS, flags=("-O0",), levels=(BASE,)), cmake=True)
    flags = [x for x in FLAGS if x.startswith("-f")]
    run("mkoctfile", "--mex", *flags, "-std=c99", *WARNINGS, f"{name}_mex.c", f"{name}.c", cwd=package)
    rng = np.random.default_rng(6)
    q, v, u = (rng.uniform(-0.3, 0.3, (2, kernel.n)) for _ in range(3))
    wrench = rng.uniform(-1.0, 1.0, (len(kernel.links), 6))
    arrays = {"q": q.T, "v": v.T, "u": u.T, "wrench": wrench}
    frame = kernel.frames[0]
    states = "\n".join(_matlab(*pair) for pair in arrays.items())
    (package / "check.m").write_text(OCTAVE.format(states=states, name=name, frame=frame), encoding="ascii")
    command = ["octave", "--no-gui", "--quiet", "--norc", "check.m"]
    result = subprocess.run(command, cwd=package, capture_output=True, text=True, check=False)
    lines = result.stdout.splitlines()
    assert len(lines) == 15, result.stderr
    found = {}
    for line in lines[:7]:
        what, shape, numbers = line.split(":")
        axes = [int(x) for x in shape.strip("[]").split()]
        found[what] = np.reshape([float(x) for x in numbers.split()], axes, order="F")
    elsewhere = kernel.replaced(parameters={"gravity.z": -1.5})
    expected = {
        "forward_dynamics": kernel.forward_dynamics(q, v, u).T,
        "one": kernel.forward_dynamics(q, v[0], u).T,
        "mass_matrix": kernel.mass_matrix(q[0]),
        "residual_jacobian": np.moveaxis(np.array(kernel.residual_jacobian(q, v, u)), 1, -1),
        "external_force": kernel.functions.external_force(q[0], wrench)[:, None],
        "frame_pose": kernel.frame_pose(q[1], frame),
        "elsewhere": elsewhere.inverse_dynamics(q, v, u).T,
    }
    for what, numbers in expected.items():
        np.testing.assert_array_equal(found[what], numbers, err_msg=what)
    assert lines[7] == " ".join(kernel.coordinates)
    told = ("frame 'nowhere'", "q has", "u holds 3", "function 'sideways'", "takes 1 arguments", "q is no", "p has")
    for line, text in zip(lines[8:], told, strict=True):
        assert line.startswith("! ")
        assert text in line


def test_the_gateway_of_a_closed_robot_does_not_call_a_status_a_coordinate(tmp_path: Path) -> None:
    options = Options(("forward_dynamics",), flags=("-O0",), levels=(BASE,))
    package = generate(eomgen.load_robot("four_bar"), tmp_path, options, cmake=True)
    text = (package / "four_bar_mex.c").read_text(encoding="ascii")
    assert "four_bar_forward_dynamics(h, in[0], in[1], in[2], out)" in text
    assert "says what it means" in text
    assert "cannot be inverted at" not in text


PLANT = """
#include "plant.hpp"
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <new>
static long allocations = 0;
void *operator new(std::size_t size) {{ ++allocations; return std::malloc(size); }}
void operator delete(void *p) noexcept {{ std::free(p); }}
void operator delete(void *p, std::size_t) noexcept {{ std::free(p); }}
namespace arm = eomgen::{name};
int main()
{{
    arm::Plant plant;
    const arm::Plant::Numbers q{{{q}}}, u{{{u}}};
    plant.reset(q, {{}});
    bool good = true;
    for (int k = 0; k < 50; ++k) good = plant.step(u, {dt}, arm::Method::{method}) && good;
    for (const double x : plant.q()) std::printf("%a ", x);
    for (const double x : plant.v()) std::printf("%a ", x);
    const arm::Plant::Numbers before = plant.q();
    const bool refused = !plant.step(u, NAN, arm::Method::{method}) && plant.q() == before;
    std::printf("%d %d %ld\\n", good, refused, allocations);
}}
"""


@pytest.mark.parametrize(
    ("name", "method"),
    soaked([("one_link", "rk4"), ("puma560_elastic", "implicit"), ("flexible_arm", "implicit")], {("one_link", "rk4")}),
)
def test_the_plant_moves_as_the_kernel_says(name: str, method: str, tmp_path: Path) -> None:
    need("gcc", "g++")
    kernel = eomgen.build(name, kernels=("rollout",), flags=("-O0",))
    package = generate(name, tmp_path, Options(("rollout",), flags=("-O0",), levels=(BASE,)), ros2=True)
    rng = np.random.default_rng(3)
    q, u, dt = rng.uniform(-1e-3, 1e-3, kernel.n), rng.uniform(-1.0, 1.0, kernel.n), 1e-4
    numbers = {key: ", ".join(x.hex() for x in values) for key, values in (("q", q), ("u", u))}
    (tmp_path / "main.cpp").write_text(PLANT.format(name=name, dt=dt, method=method, **numbers), encoding="ascii")
    *moved, good, refused, allocations = run(compiled_plant(package, tmp_path, name)).split()
    state = q, np.zeros(kernel.n)
    for _ in range(50):
        qs, vs = kernel.rollout(*state, u, dt, 1, method=method)
        state = qs[-1], vs[-1]
    np.testing.assert_array_equal([float.fromhex(x) for x in moved], np.concatenate(state))
    assert (good, refused, allocations) == ("1", "1", "0")


def test_the_package_is_one_of_ament(tmp_path: Path) -> None:
    package = generate("one_link", tmp_path, Options(("rollout",), flags=("-O0",), levels=(BASE,)), ros2=True) / "ros2"
    root = ElementTree.parse(package / "package.xml").getroot()
    name = root.findtext("name")
    assert root.get("format") == "3"
    lists = (package / "CMakeLists.txt").read_text(encoding="ascii")
    assert f"project({name} " in lists
    for depend in root.findall("depend"):
        assert f"find_package({depend.text} REQUIRED)" in lists
    assert f'package="{name}"' in (package / "launch/robot.launch.py").read_text(encoding="ascii")
    compile((package / "launch/robot.launch.py").read_text(encoding="ascii"), "launch", "exec")
    catkin = needs("catkin_pkg.package", extra=None)
    parsed = catkin.parse_package(str(package / "package.xml"))
    parsed.validate()


def test_a_package_without_rollouts_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="rollout"):
        generate("one_link", tmp_path, Options(("energy",), flags=("-O0",), levels=(BASE,)), ros2=True)
    assert not (tmp_path / "one_link").exists()


def compiled_plant(package: Path, folder: Path, name: str = "one_link") -> Path:
    """The program of a folder's main.cpp with a package's kernel and its plant."""
    (folder / "include").mkdir()
    (folder / "include/eomgen").symlink_to(package)
    places = ("-I", folder, "-I", folder / "include", "-I", package / "ros2", NO_EIGEN)
    parts = (folder / "main.cpp", compiled_kernel(package, folder, name))
    run("g++", "-std=c++17", *WARNINGS, *places, *parts, "-o", folder / "main", "-lm")
    return folder / "main"
