"""A first file for somebody who begins: what ``eomgen new`` writes."""

from __future__ import annotations

from pathlib import Path

from ..errors import InputError
from ..names import ROBOT_RULE, is_robot_name, show, to_robot_name
from .schema_files import schema_path

KINDS = ("robot", "scenario")
_FOLDER = Path(__file__).parents[1] / "new_files"


def new_file_text(name: str, kind: str = "robot") -> str:
    """A commented robot description of that name, or a scenario for it; the first line says where its schema is.

    Raises:
        InputError: the name is none of a robot, or there is no such kind.
    """
    if not is_robot_name(name):
        hint = f", such as {to_robot_name(name)!r}" if name else ""
        raise InputError(f"new: got the name {show(name)}; allowed: {ROBOT_RULE}{hint}")
    if kind not in KINDS:
        raise InputError(f"new: there is no file of the kind {show(kind)}; allowed: {', '.join(KINDS)}")
    lines = (_FOLDER / f"{kind}.toml").read_text(encoding="ascii").splitlines()
    lines[0] = f"#:schema {schema_path(kind).resolve().as_uri()}"
    for index, line in enumerate(lines):
        if line.startswith('name = "starter"'):
            lines[index] = f'name = "{name}"'.ljust(31) + " " + line[32:]
    return "\n".join(lines) + "\n"


def write_new_file(name: str, path: str | Path | None = None, kind: str = "robot") -> Path:
    """Write ``new_file_text`` to a new file, NAME.toml in the working folder if nothing else is said.

    Raises:
        InputError: the file exists or cannot be written, or as ``new_file_text``.
    """
    text = new_file_text(name, kind)
    target = Path(f"{name}.toml") if path is None else Path(path)
    if target.suffix != ".toml":
        raise InputError(f"new: got the file {show(str(target))}; allowed: a path that ends in .toml")
    try:
        with target.open("x", encoding="ascii") as file:
            file.write(text)
    except FileExistsError:
        raise InputError(f"new: {show(str(target))} is there already; allowed: a file that is not") from None
    except OSError as error:
        reason = f"{show(str(target))} cannot be written: {error.strerror}"
        raise InputError(f"new: {reason}; allowed: a file in a folder that exists") from None
    return target
