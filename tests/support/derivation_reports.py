"""Checks of a derivation's report: the page closes what it opens, LaTeX is balanced and compiles where there is one."""

from __future__ import annotations

import re
import shutil
import subprocess
from html.parser import HTMLParser
from pathlib import Path

from eomgen.codegen.derivation.afresh import Derived
from eomgen.codegen.derivation.report import render_report


class _Reader(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.open = list[str]()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag != "meta":
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def checked_page(derived: Derived) -> str:
    """The page of a derivation, which names every coordinate that has an equation."""
    text, reader = render_report(derived, ".html"), _Reader()
    reader.feed(text)
    reader.close()
    assert not reader.open
    assert text.isascii()
    assert all(f">{body.joint}<" in text or f"{body.joint}." in text for body in derived.model.bodies if body.active)
    return text


def checked_latex(derived: Derived, folder: Path) -> str:
    """The document of a derivation; pdflatex, where there is one, leaves nothing out of it."""
    text = render_report(derived, ".tex")
    assert text.isascii()
    begun, ended = (sorted(re.findall(rf"\\{word}{{(\w+\*?)}}", text)) for word in ("begin", "end"))
    assert begun == ended
    assert text.count("{") == text.count("}")
    if shutil.which("pdflatex"):
        (folder / "derivation.tex").write_text(text, encoding="ascii")
        command = ["pdflatex", "-interaction=nonstopmode", "-halt-on-error", "derivation.tex"]
        made = subprocess.run(command, cwd=folder, capture_output=True, text=True, errors="replace")
        assert made.returncode == 0, made.stdout[-3000:]
        assert "Missing character" not in made.stdout
        assert (folder / "derivation.pdf").stat().st_size > 10_000
    return text
