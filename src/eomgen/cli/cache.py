"""The command cache: where compiled kernels are kept, and how to be rid of them."""

from __future__ import annotations

import argparse
from typing import Any

from .shared.command import Command
from .shared.options import add_json
from .shared.output import say, show_json


def _add_cache(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--clear", action="store_true", help="remove them; kernels that are loaded go on")
    add_json(parser)


def _cache(options: argparse.Namespace) -> None:
    from ..pipeline.cache import KINDS, cache_folder, clear, contents

    removed = clear() if options.clear else None
    entries = contents()
    size = sum(size for _, _, size in entries)
    about: dict[str, Any] = {
        "folder": str(cache_folder()),
        **{kind: sum(1 for entry in entries if entry[0] == kind) for kind in KINDS},
        "bytes": size,
    }
    if removed is not None:
        about["removed"] = removed
    if options.json:
        show_json(about)
        return
    say(str(about["folder"]))
    counts = [f"{about[kind]} {kind}" for kind in KINDS if about[kind]]
    print(f"{', '.join(counts) or 'nothing'}, {size / 1e6:.1f} MB")
    if removed is not None:
        print(f"removed {removed} entries")


COMMANDS = (
    Command(
        _add_cache,
        _cache,
        "where compiled kernels are kept, how many, how large",
        {"cache --clear": "remove compiled kernels"},
    ),
)
