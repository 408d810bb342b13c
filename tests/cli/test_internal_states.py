"""Every command with a robot whose friction or whose servo drive has states: it works and names them, or refuses."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from eomgen.cli.entry import NAMES
from tests.support.bristled import ARM
from tests.support.commands import run
from tests.support.optional import needs
from tests.support.soak import soaked

pytestmark = [
    pytest.mark.usefixtures("unoptimised"),
    pytest.mark.filterwarnings("ignore::eomgen.errors.EomgenWarning"),
]

SCENARIO = """
duration = 0.1
motion = { type = "point_to_point", start = { j1 = 0.2, j2 = 0.2 }, goal = { j1 = 0.22, j2 = 0.21 } }
control = { type = "pd", kp = 2e3, kd = 20 }
"""
PLAN = '[[vary]]\nparameter = "joints.j2.beta.friction.bristle_stiffness"\ngrid = { values = [1e3, 2e3] }\n'
TOLERANCES = '"joints.j1.offset.gamma" = { bound = 1e-5 }\n'
RANGES = ("--range", "j1.gamma", "-1", "1", "--range", "j2.gamma", "0.2", "2")
Z1, Z2 = "j1.gamma.friction.z", "j2.beta.friction.z"
CALLS = {  # words, exit code, what is said
    "robots": ((), 0, "one_link"),
    "info": (("arm.toml",), 0, f"{Z1} [rad]  friction      5000 z^2 J"),
    "new": (("arm", "-o", "new.toml"), 0, "new.toml"),
    "check": (("arm.toml", "scenario.toml"), 0, "ok: 2 links, 4 coordinates, 2 states of force laws"),
    "schema": (("robot",), 0, "bristle_stiffness"),
    "derive": (("arm.toml",), 0, "d/dt z_beta_2 = betadot_2 - 20000.0*z_beta_2*Abs(betadot_2)"),
    "generate": (("arm.toml", "-o", "generated", "--kernels", "forward_dynamics"), 0, "generated"),
    "export": (("arm.toml", "--mjcf", "--approximate", "-o", "arm.xml"), 0, "arm.xml"),
    "observer": (
        ("arm.toml", "--measure", "encoder:j1.gamma", "-o", "observer", "--step", "1e-3"),
        1,
        "observer of bristled: it has internal states",
    ),
    "bench": (("arm.toml",), 0, "the textbook's algorithms know linear springs and dampers only"),
    "bound": (
        ("arm.toml", "--kernels", "generalized_force", "--range", f"z:{Z2}", "0", "1e-3"),
        0,
        "generalized_force of bristled, float64",
    ),
    "cache": ((), 0, "sources"),
    "reduce": (("arm.toml", "-o", "modes.npz"), 1, ".npz (finite elements of eomgen)"),
    "simulate": (
        ("arm.toml", "--scenario", "scenario.toml", "-o", "out", "--no-plots"),
        0,
        "friction of j2.beta: held",
    ),
    "feedforward": (("arm.toml", "--scenario", "scenario.toml", "-o", "drives.csv"), 1, "no flat outputs"),
    "sweep": (("arm.toml", "--scenario", "scenario.toml", "--plan", "plan.toml", "-o", "sweep"), 0, "2 samples"),
    "deflection": (("arm.toml", "--state", f"{Z2}=1e-5"), 0, f"'{Z2}': kept at 1e-05"),
    "modes": (("arm.toml", "--pose", "0.3", "0.4"), 0, f"'{Z2}': has an eigenvalue of 0"),
    "response": (("arm.toml", "--points", "5"), 0, "tcp.z                   tcp.fz"),
    "linearize": (("arm.toml",), 0, f"internal states: {Z1}, {Z2}"),
    "budget": (("out", "--robot", "arm.toml"), 0, "j2.beta"),
    "compare": (("arm.toml", "other.toml", "--duration", "0.1"), 0, "other"),
    "forces": (("arm.toml", "measured.csv"), 1, "laws of 'j1.gamma', 'j2.beta' have states; allowed: robots without"),
    "fit": (("arm.toml", "out/trajectory.npz"), 0, "friction.bristle_stiffness"),
    "identify": (
        ("arm.toml", "measured.csv"),
        1,
        "laws of 'j2.beta' have states; allowed: those of friction at drives",
    ),
    "excite": (("arm.toml", "--duration", "2"), 0, "base parameters"),
    "calibrate": (("arm.toml", "poses.csv"), 0, "joints.j1.offset.gamma"),
    "poses": (("arm.toml", *RANGES, "--count", "8", "-o", "plan.csv"), 0, "plan.csv"),
    "accuracy": (("out",), 0, "accuracy"),
    "tolerance": (("arm.toml", "tolerances.toml", "--random", "10"), 0, "tcp"),
    "compensate": (("arm.toml", "--scenario", "scenario.toml"), 0, "compensat"),
    "plot": (("out", "-o", "plots"), 0, "plots"),
    "report": (("out", "-o", "report.html"), 0, "report.html"),
    "view": (("arm.toml", "-o", "view.html"), 0, "view.html"),
    "live": (("arm.toml", "-o", "live.html"), 0, "live.html"),
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a description, a scenario, a plan, a motion, and what a simulation of it wrote."""
    folder = tmp_path_factory.mktemp("bristled")
    (folder / "arm.toml").write_text(ARM, encoding="ascii")
    (folder / "other.toml").write_text(ARM.replace('name = "bristled"', 'name = "other"'), encoding="ascii")
    for name, text in (("scenario", SCENARIO), ("plan", PLAN), ("tolerances", TOLERANCES)):
        (folder / f"{name}.toml").write_text(text, encoding="ascii")
    t = np.linspace(0.0, 1.0, 101)
    rows = [f"{x!r},{0.1 * math.sin(x)!r},{0.1 * math.cos(x)!r},1.0,2.0" for x in t.tolist()]
    head = "t,q.j1.gamma,q.j2.gamma,u.j1.gamma,u.j2.gamma"
    (folder / "measured.csv").write_text("\n".join([head, *rows]) + "\n", encoding="ascii")
    head = "j1.gamma,j2.gamma,tcp.x,tcp.y,tcp.z"
    rows = []
    for k, a in enumerate((-1.0, -0.4, 0.3, 0.9, 1.4, -0.2, 0.6, 1.1, -0.7, 0.1)):
        b, off = 0.3 + 0.25 * (k % 7), [1e-5 * math.sin(7 * k + i) for i in range(3)]
        x, y = 0.4 * math.cos(a) + 0.4 * math.cos(a + b), 0.4 * math.sin(a) + 0.4 * math.sin(a + b)
        rows.append(f"{a!r},{b!r},{x + off[0]!r},{y + off[1]!r},{off[2]!r}")
    (folder / "poses.csv").write_text("\n".join([head, *rows]) + "\n", encoding="ascii")
    return folder


