"""Claims: which command made which figure of the pages; run the commands and say what no longer holds.

    python -m benchmarks.claims [--most MINUTES] [--only TEXT]

``docs/claims.toml`` names, for every figure, the command, date, commit and machine.  Commands run in a copy of the
repository, so that pages written there can be compared with those here: words, counts and what is called exact have to
be the same, errors at most ten times as large; times and their ratios are printed beside each other.  A command that
finds no device is said not to be measured.
"""

from __future__ import annotations

import argparse
import datetime
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]
TABLE, PAGE = "docs/claims.toml", "docs/claims.md"
MOST = 60.0  # minutes that a command may take
WORSE = 10.0  # times as large as it was said to be may an error get
SHOWN = 12  # lines that differ
ABSENT = "not measured: "  # what a command says that needs what is not here, such as a device
TEXT = """# Claims

Written by `make tables` out of `docs/claims.toml`; do not edit. Every figure of these pages that was measured or
counted, and the command that made it: `pytest` where a test asserts it. Date and commit are those with which the
figures came to the page; machine "any": the same everywhere. `make claims` runs all commands that take less than an
hour and prints what no longer holds; times are printed beside those of the page. A test finds figures without a claim:
times, sizes, ratios, shares, errors, counts of operations, and tables of numbers.

| page | figures | command | minutes | date | commit | machine |
|---|---|---|---:|---|---|---|
{rows}

## Without a command

Measured once, by no command that is kept:

{waiting}
"""
_HIDDEN = re.compile(r"^ *```.*?^ *```|<!--.*?-->|`[^`\n]*`|\$\$.*?\$\$|\$[^$\n]+\$", re.DOTALL | re.MULTILINE)
_NUMBER = r"(?<![\w.^/-])\d[\d,]*(?:\.\d+)?"
FIGURE = re.compile(
    rf"{_NUMBER}(?:e-?\d+)?[ -](?:ns|us|ms|minutes?|MB|MiB)\b"  # times, and sizes
    rf"|(?<=takes ){_NUMBER} s\b|(?<=took ){_NUMBER} s\b"
    rf"|{_NUMBER} times (?:as|the|less|more)\b"  # ratios
    rf"|{_NUMBER} ?(?:%|percent\b)"
    rf"|{_NUMBER}e-\d+"  # errors
    rf"|{_NUMBER} (?:operations|instructions|multiplications|additions)\b"
)
_PROCESSOR = re.compile(r"(?:AMD|Intel\(R\))[^,;:.|]*")  # a name of one, as pages have it
_OWN = ("|", "#", "<", "- ")  # what begins a line of its own, which no line before goes on in
_CELL = re.compile(r"[\d.,e+/ -]*\d[\d.,e+/ -]*(?:%|us|ms|ns)?")
_ANY_NUMBER = re.compile(r"\d[\d,]*(?:\.\d+)?(?:e[+-]?\d+)?")


@dataclass(frozen=True)
class Claim:
    """Figures of a page, and what made them.

    Attributes:
        page: from the root of the repository.
        figures: texts of the page that hold them; none: the whole page, or its generated parts.
        parts: names of generated parts, between "begin of" and "end of".
        command: words as in a shell; "pytest ..." for a test that asserts the figures.
        date, commit: when the figures came to the page.
        machine: "any" where they are the same everywhere.
        minutes: that the command takes.
        exact: headings of sections, or names of parts, whose text is the same on every machine; "*": all.
    """

    page: str
    command: str
    date: datetime.date
    commit: str
    machine: str
    minutes: float
    figures: tuple[str, ...] = ()
    parts: tuple[str, ...] = ()
    exact: tuple[str, ...] = ()

    @property
    def is_test(self) -> bool:
        """Whether the command asserts the figures and writes nothing."""
        return self.command.startswith("pytest ")


@dataclass(frozen=True)
class Figure:
    """A figure that was found: where it stands in the text of its page, its line and itself."""

    begin: int
    end: int
    line: int
    text: str


def read(root: Path = ROOT) -> tuple[list[Claim], dict[str, list[str]], dict[str, list[str]]]:
    """Return claims; by page texts whose figures were measured by no command that is kept; those that nobody measured.

    The last are defaults, limits, inputs of examples and figures of others.
    """
    table = tomllib.loads((root / TABLE).read_text(encoding="utf-8"))
    claims = []
    for entry in table["claim"]:
        lists = {key: tuple(entry.pop(key, ())) for key in ("figures", "parts", "exact")}
        claims.append(Claim(**entry, **lists))
    return claims, table["open"], table["given"]


