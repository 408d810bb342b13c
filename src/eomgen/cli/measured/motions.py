"""Commands about motions to measure and measured: forces, fit, identify, excite."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from ...errors import InputError
from ...files import FIGURE_ENDINGS, check_ending
from ..choices import EXCITATION_CRITERIA, FURTHER_TERMS, SHAPES, TERMS
from ..shared.command import Command
from ..shared.numbers import gains, once_each, real, reals, whole
from ..shared.options import (
    FORCE_LIMITS,
    VELOCITY_LIMITS,
    add_amounts,
    add_choice,
    add_confidence,
    add_json,
    add_names,
    add_page,
    add_ranges,
    add_rows,
    add_sample_time,
    add_seed,
    keywords,
    ranges_of,
)
from ..shared.progress import stage_bar
from ..shared.reading import add_robot, read_robot
from ..shared.writing import check_output, saved_or_drawn, show_and_write, show_measured, show_with_page

_MOTION, _RESULT, _SCENARIO = ".csv", ".npz", ".toml"
_ENDINGS = (_MOTION, _RESULT, _SCENARIO, *FIGURE_ENDINGS)
_TERMS = ", ".join(TERMS).replace("dry", "dry (Coulomb)")
_LIMITS = {  # an option and its old name, which is that of the function's keyword
    ("velocity-limits", "rates"): f"{VELOCITY_LIMITS}: one number, or NAME=VALUE (the robot's, or 1 or 0.2)",
    ("acceleration-limits", "accelerations"): "greatest accelerations, per s^2: one number, or NAME=VALUE (any)",
    ("force-limits", "drives"): f"{FORCE_LIMITS}: one number, or NAME=VALUE (the robot's)",
    ("force-noise", "noise"): "standard deviations of actuator forces: one number, or NAME=VALUE (1 %% of rms)",
}


_ABOUT = ".csv or .npz: t, coordinates, velocities, actuator forces"


def _add_motion(parser: argparse.ArgumentParser) -> None:
    add_robot(parser)
    parser.add_argument("motion", metavar="MOTION", type=Path, help=_ABOUT)
    add_json(parser)


def _add_forces(parser: argparse.ArgumentParser) -> None:
    _add_motion(parser)
    parser.add_argument("--window", type=whole, default=11, metavar="N", help="samples that derivatives use (11)")
    parser.add_argument("-o", "--output", type=Path, help="write all forces over time, .csv or .npz")


def _forces(options: argparse.Namespace) -> None:
    from ...identification.from_motion import forces

    if options.output is not None:
        check_ending(options.output, _MOTION, _RESULT)
    robot = read_robot(options)
    with stage_bar("evaluating") as report:
        history = forces(robot, options.motion, window=options.window, progress=report)
    show_and_write(options, history)


def _add_fit(parser: argparse.ArgumentParser) -> None:
    add_robot(parser)
    parser.add_argument("motion", metavar="MOTION", type=Path, nargs="+", help=f"{_ABOUT}; several for --parameters")
    add_json(parser)
    add_names(parser, "--coordinates", "NAME", "those to fit (all that can be)")
    about = "of matrices: entries, joints.joint2.stiffness.x.beta, or all, loops.cut.stiffness, bushings.b.damping"
    add_names(parser, "--matrices", "NAME", about, default=None)
    about = "parameters to find by simulations, joints.joint2.gamma.friction (those of laws that have states)"
    add_names(parser, "--parameters", "NAME", about, default=None)
    about = "that leads these simulations along the motion, rad/s (0, none)"
    parser.add_argument("--bandwidth", type=real, default=0.0, metavar="RATE", help=about)
    add_confidence(parser)
    parser.add_argument("-o", "--output", type=Path, help="the result, .json")
    add_page(parser)


def _fit(options: argparse.Namespace) -> None:
    from ...identification.stiffness.solve import fit

    if options.output is not None:
        check_ending(options.output, ".json")
    robot = read_robot(options)
    with stage_bar("fitting") as report:
        motions = options.motion if len(options.motion) > 1 else options.motion[0]
        estimate = fit(robot, motions, **keywords(fit, options, progress=report))
    show_with_page(options, estimate, [] if options.output is None else [estimate.save(options.output)])


def _add_identify(parser: argparse.ArgumentParser) -> None:
    _add_motion(parser)
    about = f"parameters to identify: {_TERMS} (all these), {', '.join(FURTHER_TERMS)}"
    add_names(parser, "--terms", "TERM", about, choices=(*TERMS, *FURTHER_TERMS))
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
    parser.add_argument("--shape", choices=SHAPES, help="of the Stribeck curve (the better one on held-out samples)")
    parser.add_argument("--toml", type=Path, metavar="FILE", help="write the description with estimated values")
    parser.add_argument(
        "--force", action="store_true", help="go on and write although the data are not explained, or read wrongly"
    )
    parser.add_argument("-o", "--output", type=Path, help="the result, .npz, or a figure .svg, .pdf or .png")
    add_page(parser)


def _identify(options: argparse.Namespace) -> None:
    from ...identification.dynamics.solve import identify

    check_output(options, ".npz")
    if options.toml is not None:
        check_ending(options.toml, ".toml", label="toml")
    robot = read_robot(options)
    with stage_bar("identifying") as report:
        settings = keywords(identify, options, terms=options.terms or TERMS, progress=report)
        estimate = identify(robot, options.motion, **settings)
    written = [] if options.toml is None else [estimate.to_toml(options.toml, force=options.force)]
    show_measured(options, estimate, written + saved_or_drawn(options, estimate))


def _add_excite(parser: argparse.ArgumentParser) -> None:
    add_robot(parser)
    parser.add_argument(
        "--duration", type=real, default=10.0, metavar="S", help="duration in seconds: of the period (10)"
    )
    parser.add_argument("--harmonics", type=whole, default=5, metavar="N", help="of the Fourier series (5)")
    add_sample_time(parser, 5e-3, "0.005")
    add_choice(
        parser, "--criterion", EXCITATION_CRITERIA, "criterion of optimality: D-optimal, or condition of the regressor"
    )
    add_names(parser, "--terms", "TERM", f"parameters to identify: {_TERMS} (all)", choices=TERMS)
    add_ranges(parser)
    for (option, old), about in _LIMITS.items():
        add_amounts(parser, f"--{option}", f"--{old}", about, old)
    corners = "where frames may be: a frame or link and two corners, m, base frame; more than once"
    add_rows(parser, "--box", "FRAME X0 Y0 Z0 X1 Y1 Z1", corners)
    half_space = "a frame stays where n . p >= d, m, n as a unit vector; more than once"
    add_rows(parser, "--half-space", "FRAME NX NY NZ D", half_space)
    add_rows(parser, "--clear-of", "FRAME X Y Z R", "a frame keeps that far from a point, m; more than once")
    parser.add_argument("--starts", type=whole, default=3, metavar="N", help="searches, of which the best counts (3)")
    add_seed(parser)
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

    motion = _outputs(options.output)
    corners = once_each("box", ((frame, reals(f"box: {frame}", texts)) for frame, *texts in options.box))
    boxes = {frame: [corner[:3], corner[3:]] for frame, corner in corners.items()}
    robot = read_robot(options)
    with stage_bar("exciting") as report:
        limits = {name: gains(option, getattr(options, name)) for option, name in _LIMITS}
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
            written.append(excitation.plot(path=path))
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
        "actuator forces and joint reactions of a measured motion",
        {"forces arm.toml measured.csv": "actuator forces, springs, dampers, joint reactions"},
    ),
    Command(
        _add_fit,
        _fit,
        "stiffness and damping from a measured motion and known actuator forces",
        {"fit arm.toml measured.csv": "stiffness and damping, with their uncertainty"},
    ),
    Command(
        _add_identify,
        _identify,
        "masses, inertias and friction from a measured motion and its actuator forces",
        {
            "identify arm.toml measured.csv": "base parameters of links, rotors and friction, with residuals",
            "identify arm.toml measured.csv --toml better.toml": "the description with bodies that have them",
        },
    ),
    Command(
        _add_excite,
        _excite,
        "an excitation trajectory within limits, for the identification of masses, inertias and friction",
        {"excite arm.toml --velocity-limits 2 -o motion.csv": "D-optimal trajectory for identify, within limits"},
    ),
)
