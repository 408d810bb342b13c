"""Pages that show a robot: the mechanism under node beside Python's poses and constraints, the command, the method."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen.cli import entry as cli
from eomgen.cli.shared.reading import is_result
from eomgen.errors import InputError
from eomgen.export.live.page import scripts_of
from eomgen.export.live.view import RobotPage, contents_of_view, mechanism_of, robot_page, show_robot
from eomgen.pictures.scene import link_poses
from eomgen.results.beside import TRAJECTORY
from eomgen.robot import build_model
from eomgen.robot.value import Robot
from tests.description.test_beams import crane
from tests.support.bending_robots import bent
from tests.support.browser import open_page
from tests.support.random_followers import with_followers
from tests.support.random_robots import random_robot, with_random_loops
from tests.support.refusals import refused

pytestmark = [pytest.mark.quick, pytest.mark.usefixtures("unoptimised")]

MODULES = Path(__file__).parents[2] / "templates" / "live"
NODE = shutil.which("node")
needs_node = pytest.mark.skipif(NODE is None, reason="node is not installed")

SCRIPT = """
import { Mechanism } from "#live/mechanism";
import { readFileSync } from "node:fs";

const cases = JSON.parse(readFileSync(0, "utf8"));
console.log(JSON.stringify(cases.map(({ data, states, held, moves }) => {
  const mechanism = new Mechanism(data), start = mechanism.start(held ?? []);
  return {
    poses: states.map((q) => Object.fromEntries(mechanism.poses(q))),
    off: states.map((q) => mechanism.residual(q).off),
    start: { q: [...start.q], off: start.off, owner: start.owner },
    moves: (moves ?? []).map(([index, value]) => {
      const made = mechanism.move(start.q, index, value, new Set(held));
      return { ...made, q: [...made.q] };
    }),
  };
})));
"""


def run(tmp_path: Path, given: Any, script: str = SCRIPT, *words: str) -> Any:
    """What a script answers; beside the modules, whose names it imports."""
    for path in (*MODULES.glob("*.mjs"), MODULES / "package.json"):
        shutil.copy(path, tmp_path / path.name)
    (tmp_path / "test.mjs").write_text(script)
    command, given = [NODE or "node", "test.mjs", *words], json.dumps(given)
    done = subprocess.run(command, cwd=tmp_path, input=given, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def _case(robot: Robot, states: Any, **more: Any) -> dict[str, Any]:
    return {
        "data": {"base": robot.base, **mechanism_of(build_model(robot))},
        "states": np.asarray(states).tolist(),
        **more,
    }


@needs_node
def test_poses_are_those_of_python(tmp_path: Path) -> None:
    """With offsets, angles of all six coordinates, and followers."""
    rng = np.random.default_rng(4)
    robots = [eomgen.load_robot(name) for name in ("puma560_elastic", "geared_arm", "shaken_arm", "delta")]
    robots += [random_robot(seed, (3, 4), 6, tree=True) for seed in range(4)]
    robots += [with_followers(random_robot(seed, (3, 4), 3), seed) for seed in range(3)]
    robots += [bent(random_robot(seed, (3, 4), 3), seed, (2, 3), second=True).robot for seed in range(2)]
    robots += [crane("y")]  # whose trolley goes beyond the ends of the beam, too
    states = [rng.uniform(-1.0, 1.0, (3, len(build_model(robot).coordinates))) for robot in robots]
    answers = run(tmp_path, [_case(robot, q) for robot, q in zip(robots, states, strict=True)])
    assert any(robot.followers for robot in robots)
    for robot, q, answer in zip(robots, states, answers, strict=True):
        poses = link_poses(robot, build_model(robot).coordinates, q)
        for k, drawn in enumerate(answer["poses"]):
            assert drawn.keys() == {robot.base, *(link.name for link in robot.links)}
            for link, numbers in drawn.items():
                np.testing.assert_allclose(np.reshape(numbers, (4, 4)), poses[link][k], atol=1e-12)


TYPES = ((1, ("universal", "prismatic")), (2, ("revolute", "planar")))


@pytest.mark.soak
@needs_node
def test_residuals_are_the_constraint_of_the_kernel(tmp_path: Path) -> None:
    """Of cut joints of several types, with offsets, and of couplings."""
    rng = np.random.default_rng(5)
    robots = [eomgen.load_robot("four_bar").rigid(), eomgen.load_robot("geared_arm").rigid().with_constraints()]
    robots += [with_random_loops(random_robot(seed, (3, 3), 3), seed, types) for seed, types in TYPES]
    robots = [robot for robot in robots if build_model(robot).constraints]
    assert len(robots) >= 3
    states = [rng.uniform(-0.7, 0.7, (3, len(build_model(robot).coordinates))) for robot in robots]
    answers = run(tmp_path, [_case(robot, q) for robot, q in zip(robots, states, strict=True)])
    for robot, q, answer in zip(robots, states, answers, strict=True):
        kernel = eomgen.build(robot, kernels=("constraint",))
        np.testing.assert_allclose(answer["off"], kernel.functions.constraint(q), atol=1e-12)


CLOSED = ("andrews", "bennett", "delta", "four_bar", "gough", "hexapod_elastic")


@needs_node
def test_mechanisms_are_assembled_wherever_a_slider_is(tmp_path: Path) -> None:
    cases, contents = [], []
    for name in CLOSED:
        page = contents_of_view(eomgen.load_robot(name))
        moves = [[i, page["home"][i] + 0.05] for i in page["held"]]
        cases.append({"data": page, "states": [page["home"]], "held": page["held"], "moves": moves})
        contents.append(page)
    for name, page, case, answer in zip(CLOSED, contents, cases, run(tmp_path, cases), strict=True):
        assert page["held"], name
        assert answer["start"]["off"] < 1e-9, name
        np.testing.assert_allclose(answer["start"]["q"], page["home"], atol=2e-3, err_msg=name)
        for (index, value), made in zip(case["moves"], answer["moves"], strict=True):
            assert made["reached"], (name, page["coordinates"][index])
            assert made["q"][index] == value
    (far,) = run(tmp_path, [{**cases[3], "moves": [[1, 3.0 * np.pi / 2.0], [2, 3.0]]}])
    stuck = [made for made in far["moves"] if not made["reached"]]
    assert stuck, "a rocker has a range"
    assert all(made["owner"] == eomgen.load_robot("four_bar").loops[0].name for made in stuck)
    assert all(made["off"] > 1e-9 for made in stuck)


def test_the_page_asks_for_nothing_and_has_sliders_with_limits() -> None:
    page = robot_page("puma560_elastic")
    assert not re.findall(r'(?:src|href)="(?!data:)', page.html)
    assert "default-src 'none'" in page.html
    contents = contents_of_view(eomgen.load_robot("puma560_elastic"))
    assert [one["name"] for one in contents["sliders"]] == [f"joint{k}.gamma" for k in range(1, 7)]
    robot = eomgen.load_robot("puma560_elastic")
    for one in contents["sliders"]:
        low, high = robot.limits_of(one["name"]).range
        assert one["low"] == low or not np.isfinite(low)
        assert one["high"] == high or not np.isfinite(high)
    assert page.notes == ()


@needs_node
def test_scripts_are_well_formed() -> None:
    for path in MODULES.glob("*.mjs"):
        subprocess.run([NODE or "node", "--check", path], check=True)


@pytest.mark.parametrize(("start", "others"), [("view", set()), ("page", {"kernel", "rigid"})])
def test_a_page_has_all_that_its_scripts_import(start: str, others: set[str]) -> None:
    """And of names in braces those that the other module exports."""
    texts = scripts_of(start, {f"#live/{name}" for name in others})
    wanted = {name for text in texts.values() for name in re.findall(r'"#live/([^"]+)"', text)} | {start}
    assert wanted == {name.removeprefix("#live/") for name in texts} | others | {"three/OrbitControls"}
    for text in texts.values():
        for names, module in re.findall(r'import \{ (.*) \} from "(#live/\w+)"', text):
            if module in texts:
                exported = set(re.findall(r"^export (?:const|function|class) (\w+)", texts[module], re.MULTILINE))
                assert set(names.split(", ")) <= exported, module


def test_frames_without_a_position_are_named() -> None:
    robot = eomgen.load_robot("one_link")
    frames = [replace(robot.frames[0], name=f"frame{k}") for k in range(6)] if robot.frames else []
    page = robot_page(replace(robot, frames=tuple(frames)))
    assert page.notes == ("positions of 4 of 6 frames are shown, the first ones",)


PAGE = """
import { readFileSync, writeFileSync } from "node:fs";

