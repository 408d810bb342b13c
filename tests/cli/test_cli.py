"""Commands: what they print, where they write, their exit status and progress; completion in shells."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import time
from pathlib import Path
from threading import Event

import numpy as np
import pytest

import eomgen
from eomgen import files
from eomgen.authoring import new
from eomgen.bench import beside as bench
from eomgen.bending.element_files import arrays_of
from eomgen.bending.reduction import reduce
from eomgen.cli import entry
from eomgen.cli.completion import SHELLS
from eomgen.cli.shared.progress import progress_bar, stage_bar
from eomgen.description import load
from eomgen.description.builtin import builtin_robots
from eomgen.errors import InternalError
from eomgen.progress import told_in_lines
from eomgen.scenario.builtin import builtin_scenarios
from tests.support import element_texts
from tests.support.commands import command, errors_of, facts, run
from tests.support.finite_elements import bar, stress_of_bar
from tests.support.joint_table import joint_table
from tests.support.measured_poses import trial, write_csv
from tests.support.optional import needs
from tests.support.text_files import text_file

pytestmark = pytest.mark.usefixtures("unoptimised")

BAD_LINK = f"""
name = "bad"
[[links]]
name = "l"
mass = 1.0
inertia = {{ xx = 1.0, yy = 1.0, zz = 5.0 }}
{joint_table("j", "base", "l", "revolute")}
"""


def test_robots() -> None:
    assert [line.split()[0] for line in command("robots").splitlines()] == list(eomgen.builtin_robots())
    assert {"name": "puma560_elastic", "coordinates": 36, "links": 6} in facts("robots")


@pytest.mark.soak
def test_info_counts_zeros_and_says_why() -> None:
    out = command("info", "puma560_elastic")
    counts = ("36 coordinates", "lemma (7)", "sharper lemma", "23,976", "10,602", "eliminated in O(n)", "joint6.beta")
    for text in counts:
        assert text in out
    plain = facts("info", "one_link")
    assert plain["coordinates"] == ["joint1.x", "joint1.gamma"]
    assert plain["operations"] == eomgen.build("one_link", kernels="all").operations


def test_generate_writes_a_package_that_imports(tmp_path: Path) -> None:
    words = ("generate", "one_link", "-o", tmp_path / "made", "--kernels", "mass_matrix")
    assert command(*words).strip() == str(tmp_path / "made" / "one_link")
    code = "import one_link; print(one_link.mass_matrix([0.0, 0.0])[0, 0], one_link.load().n)"
    found = subprocess.run([sys.executable, "-c", code], cwd=tmp_path / "made", capture_output=True, text=True)
    assert found.stdout == "1.0 2\n", found.stderr
    for more, expected in (((), False), (("--cmake",), True), ((), False)):  # replaces its own
        command(*words, *more)
        for name in ("CMakeLists.txt", "one_link.hpp", "one_link.pc.in"):
            assert (tmp_path / "made" / "one_link" / name).exists() == expected


def test_generate_float32_and_single_kernels(tmp_path: Path) -> None:
    words = ("generate", "one_link", "-o", tmp_path, "--dtype", "float32")
    command(*words, "--kernels", "mass_matrix,energy", "--kernels", "residual")
    header = (tmp_path / "one_link" / "one_link.h").read_text()
    assert "const float *q" in header
    assert all(f"one_link_{name}(" in header for name in ("mass_matrix", "energy", "residual"))
    assert "forward_dynamics" not in header


def test_generate_says_what_a_package_lacks(tmp_path: Path) -> None:
    """And --kernels all has that, too."""
    words = ("generate", "one_link", "-o", tmp_path, "--levels", "v1")
    status, out, err = run(*words)
    assert (status, out.strip()) == (0, str(tmp_path / "one_link"))
    left = err.partition("note: without ")[2].partition(" and derivatives; --kernels takes")[0].split(", ")
    assert {"adaptive_rollout", "christoffel", "generalized_momentum"} <= set(left)
    header = tmp_path / "one_link" / "one_link.h"
    assert not any(f" one_link_{name}(" in header.read_text() for name in left)
    assert all(f" one_link_{name}(" in header.read_text() for name in ("mass_matrix", "reactions", "rollout"))
    status, again, err = run(*words, "--kernels", "all")
    assert (status, again, "note" in err) == (0, out, False)
    assert all(f" one_link_{name}(" in header.read_text() for name in (*left, "mass_matrix", "rollout"))


def test_simulate_writes_trajectory_and_plots_and_a_result_is_its_folder_or_its_file(tmp_path: Path) -> None:
    out, empty = tmp_path / "out", tmp_path / "empty"
    said = command("simulate", "one_link", "-o", out, "--duration", 0.2)
    written = [Path(line.removeprefix("wrote ")) for line in said.splitlines() if line.startswith("wrote ")]
    assert {path.suffix for path in written} == {".npz", ".png"}
    assert all(path.read_bytes().startswith(b"\x89PNG") for path in written if path.suffix == ".png")
    assert np.isfinite(eomgen.load_result(out / "trajectory.npz").trajectory.q).all()
    empty.mkdir()
    for words in (("budget",), ("modes", "one_link", "--points", 2, "--along"), ("linearize", "one_link", "--along")):
        assert command(*words, out) == command(*words, out / "trajectory.npz")
        assert "has no trajectory.npz" in command(*words, empty, code=1)


@pytest.mark.soak
def test_bench_compares_with_newton_euler(monkeypatch: pytest.MonkeyPatch) -> None:
    quick = bench.bench
    monkeypatch.setattr(bench, "bench", lambda robot, progress: quick(robot, repeat=2, progress=progress))
    out = command("bench", "one_link")
    for text in ("inverse_dynamics", "recursive Newton-Euler", "composite bodies", "articulated bodies", "ratio"):
        assert text in out


def test_inertia_policy(tmp_path: Path) -> None:
    path = text_file(tmp_path / "bad.toml", BAD_LINK)
    assert "--inertia" in command("info", path, code=1)
    for policy in ("warn", "project"):
        status, _, err = run("info", path, "--inertia", policy)
        assert status == 0
        assert err.startswith("note: ")


@pytest.mark.parametrize("error", [RuntimeError("boom"), InternalError("boom")])
def test_our_bug_is_status_70(error: Exception, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object, **__: object) -> None:
        raise error

    monkeypatch.setattr(load, "load_robot", fail)
    assert "boom" in command("info", "ur5", code=70)


@pytest.mark.soak
def test_a_reader_that_leaves_is_no_error() -> None:
    command = f"{sys.executable} -m eomgen info puma560_elastic | head -n 1"
    found = subprocess.run(["bash", "-o", "pipefail", "-c", command], capture_output=True, text=True)
    assert found.returncode in (0, 141)
    assert "Traceback" not in found.stderr


# Single precision


CHECK = ("check", "one_link", "--float32", "--kernels", "inverse_dynamics")


def test_check_says_what_single_precision_costs() -> None:
    said = command(*CHECK)
    assert said.startswith("one_link: ok: 1 links, 2 coordinates\n")
    assert "inverse_dynamics: joint1" in said
    assert " is off by " in said
    assert "dominant operations of joint1" in said


def test_check_prints_json_over_ranges() -> None:
    files = [facts(*CHECK, *more)[0] for more in ((), ("--range", "v", 0, 0.1))]
    assert [file["kind"] for file in files] == 2 * ["robot"]
    plain, slow = (file["float32"]["kernels"]["inverse_dynamics"]["outputs"]["joint1.x"] for file in files)
    assert slow["size"] < plain["size"]


def test_check_of_files_has_no_advice_on_what_cannot_be_used(tmp_path: Path) -> None:
    bad = text_file(tmp_path / "bad.toml", "name = 3\n")
    first, second = json.loads(run("check", bad, "one_link", "--float32", "--kernels", "energy", "--json")[1])
    assert "float32" not in first
    assert set(second["float32"]["kernels"]) == {"energy"}


# reduce


SMALL = {"counts": (3, 1, 1), "count": 2}


def test_it_prints_a_link_and_writes_its_constants(tmp_path: Path) -> None:
    elements, file = bar(**SMALL), tmp_path / "bar.npz"
    np.savez(file, **arrays_of(elements))
    text = command("reduce", file, "-o", tmp_path / "modes.npz")
    assert "mass      12 kg, centre of mass [0.5, 0, 0] m" in text
    assert "interface tip at [1, 0, 0] m" in text
    assert f"wrote {tmp_path / 'modes.npz'}" in text
    assert np.array_equal(np.load(tmp_path / "modes.npz")["K"], reduce(elements).K)
    values = facts("reduce", file, "--modes", 1, "--craig-bampton")
    assert (values["modes"], values["files"], values["velocity_terms"]) == (7, [], "exact")
    assert values["frequencies_hz"] == pytest.approx(reduce(bar(counts=(3, 1, 1), count=1)).frequencies.tolist())
    values = facts("reduce", file, "--placement", 0, 0, 0.5, 0, 0, np.pi / 2.0)
    assert values["com"] == pytest.approx([0.0, 0.5, 0.5], abs=1e-12)
    assert values["interfaces"]["tip"] == pytest.approx([0.0, 1.0, 0.5], abs=1e-12)


def test_it_reads_files_of_a_program_with_load_cases(tmp_path: Path) -> None:
    elements = bar(**SMALL)
    words = [tmp_path / name for name in element_texts.calculix(tmp_path, elements)]
    cases: list[str] = []
    for case, matrix in stress_of_bar(elements, counts=(3, 1, 1)).items():
        path = tmp_path / f"{case}.sti"
        found = matrix.tocoo()
        rows = zip(found.row.tolist(), found.col.tolist(), found.data.tolist(), strict=True)
        path.write_text("".join(f"{i + 1} {j + 1} {x!r}\n" for i, j, x in rows if i <= j))
        cases += ["--stress", f"{case}={path}"]
    sets = ("--root", "CLAMP", "--rigid", "tip=FLANGE@1,0,0", "--modes", 2)
    assert "stiffening" not in command("reduce", *words, *sets, *cases, "-o", tmp_path / "modes.npz")
    arrays = np.load(tmp_path / "modes.npz")
    assert arrays["Q"].shape == (8, 8, 4, 3)
    assert arrays["interface_Psi"].shape == (1, 3, 8, 8)
    assert "modes     3, free:" in command("reduce", *words, "--modes", 3)
    words = [tmp_path / name for name in element_texts.op4(tmp_path, elements)]
    assert "modes     3, free:" in command(
        "reduce", *words, "--modes", 3, "--matrix-name", "K=KAAX", "--matrix-name", "M=maax"
    )
    said = command("reduce", *words, "--matrix-name", "K=KXX", code=1)
    assert "matrices: no file has 'KXX'; allowed: 'KAAX', 'GOAT', 'MAAX'" in said


# Completion: bash itself is asked; zsh and fish get the same names


def script(shell: str) -> str:
    needs("shtab")
    return command("--completion", shell)


def completed(text: str, words: str, folder: Path) -> set[str]:
    """What bash offers in the place of the last of the words."""
    ask = f"""{text}
