"""Commands with a robot whose drive has a winding and controllers: they work, or refuse by name."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from eomgen.cli.entry import main

pytestmark = [
    pytest.mark.usefixtures("unoptimised"),
    pytest.mark.filterwarnings("ignore::eomgen.errors.EomgenWarning"),
]
EXAMPLE = Path(__file__).parents[2] / "examples" / "servo_axis.toml"
SCENARIO = "duration = 0.1\nmotion = { type = 'point_to_point', goal = { axis = 0.05 } }\n"
PLAN = '[[vary]]\nparameter = "joints.axis.gamma.drive.controller.velocity.kp"\ngrid = { values = [6.0, 8.0] }\n'
CALLS: dict[str, tuple[tuple[str, ...], int, str]] = {  # words, exit code, what is said
    "info": (("axis.toml",), 0, "drive.winding.resistance 0.8"),
    "check": (("axis.toml", "scenario.toml"), 0, "ok: 1 links, 1 coordinates"),
    "schema": (("robot",), 0, "torque_constant"),
    "derive": (("axis.toml",), 0, "D_gamma_1 = reference of position of axis.gamma: rad"),
    "generate": (("axis.toml", "-o", "generated", "--kernels", "inverse_dynamics,residual"), 0, "generated"),
    "export": (("axis.toml", "--mjcf", "--approximate", "-o", "axis.xml"), 0, "joints.axis.gamma.drive: left out"),
    "bench": (
        ("axis.toml",),
        0,
        "algorithms know linear springs and dampers only (axis.gamma): kernels are timed alone",
    ),
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
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("servo")
    shutil.copy(EXAMPLE, folder / "axis.toml")
    text = EXAMPLE.read_text(encoding="ascii")
    (folder / "other.toml").write_text(text.replace('name = "servo_axis"', 'name = "other"'), encoding="ascii")
    (folder / "scenario.toml").write_text(SCENARIO, encoding="ascii")
    (folder / "plan.toml").write_text(PLAN, encoding="ascii")
    return folder


@pytest.mark.parametrize("command", CALLS)
def test_it_works_or_refuses_by_name(
    command: str, folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    if command == "live":
        pytest.importorskip("ziglang", reason="the compiler for WebAssembly is not installed")
    monkeypatch.chdir(folder)
    words, code, said = CALLS[command]
    if any(word.startswith("out") for word in words) and command != "simulate" and not (folder / "out").exists():
        assert main(("simulate", *CALLS["simulate"][0])) == 0
        capsys.readouterr()
    found = main((command, *words))
    streams = capsys.readouterr()
    assert found == code, streams.err
    assert said in streams.out + streams.err
