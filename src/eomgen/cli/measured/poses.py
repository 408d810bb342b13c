"""Commands about poses to measure, and about measured ones: calibrate, poses."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from ...errors import InputError
from ...files import check_ending
from ...names import show
from ..choices import AXES, LOSSES, MEASURES, POSE_CRITERIA, VARIANTS
from ..shared.command import Command
from ..shared.numbers import real, whole
from ..shared.options import (
    add_choice,
    add_confidence,
    add_json,
    add_names,
    add_old_name,
    add_page,
    add_ranges,
    add_rotation,
    add_rows,
    add_seed,
    keywords,
    ranges_of,
)
from ..shared.progress import stage_bar
from ..shared.reading import add_robot, read_robot
from ..shared.writing import check_output, saved_or_drawn, show_measured

_CORNERS = "X0 Y0 Z0 X1 Y1 Z1"  # of a box


def _add_calibrate(parser: argparse.ArgumentParser) -> None:
    add_robot(parser)
    parser.add_argument(
        "poses", metavar="POSES", type=Path, help=".csv or .npz: coordinates, what was measured of frames"
    )
    _add_measuring(parser, "estimated")
    sizes = "3 x 3 of positions or 6 x 6 of poses, one or one per row"
    add_names(parser, "--covariance", "FILE", f"covariances of frames' errors, .csv or .npz: {sizes}", type=Path)
    parser.add_argument("--loss", choices=LOSSES, help="down-weight outliers by this loss (none)")
    parser.add_argument(
        "--folds", default="10", metavar="N", help="of cross-validation, loo: one row each, 0: none (10)"
    )
    about = "estimate gain, eccentricity, backlash, coupling and drift, too"
    errors = parser.add_argument("--transmission-errors", dest="drives", action="store_true", help=about)
    add_old_name(parser, "--drives", errors)
    add_choice(parser, "--variant", VARIANTS, "variant of the model whose values are written", "full")
    add_confidence(parser)
    parser.add_argument(
        "--force", action="store_true", help="go on and write although the data are not explained, or read wrongly"
    )
    parser.add_argument("--toml", type=Path, metavar="FILE", help="write the description with estimated values")
    parser.add_argument("--urdf", type=Path, metavar="FILE", help="write a URDF with estimated origins")
    parser.add_argument("-o", "--output", type=Path, help="the result, .npz, or a figure .svg, .pdf or .png")
    add_page(parser)
    add_json(parser)


def _add_measuring(parser: argparse.ArgumentParser, noise: str) -> None:
    """Add options of what is measured and what is estimated; ``noise`` says what --noise is by default."""
    attached = "a measured frame that the description does not have, and the link that it is on"
    add_names(parser, "--attach", "F=LINK", attached)
    add_rotation(parser)
    deviations = f"standard deviations of measured positions and rotations ({noise})"
    parser.add_argument("--noise", nargs=2, type=real, metavar=("M", "RAD"), help=deviations)
    add_names(
        parser, "--fixed", "NAME", "parameters, or the joints, frames and links that have them, to leave as they are"
    )
    about = "compliant coordinates, joint2.gamma, matrices, joints.joint2.stiffness, or entries of them, ... .x.beta"
    add_names(parser, "--stiffness", "NAME", about)


def _calibrate(options: argparse.Namespace) -> None:
    from ...identification.calibration.solve import calibrate
    from ...identification.geometry.covariances import read_covariances

    frames = _attached(options.attach)
    folds = options.folds if options.folds == "loo" else _whole("folds", options.folds)
    check_output(options, ".npz")
    for name in ("toml", "urdf"):
        if getattr(options, name) is not None:
            check_ending(getattr(options, name), f".{name}", label=name)
    robot = read_robot(options)
    with stage_bar("calibrating") as report:
        covariance = read_covariances(options.covariance)
        settings = keywords(calibrate, options, frames=frames, folds=folds, covariance=covariance, progress=report)
        calibration = calibrate(robot, options.poses, **settings)
    written, refused = [], None
    for path, write in ((options.toml, calibration.to_toml), (options.urdf, calibration.to_urdf)):
        try:
            written += [] if path is None else [write(path, force=options.force)]
        except InputError as error:
            refused = refused or error
            if calibration.is_explained:
                raise
    show_measured(options, calibration, written + saved_or_drawn(options, calibration))
    if refused is not None:
        raise refused


def _add_poses(parser: argparse.ArgumentParser) -> None:
    add_robot(parser)
    parser.add_argument("--count", type=whole, default=30, metavar="N", help="poses to choose (30)")
    parser.add_argument(
        "--frame", nargs="+", help="frame or link to look at: those to measure (tcp, or the end of the robot)"
    )
    add_choice(parser, "--measure", MEASURES, "what is measured of frames")
    _add_measuring(parser, "that of --fit, or 5e-5 1e-4")
    add_ranges(parser)
    corners = "where frames may be: two corners, m, base frame; more than once, in one of them"
    add_rows(parser, "--box", _CORNERS, corners, type=real)
    parser.add_argument("--reach", nargs=2, type=real, metavar=("LOW", "HIGH"), help="distance from the base, m")
    parser.add_argument(
        "--device", nargs=3, type=real, metavar=("X", "Y", "Z"), help="position of the measuring device, m"
    )
    parser.add_argument("--angle", type=real, metavar="RAD", help="between the frame's axis and the device, at most")
    add_choice(parser, "--axis", AXES, "that axis, --axis=-z with a sign", "z")
    add_choice(parser, "--criterion", POSE_CRITERIA, "criterion of optimality: D-optimal, or V, variance of TCP errors")
    add_rows(parser, "--workspace", _CORNERS, "boxes where TCP errors count (everywhere)", type=real)
    parser.add_argument("--after", type=Path, metavar="POSES", help="poses that were measured already: they count")
    parser.add_argument("--fit", type=Path, metavar="FILE", help="a calibration, .npz: its noise is taken")
    parser.add_argument("--candidates", type=whole, default=1000, metavar="N", help="poses to choose from (1000)")
    add_seed(parser)
    parser.add_argument(
        "-o", "--output", type=Path, help="the poses, .csv, with empty columns to fill in; or the result, .json"
    )
    add_page(parser)
    add_json(parser)


def _poses(options: argparse.Namespace) -> None:
    from ...identification.choosing.solve import poses

    if options.output is not None:
        check_ending(options.output, ".csv", ".json")
    robot = read_robot(options)
    with stage_bar("choosing poses") as report:
        settings = keywords(
            poses,
            options,
            frames=_attached(options.attach),
            ranges=ranges_of(options),
            boxes=_boxes(options.box),
            workspace=_boxes(options.workspace),
            progress=report,
        )
        chosen = poses(robot, **settings)
    written = []
    if options.output is not None:
        written.append((chosen.save if options.output.suffix == ".json" else chosen.to_csv)(options.output))
    show_measured(options, chosen, written)


def _attached(texts: Sequence[str]) -> dict[str, str]:
    frames: dict[str, str] = {}
    for text in texts:
        name, sign, link = text.partition("=")
        if not sign or name in frames:
            raise InputError(f"attach: {text!r}; allowed: F=LINK, each F once")
        frames[name] = link
    return frames


def _boxes(rows: Sequence[Sequence[float]]) -> list[list[Sequence[float]]] | None:
    return [[box[:3], box[3:]] for box in rows] or None


def _whole(label: str, text: str) -> int:
    try:
        return whole(text)
    except argparse.ArgumentTypeError:
        raise InputError(f"{label}: {show(text)}; allowed: a whole number, or loo") from None


COMMANDS = (
    Command(
        _add_calibrate,
        _calibrate,
        "joint offsets, base and tool transforms, stiffness from measured poses",
        {"calibrate arm.toml poses.csv --toml better.toml": "kinematic calibration, with uncertainties"},
    ),
    Command(
        _add_poses,
        _poses,
        "the most informative poses to measure, for calibrate",
        {"poses arm.toml --count 30 -o plan.csv": "D-optimal poses to measure"},
    ),
)