COMP_WORDS=({words}); [[ "{words}" == *" " ]] && COMP_WORDS+=("")
COMP_CWORD=$((${{#COMP_WORDS[@]}} - 1)); COMP_LINE="{words}"; COMP_POINT=${{#COMP_LINE}}
$(complete -p eomgen | sed 's/.*-F \\([^ ]*\\).*/\\1/') eomgen "${{COMP_WORDS[COMP_CWORD]}}" ""
printf '%s\\n' "${{COMPREPLY[@]}}"
"""
    done = subprocess.run(["bash", "-c", ask], capture_output=True, text=True, cwd=folder, check=False)
    assert done.returncode == 0, done.stderr
    return set(done.stdout.split())


def test_bash_completes_commands_robots_scenarios_options_and_files(tmp_path: Path) -> None:
    text = script("bash")
    if shutil.which("bash") is None:
        pytest.skip("there is no bash here")
    (tmp_path / "mine.toml").touch()
    files = {*builtin_robots(), "mine.toml"}
    for words, offered in (
        ("", {*entry.NAMES, "measure", "show"}),
        ("measure ", {"fit", "calibrate"}),
        ("measure calibrate ", files),
        *((f"{name} ", files) for name in ("info", "simulate", "modes", "bench", "export")),
        ("simulate puma560 --scenario ", {*builtin_scenarios(), "mine.toml"}),
        ("modes puma560 --u", {"--urdf-damping"}),
    ):
        assert completed(text, f"eomgen {words}", tmp_path) >= offered, words
    for words, offered in (
        ("excite ur5 --criterion ", {"D", "condition"}),
        ("measure calibrate ur5 p.csv --loss ", {"huber", "cauchy", "tukey"}),
        ("schema ", {"robot", "scenario", "plan"}),
        ("res", {"response"}),
        ("info pum", {"puma560", "puma560_elastic"}),
        ("plot out --format ", {"svg", "pdf", "png"}),
        ("check m", {"mine.toml"}),
    ):
        assert completed(text, f"eomgen {words}", tmp_path) == offered, words
    assert "--rates" not in completed(text, "eomgen excite ur5 --", tmp_path)


@pytest.mark.parametrize("shell", SHELLS)
def test_every_shell_knows_every_command_option_and_robot(shell: str) -> None:
    text = script(shell)
    for name in (*entry.NAMES, *builtin_robots(), *builtin_scenarios(), "no-plots", "urdf-damping"):
        assert name in text, name


def test_without_shtab_one_line_says_what_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "shtab", None)
    advice = 'pip install shtab, or pip install "eomgen[completion]"'
    said = f"eomgen: --completion needs shtab, which is not installed: {advice}\n"
    assert errors_of("--completion", "zsh") == said


# Progress where stderr is no terminal


def test_lines_of_long_work() -> None:
    lines: list[str] = []
    with told_in_lines("sweeping", lines.append, every=0.02) as report:
        report(0.0, "building")
        deadline = time.monotonic() + 10.0
        while not lines and time.monotonic() < deadline:
            time.sleep(0.005)
        report(0.25, "sample 3")
        count = len(lines)
        while len(lines) < count + 2 and time.monotonic() < deadline:
            time.sleep(0.005)
    assert lines[0] == "sweeping: building (0 s)"
    assert lines[-1].startswith("sweeping: 25 % sample 3 (")
    count = len(lines)
    time.sleep(0.06)
    assert len(lines) == count


def test_an_exception_of_who_says_the_lines_is_raised_behind_the_block() -> None:
    called = Event()

    def say(line: str) -> None:
        called.set()
        raise BrokenPipeError(line)

    with pytest.raises(BrokenPipeError, match="sweeping"), told_in_lines("sweeping", say, every=0.01):
        assert called.wait(10.0)
    with pytest.raises(ZeroDivisionError), told_in_lines("sweeping", say, every=0.01):
        raise ZeroDivisionError


def test_short_work_and_errors_say_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    with progress_bar("generating") as report:
        report(0.5, "half")
    with pytest.raises(ZeroDivisionError), stage_bar("generating") as stage:
        stage(str(1 // 0))
    assert capsys.readouterr().err == ""


# Files that are written: each of a format that eomgen reads is read back first

FILES = {  # a command, and the files of formats with a reader, in the order in which they are written
    "new": ("new other -o OUT/other.toml", "other.toml"),
    "new, scenario": ("new arm --scenario -o OUT/s.toml", "s.toml"),
    "new, plan": ("new arm --plan -o OUT/plan.toml", "plan.toml"),
    "new, tolerances": ("new arm --tolerances -o OUT/t.toml", "t.toml"),
    "new, dh": ("new other --dh table.csv --convention classic -o OUT/other.toml", "other.toml"),
    "simulate": ("simulate arm.toml --duration 0.05 --no-plots -o OUT", "trajectory.npz"),
    "feedforward": ("feedforward puma560 --scenario puma560_circle -o OUT/f.npz", "f.npz"),
    "response": ("response arm.toml --points 5 -o OUT/r.npz", "r.npz"),
    "linearize": ("linearize arm.toml -o OUT/l.npz", "l.npz"),
    "deflection, map": ("deflection arm.toml --map 0 0 0.5 1 0 0 0 0 0.1 --points 2 2 -o OUT/m.npz", "m.npz"),
    "deflection, csv": ("deflection arm.toml --matrix joint1 -o OUT/K.csv", "K.csv"),
    "deflection, mtx": ("deflection arm.toml --matrix joint1 -o OUT/K.mtx", "K.mtx"),
    "deflection, npz": ("deflection arm.toml --matrix joint1 -o OUT/K.npz", "K.npz"),
    "excite": (
        "excite arm.toml --duration 2 --harmonics 2 --starts 1 -o OUT/m.csv OUT/s.toml OUT/r.npz",
        "m.csv s.toml r.npz",
    ),
    "forces": ("forces arm.toml motion.csv -o OUT/f.npz", "f.npz"),
    "fit": ("fit arm.toml motion.csv -o OUT/f.json", "f.json"),
    "identify": ("identify arm.toml motion.csv --force --toml OUT/b.toml -o OUT/i.npz", "b.toml i.npz"),
    "calibrate": (
        "calibrate puma560 measured.csv --folds 0 --toml OUT/b.toml --urdf OUT/b.urdf -o OUT/c.npz",
        "b.toml b.urdf c.npz",
    ),
    "poses": ("poses arm.toml --count 5 --candidates 20 -o OUT/p.json", "p.json"),
    "tolerance": ("tolerance arm.toml tolerances.toml -o OUT/t.json", "t.json"),
    "accuracy": ("accuracy cycle1 cycle2 -o OUT/a.json", "a.json"),
    "compensate": (
        "compensate arm.toml --mode static --write-scenario OUT/s.toml -o OUT/c.npz",
        "s.csv s_wanted.csv s.toml c.npz",
    ),
    "reduce": ("reduce bar.npz -o OUT/modes.npz", "modes.npz"),
    "export, mjcf": ("export arm.toml --mjcf -o OUT/arm.xml", "arm.xml"),
}


@pytest.fixture(scope="module")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with what these commands read."""
    folder = tmp_path_factory.mktemp("inputs")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        command("new", "arm")
        command("new", "arm", "--tolerances", "-o", "tolerances.toml")
        command("excite", "arm.toml", "--duration", 2, "--harmonics", 2, "--starts", 1, "-o", "motion.csv")
        for name in ("cycle1", "cycle2"):
            command("simulate", "arm.toml", "--duration", 0.05, "--no-plots", "-o", name)
        write_csv(Path("measured.csv"), trial(eomgen.load_robot("puma560"), 0, 40).columns)
        Path("table.csv").write_text("joint,type,theta,d,a,alpha\nj1,revolute,0,0.1,0.3,0\n")
        np.savez("bar.npz", **arrays_of(bar(**SMALL)))
    return folder


@pytest.mark.parametrize("name", FILES)
def test_files_are_read_back_and_none_is_left_that_cannot_be(
    name: str, inputs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The second time, writers leave what no reader takes; an older file stays as it was."""
    if name == "export, mjcf":
        needs("mujoco")  # which reads them
    text, names = FILES[name]
    seen: list[str] = []

    def watched(path: Path, target: Path, read: files.Reader) -> None:
        seen.append(target.name)
        read_back(path, target, read)

    def spoiled(path: Path, target: Path, read: files.Reader) -> None:
        path.write_bytes(b"\0")
        read_back(path, target, read)

    read_back = files.read_back
    good, bad = tmp_path / "good", tmp_path / "bad"
    bad.mkdir()
    good.mkdir()
    monkeypatch.chdir(inputs)
    for module in (files, new):
        monkeypatch.setattr(module, "read_back", watched)
    command(*text.replace("OUT", str(good)).split())
    for module in (files, new):
        monkeypatch.setattr(module, "read_back", spoiled)
    assert seen == names.split()
    assert all((good / file).is_file() for file in seen)
    first = bad / seen[0]
    older = {} if name.startswith("new") else {first: b"older"}
    for path, data in older.items():
        path.write_bytes(data)
    said = command(*text.replace("OUT", str(bad)).split(), code=1)
    assert f"{first}: is not written, since it cannot be read back: " in said
    assert {path: path.read_bytes() for path in bad.iterdir()} == older
