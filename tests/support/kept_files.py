"""Files that eomgen writes and reads again, and their mutants: a result, the folder of a sweep.

What is handed out is raw: arrays, meta, manifest and lines, which nobody has checked.
"""

from __future__ import annotations

import json
import random
from collections.abc import Iterator, Mapping
from copy import deepcopy
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

import eomgen
from eomgen.errors import InputError
from eomgen.integration.accuracy.error_transport import GlobalError
from eomgen.integration.contacts import Contact
from eomgen.integration.trajectory import Trajectory
from eomgen.robot.model import build_model
from eomgen.robot.record import record_of, robot_hash, robot_of
from eomgen.scenario.load import scenario_from_toml
from eomgen.simulation.balance import EnergyBalance
from eomgen.simulation.contents import ARRAYS
from eomgen.simulation.result import SimulationResult
from eomgen.sweep.contents import SampleRow
from eomgen.sweep.design import Design
from eomgen.sweep.plan import Distribution
from eomgen.sweep.store import FORMAT, MANIFEST, ROWS, checksum, line_of
from tests.support.mutations import change_value

SCENARIO = """
duration = 0.5
initial = { q = { joint1 = 0.1 }, equilibrium = false }
motion = { type = "point_to_point", goal = [0.3] }
control = { type = "pd", kp = 10, kd = 1 }
[[wrenches]]
link = "link1"
rows = [[0, 0, 0, 1, 0, 0, 0], [1, 0, 0, 2, 0, 0, 0]]
[[payloads]]
link = "link1"
mass = 0.1
point = [1.0, 0.0, 0.0]
"""


def sample_result(name: str = "one_link", *, states: bool = False) -> SimulationResult:
    """A result of a robot that nobody simulated: a few samples of numbers that do not matter; with states of laws."""
    robot = eomgen.load_robot(name)
    model = build_model(robot)
    samples, n = 5, model.size
    t = np.linspace(0.0, 0.5, samples)
    q = np.sin(np.outer(t, np.arange(1.0, n + 1.0)))
    energy, pose = np.stack([t, 1.0 - t], axis=1), np.tile(np.eye(4), (samples, 1, 1))
    pose[:, 0, 3] = 1.0 + 1e-3 * t
    info = {"steps": 4, "evaluations": 9, "jacobians": 0, "wall_s": 0.1}
    names = model.coordinates
    contacts = (Contact(0.1, names[0], 1, True, 0.2),)
    driven = tuple(names[i] for i in model.driven)
    memory = tuple(f"{names[0]}.{law}.z" for law in ("friction", "maxwell.0")) if states else None
    z = None if memory is None else 1e-5 * np.sin(np.outer(t, [3.0, 5.0]))
    laws: dict[str, Any] = {"memory": memory, "memory_units": ("rad", "rad") if states else None, "z": z}
    estimate = GlobalError(
        coordinates=names,
        q_error=1e-6 * q,
        v_error=1e-6 * np.cos(q),
        z_error=None if z is None else 1e-3 * z,
        tool_error=1e-6 * pose[:, :3, 3],
        tool_rotation_error=1e-6 * t,
        unresolved=0.01,
    )
    end = {"q": q[-1].tolist(), "v": q[-1].tolist(), **({} if z is None else {"z": z[-1].tolist()})}
    return SimulationResult(
        robot=robot.name,
        trajectory=Trajectory(t, q, np.cos(q), 0.1 * q, energy, names, "rk4", info, contacts, **laws),
        program_coordinates=driven,
        program_q=q[:, list(model.driven)],
        tool=model.frames[0],
        pose=pose,
        program_pose=np.tile(np.eye(4), (samples, 1, 1)),
        notes=("a note",),
        versions=MappingProxyType({"eomgen": eomgen.__version__}),
        prescribed=tuple(names[i] for i in model.prescribed),
        robot_hash=robot_hash(robot),
        scenario=MappingProxyType(scenario_from_toml(SCENARIO).as_dict()),
        links=model.links,
        wrench=np.zeros((samples, len(model.links), 6)),
        balance=EnergyBalance(np.outer(t, np.arange(5.0)), energy),
        global_error=estimate,
        description=MappingProxyType(record_of(robot)),
        stopped=MappingProxyType({"reason": "why", "t": 0.5, "coordinate": names[0], **end}),
    )


Raw = tuple[dict[str, Any], dict[str, Any]]  # meta, arrays


def raw_result(result: SimulationResult, folder: Path) -> Raw:
    with np.load(result.save(folder / "whole.npz")) as data:
        arrays = {name: data[name] for name in data.files}
    return json.loads(str(arrays.pop("meta"))), arrays


