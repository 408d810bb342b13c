"""The command reduce: what it prints and writes, and what it refuses."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from eomgen.bending.element_files import arrays_of
from eomgen.bending.reduction import reduce
from eomgen.cli.entry import main
from tests.support import element_texts
from tests.support.finite_elements import bar, stress_of_bar

SMALL = {"counts": (3, 1, 1), "count": 2}


def test_it_prints_a_link_and_writes_its_constants(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    elements = bar(**SMALL)
    np.savez(tmp_path / "bar.npz", **arrays_of(elements))
    assert main(["reduce", str(tmp_path / "bar.npz"), "-o", str(tmp_path / "modes.npz")]) == 0
    text = capsys.readouterr().out
    assert "mass      12 kg, centre of mass [0.5, 0, 0] m" in text
    assert "interface tip at [1, 0, 0] m" in text
    assert f"wrote {tmp_path / 'modes.npz'}" in text
    assert np.array_equal(np.load(tmp_path / "modes.npz")["K"], reduce(elements).K)
    assert main(["reduce", str(tmp_path / "bar.npz"), "--modes", "1", "--craig-bampton", "--json"]) == 0
    values = json.loads(capsys.readouterr().out)
    assert values["modes"] == 7
    assert values["files"] == []
    assert values["velocity_terms"] == "exact"
    assert values["frequencies_hz"] == pytest.approx(reduce(bar(counts=(3, 1, 1), count=1)).frequencies.tolist())
    place = ["--placement", "0", "0", "0.5", "0", "0", str(np.pi / 2.0)]
    assert main(["reduce", str(tmp_path / "bar.npz"), *place, "--json"]) == 0
    values = json.loads(capsys.readouterr().out)
    assert values["com"] == pytest.approx([0.0, 0.5, 0.5], abs=1e-12)
    assert values["interfaces"]["tip"] == pytest.approx([0.0, 1.0, 0.5], abs=1e-12)


def test_it_reads_files_of_a_program_with_load_cases(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    elements = bar(**SMALL)
    names = element_texts.calculix(tmp_path, elements)
    words = [str(tmp_path / name) for name in names]
    cases = []
    for case, matrix in stress_of_bar(elements, counts=(3, 1, 1)).items():
        path = tmp_path / f"{case}.sti"
        found = matrix.tocoo()
        rows = zip(found.row.tolist(), found.col.tolist(), found.data.tolist(), strict=True)
        path.write_text("".join(f"{i + 1} {j + 1} {x!r}\n" for i, j, x in rows if i <= j))
        cases += ["--stress", f"{case}={path}"]
    sets = ["--root", "CLAMP", "--rigid", "tip=FLANGE@1,0,0", "--modes", "2"]
    assert main(["reduce", *words, *sets, *cases, "-o", str(tmp_path / "modes.npz")]) == 0
    assert "stiffening" not in capsys.readouterr().out
    arrays = np.load(tmp_path / "modes.npz")
    assert arrays["Q"].shape == (8, 8, 4, 3)
    assert arrays["interface_Psi"].shape == (1, 3, 8, 8)
    assert main(["reduce", *words, "--modes", "3"]) == 0
    assert "modes     3, free:" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["bar.npz", "-o", "modes.txt"], "output: 'modes.txt'; allowed: a path that ends in .npz"),
        (["bar.npz", "--rigid", "tip"], "rigid: 'tip'; allowed: NAME=SET"),
        (["bar.npz", "--stress", "body.x.x"], "stress: 'body.x.x'; allowed: CASE=FILE"),
        (["a.sti", "--mean", "tip=1", "--mean", "tip=2"], "mean: 'tip' is given twice; allowed: once"),
        (["none.npz"], "none.npz: cannot be read"),
        (["arm.step"], "files: arm.step; allowed: .npz (finite elements of eomgen); .sti, .mas, .dof (CalculiX)"),
    ],
)
def test_it_refuses_by_name(words: list[str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["reduce", *words]) == 1
    assert message in capsys.readouterr().err
