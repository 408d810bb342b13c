"""Coverage-guided fuzzing: python -m tests.support.atheris_target KIND [libFuzzer's flags] [corpus]."""

from __future__ import annotations

import sys
import tempfile
import warnings
from pathlib import Path

import atheris

with atheris.instrument_imports(include=["eomgen", "tomllib"]):
    from eomgen.errors import EomgenWarning
    from tests.support.fuzzing import KINDS, accepted


def main() -> None:
    kind = sys.argv.pop(1)
    assert kind in KINDS
    warnings.simplefilter("error")
    warnings.simplefilter("ignore", EomgenWarning)
    with tempfile.TemporaryDirectory() as folder:

        def one(content: bytes) -> None:
            accepted(kind, content, Path(folder))

        atheris.Setup(sys.argv, one)
        atheris.Fuzz()


if __name__ == "__main__":
    main()
