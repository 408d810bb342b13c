"""Live pages: their modules under node, and whole pages in a headless Chromium beside what Python computes."""

from __future__ import annotations

import base64
import json
import re
import shutil
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen.codegen.forces.joint_stiffness import JointStiffnesses
from eomgen.description.load import robot_from_toml
from eomgen.export.live.acting import HELD, STIFF, default_scenario
from eomgen.export.live.contents import KERNELS, _in_motion, contents_of
from eomgen.export.live.page import live_page
from eomgen.export.live.sliders import parameter_sliders
from eomgen.export.wasm.pack import make_wasm
from eomgen.export.wasm.signals import as_json
from eomgen.kernel.stepping.adaptive import adaptive_rollout
from eomgen.kernel.stepping.options import InputStepOptions
from eomgen.kernel.stepping.packed_inputs import plain_signal
from eomgen.motion.point_to_point import PointToPoint
from eomgen.motion.splines import Spline
from eomgen.progress import no_progress
from eomgen.robot.model import build_model
from eomgen.robot.value import COORDINATES, INERTIA_KEYS, Robot
from eomgen.runtime.rollouts import Control, Inputs
from eomgen.scenario.value import Initial, Scenario, Section
from eomgen.simulation.loads import combined_body
from tests.support.bristles import bristle_arm, bristle_linkage, servo_arm, servo_axes
from tests.support.browser import Page, open_page
from tests.support.every_element import robot_with
from tests.support.optional import needs
from tests.support.refusals import refused

pytestmark = pytest.mark.usefixtures("unoptimised")

ROOT = Path(__file__).parents[2]
MODULES = ROOT / "templates" / "live"
NODE = shutil.which("node")
NEAR = 1e-12  # m, rad, and their rates: round-off of what differs in order

PURE = """
import { signalAt, cycleAt, between } from "#live/signals";
import { Settings } from "#live/settings";
import { sliderScale, shown } from "#live/numbers";
import { ticks } from "#live/chart";
import { Simulation } from "#live/simulation";
import { readFileSync } from "node:fs";

const given = JSON.parse(readFileSync(0, "utf8"));
const kernel = { parameters: given.values, set() {}, energy: () => [0, 0] };
const start = { q: [0], v: [0], z: [] }, coordinates = ["a"];
const data = { coordinates, beside: [0], states: [], drives: [], start, payload: given.payload, period: 1e-3 };
const simulation = new Simulation(kernel, null, data);
simulation.payload = given.mass;
const taken = [];
const first = new Settings(), second = new Settings();
for (const settings of [first, second]) {
  settings.define("p.joints.a b.stiffness", 2e5, (value) => taken.push(value), (value) => value >= 0);
  settings.define("drive", "cycle", () => {}, (value) => ["cycle", "none"].includes(value));
  settings.define("on", true);
}
first.put("p.joints.a b.stiffness", 1.25e-7);
first.put("drive", "none");
first.put("on", false);
const fragment = first.fragment();
const refused = [second.read(`${fragment}&strange=1&%=2&=`), second.read("#drive=%3Cscript%3E&on=maybe")];
const even = { low: -2, high: 3 }, decades = { low: 1e-3, high: 1e5, log: true };
const scales = [decades, { low: 0.01, high: 5, log: true, zero: true }, even];
console.log(JSON.stringify({
  signals: given.signals.map((one) => given.times.map((t) => signalAt(one, t))),
  cycle: [0, 0.5, 1, 1.7, 2.5].map((t) => cycleAt({ start: [0], goal: [1], duration: 1, pause: 0.5 }, t)),
  between: [-1, 0, 0.25, 3, 9].map((t) => between([0, 1, 3], t)),
  loaded: simulation.loaded(given.values),
  fragment,
  refused,
  values: ["p.joints.a b.stiffness", "drive", "on"].map((key) => second.get(key)),
  denied: [["p.joints.a b.stiffness", -1], ["p.joints.a b.stiffness", "x"], ["drive", "x"], ["unknown", 1]].map(
    (one) => second.put(...one)),
  scales: scales.map((scale) => [0, 0.3, 1].map((at) => sliderScale(scale).toPosition(sliderScale(scale).toValue(at)))),
  shown: [0, 1234.5678, 1e-7, 2.5e6, -0.25].map((x) => shown(x)),
  ticks: ticks(-0.31, 1.02, 5),
}));
"""


