"""Saved results of measurements, one of each kind, and their mutants: for readers that refuse by file and key."""

from __future__ import annotations

import json
import random
from collections.abc import Callable, Mapping
from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np

import eomgen
from eomgen.analysis import ComplianceMap, Response, StateSpace
from eomgen.control import FeedForward, StableInversion
from eomgen.errors import InputError, UnknownNameError
from eomgen.identification import (
    BaseParameters,
    CompensationResult,
    Estimate,
    ExciteResult,
    FitResult,
    FittedCoordinate,
    FittedEntry,
    FittedMatrix,
    ForcesResult,
    Further,
    IdentifyResult,
    Residuals,
    accuracy,
    calibrate,
    forces,
    poses,
    tolerance,
)
from eomgen.identification.compensating.result import HeldBack, Variant
from eomgen.identification.exciting.fourier import FourierSeries
from eomgen.identification.exciting.result import Compared
from eomgen.motion.files import motion_from_columns
from eomgen.results.kinds import KINDS, read
from eomgen.scenario.load import scenario_from_toml
from tests.support.extreme_numbers import ODD, accuracy_columns, written
from tests.support.fuzzing import check_message
from tests.support.kept_files import SCENARIO, array_mutants, write_raw
from tests.support.measured_poses import chain, trial
from tests.support.mutations import change_value

Raw = tuple[dict[str, Any], dict[str, Any] | None]  # text, arrays of an .npz


def _base() -> BaseParameters:
    return BaseParameters(
        "arm", ("links",), ("a.m", "a.mx"), np.array([0]), np.array([[1.0, 2.0]]), ("a.m + 2 a.mx",), ()
    )


def _identification(_: Path) -> IdentifyResult:
    value, t = np.array([2.0]), np.linspace(0.0, 1.0, 7)
    drives = np.sin(t)[:, None]
    return IdentifyResult(
        eomgen.load_robot("one_link"),
        _base(),
        value,
        0.01 * value,
        value,
        {"link1.m": 2.0},
        {"joint1.gamma": Residuals(0.1, 0.2, 4.0, 500)},
        0.05,
        ("a warning",),
        ("a note",),
        {"joint1.gamma.gain": Further(1.0, 0.1, "N m per unit in the file")},
        t,
        drives,
        1.1 * drives,
        np.ones((7, 1), dtype=np.bool_),
    )


def _calibration(_: Path) -> Any:
    made = trial(chain(4, "RR"), 3, 30)
    return calibrate(made.robot, made.poses("rx", "ry", "rz"), folds=3, loss="huber")


def _compensation(_: Path) -> CompensationResult:
    t, times = np.linspace(0.0, 0.5, 4), np.linspace(0.0, 0.5, 7)
    error = 1e-4 * np.sin(np.outer(times + 1.0, np.arange(1.0, 7.0)))
    return CompensationResult(
        robot="arm",
        frame="tcp",
        mode="dynamic",
        coordinates=("joint1.gamma",),
        t=t,
        program=t[:, None],
        corrected=1.01 * t[:, None],
        times=times,
        before=error,
        after=0.1 * error,
        beyond=0.05 * error,
        weights=np.ones(6),
        history=(1e-3, 1e-4),
        rank=(1, 1),
        shares=(0.0, 0.1, 0.2, 0.3, 0.4, 1.0),
        limits=(HeldBack("joint1.gamma", 0.1, 1e-4, 1e-3),),
        robustness=(Variant("softer", 1e-3, 1e-3, 1e-4, 1e-4),),
        scenario=scenario_from_toml(SCENARIO),
        notes=("a note",),
    )


def _stable_inversion(_: Path) -> StableInversion:
    t = np.linspace(-0.1, 0.6, 5)
    q = np.stack([np.sin(t), 1e-3 * np.cos(t)], axis=1)
    return StableInversion(
        robot="arm",
        outputs=("tcp.y",),
        drives=("joint1.gamma",),
        coordinates=("joint1.gamma", "joint2.gamma"),
        t=t,
        duration=0.5,
        q=q,
        v=0.5 * q,
        u=q[:, :1],
        inertia=np.array([0.5]),
        zeros=np.array([-20.0 + 5.0j, -20.0 - 5.0j, 30.0 + 0.0j]),
        history=(1e-3, 1e-9),
        residual=1e-12,
        between=1e-9,
        ends=(1e-12, 1e-11),
        notes=("a note",),
    )


