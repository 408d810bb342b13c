"""What may not get into a cached kernel: other people's files, damage, what belongs under another key."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import eomgen
from eomgen.errors import BuildError
from eomgen.pipeline import cache
from eomgen.pipeline.cache import VARIABLE, is_whole
from eomgen.pipeline.stages import load_kernel, make_package
from tests.support.quick_builds import BUILD, QUICK, Q, answer, as_new_process, one_link, python
from tests.support.refusals import refused
from tests.support.soak import soaked

posix = pytest.mark.skipif(not hasattr(os, "getuid"), reason="owners and modes as POSIX has them")
FOLDERS = ("", "packages", "sources", "locks", "packages/*", "sources/*")


def place(root: Path, name: str) -> Path:
    (found,) = root.glob(name) if "*" in name else [root / name]
    return found


@posix
@pytest.mark.parametrize("name", soaked(FOLDERS, ["", "packages/*"]))
def test_no_folder_of_the_cache_may_be_open_to_others(
    name: str, empty_cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = os.umask(0)  # the worst that a user may have
    try:
        one_link()
    finally:
        os.umask(before)
    assert all(path.lstat().st_mode & 0o022 == 0 for path in empty_cache.rglob("*") if path.suffix != ".lock")
    as_new_process(monkeypatch)
    folder = place(empty_cache, name)
    if name == "locks":
        shutil.rmtree(empty_cache / "packages")  # locks are looked at where something is built
    folder.chmod(0o720)
    with pytest.raises(BuildError) as error:
        one_link()
    assert f"the cache folder {folder} may be written by others (mode 720); run chmod go-w on it" in str(error.value)
    folder.chmod(0o700)
    assert one_link().n == 2


@pytest.mark.parametrize("name", FOLDERS)
def test_links_in_the_cache_are_refused(
    name: str, filled_cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    one_link()
    as_new_process(monkeypatch)
    folder, elsewhere = place(filled_cache, name), tmp_path / "elsewhere"
    folder.rename(elsewhere)
    folder.symlink_to(elsewhere)
    if name == "locks":
        shutil.rmtree(filled_cache / "packages")
    with pytest.raises(BuildError) as error:
        one_link()
    assert f"the cache folder {folder} is a link to {elsewhere}; remove it, or set {VARIABLE}" in str(error.value)


def test_links_above_the_cache_are_the_users(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A home that is somewhere else in truth."""
    (tmp_path / "disk").mkdir()
    (tmp_path / "home").symlink_to(tmp_path / "disk")
    monkeypatch.setenv(VARIABLE, str(tmp_path / "home" / "cache"))
    assert one_link().n == 2
    assert (tmp_path / "disk" / "cache" / "packages").is_dir()


