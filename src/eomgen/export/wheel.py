"""A robot's generated package as a wheel, which pip installs where neither eomgen nor a compiler is."""

from __future__ import annotations

import hashlib
import re
import sys
import sysconfig
import tempfile
import zipfile
from base64 import urlsafe_b64encode
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path

from eomgen._version import __version__
from eomgen.description import RobotLike, as_robot
from eomgen.errors import InputError
from eomgen.files import as_path, write_atomically
from eomgen.pipeline.generating import generate
from eomgen.pipeline.options import ALL, Options
from eomgen.progress import Progress, no_progress, tells_at_prompt

OLDEST = (1980, 1, 1, 0, 0, 0)  # the first time that an archive can hold: the same files make the same bytes
C_LIBRARIES = {b"libc.so.6", b"libm.so.6", b"libpthread.so.0", b"ld-linux-x86-64.so.2", b"ld-linux-aarch64.so.1"}
NEEDS = ("cffi>=1.16", "numpy>=1.26")


@tells_at_prompt("exporting")
def export_wheel(
    robot: RobotLike, folder: Path | str, options: Options | None = None, *, progress: Progress = no_progress
) -> Path:
    """Write a wheel of the robot's generated package into a folder, and return its path.

    It has binaries for all x86-64 levels, unless the options name some, of which the best that runs is loaded, and
    needs NumPy and cffi.  Its version is this package's, and behind a + what tells one content from another; the same
    content has the same bytes.  The platform of Linux is the oldest glibc ("manylinux") that has all that the binaries
    ask of it; where they need more than a C library, "linux".  Calls are fastest on the minor version of Python that
    wrote it, and run on others.

    Args:
        robot: a Robot, the name of a built-in one, or the path of a description.
        folder: where the file is written, named by robot, version, Python and platform.
        options: as of ``generate``; not ``native``, since a wheel is for other machines.
        progress: as of ``eomgen.generate``.

    Raises:
        InputError: options ask for this processor alone, or the folder cannot be written.
        BuildError: see ``build``.
    """
    folder = as_path(folder, "folder")
    robot, options = as_robot(robot), options or Options()
    if options.native:
        raise InputError("native: a wheel is for other machines; allowed: levels, or all of them")
    options = options if options.levels else replace(options, levels=(ALL,))
    with tempfile.TemporaryDirectory(prefix="eomgen-") as place:
        package = generate(robot, place, options, progress=progress)
        files = {
            f"{robot.name}/{path.relative_to(package).as_posix()}": path.read_bytes()
            for path in package.rglob("*")
            if path.is_file() and "__pycache__" not in path.parts
        }
    name = re.sub(r"[-_.]+", "_", robot.name).lower()
    version = f"{__version__}+{_digest(files)}"
    tag = f"{python_of(files)}-{platform_of(data for path, data in files.items() if path.endswith('.so'))}"
    files |= _described(robot.name, f"{name}-{version}.dist-info", name, version, tag)
    target = Path(folder) / f"{name}-{version}-{tag}.whl"
    return write_atomically(target, lambda stream: _zip(stream, files), read=None)


def python_of(paths: Iterable[str]) -> str:
    """Return the tag of the Pythons that import a package of these files: of modules of cffi, or of plain libraries."""
    modules = [path for path in paths if re.search(r"/_[^/]*\.(so|pyd)$", path) and "/runtime/" not in path]
    if not modules:
        return "py3-none"
    if all(".abi3." in name for name in modules):
        return "cp311-abi3"
    return "cp{0}-cp{0}".format("".join(map(str, sys.version_info[:2])))


def platform_of(binaries: Iterable[bytes]) -> str:
    """Return the platform tag of binaries that were compiled here, by the C library that they ask for (PEP 600)."""
    platform = re.sub(r"[-.]", "_", sysconfig.get_platform())
    if not platform.startswith("linux_"):
        return platform
    data = b"\0".join(binaries)
    libraries = set(re.findall(rb"\0((?:lib|ld-)[\w.+-]*\.so[\w.]*)(?=\0)", data))
    versions = [
        tuple(map(int, x.split(b"."))) for x in re.findall(rb"\0GLIBC_(\d{1,9}\.\d{1,9})(?=[.\d]{0,99}\0)", data)
    ]
    if not versions or not libraries <= C_LIBRARIES:
        return platform
    major, minor = max(*versions, (2, 5))[:2]
    return f"manylinux_{major}_{minor}_{platform.removeprefix('linux_')}"


def _digest(files: Mapping[str, bytes]) -> str:
    """Return twelve figures that tell contents apart."""
    parts = (f"{path}\0{hashlib.sha256(files[path]).hexdigest()}" for path in sorted(files))
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()[:12]


def _described(robot: str, folder: str, name: str, version: str, tag: str) -> dict[str, bytes]:
    """Return files that tell pip what it installs."""
    metadata = [
        "Metadata-Version: 2.1",
        f"Name: {name}",
        f"Version: {version}",
        f"Summary: Equations of motion of the robot {robot}, compiled; written by eomgen",
        "Requires-Python: >=3.11",
        *(f"Requires-Dist: {x}" for x in NEEDS),
    ]
    wheel = [
        "Wheel-Version: 1.0",
        f"Generator: eomgen {__version__}",
        "Root-Is-Purelib: false",
        f"Tag: {tag}",
    ]
    texts = {"METADATA": metadata, "WHEEL": wheel, "top_level.txt": [robot]}
    return {f"{folder}/{file}": ("\n".join(lines) + "\n").encode() for file, lines in texts.items()}


def _zip(stream: object, files: Mapping[str, bytes]) -> None:
    """Write an archive with the record of its files, whose order and times are always the same."""
    record = next(path for path in files if path.endswith(".dist-info/WHEEL")).replace("WHEEL", "RECORD")
    ordered = [(path, files[path]) for path in sorted(files, key=lambda path: (".dist-info/" in path, path))]
    lines = [f"{path},sha256={_encoded(data)},{len(data)}" for path, data in ordered]
    ordered.append((record, "".join(f"{line}\n" for line in (*lines, f"{record},,")).encode()))
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:  # type: ignore[call-overload]
        for path, data in ordered:
            entry = zipfile.ZipInfo(path, OLDEST)
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.external_attr = (0o755 if path.endswith(".so") else 0o644) << 16
            archive.writestr(entry, data)


def _encoded(data: bytes) -> str:
    return urlsafe_b64encode(hashlib.sha256(data).digest()).rstrip(b"=").decode()
