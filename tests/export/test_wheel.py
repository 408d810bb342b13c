"""Wheels of generated packages: pip installs them without eomgen, their files and platform are what they say."""

from __future__ import annotations

import csv
import hashlib
import subprocess
import sys
import sysconfig
import venv
import zipfile
from base64 import urlsafe_b64decode
from io import StringIO
from pathlib import Path

import numpy as np
import pytest

import eomgen
from eomgen.cli.entry import main
from eomgen.errors import InputError
from eomgen.export.wheel import platform_of, python_of
from eomgen.pipeline.options import Options
from eomgen.runtime.levels import LEVELS, machine_levels
from tests.support.refusals import refused

pytestmark = pytest.mark.quick

KERNELS = ("forward_dynamics",)
CALL = """
import sys, one_link
assert not any(name.partition(".")[0] == "eomgen" for name in sys.modules)
print(*(x.hex() for x in one_link.forward_dynamics([0.1, 0.2], [0.3, 0.4], [0.0, 1.0])))
"""


@pytest.mark.soak
def test_the_same_robot_makes_the_same_whole_wheel(tmp_path: Path) -> None:
    first = eomgen.export_wheel("one_link", tmp_path / "a", Options(KERNELS))
    assert main(["generate", "one_link", "--wheel", "--kernels", *KERNELS, "-o", str(tmp_path / "b")]) == 0
    (second,) = (tmp_path / "b").iterdir()
    assert (first.name, first.read_bytes()) == (second.name, second.read_bytes())
    name, version, *tag = first.stem.split("-")
    assert (name, version.partition("+")[0], tag[:2]) == ("one_link", eomgen.__version__, ["cp311", "abi3"])
    with zipfile.ZipFile(first) as archive:
        files = {entry: archive.read(entry) for entry in archive.namelist()}
    info = f"one_link-{version}.dist-info"
    rows = list(csv.reader(StringIO(files[f"{info}/RECORD"].decode())))
    assert {row[0] for row in rows} == set(files)
    for path, digest, size in rows[:-1]:
        assert urlsafe_b64decode(digest.removeprefix("sha256=") + "=") == hashlib.sha256(files[path]).digest()
        assert int(size) == len(files[path])
    assert f"Tag: {'-'.join(tag)}" in files[f"{info}/WHEEL"].decode().splitlines()
    assert {"one_link/__init__.py", "one_link/one_link.json", "one_link/runtime/compiled_kernel.py"} <= set(files)


def test_another_content_has_another_version(tmp_path: Path) -> None:
    """Of all levels unless some are named."""
    ways = Options(KERNELS), Options(("energy",)), Options(KERNELS, levels=("v1",))
    wheels = [eomgen.export_wheel("one_link", tmp_path, options) for options in ways]
    assert len({wheel.name for wheel in wheels}) == 3
    for wheel, levels in zip(wheels, (machine_levels(), machine_levels(), ("v1",)), strict=True):
        with zipfile.ZipFile(wheel) as archive:
            assert {level for level in LEVELS if any(f"/{level}/" in name for name in archive.namelist())} == {
                *levels[1:]
            }
    refused(InputError, "native", eomgen.export_wheel, "one_link", tmp_path, Options(KERNELS, native=True))
    assert main(["generate", "one_link", "--wheel", "--cmake", "-o", str(tmp_path)]) == 1


def test_pythons_are_those_that_can_import_the_modules() -> None:
    direct = "arm/runtime/_direct.cpython-311-x86_64-linux-gnu.so"  # done without where it does not fit
    mine = "cp{0}{1}-cp{0}{1}".format(*sys.version_info)
    assert python_of(["arm/__init__.py", "arm/_arm.abi3.so", "arm/v3/_arm.abi3.so", direct]) == "cp311-abi3"
    assert python_of(["arm/__init__.py", "arm/_arm.cpython-311-x86_64-linux-gnu.so", direct]) == mine
    assert python_of(["arm/__init__.py", "arm/libarm.so", direct]) == "py3-none"


@pytest.mark.skipif(not sysconfig.get_platform().startswith("linux-"), reason="the tags of Linux")
def test_platforms_are_those_of_the_symbols() -> None:
    here = sysconfig.get_platform().replace("-", "_")
    there = here.removeprefix("linux_")
    assert platform_of([b"\0libc.so.6\0GLIBC_2.2.5\0GLIBC_2.14\0", b"\0GLIBC_2.9\0"]) == f"manylinux_2_14_{there}"
    assert platform_of([b"\0libc.so.6\0GLIBC_2.2.5\0"]) == f"manylinux_2_5_{there}"
    assert platform_of([b"\0libc.so.6\0libgomp.so.1\0GLIBC_2.14\0"]) == here
    assert platform_of([b"\0libc.musl-x86_64.so.1\0"]) == here


@pytest.mark.soak
def test_pip_installs_it_without_eomgen(tmp_path: Path) -> None:
    wheel = eomgen.export_wheel("one_link", tmp_path, Options(KERNELS))
    venv.create(tmp_path / "venv", with_pip=True)
    python = str(tmp_path / "venv/bin/python")
    packages = {Path(np.__file__).parents[1], Path(sysconfig.get_paths()["platlib"])}
    seen = tmp_path / "seen"
    seen.mkdir()
    for name in ("numpy", "numpy.libs", "cffi", "_cffi_backend*", "pycparser"):  # not eomgen, which is beside them
        for path in {path for place in packages for path in place.glob(name)}:
            (seen / path.name).symlink_to(path)
    subprocess.run([python, "-m", "pip", "install", "-q", "--no-index", "--no-deps", str(wheel)], check=True)
    command = [python, "-c", f"import sys; sys.path.append({str(seen)!r})\n{CALL}"]
    result = subprocess.run(command, cwd=tmp_path, env={}, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr
    kernel = eomgen.build("one_link", kernels=KERNELS)
    expected = kernel.forward_dynamics([0.1, 0.2], [0.3, 0.4], [0.0, 1.0])
    assert [float.fromhex(x) for x in result.stdout.split()] == expected.tolist()