@posix
@pytest.mark.skipif(hasattr(os, "geteuid") and os.geteuid() != 0, reason="only root can give files away")
@pytest.mark.parametrize("name", FOLDERS)
def test_folders_of_other_users_are_refused(name: str, filled_cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    one_link()
    as_new_process(monkeypatch)
    folder = place(filled_cache, name)
    if name == "locks":
        shutil.rmtree(filled_cache / "packages")
    os.chown(folder, 12345, -1)
    refused(BuildError, r"belongs to another user; set EOMGEN_CACHE_DIR to a folder of yours", one_link)


@posix
@pytest.mark.parametrize("name", FOLDERS)
def test_who_is_asked_for_the_owner(name: str, filled_cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The same without root: from where another user stands, and the files are not root's."""
    if os.getuid() == 0:
        pytest.skip("root's files are anybody's to use; see test_folders_of_other_users_are_refused")
    one_link()
    as_new_process(monkeypatch)
    monkeypatch.setattr(os, "getuid", lambda: 12345)
    refused(BuildError, r"belongs to another user", one_link)


@posix
@pytest.mark.parametrize("how", soaked(["open", "link", "pipe", "folder"], ["open", "link"]))
def test_files_that_others_may_have_written_are_made_again(
    how: str, filled_cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    expected = one_link().mass_matrix(Q)
    as_new_process(monkeypatch)
    (file,) = filled_cache.glob("packages/*/*.so")
    if how == "open":
        file.chmod(0o666)
    else:
        file.rename(tmp_path / "elsewhere.so")
        make: dict[str, Callable[[], None]] = {
            "link": lambda: file.symlink_to(tmp_path / "elsewhere.so"),
            "pipe": lambda: os.mkfifo(file, 0o600),
            "folder": lambda: file.mkdir(mode=0o700),
        }
        make[how]()
    assert not is_whole(file.parent)
    steps: list[str] = []
    assert np.array_equal(one_link(steps).mass_matrix(Q), expected)
    assert [step.split()[0] for step in steps] == ["compiling"]
    assert is_whole(file.parent)


def test_a_manifest_answers_for_itself(filled_cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One that lists less, another hash, or what is under another key, is not believed."""
    one_link()
    (package,) = (filled_cache / "packages").iterdir()
    path = package / "manifest.json"
    text = path.read_text()
    assert is_whole(package)
    shorter = json.loads(text)
    del shorter["files"]["one_link.c"]
    other = json.loads(text)
    (package / "one_link.h").write_text("/* other */")
    other["files"]["one_link.h"] = hashlib.sha256(b"/* other */").hexdigest()
    for changed in (shorter, other, {"files": shorter["files"]}, {}, [], None):
        path.write_text(json.dumps(changed))
        assert not is_whole(package)
    path.write_text(text)
    assert not is_whole(package)
    as_new_process(monkeypatch)
    one_link()
    elsewhere = package.with_name("0" * 64)
    shutil.copytree(package, elsewhere)
    assert is_whole(package)
    assert not is_whole(elsewhere)


def test_what_is_loaded_is_what_was_checked(filled_cache: Path) -> None:
    """Neither a file that changes after the check, nor compiled Python beside the files, which nobody checks."""
    robot, options = eomgen.load_robot("one_link"), QUICK
    expected = one_link().mass_matrix(Q)
    for name in [name for name in sys.modules if name.startswith("_eomgen_")]:
        del sys.modules[name]
    package = make_package(robot, options)
    (folder,) = (filled_cache / "packages").iterdir()
    for path in folder.rglob("*"):
        if path.is_file():
            path.write_bytes(b"")
    kernel = load_kernel(package, "one_link")
    assert np.array_equal(kernel.mass_matrix(Q), expected)
    assert not list(filled_cache.glob("packages/*/__pycache__"))
    assert not list(filled_cache.glob("loading-*"))


@pytest.mark.soak
def test_a_binary_that_is_overwritten_while_it_runs(filled_cache: Path) -> None:
    """In place, as a careless copy does it: a mapped file would take the process along."""
    code = f"""
        import json, eomgen
        from pathlib import Path
        kernel = eomgen.build(eomgen.load_robot("one_link"), kernels=("mass_matrix",), flags=("-O0",))
        (file,) = Path({str(filled_cache)!r}).glob("packages/*/*.so")
        with file.open("r+b") as stream:
            stream.truncate(0)
        print(json.dumps(kernel.mass_matrix({Q}).tolist()))
    """
    assert answer(python(code)) == answer(python(BUILD))


def test_where_no_copy_can_be_had_the_file_itself_is_loaded(
    filled_cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A full disk, or one that nobody may write to, keeps nobody from a kernel that is there."""
    expected = one_link().mass_matrix(Q)
    as_new_process(monkeypatch)

    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("tempfile.TemporaryDirectory", full)
    assert np.array_equal(one_link().mass_matrix(Q), expected)


def test_a_binary_that_does_not_load(filled_cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    package = make_package(eomgen.load_robot("one_link"), QUICK)
    files = {name: b"no binary" if name.endswith(".so") else data for name, data in package.files.items()}
    with pytest.raises(BuildError, match=r"the compiled module in .*packages.* does not load: "):
        load_kernel(cache.Entry("packages", "0" * 64, files), "one_link")


def test_what_killed_processes_left_is_removed(filled_cache: Path, tmp_path: Path) -> None:
    """Of the same key at once, of others after a day; nothing that may be in use, nothing else."""
    one_link()
    (package,) = (filled_cache / "packages").iterdir()
    old = time.time() - 100000.0
    for name in (f"making-{package.name}-a", f"damaged-{package.name}-b", "making-1-c", "loading-d", "mine"):
        (filled_cache / name / "build").mkdir(parents=True)
        if name != "making-1-c":
            os.utime(filled_cache / name, (old, old))
    fresh = filled_cache / f"making-{package.name}-e"
    fresh.mkdir()
    shutil.rmtree(package)
    for name in [name for name in sys.modules if name.startswith("_eomgen_")]:
        del sys.modules[name]
    one_link()
    assert sorted(path.name for path in filled_cache.iterdir()) == [
        "locks",
        "making-1-c",
        "mine",
        "packages",
        "sources",
    ]


def test_a_lock_that_nobody_lets_go_does_not_hold_up_others(
    filled_cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A process that was stopped, not killed: the others wait a while, then build for themselves."""
    from filelock import FileLock

    one_link()
    (package,) = (filled_cache / "packages").iterdir()
    shutil.rmtree(package)
    as_new_process(monkeypatch)
    monkeypatch.setattr(cache, "PATIENCE", 0.1)
    (filled_cache / f"making-{package.name}-of-the-stopped").mkdir()
    with FileLock(str(filled_cache / "locks" / f"{package.name}.lock")):
        assert one_link().n == 2
    assert is_whole(package)
    assert (filled_cache / f"making-{package.name}-of-the-stopped").exists()
