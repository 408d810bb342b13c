"""One file of HTML: what it shows, the kernel that moves it, and the scripts that do both; it asks for nothing else."""

from __future__ import annotations

import base64
import hashlib
import json
import re
from collections.abc import Collection
from importlib import resources
from pathlib import Path
from typing import Any

from ..._version import __version__
from ...codegen.c.source import environment
from ...codegen.kernels.groups import INVERSE_DYNAMICS
from ...description import RobotLike, as_robot
from ...errors import InputError
from ...files import PAGE_ENDING, check_ending, write_atomically
from ...progress import Progress, no_progress, tells_at_prompt
from ...robot.value import Robot
from ...scenario.load import load_scenario
from ...scenario.value import Scenario
from ...simulation.result import SimulationResult, simulated_robot
from ..wasm.compile import wasm_command
from ..wasm.pack import make_wasm
from .contents import KERNELS, contents_of

TEMPLATE = "live/page.html.jinja"
THREE = {"three": "three/three.module.min.js", "#live/three/OrbitControls": "three/OrbitControls.js"}
_IMPORTED = re.compile(r'^import .* from "#live/(\w+)";$', re.MULTILINE)  # of a script by another


@tells_at_prompt("making the page")
def export_live(
    subject: RobotLike | SimulationResult,
    path: Path | str,
    *,
    scenario: Scenario | Path | str | None = None,
    described: RobotLike | None = None,
    progress: Progress | None = None,
) -> Path:
    """Write a page in which the robot lives: simulated in the browser, in real time, by its kernel.

    It opens from disk and asks for nothing else.  Drives, parameters, loads and what is plotted are moved there; the
    fragment of its address keeps what was set.

    Args:
        subject: a Robot, the name of a built-in one, the path of a description, or a result of ``simulate`` or
            ``run_scenario``, whose motion the page then shows, and goes on from.
        path: of the page, .html.
        scenario: what drives and loads do at first, see ``load_scenario``; not with a result, which has one.
        described: the robot of a result that does not keep it.
        progress: called with a fraction from 0 to 1 and a line of text.

    Returns:
        The path.

    Raises:
        InputError: the scenario does not fit the robot, has a program that only Python can ask, or comes with a result;
            or the path has another ending.
        BuildError: there is no compiler for WebAssembly.
        LoopError: loops do not close at the start.
    """
    target = check_ending(path, PAGE_ENDING, label="path")
    text = live_page(subject, scenario=scenario, described=described, progress=progress).encode("utf-8", "replace")
    return write_atomically(target, lambda stream: stream.write(text), read=None)


def live_page(
    subject: RobotLike | SimulationResult,
    *,
    scenario: Scenario | Path | str | None = None,
    described: RobotLike | None = None,
    progress: Progress | None = None,
) -> str:
    """Return the text of the page; arguments and errors as of ``export_live``."""
    report = progress or no_progress
    result = subject if isinstance(subject, SimulationResult) else None
    if result is not None and scenario is not None:
        raise InputError("scenario: given together with a result, which has one; allowed: one of both")
    wasm_command()  # where there is none, that is said before anything is built
    if isinstance(subject, SimulationResult):
        robot = simulated_robot(subject, described)
    else:
        robot = as_robot(subject)
    acts = load_scenario(scenario) if isinstance(scenario, (str, Path)) else scenario
    contents = contents_of(robot, acts, result, report)
    report(0.0, "kernel as WebAssembly")
    values, modules = {**contents.values, "rigid": None}, dict[str, str]()
    values["kernel"], modules["#live/kernel"] = kernel_of(contents.robot, KERNELS)
    if contents.rigid is not None:
        values["rigid"], modules["#live/rigid"] = kernel_of(contents.rigid, INVERSE_DYNAMICS)
    return _html(values, modules)


def kernel_of(robot: Robot, kernels: tuple[str, ...]) -> tuple[str, str]:
    """Return a kernel as bytes of WebAssembly, in base64, and the text of the module that loads them."""
    module = make_wasm(robot, kernels=kernels)
    return base64.b64encode(module.binary).decode("ascii"), module.script


def _html(values: dict[str, Any], modules: dict[str, str]) -> str:
    drives, count = len(values["drives"]), len(values["coordinates"])
    words = [f"{count} coordinate{'s' * (count != 1)}", f"{drives} drive{'s' * (drives != 1)}"]
    line = f"{', '.join(words)}; simulated in this page by its equations of motion"
    return filled_page(values, modules, start="page", title=f"{values['name']}: eomgen live", line=line)


def filled_page(values: dict[str, Any], modules: dict[str, str], **about: str) -> str:
    """Return the text of a page that asks for nothing outside of it.

    Args:
        values: its data, as JSON holds them; ``name`` is that of the robot.
        modules: texts of modules of this page alone, by the names that scripts import them by: "#live/kernel".
        about: ``start``, the script that begins, ``title`` and a ``line`` below the name.
    """
    from markupsafe import Markup

    texts = scripts_of(about["start"], modules) | modules | {name: _file(place) for name, place in THREE.items()}
    imports = _json({"imports": {name: _module(text) for name, text in texts.items()}})
    style, start = _file("style.css"), f'import "#live/{about["start"]}";'
    allowed = " ".join(f"'sha256-{_digest(text)}'" for text in (imports, start))
    policy = (
        f"default-src 'none'; script-src {allowed} data: 'wasm-unsafe-eval'; style-src 'sha256-{_digest(style)}';"
        " img-src data:; base-uri 'none'; form-action 'none'"
    )
    html = environment().overlay(autoescape=True, keep_trailing_newline=False)
    return html.get_template(TEMPLATE).render(
        simulated=about["start"] == "page",
        policy=Markup(policy),  # nothing of a description is in it
        version=__version__,
        title=about["title"],
        name=values["name"],
        line=about["line"],
        style=Markup(style),
        imports=Markup(imports),
        data=Markup(_json(values)),
        licence=_file("three/LICENSE.txt"),
        start=Markup(start),
    )


def scripts_of(start: str, others: Collection[str] = ()) -> dict[str, str]:
    """Return texts of the script ``start`` and of all that it imports, by the names that they import each other by.

    Args:
        start: "page" or "view".
        others: names of modules that are no files of ours.
    """
    texts: dict[str, str] = {}
    waiting = [start]
    while waiting:
        script = waiting.pop()
        name = f"#live/{script}"
        if name not in texts and name not in others:
            texts[name] = _file(f"{script}.mjs")
            waiting += _IMPORTED.findall(texts[name])
    return texts


def _file(name: str) -> str:
    """Return the text of a file of the page."""
    return (resources.files("eomgen.templates") / "live" / name).read_text(encoding="utf-8")


def _module(text: str) -> str:
    """Return a module as an address that needs no server."""
    return "data:text/javascript;base64," + base64.b64encode(text.encode("utf-8")).decode("ascii")


def _digest(text: str) -> str:
    return base64.b64encode(hashlib.sha256(text.encode("utf-8")).digest()).decode("ascii")


def _json(values: Any) -> str:
    """Return JSON that no name or text in it ends an element with."""
    text = json.dumps(values, allow_nan=False, ensure_ascii=True, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")
