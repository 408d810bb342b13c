"""Number of elements of an MJCF text with its copies and files, before MuJoCo makes them.

Tags are found as MuJoCo's XML parser finds them, which takes some texts that are no XML.  A text that it does not take
is left to its message.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from html import unescape
from math import prod
from pathlib import Path
from typing import NoReturn

from eomgen.errors import DescriptionError
from eomgen.files import read_regular
from eomgen.limits import MOST_ENTRIES
from eomgen.names import show

_MOST_ELEMENTS = 4 * MOST_ENTRIES  # a body has a joint, some geoms and sites
_MOST_COPIES = 1_000  # MuJoCo's time grows with their square: 0.5 s
_MOST_FILES, _MOST_TEXT = 200, 1 << 22
_COPYING = ("replicate", "composite", "flexcomp")
_KNOWN = {  # attributes; MuJoCo ignores others of these elements, and refuses those of all that are not here
    "frame": {"name", "class", "childclass", "pos", "quat", "axisangle", "xyaxes", "zaxis", "euler"},
    "replicate": {"class", "childclass", "count", "sep", "offset", "euler"},
}
_TAG = re.compile(
    r"<!--.*?(?:-->|\Z)|<!\[CDATA\[.*?(?:\]\]>|\Z)|<\?.*?(?:\?>|\Z)|<![^>]*"
    r"|<(?P<end>/?)(?P<tag>[^\s/<>!?]++)(?P<attributes>(?:[^<>\"']++|\"[^\"]*+\"|'[^']*+')*+)>",
    re.DOTALL,
)
_ATTRIBUTE = re.compile(r"""(?<![^\s"'/])([^\s=<>"'/]++)\s*+=\s*+(?:"([^"]*+)"|'([^']*+)')""")
_WHOLE = re.compile(r"\s*\+?([0-9]+)")  # MuJoCo reads no further than it goes


def check_copies(text: str, source: str, folder: Path | None) -> list[str]:
    """Refuse a model with too many elements, where copies and those of the files that it names count.

    Args:
        text: the XML.
        source: its name, for messages.
        folder: where files that it names are; None: it may open none.

    Returns:
        Notes on attributes that MuJoCo ignores.

    Raises:
        DescriptionError: copies, elements or files are too many; with the file, the element and its line.
    """
    files = _Files(folder)
    files.count(text, source)
    return [
        str(place.refusal(f"MuJoCo ignores the attribute {show(key)}")) for (_, key), place in files.ignored.items()
    ]


@dataclass
class _Model:
    """Numbers of elements and of <attach>, each with its copies, and of elements in the largest model to attach."""

    elements: int = 0
    attaches: int = 0
    largest: int = 0
    included: set[Path] = field(default_factory=set)

    @property
    def total(self) -> int:
        """Upper bound of the number of elements with all models that are attached."""
        return self.elements + self.attaches * self.largest


@dataclass
class _Files:
    """Files that a model names."""

    folder: Path | None
    ignored: dict[tuple[str, str], _Place] = field(default_factory=dict)  # tag and attribute: where it is first
    texts: dict[Path, str] = field(default_factory=dict)
    counted: dict[Path, int | None] = field(default_factory=dict)  # models to attach; None: while it is counted

    def count(self, text: str, source: str) -> int:
        """Return an upper bound of the number of elements of a model."""
        model = _Model()
        self._walk(text, source, 1, model)
        return model.total

    def _walk(self, text: str, source: str, copies: int, model: _Model) -> None:
        stack, line, at = [copies], 1, 0
        for match in _TAG.finditer(text):
            tag, words = match["tag"], match["attributes"]
            line, at = line + text.count("\n", at, match.start()), match.start()
            if tag is None:
                continue
            if match["end"]:
                stack[1:] = stack[1:-1]
                continue
            copies = stack[-1]
            if tag in _KNOWN or tag in (*_COPYING, "include", "model", "attach"):
                place = _Place(source, line, tag)
                attributes = {key: unescape(one or other) for key, one, other in _ATTRIBUTE.findall(words)}
                copies *= self._element(place, attributes, copies, model)
            model.elements += copies
            if model.total > _MOST_ELEMENTS:
                message = f"the model has {model.total} elements, with all copies and files"
                _Place(source, line, tag).fail(message, f"up to {_MOST_ELEMENTS}")
            if not words.endswith("/"):
                stack.append(copies)

    def _element(self, place: _Place, attributes: dict[str, str], copies: int, model: _Model) -> int:
        """Count what an element stands for; return how often its content is copied."""
        for key in (key for key in attributes if key not in _KNOWN.get(place.tag, attributes)):
            self.ignored.setdefault((place.tag, key), place)
        if place.tag in _COPYING:
            words = map(_WHOLE.match, attributes.get("count", "1").split()[:3])
            made = prod(max(1, int(word[1].lstrip("0")[:9] or 0)) for word in words if word)
            if copies * made > _MOST_COPIES:
                place.fail(f"its content is copied {copies * made} times", f"up to {_MOST_COPIES}")
            return made
        if place.tag == "attach":
            model.attaches += copies
        elif (other := self._named(place, attributes.get("file", ""))) is not None:
            if place.tag == "model":
                model.largest = max(model.largest, self._attachable(other, place))
            elif other not in model.included:  # MuJoCo refuses one that is there twice
                model.included.add(other)
                self._walk(self.texts[other], str(other), copies, model)
        return 1

    def _attachable(self, path: Path, place: _Place) -> int:
        """Return the number of elements of a file that is a model of its own."""
        if path not in self.counted:
            self.counted[path] = None
            self.counted[path] = self.count(self.texts[path], str(path))
        number = self.counted[path]
        if number is None:
            place.fail(f"the model {show(path.name)} attaches itself", "models that do not")
        return number

    def _named(self, place: _Place, name: str) -> Path | None:
        """Return the file that an element names, by the model's folder or its own; None where MuJoCo says why not."""
        if self.folder is None or not name:
            return None
        for folder in (self.folder, Path(place.source).parent):
            try:
                path = (folder / name).resolve()
                if path not in self.texts:
                    self.texts[path] = read_regular(path, _MOST_TEXT).decode("utf-8-sig", errors="replace")
            except (FileNotFoundError, ValueError, RuntimeError):  # a NUL in its name, a circle of links
                continue
            except OSError as error:
                place.fail(f"{show(name)} cannot be read: {error.strerror or error}", "files of XML")
            size = sum(map(len, self.texts.values()))
            if len(self.texts) > _MOST_FILES or size > _MOST_TEXT:
                message = f"the model has {len(self.texts)} other files with {size} characters"
                place.fail(message, f"up to {_MOST_FILES} files, {_MOST_TEXT} characters")
            return path
        return None


@dataclass(frozen=True)
class _Place:
    """A tag in a text."""

    source: str
    line: int
    tag: str

    def fail(self, message: str, allowed: str) -> NoReturn:
        """Raise the DescriptionError of the element."""
        raise self.refusal(f"{message}; allowed: {allowed}")

    def refusal(self, message: str) -> DescriptionError:
        """Return the error of the element."""
        return refusal(message, self.source, self.line, f"<{self.tag}>")


def refusal(message: str, source: str, line: int | None, where: str = "") -> DescriptionError:
    """Return the error of a place in a text."""
    source = source if source.isascii() and source.isprintable() else ascii(source)
    error = DescriptionError(message, where=where, source=source)
    error.line = line
    return error