def pages(root: Path = ROOT) -> list[str]:
    """List pages whose figures need a claim: README and all of docs, but for the page of claims."""
    found = [root / "README.md", *sorted((root / "docs").rglob("*.md"))]
    return [name for path in found if (name := path.relative_to(root).as_posix()) != PAGE]


def figures(text: str) -> Iterator[Figure]:
    """Yield figures of a page: of prose each, of a table of numbers its heading."""
    shown = _HIDDEN.sub(lambda match: re.sub(r"[^\n]", " ", match[0]), text)
    at, heading, rows = 0, (0, ""), 0
    for number, line in enumerate(shown.splitlines(keepends=True), 1):
        if line.startswith("|"):
            if rows == 0:
                heading = (at, text[at : at + len(line)].strip())
            rows += 1
            cells = [cell.strip() for cell in line.strip().strip("|").split("|")[1:]]
            if rows > 2 and sum(bool(_CELL.fullmatch(cell)) for cell in cells) >= 2 and heading[1]:
                yield Figure(heading[0], heading[0] + len(heading[1]), number - rows + 1, heading[1])
                heading = (0, "")
        else:
            rows = 0
            for match in FIGURE.finditer(line):
                yield Figure(at + match.start(), at + match.end(), number, match[0])
        at += len(line)


def part(text: str, name: str) -> tuple[int, int] | None:
    """Return where a generated part of a page begins and ends, None where there is none."""
    begin, end = text.find(f"<!-- begin of {name} -->"), text.find(f"<!-- end of {name} -->")
    return (begin, end) if 0 <= begin < end else None


def covered(text: str, claims: Sequence[Claim], given: Sequence[str]) -> tuple[list[tuple[int, int]], list[str]]:
    """Return spans of a page that are accounted for, and what is named that the page does not have."""
    spans, missing = [], []
    for claim in claims:
        if not claim.figures and not claim.parts:
            spans.append((0, len(text)))
        for name in claim.parts:
            if (span := part(text, name)) is None:
                missing.append(f"part {name}")
            else:
                spans.append(span)
    for words in (*(words for claim in claims for words in claim.figures), *given):
        places = [(match.start(), match.end()) for match in re.finditer(_spaced(words), text)]
        spans += places
        if not places:
            missing.append(words)
    return spans, missing


def _spaced(words: str) -> str:
    """Return a pattern of words that line ends may part."""
    return r"\s+".join(map(re.escape, words.split()))


def unclaimed(page: str, text: str, claims: Sequence[Claim], given: Mapping[str, Sequence[str]]) -> list[str]:
    """Say which figures of a page no claim has, and which claims name what the page does not have."""
    spans, missing = covered(text, [claim for claim in claims if claim.page == page], given.get(page, ()))
    wrong = [f"{page}: docs/claims.toml names {words!r}, which the page does not have" for words in missing]
    for figure in figures(text):
        if not any(begin <= figure.begin and figure.end <= end for begin, end in spans):
            wrong.append(f"{page}:{figure.line}: {figure.text!r} has no claim in docs/claims.toml")
    return wrong


def table_page() -> str:
    """Return the page of all claims."""
    claims, waiting, _ = read()
    rows = []
    for claim in claims:
        name = claim.page.removeprefix("docs/")
        link = f"[{name}]({name if claim.page.startswith('docs/') else '../' + name})"
        shown = "; ".join([*(f"part {x}" for x in claim.parts), *map(_shown, claim.figures)]) or "all of it"
        made = f"`{claim.command}` | {claim.minutes:g} | {claim.date} | {claim.commit} | {claim.machine}"
        rows.append(f"| {link} | {shown} | {made} |")
    left = [f"- `{page}`: {'; '.join(_shown(x) for x in texts)}" for page, texts in waiting.items()]
    return TEXT.format(rows="\n".join(rows), waiting="\n".join(left))


def _shown(words: str) -> str:
    """Return words of a page as a cell of a table may have them."""
    return f"... {' '.join(words.strip('| ').replace('|', ',').split())} ..."


def sections(text: str) -> dict[str, list[str]]:
    """Return lines of a page by the heading or generated part that they stand under; those that go on as one."""
    found: dict[str, list[str]] = {"": []}
    name = outer = ""
    for line in text.splitlines():
        if match := re.match(r"#+ (.*)", line):
            name = outer = match[1]
        elif match := re.match(r"<!-- begin of (\w+) -->", line):
            name = match[1]
        elif line.startswith("<!-- end of "):
            name = outer
        lines = found.setdefault(name, [])
        if line and lines and lines[-1] and not line.startswith(_OWN) and not lines[-1].startswith(_OWN[:3]):
            lines[-1] += f" {line.strip()}"
        else:
            lines.append(line)
    return found


