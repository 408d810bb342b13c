"""XML that somebody else wrote, parsed without DTD or entities; where an element stands, how to mend what is none."""

from __future__ import annotations

import re
from xml.etree.ElementTree import Element
from xml.parsers import expat

import defusedxml.ElementTree as ElementTree
from defusedxml import DefusedXmlException

from ..errors import DescriptionError
from ..forms.toml_text import line_and_column
from ..names import show

NUMBER = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?")  # float() also takes nan, inf and 1_000
_MOST_NAMESPACE = 256  # the parser copies it into the name of every element
_LONG_NAMESPACE = re.compile(
    rf"""\sxmlns(?::[^\s=]*)?\s*=\s*(?:"[^"]{{{_MOST_NAMESPACE + 1}}}|'[^']{{{_MOST_NAMESPACE + 1}}})"""
)

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
    """Advice on what to write instead of what the parser refused; ``root``: the element that holds the rest."""
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


def parse_xml(text: str, source: str, root_tag: str = "robot") -> Element:
    """The root element of an XML text; ``root_tag`` is what its tag should be, for messages.

    Raises:
        DescriptionError: it is no XML, or has a document type, an entity or a long namespace.
    """
    long = _LONG_NAMESPACE.search(text)
    if long is not None:
        message = f"a namespace (xmlns) has more than {_MOST_NAMESPACE} characters; allowed: shorter, or none"
        raise _refusal(message, source, text, long.start() + 1)
    try:
        root: Element = ElementTree.fromstring(text, forbid_dtd=True)
    except ElementTree.ParseError as error:
        said = str(error).partition(": line ")[0]
        message = f"not well-formed XML: {show(said)}; allowed: {xml_remedy(said, root_tag)}"
        refusal = DescriptionError(message, source=source)
        refusal.line, refusal.column = error.position[0], error.position[1] + 1
        raise refusal from None
    except DefusedXmlException as error:
        kind = type(error).__name__
        message = f"the XML has a document type or an entity ({kind}); allowed: plain elements"
        raise _refusal(message, source, text, max(text.find("<!DOCTYPE"), 0)) from None
    except (ValueError, LookupError, RecursionError, MemoryError) as error:  # unknown encodings, lone surrogates
        message = f"cannot be read as XML: {show(str(error))}; allowed: XML 1.0 in UTF-8"
        offset = error.start if isinstance(error, UnicodeEncodeError) else 0  # the declaration, which names an encoding
        raise _refusal(message, source, text, offset) from None
    return root


def _refusal(message: str, source: str, text: str, offset: int) -> DescriptionError:
    error = DescriptionError(message, source=source)
    error.line, error.column = line_and_column(text, offset)
    return error
