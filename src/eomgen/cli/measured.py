"""Commands about what was measured, and what tolerances make of it: forces, fit, calibrate, tolerance."""

from __future__ import annotations

import argparse
from pathlib import Path

from ..errors import InputError
from ..files import FIGURE_ENDINGS
from .shared import (
    Command,
    add_json,
    add_robot,
    coordinate_values,
    read_robot,
    say,
    show_files,
    show_json,
    show_result,
    stage_bar,
)


def _add_motion(parser: argparse.ArgumentParser) -> None:
    add_robot(parser)
    parser.add_argument("motion", metavar="MOTION", type=Path, help=".csv or .npz: t, coordinates, rates, drives")
    add_json(parser)


def _add_forces(parser: argparse.ArgumentParser) -> None:
    _add_motion(parser)
    parser.add_argument("--window", type=int, default=11, metavar="N", help="samples that derivatives use (11)")
    parser.add_argument("-o", "--output", type=Path, help="write all forces over time, .csv or .npz")


def _forces(options: argparse.Namespace) -> None:
    from ..identification.from_motion import forces

    robot = read_robot(options)
    with stage_bar("evaluating") as report:
        found = forces(robot, options.motion, window=options.window, progress=report)
    if options.output is not None:
        found.save(options.output)
    show_result(options, found)


def _add_fit(parser: argparse.ArgumentParser) -> None:
    _add_motion(parser)
    parser.add_argument("--coordinates", nargs="+", default=(), metavar="NAME", help="those to fit (all that can be)")
    parser.add_argument("--confidence", type=float, default=0.95, metavar="P", help="of the intervals (0.95)")


def _fit(options: argparse.Namespace) -> None:
    from ..identification.least_squares import fit

    robot = read_robot(options)
    with stage_bar("fitting") as report:
        found = fit(
            robot,
            options.motion,
            coordinates=options.coordinates,
            confidence=options.confidence,
            progress=report,
        )
    show_result(options, found)


def _add_calibrate(parser: argparse.ArgumentParser) -> None:
    add_robot(parser)
    parser.add_argument(
        "poses", metavar="POSES", type=Path, help=".csv or .npz: coordinates, what was measured of frames"
    )
    parser.add_argument(
        "--attach",
        nargs="+",
        default=[],
        metavar="F=LINK",
        help="a measured frame that the description does not have, and the link that it is on",
    )
    parser.add_argument(
        "--rotation",
        default="rotvector",
        metavar="KIND",
        help="of orientations: rotvector, rpy, quaternion (rotvector)",
    )
    parser.add_argument(
        "--noise",
        nargs=2,
        type=float,
        metavar=("M", "RAD"),
        help="standard deviations of lengths and turns (estimated)",
    )
    parser.add_argument("--loss", metavar="NAME", help="huber, cauchy or tukey: mistrust what is far off (none)")
    parser.add_argument("--folds", default="10", metavar="N", help="parts that are held out in turn, loo, or 0 (10)")
    parser.add_argument("--fixed", nargs="+", default=[], metavar="NAME", help="quantities that stay, or their owners")
    parser.add_argument(
        "--stiffness", nargs="+", default=[], metavar="NAME", help="coordinates that give way, such as joint2.gamma"
    )
    parser.add_argument("--drives", action="store_true", help="look for gain, eccentricity, backlash, coupling, drift")
    parser.add_argument("--variant", default="full", metavar="NAME", help="whose values: placement, zeros, full, prior")
    parser.add_argument("--confidence", type=float, default=0.95, metavar="P", help="of the intervals (0.95)")
    parser.add_argument("--toml", type=Path, metavar="FILE", help="write the description with what was found")
    parser.add_argument("--urdf", type=Path, metavar="FILE", help="write an URDF with what was found in its origins")
    parser.add_argument("-o", "--output", type=Path, help="the result, .npz, or a figure .svg, .pdf or .png")
    add_json(parser)


