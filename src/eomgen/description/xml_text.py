"""XML that somebody else wrote, parsed without DTD, entities or namespaces; where its elements stand.

Names are read as they are written, prefix and all, as other readers of URDF and MJCF do.  What is not quite XML, but
plain, is read with a note.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from typing import NoReturn
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

from ..errors import DescriptionError
from ..forms.toml_text import line_and_column
from ..names import listed, show
from .draft import Place, spot

NUMBER = re.compile(r"[+-]?([0-9]+(\.[0-9]*)?|\.[0-9]+)([eE][+-]?[0-9]+)?")  # float() also takes nan, inf and 1_000

_LONGEST = 400  # of what other programs say

_VISIBLE = re.compile(r"[^\r\n]")
_NO_ELEMENT = re.compile(r"[ \t\r\n]+|<!--.*?-->|<\?.*?\?>", re.DOTALL)  # blanks, a comment, or an instruction
_PREFIXED = re.compile(r"""[\s</][^\s<>/=:"']+:[^\s<>/=:"']""")  # perhaps a name with a prefix
_XMLNS = "xmlns:"
_NEED_NONE = frozenset(("xml", "xmlns"))  # prefixes that need no declaration

_REMEDIES = {  # what the parser says, and what to write instead
    "mismatched tag": "the element that was opened last is closed first: <link> ... </link>",
    "no element found": "<robot name='...'> ... </robot>; the file is empty or ends too early",
    "unclosed token": "a file that does not end inside of a tag",
    "unclosed CDATA": "a file that does not end inside of CDATA",
    "duplicate attribute": "each attribute once in an element",
    "undefined entity": "&lt; &gt; &amp; &quot; &apos; and no others",
    "junk after": "one element <robot>, and nothing behind it",
    "not well-formed": "XML: values in quotes, &lt; for <, &amp; for &, no control characters",
    "XML or text declaration": "<?xml ...?> at the very beginning, or not at all",
    "syntax error": "<?xml version='1.0'?> or <robot name='...'> at the very beginning",
    "reference to invalid character": "characters that XML has",
}


def xml_remedy(said: str, root: str = "robot") -> str:
    """Return advice on what to write instead of a refused text; ``root``: the element that holds the rest."""
    remedy = next((what for begin, what in _REMEDIES.items() if said.startswith(begin)), "XML 1.0")
    if root == "robot":
        return remedy
    return remedy.replace("<robot name='...'>", f"<{root}>").replace("robot>", f"{root}>").replace("link>", "body>")


@dataclass(frozen=True)
class Xml:
    """An XML text that has been read.

    Attributes:
        source: the file's name, for messages.
        text: the parsed text; corrections have kept its lines and columns.
        notes: deviations from XML that were read all the same, each with its place.
    """

    source: str
    text: str
    root: Element
    notes: tuple[str, ...] = ()

    def place(self, element: Element | None) -> Place | None:
        """Return line and column at which an element begins."""
        return self.places_of([element])[0]

    def places_of(self, elements: Sequence[Element | None]) -> list[Place | None]:
        """Return line and column at which each element begins; reads the text once more for all of them."""
        wanted = {element for element in elements if element is not None}
        indices = {element: index for index, element in enumerate(self.root.iter()) if element in wanted}
        places = _starts(self.text, set(indices.values()))  # both are in the order of the start tags
        return [None if element is None else places.get(indices.get(element, -1)) for element in elements]


def parse_xml(text: str, source: str, root_tag: str = "robot") -> Xml:
    """Parse an XML text; ``root_tag`` is what the root's tag should be, for messages.

    Raises:
        DescriptionError: it is no XML, or has a document type or an entity.
    """
    text, notes = _without_late_declarations(text, source)
    builder, parser = TreeBuilder(), expat.ParserCreate()

    def refuse_document_type(*_: object) -> NoReturn:
        raise _refusal("the XML has a document type or an entity; allowed: plain elements", source, parser)

    parser.StartElementHandler, parser.EndElementHandler = builder.start, builder.end
    parser.StartDoctypeDeclHandler = refuse_document_type
    try:
        parser.Parse(text, True)
        root = builder.close()
    except expat.ExpatError as error:
        said = expat.ErrorString(error.code)
        message = f"not well-formed XML: {show(said)}; allowed: {xml_remedy(said, root_tag)}"
        raise _refusal(message, source, parser) from None
    except DescriptionError:
        raise
    except (ValueError, LookupError, RecursionError, MemoryError) as error:  # unknown encodings, lone surrogates
        message = f"cannot be read as XML: {show(str(error))}; allowed: XML 1.0 in UTF-8"
        refusal = _refusal(message, source, parser)
        if isinstance(error, UnicodeEncodeError):  # the parser has not begun
            refusal.line, refusal.column = line_and_column(text, error.start)
        raise refusal from None
    made = Xml(source, text, root)
    return Xml(source, text, root, (*notes, *_undeclared_prefixes(made)))


def one_line(error: object) -> str:
    """Return a message of another program as printable ASCII in a line."""
    return ascii(" ".join(str(error).split()))[1:-1][:_LONGEST]


def _refusal(message: str, source: str, parser: expat.XMLParserType) -> DescriptionError:
    error = DescriptionError(message, source=source)
    error.line, error.column = parser.CurrentLineNumber, parser.CurrentColumnNumber + 1
    return error


def _starts(text: str, wanted: Collection[int]) -> dict[int, Place]:
    """Return line and column of the start tags of these indices; the text has been parsed before."""
    parser, index, places, rest = expat.ParserCreate(), -1, dict[int, Place](), len(wanted)

    def count(*_: object) -> None:
        nonlocal index
        index += 1
        if index in wanted:
            places[index] = parser.CurrentLineNumber, parser.CurrentColumnNumber + 1
            if len(places) == rest:
                raise _Enough

    parser.StartElementHandler = count
    try:
        if wanted:
            parser.Parse(text, True)
    except _Enough:
        pass
    return places


class _Enough(Exception):
    """End of a search: all wanted start tags are located."""


def _without_late_declarations(text: str, source: str) -> tuple[str, list[str]]:
    """Replace every <?xml ...?> behind blanks or comments by spaces; return the text and notes on it."""
    places = _late_declarations(text)
    if not places:
        return text, []
    pieces, at = [], 0
    for begin, end in places:
        pieces += [text[at:begin], _VISIBLE.sub(" ", text[begin:end])]
        at = end
    where = spot(source, line_and_column(text, places[0][0]))
    note = "the declaration <?xml ...?> is not at the very beginning; the file is read without it"
    return "".join([*pieces, text[at:]]), [f"{where}: {note}"]


def _late_declarations(text: str) -> list[tuple[int, int]]:
    """Return begin and end of each <?xml ...?> before the first element, but for one at the very beginning."""
    declarations: list[tuple[int, int]] = []
    at = 0
    while match := _NO_ELEMENT.match(text, at):
        begin, at = match.span()
        if begin > 0 and text.startswith("<?xml", begin) and text[begin + 5].isspace():
            declarations.append((begin, at))
    return declarations


def _undeclared_prefixes(xml: Xml) -> list[str]:
    """Return a note on prefixes that no xmlns:PREFIX declares, at the place of the first."""
    if _PREFIXED.search(xml.text) is None:
        return []
    prefixes: dict[str, Element] = {}
    plain = _XMLNS not in xml.text  # the usual case, which takes a third of the time
    for element, known in ((each, _NEED_NONE) for each in xml.root.iter()) if plain else _with_declared(xml.root):
        for name in (element.tag, *element.attrib) if element.attrib else (element.tag,):
            if ":" in name and (prefix := name.partition(":")[0]) not in known:
                prefixes.setdefault(prefix, element)
    if not prefixes:
        return []
    where = spot(xml.source, xml.place(next(iter(prefixes.values()))))
    return [f"{where}: prefixes without a declaration xmlns:PREFIX='...' are read with the names: {listed(prefixes)}"]


def _with_declared(root: Element) -> Iterator[tuple[Element, frozenset[str]]]:
    """Yield each element, in the order of the start tags, with the prefixes that are declared there."""
    stack = [(root, _NEED_NONE)]
    while stack:
        element, known = stack.pop()
        if element.attrib:
            declared = [name.removeprefix(_XMLNS) for name in element.attrib if name.startswith(_XMLNS)]
            known = known.union(declared) if declared else known
        yield element, known
        stack += [(child, known) for child in reversed(element)]
