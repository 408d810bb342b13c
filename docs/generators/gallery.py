"""Gallery of the built-in robots: pictures, what each is, what its equations cost."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from importlib import resources
from pathlib import Path

import eomgen
from eomgen.codegen.c.operation_counts import operations
from eomgen.codegen.kernels.equations import derive_equations
from eomgen.pictures import plot_robot, plot_zeros
from eomgen.robot import Model, build_model

from . import live

KERNELS = ("inverse_dynamics", "mass_matrix", "forward_dynamics")
POSES: dict[str, Mapping[str, float]] = {  # that show more than zero does
    "puma560": {"joint2.gamma": -0.8, "joint3.gamma": 0.4},
    "puma560_elastic": {"joint2.gamma": -0.8, "joint3.gamma": 0.4},
    "ur5": {"joint2.gamma": -1.0, "joint3.gamma": 1.4},
    "shaken_arm": {"shoulder.gamma": 0.8, "elbow.gamma": -1.2},
}


def count(model: Model) -> dict[str, str]:
    """Multiplications/additions of a few kernels, with divisions."""
    found = operations(derive_equations(model, KERNELS))
    return {
        name: f"{c['mul']}/{c['add']}" + (f" + {c['div']} div" if c["div"] else "")
        for name, c in found.items()
        if name in KERNELS
    }


def about(name: str) -> str:
    """The comment that its description begins with, as Markdown."""
    text = (resources.files(eomgen) / "robots" / f"{name}.toml").read_text(encoding="utf-8")
    lines: list[str] = []
    for line in text.split("\nname = ")[0].splitlines():
        content = line.removeprefix("#").removeprefix(" ").replace("<", "&lt;").replace("[", r"\[").replace("*", r"\*")
        if content.startswith(" - ") and lines and not lines[-1].startswith((" - ", "   ")):
            lines.append("")  # Markdown wants an empty line in front of a list
        lines.append(content if content.startswith((" - ", "   ")) else content.strip())
    return "\n".join(lines)


def figures(robots: Sequence[str]) -> dict[str, bytes]:
    """Pictures by the name of their files: every one of these built-in robots, and the zeros of its M and C."""
    found = {}
    with tempfile.TemporaryDirectory() as folder:
        for name in robots:
            robot = eomgen.load_robot(name)
            for path in (
                plot_robot(robot, Path(folder) / f"{name}.png", closed_pose(robot)),
                plot_zeros(build_model(robot), Path(folder) / f"{name}_zeros.svg"),
            ):
                found[path.name] = path.read_bytes()
    return found


def closed_pose(robot: eomgen.Robot) -> Mapping[str, float]:
    """The robot's pose of POSES, or its home, where its loops are closed."""
    return POSES.get(robot.name, {}) if not robot.is_closed else dict(robot.home)


def page(robots: Sequence[str]) -> str:
    """These built-in robots."""
    lines = [
        "# Gallery",
        "",
        'The built-in robots. Each is loaded by its name, `eomgen.load_robot("ur5")` or `eomgen simulate ur5`; '
        "`eomgen info NAME` says what it is made of. Operations are multiplications/additions of the generated C, "
        "counted when this page was made. Pictures are by `eomgen.pictures.plot_robot`, zeros by "
        "`eomgen.pictures.plot_zeros`.",
        "",
    ]
    for name in robots:
        robot = eomgen.load_robot(name)
        model = build_model(robot)
        counted = {
            "coordinate": model.size,
            "moving link": len(model.links),
            "cut joint": len(robot.loops),
            "spring between points|springs between points": len(robot.springs),
            "motor behind an elastic gear|motors behind elastic gears": len(model.motors),
            "prescribed coordinate": len(model.prescribed),
        }
        parts = [_counted(number, words) for words, number in counted.items() if number]
        lines += [f"## {name}", "", about(name), "", ", ".join(parts) + ".", ""]
        lines += [f"![{name}](figures/{name}.png){{ width=340 }}", ""]
        if name in live.ROBOTS:
            lines += ['??? example "Live, in this page"', "", f"    {live.frame(name)}", ""]
        counts = count(model)
        lines += ["| " + " | ".join(kernel.replace("_", " ") for kernel in counts) + " |", "|---" * len(counts) + "|"]
        lines += ["| " + " | ".join(counts.values()) + " |", ""]
        lines += ['??? note "What vanishes in M and C"', "", f"    ![zeros of {name}](figures/{name}_zeros.svg)", ""]
    return "\n".join(lines)


def _counted(number: int, words: str) -> str:
    """ "1 coordinate", "2 coordinates"; the words' plural stands behind a bar where it is not one with s."""
    one, _, more = words.partition("|")
    return f"{number} {one if number == 1 else more or one + 's'}"
