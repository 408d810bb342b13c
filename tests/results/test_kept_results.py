"""Files of results that eomgen 0.1.0 wrote, one of each kind in ``kept``: they are read, with the values they had."""

from __future__ import annotations

import importlib.util
import json
import math
import re
from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen import identification
from eomgen.errors import InputError
from eomgen.identification.tolerances import solve
from eomgen.sweep.result import SweepResult
from tests.support.optional import needs
from tests.support.quick_builds import answer, python

pytestmark = pytest.mark.quick

KEPT = Path(__file__).parent / "kept"
VALUES = KEPT / "values.json"  # by file
READ: Mapping[str, Callable[[Path], Any]] = {
    "accuracy.json": identification.load_accuracy,
    "calibration.npz": identification.load_calibration,
    "compensation.npz": identification.load_compensation,
    "compliance_map.npz": eomgen.load_result,
    "excitation.npz": identification.load_excitation,
    "feedforward.npz": eomgen.load_result,
    "fit.json": identification.load_fit,
    "forces.npz": eomgen.load_result,
    "identification.npz": identification.load_identification,
    "poses.json": identification.load_poses,
    "simulation.npz": eomgen.simulation.load_result,
    "response.npz": eomgen.load_result,
    "state_space.npz": eomgen.load_result,
    "stable_inversion.npz": eomgen.load_result,
    "stream": eomgen.load_stream,
    "sweep": SweepResult.load,
    "tolerance.json": identification.load_tolerance,
}
_FOLLOW = ("model", "exact", "folder")  # from other values, or from where the file is


def values_of(found: Any) -> Any:
    """All values of a result as JSON holds them."""
    if is_dataclass(found):
        return {x.name: values_of(getattr(found, x.name)) for x in fields(found) if x.name not in _FOLLOW}
    if isinstance(found, np.ndarray):
        return values_of(found.tolist())
    if isinstance(found, Mapping):
        return {str(key): values_of(x) for key, x in found.items()}
    if isinstance(found, (list, tuple)):
        return [values_of(x) for x in found]
    if isinstance(found, complex):
        return [found.real, found.imag]
    return found


def assert_same(found: Any, kept: Any, place: str) -> None:
    """Numbers within round-off (some follow from others when a file is read), all else equal."""
    if isinstance(kept, dict):
        assert set(kept) <= set(found), place
        for key in kept:
            assert_same(found[key], kept[key], f"{place}.{key}")
    elif isinstance(kept, list):
        assert len(found) == len(kept), place
        for i, (ours, theirs) in enumerate(zip(found, kept, strict=True)):
            assert_same(ours, theirs, f"{place}[{i}]")
    elif isinstance(kept, float):
        same = math.isnan(found) if math.isnan(kept) else math.isclose(found, kept, rel_tol=1e-9, abs_tol=1e-12)
        assert same, (place, found, kept)
    else:
        assert found == kept, place


@pytest.mark.parametrize("name", READ)
def test_a_result_that_was_kept_is_read_with_its_values(name: str) -> None:
    if name == "stream":
        needs("zarr")
    found = READ[name](KEPT / name)
    kept = json.loads(VALUES.read_text(encoding="ascii"))[name]
    assert_same(values_of(found), kept, name)


def test_one_function_loads_them_all() -> None:
    """Files and folders say what they are; the kinds that are read by functions of their own are the same results."""
    for name, read in READ.items():
        if name != "stream" or importlib.util.find_spec("zarr"):
            found = eomgen.load_result(KEPT / name)
            assert type(found) is type(read(KEPT / name)), name
            assert_same(values_of(found), values_of(read(KEPT / name)), name)


@pytest.mark.parametrize("name", [name for name in READ if "." in name])
def test_a_result_that_is_saved_again_is_the_same(name: str, tmp_path: Path) -> None:
    found = eomgen.load_result(KEPT / name)
    again = eomgen.load_result(found.save(tmp_path / name))
    assert type(again) is type(found)
    assert_same(values_of(again), values_of(found), name)


@pytest.mark.xfail(
    strict=True,
    raises=InputError,
    reason="numbers that are not finite are looked for in the text, which has the robot's name: issue 67",
)
@pytest.mark.parametrize("robot", ["inf", "nan"])
@pytest.mark.parametrize("name", ["accuracy.json", "compensation.npz", "feedforward.npz", "fit.json", "poses.json"])
def test_the_name_of_a_robot_is_no_number(name: str, robot: str, tmp_path: Path) -> None:
    found = replace(eomgen.load_result(KEPT / name), robot=robot)
    assert eomgen.load_result(found.save(tmp_path / name)).robot == robot


@pytest.mark.xfail(
    strict=True,
    raises=pytest.fail.Exception,
    reason="load_tolerance computes the result again, so that it changes with the version: issue 67",
)
def test_a_result_of_tolerances_is_read_and_not_computed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(solve, "tolerance", lambda *_, **__: pytest.fail("it is computed again"))
    assert eomgen.load_result(KEPT / "tolerance.json").names


def test_what_is_no_result_is_refused_by_name(tmp_path: Path) -> None:
    (tmp_path / "other.json").write_text('{"kind": "mood"}', encoding="ascii")
    np.savez(tmp_path / "other.npz", x=np.zeros(3))
    (tmp_path / "folder").mkdir()
    for name, message in (
        ("other.json", "is no result that eomgen wrote (kind: 'mood'); allowed: those of 'accuracy', 'calibration'"),
        ("other.npz", "is not a saved simulation (meta is no text); allowed: a file that eomgen wrote"),
        ("nothing.npz", "cannot be read: "),
        (
            "folder",
            "holds no result; allowed: a folder that eomgen wrote, with trajectory.npz, sweep.json or",
        ),
    ):
        with pytest.raises(InputError) as caught:
            eomgen.load_result(tmp_path / name)
        assert f"{tmp_path / name}: {message}" in str(caught.value)


def test_a_fresh_process_knows_all_kinds_of_results() -> None:
    """Modules declare theirs where they are imported, and nothing else of eomgen was imported before."""
    folder = Path(eomgen.__file__).parent
    texts = [path.read_text(encoding="utf-8") for path in folder.rglob("*.py")]
    declared = {name for text in texts for name in re.findall(r'\bKind\(\s*"(\w+)"', text)}
    code = f"""
    import json, eomgen
    from eomgen.results.kinds import KINDS
    eomgen.load_result({str(KEPT / "fit.json")!r})
    print(json.dumps(sorted(KINDS)))
    """
    assert answer(python(code)) == sorted(declared)
    assert len(declared) > 12