class Element {
  constructor(tag) {
    Object.assign(this, { tag, children: [], listeners: {}, dataset: {}, attributes: {} });
    Object.assign(this, { hidden: false, textContent: "" });
  }
  append(...inner) { this.children.push(...inner); }
  replaceChildren(...inner) { this.children = inner; }
  addEventListener(name, call) { this.listeners[name] = call; }
  setAttribute(name, value) { this.attributes[name] = String(value); }
  all() { return [this, ...this.children.flatMap((one) => one instanceof Element ? one.all() : [])]; }
}
const known = new Map(), by = (id) => known.get(id) ?? known.set(id, new Element(id)).get(id);
by("data").textContent = readFileSync(0, "utf8");
const made = (tag) => new Element(tag), location = { hash: process.argv[2] ?? "", href: "file:///page.html" };
globalThis.document = { getElementById: by, createElement: made, documentElement: made("html") };
const system = { matches: false, addEventListener: (name, call) => { system.changed = call; } }, pageListeners = {};
const addEventListener = (name, call) => { pageListeners[name] = call; };
globalThis.window = { location, matchMedia: () => system, addEventListener };
globalThis.requestAnimationFrame = () => {};
writeFileSync("scene.mjs", `export class Scene {
  constructor() { this.ghost = { root: {} }; this.reality = {}; this.looks = 0; }
  theme(dark) { this.dark = dark; }
  pose(robot, poseOf) { this.poseOf = poseOf; }
  moveSprings() {}
  look() { this.looks += 1; }
  draw() {}
}`);
await import("#live/view");
const view = window.view3d;
const inputs = by("panel").all().filter((one) => one.tag === "input" && one.attributes.type === "text");
const answers = { opened: [...view.q], sliders: inputs.length, said: by("message").textContent };
answers.read = by("readout").children.length;
inputs[0].value = "1.3";
inputs[0].listeners.change();
answers.moved = [...view.q];
answers.shown = inputs.map((one) => Number(one.value));
view.settings.put("q.joint3.gamma", 3.1);
answers.stuck = [...view.q];
answers.refusal = by("message").textContent;
system.matches = true;
system.changed();
answers.dark = [view.scene.dark];
by("theme").listeners.click();
answers.dark.push(view.scene.dark);
system.changed();
answers.dark.push(view.scene.dark);
location.hash = "#q.joint1.gamma=1.25&strange=1";
pageListeners.hashchange();
answers.again = [view.q[0], by("message").textContent];
await by("share").listeners.click();
answers.address = by("message").textContent;
view.reset();
answers.reset = [...view.q];
answers.silence = by("message").hidden;
console.log(JSON.stringify(answers));
"""


@needs_node
def test_sliders_move_what_is_drawn(tmp_path: Path) -> None:
    """The page's script on a document that has no more than what it asks for."""
    contents = contents_of_view(eomgen.load_robot("four_bar"))
    answers = run(tmp_path, contents, PAGE, "#q.joint1.gamma=1.2")
    assert answers["opened"][0] == 1.2
    assert answers["sliders"] == len(contents["sliders"]) == 3
    assert answers["read"] == 2 * len(contents["frames"])
    assert answers["said"] == ""
    assert answers["moved"][0] == 1.3
    assert answers["moved"][1] != answers["opened"][1]
    np.testing.assert_allclose(answers["shown"], answers["moved"], rtol=1e-4)
    assert re.match(r"^joint4 cannot be assembled with joint3\.gamma at 3\.1 rad: .* is left$", answers["refusal"])
    assert answers["dark"] == [True, False, False], "as the system has it, until it is chosen"
    assert answers["again"] == [1.25, "The address has settings that this page does not know: strange"]
    assert answers["address"].startswith("file:///page.html#q.joint1.gamma=1.25&"), "without a clipboard it is shown"
    np.testing.assert_allclose(answers["reset"], contents["home"], atol=1e-6)
    assert answers["silence"]


