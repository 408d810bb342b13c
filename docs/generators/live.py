"""Live robots of the site: pages that `eomgen live` makes, and the elements that show them within others."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

from eomgen.export.live.page import live_page

ROBOTS = ("puma560_elastic", "ur5", "worn_arm", "shaken_arm", "four_bar", "gough")  # of the gallery that are live
HOME = "puma560_elastic"
START = "start.md"
_ARM = re.compile(r'```toml title="arm\.toml"\n(.*?)```', re.DOTALL)


def pages(robots: Sequence[str], docs: Path, say: Callable[[str, str], None]) -> dict[str, str]:
    """Live pages by their paths in the site: those of the gallery, of the home page, and the arm of `ten minutes`.

    ``say`` is called with a format and the name of each before it is made.
    """
    found = {}
    for name in ROBOTS:
        if name in {*robots, HOME}:
            say("live page of %s", name)
            found[f"live/{name}.html"] = live_page(name)
    description = _ARM.search((docs / START).read_text(encoding="utf-8"))
    if description is None:
        raise ValueError(f"{START}: the description of arm.toml is not there")
    say("live page of %s", "arm.toml")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "arm.toml"
        path.write_text(description[1], encoding="utf-8")
        found["live/arm.html"] = live_page(path)
    return found


def frame(name: str) -> str:
    """The element that shows a robot's live page within another page of the site's first folder."""
    return (
        f'<iframe src="live/{name}.html#compact=true" title="{name}, simulated in this page" loading="lazy"'
        ' style="width: 100%; height: 360px; border: 1px solid #8884; border-radius: 6px"></iframe>'
    )
