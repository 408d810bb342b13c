"""Files that eomgen writes and reads again: one right file of each kind, as raw values, and their systematic changes.

Raw values are plain values and arrays that nobody has checked; ``packed`` and ``write_sweep`` make files of them.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Iterator, Mapping
from copy import deepcopy
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

import eomgen
from eomgen.errors import InputError
from eomgen.identification import Estimate, FittedEntry, FittedMatrix
from eomgen.integration.contacts import Contact
from eomgen.integration.reference_motions import GlobalError
from eomgen.integration.trajectory import Trajectory
from eomgen.robot.model import build_model
from eomgen.robot.record import record_of, robot_hash, robot_of
from eomgen.scenario.load import scenario_from_toml
from eomgen.simulation.balance import EnergyBalance
from eomgen.simulation.contents import ARRAYS
from eomgen.simulation.result import SimulationResult
from eomgen.sweep.store import MANIFEST, ROWS, checksum
from tests.support.mutations import ESC, Chance, array_mutants, change_arrays, change_value, npz

KEPT = Path(__file__).parents[1] / "results" / "kept"  # files that the first version wrote
MEASURED = {path.stem: path.suffix for path in sorted(KEPT.glob("*.*")) if path.stem not in ("simulation", "values")}
Raw = tuple[Any, Mapping[str, Any] | None]  # meta, and arrays of an .npz
Sweep = tuple[Any, list[Any]]  # manifest and rows, without checksums
SCENARIO = """
duration = 0.5
initial = { q = { joint1 = 0.1 }, equilibrium = false }
motion = { type = "point_to_point", goal = [0.3] }
control = { type = "pd", kp = 10, kd = 1 }
wrenches = [{ link = "link1", rows = [[0, 0, 0, 1, 0, 0, 0], [1, 0, 0, 2, 0, 0, 0]] }]
payloads = [{ link = "link1", mass = 0.1, point = [1.0, 0.0, 0.0] }]
"""


def sample_result(name: str = "one_link", *, states: bool = False) -> SimulationResult:
    """Return a result that nobody simulated: a few samples of numbers that do not matter; with internal states."""
    robot = eomgen.load_robot(name)
    model = build_model(robot)
    names, n, t = model.coordinates, 5, np.linspace(0.0, 0.5, 5)
    q = np.sin(np.outer(t, np.arange(1.0, model.size + 1.0)))
    energy, pose = np.stack([t, 1.0 - t], axis=1), np.tile(np.eye(4), (n, 1, 1))
    pose[:, 0, 3] = 1.0 + 1e-3 * t
    z = 1e-5 * np.sin(np.outer(t, [3.0, 5.0])) if states else None
    laws: dict[str, Any] = {}
    if states:
        owners = tuple(f"{names[0]}.{law}.z" for law in ("friction", "maxwell.0"))
        laws = {"internal_states": owners, "internal_state_units": ("rad", "rad"), "z": z}
    end = {"q": q[-1].tolist(), "v": q[-1].tolist(), **({} if z is None else {"z": z[-1].tolist()})}
    info = {"steps": 4, "evaluations": 9, "jacobians": 0, "wall_s": 0.1}
    contacts = (Contact(0.1, names[0], 1, True, 0.2),)
    return SimulationResult(
        robot=robot.name,
        trajectory=Trajectory(t, q, np.cos(q), 0.1 * q, energy, names, "rk4", info, contacts, **laws),
        program_coordinates=tuple(names[i] for i in model.driven),
        program_q=q[:, list(model.driven)],
        tool=model.frames[0],
        pose=pose,
        program_pose=np.tile(np.eye(4), (n, 1, 1)),
        notes=("a note",),
        versions=MappingProxyType({"eomgen": eomgen.__version__}),
        prescribed=tuple(names[i] for i in model.prescribed),
        robot_hash=robot_hash(robot),
        scenario=MappingProxyType(scenario_from_toml(SCENARIO).as_dict()),
        links=model.links,
        wrench=np.zeros((n, len(model.links), 6)),
        balance=EnergyBalance(np.outer(t, np.arange(5.0)), energy),
        global_error=GlobalError(
            coordinates=names,
            q_error=1e-6 * q,
            v_error=1e-6 * np.cos(q),
            z_error=None if z is None else 1e-3 * z,
            tool_error=1e-6 * pose[:, :3, 3],
            tool_rotation_error=1e-6 * t,
            unresolved=0.01,
        ),
        description=MappingProxyType(record_of(robot)),
        stopped=MappingProxyType({"reason": "why", "t": 0.5, "coordinate": names[0], **end}),
    )


def kept_result(kind: str) -> Any:
    """Return the result of that kind among those that are kept, with what files of the first version do not have."""
    found = eomgen.load_result(KEPT / f"{kind}{MEASURED[kind]}")
    if kind == "fit":
        size = Estimate(1100.0, 20.0, 1060.0, 1140.0, 1000.0, 0.02, 0.013)
        entries, rows = (FittedEntry("x.x", size), FittedEntry("x.beta", size)), ((1100.0, 1100.0), (1100.0, 1e6))
        held = FittedMatrix(
            "mount", "stiffness", ("x", "beta"), entries, rows, (), ("beta.beta",), 0.5, 0.1, "bushings"
        )
        return replace(found, matrices=(held,))
    if kind == "state_space":
        law = "joint1.gamma.friction.z"
        return replace(
            found,
            A=np.array([[0.0, 1.0, 0.0], [-2.0, -0.5, -9.0], [0.0, 1.0, 0.0]]),
            B=np.array([[0.0], [1.0], [0.0]]),
            C=np.array([[1.0, 0.0, 0.0]]),
            states=("joint1.gamma", "joint1.gamma.rate", law),
            internal_states=(law,),
            z=np.array([1e-5]),
        )
    return found


def raw_result(result: Any, ending: str = ".npz") -> Raw:
    """Return the values and arrays of a result as its file has them."""
    with tempfile.TemporaryDirectory() as folder:
        path = result.save(Path(folder) / f"whole{ending}")
        if ending == ".json":
            return json.loads(path.read_text()), None
        with np.load(path) as data:
            arrays = {name: data[name] for name in data.files}
    return json.loads(str(arrays.pop("meta"))), arrays


@cache
def raw_kept(kind: str) -> Raw:
    return raw_result(kept_result(kind), MEASURED[kind])


def packed(raw: Raw, chance: Chance | None = None) -> bytes:
    """Return the file of raw values; a text in the place of meta is written as it is."""
    meta, arrays = raw
    text = meta if isinstance(meta, str) else json.dumps(meta)
    return text.encode() if arrays is None else npz({"meta": np.array(text), **arrays}, chance)


def write_raw(path: Path, meta: Any, arrays: Mapping[str, Any] | None) -> Path:
    path.write_bytes(packed((meta, arrays)))
    return path


def changed_file(raw: Raw, chance: Chance) -> bytes:
    """Return the file of raw values with a few random changes; the kind stays, so that its reader is asked."""
    meta, arrays = deepcopy(raw[0]), None if raw[1] is None else dict(raw[1])
    for _ in range(chance.choice((0, 1, 1, 2, 3) if arrays else (1, 1, 2, 3))):
        inner = [value for value in meta.values() if isinstance(value, dict) and value]
        change_value(chance.choice(inner) if inner and chance.random() < 0.5 else meta, chance)
    if arrays and chance.random() < 0.5:
        change_arrays(arrays, chance)
    if "kind" in raw[0] and chance.random() < 0.95:
        meta["kind"] = raw[0]["kind"]
    return packed((sealed(meta) if chance.random() < 0.8 else meta, arrays), chance)


def sealed(meta: Any) -> Any:
    """Return meta with the hash of its robot, where it has one, so that nothing is refused for the hash alone."""
    try:
        return {**meta, "robot_hash": robot_hash(robot_of(meta["description"]))} if meta["robot_hash"] else meta
    except (InputError, KeyError, TypeError, AttributeError, ValueError):
        return meta


def raw_sweep() -> Sweep:
    """Return the manifest and the rows of the sweep among the files that are kept."""
    lines = [KEPT.joinpath("sweep", MANIFEST).read_text(), *KEPT.joinpath("sweep", ROWS).read_text().splitlines()]
    manifest, *rows = ({key: x for key, x in json.loads(line).items() if key != "check"} for line in lines)
    return manifest, rows


def with_check(values: Any) -> Any:
    return {**values, "check": checksum(values)} if isinstance(values, dict) else values


def packed_sweep(manifest: Any, rows: list[Any], *, seal: bool = True) -> dict[str, bytes]:
    """Return the files of a sweep; with checksums that are right, or with those of the rows as they are."""
    lines = [json.dumps(with_check(row) if seal else row) for row in rows]
    return {MANIFEST: json.dumps(with_check(manifest)).encode(), ROWS: "".join(f"{line}\n" for line in lines).encode()}


def write_sweep(folder: Path, manifest: Any, rows: list[Any], *, seal: bool = True) -> Path:
    folder.mkdir(exist_ok=True)
    for name, content in packed_sweep(manifest, rows, seal=seal).items():
        (folder / name).write_bytes(content)
    return folder


def changed_sweep(chance: Chance) -> dict[str, bytes]:
    """Return the files of a sweep with a few random changes."""
    manifest, rows = raw_sweep()
    for _ in range(chance.choice((0, 1, 1, 2))):
        change_value(manifest, chance)
    for _ in range(chance.choice((0, 1, 1, 2))):
        change_value(chance.choice(rows), chance)
    if chance.random() < 0.2:
        rows.append(deepcopy(chance.choice(rows)))
    return packed_sweep(manifest, rows)


DEEP: Any = json.loads("[" * 60 + "]" * 60)
VALUES: tuple[Any, ...] = (
    *(None, True, -1, 10**400, 1e308, float("nan"), float("inf"), "", ESC, "text", [], {}, [1, 2], {"a": 1}),
    *([ESC], ["joint1.x", "joint1.x"], {ESC: ESC}, DEEP),
)


def paths_of(node: Any, deep: int = 12) -> Iterator[tuple[Any, ...]]:
    """Yield paths to everything in a tree; of lists the first entry alone."""
    if not deep or not isinstance(node, (dict, list)):
        return
    for key in list(node) if isinstance(node, dict) else range(min(len(node), 1)):
        yield (key,)
        for rest in paths_of(node[key], deep - 1):
            yield (key, *rest)


def changed(tree: Any, path: tuple[Any, ...] | str, value: Any) -> Any:
    """Return the tree with another value at a path, such as "links.0.mass"; without it where the value is KeyError."""
    found = deepcopy(tree)
    node = found
    if isinstance(path, str):
        path = tuple(int(key) if key.isdigit() else key for key in path.split("."))
    for key in path[:-1]:
        node = node[key]
    if value is KeyError:
        del node[path[-1]]
    else:
        node[path[-1]] = deepcopy(value)
    return found


def result_mutants(raw: Raw) -> Iterator[tuple[str, Any, Mapping[str, Any]]]:
    """Yield each entry of meta, at every depth, and each array, changed in every way, with what the change is."""
    meta, arrays = raw
    assert arrays is not None
    for path in paths_of(meta):
        for value in (KeyError, *VALUES) if len(path) < 4 else (KeyError, None, 10**400, float("nan"), ESC, {}, []):
            found = changed(meta, path, value)
            yield f"meta {path} {value!a:.20}", sealed(found) if path[0] == "description" else found, arrays
    for text in ("", "[", "null", "3", "{}", "[" * 100_000, '{"format": 1' + "0" * 5000 + "}", "9" * 5000):
        yield f"meta is {text:.12}", text, arrays
    for name in arrays:
        yield f"without {name}", meta, {key: x for key, x in arrays.items() if key != name}
        for what, array in array_mutants(arrays[name]):
            yield f"{name} {what}", meta, {**arrays, name: array}
    for item in (item for item in ARRAYS if item.name in arrays):  # as a newer eomgen may add
        yield f"with more {item.name}", {**meta, "more": 1}, {**arrays, "more": arrays[item.name]}


def sweep_mutants(sweep: Sweep) -> Iterator[tuple[str, Any, list[Any]]]:
    """Yield the name, manifest and rows of each change; checksums are those of what was changed."""
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
