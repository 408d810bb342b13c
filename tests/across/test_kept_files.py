"""Files that eomgen wrote and somebody changed: results, sweeps, streams are refused with a place, or are right."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen.cli import entry as cli
from eomgen.description.recorded import robot_from_record
from eomgen.errors import InputError, IntegrationStopped
from eomgen.forms.plain import parse_json, printable
from eomgen.pictures.measured.kinds import PAGES, page_of
from eomgen.results.kinds import KINDS as DECLARED
from eomgen.results.kinds import read
from eomgen.robot.record import record_of
from eomgen.simulation.contents import ARRAYS
from eomgen.sweep.contents import manifest_of, row_check
from eomgen.sweep.result import SweepResult
from eomgen.sweep.store import MANIFEST, ROWS, opened, read_manifest
from tests.support import fuzzing
from tests.support.kept_files import (
    ESC,
    Raw,
    Sweep,
    changed,
    heavier,
    raw_result,
    raw_sweep,
    result_mutants,
    sample_result,
    sweep_mutants,
    with_check,
    write_raw,
    write_sweep,
)
from tests.support.kept_fuzzing import KINDS, MEASURED, loaded
from tests.support.measured_results import RESULTS, loaded_measured, raw_measured, write_measured
from tests.support.soak import WHOLE

pytestmark = pytest.mark.usefixtures("unoptimised")

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def raw(tmp_path_factory: pytest.TempPathFactory) -> Raw:
    return raw_result(sample_result(), tmp_path_factory.mktemp("raw"))


# Results


def _accepted(raw: Raw, folder: Path, chosen: Callable[[str], bool], every: int) -> list[tuple[str, Path]]:
    """Mutants that are read, each in a file of its own; the others are refused in words."""
    found, count = [], 0
    for name, meta, arrays in result_mutants(raw):
        count += chosen(name)
        if chosen(name) and count % every == 0:
            path = write_raw(folder / f"{len(found)}.npz", meta, arrays)
            try:
                if loaded(eomgen.load_result, path) is not None:
                    found.append((name, path))
            except Exception as error:
                raise AssertionError(name) from error
    assert 0 < len(found) < count / every / 2
    return found


def _is_quick(name: str) -> bool:
    return not name.startswith("meta (") or name.partition(")")[0].count(",") == 1


def test_each_change_of_a_result_is_refused_or_read(raw: Raw, tmp_path: Path) -> None:
    accepted = dict(_accepted(raw, tmp_path, _is_quick, 2))
    for name in accepted:
        assert "nan" not in name
        assert " inf" not in name
        assert not name.startswith("without ") or name in ("without work", "without wrench", "without rotating")
    assert {f"with more {item.name}" for item in ARRAYS} & set(accepted)
    pictures = [name for name in accepted if name.startswith(("pose all", "q all", "t all", "energy all", "pose -1e"))]
    assert pictures
    for name in pictures:
        assert cli.main(["plot", str(accepted[name]), "-o", str(tmp_path / "plots"), "--format", "svg"]) in (0, 1), name


@pytest.mark.soak
def test_commands_take_each_changed_result(raw: Raw, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Arrays, and fewer entries of meta, that are read go through all commands, which find no bug of ours."""
    found = enumerate(_accepted(raw, tmp_path, lambda name: True, 1))
    meta, array = (6, 1) if WHOLE else (36, 6)
    accepted = [item for i, item in found if i % (meta if item[0].startswith("meta") else array) == 0]
    for number, (name, path) in enumerate(accepted):
        for words in (["plot", "--format", "svg"], ["report", "--no-modes"], ["budget"]):
            out = tmp_path / "out" / {"plot": "plots", "report": "report.html"}.get(words[0], f"{words[0]}.svg")
            code = cli.main([words[0], str(path), *words[1:], "-o", str(out)])
            assert code in (0, 1), (name, words, capsys.readouterr().err[-2000:])
        if number % 20 == 0:
            _check_view(path)
        assert ESC[0] not in capsys.readouterr().out
    with capsys.disabled():
        print(f"\n{len(accepted)} changed results that are read go through plot, report and budget")


