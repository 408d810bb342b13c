"""SVG texts made fit to stand inside one HTML page."""

from __future__ import annotations

import re

from .style import FULL_WIDTH

POINTS = 72.0  # of an inch
_HEAD = re.compile(r"^.*?(?=<svg\b)", re.S)  # XML declaration, document type
_DROPPED = re.compile(r"<metadata>.*?(?:</metadata>|\Z)|<style\b.*?(?:</style>|\Z)|<!--.*?(?:-->|\Z)", re.S)
_NAMESPACE = re.compile(r'\sxmlns(:\w+)?="[^"]*"')  # an HTML parser knows them
_SIZE = re.compile(r'\s(?:width|height)="[^"]*"')
_WIDTH = re.compile(r'\swidth="([0-9.]+)pt"')
_STYLE = "stroke-linejoin:round;stroke-linecap:butt"  # Matplotlib's style element, which would be the page's


def inline_svg(text: str, prefix: str, label: str) -> str:
    """The element ``<svg>`` of a figure of Matplotlib, without addresses, with identifiers that no other has.

    It takes the share of the page's width that the figure takes of FULL_WIDTH: one scale for all figures of a page.

    Args:
        text: the file.
        prefix: put before all identifiers, so that several figures can stand in one page; letters and digits.
        label: what readers of the screen say; markup in it is escaped by the caller.
    """
    body = _DROPPED.sub("", _HEAD.sub("", text, count=1))
    root, _, rest = body.partition(">")
    width = _WIDTH.search(root)
    share = 100.0 * float(width[1]) / POINTS / FULL_WIDTH if width else 100.0
    root = _SIZE.sub("", _NAMESPACE.sub("", root))
    root += f' style="{_STYLE};width:{min(share, 100.0):.4g}%" role="img" aria-label="{label}">'
    rest = re.sub(r'(\sid=")', rf"\g<1>{prefix}-", rest)
    rest = re.sub(r'(href="#)', rf"\g<1>{prefix}-", rest)
    return root + re.sub(r"(url\(#)", rf"\g<1>{prefix}-", rest)