def write_raw(path: Path, meta: object, arrays: Mapping[str, Any]) -> Path:
    np.savez(path, meta=meta if isinstance(meta, str) else json.dumps(meta), **arrays)
    return path


DEEP: Any = []
for _ in range(60):
    DEEP = [DEEP]
ESC = "\x1b[31mred\x1b[0m\u202e\n"
VALUES: tuple[Any, ...] = (
    *(None, True, -1, 10**400, 1e308, float("nan"), float("inf"), "", ESC, "text", [], {}, [1, 2], {"a": 1}),
    *([ESC], ["joint1.x", "joint1.x"], {ESC: ESC}, DEEP),
)


def paths_of(node: Any, deep: int = 12) -> Iterator[tuple[Any, ...]]:
    """Paths to everything in a tree; of arrays the first entry alone."""
    if not deep or not isinstance(node, (dict, list)):
        return
    for key in list(node) if isinstance(node, dict) else range(min(len(node), 1)):
        yield (key,)
        for rest in paths_of(node[key], deep - 1):
            yield (key, *rest)


def changed(tree: Any, path: tuple[Any, ...], value: Any) -> Any:
    """The tree with another value at a path; without it where the value is KeyError."""
    found = deepcopy(tree)
    node = found
    for key in path[:-1]:
        node = node[key]
    if value is KeyError:
        del node[path[-1]]
    else:
        node[path[-1]] = deepcopy(value)
    return found


def array_mutants(array: Any) -> Iterator[tuple[str, Any]]:
    yield "transposed", np.asarray(array).T.copy()
    row = np.atleast_1d(array)
    yield "longer", np.concatenate([row, row])
    yield "shorter", row[:-1]
    yield "empty", row[:0]
    yield "flat", np.asarray(array).reshape(-1)
    yield "deeper", np.asarray(array)[np.newaxis]
    yield "number", np.array(1.0)
    yield "texts", np.full(array.shape, ESC)
    yield "backwards", row[::-1].copy()
    yield "other byte order", array.astype(array.dtype.newbyteorder())
    for dtype in ("f4", "i8", "c16", "?"):
        yield dtype, np.ones(array.shape, dtype)
    for number in (np.nan, np.inf, -np.inf, 1e308, 1e149, -1e299):
        if array.dtype.kind == "f":
            whole, one = np.full(array.shape, number), array.copy()
            one.flat[-1] = number
            yield f"{number} once", one
            yield f"all {number}", whole
    if array.dtype.kind == "U" and array.size:
        for text in (ESC, "", "joint1", "joint9.x", "x" * 5000, str(row[0])):
            yield f"named {text[:9]!a}", np.array([text, *row[1:]])
            yield f"ends with {text[:9]!a}", np.array([*row[:-1], text])


def result_mutants(raw: Raw) -> Iterator[tuple[str, Any, dict[str, Any]]]:
    """Name, meta and arrays: each entry of meta, at every depth, and each array, changed in every way."""
    meta, arrays = raw
    for path in paths_of(meta):
        for value in (KeyError, *VALUES) if len(path) < 4 else (KeyError, None, 10**400, float("nan"), ESC, {}, []):
            yield f"meta {path} {value!a:.20}", _sealed_where(path, changed(meta, path, value)), arrays
    for text in ("", "[", "null", "3", "{}", "[" * 100_000, '{"format": 1' + "0" * 5000 + "}", "9" * 5000):
        yield f"meta is {text:.12}", text, arrays
    for name in arrays:
        yield f"without {name}", meta, {key: x for key, x in arrays.items() if key != name}
        for what, array in array_mutants(arrays[name]):
            yield f"{name} {what}", meta, {**arrays, name: array}
    for item in (item for item in ARRAYS if item.name in arrays):  # as a newer eomgen may add
        yield f"with more {item.name}", {**meta, "more": 1}, {**arrays, "more": arrays[item.name]}


def _sealed_where(path: tuple[Any, ...], meta: Any) -> Any:
    return sealed(meta) if path[0] == "description" else meta


def sealed(meta: Any) -> Any:
    """The meta with the hash of its robot, where it has one, so that nothing is refused for the hash alone."""
    try:
        return {**meta, "robot_hash": robot_hash(robot_of(meta["description"]))} if meta["robot_hash"] else meta
    except (InputError, KeyError, TypeError, AttributeError, ValueError):
        return meta


