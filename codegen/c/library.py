"""The C library that robots' code includes: its files, and its types as cffi reads them."""

from __future__ import annotations

import importlib.resources
import re
from collections.abc import Iterable
from functools import cache

FOLDER = "clib"  # of eomgen, and beside a robot's file
LINKED = "EOM_LINKED"  # macro of robots' files that are linked with the library's objects
SETUP_ONLY = "EOM_SETUP_ONLY"  # macro that leaves of a robot's file what h is made by
_DIRECTIVE = re.compile(r"\s*#\s*(if|ifdef|ifndef|else|elif|endif|define|include)\b\s*(.*?)\s*$")
_TYPES = ("eom.h", "eom_types.h")


@cache
def library_files() -> dict[str, str]:
    """Read the library's files, by their places beside a robot's file ("clib/eom.h"), sorted."""
    folder = importlib.resources.files("eomgen").joinpath(FOLDER)
    names = sorted(path.name for path in folder.iterdir() if path.name.endswith((".c", ".h")))
    return {f"{FOLDER}/{name}": folder.joinpath(name).read_text(encoding="ascii") for name in names}


def included_files(*codes: str) -> dict[str, str]:
    """Return those of the library's files that a robot's files include, compiled alone, and all that these include."""
    files, found = library_files(), dict[str, str]()

    def follow(text: str, known: set[str], folder: str) -> None:
        taken, closed = [True], [False]  # closed: another part of the condition holds
        for line in re.sub(r"\\\n", " ", text).splitlines():
            if match := _DIRECTIVE.match(line):
                word, rest = match.groups()
                if word in ("if", "ifdef", "ifndef"):
                    condition = {"if": rest, "ifdef": f"defined({rest})", "ifndef": f"!defined({rest})"}[word]
                    holds = _holds(condition, known)
                    taken.append(taken[-1] and holds is not False)
                    closed.append(holds is True)
                elif word == "endif":
                    taken.pop()
                    closed.pop()
                elif word in ("else", "elif"):
                    taken[-1] = taken[-2] and not closed[-1]
                elif taken[-1] and word == "define":
                    known.add(rest.split("(")[0].split()[0])
                elif taken[-1] and (place := f"{folder}{rest[1:-1]}") in files:
                    found[place] = files[place]
                    follow(files[place], known, f"{FOLDER}/")

    for code in codes:
        follow(code, set(), "")
    return dict(sorted(found.items()))


def _holds(condition: str, known: set[str]) -> bool | None:
    """Whether a condition of the preprocessor holds where some macros are defined; None where they do not decide it."""

    def defined(term: str) -> bool | None:
        match = re.fullmatch(r"(!?)defined\((\w+)\)", term.strip())
        return None if match is None else (match[2] in known) != bool(match[1])

    condition = condition.partition("/*")[0]
    if "||" not in condition:
        values = [defined(term) for term in condition.split("&&")]
        return False if False in values else None if None in values else True
    values = [defined(term) for term in condition.split("||")]
    return True if True in values else None if None in values else False


@cache
def library_types(dtype: str) -> str:
    """Declare the library's types in one precision, "float64" or "float32", without preprocessor and comments."""
    return _declared(dtype, _TYPES)


def _plain(name: str) -> str:
    """Return a file without comments and what is for C++, continued lines joined."""
    text = re.sub(r"#ifdef __cplusplus\n.*?#endif\n", "", library_files()[f"{FOLDER}/{name}"], flags=re.DOTALL)
    return re.sub(r"/\*.*?\*/", "", text, flags=re.DOTALL).replace("\\\n", "")


def _declared(dtype: str, names: Iterable[str]) -> str:
    """Return declarations of headers in one precision."""
    text = "\n".join(map(_plain, names))
    prefix, scalar = ("eomf", "float") if dtype == "float32" else ("eom", "double")
    text = re.sub(r"\bEOM\((\w+)\)", rf"{prefix}_\1", text).replace("EOM_SCALAR", scalar)
    lines = (line.rstrip() for line in text.splitlines() if not line.startswith("#"))
    return "\n".join(line for line in lines if line) + "\n"