def test_every_command_is_called() -> None:
    assert set(CALLS) == set(NAMES)


EXAMPLE = Path(__file__).parents[2] / "examples" / "servo_axis.toml"
SERVO_SCENARIO = "duration = 0.1\nmotion = { type = 'point_to_point', goal = { axis = 0.05 } }\n"
SERVO_PLAN = '[[vary]]\nparameter = "joints.axis.gamma.drive.controller.velocity.kp"\ngrid = { values = [6.0, 8.0] }\n'
SERVO = {  # words, exit code, what is said
    "info": (("axis.toml",), 0, "drive.winding.resistance 0.8"),
    "check": (("axis.toml", "scenario.toml"), 0, "ok: 1 links, 1 coordinates"),
    "schema": (("robot",), 0, "torque_constant"),
    "derive": (("axis.toml",), 0, "D_gamma_1 = reference of position of axis.gamma: rad"),
    "generate": (("axis.toml", "-o", "generated", "--kernels", "inverse_dynamics,residual"), 0, "generated"),
    "export": (("axis.toml", "--mjcf", "--approximate", "-o", "axis.xml"), 0, "joints.axis.gamma.drive: left out"),
    "bench": (("axis.toml",), 0, "springs and dampers only (axis.gamma): kernels are timed alone"),
    "bound": (("axis.toml", "--kernels", "drive_forces"), 0, "drive_forces of servo_axis, float64"),
    "simulate": (("axis.toml", "--scenario", "scenario.toml", "-o", "out", "--no-plots"), 0, "energy: drives"),
    "sweep": (("axis.toml", "--scenario", "scenario.toml", "--plan", "plan.toml", "-o", "sweep"), 0, "2 samples"),
    "linearize": (("axis.toml", "--drives", "free"), 0, "axis.gamma.drive.current"),
    "modes": (("axis.toml",), 0, "nothing can move"),
    "compare": (("axis.toml", "other.toml", "--duration", "0.1"), 0, "other"),
    "identify": (("axis.toml", "out/trajectory.npz", "--terms", "links", "rotors", "viscous"), 0, "base parameters"),
    "compensate": (("axis.toml", "--scenario", "scenario.toml"), 0, "cannot be corrected"),
    "report": (("out", "-o", "report.html"), 0, "report.html"),
    "view": (("axis.toml", "-o", "view.html"), 0, "view.html"),
    "live": (("axis.toml", "-o", "live.html"), 0, "live.html"),
}


@pytest.fixture(scope="module")
def servo(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the example of a servo drive, a scenario and a plan."""
    folder, text = tmp_path_factory.mktemp("servo"), EXAMPLE.read_text(encoding="ascii")
    other = text.replace('name = "servo_axis"', 'name = "other"')
    for name, content in (("axis", text), ("other", other), ("scenario", SERVO_SCENARIO), ("plan", SERVO_PLAN)):
        (folder / f"{name}.toml").write_text(content, encoding="ascii")
    return folder


def check(command: str, calls: dict[str, tuple[tuple[str, ...], int, str]]) -> None:
    """In the current folder; what needs the result of a simulation has it made first."""
    if command == "live":
        needs("ziglang")
    words, code, said = calls[command]
    if any(word.startswith("out") for word in words) and command != "simulate" and not Path("out").exists():
        assert run("simulate", *calls["simulate"][0])[0] == 0
    status, out, err = run(command, *words)
    assert status == code, err
    assert said in out + err


@pytest.mark.parametrize("command", soaked(CALLS, CALLS.keys() - {"fit", "live"}))
def test_it_works_or_refuses_by_name(command: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)
    check(command, CALLS)


@pytest.mark.parametrize("command", soaked(SERVO, SERVO.keys() - {"live"}))
def test_servo_drives(command: str, servo: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(servo)
    check(command, SERVO)