def random_result(raw: Raw, seed: int) -> tuple[Any, dict[str, Any]]:
    """Some random changes of meta and of arrays."""
    chance = random.Random(f"result {seed}")
    meta, arrays = deepcopy(raw[0]), dict(raw[1])
    for _ in range(chance.choice((0, 1, 1, 2, 3))):
        change_value(meta if chance.random() < 0.3 else _part(meta, chance), chance)
    if chance.random() < 0.5:
        name = chance.choice(list(arrays))
        arrays[name] = chance.choice([array for _, array in array_mutants(arrays[name])])
    return (sealed(meta) if chance.random() < 0.8 else meta), arrays


def _part(meta: dict[str, Any], chance: random.Random) -> dict[str, Any]:
    found = meta.get(chance.choice(("description", "scenario", "stopped", "info", "versions")))
    return found if isinstance(found, dict) else meta


# Folders of sweeps

DISTRIBUTIONS = (
    Distribution("normal", mean=1.0, deviation=0.1, low=0.5),
    Distribution("uniform", low=1.0, high=2.0),
    Distribution("grid", values=(3.0, 4.0)),
)
Sweep = tuple[dict[str, Any], list[dict[str, Any]]]  # manifest, rows; without checksums


def raw_sweep() -> Sweep:
    design = Design(DISTRIBUTIONS, 3, 7, "latin_hypercube")
    names = ("joints.joint1.x.stiffness", "links.link1.mass", "control.kd")
    manifest = {
        "format": FORMAT,
        "key": "0" * 64,
        "eomgen": eomgen.__version__,
        "robot": "one_link",
        "tool": "tcp",
        "samples": 6,
        "seed": 7,
        "design": "latin_hypercube",
        "draws": 3,
        "distributions": [item.as_dict() for item in DISTRIBUTIONS],
        "varied": [
            {"kind": "parameter", "name": name, "relative_to": 2.0 if i == 0 else None, "distribution": i}
            for i, name in enumerate(names)
        ],
        "columns": [{"name": "tool_deviation_max", "unit": "m"}, {"name": "drive_max.joint1.gamma", "unit": "N m"}],
        "scenario": {"duration": 0.5},
        "notes": ["a note"],
    }
    rows = []
    for i in (0, 2, 1, 4, 3):
        values = SampleRow(i, design.values(i), *(((0.1 * i, 2.0), "") if i != 4 else ((), "InputError: no")))
        row = line_of(values)
        rows.append({key: row[key] for key in row if key != "check"})
    return json.loads(json.dumps(manifest)), json.loads(json.dumps(rows))


def with_check(values: Any) -> Any:
    return {**values, "check": checksum(values)} if isinstance(values, dict) else values


def write_sweep(folder: Path, manifest: Any, rows: list[Any], *, seal: bool = True) -> Path:
    """A folder of these; with checksums that are right, or with those of the rows as they are."""
    folder.mkdir(exist_ok=True)
    (folder / MANIFEST).write_text(json.dumps(with_check(manifest)), encoding="ascii")
    lines = [json.dumps(with_check(row) if seal else row) for row in rows]
    (folder / ROWS).write_text("".join(f"{line}\n" for line in lines), encoding="ascii")
    return folder


def sweep_mutants(sweep: Sweep) -> Iterator[tuple[str, Any, list[Any]]]:
    """Name, manifest and rows; checksums are those of what was changed."""
    manifest, rows = sweep
    for path in paths_of(manifest):
        for value in (KeyError, *VALUES, 1, 10**12, 10**18):
            yield f"manifest {path} {value!a:.20}", changed(manifest, path, value), rows
    for value in VALUES:
        yield f"manifest is {value!a:.20}", value, rows
        yield f"row is {value!a:.20}", manifest, [*rows, value]
    for path in paths_of(rows[0]):
        for value in (KeyError, *VALUES, 5, 6, 3.25):
            yield f"row {path} {value!a:.20}", manifest, [changed(rows[0], path, value), *rows[1:]]


def random_sweep(sweep: Sweep, seed: int) -> tuple[Any, list[Any]]:
    """Some random changes of manifest and rows."""
    chance = random.Random(f"sweep {seed}")
    manifest, rows = deepcopy(sweep[0]), deepcopy(sweep[1])
    for _ in range(chance.choice((0, 1, 1, 2))):
        change_value(manifest, chance)
    for _ in range(chance.choice((0, 1, 1, 2))):
        change_value(chance.choice(rows), chance)
    if chance.random() < 0.2:
        rows.append(deepcopy(chance.choice(rows)))
    return manifest, rows


def heavier(result: SimulationResult) -> SimulationResult:
    """The result with a robot that is another one, and its hash."""
    record = json.loads(json.dumps(dict(result.description)))
    record["links"][0]["mass"] = 2.0
    return replace(result, description=MappingProxyType(record))
