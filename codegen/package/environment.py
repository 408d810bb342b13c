"""What the environment says about compiling: CC, CFLAGS and LDFLAGS, split as a shell splits words, and checked."""

from __future__ import annotations

import os
import re
import shlex
from collections.abc import Iterable

from eomgen.errors import BuildError

_UNSAFE = re.compile(
    r"-Ofast|-f(fast-math|unsafe-math-optimizations|finite-math-only|associative-math|reciprocal-math|cx-limited-range"
    r"|no-signed-zeros|no-honor-nans|no-honor-infinities|approx-func|denormal-fp-math=(?!ieee).*"
    r"|fp-model=(fast|aggressive).*)|-mdaz-ftz|-fp-model=?fast.*"
)
_WHY = (
    "folds the checks for NaN away, and linked with it a library turns denormal numbers off for the whole process;"
    " allowed: flags that keep IEEE arithmetic, such as -O3, -g or -march=native"
)


def environment_words(name: str) -> tuple[str, ...]:
    """The words of an environment variable; none where it is not set.

    Raises:
        BuildError: a quote is not closed.
    """
    text = os.environ.get(name, "")
    try:
        return tuple(shlex.split(text))
    except ValueError as error:
        raise BuildError(f"${name} is {text[:200]!a}: {error}; allowed: words as a shell reads them") from None


def check_flags(flags: Iterable[str], whence: str) -> None:
    """BuildError for flags that break arithmetic; ``whence`` is what they were given by."""
    for flag in flags:
        if _UNSAFE.fullmatch(flag):
            raise BuildError(f"{whence}: {flag} {_WHY}")
