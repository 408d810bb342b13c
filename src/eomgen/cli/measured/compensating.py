"""The command that corrects programs: compensate."""

from __future__ import annotations

import argparse
from pathlib import Path

from ...errors import InputError
from ...files import check_ending
from ..shared import (
    Command,
    add_json,
    add_page,
    add_robot,
    as_seed,
    check_output,
    coordinate_values,
    pages_written,
    progress_bar,
    read_robot,
    real,
    saved_or_drawn,
    show_files,
    whole,
)


def _add_compensate(parser: argparse.ArgumentParser) -> None:
    add_robot(parser)
    parser.add_argument(
        "--scenario", metavar="FILE", help="path of a .toml file, or a built-in name (the motion of eomgen simulate)"
    )
    parser.add_argument("--frame", help="frame or link that is to follow (that of the scenario)")
    parser.add_argument(
        "--mode", default="dynamic", metavar="MODE", help="dynamic: by repeated simulation; static: states of rest"
    )
    parser.add_argument("--step", type=real, metavar="S", help="between samples (the scenario's output step)")
    parser.add_argument(
        "--weights",
        nargs="+",
        metavar="AXIS=W",
        help="of errors along the tool's axes, x, y, z (1), and about them, rx, ry, rz (0.1 m/rad); 0: not corrected",
    )
    parser.add_argument(
        "--accelerations", action="store_true", help="static: what accelerates the masses bends the robot, too"
    )
    parser.add_argument("--iterations", type=whole, default=30, metavar="N", help="dynamic: simulations at most (30)")
    parser.add_argument("--rates", nargs="+", metavar="NAME=V", help="greatest rates of joints, rad/s or m/s")
    parser.add_argument("--drive-limits", nargs="+", metavar="NAME=U", help="greatest forces of drives, N m or N")
    parser.add_argument(
        "--robustness", type=real, metavar="SHARE", help="try robots whose stiffness is wrong by it, such as 0.2"
    )
    parser.add_argument("--draws", type=whole, default=3, metavar="N", help="of them with signs by chance (3)")
    parser.add_argument("--seed", type=as_seed, default=0, help="of these signs (0)")
    parser.add_argument("--toml", type=Path, metavar="FILE", help="write a scenario that follows the corrected program")
    parser.add_argument("-o", "--output", type=Path, help="the result, .npz, or a figure .svg, .pdf or .png")
    add_page(parser)
    add_json(parser)


def _compensate(options: argparse.Namespace) -> None:
    from ...identification.compensating.solve import compensate
    from ...pictures.measured.compensation import plot_compensation

    check_output(options, ".npz")
    if options.toml is not None:
        check_ending(options.toml, ".toml", label="toml")
    robot = read_robot(options)
    with progress_bar("compensating") as report:
        found = compensate(
            robot,
            options.scenario,
            frame=options.frame,
            mode=options.mode,
            step=options.step,
            weights=_numbers("weights", options.weights),
            accelerations=options.accelerations,
            iterations=options.iterations,
            rates=_numbers("rates", options.rates),
            drives=_numbers("drive-limits", options.drive_limits),
            robustness=options.robustness,
            draws=options.draws,
            seed=options.seed,
            progress=report,
        )
    written = [] if options.toml is None else found.to_scenario(options.toml)
    written += saved_or_drawn(options, found, plot_compensation)
    show_files(options, found.lines(), found.as_dict(), written + pages_written(options, found))


def _numbers(label: str, texts: list[str] | None) -> dict[str, float] | None:
    """Numbers by name; InputError where one has none."""
    found = coordinate_values(label, texts)
    if found is not None and not isinstance(found, dict):
        raise InputError(f"{label}: {texts[0] if texts else ''!r}; allowed: NAME=VALUE")
    return found


COMMANDS = (
    Command(
        "compensate",
        "a corrected program with which the elastic robot's tool goes where it should",
        _add_compensate,
        _compensate,
        (
            (
                "compensate arm.toml --scenario s.toml --toml new.toml",
                "a program that brings the tool where it should be",
            ),
        ),
    ),
)
