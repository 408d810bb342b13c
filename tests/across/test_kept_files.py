"""Files that eomgen wrote and somebody changed: results, sweeps, streams are refused with a place, or are right."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from copy import deepcopy
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen.cli import entry as cli
from eomgen.description.recorded import robot_from_record
from eomgen.errors import InputError, IntegrationStopped
from eomgen.forms.plain import parse_json, printable
from eomgen.results.kinds import KINDS, read
from eomgen.robot.record import record_of
from eomgen.simulation.contents import ARRAYS
from eomgen.sweep.contents import manifest_of, row_check
from eomgen.sweep.result import SweepResult
from eomgen.sweep.store import MANIFEST, ROWS, opened, read_manifest
from tests.support.fuzzing import ROOT, accepted, check_message
from tests.support.kept_files import (
    MEASURED,
    Raw,
    Sweep,
    changed,
    raw_kept,
    raw_result,
    raw_sweep,
    result_mutants,
    sample_result,
    sweep_mutants,
    with_check,
    write_raw,
    write_sweep,
)
from tests.support.mutations import ESC
from tests.support.optional import needs
from tests.support.refusals import refused
from tests.support.soak import WHOLE
from tests.support.surfaces import SURFACES

pytestmark = pytest.mark.usefixtures("unoptimised")


@pytest.fixture(scope="module")
def raw() -> Raw:
    return raw_result(sample_result())


@pytest.fixture(scope="module")
def sweep() -> Sweep:
    return raw_sweep()


def refusal(read: Callable[..., Any], *given: Any) -> str:
    """The message with which something is refused."""
    caught = refused(InputError, "", read, *given)
    check_message(caught)
    return str(caught)


def read_ones(surface: str, mutants: Iterable[tuple[str, Any, Any]], write: Callable[..., Path]) -> Iterator[Any]:
    """Names of mutants that are read, and their paths; the others are refused in words."""
    for name, *contents in mutants:
        path = write(*contents)
        try:
            found = accepted(SURFACES[surface], path)
        except Exception as error:
            raise AssertionError(name) from error
        if found is not None:
            yield name, path


# Results


def _accepted(raw: Raw, folder: Path, chosen: Callable[[str], bool], every: int) -> list[tuple[str, Path]]:
    """Changed results that are read, each in a file of its own."""
    mutants = [item for item in result_mutants(raw) if chosen(item[0])]
    mutants = [item for k, item in enumerate(mutants) if k % every == 0 or " all " in item[0]]
    paths = (folder / f"{k}.npz" for k in range(len(mutants)))
    found = list(read_ones("result", mutants, lambda *values: write_raw(next(paths), *values)))
    assert 0 < len(found) < len(mutants) / 2
    return found


def _is_quick(name: str) -> bool:
    return not name.startswith("meta (") or name.partition(")")[0].count(",") == 1


@pytest.mark.soak
def test_each_change_of_a_result_is_refused_or_read(raw: Raw, tmp_path: Path) -> None:
    accepted = dict(_accepted(raw, tmp_path, _is_quick, 3))
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
    for number, (name, path) in found:
        if number % (meta if name.startswith("meta") else array):
            continue
        for words in (["plot", "--format", "svg"], ["report", "--no-modes"], ["budget"]):
            out = tmp_path / "out" / {"plot": "plots", "report": "report.html"}.get(words[0], f"{words[0]}.svg")
            code = cli.main([words[0], str(path), *words[1:], "-o", str(out)])
            assert code in (0, 1), (name, words, capsys.readouterr().err[-2000:])
        assert ESC[0] not in capsys.readouterr().out


@pytest.mark.soak
def test_views_take_changed_results(raw: Raw, tmp_path: Path) -> None:
    needs("viser")
    from eomgen.pictures.browser import View

    for _, path in _accepted(raw, tmp_path, lambda name: True, 1)[:: 60 if WHOLE else 360]:
        with suppress(InputError):
            View(eomgen.load_result(path), port=8765).close()


def test_commands_refuse_what_is_no_result(raw: Raw, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bad = np.array(raw[1]["pose"])
    bad[1, 0, 3] = np.nan
    path = write_raw(tmp_path / "r.npz", raw[0], {**raw[1], "pose": bad})
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
    said = refusal(eomgen.load_result, path)
    assert said.startswith(f"{path}: ")
    assert message in said


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        ("robot", ESC, r"meta: robot: got '\\x1b[31mred"),
        ("tool", 3, "meta: tool: got 3; allowed: a value of type str"),
        ("info.steps", "many", "meta: info.steps: got 'many'; allowed: a value of type float"),
        ("info.steps", KeyError, "meta: info: got None for steps"),
        ("contacts.0.t", float("nan"), "meta: contacts[0].t: got nan; allowed: a finite number"),
        ("contacts.0.coordinate", "joint9.x", "contacts: got 'joint9.x'; allowed: each once, of 'joint1.x'"),
        ("robot_hash", "0", "robot_hash: got '0'; allowed: 64 hexadecimal digits"),
        ("scenario.duration", 10**400, "scenario.duration: got an integer of 1329 bits; allowed: a finite number"),
        ("scenario.wrenches.0.table.t.1", 0.0, "wrenches[0].table.t: got times that do not increase"),
        ("scenario.speed", 1, "scenario: 'speed' is unknown"),
        ("stopped.q", [0.0], "stopped: is not of these coordinates"),
        ("tool", "nobody", "description: its tool is not that of the result; allowed: the robot simulated"),
        ("description.links.0.mass", 10**400, "links[0].mass: got an integer of 1329 bits; allowed: a finite"),
        ("description.joints.0.parent", "nobody", "joints.joint1.parent: there is no link 'nobody'"),
    ],
)
def test_meta_is_what_it_is_declared_to_be(raw: Raw, tmp_path: Path, path: str, value: Any, message: str) -> None:
    file = write_raw(tmp_path / "r.npz", changed(raw[0], path, value), raw[1])
    assert message in refusal(eomgen.load_result, file)


def test_a_result_that_would_not_be_read_is_not_written(tmp_path: Path) -> None:
    result = sample_result()
    result.trajectory.q[2, 1] = np.inf
    with pytest.raises(InputError, match=r"the result cannot be saved: array q: got .*inf.* at \[2, 1\]"):
        result.save(tmp_path / "r.npz")
    assert not list(tmp_path.iterdir())
    record = changed(dict(sample_result().description), "links.0.mass", 2.0)
    with pytest.raises(InputError, match=r"is not written, since it cannot be read back: .* is not that of its hash"):
        replace(sample_result(), description=MappingProxyType(record)).save(tmp_path / "r.npz")
    assert not list(tmp_path.iterdir())


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
        refused(InputError, message, parse_json, text, "it", 1_000_000)


@pytest.mark.parametrize("kind", MEASURED)
def test_a_key_of_another_kind_is_named(kind: str, tmp_path: Path) -> None:
    """A list or a huge integer where there is none, in files of measurements."""
    text, arrays = raw_kept(kind)
    path = tmp_path / f"r{MEASURED[kind]}"
    read(KINDS[kind], write_raw(path, text, arrays))
    for key in text:
        for value in ([[1]], 10**400, {"a": []}):
            if (kind, key, value) == ("tolerance", "q", [[1]]):  # a pose
                continue
            caught = refused(InputError, "", read, KINDS[kind], write_raw(path, {**text, key: value}, arrays))
            assert f"{path.name}: " in str(caught)
            assert key in ("kind", "format", "description", "standard") or key in str(caught)


# Robots of records


def _record(name: str = "geared_arm") -> Any:
    return json.loads(json.dumps(record_of(eomgen.load_robot(name))))


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        ("name", "Not a name", "name: got 'Not a name'"),
        ("links.0.mass", -1.0, "links.column.mass: got -1.0; allowed: a number that is at least 0"),
        ("links.0.mass", 1e31, "links[0].mass: got 1e+31; allowed: a finite number of magnitude up to 1e+30"),
        ("links.1.name", "column", "links: the name 'column' is there twice"),
        ("joints.0.type", "hinge", "joints.waist.type: got 'hinge'"),
        ("joints.0.offset", [], "joints.waist.offset: got 0 numbers; allowed: 6"),
        ("joints.0.coordinates.w", {}, "'w' is no coordinate; allowed: x, y, z"),
        ("joints.0.placement.rotation", [[1, 0, 0]] * 3, "joints.waist.placement: the axes are no rotation"),
        ("joints.0.coordinates.gamma.further", {"cubik": 1.0}, "'cubik' is no number of a law"),
        ("joints.1.child", "nobody", "there is no link 'nobody'"),
        ("joints.1.child", "column", "already the child of joint"),
        ("joints.1.parent", "fore", "form a cycle"),
        ("joints", [], "no joint has this link as its child"),
        ("joints", _record()["joints"][::-1], "it comes before the joint of its parent"),
        ("frames.0.link", "nobody", "frames.tcp.link: there is no link 'nobody'"),
        ("tunable", ["links.*.colour"], "no parameter has this name"),
    ],
)
def test_robots_of_records_are_looked_at_as_those_of_files(path: str, value: Any, message: str) -> None:
    assert robot_from_record(_record(), "r") == eomgen.load_robot("geared_arm")
    assert message in refusal(robot_from_record, changed(_record(), path, value), "r")


def test_robots_that_were_read_with_a_warning_come_back(tmp_path: Path) -> None:
    text = (ROOT / "src/eomgen/robots/one_link.toml").read_text(encoding="utf-8")
    (tmp_path / "r.toml").write_text(text.replace("zz = 0.08", "zz = 8", 1), encoding="utf-8")
    with pytest.warns(eomgen.EomgenWarning, match="taken as it is"):
        robot = eomgen.load_robot(tmp_path / "r.toml", inertia="warn")
    assert robot_from_record(json.loads(json.dumps(record_of(robot))), "r") == robot


# Sweeps


def test_a_sweep_comes_back(sweep: Sweep, tmp_path: Path) -> None:
    found = SweepResult.load(write_sweep(tmp_path / "s", *sweep))
    assert found.index.tolist() == [0, 1, 2, 3, 4]
    assert not found.complete
    assert found.errors == {4: "InputError: no"}
    assert found.samples[0, 0] == 2.0 * sweep[1][0]["sample"][0]


@pytest.mark.parametrize("every", [4, pytest.param(1, marks=pytest.mark.soak)])
def test_each_change_of_a_sweep_is_refused_or_read(every: int, sweep: Sweep, tmp_path: Path) -> None:
    """With right checksums: what is left to the checks of values."""
    mutants = list(sweep_mutants(sweep))[::every]
    accepted = [name for name, _ in read_ones("sweep", mutants, lambda *x: write_sweep(tmp_path / "s", *x))]
    assert 0 < len(accepted) < len(mutants) / 2
    for name in accepted:
        assert "nan" not in name
        assert not name.startswith(("row is", "manifest is", "row ('sample'"))


def _opened(folder: Path, manifest: dict[str, Any]) -> None:
    with opened(folder, manifest, row_check(manifest_of(manifest, "here"))):
        pass


def _again(line: str, **values: Any) -> str:
    """A line of rows with other values, and their checksum."""
    row = {**json.loads(line), **values}
    row.pop("check")
    return json.dumps(with_check(row))


@pytest.mark.parametrize(
    ("number", "change", "message"),
    [
        (2, lambda line: line.replace("0.2", "0.3", 1), "its checksum is not that"),
        (1, lambda line: line.replace('"index": 0', '"index": 5'), "its checksum is not that"),
        (3, lambda line: line[:30], "is no JSON"),
        (6, lambda _: "[]", "its checksum is not that"),
        (6, lambda line: _again(line, record=[9.0, 9.0]), "sample 0 is there before with other numbers"),
        (1, lambda line: _again(line, index=6), "got the index 6; allowed: 0 to 5"),
        (1, lambda line: _again(line, index=5), "allowed: "),
        (1, lambda line: _again(line, index=0.0), "row: index: got 0.0; allowed: a value of type int"),
        (1, lambda line: _again(line, record=[1.0]), "allowed: 2 numbers, or an error"),
        (1, lambda line: _again(line, record=[1.0, float("nan")]), "record[1]: got nan; allowed"),
        (1, lambda line: _again(line, sample=[1.0, 1.5, 3.0]), "which seed and index make"),
        (1, lambda line: _again(line, colour="red"), "'colour' is unknown"),
    ],
)
def test_rows_that_were_changed_are_named(
    sweep: Sweep, tmp_path: Path, number: int, change: Callable[[str], str], message: str
) -> None:
    """A line, or one more behind the five, which begins as the first one."""
    folder = write_sweep(tmp_path / "s", *sweep)
    lines = (folder / ROWS).read_text(encoding="ascii").splitlines()
    lines[number - 1 : number] = [change(lines[(number - 1) % 5])]
    assert len(lines) == max(number, 5)
    (folder / ROWS).write_text("".join(f"{line}\n" for line in lines), encoding="ascii")
    manifest = read_manifest(folder)
    for said in (refusal(SweepResult.load, folder), refusal(_opened, folder, manifest)):
        assert f"{ROWS}: line {number} is damaged: " in said
        assert message in said


def test_a_manifest_that_was_changed_is_refused(sweep: Sweep, tmp_path: Path) -> None:
    folder = write_sweep(tmp_path / "s", *sweep)
    text = (folder / MANIFEST).read_text(encoding="ascii")
    assert '"m"' in text
    (folder / MANIFEST).write_text(text.replace('"m"', '"N"', 1), encoding="ascii")
    assert "was changed since it was written" in refusal(SweepResult.load, folder)
    write_sweep(folder, changed(sweep[0], "columns.0.unit", "N"), sweep[1])
    assert "'columns' is not what plan, scenario and robot make of it" in refusal(_opened, folder, sweep[0])


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
    assert "its rows have no checksums" in refusal(_opened, folder, sweep[0])
    write_sweep(folder, sweep[0], rows, seal=False)
    assert "its checksum is not that of its values" in refusal(SweepResult.load, folder)


@pytest.mark.parametrize("name", [MANIFEST, ROWS])
@pytest.mark.parametrize("make", [os.mkfifo, os.mkdir, lambda path: os.symlink("/dev/zero", path)])
def test_sweeps_of_no_files(sweep: Sweep, tmp_path: Path, name: str, make: Callable[[Path], None]) -> None:
    folder = write_sweep(tmp_path / "s", *sweep)
    (folder / name).unlink()
    make(folder / name)
    assert "allowed: a regular file" in refusal(SweepResult.load, folder)
    if name == ROWS:
        assert "allowed: a regular file" in refusal(_opened, folder, sweep[0])


def test_rows_have_a_limit(sweep: Sweep, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = write_sweep(tmp_path / "s", *sweep)
    monkeypatch.setenv("EOMGEN_SWEEP_MB", "1")
    with (folder / ROWS).open("ab") as stream:
        stream.truncate(2 << 20)
    refused(InputError, r"2097152 bytes; allowed: up to 1048576 .*EOMGEN_SWEEP_MB", SweepResult.load, folder)


# Streams


@pytest.fixture
def stream(tmp_path: Path) -> Path:
    needs("zarr")
    from eomgen.simulation.stream import MotionStream

    made = MotionStream(tmp_path / "s", ["a.x", "b.gamma"], 300, {"robot": "r"}, {"a.x.friction.z": "m"})
    t = np.linspace(0.0, 1.0, 200)
    made.append(t, np.outer(t, [1.0, 2.0]), np.outer(t, [3.0, 4.0]), 1e-5 * t[:, np.newaxis])
    made.flush()
    return tmp_path / "s"


@pytest.mark.parametrize(
    ("part", "path", "value", "message"),
    [
        ("t", "shape", [10**15], "allowed: float64 (1000000000000000, 2)"),
        ("q", "shape", [10**15, 2], "array q: is float64"),
        ("t", "shape", [True], "array t: shape[0]: got true"),
        ("t", "shape", KeyError, "the key 'shape' is missing"),
        ("v", "chunk_grid.configuration.chunk_shape", [10**12, 2], "array v: its chunks are"),
        ("q", "data_type", "string", "array q: is string"),
        ("", "attributes.coordinates", ["a.x", ESC], r"coordinates: got '\\x1b[31m"),
        ("", "attributes.coordinates", ["a.x", "a.x"], "allowed: each name once"),
        ("", "attributes.coordinates", ["a.x"], "units: got"),
        ("", "attributes.internal_states", ["a.x"], "internal_states: got 'a.x'; allowed: OWNER.LAW.STATE"),
        ("", "attributes.internal_states", ["a.x.b.c"] * 2, "internal_states: got 'a.x.b.c', 'a.x.b.c'"),
        ("", "attributes.internal_states", ["a.x.b.c", "a.x.b.d"], "internal_state_units: got 'm'"),
        ("", "attributes.internal_state_units", [ESC], r"internal_state_units: got '\\x1b[31m"),
        ("z", "shape", [10**15, 1], "array z: is float64"),
        ("", "attributes.units", ["m", "m"], "units: got 'm', 'm'"),
        ("q", "codecs.1.name", "gzip", "its codecs are others than eomgen's"),
        ("q", "chunk_key_encoding", {"name": "v2", "configuration": {"separator": "."}}, "names its chunks in another"),
        ("t", "chunk_key_encoding.configuration.separator", ".", "another way than eomgen; allowed: default"),
        ("", "attributes", KeyError, "allowed: a table"),
        ("", "attributes.format", 99, "newer eomgen"),
        ("", "attributes.meta.robot", float("inf"), "meta.robot: got inf"),
        ("", "attributes.meta.robot", json.loads("[" * 100 + "]" * 100), "nested too deeply"),
    ],
)
def test_streams_that_were_changed_are_refused(stream: Path, part: str, path: str, value: Any, message: str) -> None:
    assert eomgen.load_stream(stream).t.size == 200
    file = stream / part / "zarr.json"
    file.write_text(json.dumps(changed(json.loads(file.read_text()), path, value)), encoding="ascii")
    assert message in refusal(eomgen.load_stream, stream)


def test_sizes_of_streams_are_those_of_their_arrays(stream: Path) -> None:
    """A group's copy of the metadata of its arrays could have other sizes: it is not looked at."""
    group, arrays = (json.loads((stream / part / "zarr.json").read_text()) for part in ("", "q"))
    copies = {"q": {**arrays, "shape": [10**9, 2]}}
    group["consolidated_metadata"] = {"kind": "inline", "must_understand": False, "metadata": copies}
    (stream / "zarr.json").write_text(json.dumps(group))
    assert eomgen.load_stream(stream).q.shape == (200, 2)


@pytest.mark.parametrize("name", ["zarr.json", "t/zarr.json", "t/c/0", "q/c/0/0"])
def test_streams_of_no_files(stream: Path, name: str) -> None:
    (stream / name).unlink()
    os.mkfifo(stream / name)
    refused(InputError, "is no file; allowed", eomgen.load_stream, stream)


def test_chunks_that_become_larger_than_they_should_are_refused(stream: Path) -> None:
    """A few bytes of Zstandard that stand for a gigabyte."""
    from numcodecs.zstd import Zstd

    packed = [Zstd().encode(bytes(1 << 24)), Zstd().encode(b"few"), b"", b"\x28\xb5\x2f\xfd\x00\x00\x00", b"x" * 100]
    for data in packed:
        (stream / "q/c/0/0").write_bytes(data)
        refused(InputError, r"array q: chunk 0 has [0-9None]+ bytes; allowed: 4096, packed", eomgen.load_stream, stream)
