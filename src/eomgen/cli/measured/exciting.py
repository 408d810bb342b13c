"""The command that finds a motion to measure: excite."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ...errors import InputError
from ...files import FIGURE_ENDINGS
from ..shared import (
    Command,
    add_json,
    add_page,
    add_robot,
    as_seed,
    coordinate_values,
    pages_written,
    read_robot,
    real,
    reals,
    show_files,
    stage_bar,
    whole,
)

_MOTION, _RESULT, _SCENARIO = ".csv", ".npz", ".toml"
_ENDINGS = (_MOTION, _RESULT, _SCENARIO, *FIGURE_ENDINGS)
_AMOUNT = "one number, or NAME=VALUE"


def _add_excite(parser: argparse.ArgumentParser) -> None:
    add_robot(parser)
    parser.add_argument("--duration", type=real, default=10.0, metavar="S", help="of the period, s (10)")
    parser.add_argument("--harmonics", type=whole, default=5, metavar="N", help="of the Fourier series (5)")
    parser.add_argument("--step", type=real, default=5e-3, metavar="S", help="between samples, s (0.005)")
    parser.add_argument(
        "--criterion", default="D", metavar="NAME", help="D, or condition: the condition number of the regressor (D)"
    )
    parser.add_argument(
        "--terms",
        nargs="+",
        default=(),
        metavar="TERM",
        help="what is sought: links, rotors, viscous, dry, offset (all)",
    )
    parser.add_argument(
        "--range",
        nargs=3,
        action="append",
        default=[],
        metavar=("NAME", "LOW", "HIGH"),
        help="of a coordinate, m or rad (its limits); more than once",
    )
    parser.add_argument(
        "--rates", nargs="+", metavar="V", help=f"greatest, rad/s or m/s: {_AMOUNT} (its limits, or 1 or 0.2)"
    )
    parser.add_argument("--accelerations", nargs="+", metavar="A", help=f"greatest, per s^2: {_AMOUNT} (any)")
    parser.add_argument("--drives", nargs="+", metavar="U", help=f"greatest, N m or N: {_AMOUNT} (its limits)")
    parser.add_argument(
        "--box",
        nargs=7,
        action="append",
        default=[],
        metavar=("FRAME", "X0", "Y0", "Z0", "X1", "Y1", "Z1"),
        help="where a frame or link stays, corners, m, base axes; more than once",
    )
    parser.add_argument(
        "--half-space",
        nargs=5,
        action="append",
        default=[],
        metavar=("FRAME", "NX", "NY", "NZ", "D"),
        help="a frame stays where n . p >= d, m, n as a unit vector; more than once",
    )
    parser.add_argument(
        "--clear-of",
        nargs=5,
        action="append",
        default=[],
        metavar=("FRAME", "X", "Y", "Z", "R"),
        help="a frame keeps that far from a point, m; more than once",
    )
    parser.add_argument(
        "--noise", nargs="+", metavar="U", help=f"standard deviations of drives: {_AMOUNT} (1 %% of rms)"
    )
    parser.add_argument("--starts", type=whole, default=3, metavar="N", help="searches, of which the best counts (3)")
    parser.add_argument("--seed", type=as_seed, default=0, metavar="N", help="of random numbers (0)")
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        nargs="+",
        default=[],
        help="the motion .csv, a scenario of it .toml, the result .npz, a figure .svg, .pdf or .png",
    )
    add_page(parser)
    add_json(parser)


def _excite(options: argparse.Namespace) -> None:
    from ...identification.exciting.solve import excite
    from ...identification.identifiable import TERMS

    motion = _outputs(options.output)
    boxes = {}
    for frame, *texts in options.box:
        if frame in boxes:
            raise InputError(f"box: {frame!r} is given twice; allowed: once")
        corner = _numbers("box", frame, texts)
        boxes[frame] = [corner[:3], corner[3:]]
    robot = read_robot(options)
    with stage_bar("exciting") as report:
        found = excite(
            robot,
            duration=options.duration,
            harmonics=options.harmonics,
            step=options.step,
            criterion=options.criterion,
            terms=options.terms or TERMS,
            ranges={name: _numbers("range", name, ends) for name, *ends in options.range},
            rates=_amounts("rates", options.rates),
            accelerations=_amounts("accelerations", options.accelerations),
            drives=_amounts("drives", options.drives),
            boxes=boxes,
            half_spaces=_rows("half-space", options.half_space),
            clear_of=_rows("clear-of", options.clear_of),
            noise=_amounts("noise", options.noise),
            starts=options.starts,
            seed=options.seed,
            progress=report,
        )
    written = []
    for path in options.output:
        if path.suffix == _MOTION:
            written.append(found.to_csv(path))
        elif path.suffix == _RESULT:
            written.append(found.save(path))
        elif path.suffix == _SCENARIO:
            written.append(found.to_scenario(path, motion))
        else:
            from ...pictures.measured.excitation import plot_excitation

            written.append(plot_excitation(found, path))
    show_files(options, found.lines(), found.as_dict(), written + pages_written(options, found))


def _outputs(paths: Sequence[Path]) -> Path:
    """The path of the motion, which a scenario needs beside it."""
    for path in paths:
        if path.suffix not in _ENDINGS:
            raise InputError(f"output: {str(path)!r}; allowed: paths that end in {', '.join(_ENDINGS)}")
    motions = [path for path in paths if path.suffix == _MOTION]
    scenarios = [path for path in paths if path.suffix == _SCENARIO]
    if scenarios and len(motions) != 1:
        raise InputError(f"output: {str(scenarios[0])!r} with {len(motions)} files .csv; allowed: one, which it names")
    return motions[0] if motions else Path()


def _amounts(label: str, texts: Sequence[str] | None) -> Any:
    found = coordinate_values(label, texts)
    if isinstance(found, list):
        if len(found) != 1:
            raise InputError(f"{label}: {len(found)} numbers; allowed: one number, or NAME=VALUE for each")
        return found[0]
    return found


def _rows(label: str, given: Sequence[Sequence[str]]) -> list[tuple[str, list[float], float]]:
    rows = []
    for frame, *texts in given:
        *vector, number = _numbers(label, frame, texts)
        rows.append((frame, vector, number))
    return rows


def _numbers(label: str, name: str, texts: Sequence[str]) -> list[float]:
    return reals(f"{label}: {name}", texts)


COMMANDS = (
    Command(
        "excite",
        "a motion within limits that shows masses, inertias and friction to identify",
        _add_excite,
        _excite,
        (("excite arm.toml --rates 2 -o motion.csv", "a motion that identify finds most from, within limits"),),
    ),
)
