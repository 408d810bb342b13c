"""What MkDocs calls while it builds the site: generated pages and figures go in, formulas and links are checked."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from mkdocs.exceptions import PluginError
from mkdocs.plugins import get_plugin_logger
from mkdocs.structure.files import File

sys.path.insert(0, str(Path(__file__).parent))

from generators import api, commands, figures, formats, gallery, live, mathematics, notebooks

import eomgen

SAY = get_plugin_logger("eomgen").info  # lines beside those of MkDocs
HOWTO, GUIDES = "How to", "Guides"  # sections of the menu
HOWTO_PAGES = ("fmu.md", "mjcf.md", "embed.md")  # export and embed
_REFERENCE = re.compile(r'\s(href|src)="([^"]*)"')
_OUTSIDE = re.compile(r"\[([^\]]+)\]\(((?:\.\./)+[^)#]*)(?:#[^)]*)?\)")
_NOTEBOOK = re.compile(r"(?:\.\./)+examples/notebooks/(\w+)\.ipynb")
_SITE = re.compile(r"<!-- site: (.*?) -->", re.DOTALL)
_LIVE = re.compile(r"^<!-- live: (\w+) -->$", re.MULTILINE)
_CODE = re.compile(r"<(code|pre)\b.*?</\1>", re.DOTALL)


def generated(robots: Sequence[str], docs: Path, run: Sequence[str] | None = None) -> dict[str, str | bytes]:
    """Pages and figures that are in no file, by their paths in the site; a line is written for each that takes long.

    The gallery is one of these robots; notebooks of these names are run, all by default.
    """
    SAY("reference, and gallery of %s", ", ".join(robots))
    found: dict[str, str | bytes] = {
        "reference/description.md": formats.description_page(),
        "reference/scenario.md": formats.scenario_page(),
        "reference/plan.md": formats.plan_page(),
        "reference/cli.md": commands.page(),
        "reference/api.md": api.main_page(),
        "gallery.md": gallery.page(robots),
    }
    found |= {f"reference/{name}.md": text for name, text in api.pages().items()}
    found |= live.pages(robots, docs, SAY)
    SAY("figures")
    drawn = {**gallery.figures(robots), **figures.figures()}
    found |= {f"figures/{name}": content for name, content in drawn.items()}
    try:
        return found | notebooks.pages(run, SAY)
    except notebooks.NotebookError as error:
        raise PluginError(str(error)) from None


def on_config(config: Any) -> Any:
    """Pages that mkdocs.yml has no place for come at the end of a section of the menu."""
    root = Path(config.docs_dir)
    named = set(_pages_of(config.nav))
    sections = {name: pages for entry in config.nav for name, pages in entry.items() if isinstance(pages, list)}
    for path in sorted(root.rglob("*.md")):
        name = path.relative_to(root).as_posix()
        if name not in named:
            sections[HOWTO if name.startswith("howto/") or name in HOWTO_PAGES else GUIDES].append(name)
    return config


def _pages_of(nav: Any) -> Iterator[str]:
    """The paths that a menu names."""
    for entry in nav.values() if isinstance(nav, dict) else nav if isinstance(nav, list) else ():
        if isinstance(entry, str):
            yield entry
        else:
            yield from _pages_of(entry)


def on_files(files: Any, config: Any) -> Any:
    """Add what is generated; a draft may ask for a few robots and notebooks, which take most of the time."""
    robots = (config.extra.get("gallery") or "").split() or eomgen.builtin_robots()
    run = (config.extra.get("notebooks") or "").split() or None
    for path, content in generated(robots, Path(config.docs_dir), run).items():
        files.append(File.generated(config, path, content=content))
    return files


def on_page_markdown(markdown: str, page: Any, config: Any, **_: Any) -> str:
    """Return what the site shows of a page that is read in the repository, too.

    Comments that begin with "site:" become text: links to generated pages stand there.  Robots that are to be live
    become so; links to notebooks lead to their pages, those to other files outside of docs become the files' names.
    """
    docs = Path(config.docs_dir).resolve()
    markdown = _LIVE.sub(lambda match: live.frame(match[1]), _SITE.sub(r"\1", markdown))
    up = "../" * page.file.src_uri.count("/")

    def named(match: re.Match[str]) -> str:
        if notebook := _NOTEBOOK.fullmatch(match[2]):
            return f"[{match[1]}]({up}notebooks/{notebook[1]}.md)"
        target = (docs / page.file.src_uri).parent.joinpath(match[2]).resolve()
        if docs in target.parents:
            return match[0]
        if not target.exists():
            raise PluginError(f"{page.file.src_uri}: the link {match[2]!r} leads to no file of the repository")
        return f"{match[1]} (`{target.relative_to(docs.parent).as_posix()}` in the repository)"

    return _OUTSIDE.sub(named, markdown)


def on_page_content(html: str, page: Any, **_: Any) -> str:
    """Formulas become MathML; links out of the site are checked for their form: they cannot be followed here."""
    try:
        html = mathematics.with_mathml(html)
    except ValueError as error:
        raise PluginError(f"{page.file.src_uri}: {error}") from None
    for kind, target in _REFERENCE.findall(_CODE.sub("", html)):
        wrong = what_is_wrong(kind, target)
        if wrong:
            raise PluginError(f"{page.file.src_uri}: the link {target!r} {wrong}")
    return html


def what_is_wrong(kind: str, target: str) -> str:
    """What is wrong with the form of a link or source that leads out of the site; empty if nothing is."""
    parts = urlsplit(target.replace("&amp;", "&"))
    if not parts.scheme and not parts.netloc:
        return ""  # inside of the site: MkDocs has checked it
    if kind == "src":
        return "is fetched from elsewhere; allowed: files of the site"
    if parts.scheme != "https":
        return "is not of https"
    if not re.fullmatch(r"([a-z0-9-]+\.)+[a-z]{2,}", parts.netloc):
        return "has no name of a host"
    return "has a character that no address has" if re.search(r"[\s<>{}|\\^`]", target) else ""