def _check_view(path: Path) -> None:
    pytest.importorskip("viser")
    from eomgen.pictures.browser import View

    with suppress(InputError):
        View(eomgen.load_result(path), port=8765).close()


def test_commands_refuse_what_is_no_result(raw: Raw, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    meta, arrays = raw
    bad = arrays["pose"].copy()
    bad[1, 0, 3] = np.nan
    path = write_raw(tmp_path / "r.npz", meta, {**arrays, "pose": bad})
    for command in ("plot", "report", "view", "budget"):
        assert cli.main([command, str(path)]) == 1
        assert f"{path}: array pose: got " in capsys.readouterr().err


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("coordinates", np.array(["joint1.x", "joint1.x"]), "coordinates: got 'joint1.x', 'joint1.x'; allowed: each"),
        ("coordinates", np.array(["joint1.x", ESC]), r"coordinates: got '\x1b[31mred"),
        ("units", np.array(["m", "m"]), "units: got 'm', 'm'; allowed: 'm', 'rad'"),
        ("program_coordinates", np.array(["joint1.y"]), "program_coordinates: got 'joint1.y'; allowed: each once, of"),
        ("t", np.zeros(5), "array t: got 0 after 0; allowed: increasing times"),
        ("q", np.zeros((5, 3)), "array q: got the shape (5, 3); allowed: (T, n), which is (5, 2) here"),
        ("v", np.zeros((5, 2), np.float32), "array v: got the dtype float32; allowed: float64"),
        ("u", np.full((5, 2), 1e305), "array u: got 1e+305 at [0, 0]; allowed: finite numbers of magnitude"),
        ("work", np.zeros((5, 4)), "array work: got the shape (5, 4); allowed: (T, 5)"),
        ("wrench", np.zeros((5, 2, 6)), "array wrench: got the shape (5, 2, 6); allowed: (T, links, 6)"),
    ],
)
def test_arrays_are_what_they_are_declared_to_be(raw: Raw, tmp_path: Path, name: str, value: Any, message: str) -> None:
    path = write_raw(tmp_path / "r.npz", raw[0], {**raw[1], name: value})
    with pytest.raises(InputError) as caught:
        eomgen.load_result(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert message in str(caught.value)


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        (("robot",), ESC, r"meta: robot: got '\\x1b[31mred"),
        (("tool",), 3, "meta: tool: got 3; allowed: a value of type str"),
        (("info", "steps"), "many", "meta: info.steps: got 'many'; allowed: a value of type float"),
        (("info", "steps"), KeyError, "meta: info: got None for steps"),
        (("contacts", 0, "t"), float("nan"), "meta: contacts[0].t: got nan; allowed: a finite number"),
        (("contacts", 0, "coordinate"), "joint9.x", "contacts: got 'joint9.x'; allowed: each once, of 'joint1.x'"),
        (("robot_hash",), "0", "robot_hash: got '0'; allowed: 64 hexadecimal digits"),
        (("scenario", "duration"), 10**400, "scenario.duration: got an integer of 1329 bits; allowed: a finite number"),
        (("scenario", "wrenches", 0, "table", "t", 1), 0.0, "wrenches[0].table.t: got times that do not increase"),
        (("scenario", "speed"), 1, "scenario: 'speed' is unknown"),
        (("stopped", "q"), [0.0], "stopped: is not of these coordinates"),
        (("tool",), "nobody", "description: its tool is not that of the result; allowed: the robot simulated"),
        (("description", "links", 0, "mass"), 10**400, "links[0].mass: got an integer of 1329 bits; allowed: a finite"),
        (("description", "joints", 0, "parent"), "nobody", "joints.joint1.parent: there is no link 'nobody'"),
    ],
)
def test_meta_is_what_it_is_declared_to_be(
    raw: Raw, tmp_path: Path, path: tuple[Any, ...], value: Any, message: str
) -> None:
    file = write_raw(tmp_path / "r.npz", changed(raw[0], path, value), raw[1])
    with pytest.raises(InputError) as caught:
        eomgen.load_result(file)
    assert message in str(caught.value)


