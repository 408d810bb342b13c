"""Commands about motions to measure and measured: forces, fit, identify, excite."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from ...errors import InputError
from ...files import FIGURE_ENDINGS
from ..shared import (
    Command,
    add_json,
    add_names,
    add_page,
    add_ranges,
    add_robot,
    add_rows,
    as_seed,
    check_output,
    gains,
    keywords,
    ranges_of,
    read_robot,
    real,
    reals,
    saved_or_drawn,
    show_measured,
    show_result,
    show_with_page,
    stage_bar,
    whole,
)

_MOTION, _RESULT, _SCENARIO = ".csv", ".npz", ".toml"
_ENDINGS = (_MOTION, _RESULT, _SCENARIO, *FIGURE_ENDINGS)
_TERMS = "links, rotors, viscous, dry, offset"
_AMOUNT = "one number, or NAME=VALUE"


def _add_motion(parser: argparse.ArgumentParser) -> None:
    add_robot(parser)
    parser.add_argument("motion", metavar="MOTION", type=Path, help=".csv or .npz: t, coordinates, rates, drives")
    add_json(parser)


def _add_forces(parser: argparse.ArgumentParser) -> None:
    _add_motion(parser)
    parser.add_argument("--window", type=whole, default=11, metavar="N", help="samples that derivatives use (11)")
    parser.add_argument("-o", "--output", type=Path, help="write all forces over time, .csv or .npz")


def _forces(options: argparse.Namespace) -> None:
    from ...identification.from_motion import forces

    robot = read_robot(options)
    with stage_bar("evaluating") as report:
        history = forces(robot, options.motion, window=options.window, progress=report)
    if options.output is not None:
        history.save(options.output)
    show_result(options, history)


def _add_fit(parser: argparse.ArgumentParser) -> None:
    _add_motion(parser)
    add_names(parser, "--coordinates", "NAME", "those to fit (all that can be)")
    parser.add_argument("--confidence", type=real, default=0.95, metavar="P", help="of the intervals (0.95)")
    parser.add_argument("-o", "--output", type=Path, help="the result, .json")
    add_page(parser)


def _fit(options: argparse.Namespace) -> None:
    from ...identification.stiffness.solve import fit

    robot = read_robot(options)
    with stage_bar("fitting") as report:
        estimate = fit(robot, options.motion, **keywords(fit, options, progress=report))
    show_with_page(options, estimate, [] if options.output is None else [estimate.save(options.output)])


def _add_identify(parser: argparse.ArgumentParser) -> None:
    _add_motion(parser)
    further = "stribeck, gains, delay, transmissions"
    add_names(parser, "--terms", "TERM", f"what is sought: {_TERMS} (all these), {further}")
    add_names(parser, "--known", "LINK", "links whose numbers are known: gains need a measure")
    parser.add_argument(
        "--half",
        type=whole,
        metavar="N",
        help="half width of the second filter, samples, 0 for none (the best of some)",
    )
    parser.add_argument(
        "--spread",
        type=real,
        default=0.5,
        metavar="S",
        help="how far the description's links are off, relative (0.5)",
    )
    parser.add_argument(
        "--shape", metavar="NAME", help="of Stribeck's curve: lorentzian or gaussian (the better one, held out)"
    )
    parser.add_argument("--toml", type=Path, metavar="FILE", help="write the description with estimated values")
    parser.add_argument("-o", "--output", type=Path, help="the result, .npz, or a figure .svg, .pdf or .png")
    add_page(parser)


def _identify(options: argparse.Namespace) -> None:
    from ...identification.dynamics.solve import identify
    from ...identification.identifiable import TERMS
    from ...pictures.measured.motions import plot_identification

    check_output(options, ".npz")
    robot = read_robot(options)
    with stage_bar("identifying") as report:
        settings = keywords(identify, options, terms=options.terms or TERMS, progress=report)
        estimate = identify(robot, options.motion, **settings)
    written = [] if options.toml is None else [estimate.to_toml(options.toml)]
    show_measured(options, estimate, written + saved_or_drawn(options, estimate, plot_identification))


def _add_excite(parser: argparse.ArgumentParser) -> None:
    add_robot(parser)
    parser.add_argument("--duration", type=real, default=10.0, metavar="S", help="of the period, s (10)")
    parser.add_argument("--harmonics", type=whole, default=5, metavar="N", help="of the Fourier series (5)")
    parser.add_argument("--step", type=real, default=5e-3, metavar="S", help="between samples, s (0.005)")
    parser.add_argument(
        "--criterion", default="D", metavar="NAME", help="D, or condition: the condition number of the regressor (D)"
    )
    add_names(parser, "--terms", "TERM", f"what is sought: {_TERMS} (all)")
    add_ranges(parser)
    for option, name, about in (
        ("--rates", "V", f"greatest, rad/s or m/s: {_AMOUNT} (its limits, or 1 or 0.2)"),
        ("--accelerations", "A", f"greatest, per s^2: {_AMOUNT} (any)"),
        ("--drives", "U", f"greatest, N m or N: {_AMOUNT} (its limits)"),
        ("--noise", "U", f"standard deviations of drives: {_AMOUNT} (1 %% of rms)"),
    ):
        add_names(parser, option, name, about, default=None)
    corners = "where a frame or link stays, corners, m, base axes; more than once"
    add_rows(parser, "--box", "FRAME X0 Y0 Z0 X1 Y1 Z1", corners)
    half_space = "a frame stays where n . p >= d, m, n as a unit vector; more than once"
    add_rows(parser, "--half-space", "FRAME NX NY NZ D", half_space)
    add_rows(parser, "--clear-of", "FRAME X Y Z R", "a frame keeps that far from a point, m; more than once")
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
        corner = reals(f"box: {frame}", texts)
        boxes[frame] = [corner[:3], corner[3:]]
    robot = read_robot(options)
    with stage_bar("exciting") as report:
        limits = {name: gains(name, getattr(options, name)) for name in ("rates", "accelerations", "drives", "noise")}
        settings = keywords(
            excite,
            options,
            **limits,
            terms=options.terms or TERMS,
            ranges=ranges_of(options),
            boxes=boxes,
            half_spaces=_rows("half-space", options.half_space),
            clear_of=_rows("clear-of", options.clear_of),
            progress=report,
        )
        excitation = excite(robot, **settings)
    written = []
    for path in options.output:
        if path.suffix == _MOTION:
            written.append(excitation.to_csv(path))
        elif path.suffix == _RESULT:
            written.append(excitation.save(path))
        elif path.suffix == _SCENARIO:
            written.append(excitation.to_scenario(path, motion))
        else:
            from ...pictures.measured.excitation import plot_excitation

            written.append(plot_excitation(excitation, path))
    show_measured(options, excitation, written)


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


def _rows(label: str, groups: Sequence[Sequence[str]]) -> list[tuple[str, list[float], float]]:
    rows = []
    for frame, *texts in groups:
        *vector, number = reals(f"{label}: {frame}", texts)
        rows.append((frame, vector, number))
    return rows


COMMANDS = (
    Command(
        _add_forces,
        _forces,
        "forces and reactions that belong to a measured motion",
        {"forces arm.toml measured.csv": "drives, springs, dampers, reactions of a measured motion"},
    ),
    Command(
        _add_fit,
        _fit,
        "stiffness and damping from a measured motion and known drives",
        {"fit arm.toml measured.csv": "stiffness and damping from motion and known drives"},
    ),
    Command(
        _add_identify,
        _identify,
        "masses, inertias and friction from a measured motion and its drives",
        {
            "identify arm.toml measured.csv": "base parameters of links, rotors and friction, with residuals",
            "identify arm.toml measured.csv --toml better.toml": "the description with bodies that have them",
        },
    ),
    Command(
        _add_excite,
        _excite,
        "a motion within limits that shows masses, inertias and friction to identify",
        {"excite arm.toml --rates 2 -o motion.csv": "a motion that identify finds most from, within limits"},
    ),
)