def _calibrate(options: argparse.Namespace) -> None:
    from ..identification.calibration.calibrating import calibrate

    frames = {}
    for text in options.attach:
        name, sign, link = text.partition("=")
        if not sign or name in frames:
            raise InputError(f"attach: {text!r}; allowed: F=LINK, each F once")
        frames[name] = link
    folds = options.folds if options.folds == "loo" else _whole("folds", options.folds)
    endings = (".npz", *FIGURE_ENDINGS)
    if options.output is not None and options.output.suffix not in endings:
        raise InputError(f"output: {str(options.output)!r}; allowed: a path that ends in {', '.join(endings)}")
    robot = read_robot(options)
    with stage_bar("calibrating") as report:
        found = calibrate(
            robot,
            options.poses,
            frames=frames,
            rotation=options.rotation,
            noise=options.noise,
            loss=options.loss,
            folds=folds,
            fixed=options.fixed,
            stiffness=options.stiffness,
            drives=options.drives,
            variant=options.variant,
            confidence=options.confidence,
            progress=report,
        )
    written = []
    if options.toml is not None:
        written.append(found.to_toml(options.toml))
    if options.urdf is not None:
        written.append(found.to_urdf(options.urdf))
    if options.output is not None and options.output.suffix == ".npz":
        written.append(found.save(options.output))
    elif options.output is not None:
        from ..pictures.calibration import plot_calibration

        written.append(plot_calibration(found, options.output))
    show_files(options, found.lines(), found.as_dict(), written)


def _add_tolerance(parser: argparse.ArgumentParser) -> None:
    add_robot(parser)
    parser.add_argument(
        "table", metavar="TABLE", type=Path, help=".toml: deviations or bounds of quantities, by the names of calibrate"
    )
    parser.add_argument("--frame", metavar="NAME", help="frame or link to look at (the tool)")
    where = parser.add_mutually_exclusive_group()
    where.add_argument("--pose", nargs="+", metavar="VALUE", help="coordinates, m and rad, or NAME=VALUE (home)")
    where.add_argument("--random", type=int, default=0, metavar="N", help="poses within the joints' limits")
    where.add_argument("--along", type=Path, metavar="MOTION", help=".csv or .npz, such as a simulation's result")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="of the random poses (0)")
    parser.add_argument("--wrench", nargs=6, type=float, metavar="F", help="force and moment on the frame, N and N m")
    parser.add_argument("--confidence", type=float, default=0.95, metavar="P", help="of the regions (0.95)")
    parser.add_argument("--accuracy", type=float, metavar="M", help="radius to reach: which tolerances to tighten")
    add_json(parser)


def _tolerance(options: argparse.Namespace) -> None:
    from ..identification.tolerances.budgeting import tolerance

    robot = read_robot(options)
    with stage_bar("looking at tolerances") as report:
        found = tolerance(
            robot,
            options.table,
            options.frame,
            poses=coordinate_values("pose", options.pose),
            random=options.random,
            along=options.along,
            seed=options.seed,
            wrench=options.wrench,
            confidence=options.confidence,
            progress=report,
        )
        allocation = None if options.accuracy is None else found.allocate(options.accuracy)
    if options.json:
        show_json({**found.as_dict(), "allocation": None if allocation is None else allocation.as_dict()})
        return
    say("\n".join([*found.lines(), *([] if allocation is None else ["", *allocation.lines()])]))


def _whole(label: str, text: str) -> int:
    try:
        return int(text)
    except ValueError:
        raise InputError(f"{label}: {text!r}; allowed: a whole number, or loo") from None


COMMANDS = (
    Command(
        "forces",
        "forces and reactions that belong to a measured motion",
        _add_forces,
        _forces,
        (("forces arm.toml measured.csv", "drives, springs, dampers, reactions of a measured motion"),),
    ),
    Command(
        "fit",
        "stiffness and damping from a measured motion and known drives",
        _add_fit,
        _fit,
        (("fit arm.toml measured.csv", "stiffness and damping from motion and known drives"),),
    ),
    Command(
        "calibrate",
        "offsets, placements and stiffness from measured poses",
        _add_calibrate,
        _calibrate,
        (("calibrate arm.toml poses.csv --toml better.toml", "offsets and placements from measured poses"),),
    ),
    Command(
        "tolerance",
        "accuracy of a tool by the tolerances of joints, links and stiffness",
        _add_tolerance,
        _tolerance,
        (("tolerance arm.toml tolerances.toml --random 200", "how accurate the tool is, and what makes it so"),),
    ),
)
