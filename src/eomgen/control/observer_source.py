"""An extended Kalman filter as C: beside the robot's, no heap, and all of it in one struct."""

from __future__ import annotations

import importlib.resources
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import IO

import numpy as np

from .._version import __version__
from ..codegen.c.source import environment
from ..codegen.kernels.groups import (
    FILTER_BY_SENSITIVITIES,
    FILTER_OF_LINEAR_LAWS,
    FILTERED_ACCELERATIONS_BY_PARAMETERS,
    FILTERED_ACCELERATIONS_IN_C,
    FILTERED_SENSORS_IN_C,
    FILTERED_WRENCHES,
    SENSORS,
    kernel_group,
)
from ..errors import InputError
from ..files import as_path, write_atomically
from ..identifiers import check_kind
from ..pipeline.options import Options
from ..pipeline.stages import make_source
from ..progress import StageReport, no_report, tells_at_prompt
from .kalman_filter import FilterModel, Observer
from .sensing import Measurement

LIBRARY = "kalman.h"


@tells_at_prompt("writing the observer")
def write_observer(observer: Observer, folder: Path | str, *, progress: StageReport = no_report) -> list[Path]:
    """Write a filter as C99, with the robot's equations that it calls, and return the paths.

    ``cc -c NAME.c NAME_observer.c`` in the folder compiles it, with NAME_innovation.c where that is there (where
    readings are more than encoders and tachometers tell); all warnings may be errors.

    Args:
        observer: of ``eomgen.control.observer``; the C begins as that did.
        folder: written to; files of the same names are replaced.
        progress: called with a line of text when a stage begins.

    Raises:
        InputError: no observer, one of a closed mechanism, or a folder that cannot be written.
    """
    check_kind("observer", observer, isinstance(observer, Observer), "an observer (of eomgen.control.observer)")
    target = Path(as_path(folder, "folder"))
    progress("deriving the equations")
    return write_texts(observer_files(observer), target)


def write_texts(texts: Mapping[str, str], folder: Path) -> list[Path]:
    """Write texts by their places in a folder, and return the paths."""
    return [write_atomically(folder / name, partial(_write, text), read=None) for name, text in texts.items()]


def _write(text: str, stream: IO[bytes]) -> None:
    stream.write(text.encode("ascii"))


def observer_files(observer: Observer) -> dict[str, str]:
    """Return texts of a filter by their places in one folder: the robot's C, the filter's, and what both include."""
    model, is_linear = observer.filter, observer.is_linear
    measurement = model.measurement
    if model.independent is not None:
        raise InputError(
            f"observer of {model.model.name}: it has closed loops, whose filter is in Python alone; allowed: in C"
            " robots without them"
        )
    robot = replace(measurement.robot, sensors=()) if _reads_states(measurement) else measurement.robot
    kernels = _kernels(model, is_linear=is_linear)
    source = make_source(robot, Options(kernels=kernels, dtype=model.dtype, batches=False))
    context = _context(model, is_linear=is_linear)
    made = {
        f"{source.name}_observer.{end}": environment().get_template(f"control/observer.{end}.jinja").render(context)
        for end in ("h", "c")
    }
    sensors = {} if _reads_states(measurement) else measurement.sources(model.dtype)
    library = importlib.resources.files("eomgen.control").joinpath(LIBRARY).read_text(encoding="ascii")
    return {**source.files, LIBRARY: library, **sensors, **made}


def _reads_states(measurement: Measurement) -> bool:
    """Whether all that is measured are numbers of q and v without biases, which need no kernels."""
    return None not in measurement.places and not measurement.biased


def _kernels(model: FilterModel, *, is_linear: bool) -> tuple[str, ...]:
    """Name the kernels that the C of a filter calls."""
    evaluates, by_acceleration = not _reads_states(model.measurement), model.measurement.depends_on_acceleration
    estimates = evaluates and bool(model.parameters)
    wanted: dict[tuple[str, ...], bool] = {
        FILTER_OF_LINEAR_LAWS: is_linear,
        FILTER_BY_SENSITIVITIES: not is_linear,
        FILTERED_WRENCHES: bool(model.links),
        SENSORS: evaluates,
        FILTERED_ACCELERATIONS_IN_C: evaluates and by_acceleration,
        FILTERED_SENSORS_IN_C: estimates,
        FILTERED_ACCELERATIONS_BY_PARAMETERS: estimates and by_acceleration,
    }
    return kernel_group(model.model, *(group for group, is_wanted in wanted.items() if is_wanted))


def _context(model: FilterModel, *, is_linear: bool) -> dict[str, object]:
    """Return what the templates of a filter know."""
    robot, measurement, n = model.model, model.measurement, model.model.size
    parameters, real = list(robot.parameters), "float" if model.dtype == "float32" else "double"

    def literal(value: float) -> str:
        return f"{float(np.float32(value))!r}F" if real == "float" else repr(float(value))

    is_root = model.form == "square_root"
    noise = model.noise() if is_root else model.noise() ** 2
    measured = [
        f"{name}, {deviation:g} {unit}"
        for (name, unit), deviation in zip(measurement.innovations, measurement.noise, strict=True)
    ]
    return {
        "name": robot.name,
        "version": __version__,
        "dtype": model.dtype,
        "real": real,
        "dt": repr(model.dt),
        "dt_literal": literal(model.dt),
        "zero": literal(0.0),
        "one": literal(1.0),
        "n": n,
        "N": len(model.states),
        "states": model.states,
        "reads_states": _reads_states(measurement),
        "by_acceleration": measurement.depends_on_acceleration,
        "readings": measurement.readings,
        "measured": measured,
        "places": measurement.places,
        "biased": measurement.biased,
        "variances": [literal(x**2) for x in measurement.noise],
        "wrenches": [robot.links.index(link) for link in model.links],
        "links": len(robot.links),
        "parameters": len(parameters),
        "nominal": [literal(value) for value in robot.parameters.values()],
        "parameter_places": [parameters.index(name) for name in model.parameters],
        "bounded": [(i, literal(x)) for i, x in enumerate(model.least()) if x > -np.inf],
        "gravity": [i for i, name in enumerate(parameters) if name.startswith("gravity.")],
        "is_linear": is_linear,
        "is_root": is_root,
        "deviations": [literal(x) for x in model.deviations()],
        "noise": [literal(x) for x in noise],
    }