def test_a_result_that_would_not_be_read_is_not_written(tmp_path: Path) -> None:
    result = sample_result()
    result.trajectory.q[2, 1] = np.inf
    with pytest.raises(InputError, match=r"the result cannot be saved: array q: got .*inf.* at \[2, 1\]"):
        result.save(tmp_path / "r.npz")
    assert not list(tmp_path.iterdir())
    path = heavier(sample_result()).save(tmp_path / "r.npz")
    with pytest.raises(InputError, match="is not that of its hash"):
        eomgen.load_result(path)


def test_why_a_motion_stopped_is_said_where_its_result_cannot_be_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def stop(*_: object, **__: object) -> None:
        error = IntegrationStopped("joint1.x diverged", 0.1, np.zeros(2), np.zeros(2), "joint1.x")
        error.result = sample_result()
        error.result.trajectory.v[3, 0] = 1e200
        raise error

    monkeypatch.setattr("eomgen.simulation.run.simulate", stop)
    assert cli.main(["simulate", "one_link", "-o", str(tmp_path / "out")]) == 1
    said = capsys.readouterr().err
    assert "the result cannot be saved: array v: got " in said
    assert "eomgen: joint1.x diverged" in said


def test_texts_of_a_result_are_printable(raw: Raw, tmp_path: Path) -> None:
    """Names are refused; notes and the like are shown with what a terminal would act on escaped."""
    path = write_raw(tmp_path / "r.npz", {**raw[0], "notes": [ESC]}, raw[1])
    assert eomgen.load_result(path).notes == (r"\x1b[31mred\x1b[0m\u202e\n",)
    assert printable("plain \N{GREEK SMALL LETTER ALPHA}") == "plain \N{GREEK SMALL LETTER ALPHA}"


def test_json_is_measured_before_it_is_read() -> None:
    assert parse_json('{"a": [1, 2]}', "it", 10_000) == {"a": [1, 2]}
    for text, message in (
        ("[" + "[]," * 10_000 + "[]]", "it: its values may take [0-9]+ bytes; allowed: up to 1000000"),
        ("[" * 3000 + "]" * 3000, "it: is nested too deeply"),
        ("[1", "it: is no JSON"),
        ("1" * 5000, "it: is no JSON"),
    ):
        with pytest.raises(InputError, match=message):
            parse_json(text, "it", 1_000_000)


# Robots of records


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        (("name",), "Not a name", "name: got 'Not a name'"),
        (("links", 0, "mass"), -1.0, "links.column.mass: got -1.0; allowed: a number that is at least 0"),
        (("links", 0, "mass"), 1e31, "links[0].mass: got 1e+31; allowed: a finite number of magnitude up to 1e+30"),
        (("links", 1, "name"), "column", "links: the name 'column' is there twice"),
        (("joints", 0, "type"), "hinge", "joints.waist.type: got 'hinge'"),
        (("joints", 0, "offset"), [], "joints.waist.offset: got 0 numbers; allowed: 6"),
        (("joints", 0, "coordinates", "w"), {}, "'w' is no coordinate; allowed: x, y, z"),
        (
            ("joints", 0, "placement", "rotation"),
            [[1, 0, 0]] * 3,
            "joints.waist.placement: the axes are no rotation",
        ),
        (("joints", 0, "coordinates", "gamma", "further"), {"cubik": 1.0}, "'cubik' is no number of a law"),
        (("joints", 1, "child"), "nobody", "there is no link 'nobody'"),
        (("joints", 1, "child"), "column", "already the child of joint"),
        (("joints", 1, "parent"), "fore", "form a cycle"),
        (("joints",), [], "no joint has this link as its child"),
        (("frames", 0, "link"), "nobody", "frames.tcp.link: there is no link 'nobody'"),
        (("tunable",), ["links.*.colour"], "no parameter has this name"),
    ],
)
def test_robots_of_records_are_looked_at_as_those_of_files(path: tuple[Any, ...], value: Any, message: str) -> None:
    record = json.loads(json.dumps(record_of(eomgen.load_robot("geared_arm"))))
    assert robot_from_record(record, "r") == eomgen.load_robot("geared_arm")
    with pytest.raises(InputError) as caught:
        robot_from_record(changed(record, path, value), "r")
    assert message in str(caught.value)
    fuzzing.check_message(caught.value)