def _excitation(_: Path) -> ExciteResult:
    series = FourierSeries(("joint1.gamma",), 2.0, np.zeros(1), np.ones((1, 3)), np.zeros((1, 3)))
    t = np.linspace(0.0, 2.0, 9)
    q, v, a = series.at(t)
    compared = Compared(2.0, 4.0, 8.0)
    return ExciteResult(
        robot="arm",
        series=series,
        t=t,
        q=q,
        v=v,
        a=a,
        u=q,
        base=_base(),
        noise=np.ones(1),
        sizes=np.ones(1),
        deviations=np.ones(1),
        criterion="D",
        condition=compared,
        deviation=compared,
        limited=("joint1.gamma rate",),
        units=("rad/s",),
        limits=np.array([[-np.inf, 3.0]]),
        extremes=np.array([[-2.0, 2.0]]),
        randoms=20,
        starts=1,
        seed=0,
        notes=("a note",),
    )


def _forces(_: Path) -> ForcesResult:
    t = np.linspace(0.0, 1.0, 30)
    columns = {"t": t, "joint1.gamma": np.sin(t), "joint1.x": 1e-3 * np.cos(t)}
    return forces("one_link", motion_from_columns(columns, ("joint1.x", "joint1.gamma")))


def _fit(_: Path) -> FitResult:
    found = Estimate(1100.0, 20.0, 1060.0, 1140.0, 1000.0, 0.02, 0.013)
    entries = FittedEntry("x.x", found), FittedEntry("x.beta", found)
    rows = (found.value, found.value), (found.value, 1e6)
    held = FittedMatrix("mount", "stiffness", ("x", "beta"), entries, rows, (), ("beta.beta",), 0.5, 0.1, "bushings")
    gear = FittedCoordinate("gear.gamma", found, None, 1e-6)
    return FitResult("arm", 0.95, (gear,), ("a warning",), ("a note",), (held,))


def _response(_: Path) -> Response:
    H = np.array([1.0 + 2.0j, 3.0 - 4.0j]).reshape(2, 1, 1)
    return Response(
        robot="arm",
        frequencies=np.array([1.0, 2.0]),
        H=H,
        inputs=("tcp.fx",),
        outputs=("tcp.x",),
        kind="velocity",
        coordinates=("joint1.gamma",),
        q=np.array([0.5]),
        notes=("a note",),
    )


def _state_space(_: Path) -> StateSpace:
    return StateSpace(
        robot="arm",
        A=np.array([[0.0, 1.0, 0.0], [-2.0, -0.5, -9.0], [0.0, 1.0, 0.0]]),
        B=np.array([[0.0], [1.0], [0.0]]),
        C=np.array([[1.0, 0.0, 0.0]]),
        D=np.zeros((1, 1)),
        states=("joint1.gamma", "joint1.gamma.rate", "joint1.gamma.friction.z"),
        inputs=("joint1.gamma",),
        outputs=("tcp.x",),
        kind="displacement",
        coordinates=("joint1.gamma",),
        q=np.array([0.5]),
        v=np.zeros(1),
        a=np.zeros(1),
        u=np.array([3.0]),
        memory=("joint1.gamma.friction.z",),
        z=np.array([1e-5]),
        notes=("a note",),
    )


def _compliance_map(_: Path) -> ComplianceMap:
    """A place that the tool reaches, and one that it does not."""
    reached = np.array([1.0, np.nan])
    return ComplianceMap(
        robot="arm",
        frame="tcp",
        coordinates=("joint1.gamma",),
        points=np.arange(6.0).reshape(2, 1, 3),
        q=reached.reshape(2, 1, 1),
        deflection=np.tile(1e-5 * reached[:, None, None], (1, 1, 6)),
        compliance=1e-6 * reached[:, None, None, None] * np.eye(6),
        notes=("a note",),
    )


