"""Processes that replace a folder again and again, and what they need to be told."""

from __future__ import annotations

import sys
import textwrap
from pathlib import Path
from subprocess import PIPE, Popen

REPLACING = """
    import sys
    from pathlib import Path
    from eomgen.pipeline.folders import new_folder, put_folder
    target, who = Path(sys.argv[1]), sys.argv[2]
    print("ready", flush=True)
    sys.stdin.readline()
    for turn in range(int(sys.argv[3])):
        with new_folder(target) as private:
            for name in ("one", "two"):
                (private / name).write_text(f"{who} {turn}")
            put_folder(private, target, lambda place: None)
"""


def start_writers(target: Path, count: int, turns: int) -> list[Popen[str]]:
    """Writers of a folder with the files "one" and "two", which say the same; they wait until ``release``."""
    code = textwrap.dedent(REPLACING)
    arguments = ([sys.executable, "-c", code, str(target), str(who), str(turns)] for who in range(count))
    writers = [Popen(words, stdin=PIPE, stdout=PIPE, stderr=PIPE, text=True) for words in arguments]
    for writer in writers:
        assert writer.stdout.readline() == "ready\n"
    return writers


def release(writers: list[Popen[str]]) -> None:
    for writer in writers:
        writer.stdin.write("\n")
        writer.stdin.flush()


def look_until_done(target: Path, writers: list[Popen[str]]) -> int:
    """Number of looks at the folder while writers replace it; each look finds it with both of its files."""
    looks = 0
    while any(writer.poll() is None for writer in writers):
        assert (target / "one").read_text()
        assert (target / "two").read_text()
        looks += 1
    return looks
