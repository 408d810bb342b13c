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
from ..names import nearest, show, show_path
from ..optional import optional_import

Xacro = bool | Mapping[str, str | Path]  # whether to expand, or the folders of packages with which to
_WHY = "xacro runs what stands in ${...} of a .xacro file as Python, which can do whatever you can"
_ASK = "--xacro, or xacro=True, for files of people whom you trust; or a URDF: xacro robot.xacro > robot.urdf"
_ALLOWED = "a file that xacro expands; $(find NAME) needs --package NAME=DIR, xacro={NAME: DIR}, or ROS that is sourced"
_INDEX = "ament_index_python"
_FOLDERS = threading.Lock()  # xacro looks for packages in one place for all threads


def expanded_urdf(path: Path, *, trusted: Xacro) -> str:
    """Return the URDF that a .xacro file stands for.

    xacro evaluates the file's ${...} as Python expressions, from whose few names all others can be reached, and opens
    the files that it includes.

    Args:
        path: of the file.
        trusted: whether somebody has asked for that; or the folders of packages by their names, for $(find NAME).

    Raises:
        NotInstalledError: xacro is not installed.
        DescriptionError: nobody has asked for it, a package's folder does not exist, or xacro does not take the file;
            says what xacro says.
    """
    packages = dict(trusted) if isinstance(trusted, Mapping) else {}
    if trusted is not True and not isinstance(trusted, Mapping):
        raise DescriptionError(f"{_WHY}; allowed: {_ASK}", source=str(path))
    for name, folder in packages.items():
        if not isinstance(folder, (str, Path)) or not os.path.isdir(folder):
            what = f"package {show(name)}: there is no folder {show_path(str(folder))}"
            raise DescriptionError(f"{what}; allowed: the folder of the package", source=str(path))
    with optional_import("xacro", "files that end in .xacro need", "or expand it: xacro robot.xacro > robot.urdf"):
        import xacro
    try:
        with _packages_found(packages):
            return str(xacro.process_file(str(path)).toxml())
    except Exception as error:  # whatever the file's expressions raise
        from .xml_text import one_line  # with expat, which descriptions in TOML do without

        said = f"{type(error).__name__}: {one_line(error)}"
        raise DescriptionError(f"xacro says: {said}; allowed: {_ALLOWED}", source=str(path)) from None


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
