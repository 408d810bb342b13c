"""First files for somebody who begins, for ``eomgen new``."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from pathlib import Path

from ..description.builtin import builtin_robots
from ..description.load import SUFFIXES, load_robot
from ..errors import InputError
from ..files import Reader, read_back, write_atomically
from ..identifiers import ROBOT_RULE, check_kind, is_robot_name, to_robot_name
from ..names import component_name, joint_of, kind_of, listed, show
from ..robot.coordinates import MOTIONS, unit_of
from ..robot.model import program_coordinates, tool_of
from ..robot.value import Robot
from ..scenario.load import load_scenario
from ..sweep.plan import load_plan
from .dh import Table, dh_file_text
from .schema_files import is_schema, schema_path
from .studies import check_tolerances, plan_file_text, tolerances_file_text

KINDS = ("robot", "scenario")
_READERS: Mapping[str, Reader] = {"robot": load_robot, "scenario": load_scenario, "plan": load_plan}
_FOLDER = Path(__file__).parents[1] / "new_files"


def new_file_text(name: str, kind: str = "robot") -> str:
    """Return a commented robot description of that name, or a scenario for it; its first line names its schema.

    Where there is a robot of that name, as for ``write_poses_file``, the scenario moves a joint of it.

    Raises:
        InputError: the name is none of a robot, or there is no such kind.
    """
    if not is_robot_name(name) and not (kind == "scenario" and _is_path(name)):
        hint = f", such as {to_robot_name(name)!r}" if name else ""
        raise InputError(f"new: got the name {show(name)}; allowed: {ROBOT_RULE}{hint}")
    if kind not in KINDS:
        raise InputError(f"new: there is no file of the kind {show(kind)}; allowed: {', '.join(KINDS)}")
    lines = (_FOLDER / f"{kind}.toml").read_text(encoding="ascii").splitlines()
    lines[0] = f"#:schema ./{schema_path(kind).name}"
    for index, line in enumerate(lines):
        if line.startswith('name = "starter"'):
            lines[index] = f'name = "{name}"'.ljust(31) + " " + line[32:]
    robot = None if kind != "scenario" else _robot_here(name) if _is_path(name) else _known_robot(name)
    return "\n".join(lines if robot is None else _scenario_lines(robot, lines)) + "\n"


def _scenario_lines(robot: Robot, lines: list[str]) -> list[str]:
    """Return the lines of a scenario with names of a robot; what moves nothing is a comment where nothing is driven."""
    first = next(i for i, line in enumerate(lines) if line.startswith("[motion]"))
    after = next(i for i, line in enumerate(lines) if line.startswith("[integrator]"))
    driven = program_coordinates(robot)[:1]
    if not driven:
        lines[first:after] = [f"# {line}" if line else line for line in lines[first:after]]
    for name in driven:
        from ..motion.ends import default_ends  # which imports NumPy

        joint = robot.joint(joint_of(name))
        key = joint.name if joint.principal == kind_of(name) else f'"{name}"'
        _, goal = default_ends(robot, driven)
        goals = f"goal = {{ {key} = {float(goal[0]):.3g} }}"
        _replace(lines, "goal = ", f"{goals:<31} # {unit_of(name)}; the others stay")
    for link in robot.links[:1]:
        _replace(lines, "# link = ", f'# link = "{link.name}"')
    return lines


def _replace(lines: list[str], start: str, line: str) -> None:
    lines[next(i for i, old in enumerate(lines) if old.startswith(start))] = line


def write_new_file(name: str, path: str | Path | None = None, kind: str = "robot") -> Path:
    """Write ``new_file_text`` to a new file, NAME.toml in the working folder if nothing else is said.

    A scenario for a robot that is there is NAME_scenario.toml.  The schema that its first line names goes beside it, so
    that editors of everybody who gets the folder find it; one of another version is replaced.

    Raises:
        InputError: the file exists or cannot be written, a file that is no such schema has its name, or as
            ``new_file_text``.
    """
    check_kind("name", name, isinstance(name, str), "a name")
    text = new_file_text(name, kind)
    of_robot = kind == "scenario" and (_is_path(name) or _known_robot(name) is not None)
    usual = f"{_base_name(name)}_scenario.toml" if of_robot else f"{name}.toml"
    return _write_beside_schema(text, Path(usual if path is None else path), kind)


def _write_beside_schema(text: str, target: Path, kind: str) -> Path:
    """Write a new file and beside it the schema that its first line names; return its path."""
    schema = target.with_name(schema_path(kind).name)
    if os.path.exists(schema) and not is_schema(schema, kind):
        raise InputError(f"new: {show(schema.name)} there is no schema of a {kind}; allowed: another folder")
    _write_new(text, target, ".toml", _READERS[kind])
    write_atomically(schema, lambda stream: stream.write(schema_path(kind).read_bytes()), read=None)
    return target


def write_dh_file(name: str, table: Table, convention: str, path: str | Path | None = None) -> Path:
    """Write ``dh_file_text`` to a new file, NAME.toml in the working folder if nothing else is said.

    Raises:
        InputError: as of ``write_new_file``, or as of ``dh_file_text``.
    """
    text = dh_file_text(name, table, convention)
    return _write_beside_schema(text, Path(f"{name}.toml" if path is None else path), "robot")


def poses_file_text(robot: Robot) -> str:
    """Return a commented .csv for measured poses of a robot: its header has the columns, the values are to come."""
    frame = tool_of(robot, None)
    columns = [*program_coordinates(robot), *(component_name(frame, motion) for motion in MOTIONS)]
    lines = (_FOLDER / "poses.csv").read_text(encoding="ascii").splitlines()
    about = [line.replace("ROBOT", robot.name).replace("FRAME", frame) for line in lines]
    example = ",".join("0.0" for _ in columns)
    return "\n".join([*about, ",".join(columns), f"# {example}"]) + "\n"


def write_poses_file(name: str, path: str | Path | None = None) -> Path:
    """Write ``poses_file_text`` to a new file, NAME_poses.csv in the working folder if nothing else is said.

    Args:
        name: of a robot: NAME.toml or NAME.urdf in the working folder, or a built-in one; or the path of a description,
            whose first part names the file: arm_poses.csv of arm.urdf.xml.
        path: of the file.

    Raises:
        InputError: there is no such robot, the file exists or cannot be written.
    """
    check_kind("name", name, isinstance(name, str), "a name")
    target = Path(f"{_base_name(name)}_poses.csv" if path is None else path)
    return _write_new(poses_file_text(_robot_here(name)), target, ".csv", None)  # a form: it has no rows yet


def write_plan_file(name: str, path: str | Path | None = None) -> Path:
    """Write ``plan_file_text`` to a new file, NAME_plan.toml, and its schema; arguments as of ``write_poses_file``."""
    check_kind("name", name, isinstance(name, str), "a name")
    target = Path(f"{_base_name(name)}_plan.toml" if path is None else path)
    return _write_beside_schema(plan_file_text(_robot_here(name)), target, "plan")


def write_tolerances_file(name: str, path: str | Path | None = None) -> Path:
    """Write ``tolerances_file_text`` to a new file, NAME_tolerances.toml; arguments as of ``write_poses_file``."""
    check_kind("name", name, isinstance(name, str), "a name")
    target = Path(f"{_base_name(name)}_tolerances.toml" if path is None else path)
    robot = _robot_here(name)
    return _write_new(tolerances_file_text(robot), target, ".toml", partial(check_tolerances, robot))


def _is_path(name: str) -> bool:
    return name.endswith(SUFFIXES)


def _base_name(name: str) -> str:
    """Return what the names of files for a robot begin with: its name, or one like that of its file."""
    return to_robot_name(Path(name).name.partition(".")[0]) if _is_path(name) else name


def _known_robot(name: str) -> Robot | None:
    """Return the robot of that name as ``_robot_here`` does; None where there is none, or its file is of none."""
    try:
        return _robot_here(name)
    except InputError:
        return None


def _robot_here(name: str) -> Robot:
    """Return the robot of that name: of a file in the working folder, or a built-in one; or that of a path."""
    if _is_path(name):
        return load_robot(Path(name))
    if not is_robot_name(name):
        raise InputError(f"new: got the name {show(name)}; allowed: {ROBOT_RULE}")
    files = [Path(f"{name}{ending}") for ending in (".toml", ".urdf") if os.path.isfile(f"{name}{ending}")]
    if not files and name not in builtin_robots():
        raise InputError(
            f"new: there is no robot {show(name)}; allowed: the name of a .toml or .urdf file here, or of a built-in"
            f" robot ({listed(builtin_robots())})"
        )
    return load_robot(files[0] if files else name)


def _write_new(text: str, target: Path, ending: str, read: Reader | None) -> Path:
    """Write a file that is not there yet, and read it back; nothing is left of one that cannot be read."""
    if target.suffix != ending:
        raise InputError(f"new: got the file {show(str(target))}; allowed: a path that ends in {ending}")
    try:
        target.open("x").close()
        with _removed_if_refused(target):
            target.write_text(text, encoding="ascii")
            if read is not None:
                read_back(target, target, read)
    except FileExistsError:
        raise InputError(f"new: {show(str(target))} is there already; allowed: a file that is not") from None
    except OSError as error:
        reason = f"{show(str(target))} cannot be written: {error.strerror}"
        raise InputError(f"new: {reason}; allowed: a file in a folder that exists") from None
    return target


@contextmanager
def _removed_if_refused(path: Path) -> Iterator[None]:
    try:
        yield
    except BaseException:
        path.unlink(missing_ok=True)
        raise