def differences(claim: Claim, here: str, there: str) -> tuple[list[str], list[str]]:
    """Compare a page with the one that was made now: what no longer holds, and what is beside what was measured."""
    broken, beside = [], []
    old, new = sections(here), sections(there)
    for name in dict.fromkeys([*old, *new]):
        lines, others = old.get(name, []), new.get(name, [])
        if "*" in claim.exact or name in claim.exact:
            broken += [f"{name}: {x}" for x in others if x not in lines]
            continue
        if len(lines) != len(others):
            broken.append(f"{name or claim.page}: {len(lines)} lines were there, {len(others)} are now")
            continue
        for line, other in zip(lines, others, strict=True):
            if line == other:
                continue
            if _words(line) != _words(other):
                broken.append(f"{name}: {other}    was: {line}")
            elif _is_worse(line, other):
                broken.append(f"{name}: an error is more than {WORSE:g} times as large: {other}    was: {line}")
            else:
                beside.append(f"{name}: {other}    was: {line}")
    return broken, beside


def _words(line: str) -> str:
    """Return a line without its numbers and the name of a processor."""
    return _ANY_NUMBER.sub("#", _PROCESSOR.sub("a processor", line))


def _is_worse(line: str, other: str) -> bool:
    """Whether an error of a line, a number with a negative exponent, is much larger in the other."""
    one, two = (_ANY_NUMBER.findall(_PROCESSOR.sub("", x)) for x in (line, other))
    pairs = zip(one, two, strict=True)
    return any("e-" in old and float(new.replace(",", "")) > WORSE * float(old.replace(",", "")) for old, new in pairs)


def copied(folder: Path) -> Path:
    """Copy the files of the repository, as they are, into a folder, and return that."""
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, check=True, capture_output=True, text=True).stdout
    for name in filter(None, listed.split("\0")):
        source, target = ROOT / name, folder / name
        if source.is_file():
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(source, target)
    return folder


def run(command: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """Run a claim's command in a copy of the repository, by this very Python."""
    words = shlex.split(command)
    if words[0] == "pytest":
        words = ["python", "-m", "pytest", "-q", "-n", "0", "-m", "soak or not soak", *words[1:]]
    if words[0] != "python":
        raise ValueError(f"command {command!r} begins with {words[0]!r}; allowed: python, pytest")
    return subprocess.run([sys.executable, *words[1:]], cwd=folder, capture_output=True, text=True, check=False)


def main() -> int:
    """Run commands and print what no longer holds; status 1 if something does not."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.claims")
    parser.add_argument("--most", type=float, default=MOST, help="minutes that a command may take (60)")
    parser.add_argument("--only", default="", help="commands that hold this text")
    options = parser.parse_args()
    claims, *_ = read()
    wrong = 0
    for command in dict.fromkeys(claim.command for claim in claims if options.only in claim.command):
        of_command = [claim for claim in claims if claim.command == command]
        if max(claim.minutes for claim in of_command) >= options.most:
            print(f"{command}: left out, takes {of_command[0].minutes:g} minutes")
            continue
        wrong += check(of_command)
    print("all claims hold" if not wrong else f"commands whose claims no longer hold: {wrong}")
    return int(wrong > 0)


def check(claims: Sequence[Claim]) -> bool:
    """Run the command of these claims, print what it says, and return whether something no longer holds."""
    began = time.monotonic()
    broken, beside = [], []
    with tempfile.TemporaryDirectory() as name:
        folder = copied(Path(name))
        done = run(claims[0].command, folder)
        if done.returncode and done.stderr.startswith(ABSENT):
            print(f"{claims[0].command}: {done.stderr.strip()}", flush=True)
            return False
        if done.returncode:
            broken.append(f"status {done.returncode}: {(done.stdout + done.stderr)[-2000:]}")
        for claim in () if claims[0].is_test or done.returncode else claims:
            here, there = ((root / claim.page).read_text(encoding="utf-8") for root in (ROOT, folder))
            lost, changed = differences(claim, here, there)
            broken, beside = broken + lost, beside + changed
    minutes = (time.monotonic() - began) / 60.0
    print(f"{claims[0].command}: {'no longer holds' if broken else 'holds'} ({minutes:.1f} minutes)")
    for line in broken:
        print(f"  no longer: {line}")
    for line in beside[:SHOWN]:
        print(f"  beside: {line}")
    if len(beside) > SHOWN:
        print(f"  beside: {len(beside) - SHOWN} lines more")
    sys.stdout.flush()
    return bool(broken)


if __name__ == "__main__":
    sys.exit(main())
