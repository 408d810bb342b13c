"""Commands for who reads equations."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

from .robot import Robot

Load = Callable[[argparse.Namespace], Robot]


def add_derive(commands: Any, robot_command: Callable[..., argparse.ArgumentParser], load: Load) -> None:
    """``eomgen derive``; ``robot_command`` makes a command that takes a robot, ``load`` reads it."""

    def derive(options: argparse.Namespace) -> None:
        from .codegen.readable import readable_form
        from .model import build_model

        form = readable_form(build_model(load(options)), numbers=options.numbers)
        _write(options.output, form.latex() if options.latex else "\n".join(form.lines()))

    command = robot_command(commands, "derive", derive, "closed-form equations of a small robot, for a reader")
    style = command.add_mutually_exclusive_group()
    style.add_argument("--text", action="store_true", help="plain text (the default)")
    style.add_argument("--latex", action="store_true", help="a LaTeX fragment for amsmath")
    command.add_argument("--numbers", action="store_true", help="keep the description's numbers, no symbols for them")
    command.add_argument("-o", "--output", type=Path, help="file to write to (standard output)")


def _write(target: Path | None, text: str) -> None:
    """The text into a file, or on standard output."""
    if target is None:
        print(text)
        return
    from .result import write_atomically

    print(f"wrote {write_atomically(target, lambda stream: stream.write((text + chr(10)).encode()))}")
