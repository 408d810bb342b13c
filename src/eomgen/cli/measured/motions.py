"""Commands about measured motions: forces, fit, identify."""

from __future__ import annotations

import argparse
from pathlib import Path

from ..shared import (
    Command,
    add_json,
    add_page,
    add_robot,
    check_output,
    pages_written,
    read_robot,
    real,
    saved_or_drawn,
    show_files,
    show_result,
    show_with_page,
    stage_bar,
    whole,
)


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
        found = forces(robot, options.motion, window=options.window, progress=report)
    if options.output is not None:
        found.save(options.output)
    show_result(options, found)


def _add_fit(parser: argparse.ArgumentParser) -> None:
    _add_motion(parser)
    parser.add_argument("--coordinates", nargs="+", default=(), metavar="NAME", help="those to fit (all that can be)")
    parser.add_argument("--confidence", type=real, default=0.95, metavar="P", help="of the intervals (0.95)")
    parser.add_argument("-o", "--output", type=Path, help="the result, .json")
    add_page(parser)


def _fit(options: argparse.Namespace) -> None:
    from ...identification.stiffness.solve import fit

    robot = read_robot(options)
    with stage_bar("fitting") as report:
        found = fit(
            robot,
            options.motion,
            coordinates=options.coordinates,
            confidence=options.confidence,
            progress=report,
        )
    show_with_page(options, found, [] if options.output is None else [found.save(options.output)])


def _add_identify(parser: argparse.ArgumentParser) -> None:
    _add_motion(parser)
    parser.add_argument(
        "--terms",
        nargs="+",
        default=(),
        metavar="TERM",
        help="what is sought: links, rotors, viscous, dry, offset (all these), stribeck, gains, delay, transmissions",
    )
    parser.add_argument(
        "--known", nargs="+", default=(), metavar="LINK", help="links whose numbers are known: gains need a measure"
    )
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
    parser.add_argument("--toml", type=Path, metavar="FILE", help="write the description with what was found")
    parser.add_argument("-o", "--output", type=Path, help="the result, .npz, or a figure .svg, .pdf or .png")
    add_page(parser)


def _identify(options: argparse.Namespace) -> None:
    from ...identification.dynamics.solve import identify
    from ...identification.identifiable import TERMS
    from ...pictures.measured.motions import plot_identification

    check_output(options, ".npz")
    robot = read_robot(options)
    with stage_bar("identifying") as report:
        found = identify(
            robot,
            options.motion,
            terms=options.terms or TERMS,
            known=options.known,
            half=options.half,
            shape=options.shape,
            spread=options.spread,
            progress=report,
        )
    written = []
    if options.toml is not None:
        written.append(found.to_toml(options.toml))
    written += saved_or_drawn(options, found, plot_identification)
    show_files(options, found.lines(), found.as_dict(), written + pages_written(options, found))


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
        "identify",
        "masses, inertias and friction from a measured motion and its drives",
        _add_identify,
        _identify,
        (
            ("identify arm.toml measured.csv", "base parameters of links, rotors and friction, with residuals"),
            ("identify arm.toml measured.csv --toml better.toml", "the description with bodies that have them"),
        ),
    ),
)