def test_joints_of_records_come_from_the_base_on() -> None:
    record = json.loads(json.dumps(record_of(eomgen.load_robot("geared_arm"))))
    record["joints"].reverse()
    with pytest.raises(InputError, match="it comes before the joint of its parent"):
        robot_from_record(record, "r")


def test_robots_that_were_read_with_a_warning_come_back(tmp_path: Path) -> None:
    text = (ROOT / "src/eomgen/robots/one_link.toml").read_text(encoding="utf-8")
    (tmp_path / "r.toml").write_text(text.replace("zz = 0.08", "zz = 8", 1), encoding="utf-8")
    with pytest.warns(eomgen.EomgenWarning, match="taken as it is"):
        robot = eomgen.load_robot(tmp_path / "r.toml", inertia="warn")
    assert robot_from_record(json.loads(json.dumps(record_of(robot))), "r") == robot


# Sweeps


@pytest.fixture(scope="module")
def sweep() -> Sweep:
    return raw_sweep()


def test_a_sweep_comes_back(sweep: Sweep, tmp_path: Path) -> None:
    found = SweepResult.load(write_sweep(tmp_path / "s", *sweep))
    assert found.index.tolist() == [0, 1, 2, 3, 4]
    assert not found.complete
    assert found.errors == {4: "InputError: no"}
    assert found.samples[0, 0] == 2.0 * sweep[1][0]["sample"][0]


@pytest.mark.parametrize("every", [4, pytest.param(1, marks=pytest.mark.soak)])
def test_each_change_of_a_sweep_is_refused_or_read(every: int, sweep: Sweep, tmp_path: Path) -> None:
    """With right checksums: what is left to the checks of values."""
    accepted, count = [], 0
    for name, manifest, rows in list(sweep_mutants(sweep))[::every]:
        path, count = write_sweep(tmp_path / "s", manifest, rows), count + 1
        try:
            if loaded(SweepResult.load, path) is not None:
                accepted.append(name)
        except Exception as error:
            raise AssertionError(name) from error
    assert 0 < len(accepted) < count / 2
    for name in accepted:
        assert "nan" not in name
        assert not name.startswith(("row is", "manifest is", "row ('sample'"))


def _edited(line: str, old: str, new: str) -> str:
    assert old in line
    return line.replace(old, new, 1)


@pytest.mark.parametrize(
    ("change", "number", "message"),
    [
        (lambda lines: [lines[0], _edited(lines[1], "0.2", "0.3"), *lines[2:]], 2, "its checksum is not that"),
        (lambda lines: [_edited(lines[0], '"index": 0', '"index": 5'), *lines[1:]], 1, "its checksum is not that"),
        (lambda lines: [*lines[:2], lines[2][:30], *lines[3:]], 3, "is no JSON"),
        (lambda lines: [*lines, "[]"], 6, "its checksum is not that"),
        (lambda lines: [*lines, _again(lines[0], record=[9.0, 9.0])], 6, "sample 0 is there before with other numbers"),
        (lambda lines: [_again(lines[0], index=6), *lines[1:]], 1, "got the index 6; allowed: 0 to 5"),
        (lambda lines: [_again(lines[0], index=5), *lines[1:]], 1, "allowed: "),
        (
            lambda lines: [_again(lines[0], index=0.0), *lines[1:]],
            1,
            "row: index: got 0.0; allowed: a value of type int",
        ),
        (lambda lines: [_again(lines[0], record=[1.0]), *lines[1:]], 1, "allowed: 2 numbers, or an error"),
        (lambda lines: [_again(lines[0], record=[1.0, float("nan")]), *lines[1:]], 1, "record[1]: got nan; allowed"),
        (lambda lines: [_again(lines[0], sample=[1.0, 1.5, 3.0]), *lines[1:]], 1, "which seed and index make"),
        (lambda lines: [_again(lines[0], colour="red"), *lines[1:]], 1, "'colour' is unknown"),
    ],
)
def test_rows_that_were_changed_are_named(
    sweep: Sweep, tmp_path: Path, change: Callable[[list[str]], list[str]], number: int, message: str
) -> None:
    folder = write_sweep(tmp_path / "s", *sweep)
    lines = change((folder / ROWS).read_text(encoding="ascii").splitlines())
    (folder / ROWS).write_text("".join(f"{line}\n" for line in lines), encoding="ascii")
    manifest = read_manifest(folder)
    for loaded_by in (lambda: SweepResult.load(folder), lambda: _opened(folder, manifest)):
        with pytest.raises(InputError) as caught:
            loaded_by()
        assert f"{ROWS}: line {number} is damaged: " in str(caught.value)
        assert message in str(caught.value)
        fuzzing.check_message(caught.value)


