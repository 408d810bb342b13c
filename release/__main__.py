"""Build what an index would give out, and check it in fresh environments: python -m release [--pythons 3.11 3.12 ...]

Nothing is signed and nothing is uploaded.  What is checked:

1. the tree is clean, and version, CHANGELOG.md, CITATION.cff and the recipe for conda say the same;
2. the source distribution and the wheel are built, and an index could show them (twine check --strict);
3. for each Python: the wheel with the extra "sim" in a fresh environment, whose commands and kernels work in an empty
   folder; and the README's `make demo` in the unpacked source distribution.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import re
import shutil
import subprocess
import sys
import tarfile
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

from .pythons import PYTHONS, interpreter, unpack_debian

ROOT = Path(__file__).parents[1]
COMMANDS = (
    ("eomgen", "robots"),
    ("eomgen", "info", "puma560_elastic"),
    ("eomgen", "simulate", "one_link", "-o", "out"),
    ("eomgen", "generate", "one_link", "-o", "."),
)
KERNEL = """
import numpy, one_link
a = one_link.kernel.forward_dynamics([0.0, 0.0], [0.0, 0.0], [0.0, 0.0])
numpy.testing.assert_allclose(a, [0.0, -14.715], atol=1e-12)
"""


class Refused(Exception):
    """The tree, the archives or an environment is not what a release needs."""


def main() -> int:
    """Check all, and say what was made; 1 if something is not as it should be."""
    parser = argparse.ArgumentParser(prog="python -m release", description=(__doc__ or "").partition("\n")[0])
    available = f"versions to test (those of {' '.join(PYTHONS)} that are available)"
    parser.add_argument("--pythons", nargs="+", default=[], metavar="3.X", help=available)
    options = parser.parse_args()
    try:
        version = consistent_version()
        clean_tree()
        archives = build(ROOT / "dist", version)
        chosen = interpreters(options.pythons or PYTHONS, required=bool(options.pythons))
        for name, python in chosen.items():
            check_python(name, python, *archives)
    except Refused as error:
        print(f"release: {error}", file=sys.stderr)
        return 1
    untested = [name for name in PYTHONS if name not in chosen]
    print(f"\neomgen {version} is ready; tested with Python {', '.join(chosen)}", end="; ")
    print(f"not tested: {', '.join(untested) or 'none of the supported versions'}.  Neither signed nor uploaded:")
    for path in archives:
        print(f"  {hashlib.sha256(path.read_bytes()).hexdigest()}  {path.relative_to(ROOT)}")
    return 0


def consistent_version() -> str:
    """Return the version, which all files that name one agree about.

    Raises:
        Refused: one of them does not, or the changelog has no date of it.
    """
    text = {name: (ROOT / name).read_text(encoding="utf-8") for name in (*_VERSIONS, "src/eomgen/_version.py")}
    (version,) = re.findall(r'^__version__ = "(.+)"$', text["src/eomgen/_version.py"], re.MULTILINE)
    for name, pattern in _VERSIONS.items():
        named = re.search(pattern, text[name], re.MULTILINE)
        if named is None or named[1] != version:
            raise Refused(f"{name}: names {named[1] if named else 'no version'}; expected {version}, with a date")
    dates = {re.search(_DATES[name], text[name], re.MULTILINE)[1] for name in _DATES}  # type: ignore[index]
    if len(dates) != 1:
        raise Refused(f"{' and '.join(_DATES)}: date the release {' and '.join(sorted(dates))}; expected one date")
    return str(version)


_VERSIONS: Mapping[str, str] = {
    "CHANGELOG.md": r"\A# Changelog\n\n## (\S+) \(\d{4}-\d\d-\d\d\)$",
    "CITATION.cff": r"^version: (\S+)\ndate-released: \d{4}-\d\d-\d\d$",
    "release/conda/recipe.yaml": r'^  version: "(\S+)"$',
}
_DATES: Mapping[str, str] = {"CHANGELOG.md": r"^## \S+ \((\S+)\)$", "CITATION.cff": r"^date-released: (\S+)$"}


def clean_tree() -> None:
    """Refuse a tree with changes or untracked files: what is built is what was committed."""
    done = subprocess.run(["git", "status", "--porcelain"], cwd=ROOT, capture_output=True, text=True, check=False)
    if done.returncode or done.stdout:
        raise Refused(f"the tree is not clean:\n{done.stdout or done.stderr}commit or remove that first")


def build(out: Path, version: str) -> tuple[Path, Path]:
    """Return the source distribution and the wheel in a folder that holds nothing else."""
    shutil.rmtree(out, ignore_errors=True)
    shutil.rmtree(ROOT / "build" / "lib", ignore_errors=True)
    run([sys.executable, "-m", "build", "--outdir", str(out)], ROOT)
    source, wheel = out / f"eomgen-{version}.tar.gz", out / f"eomgen-{version}-py3-none-any.whl"
    built = sorted(path.name for path in out.iterdir())
    if built != sorted((source.name, wheel.name)):
        raise Refused(f"built are {', '.join(built)}; expected {source.name} and {wheel.name}")
    run([sys.executable, "-m", "twine", "check", "--strict", str(source), str(wheel)], ROOT)
    return source, wheel


def interpreters(wanted: Sequence[str], *, required: bool) -> dict[str, str]:
    """Return paths of these Pythons by their versions, unpacked from packages where they are not installed.

    Raises:
        Refused: one that is required is not available, or none is.
    """
    found = {version: interpreter(version) or unpack_debian(version) for version in wanted}
    pythons = {version: python for version, python in found.items() if python is not None}
    missing = [version for version in wanted if version not in pythons]
    if not pythons or (required and missing):
        raise Refused(f"Python {', '.join(missing)} is not installed; allowed: --pythons with installed versions")
    return pythons


def check_python(version: str, python: str, source: Path, wheel: Path) -> None:
    """Install the wheel and use it, and run the README's `make demo` in the source distribution.

    Raises:
        Refused: a command fails.
    """
    print(f"\nPython {version}: the wheel in a fresh environment", flush=True)
    with tempfile.TemporaryDirectory(prefix="eomgen-release-") as work:
        folder, venv = Path(work, "folder"), Path(work, "venv")
        folder.mkdir()
        run([python, "-m", "venv", str(venv)], folder)
        interpreter_path = str(venv / "bin" / "python")
        run([interpreter_path, "-m", "pip", "install", "-q", "--disable-pip-version-check", f"{wheel}[sim]"], folder)
        run([interpreter_path, "-m", "pip", "check"], folder)
        for command in COMMANDS:
            run([str(venv / "bin" / command[0]), *command[1:]], folder)
        run([interpreter_path, "-c", KERNEL], folder)
        print(f"Python {version}: make demo in the source distribution", flush=True)
        with tarfile.open(source) as archive:
            archive.extractall(work, filter="data")
        run(["make", "demo", f"PYTHON={python}"], Path(work, source.name.removesuffix(".tar.gz")))


def run(command: Sequence[str], folder: Path) -> None:
    """Run a command with a new cache, and without what would lead to this tree.

    Raises:
        Refused: it fails; the end of what it said is in the message.
    """
    environment = {
        key: value for key, value in os.environ.items() if not key.startswith(("PYTHON", "EOMGEN", "MAKE", "VIRTUAL"))
    }
    environment["XDG_CACHE_HOME"] = str(folder / ".cache")
    print(f"  {' '.join(command)}", flush=True)
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    if done.returncode:
        raise Refused(f"{' '.join(command)}: status {done.returncode}\n{(done.stdout + done.stderr)[-3000:]}")


if __name__ == "__main__":
    sys.exit(main())
