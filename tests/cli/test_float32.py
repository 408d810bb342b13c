"""The options of check and generate about single precision."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from eomgen.cli.entry import main

WITHIN = "--float32-within"
CHECK = ("check", "one_link", "--float32", "--kernels", "inverse_dynamics")


def test_check_says_what_single_precision_costs(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(CHECK) == 0
    said = capsys.readouterr().out
    assert said.startswith("one_link: ok: 1 links, 2 coordinates\n")
    assert "inverse_dynamics: joint1.gamma is off by at most" in said
    assert "joint1.gamma comes from:" in said


def test_check_prints_json_over_ranges(capsys: pytest.CaptureFixture[str]) -> None:
    found = []
    for more in ((), ("--range", "v", "0", "0.1"), (WITHIN, "2e-7")):
        assert main([*CHECK, *more, "--json"]) == 0
        (file,) = json.loads(capsys.readouterr().out)
        found.append(file["float32"]["kernels"]["inverse_dynamics"])
        assert file["kind"] == "robot"
    plain, slow, mixed = found
    assert plain["ranges"]["v:joint1.gamma"] == [-3.0, 3.0]
    assert slow["ranges"]["v:joint1.gamma"] == [0.0, 0.1]
    assert slow["outputs"]["joint1.x"]["bound"] < plain["outputs"]["joint1.x"]["bound"]
    assert mixed["in_double"] > plain["in_double"] == 0


def test_check_of_files_has_no_advice_on_what_cannot_be_used(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bad = tmp_path / "bad.toml"
    bad.write_text("name = 3\n", encoding="ascii")
    assert main(["check", str(bad), "one_link", "--float32", "--kernels", "energy", "--json"]) == 1
    first, second = json.loads(capsys.readouterr().out)
    assert "float32" not in first
    assert set(second["float32"]["kernels"]) == {"energy"}


@pytest.mark.parametrize(("words", "said"), [
    (("check", "one_link", "--range", "q", "0", "1"), "--range: given without --float32; allowed: with it"),
    (("check", "one_link", "--kernels", "energy"), "--kernels: given without --float32; allowed: with it"),
    (("check", "one_link", WITHIN, "1e-6"), f"{WITHIN}: given without --float32; allowed: with it"),
    ((*CHECK, WITHIN, "1e-9"), "within: 1e-09; allowed: an error by the size of results, from 1.2e-07 to 1"),
    ((*CHECK, "--range", "joint7.x", "0", "1"), "range of 'joint7.x': no such input"),
    (("generate", "one_link", WITHIN, "1e-6"), f"{WITHIN}: given without --dtype float32; allowed: with it"),
    (("generate", "one_link", "--range", "q", "0", "1"), "--range: given without --dtype float32; allowed: with it"),
    (("generate", "one_link", "--simt", "--dtype", "float32", WITHIN, "1e-6"), f"--simt stands without {WITHIN}"),
])  # fmt: skip
def test_options_that_do_not_fit_are_refused(
    words: tuple[str, ...],
    said: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(words) == 1
    assert said in " ".join(capsys.readouterr().err.split())
    assert not list(tmp_path.iterdir())


@pytest.mark.soak
def test_a_generated_package_is_mixed_and_says_so(tmp_path: Path) -> None:
    words = (
        "generate",
        "geared_arm",
        "--dtype",
        "float32",
        "--kernels",
        "inverse_dynamics",
        WITHIN,
        "1e-5",
    )
    assert main([*words, "--native", "-o", str(tmp_path)]) == 0
    about = json.loads((tmp_path / "geared_arm" / "geared_arm.json").read_text(encoding="ascii"))["float32"]
    assert 0 < about["inverse_dynamics"]["in_double"] < about["inverse_dynamics"]["operations"]
    assert about["inverse_dynamics"]["bound"] <= 1e-5 * about["inverse_dynamics"]["size"]
    header = (tmp_path / "geared_arm" / "geared_arm.h").read_text(encoding="ascii")
    assert " operations in double\n" in header
    assert "(double)" in (tmp_path / "geared_arm" / "geared_arm.c").read_text(encoding="ascii")
