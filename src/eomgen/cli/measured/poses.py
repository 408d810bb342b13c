"""The command about measured poses: calibrate."""

from __future__ import annotations

import argparse
from pathlib import Path

from ...errors import InputError
from ...files import FIGURE_ENDINGS
from ..shared import Command, add_json, add_robot, read_robot, show_files, stage_bar


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
    from ...identification.calibration.calibrating import calibrate

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
        from ...pictures.measured import plot_calibration

        written.append(plot_calibration(found, options.output))
    show_files(options, found.lines(), found.as_dict(), written)


def _whole(label: str, text: str) -> int:
    try:
        return int(text)
    except ValueError:
        raise InputError(f"{label}: {text!r}; allowed: a whole number, or loo") from None


COMMANDS = (
    Command(
        "calibrate",
        "offsets, placements and stiffness from measured poses",
        _add_calibrate,
        _calibrate,
        (("calibrate arm.toml poses.csv --toml better.toml", "offsets and placements from measured poses"),),
    ),
)
