"""Where an element stands in the text of an XML file, and what to do about XML that is none: for messages alone."""

from __future__ import annotations

from typing import TYPE_CHECKING
from xml.parsers import expat

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

_REMEDIES = {  # what the parser says, and what to write instead
    "mismatched tag": "the element that was opened last is closed first: <link> ... </link>",
    "no element found": "<robot name='...'> ... </robot>; the file is empty or ends too early",
    "unclosed token": "a file that does not end inside of a tag",
    "unclosed CDATA": "a file that does not end inside of CDATA",
    "duplicate attribute": "each attribute once in an element",
    "undefined entity": "&lt; &gt; &amp; &quot; &apos; and no others",
    "junk after": "one element <robot>, and nothing behind it",
    "not well-formed": "XML: values in quotes, &lt; for <, &amp; for &, no control characters",
    "unbound prefix": "names without a prefix, or xmlns:PREFIX='...' in <robot>",
    "XML or text declaration": "<?xml ...?> at the very beginning, or not at all",
    "syntax error": "<?xml version='1.0'?> or <robot name='...'> at the very beginning",
    "reference to invalid character": "characters that XML has",
}


def xml_remedy(said: str, root: str = "robot") -> str:
    """What to write instead of what the parser refused with these words; ``root``: the element that holds the rest."""
    found = next((what for begin, what in _REMEDIES.items() if said.startswith(begin)), "XML 1.0")
    if root == "robot":
        return found
    return found.replace("<robot name='...'>", f"<{root}>").replace("robot>", f"{root}>").replace("link>", "body>")


def place_of(text: str, root: Element, element: Element | None) -> tuple[int, int] | None:
    """Line and column, from 1, at which an element of the tree under root begins, which was read from the text."""
    for index, other in enumerate(root.iter()):  # in the order of the start tags
        if other is element:
            return _start(text, index)
    return None


class _Found(Exception):
    """The parser has come to the element: line and column, which afterwards are those of the tag's end."""


def _start(text: str, index: int) -> tuple[int, int] | None:
    """Line and column of the start tag of that index; the text has been parsed before, without a document type."""
    parser, left = expat.ParserCreate(), index

    def count(*_: object) -> None:
        nonlocal left
        left -= 1
        if left < 0:
            raise _Found(parser.CurrentLineNumber, parser.CurrentColumnNumber + 1)

    parser.StartElementHandler = count
    try:
        parser.Parse(text, True)
    except _Found as found:
        line, column = found.args
        return line, column
    return None
