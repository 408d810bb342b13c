"""A headless Chromium for the tests that look at pages; they skip where there is none, and nothing is downloaded."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import pytest

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
# software rendering: test machines have no graphics
FLAGS = ("--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")


@dataclass
class Page:
    """A page of Playwright, and what went wrong or was asked for meanwhile."""

    page: Any
    errors: list[str] = field(default_factory=list)
    requests: list[str] = field(default_factory=list)


@contextmanager
def open_page(width: int = 1000, height: int = 700) -> Iterator[Page]:
    """An empty page; pytest.skip where Playwright (pip install playwright) or a browser of the system is missing."""
    api = pytest.importorskip("playwright.sync_api", reason="needs Playwright: pip install playwright")
    place = os.environ.get("EOMGEN_BROWSER") or next(filter(None, map(shutil.which, NAMES)), None)
    if place is None:
        pytest.skip(f"needs one of {', '.join(NAMES)}, or its path in EOMGEN_BROWSER")
    with api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=place, args=list(FLAGS))
        found = Page(browser.new_page(viewport={"width": width, "height": height}))
        found.page.on("console", lambda m: found.errors.append(m.text) if m.type == "error" else None)
        found.page.on("pageerror", lambda error: found.errors.append(str(error)))
        found.page.on("request", lambda request: found.requests.append(request.url))
        try:
            yield found
        finally:
            browser.close()
