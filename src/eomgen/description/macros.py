"""Macros of xacro, expanded into an URDF by the package xacro, which needs no ROS."""

from __future__ import annotations

from pathlib import Path

from ..errors import DescriptionError
from ..optional import optional_import
from .xml_text import one_line

_WHY = "xacro runs what stands in ${...} of a .xacro file as Python, which can do whatever you can"
_ASK = "--xacro, or xacro=True, for files of people whom you trust; or an URDF: xacro robot.xacro > robot.urdf"
_ALLOWED = "a file that xacro expands; $(find PACKAGE) works where ROS is sourced alone"


def expanded_urdf(path: Path, *, trusted: bool) -> str:
    """The URDF that a .xacro file stands for.

    xacro evaluates the file's ${...} as Python expressions, from whose few names all others can be reached, and opens
    the files that it includes.

    Args:
        path: of the file.
        trusted: whether somebody has asked for that.

    Raises:
        NotInstalledError: xacro is not installed.
        DescriptionError: nobody has asked for it, or xacro does not take the file; says what xacro says.
    """
    if trusted is not True:
        raise DescriptionError(f"{_WHY}; allowed: {_ASK}", source=str(path))
    with optional_import("xacro", "files that end in .xacro need", "or expand it: xacro robot.xacro > robot.urdf"):
        import xacro
    try:
        return str(xacro.process_file(str(path)).toxml())
    except Exception as error:  # whatever the file's expressions raise
        said = f"{type(error).__name__}: {one_line(error)}"
        raise DescriptionError(f"xacro says: {said}; allowed: {_ALLOWED}", source=str(path)) from None
