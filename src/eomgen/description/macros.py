"""Macros of xacro, expanded into a URDF by the package xacro, which needs no ROS."""

from __future__ import annotations

import importlib
import os
import sys
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType

from ..errors import DescriptionError
from ..identifiers import show_path
from ..names import listed, nearest, show
from ..optional import optional_import

Xacro = bool | Mapping[str, str | Path]  # whether to expand, or the folders of packages with which to
_WHY = "xacro runs what stands in ${...} of a .xacro file as Python, which can do whatever you can"
_ASK = "--xacro, or xacro=True, for files of people whom you trust; or a URDF: xacro robot.xacro > robot.urdf"
_PACKAGES = "$(find NAME) needs --package NAME=DIR, xacro={NAME: DIR}, or ROS that is sourced"
_ARGUMENTS = "NAME:=VALUE, or xacro_args={NAME: VALUE}"
_INDEX = "ament_index_python"
_FOLDERS = threading.Lock()  # xacro looks for packages in one place for all threads


class _Arguments(dict[str, str]):
    """Arguments of a file, to which xacro adds its defaults; ``asked`` has the names that the file asks for."""

    def __init__(self, given: Mapping[str, str]) -> None:
        super().__init__(given)
        self.asked: dict[str, None] = {}

    def __contains__(self, name: object) -> bool:
        self.asked[str(name)] = None
        return super().__contains__(name)

    def __getitem__(self, name: str) -> str:
        self.asked[name] = None
        return super().__getitem__(name)


def expanded_urdf(path: Path, *, trusted: Xacro, arguments: Mapping[str, object] | None = None) -> str:
    """Return the URDF that a .xacro file stands for.

    xacro evaluates the file's ${...} as Python expressions, from whose few names all others can be reached, and opens
    the files that it includes.

    Args:
        path: of the file.
        trusted: whether somebody has asked for that; or the folders of packages by their names, for $(find NAME).
        arguments: values of the file's arguments by their names, for $(arg NAME).

    Raises:
        NotInstalledError: xacro is not installed.
        DescriptionError: nobody has asked for it, a package's folder does not exist, the file has no such argument, or
            xacro does not take the file; says what xacro says.
    """
    packages = dict(trusted) if isinstance(trusted, Mapping) else {}
    if trusted is not True and not isinstance(trusted, Mapping):
        raise DescriptionError(f"{_WHY}; allowed: {_ASK}", source=str(path))
    for name, folder in packages.items():
        if not isinstance(folder, (str, Path)) or not os.path.isdir(folder):
            what = f"package {show(name)}: there is no folder {show_path(str(folder))}"
            raise DescriptionError(f"{what}; allowed: the folder of the package", source=str(path))
    given = _Arguments({name: _value_of(path, name, value) for name, value in (arguments or {}).items()})
    with optional_import("xacro", "files that end in .xacro need", "or expand it: xacro robot.xacro > robot.urdf"):
        import xacro
    from xml.dom import DOMException
    from xml.parsers.expat import ExpatError

    # what xacro raises itself, and what it lets through of XML, of files, of Python in ${...} and of macros without end
    of_files = (xacro.XacroException, DOMException, ExpatError, OSError, RecursionError)
    of_python = (ArithmeticError, AttributeError, LookupError, NameError, SyntaxError, TypeError, ValueError)
    try:
        with _packages_found(packages):
            text = str(xacro.process_file(str(path), mappings=given).toxml())
    except (*of_files, *of_python) as error:
        from .xml_text import one_line  # with expat, which descriptions in TOML do without

        said = f"{type(error).__name__}: {one_line(error)}"
        known = f"; arguments of this file: {listed(given.asked)}" if given.asked else ""
        allowed = f"a file that xacro expands; its arguments are given as {_ARGUMENTS}; {_PACKAGES}"
        raise DescriptionError(f"xacro says: {said}{known}; allowed: {allowed}", source=str(path)) from None
    unknown = [name for name in given if name not in dict(given.asked)]
    if unknown:
        message = f"there is no argument {show(unknown[0])}{nearest(unknown[0], given.asked)}"
        allowed = listed(given.asked) or "no arguments"
        raise DescriptionError(f"{message}; allowed: {allowed}", where="xacro_args", source=str(path))
    return text


def _value_of(path: Path, name: object, value: object) -> str:
    """Return the value of an argument as a launch file writes it."""
    if not isinstance(name, str) or not name or not isinstance(value, (str, bool, int, float)):
        message = f"{show(name)} is {show(value)}; allowed: texts, numbers, true and false by names of arguments"
        raise DescriptionError(message, where="xacro_args", source=str(path))
    return str(value).lower() if isinstance(value, bool) else str(value)


@contextmanager
def _packages_found(packages: Mapping[str, str | Path]) -> Iterator[None]:
    """Let xacro find packages in these folders, and others where it does without them: where ROS is sourced.

    xacro asks ROS's index, the module ``ament_index_python.packages``, in whose place another stands meanwhile.
    """
    with _FOLDERS:  # also while ROS's index is looked up, or it would be the one that stands in its place
        index = _index_of(packages)
        before = {name: sys.modules.get(name) for name in index}
        sys.modules |= index
        try:
            yield
        finally:
            for name, module in before.items():
                if module is None:
                    del sys.modules[name]
                else:
                    sys.modules[name] = module


def _index_of(packages: Mapping[str, str | Path]) -> dict[str, ModuleType]:
    """Return modules in the place of ROS's index, which knows these folders, too."""
    try:
        elsewhere = importlib.import_module(f"{_INDEX}.packages").get_package_share_directory
    except ImportError:  # no ROS
        elsewhere = None

    def find(name: str) -> str:
        if name in packages:
            return str(Path(packages[name]).resolve())
        if elsewhere is None:
            raise LookupError(f"there is no package {show(name)}{nearest(name, packages)}")
        return str(elsewhere(name))

    index, inner = ModuleType(_INDEX), ModuleType(f"{_INDEX}.packages")
    inner.__dict__["get_package_share_directory"] = find
    index.__dict__["packages"] = inner
    return {_INDEX: index, f"{_INDEX}.packages": inner}
