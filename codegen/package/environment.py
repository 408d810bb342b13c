"""Compiler's words from the environment: CC, CFLAGS and LDFLAGS, split as a shell splits words, and checked."""

from __future__ import annotations

import os
import re
import shlex
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from eomgen.errors import BuildError
from eomgen.files import read_regular
from eomgen.identifiers import show_path
from eomgen.names import show

_FILE, _FILES, _WORDS = 1 << 20, 50, 10_000  # bytes of a response file; such files, and words, in one variable
_UNSAFE = re.compile(
    r"-Ofast"
    r"|-f(fast-math|unsafe-math-optimizations|finite-math-only|associative-math|reciprocal-math|approx-func"
    r"|cx-limited-range|cx-fortran-rules|single-precision-constant|no-signed-zeros|no-honor-nans|no-honor-infinities"
    r"|no-protect-parens|excess-precision=(?!standard).*|fp-eval-method=(?!source).*|denormal-fp-math(-f32)?=(?!ieee).*"
    r"|fp-model=(?!precise|strict).*|imf-.*|tz)"
    r"|-m(daz-ftz|recip(=(?!none).*)?|fpmath=(?!sse$).*|no-ieee-fp|pc(32|64)|low-precision-.*|fast-fp"
    r"|reassociate|enable-no-infs|enable-no-nans|enable-unsafe-fp-math)"
    r"|-cl-(fast-relaxed-math|unsafe-math-optimizations|finite-math-only|single-precision-constant|no-signed-zeros"
    r"|denorms-are-zero|mad-enable)"
    r"|-fp-model(?!=?(precise|strict)).+|-ftz|-fast|-no-prec-(div|sqrt)|-+enable-(unsafe|no-(nans|infs))-.*"
)
_PARTED = ("--optimize", "--machine", "-fp-model")  # words whose value may be the next word
_WHY = (
    "changes what the equations compute: such flags fold the checks for NaN away, reorder sums or round constants, and"
    " linked with them a library turns denormal numbers off for the whole process; allowed: flags that keep IEEE"
    " arithmetic, such as -O3, -g or -march=native"
)


def environment_words(name: str) -> tuple[str, ...]:
    """Return an environment variable's words, with those of response files (@FILE); none where it is not set.

    Raises:
        BuildError: a quote is not closed, or a response file cannot be read.
    """
    text = os.environ.get(name, "")
    try:
        words = tuple(shlex.split(text))
    except ValueError as error:
        raise BuildError(f"${name} is {text[:200]!a}: {error}; allowed: words as a shell reads them") from None
    return expanded(words, f"${name}")


def expanded(words: Sequence[str], whence: str) -> tuple[str, ...]:
    """Put the content in place of every response file, so that what is checked is what is used.

    Raises:
        BuildError: a file cannot be read, or there are too many or too large ones; ``whence`` is named.
    """
    content: list[str] = []
    waiting, files = list(reversed(words)), 0
    while waiting:
        word = waiting.pop()
        if not word.startswith("@"):
            content.append(word)
            continue
        files += 1
        waiting.extend(reversed(_response(word, whence)))
        if files > _FILES or len(content) + len(waiting) > _WORDS:
            raise BuildError(
                f"{whence}: {show_path(word)}: response files name too many files or words; allowed: up to {_FILES}"
                f" files and {_WORDS} words, and none that names itself"
            )
    return tuple(content)


def _response(word: str, whence: str) -> list[str]:
    """Read words of the response file @FILE, which separates and quotes as a shell does."""
    try:
        text = os.fsdecode(read_regular(Path(word[1:]), _FILE))
        if "\0" in text:
            raise ValueError("it holds a NUL")
        return shlex.split(text)
    except (OSError, ValueError) as error:
        said = getattr(error, "strerror", None) or error
        raise BuildError(
            f"{whence}: {show_path(word)}: {said}; allowed: @ and the path of a file with words as a shell reads them"
        ) from None


def check_flags(flags: Iterable[str], whence: str) -> None:
    """Refuse flags that break arithmetic; ``whence`` names where they come from."""
    for flag, meanings in _meanings(flags):
        if any(_UNSAFE.fullmatch(meaning) for meaning in meanings):
            raise BuildError(f"{whence}: {show(flag)[1:-1]} {_WHY}")


def _meanings(flags: Iterable[str]) -> Iterator[tuple[str, list[str]]]:
    """Return every flag with all that it may stand for: long forms, and those that are handed to a pass."""
    before = ""
    for flag in flags:
        inner = flag.split(",")[1:] if re.match(r"-W[pl],", flag) else []
        parts = [_short(form) for form in (flag, *inner)]
        if before in _PARTED:
            parts.append(_short(f"{before}={flag}"))
        yield (f"{before} {flag}" if before in _PARTED else flag), parts
        before = flag


def _short(flag: str) -> str:
    """Return a flag's short form, as GCC translates long ones: --optimize=fast is -Ofast, --no-honor-nans -fno-..."""
    for long, short in (("--optimize=", "-O"), ("--machine=", "-m"), ("--machine-", "-m")):
        if flag.startswith(long):
            return short + flag.removeprefix(long)
    return "-f" + flag[2:] if flag.startswith("--") else flag