def test_a_robot_shows_itself(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Opened in the browser, written to a path, or shown by a notebook; hostile names stay texts."""
    opened: list[str] = []
    monkeypatch.setattr("webbrowser.open", opened.append)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    robot = eomgen.load_robot("one_link")
    page = robot.show()
    assert isinstance(page, RobotPage)
    assert len(opened) == 1
    assert opened[0].startswith("file://")
    assert opened[0].endswith("one_link.html")
    robot.show(tmp_path / "page.html")
    assert (tmp_path / "page.html").read_text(encoding="utf-8") == page.html
    assert len(opened) == 1
    frame = page._repr_html_()
    assert frame.startswith("<iframe srcdoc=")
    assert "<!DOCTYPE" not in frame
    monkeypatch.setitem(sys.modules, "ipykernel", object())  # imported, as tools for notebooks do, but no kernel
    robot.show()
    assert len(opened) == 2
    shell = SimpleNamespace(kernel=object())
    monkeypatch.setitem(sys.modules, "IPython", SimpleNamespace(get_ipython=lambda: shell))
    robot.show()
    assert len(opened) == 2
    refused(InputError, r"^robot: got a value of type int", show_robot, 3)
    refused(InputError, r"^path: got a value of type int", robot.show, 3)


def test_the_command_shows_a_robot(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any) -> None:
    opened: list[str] = []
    monkeypatch.setattr("webbrowser.open", opened.append)
    monkeypatch.chdir(tmp_path)
    assert cli.main(["view", "one_link", "-o", "a.html", "--no-browser"]) == 0
    assert "a.html" in capsys.readouterr().out
    assert (tmp_path / "a.html").read_text(encoding="utf-8") == robot_page("one_link").html
    assert opened == []
    assert cli.main(["view", "one_link"]) == 0
    assert opened == [(tmp_path / "out" / "one_link.view.html").resolve().as_uri()]
    assert cli.main(["view", "one_lnk"]) != 0
    assert "one_link" in capsys.readouterr().err
    for option in (["--robot", "ur5"], ["--port", "9000"], ["--tolerance", "t.toml"]):
        assert cli.main(["view", "one_link", *option]) != 0
        assert f"{option[0]}: comes together with a robot" in capsys.readouterr().err


@pytest.mark.parametrize("command", ["view", "live"])
def test_a_built_in_name_is_the_robot_beside_a_folder_of_that_name(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    """As of a generated package; the folder is meant where a result is in it, and any other folder is no robot."""
    monkeypatch.chdir(tmp_path)
    for name in ("one_link", "ur5", "empty"):
        (tmp_path / name).mkdir()
    (tmp_path / "ur5" / TRAJECTORY).write_bytes(b"no archive")
    assert [is_result(name) for name in ("one_link", "ur5", "empty", "four_bar", "gone.npz", "a.toml")] == [
        *(False, True, True, False, True, False),
    ]
    assert cli.main([command, "empty"]) == 1
    assert f"empty: has no {TRAJECTORY}; allowed: " in capsys.readouterr().err
    assert cli.main([command, "ur5"]) == 1
    assert TRAJECTORY in capsys.readouterr().err
    if command == "view":
        assert cli.main(["view", "one_link", "--no-browser"]) == 0


def test_the_page_moves_in_a_browser(tmp_path: Path) -> None:
    show_robot("four_bar", tmp_path / "page.html")
    with open_page() as page:
        page.page.goto((tmp_path / "page.html").as_uri())
        page.page.wait_for_selector("html[data-ready]", timeout=60_000)
        before = page.page.evaluate("[...window.view3d.q]")
        page.page.evaluate("window.view3d.settings.put('q.joint1.gamma', 1.3)")
        after = page.page.evaluate("[...window.view3d.q]")
        assert after[0] == 1.3
        assert after[1] != before[1]
        assert page.errors == []
