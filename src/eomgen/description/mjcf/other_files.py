"""Checks of the files that an MJCF model names before MuJoCo compiles it: circles, copies of copies, NaN.

MuJoCo itself ends the process on a model that attaches itself, makes copies until memory ends, and takes "nan" for
a missing number.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import NoReturn
from xml.etree.ElementTree import Element

from eomgen.errors import DescriptionError
from eomgen.forms.toml_text import read_text
from eomgen.limits import MOST_ENTRIES
from eomgen.names import show, show_path

from ..xml_text import Xml, parse_xml
from .values import ORIENTATIONS

_COPIES = ("replicate", "composite", "flexcomp")
_MOST_ELEMENTS = 20 * MOST_ENTRIES  # with all copies: a body has a joint, some geoms, sites and frames
_MOST_FILES = 200  # each is parsed, and may be as large as a model
_MOST_DEEP = 50  # files in files: what is deeper has been made to be deep
_NAN = re.compile(r"[+-]?nan(\(\w*\))?", re.ASCII | re.IGNORECASE)  # as C reads it
_WHOLE = re.compile(r"\+?([0-9]+)")  # MuJoCo reads no further than it goes
_NUMBERS = frozenset(  # attributes that hold numbers, of elements that count for the motion
    (
        *("pos", *ORIENTATIONS, "mass", "density", "size", "fromto", "diaginertia", "fullinertia", "axis", "ref"),
        *("springref", "stiffness", "damping", "armature", "frictionloss", "range", "springdamper", "springlength"),
        *("springyield", "gravity", "viscosity", "wind", "polycoef", "anchor", "relpose", "coef", "divisor", "offset"),
        *("gravcomp", "scale", "refpos", "refquat", "boundmass", "boundinertia", "settotalmass", "inertiagrouprange"),
        *("count", "spacing", "radius", "curve", "shellinertia", "qpos"),
    )
)


def nan_in(root: Element) -> tuple[Element, str] | None:
    """Find the first element with an attribute of numbers that holds NaN.

    Returns:
        The element and the attribute's name; None where there is none.
    """
    for element in root.iter():
        for key, text in element.attrib.items():
            if key in _NUMBERS and "n" in text.lower() and any(map(_NAN.fullmatch, text.split())):
                return element, key
    return None


def nan_message(element: Element, key: str) -> str:
    """Say that an attribute holds NaN, which MuJoCo would take for a missing number."""
    return f"{key} is {show(element.attrib[key])}; allowed: finite numbers, or no {key}"


def check_other_files(path: Path, xml: Xml) -> None:
    """Refuse a model whose files MuJoCo could not compile, before it tries.

    Args:
        path: the model's file.
        xml: its elements.

    Raises:
        DescriptionError: a file is included or attached by itself, through others too; copies, with those of included
            and attached files, are more than a description may hold; a number is NaN.
    """
    _Files(path.resolve().parent).count(path.resolve(), xml)


@dataclass
class _Files:
    """Files that a model names: which are being read, and how many elements those for attachment stand for."""

    folder: Path
    open: list[Path] = field(default_factory=list)
    counted: dict[Path, int] = field(default_factory=dict)
    parsed: dict[Path, Xml | None] = field(default_factory=dict)

    def count(self, path: Path, xml: Xml) -> int:
        """Count the elements of a model with all copies, and with those of the files that it names."""
        if path not in self.counted:
            self.open.append(path)
            files: dict[Path, Xml] = {}
            self._include(path, xml, files)
            models: dict[str, int] = {}
            for file, inner in files.items():
                self._models(file, inner, models)
            self.counted[path] = self._with_copies(path, files, models)
            self.open.pop()
        return self.counted[path]

    def _include(self, path: Path, xml: Xml, files: dict[Path, Xml]) -> None:
        """Add a file, and those that it includes, to the files of a model."""
        if (nan := nan_in(xml.root)) is not None:
            _fail(xml, nan[0], nan_message(*nan))
        files[path] = xml
        for element in xml.root.iter("include"):
            other, inner = self._named(path, xml, element)
            if other is not None and inner is not None and other not in files:  # MuJoCo takes each once
                self.open.append(other)
                self._include(other, inner, files)
                self.open.pop()

    def _models(self, path: Path, xml: Xml, models: dict[str, int]) -> None:
        """Add the number of elements of each model that a file declares for attachment, by its name."""
        for element in xml.root.iterfind("asset/model"):
            other, inner = self._named(path, xml, element)
            if other is not None and inner is not None:
                for name in (element.get("name"), inner.root.get("model")):
                    models[name or ""] = max(models.get(name or "", 0), self.count(other, inner))

    def _with_copies(self, path: Path, files: dict[Path, Xml], models: dict[str, int]) -> int:
        total, seen, stack = 0, {path}, [(path, files[path].root, 1)]
        while stack:
            at, element, copies = stack.pop()
            if element.tag in _COPIES and (copies := copies * _copies(element)) > MOST_ENTRIES:
                message = f"its bodies are copied {copies} times; allowed: up to {MOST_ENTRIES}"
                _fail(files[at], element, message)
            total += copies * (1 + (models.get(element.get("model", ""), 0) if element.tag == "attach" else 0))
            if total > _MOST_ELEMENTS:
                message = f"with all copies and all files the model has more than {_MOST_ELEMENTS} elements"
                _fail(files[at], element, f"{message}; allowed: up to {_MOST_ELEMENTS}")
            stack += [(at, child, copies) for child in element]
            other = self._other(at, element) if element.tag == "include" else None
            if other is not None and other in files and other not in seen:
                seen.add(other)
                stack += [(other, child, copies) for child in files[other].root]
        return total

    def _named(self, path: Path, xml: Xml, element: Element) -> tuple[Path | None, Xml | None]:
        """Return the file that an element names, and its XML; None where MuJoCo will say why not."""
        other = self._other(path, element)
        if other is None:
            return None, None
        if other in self.open:
            circle = [*self.open[self.open.index(other) :], other]
            names = " -> ".join(show_path(each.name) for each in circle[-6:])
            _fail(xml, element, f"the file names itself: {names}; allowed: files that do not lead back to themselves")
        if len(self.open) >= _MOST_DEEP or len(self.parsed) >= _MOST_FILES:
            message = f"the model is in more than {_MOST_FILES} files, or in files in files more than {_MOST_DEEP} deep"
            _fail(xml, element, f"{message}; allowed: fewer")
        return other, self._xml(other)

    def _other(self, path: Path, element: Element) -> Path | None:
        """Return the file that an element names: beside the element's file, or beside the model's."""
        name = element.get("file", "")
        for folder in (path.parent, self.folder):
            try:
                other = (folder / name).resolve()
                if name and other.is_file():
                    return other
            except (OSError, ValueError, RuntimeError):  # a NUL, too long a name, a circle of links
                return None
        return None

    def _xml(self, path: Path) -> Xml | None:
        """Parse a file; None where it cannot be read, which MuJoCo will say."""
        if path not in self.parsed:
            try:
                self.parsed[path] = parse_xml(read_text(path, str(path)), str(path), "mujoco")
            except DescriptionError:
                self.parsed[path] = None
        return self.parsed[path]


def _copies(element: Element) -> int:
    """Return how many copies an element makes of its contents, or of its points."""
    words = [match[1] for word in element.get("count", "1").split() if (match := _WHOLE.match(word))]
    return math.prod(max(1, int(word)) if len(word) < 10 else MOST_ENTRIES + 1 for word in words[:3])


def _fail(xml: Xml, element: Element, message: str) -> NoReturn:
    source = xml.source if xml.source.isascii() and xml.source.isprintable() else ascii(xml.source)
    error = DescriptionError(message, where=f"<{show(element.tag)[1:-1]}>", source=source)
    error.line, error.column = xml.place(element) or (None, None)
    raise error