def answer_of(folder: Path, script: str, given: Any) -> Any:
    """Return what a script of node answers, from JSON; it stands with the page's modules in the folder live."""
    (folder / "live" / "runner.mjs").write_text(script, encoding="ascii")
    command = [str(NODE), str(folder / "live" / "runner.mjs")]
    done = subprocess.run(command, input=json.dumps(given), capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.mark.skipif(NODE is None, reason="node is not installed")
def test_the_modules_of_the_page(tmp_path: Path) -> None:
    """Programs, payloads and settings as Python has them."""
    rng = np.random.default_rng(5)
    programs = [
        PointToPoint(np.array([0.1, -1.0]), np.array([0.7, 2.0]), 0.8, 0.2),
        Spline([0.0, 0.3, 0.7, 1.1], rng.uniform(-1.0, 1.0, (4, 3)), at_rest=True),
        PointToPoint(np.array([0.1, -1.0]), np.array([0.7, 2.0]), 0.8, 0.2, smooth=4),
    ]
    link = eomgen.Link("arm", 2.0, (0.1, -0.2, 0.3), (0.3, 0.4, 0.5, 0.01, -0.02, 0.03))
    names = ["mass", *(f"com.{axis}" for axis in "xyz"), *(f"inertia.{key}" for key in INERTIA_KEYS)]

    def parameters(body: eomgen.Link) -> dict[str, float]:
        return {f"links.arm.{k}": x for k, x in zip(names, (body.mass, *body.com, *body.inertia), strict=True)}

    point, times = (0.4, 0.1, -0.1), [-0.5, 0.0, 0.2, 0.33, 0.7, 0.99, 1.0, 1.1, 2.0]
    given = {
        "signals": [as_json(plain_signal(program.as_signal())) for program in programs],
        "times": times,
        "values": parameters(link),
        "payload": {"link": "arm", "point": point, "most": 1.0},
        "mass": 0.7,
    }
    shutil.copytree(MODULES, tmp_path / "live")
    found = answer_of(tmp_path, PURE, given)
    for program, rows in zip(programs, found["signals"], strict=True):
        expected = [np.array(program.at(t)) for t in times]
        np.testing.assert_allclose(np.array(rows), expected, rtol=0.0, atol=1e-10)
    q, v, a = (np.array(x)[:, 0] for x in zip(*found["cycle"], strict=True))
    np.testing.assert_allclose(q, [0.0, 0.5, 1.0, 1.0 - PointToPoint(np.zeros(1), np.ones(1), 1.0).at(0.2)[0][0], 0.0])
    np.testing.assert_allclose(v[[0, 1, 2, 4]], [0.0, 1.875, 0.0, 0.0])
    assert abs(a[1]) < 1e-12
    assert found["between"] == [[0, 0], [0, 0], [0, 0.25], [2, 0], [2, 0]]
    both = parameters(combined_body(link, [eomgen.Link("payload", 0.7, point, (0.0,) * 6)]))
    assert found["loaded"] == pytest.approx(both, rel=1e-13)
    assert found["fragment"].startswith("#") and "<" not in found["fragment"]  # noqa: PT018
    assert found["values"] == [1.25e-7, "none", False]
    assert found["refused"] == [["strange"], ["drive", "on"]]
    assert found["denied"] == [False] * 4
    np.testing.assert_allclose(found["scales"], [[0.0, 0.3, 1.0]] * 3, atol=1e-12)
    assert found["shown"] == ["0", "1235", "1e-7", "2.5e6", "-0.25"]
    np.testing.assert_allclose(found["ticks"], [0.0, 0.5, 1.0], atol=1e-12)


MOVING = """
import { readFileSync } from "node:fs";
import { load } from "./NAME.mjs";
import { Simulation } from "#live/simulation";
import { plotsOf } from "#live/plots";

const { data, ticks, changed } = JSON.parse(readFileSync(0, "utf8"));
const simulation = new Simulation(await load(), null, data);
simulation.drive = "none";
simulation.reset();
for (const [name, value] of Object.entries(changed)) simulation.set(name, value);
for (let i = 0; i < ticks; i++) simulation.tick();
simulation.reset(simulation); // as a page goes on from a recording
const shown = [...plotsOf(data)].filter(([key]) => key.startsWith("states.")).map(([, plot]) => plot);
const plots = shown.map((plot) => [plot.names, plot.value({ states: simulation.z })]);
const { q, v, z, t } = simulation;
console.log(JSON.stringify({ q: [...q], v: [...v], z: [...z], t, plots }));
"""


def moved_on_page(contents: Any, folder: Path, ticks: int, first: str = "", **given: Any) -> Any:
    """Return the answer of the page's modules under node, without a browser, after ticks of its simulation.

    Args:
        contents: Of the page.
        folder: To write the modules and the WebAssembly to.
        ticks: Number of periods.
        first: JavaScript before the first tick, in the place of drives that are switched off.
        given: Values of parameters that are changed, as ``changed``; other values of the page.
    """
    needs("ziglang")
    shutil.copytree(MODULES, folder / "live")
    make_wasm(contents.robot, kernels=KERNELS).write(folder / "live")
    text = MOVING.replace("NAME", contents.robot.name)
    if first.startswith("simulation.push"):
        text = text.replace('simulation.drive = "none";\n', "")
    script = text.replace("for (let i = 0; i < ticks", f"{first}\nfor (let i = 0; i < ticks")
    changed = given.pop("changed", {})
    return answer_of(folder, script, {"data": {**contents.values, **given}, "ticks": ticks, "changed": changed})


def rolled(kernel: eomgen.Kernel, values: dict[str, Any], ticks: int, u: Any = None) -> tuple[Any, Any, Any]:
    """Return q, v and z after rollouts over so many periods of the page.

    Args:
        kernel: That moves.
        values: Of the page.
        ticks: Number of periods.
        u: Drives with forces beside those with states behind them, or (k, q) -> those of period k.
    """
    start, how = (
        values["start"],
        InputStepOptions(duration=values["period"], **{x: values[x] for x in ("rtol", "method")}),
    )
    q, v = np.array(start["q"]), np.array([*start["v"], *start["z"]])
    for k in range(ticks):
        inputs = Inputs(q, v, u(k, q) if callable(u) else u, Control())
        q, v = (x[-1] for x in adaptive_rollout(kernel.calls, inputs, how))
    return q, v[: kernel.n], v[kernel.n :]


def with_matrix() -> Robot:
    """Return a robot whose joint has matrices, of which one entry is moved on the page's kernel."""
    return robot_from_toml(robot_with(JointStiffnesses))


@pytest.mark.skipif(NODE is None, reason="node is not installed")
@pytest.mark.parametrize(
    ("make", "changed"),
    [
        (bristle_arm, {"joints.j1.gamma.friction.coulomb": 0.2}),
        pytest.param(bristle_linkage, {}, marks=pytest.mark.soak),
        pytest.param(with_matrix, {"joints.neck.stiffness.x.beta": 1.0}, marks=pytest.mark.soak),
    ],
)
def test_what_moves_on_a_page_moves_as_rollouts_of_python(
    make: Callable[[], Robot], changed: dict[str, float], tmp_path: Path
) -> None:
    """Under node, without a browser: internal states, loops, matrices; drives off, parameters as they were changed."""
    contents = contents_of(make(), None, None, no_progress)
    values, start = contents.values, contents.values["start"]
    kernel, ticks = eomgen.build(contents.robot, kernels=KERNELS), 40
    assert len(start["q"]) == len(start["v"]) == kernel.n
    assert len(start["z"]) == len(kernel.internal_states)
    for drive in values["drives"]:  # critical damping, in two digits
        assert drive["kp"] > 0.0
        assert drive["kd"] == pytest.approx(2.0 * drive["kp"] / STIFF, rel=0.1)
    assert [state["name"] for state in values["states"]] == list(kernel.internal_states)
    assert not any(
        name in {slider["name"] for slider in values["parameters"]} for name in changed if ".stiffness." in name
    )
    found = moved_on_page(contents, tmp_path, ticks, changed=changed, drive="none")
    kernel.parameters.update(changed)
    q, v, z = rolled(kernel, values, ticks)
    np.testing.assert_allclose(found["q"], q, rtol=0.0, atol=NEAR)
    np.testing.assert_allclose([*found["v"], *found["z"]], [*v, *z], rtol=1e-10, atol=NEAR)
    assert np.abs(q - start["q"]).max() > 1e-3
    if kernel.internal_states:
        ((names, shown),) = found["plots"]
        assert names == list(kernel.internal_states)
        np.testing.assert_allclose(shown, 1e3 * z, rtol=1e-9)
        assert np.abs(z).min() > 1e-5
    else:
        assert found["plots"] == []


@pytest.mark.soak
@pytest.mark.skipif(NODE is None, reason="node is not installed")
def test_servo_drives_take_references_from_a_page(tmp_path: Path) -> None:
    """Positions of the program at the shafts, held over a period, and a push beside the drives, as in Python."""
    robot, ticks = servo_axes(), 60
    motion = Section("point_to_point", {"duration": 0.2, "goal": {"j1": 0.6, "j2": -0.3}})
    contents = contents_of(robot, eomgen.Scenario(0.2, motion=motion), None, no_progress)
    values, kernel = contents.values, eomgen.build(contents.robot, kernels=(*KERNELS, "forward_dynamics"))
    assert (values["control"], values["drive"], [x["rate"] for x in values["drives"]]) == (
        "reference",
        "program",
        [False, False],
    )
    assert contents_of(robot, None, None, no_progress).values["control"] == "reference"
    push = {"link": "l2", "point": [0.2, 0.0, 0.05], "force": [0.0, 5.0, 0.0]}
    found = moved_on_page(contents, tmp_path, ticks, f"simulation.push = {json.dumps(push)};")
    program, wrench = signal_program(values), np.zeros((len(kernel.links), 6))
    wrench[kernel.links.index("l2"), :3] = push["force"]

    def drives(k: int, q: Any) -> Any:
        u = np.zeros(kernel.calls.inputs)
        for drive, at in zip(values["drives"], program((k + 0.5) * values["period"]), strict=True):
            u[drive["place"]] = at * drive["ratio"]
        np.add.at(u, values["beside"], kernel.functions.external_force(q, wrench))
        return u

    q, v, z = rolled(kernel, values, ticks, drives)
    np.testing.assert_allclose(found["q"], q, rtol=0.0, atol=1e-10)
    np.testing.assert_allclose([*found["v"], *found["z"]], [*v, *z], rtol=1e-7, atol=1e-9)
    assert np.abs(q - values["start"]["q"]).max() > 1e-2


@pytest.mark.skipif(NODE is None, reason="node is not installed")
def test_drives_that_take_a_voltage_have_sliders(tmp_path: Path) -> None:
    """Of a position and a voltage in one robot: each input acts as in Python, from where it stands at the start."""
    contents, ticks = contents_of(servo_arm(), None, None, no_progress), 30
    values, kernel = contents.values, eomgen.build(contents.robot, kernels=KERNELS)
    assert (values["control"], values["drive"], values["drives"]) == ("none", "none", [])
    first, second = values["inputs"]
    assert first == {"label": "j1.gamma: reference of position", "place": 0, "unit": "rad", **_ends(first, 1.5)}
    assert second == {"label": "j2.motor: voltage", "place": 3, "unit": "V", "start": 0.0, "low": -24.0, "high": 24.0}
    assert first["start"] == values["start"]["q"][0]
    inputs, u = [first["start"] + 0.2, 3.0], np.zeros(kernel.calls.inputs)
    found = moved_on_page(contents, tmp_path, ticks, f"simulation.inputs = {inputs};")
    u[[0, 3]] = inputs
    q, v, z = rolled(kernel, values, ticks, u)
    np.testing.assert_allclose(found["q"], q, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose([*found["v"], *found["z"]], [*v, *z], rtol=1e-7, atol=1e-8)
    assert np.abs(q - values["start"]["q"]).max() > 1e-2
    assert contents_of(servo_axes(), None, None, no_progress).values["inputs"] == []


def _ends(slider: dict[str, Any], span: float) -> dict[str, float]:
    return {"start": slider["start"], "low": slider["start"] - span, "high": slider["start"] + span}


def signal_program(values: dict[str, Any]) -> Callable[[float], Any]:
    """Return the page's program as Python evaluates it."""
    motion = PointToPoint(np.array([d["start"] for d in values["drives"]]), np.array([0.6, -0.3]), 0.2)
    return lambda t: motion.at(t)[0]


def test_a_recording_has_internal_states() -> None:
    robot = bristle_arm()
    result = eomgen.run_scenario(robot, eomgen.Scenario(0.05))
    recorded = contents_of(robot, None, result, no_progress).values["recorded"]
    motion = result.trajectory
    assert motion.z is not None
    for key, wanted in (("q", motion.q), ("v", motion.v), ("z", motion.z)):
        found = np.frombuffer(base64.b64decode(recorded[key])).reshape(motion.t.size, -1)
        np.testing.assert_array_equal(found, wanted)


@pytest.mark.soak
def test_a_page_has_everything_and_no_text_ends_its_elements() -> None:
    needs("ziglang")
    robot = eomgen.load_robot("one_link")
    spoiled = Robot(**{**vars(robot), "notes": ("</script><script>document.title = 'taken'</script>", "a & b")})
    text = live_page(spoiled)
    assert text.count("<script") == text.count("</script>") == 4
    assert "taken'</script>" not in text
    assert not re.search(r'(src|href)="(?!data:)', text)
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', text)
    assert "default-src 'none'" in policy[1]
    assert "http" not in policy[1]
    values = json.loads(re.search(r'<script type="application/json" id="data">(.*?)</script>', text, re.DOTALL)[1])  # type: ignore[index]
    assert values["notes"] == list(spoiled.notes)
    assert [x["name"] for x in values["parameters"]][:3] == ["gravity.x", "gravity.y", "gravity.z"]
    assert values["meshes"] == []
    assert {c["link"] for c in values["capsules"]} <= {"base", "link1"}


def test_without_a_compiler_the_extra_is_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name, package=None: None)
    monkeypatch.setattr("shutil.which", lambda *given, **more: None)
    refused(eomgen.BuildError, r"eomgen\[compiler\]", eomgen.export_live, "one_link", tmp_path / "page.html")
    assert not list(tmp_path.iterdir())


def test_sliders_of_parameters_have_ranges_about_their_values() -> None:
    """Gravity up to that of Jupiter; what cannot be negative by two decades to either side."""
    robot = eomgen.load_robot("one_link")
    values = dict(build_model(robot).parameters)
    _, y, _, spring = parameter_sliders(robot, values, frozenset())
    assert (y["name"], y["value"], y["unit"]) == ("gravity.y", -9.81, "m/s^2")
    assert (y["low"], y["high"], y["log"], y["least"]) == (-25.0, 25.0, False, None)
    assert (spring["owner"], spring["label"], spring["unit"]) == ("joints joint1", "x.stiffness", "N/m")
    assert [spring[key] for key in ("low", "value", "high", "log", "least")] == [1e2, 1e4, 1e6, True, 0.0]
    rest = parameter_sliders(robot, values, frozenset({"gravity.y"}))
    assert [x["name"] for x in rest] == ["gravity.x", "gravity.z", "joints.joint1.x.stiffness"]


def test_default_scenarios_hold_a_robot() -> None:
    """Servo drives by their references where default motions begin, a shaken base by small harmonic motions."""
    initial = Initial(q={"j1.gamma": 0.0, "j2.gamma": 0.0})
    assert default_scenario(servo_axes()) == Scenario(HELD, initial=initial, control=Section("reference", {}))
    shaken = default_scenario(eomgen.load_robot("shaken_arm"))
    assert (shaken.control.type, shaken.control.values["gravity"]) == ("pd", True)
    assert list(shaken.control.values["kp"]) == ["waist.gamma", "shoulder.gamma", "elbow.gamma"]
    names = [f"mount.{name}" for name in COORDINATES]
    assert [(x.type, x.values["coordinate"]) for x in shaken.prescribed] == [("harmonic", name) for name in names]


def test_deflections_under_the_largest_acceleration_of_the_default_motion() -> None:
    """From the first joint's acceleration at rest: of l2's mass along j2.x, over the stiffness there."""
    kernel = eomgen.build(bristle_arm(), kernels=KERNELS)
    names = kernel.coordinates
    acting = {"cycle": {"start": [0.1], "goal": [0.9], "duration": 2.0}, "drives": [{"joint": 0}]}
    found = _in_motion(bristle_arm(), kernel, np.zeros(len(names)), [names.index("j2.x")], acting)
    t = np.linspace(0.0, 2.0, 2001)
    fastest = np.abs(PointToPoint(np.array([0.1]), np.array([0.9]), 2.0).at(t)[2]).max()
    expected = {"j2.x": 1.0 * fastest * 0.05 * np.sin(0.5) / 1e4}
    assert np.abs(found) == pytest.approx([expected.get(name, 0.0) for name in names], rel=1e-3)


def test_what_a_page_cannot_do_is_refused() -> None:
    class Python:
        start = np.zeros(1)

        def at(self, t: Any) -> Any:
            return (np.zeros((*np.shape(t), 1)),) * 3

    section = Section("program", {"program": Python()})
    scenario = eomgen.Scenario(1.0, motion=section)
    with pytest.raises(eomgen.InputError, match=r"motion: is a reference trajectory that only Python can ask"):
        contents_of(eomgen.load_robot("one_link"), scenario, None, no_progress)
    with pytest.raises(eomgen.UnknownNameError, match="nothing_like_it"):
        eomgen.export_live("one_link", "unused.html", scenario=eomgen.Scenario(1.0, frame="nothing_like_it"))


# In a browser


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("pages")


@pytest.fixture
def browser() -> Iterator[Page]:
    needs("ziglang")
    with open_page(1280, 800) as found:
        yield found


def opened(browser: Page, path: Path, fragment: str = "") -> Any:
    """The page in the browser, ready, its time standing still."""
    browser.page.goto(path.as_uri() + fragment)
    browser.page.wait_for_selector("html[data-ready=yes]", state="attached", timeout=60000)
    return browser.page


STATE = "() => { const { t, q, v, z } = live.simulation; return { t, q: [...q], v: [...v], z: [...z] }; }"


@pytest.mark.soak
@pytest.mark.parametrize("name", ["puma560_elastic", "ur5", "four_bar"])
def test_it_moves_as_rollouts_of_python_do(name: str, browser: Page, pages: Path) -> None:
    """Step by step, drives off; a slider's stiffness and gravity, too."""
    robot = eomgen.load_robot(name)
    page = opened(browser, eomgen.export_live(robot, pages / f"{name}.html"))
    page.wait_for_function("() => live.simulation.t > 0.2")
    page.evaluate("() => live.play(false)")
    contents = contents_of(robot, None, None, no_progress)
    start, kernel = contents.values["start"], eomgen.build(contents.robot)
    changed = {"gravity.x": 1.5} | ({"joints.joint2.alpha.stiffness": 4e4} if name == "puma560_elastic" else {})
    page.evaluate("() => { live.settings.put('drive', 'none'); live.reset(); }")
    for key, value in changed.items():
        assert page.evaluate("([key, value]) => live.settings.put(key, value)", [f"p.{key}", value])
    kernel.parameters.update(changed)
    q, v, _ = rolled(kernel, contents.values, 40)
    page.evaluate("() => { for (let i = 0; i < 40; i++) live.step(); }")
    found = page.evaluate(STATE)
    assert np.abs(q - start["q"]).max() > 1e-3
    np.testing.assert_allclose(found["q"], q, rtol=0.0, atol=NEAR)
    np.testing.assert_allclose(found["v"], v, rtol=0.0, atol=NEAR)
    assert found["t"] == pytest.approx(40 * contents.values["period"])
    assert browser.errors == []
    assert [url for url in browser.requests if not url.startswith(("file:", "data:"))] == []


@pytest.mark.soak
def test_a_scenario_goes_on_as_python_simulates_it(browser: Page, pages: Path) -> None:
    """Circle, push and payload of the built-in scenario; drives of the page are held over a period each."""
    result = eomgen.run_scenario("puma560", eomgen.load_scenario("puma560_circle"))
    page = opened(browser, eomgen.export_live("puma560", pages / "circle.html", scenario="puma560_circle"))
    page.evaluate("() => { live.play(false); live.reset(); }")
    off = []
    for t in (0.3, 0.5, 0.8, 1.2, 1.5):
        page.evaluate("(t) => live.advance(t)", t)
        k = int(np.abs(result.trajectory.t - t).argmin())
        off.append(np.abs(np.array(page.evaluate(STATE)["q"]) - result.trajectory.q[k]).max())
    moved = np.ptp(result.trajectory.q, axis=0).max()
    assert max(off) < 2e-3 * moved  # a period is 2 ms, and drives are by 40 rad/s
    errors = np.abs(result.tracking_error).max()
    assert max(off) < 0.2 * errors  # what pushes and payload do is there
    assert browser.errors == []


@pytest.mark.soak
def test_sliders_settings_and_the_address(browser: Page, pages: Path) -> None:
    path = eomgen.export_live("puma560_elastic", pages / "elastic.html")
    page = opened(browser, path, "#p.gravity.z=-3.7&exaggeration=50&drive=target&target.joint3=0.5&compact=true")
    assert page.evaluate("() => live.simulation.kernel.parameters['gravity.z']") == -3.7
    assert not page.locator("#panel").is_visible()
    page.locator("#whole").click()
    assert page.locator("#panel").is_visible()
    page.wait_for_function("() => Math.abs(live.simulation.q[live.data.drives[2].joint] - 0.5) < 0.01", timeout=60000)
    bar = page.get_by_label("all stiffness", exact=True)
    bar.focus()
    before = page.evaluate("() => live.simulation.kernel.parameters['joints.joint2.alpha.stiffness']")
    for _ in range(3):
        page.keyboard.press("ArrowLeft")
    after = page.evaluate("() => live.simulation.kernel.parameters['joints.joint2.alpha.stiffness']")
    factor = page.evaluate("() => live.settings.get('times.stiffness')")
    assert after == pytest.approx(before * factor)
    assert factor < 1.0
    page.locator("#view").focus()
    playing = page.evaluate("() => live.playing")
    page.keyboard.press("Space")
    assert page.evaluate("() => live.playing") is not playing
    page.wait_for_timeout(500)
    fragment = page.evaluate("() => location.hash")
    for part in ("p.gravity.z=-3.7", "exaggeration=50", "times.stiffness="):
        assert part in fragment
    again = opened(browser, path, fragment)
    assert again.evaluate("() => live.settings.get('times.stiffness')") == factor
    again.get_by_role("button", name="All settings as they were").click()
    assert again.evaluate("() => live.settings.fragment()") == ""
    assert browser.errors == []


@pytest.mark.soak
@pytest.mark.parametrize("make", [lambda: eomgen.load_robot("one_link"), bristle_arm], ids=["rigid", "bristles"])
def test_a_recording_is_shown_and_goes_on(make: Callable[[], Robot], browser: Page, pages: Path) -> None:
    result = eomgen.simulate(make(), duration=0.6)
    page = opened(browser, eomgen.export_live(result, pages / "recorded.html"))
    t, q, z = result.trajectory.t, result.trajectory.q, result.trajectory.z
    page.evaluate("(t) => { live.play(false); live.at = t; live.changed(); }", float(t[100]))
    np.testing.assert_array_equal(page.evaluate(STATE)["q"], q[100])
    np.testing.assert_array_equal(page.evaluate(STATE)["z"], [] if z is None else z[100])
    page.get_by_role("button", name="Go on from here").click()
    page.evaluate("() => live.play(false)")
    page.evaluate("(t) => live.advance(t)", float(t[-1]))
    np.testing.assert_allclose(page.evaluate(STATE)["q"], q[-1], atol=2e-3 * np.ptp(q, axis=0).max())
    page.wait_for_timeout(100)
    assert page.get_by_role("button", name="Back to the recording").is_visible()
    assert browser.errors == []


@pytest.mark.soak
def test_a_pushed_link_gives_way(browser: Page, pages: Path) -> None:
    """A force of the tool does what Python's wrench does at rest: the drives' gains are springs."""
    page = opened(browser, eomgen.export_live("one_link", pages / "pushed.html"), "#drive=target")
    data = json.loads(page.locator("#data").text_content())
    place = data["drives"][0]["joint"]
    for y, sign in ((4.0, 1.0), (-4.0, -1.0)):
        page.evaluate("(y) => { live.play(false); live.reset(); live.settings.put('push.y', y); live.advance(6); }", y)
        moved = page.evaluate(STATE)["q"][place] - data["start"]["q"][place]
        moment = y * data["push"]["point"][0]
        assert moved == pytest.approx(moment / data["drives"][0]["kp"], rel=0.05)
        assert sign * moved > 0.0


@pytest.mark.soak
def test_what_a_frame_costs(browser: Page, pages: Path, capsys: pytest.CaptureFixture[str]) -> None:
    page = opened(browser, eomgen.export_live("puma560_elastic", pages / "costs.html"))
    page.evaluate("() => live.profile(60)")
    costs = page.evaluate("() => live.profile(300)")
    with capsys.disabled():
        print(f"\npuma560_elastic, ms of a frame of 60 Hz: {costs}")
    assert min(costs.values()) >= 0.0
