"""Formulas as MathML, which browsers draw by themselves: no script, no font, nothing to fetch."""

from __future__ import annotations

import html
import re

from latex2mathml.converter import convert

_FORMULA = re.compile(r'<(span|div) class="arithmatex">\s*\\([(\[])(.*?)\\[)\]]\s*</\1>', re.DOTALL)


def with_mathml(page: str) -> str:
    """The page with what pymdownx.arithmatex has marked turned into <math>.

    Raises:
        ValueError: a formula has a command that is not known.
    """
    return _FORMULA.sub(_mathml, page)


def _mathml(match: re.Match[str]) -> str:
    latex = html.unescape(match[3]).strip()
    display = "block" if match[2] == "[" else "inline"
    found = convert(latex, display=display)
    left = re.search(r"\\[A-Za-z]+", re.sub(r"<annotation.*?</annotation>", "", found))
    if left:
        raise ValueError(f"the formula {latex!r} has {left[0]}, which cannot be drawn")
    return f'<div class="formula">{found}</div>' if display == "block" else str(found)
