"""The gateway for MATLAB, compiled and called by Octave: the Python kernel's bits, and its errors."""

from __future__ import annotations

import subprocess
from pathlib import Path

import numpy as np
import pytest

import eomgen
from eomgen.codegen.package.compile import FLAGS
from eomgen.pipeline.stages import Options, generate
from eomgen.runtime.levels import BASE
from tests.support.c_project import WARNINGS, need, run
from tests.support.soak import soaked

KERNELS = ("forward_dynamics", "inverse_dynamics", "mass_matrix", "kinematics", "external_force", "residual_jacobian")
SCRIPT = """
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
    kernel = eomgen.build(robot, kernels=KERNELS, flags=("-O0",))
    package = generate(robot, tmp_path, Options(KERNELS, flags=("-O0",), level=BASE), cmake=True)
    flags = [x for x in FLAGS if x.startswith("-f")]
    run("mkoctfile", "--mex", *flags, "-std=c99", *WARNINGS, f"{name}_mex.c", f"{name}.c", cwd=package)
    rng = np.random.default_rng(6)
    q, v, u = (rng.uniform(-0.3, 0.3, (2, kernel.n)) for _ in range(3))
    wrench = rng.uniform(-1.0, 1.0, (len(kernel.links), 6))
    arrays = {"q": q.T, "v": v.T, "u": u.T, "wrench": wrench}
    frame = kernel.frames[0]
    states = "\n".join(_matlab(*pair) for pair in arrays.items())
    (package / "check.m").write_text(SCRIPT.format(states=states, name=name, frame=frame), encoding="ascii")
    command = ["octave", "--no-gui", "--quiet", "--norc", "check.m"]
    result = subprocess.run(command, cwd=package, capture_output=True, text=True, check=False)
    lines = result.stdout.splitlines()
    assert len(lines) == 15, result.stderr
    found = {}
    for line in lines[:7]:
        what, shape, numbers = line.split(":")
        axes = [int(x) for x in shape.strip("[]").split()]
        found[what] = np.reshape([float(x) for x in numbers.split()], axes, order="F")
    elsewhere = kernel.with_parameters({"gravity.z": -1.5})
    expected = {
        "forward_dynamics": kernel.forward_dynamics(q, v, u).T,
        "one": kernel.forward_dynamics(q, v[0], u).T,
        "mass_matrix": kernel.mass_matrix(q[0]),
        "residual_jacobian": np.moveaxis(np.array(kernel.residual_jacobian(q, v, u)), 1, -1),
        "external_force": kernel.external_force(q[0], wrench)[:, None],
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
    options = Options(("forward_dynamics",), flags=("-O0",), level=BASE)
    package = generate(eomgen.load_robot("four_bar"), tmp_path, options, cmake=True)
    text = (package / "four_bar_mex.c").read_text(encoding="ascii")
    assert "four_bar_forward_dynamics(h, in[0], in[1], in[2], out)" in text
    assert "says what it means" in text
    assert "cannot be inverted at" not in text