def _opened(folder: Path, manifest: dict[str, Any]) -> None:
    with opened(folder, manifest, row_check(manifest_of(manifest, "here"))):
        pass


def _again(line: str, **values: Any) -> str:
    row = {**json.loads(line), **values}
    row.pop("check")
    return json.dumps(with_check(row))


def test_a_manifest_that_was_changed_is_refused(sweep: Sweep, tmp_path: Path) -> None:
    folder = write_sweep(tmp_path / "s", *sweep)
    text = (folder / MANIFEST).read_text(encoding="ascii")
    (folder / MANIFEST).write_text(_edited(text, '"m"', '"N"'), encoding="ascii")
    with pytest.raises(InputError, match="was changed since it was written"):
        SweepResult.load(folder)
    changed_units = changed(sweep[0], ("columns", 0, "unit"), "N")
    write_sweep(folder, changed_units, sweep[1])
    with pytest.raises(InputError, match="'columns' is not what plan, scenario and robot make of it"):
        _opened(folder, sweep[0])


def test_folders_without_checksums_are_read_and_not_gone_on_with(sweep: Sweep, tmp_path: Path) -> None:
    """Format 1, as it was: all other checks hold."""
    manifest, rows = deepcopy(sweep)
    manifest["format"] = 1
    for key in ("draws", "distributions"):
        del manifest[key]
    for item in manifest["varied"]:
        del item["distribution"]
    folder = write_sweep(tmp_path / "s", manifest, rows, seal=False)
    (folder / MANIFEST).write_text(json.dumps(manifest), encoding="ascii")
    assert SweepResult.load(folder).index.tolist() == [0, 1, 2, 3, 4]
    with pytest.raises(InputError, match="its rows have no checksums"):
        _opened(folder, sweep[0])
    write_sweep(folder, sweep[0], rows, seal=False)
    with pytest.raises(InputError, match="its checksum is not that of its values"):
        SweepResult.load(folder)


@pytest.mark.parametrize("name", [MANIFEST, ROWS])
def test_sweeps_of_no_files(sweep: Sweep, tmp_path: Path, name: str) -> None:
    folder = write_sweep(tmp_path / "s", *sweep)
    for make in (os.mkfifo, os.mkdir, lambda path: os.symlink("/dev/zero", path)):
        (folder / name).unlink()
        make(folder / name)
        with pytest.raises(InputError, match="allowed: a regular file"):
            SweepResult.load(folder)
        if name == ROWS:
            with pytest.raises(InputError, match="allowed: a regular file"):
                _opened(folder, sweep[0])
        (folder / name).rmdir() if (folder / name).is_dir() else (folder / name).unlink()
        (folder / name).touch()


