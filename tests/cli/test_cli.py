"""The command line: what it prints, where it writes, and its exit status."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import eomgen
from eomgen.cli import entry as cli
from eomgen.description import load
from eomgen.errors import InternalError

BAD_LINK = """
name = "bad"
[[links]]
name = "l"
mass = 1.0
inertia = { xx = 1.0, yy = 1.0, zz = 5.0 }
[[joints]]
name = "j"
parent = "base"
child = "l"
type = "revolute"
"""


def run(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str, str]:
    status = cli.main(arguments)
    printed = capsys.readouterr()
    return status, printed.out, printed.err


def test_robots(capsys: pytest.CaptureFixture[str]) -> None:
    status, out, _ = run(capsys, "robots")
    assert status == 0
    assert [line.split()[0] for line in out.splitlines()] == list(eomgen.builtin_robots())
    rows = json.loads(run(capsys, "robots", "--json")[1])
    assert {"name": "puma560_elastic", "coordinates": 36, "links": 6} in rows


@pytest.mark.soak
def test_info_counts_zeros_and_says_why(capsys: pytest.CaptureFixture[str]) -> None:
    status, out, _ = run(capsys, "info", "puma560_elastic")
    assert status == 0
    for text in (
        "36 coordinates",
        "lemma (7)",
        "sharper lemma",
        "23,976",
        "10,602",
        "eliminated in O(n)",
        "joint6.beta",
    ):
        assert text in out
    plain = json.loads(run(capsys, "info", "one_link", "--json")[1])
    assert plain["coordinates"] == ["joint1.x", "joint1.gamma"]
    assert plain["operations"] == eomgen.build("one_link", kernels="all").operations


@pytest.mark.usefixtures("unoptimised")
def test_generate_writes_a_package_that_imports(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ("generate", "one_link", "-o", str(tmp_path / "made"), "--kernels", "mass_matrix")
    status, out, _ = run(capsys, *words)
    assert status == 0
    assert out.strip() == str(tmp_path / "made" / "one_link")
    code = "import one_link; print(one_link.mass_matrix([0.0, 0.0])[0, 0], one_link.load().n)"
    found = subprocess.run([sys.executable, "-c", code], cwd=tmp_path / "made", capture_output=True, text=True)
    assert found.stdout == "1.0 2\n", found.stderr
    assert run(capsys, *words)[0] == 0  # replaces its own


def test_generate_for_cmake(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ("generate", "one_link", "-o", str(tmp_path), "--kernels", "mass_matrix")
    for more, expected in (((), False), (("--cmake",), True), ((), False)):
        assert run(capsys, *arguments, *more)[0] == 0
        for name in ("CMakeLists.txt", "one_link.hpp", "one_link.pc.in"):
            assert (tmp_path / "one_link" / name).exists() == expected


def test_generate_float32_and_single_kernels(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ("generate", "one_link", "-o", str(tmp_path), "--dtype", "float32")
    assert run(capsys, *arguments, "--kernels", "mass_matrix,energy", "--kernels", "residual")[0] == 0
    header = (tmp_path / "one_link" / "one_link.h").read_text()
    assert "const float *q" in header
    assert all(f"one_link_{name}(" in header for name in ("mass_matrix", "energy", "residual"))
    assert "forward_dynamics" not in header
    status, _, error = run(capsys, *arguments, "--kernels", "mass_matrix,engy")
    assert status == 1
    assert "kernels: 'engy' is unknown; allowed: mass_matrix" in error


def test_simulate_writes_trajectory_and_plots(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status, out, _ = run(capsys, "simulate", "one_link", "-o", str(tmp_path / "out"), "--duration", "0.2")
    assert status == 0
    written = [Path(line.removeprefix("wrote ")) for line in out.splitlines() if line.startswith("wrote ")]
    assert {path.suffix for path in written} == {".npz", ".png"}
    assert all(path.read_bytes().startswith(b"\x89PNG") for path in written if path.suffix == ".png")
    result = eomgen.load_result(tmp_path / "out" / "trajectory.npz")
    assert np.isfinite(result.trajectory.q).all()


def test_a_result_is_its_folder_or_its_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(capsys, "simulate", "one_link", "-o", str(tmp_path), "--duration", "0.1", "--no-plots")[0] == 0
    for words in (("budget",), ("modes", "one_link", "--points", "2", "--along"), ("linearize", "one_link", "--along")):
        folder, file = (run(capsys, *words, str(path)) for path in (tmp_path, tmp_path / "trajectory.npz"))
        assert folder == file
        assert folder[0] == 0
        (tmp_path / "empty").mkdir(exist_ok=True)
        assert "has no trajectory.npz" in run(capsys, *words, str(tmp_path / "empty"))[2]


@pytest.mark.soak
def test_bench_compares_with_newton_euler(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    from eomgen.bench import beside as bench

    quick = bench.bench
    monkeypatch.setattr(bench, "bench", lambda robot, progress: quick(robot, repeat=2, progress=progress))
    status, out, _ = run(capsys, "bench", "one_link")
    assert status == 0
    for text in ("inverse_dynamics", "recursive Newton-Euler", "composite bodies", "articulated bodies", "ratio"):
        assert text in out


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("info", "pumma560"), ("pumma560", "puma560")),
        (("info", "missing.toml"), ("missing.toml",)),
        (("generate", "one_link", "-o", "/dev/null/x"), ("/dev/null/x",)),
        (("simulate", "ur5", "--goal", "1"), ("goal", "6 numbers")),
        (("simulate", "ur5", "--duration", "-1"), ("duration", "-1.0")),
    ],
)
def test_wrong_input_is_status_1_without_traceback(
    arguments: tuple[str, ...], words: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    status, out, err = run(capsys, *arguments)
    assert (status, out) == (1, "")
    assert "Traceback" not in err
    for word in words:
        assert word in err


@pytest.mark.parametrize("arguments", [(), ("nonsense",), ("info",), ("info", "ur5", "--inertia", "guess"), ("bench",)])
def test_wrong_usage_is_status_2(arguments: tuple[str, ...]) -> None:
    with pytest.raises(SystemExit) as left:
        cli.main(arguments)
    assert left.value.code == 2


def test_inertia_policy(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "bad.toml"
    path.write_text(BAD_LINK)
    status, _, err = run(capsys, "info", str(path))
    assert status == 1
    assert "--inertia" in err
    for policy in ("warn", "project"):
        status, _, err = run(capsys, "info", str(path), "--inertia", policy)
        assert status == 0
        assert err.startswith("note: ")


@pytest.mark.parametrize("error", [RuntimeError("boom"), InternalError("boom")])
def test_our_bug_is_status_70(
    error: Exception, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise error

    monkeypatch.setattr(load, "load_robot", fail)
    status, _, err = run(capsys, "info", "ur5")
    assert status == 70
    assert "boom" in err


@pytest.mark.soak
def test_a_reader_that_leaves_is_no_error() -> None:
    command = f"{sys.executable} -m eomgen info puma560_elastic | head -n 1"
    found = subprocess.run(["bash", "-o", "pipefail", "-c", command], capture_output=True, text=True)
    assert found.returncode in (0, 141)
    assert "Traceback" not in found.stderr