def _feedforward(_: Path) -> FeedForward:
    """Two samples of a motor and the joint behind its gear, with a jump."""
    pair = np.array([[0.1, 10.0], [0.2, 20.0]])
    return FeedForward(
        robot="arm",
        t=np.array([0.0, 0.1]),
        q=pair,
        v=2.0 * pair,
        a=3.0 * pair,
        u=np.array([[0.0, 0.3], [0.0, 0.4]]),
        coordinates=("joint1.gamma", "joint1.motor"),
        driven=("joint1.motor",),
        residual=np.array([0.01, 0.0]),
        jump_times=np.array([0.05]),
        jump_orders=np.array([4.0]),
        notes=("a note",),
    )


TOLERANCES: Mapping[str, Any] = {
    "joints.*.offset.x": {"bound": 3e-4},
    "frames.*.y": {"deviation": 1e-4},
    "frames.*.z": {"deviation": 2e-4},
    "correlations": [{"names": ["frames.*.y", "frames.*.z"], "coefficient": 0.5}],
}
RESULTS: Mapping[str, Callable[[Path], Any]] = {
    "accuracy": lambda folder: accuracy(written(folder / "measured.csv", accuracy_columns())),
    "calibration": _calibration,
    "compensation": _compensation,
    "compliance_map": _compliance_map,
    "excitation": _excitation,
    "feedforward": _feedforward,
    "fit": _fit,
    "forces": _forces,
    "identification": _identification,
    "poses": lambda _: poses(
        chain(4, "RR"), count=8, candidates=20, ranges={"joint1.gamma": (-2.0, 2.0), "joint2.gamma": (-2.0, 2.0)}
    ),
    "response": _response,
    "stable_inversion": _stable_inversion,
    "state_space": _state_space,
    "tolerance": lambda _: tolerance("one_link", TOLERANCES, poses=np.zeros((2, 1))),
}
IN_TEXT = ("accuracy", "fit", "poses", "tolerance")  # .json


def raw_measured(kind: str, folder: Path) -> Raw:
    """Text and arrays of a result that was saved."""
    path = RESULTS[kind](folder).save(folder / f"whole{'.json' if kind in IN_TEXT else '.npz'}")
    if kind in IN_TEXT:
        return json.loads(path.read_text()), None
    with np.load(path) as data:
        arrays = {name: data[name] for name in data.files}
    return json.loads(str(arrays.pop("meta"))), arrays


def write_measured(folder: Path, text: Any, arrays: Mapping[str, Any] | None) -> Path:
    if arrays is not None:
        return write_raw(folder / "r.npz", text, arrays)
    path = folder / "r.json"
    path.write_text(json.dumps(text))
    return path


def random_measured(raw: Raw, seed: int) -> tuple[Any, dict[str, Any] | None]:
    """Some random changes of text and arrays; the kind stays, so that its reader is asked."""
    chance = random.Random(f"measured {seed}")
    text, arrays = deepcopy(raw[0]), None if raw[1] is None else dict(raw[1])
    kind = text["kind"]
    for _ in range(chance.choice((0, 1, 1, 2, 3) if arrays else (1, 1, 2, 3))):
        inner = [x for x in text.values() if isinstance(x, dict) and x]
        change_value(chance.choice(inner) if inner and chance.random() < 0.3 else text, chance)
    if arrays and chance.random() < 0.5:
        name = chance.choice(list(arrays))
        arrays[name] = chance.choice([array for _, array in array_mutants(arrays[name])])
    if chance.random() < 0.95:
        text["kind"] = kind
    return text, arrays


def loaded_measured(kind: str, path: Path) -> Any | None:
    """A result with what is printed of it; None where it is refused, by a message with the file's name."""
    try:
        found = read(KINDS[kind], path)
    except InputError as error:
        if not isinstance(error, UnknownNameError):  # which says what is known
            check_message(error)
        if str(path) not in str(error):
            raise AssertionError(f"{path} is not named: {error}") from None
        return None
    lines = found.lines()
    infinite = not KINDS[kind].is_finite  # limits that there are not, and stiffness of what does not give
    own = path.suffix == ".json" and ODD.search(path.read_text(errors="replace"))  # in a text that a change wrote
    assert infinite or own or not any(ODD.search(line) for line in lines), [line for line in lines if ODD.search(line)]
    json.dumps(found.as_dict())
    return found