def test_rows_have_a_limit(sweep: Sweep, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = write_sweep(tmp_path / "s", *sweep)
    monkeypatch.setenv("EOMGEN_SWEEP_MB", "1")
    with (folder / ROWS).open("ab") as stream:
        stream.truncate(2 << 20)
    with pytest.raises(InputError, match=r"2097152 bytes; allowed: up to 1048576 .*EOMGEN_SWEEP_MB"):
        SweepResult.load(folder)


# Streams


def _stream(folder: Path) -> Path:
    from eomgen.simulation.stream import MotionStream

    stream = MotionStream(folder, ["a.x", "b.gamma"], 300, {"robot": "r"}, {"a.x.friction.z": "m"})
    t = np.linspace(0.0, 1.0, 200)
    stream.append(t, np.outer(t, [1.0, 2.0]), np.outer(t, [3.0, 4.0]), 1e-5 * t[:, np.newaxis])
    stream.flush()
    return folder


STREAM_CHANGES: dict[str, tuple[str, tuple[Any, ...], Any, str]] = {
    "huge shape": ("t", ("shape",), [10**15], "allowed: float64 (1000000000000000, 2)"),
    "huge shape and chunks": ("q", ("shape",), [10**15, 2], "array q: is float64"),
    "shape of a flag": ("t", ("shape",), [True], "array t: shape[0]: got true"),
    "no shape": ("t", ("shape",), KeyError, "the key 'shape' is missing"),
    "huge chunks": ("v", ("chunk_grid", "configuration", "chunk_shape"), [10**12, 2], "array v: its chunks are"),
    "texts": ("q", ("data_type",), "string", "array q: is string"),
    "other names": ("", ("attributes", "coordinates"), ["a.x", ESC], r"coordinates: got '\\x1b[31m"),
    "names twice": ("", ("attributes", "coordinates"), ["a.x", "a.x"], "allowed: each name once"),
    "more names": ("", ("attributes", "coordinates"), ["a.x"], "units: got"),
    "other states": ("", ("attributes", "memory"), ["a.x"], "memory: got 'a.x'; allowed: OWNER.LAW.STATE"),
    "states twice": ("", ("attributes", "memory"), ["a.x.b.c"] * 2, "memory: got 'a.x.b.c', 'a.x.b.c'"),
    "more states": ("", ("attributes", "memory"), ["a.x.b.c", "a.x.b.d"], "memory_units: got 'm'"),
    "units of no state": ("", ("attributes", "memory_units"), [ESC], r"memory_units: got '\\x1b[31m"),
    "huge states": ("z", ("shape",), [10**15, 1], "array z: is float64"),
    "other units": ("", ("attributes", "units"), ["m", "m"], "units: got 'm', 'm'"),
    "other codecs": ("q", ("codecs", 1, "name"), "gzip", "its codecs are others than eomgen's"),
    "no attributes": ("", ("attributes",), KeyError, "allowed: a table"),
    "newer": ("", ("attributes", "format"), 99, "newer eomgen"),
    "infinite meta": ("", ("attributes", "meta", "robot"), float("inf"), "meta.robot: got inf"),
    "deep meta": ("", ("attributes", "meta", "robot"), json.loads("[" * 100 + "]" * 100), "nested too deeply"),
}


@pytest.mark.parametrize("name", STREAM_CHANGES)
def test_streams_that_were_changed_are_refused(name: str, tmp_path: Path) -> None:
    pytest.importorskip("zarr")
    folder = _stream(tmp_path / "s")
    assert eomgen.load_stream(folder).t.size == 200
    part, path, value, message = STREAM_CHANGES[name]
    file = folder / part / "zarr.json"
    file.write_text(json.dumps(changed(json.loads(file.read_text()), path, value)), encoding="ascii")
    with pytest.raises(InputError) as caught:
        eomgen.load_stream(folder)
    assert message in str(caught.value)
    fuzzing.check_message(caught.value)


@pytest.mark.parametrize("name", ["zarr.json", "t/zarr.json", "t/c/0", "q/c/0/0"])
def test_streams_of_no_files(name: str, tmp_path: Path) -> None:
    pytest.importorskip("zarr")
    folder = _stream(tmp_path / "s")
    (folder / name).unlink()
    os.mkfifo(folder / name)
    with pytest.raises(InputError, match="is no file; allowed"):
        eomgen.load_stream(folder)


def test_chunks_that_become_larger_than_they_should_are_refused(tmp_path: Path) -> None:
    """A few bytes of Zstandard that stand for a gigabyte."""
    pytest.importorskip("zarr")
    from numcodecs.zstd import Zstd

    folder = _stream(tmp_path / "s")
    for data in (
        Zstd().encode(bytes(1 << 24)),
        Zstd().encode(b"few"),
        b"",
        b"\x28\xb5\x2f\xfd\x00\x00\x00",
        b"x" * 100,
    ):
        (folder / "q/c/0/0").write_bytes(data)
        with pytest.raises(InputError, match=r"array q: chunk 0 has [0-9None]+ bytes; allowed: 4096, packed"):
            eomgen.load_stream(folder)


# At random


def _fuzzed(kind: str, first: int, count: int) -> dict[str, Any]:
    command = [sys.executable, "-m", "tests.support.kept_fuzzing", kind, str(first), str(count)]
    found = subprocess.run(command, capture_output=True, text=True, cwd=ROOT)
    assert found.returncode == 0, found.stderr[-6000:]
    report: dict[str, Any] = json.loads(found.stdout)
    assert report["slowest"] < fuzzing.SECONDS
    assert count / 50 < report["accepted"] < count * 0.7
    return report


@pytest.mark.soak
@pytest.mark.parametrize("kind", ["result", "sweep"])
def test_random_changes_are_refused_or_read(kind: str) -> None:
    _fuzzed(kind, 10_000_000, 80)


@pytest.mark.parametrize("kind", MEASURED)
def test_random_changes_of_measurements_are_refused_by_file_and_key(kind: str, tmp_path: Path) -> None:
    begun = KINDS[kind](tmp_path)
    for seed in range(15):
        begun(seed)
    text, arrays = raw_measured(kind, tmp_path)
    assert loaded_measured(kind, write_measured(tmp_path, text, arrays)) is not None
    for key in text:  # a list or a huge integer where there is none
        for value in ([[1]], 10**400, {"a": []}):
            if (kind, key, value) == ("tolerance", "q", [[1]]):  # a pose
                continue
            changed_text = {**text, key: value}
            with pytest.raises(InputError) as caught:
                read(DECLARED[kind], write_measured(tmp_path, changed_text, arrays))
            assert "r.npz: " in str(caught.value) or "r.json: " in str(caught.value)
            if key not in ("kind", "format", "description", "standard"):
                assert key in str(caught.value)


def test_files_of_every_kind_are_changed_at_random() -> None:
    """A kind that is declared has a sample here, a file among those that are kept, and a page."""
    assert set(DECLARED) == set(RESULTS)
    kept = {path.stem for path in (ROOT / "tests/results/kept").iterdir()}
    assert set(DECLARED) <= kept
    measured = {kind.result for kind in DECLARED.values() if "identification" in kind.result.__module__}
    assert measured <= set(PAGES)


@pytest.mark.soak
@pytest.mark.parametrize("kind", [kind for kind in MEASURED if DECLARED[kind].result in PAGES])
def test_pages_of_changed_measurements(kind: str, tmp_path: Path) -> None:
    """What is read can be drawn as a page."""
    begun, accepted = KINDS[kind](tmp_path), 0
    for seed in range(1_000_000, 1_000_400 if WHOLE else 1_000_160):
        found = begun(seed)
        accepted += found is not None
        if found is not None:
            assert page_of(found).html()
    assert accepted > 8


@pytest.mark.soak
@pytest.mark.parametrize(
    ("kind", "many"), [("result", 20_000), ("sweep", 50_000), *((kind, 5_000) for kind in MEASURED)]
)
def test_many_random_changes(kind: str, many: int) -> None:
    count = many if WHOLE else many // 12
    report = _fuzzed(kind, 0, count)
    print(f"\n{count} of {kind}: {report['accepted']} accepted, slowest {report['slowest']:.3f} s, {report['peak']} MB")
