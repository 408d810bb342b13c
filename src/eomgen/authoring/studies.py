"""First files for studies of a robot: a plan of a sweep, and a table of tolerances, with the robot's own names."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from ..errors import DescriptionError
from ..robot.model import tool_of
from ..robot.parameter_names import expand_tunable
from ..robot.value import Robot
from .schema_files import schema_path

_LENGTH, _ANGLE = 5e-5, 1e-4  # m, rad: of a machined arm
_SIZES = {"m": f"deviation = {_LENGTH:g}", "rad": f"deviation = {_ANGLE:g}"}
_GROUPS = (  # what a table begins with, by parts of names; what else can be off stands there as comments
    (".offset.gamma", "zeros of drives that turn, and what their encoders are off by", True),
    (".offset.z", "along the axes", True),
    (".offset.", "where axes are off: lengths across them, angles between them", True),
    ("frames.", "the tool", True),
    (".length", "lengths of links, in the place of offsets across the axes", False),
    (".placement.", "where joints stand in the links before, in the place of their offsets", False),
    (".second.", "where the second links of cut joints are off", False),
    (".clearance", "clearances, bounds of what bearings let the link move", False),
    (".stiffness", "how well stiffness is known, as a share of it; needs a load", False),
    (".eccentricity.", "eccentric encoders or gears: rad per turn", False),
    (".gain", "readings that are off by a factor", False),
    ("base.", "where the robot stands", False),
    ("", "other quantities", False),
)
_PLAN = """\
#:schema ./{schema}
# A plan of a sweep of {robot}: many simulations whose numbers vary.  `eomgen check FILE` checks it,
# `eomgen sweep {robot} --scenario SCENARIO --plan FILE -o out` does it; `eomgen new NAME --scenario` writes a scenario.

samples = 200                   # simulations; each draws all numbers below
seed = 1
design = "latin_hypercube"      # or "random"
record = ["tool_deviation_max", "tool_deviation_end", "drive_max"]     # what is kept of each

# What varies: a parameter of the robot (* stands for one part of its name, each is drawn for itself), or a number
# of the scenario by its path; uniform = {{ low, high }}, normal = {{ mean, deviation, low, high }} or
# grid = {{ low, high, count }}; relative = true: as a multiple of what robot and scenario say.
"""


def plan_file_text(robot: Robot) -> str:
    """Return a commented plan of a sweep that varies what the robot has: masses, stiffness, friction, gravity."""
    lines = _PLAN.format(robot=robot.name, schema=schema_path("plan").name).splitlines()
    tried = (
        ("links.*.mass", "masses, by 5 percent", "normal = { mean = 1.0, deviation = 0.05, low = 0.8, high = 1.2 }"),
        ("joints.*.*.stiffness", "stiffness, by 10 percent", "normal = { mean = 1.0, deviation = 0.1, low = 0.5 }"),
        ("joints.*.*.damping", "damping is known least of all", "uniform = { low = 0.5, high = 2.0 }"),
        ("joints.*.*.friction.coulomb", "friction, too", "uniform = { low = 0.5, high = 1.5 }"),
        ("links.*.modes.*.stiffness", "links that bend, by 10 percent", "uniform = { low = 0.9, high = 1.1 }"),
    )
    for pattern, about, distribution in tried:
        for name in _varied(robot, pattern):
            lines += ["", f"[[vary]]  # {about}", f'parameter = "{name}"', distribution, "relative = true"]
    lines += ["", "# [[vary]]  # the tool's load, where the scenario has a payload", '# scenario = "payloads.0.mass"']
    return "\n".join([*lines, "# uniform = { low = 0.0, high = 5.0 }"]) + "\n"


def _varied(robot: Robot, pattern: str) -> list[str]:
    """Return a pattern, or the names that it stands for where some are left out.

    Nothing is a multiple of 0, and the mass of a link that bends is that of its modes.
    """
    try:
        names = expand_tunable(robot, [pattern])
    except DescriptionError:
        return []
    values = dict(robot.numbers())
    bending = [f"links.{link.name}.mass" for link in robot.links if link.modes is not None]
    kept = [name for name in names if values[name] and name not in bending]
    return [pattern] if len(kept) == len(names) else kept if bending else []


def tolerances_file_text(robot: Robot) -> str:
    """Return a commented table of tolerances: what of the robot may be off, with sizes to begin with."""
    from ..identification.tolerances.solve import tolerance_quantities  # imports NumPy and SciPy

    frame = tool_of(robot, None)
    left = _patterns(tolerance_quantities(robot, frame).items())
    name = robot.name
    lines = [
        f"# Tolerances of {name}: `eomgen tolerance {name} FILE --frame {frame} --random 200` says how accurate the",
        "# tool is, what makes it so, and by --accuracy what to tighten.",
        "#",
        "# deviation: standard deviation of a normal distribution; bound: half the width of a uniform one; in m, rad,",
        "# N/m or N m/rad, with relative = true as a share.  cost: of tightening it, beside others (1); fixed = true:",
        "# it stays.  * stands for any part of a name; names that are written out go before it.  Sizes are those of a",
        "# machined arm, to begin with: put in your own.",
    ]
    for part, about, is_active in _GROUPS:
        mine = [pattern for pattern in left if part in pattern]
        if mine:
            lines += ["", f"# {about[0].upper()}{about[1:]}."]
            lines += [f"{'' if is_active else '# '}{_entry(pattern, left[pattern])}" for pattern in mine]
        left = {pattern: unit for pattern, unit in left.items() if pattern not in mine}
    return "\n".join(lines) + "\n"


def check_tolerances(robot: Robot, path: Path) -> None:
    """Read a table of tolerances of a robot; InputError where it cannot be used."""
    from ..identification.tolerances.solve import tolerance_quantities
    from ..identification.tolerances.table import read_table

    read_table(path, tuple(tolerance_quantities(robot, tool_of(robot, None))))


def _patterns(quantities: Iterable[tuple[str, str]]) -> dict[str, str]:
    """Return units by names in which * stands for the joint or loop."""
    found: dict[str, str] = {}
    for name, unit in quantities:
        first, _, rest = name.partition(".")
        pattern = f"{first}.*.{rest.partition('.')[2]}" if first in ("joints", "loops") else name
        found.setdefault(pattern, unit)
    return found


def _entry(pattern: str, unit: str) -> str:
    size = _SIZES.get(unit, "deviation = 1e-4")
    if pattern.endswith(".stiffness"):
        size = "deviation = 0.1, relative = true"
    elif pattern.endswith(".clearance"):
        size = f"bound = {1e-5 if unit == 'm' else _ANGLE:g}"
    return (f'"{pattern}" = {{ {size} }}'.ljust(60) + f"# {unit}" * (unit not in ("", "1"))).rstrip()
