"""The command cache: where compiled kernels are kept, and how to be rid of them."""

from __future__ import annotations

import argparse
import json
from typing import Any


def add_cache(commands: Any) -> None:
    """``eomgen cache``."""
    text = "where compiled kernels are kept, how many, how large"
    parser = commands.add_parser("cache", help=text, description=f"{text[0].upper()}{text[1:]}.")
    parser.add_argument("--clear", action="store_true", help="remove them; kernels that are loaded go on")
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.set_defaults(command=_cache)


def _cache(options: argparse.Namespace) -> None:
    from ..pipeline.cache import KINDS, cache_folder, clear, contents

    removed = clear() if options.clear else None
    found = contents()
    size = sum(size for _, _, size in found)
    about: dict[str, Any] = {
        "folder": str(cache_folder()),
        **{kind: sum(1 for entry in found if entry[0] == kind) for kind in KINDS},
        "bytes": size,
    }
    if removed is not None:
        about["removed"] = removed
    if options.json:
        print(json.dumps(about, indent=1))
        return
    print(about["folder"])
    counts = [f"{about[kind]} {kind}" for kind in KINDS if about[kind]]
    print(f"{', '.join(counts) or 'nothing'}, {size / 1e6:.1f} MB")
    if removed is not None:
        print(f"removed {removed} entries")
