"""Parts that commands share: a robot as argument, options about a state, progress, results as text or JSON."""

from __future__ import annotations

import argparse
import json
import re
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields
from inspect import signature
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

from ..errors import InputError
from ..files import FIGURE_ENDINGS, check_ending
from ..limits import LARGEST, MOST_COUNTED, SMALLEST, is_usable
from ..names import printable, show
from ..optional import NotInstalledError
from ..progress import Progress, StageReport, told_in_lines
from ..results.beside import JSON, NPZ, PAGE_ENDING, TRAJECTORY, is_ours, older_than, remove_ours
from .choices import ROTATIONS

if TYPE_CHECKING:
    from ..description.macros import Xacro
    from ..robot.value import Robot

VELOCITY_LIMITS = "greatest velocities of joints, rad/s or m/s"
FORCE_LIMITS = "greatest actuator forces, N m or N"
_NUMBERS = f"0, or a number of magnitude {SMALLEST:g} to {LARGEST:g}"
_DRIVES = {
    "locked": "locked (brakes on)",
    "free": "free under constant forces",
    "pd": "held by gains (pd)",
}
_MICRO = re.compile(r"(?<=[0-9] )u(?=(m|rad|s|N|J|W)\b)|(?<=\[)u(?=(m|rad|s|N|J|W)\b)")  # 5 um, [urad]
_DIGITS = 18  # of whole numbers, so that 64 bits hold them


@dataclass(frozen=True)
class Command:
    """A command of ``eomgen``.

    add_arguments: adds its arguments to its parser; imports what their choices are taken from.
    run: does it; imports what it needs; named as the command, behind a _.
    help: one line about it, in the list of all commands.
    examples: lines of the epilog of its help and of its group's: the words behind ``eomgen``, and what they do.
    description: text of ``eomgen COMMAND --help``; by default ``help`` as a sentence.
    """

    add_arguments: Callable[[argparse.ArgumentParser], None]
    run: Callable[[argparse.Namespace], None]
    help: str
    examples: Mapping[str, str]
    description: str | None = None

    @property
    def name(self) -> str:
        """The word that calls it."""
        return self.run.__name__.removeprefix("_")


@dataclass(frozen=True)
class Group:
    """Commands under a heading of ``eomgen --help``.

    name: stands before those of its commands, or is left out.
    about: what they are about, in some words.
    commands: in the order of the help.
    """

    name: str
    about: str
    commands: Sequence[Command]

    @property
    def names(self) -> tuple[str, ...]:
        """The words that call its commands."""
        return tuple(command.name for command in self.commands)


class OldName(argparse.Action):
    """An option under the name that it had before: does what the new name does, with a note on standard error."""

    def __init__(self, *arguments: Any, new: str, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self.new = new

    def __call__(
        self, parser: argparse.ArgumentParser, namespace: argparse.Namespace, values: Any, option: str | None = None
    ) -> None:
        print(f"note: {option} is now called {self.new}", file=sys.stderr)
        setattr(namespace, self.dest, True if self.nargs == 0 else values)


def add_old_name(parser: argparse.ArgumentParser | argparse._ArgumentGroup, old: str, option: argparse.Action) -> None:
    """Let an option of a parser, or of a group of it, be called ``old``, too; neither help nor shells say so."""
    alike = {name: getattr(option, name) for name in ("dest", "nargs", "type", "choices", "default")}
    parser.add_argument(old, action=OldName, new=option.option_strings[0], help=argparse.SUPPRESS, **alike)


# Robots and results that commands begin with


def add_robot(parser: argparse.ArgumentParser) -> None:
    """A ROBOT and the options of reading it."""
    parser.add_argument("robot", metavar="ROBOT", help="built-in name, or path of a .toml, .urdf or .xml (MJCF) file")
    add_reading(parser)


def add_result(parser: argparse.ArgumentParser) -> None:
    """A RESULT of a simulation."""
    parser.add_argument("result", metavar="RESULT", type=Path, help="folder of eomgen simulate, or its trajectory.npz")


def add_robot_or_result(parser: argparse.ArgumentParser) -> None:
    """Add a ROBOT|RESULT, of which ``is_result`` says which it is, and the options of reading either."""
    parser.add_argument(
        "subject",
        metavar="ROBOT|RESULT",
        help="built-in name, or path of a .toml, .urdf or .xml (MJCF) file; folder of eomgen simulate, or its .npz",
    )
    add_robot_of_result(parser, "the one that the result keeps")


def is_result(subject: str) -> bool:
    """Return whether a ROBOT|RESULT is a .npz or a folder; a built-in name is one where its folder holds a result."""
    from ..description.builtin import builtin_robots

    path = Path(subject)
    return path.suffix == NPZ or (path.is_dir() and (subject not in builtin_robots() or (path / TRAJECTORY).is_file()))


def add_robot_of_result(parser: argparse.ArgumentParser, default: str) -> None:
    """The option --robot of a command about a result; ``default`` says which it is where the option is not given."""
    parser.add_argument("--robot", help=f"the robot that was simulated ({default})")
    add_reading(parser)


def add_reading(parser: argparse.ArgumentParser, *names: str) -> None:
    """Add options of reading a robot from the fields of ``ReadOptions``, in a group of their own.

    Args:
        parser: of the command.
        names: of the fields; all if there are none.
    """
    from ..description.options import ReadOptions

    group = parser.add_argument_group("reading of descriptions")
    for item in fields(ReadOptions):
        if names and item.name not in names:
            continue
        about_it: dict[str, Any] = {"dest": item.name, **item.metadata}
        option = about_it.pop("option", f"--{item.name.replace('_', '-')}")
        if isinstance(item.default, bool):
            about_it["action"] = "store_false" if item.default else "store_true"
        group.add_argument(option, **about_it)
        if item.name == "xacro":
            package: dict[str, Any] = {"action": "append", "default": [], "metavar": "NAME=DIR"}
            package["help"] = "with --xacro: folder of a package, which $(find NAME) asks for; more than once"
            group.add_argument("--package", dest="packages", **package)


def read_robot(options: argparse.Namespace) -> Robot:
    """The robot of ``options.robot``; its notes are printed on standard error.

    Raises:
        InputError: see ``eomgen.load_robot``.
    """
    from ..description.load import load_robot
    from ..description.options import ReadOptions

    how = {item.name: getattr(options, item.name) for item in fields(ReadOptions)} | {"xacro": xacro_of(options)}
    if how["stops"] is not None:
        how["stops"] = _by_name("stops", how["stops"].split(","))
    robot = load_robot(options.robot, **how)
    for note in robot.notes:
        say(f"note: {note}", sys.stderr)
    return robot


def xacro_of(options: argparse.Namespace) -> Xacro:
    """Return what --xacro and --package ask for; InputError of packages without --xacro."""
    packages: dict[str, str] = {}
    for text in options.packages:
        name, sign, folder = text.partition("=")
        if not (name and sign and folder):
            raise InputError(f"package: {show(text)}; allowed: NAME=DIR")
        packages[name] = folder
    if packages and not options.xacro:
        raise InputError("--package: given without --xacro; allowed: with it, for files of people whom you trust")
    return packages or bool(options.xacro)


def result_path(path: Path) -> Path:
    """The file of a result: the path itself, or ``trajectory.npz`` in a folder.

    Raises:
        InputError: there is none.
    """
    if path.is_dir():
        if not (path / TRAJECTORY).is_file():
            raise InputError(f"{path}: has no {TRAJECTORY}; allowed: a folder that eomgen simulate wrote, or a .npz")
        return path / TRAJECTORY
    return path


# What is shown


def with_micro_signs(text: str, stream: TextIO) -> str:
    """Return the text with micro signs in the place of the u of units, on a terminal whose encoding has them."""
    try:
        "\N{MICRO SIGN}".encode(stream.encoding or "ascii")
    except (UnicodeError, LookupError):
        return text
    return _MICRO.sub("\N{MICRO SIGN}", text) if stream.isatty() else text


def say(text: str, file: TextIO | None = None) -> None:
    """Print a line that may have names of others' files in it; nothing in it steers the terminal or ends the line."""
    print(with_micro_signs(printable(text).replace("\n", "\\n"), file or sys.stdout), file=file)


def say_lines(lines: Iterable[str], file: TextIO | None = None) -> None:
    """Print lines, each as ``say`` does."""
    for line in lines:
        say(line, file)


@contextmanager
def progress_bar(title: str) -> Iterator[Progress]:
    """A progress bar on a terminal; in a pipe a line on stderr every few seconds of what takes that long."""
    if not sys.stderr.isatty():
        with told_in_lines(title, lambda line: print(line, file=sys.stderr, flush=True)) as report:
            yield report
        return
    from rich.console import Console
    from rich.progress import BarColumn, TextColumn, TimeElapsedColumn
    from rich.progress import Progress as Bars

    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    with Bars(*columns, console=Console(stderr=True), transient=True) as bars:
        task = bars.add_task(title, total=None)

        def report(fraction: float, text: str) -> None:
            bars.update(task, description=text or title, total=1.0 if fraction > 0 else None, completed=fraction)

        yield report


@contextmanager
def stage_bar(title: str) -> Iterator[StageReport]:
    """A progress bar for work that names its stages and cannot tell how long they take."""
    with progress_bar(title) as report:
        yield lambda text: report(0.0, text)


def add_json(parser: argparse.ArgumentParser) -> None:
    """The option --json of all commands that print results."""
    parser.add_argument("--json", action="store_true", help="print JSON")


def show_json(values: Any) -> None:
    """Print values as JSON, one to a line."""
    print(json.dumps(values, indent=1))


def show_result(options: argparse.Namespace, result: Any) -> None:
    """Print a result that has ``lines`` and ``as_dict``: as text, or as JSON with --json."""
    if options.json:
        show_json(result.as_dict())
    else:
        say_lines(result.lines())


def show_files(
    options: argparse.Namespace, lines: Sequence[str], values: Mapping[str, Any], written: Iterable[Path]
) -> None:
    """Print a result as ``lines`` or as JSON of ``values``, with the files that were written."""
    if options.json:
        show_json({"files": [str(path) for path in written], **values})
        return
    say_lines(lines)
    show_written(written)


@contextmanager
def can_be_left_out(what: str) -> Iterator[None]:
    """Around work that a command does besides: where its package is missing, a line says so, and the rest goes on."""
    try:
        yield
    except NotInstalledError as error:
        say(f"note: {what} left out: {error}", sys.stderr)


def keywords(function: Callable[..., Any], options: argparse.Namespace, **converted: Any) -> dict[str, Any]:
    """Values of the options that have the names of a function's keywords, and ``converted`` in place of the others."""
    named = [item.name for item in signature(function).parameters.values() if item.kind is item.KEYWORD_ONLY]
    return {**{name: value for name, value in vars(options).items() if name in named}, **converted}


def add_rows(parser: argparse.ArgumentParser, option: str, columns: str, about: str, **options: Any) -> None:
    """An option that may be given more than once, each time with a value for each of the columns "NAME LOW HIGH"."""
    names = tuple(columns.split())
    parser.add_argument(option, nargs=len(names), action="append", default=[], metavar=names, help=about, **options)


def add_names(parser: argparse.ArgumentParser, option: str, name: str, about: str, **options: Any) -> None:
    """An option with one value or more behind it, each of which ``name`` stands for; by default none."""
    parser.add_argument(option, **{"nargs": "+", "default": (), "metavar": name, "help": about, **options})


def add_choice(
    parser: argparse.ArgumentParser, option: str, choices: Sequence[str], about: str, default: str = ""
) -> None:
    """An option that is one of some words, by default the first of them."""
    default = default or choices[0]
    parser.add_argument(option, choices=choices, default=default, help=f"{about} ({default})")


def add_rotation(parser: argparse.ArgumentParser) -> None:
    """Add the option --rotation of commands about measured poses."""
    add_choice(parser, "--rotation", ROTATIONS, "how measured orientations are written")


def add_amounts(parser: argparse.ArgumentParser, option: str, old: str, about: str, dest: str) -> None:
    """Add an option of numbers by name, which ``gains`` reads, with the name that it had before."""
    add_old_name(parser, old, parser.add_argument(option, nargs="+", metavar="VALUE", help=about, dest=dest))


def add_ranges(parser: argparse.ArgumentParser) -> None:
    """The option --range, which ``ranges_of`` reads."""
    add_rows(parser, "--range", "NAME LOW HIGH", "of a coordinate, m or rad (its limits); more than once")


def ranges_of(options: argparse.Namespace) -> dict[str, list[float]]:
    """Least and greatest values of coordinates by --range; InputError of what is no number."""
    return {name: reals(f"range: {name}", ends) for name, *ends in options.range}


def add_page(parser: argparse.ArgumentParser) -> None:
    """The option --report of commands about measurements."""
    parser.add_argument("--report", type=Path, metavar="FILE", help="write a page about it: figures, tables")


def pages_written(options: argparse.Namespace, result: Any) -> list[Path]:
    """Write the page about a result of measurements where --report asks for one; its path."""
    if options.report is None:
        return []
    from ..pictures.measured.kinds import page_of

    return [page_of(result).save(options.report)]


def show_measured(options: argparse.Namespace, result: Any, written: Sequence[Path] = ()) -> None:
    """Print a result of measurements as ``show_files`` does, and write its page where --report asks for it."""
    written = [*written, *pages_written(options, result)]
    show_files(options, result.lines(), result.as_dict(), written)
    name_older_pages(written)


def check_output(options: argparse.Namespace, *endings: str) -> None:
    """Check the ending of -o before anything is computed.

    Raises:
        InputError: it is none of these, nor that of a figure.
    """
    if options.output is not None:
        check_ending(options.output, *endings, *FIGURE_ENDINGS)


def saved_or_drawn(options: argparse.Namespace, result: Any, *about: Any) -> list[Path]:
    """Write a result where -o says, after ``check_output``: its plot to a path of a figure, else what its save writes.

    Args:
        options: of the command.
        result: with ``plot`` and ``save``.
        about: further arguments of its plot.

    Returns:
        The path that was written, or none.
    """
    path = options.output
    if path is None:
        return []
    return [result.plot(*about, path=path) if path.suffix in FIGURE_ENDINGS else result.save(path)]


def show_with_page(options: argparse.Namespace, result: Any, written: Iterable[Path] = ()) -> None:
    """Print a result as ``show_result`` does, with files that were written; and its page where --report asks for it."""
    written = [*written, *pages_written(options, result)]
    show_result(options, result)
    if not options.json:
        show_written(written)
    name_older_pages(written)


def show_written(paths: Iterable[Path]) -> None:
    """Print the paths of files that were written."""
    for path in paths:
        say(f"wrote {path}")


def remove_older(result: Path, names: Iterable[str], written: Iterable[Path] = (), *, replaced: bool = True) -> None:
    """Remove figures and pages that an older result left beside a new one, and say so; name those that stay.

    Args:
        result: the file of the new result.
        names: of files beside it, as ``results.beside`` knows them.
        written: with the new result.
        replaced: whether an older result was there; else the files are of something else, and stay.
    """
    older = older_than(result, names, written)
    removed, left = remove_ours(older) if replaced else ([], older)
    if removed:
        say(f"note: removed of the older result: {', '.join(map(str, removed))}", sys.stderr)
    _name_older(left)


def name_older_pages(written: Iterable[Path]) -> None:
    """Name pages that ``report`` may have written about older results, beside those that were written."""
    written = list(written)
    results = [path for path in written if path.suffix in (NPZ, JSON)]
    pages = [page for path in results for page in older_than(path, [path.with_suffix(PAGE_ENDING).name], written)]
    _name_older([page for page in pages if is_ours(page)])


def _name_older(paths: Sequence[Path]) -> None:
    if paths:
        say(f"note: older than the result beside, maybe of another one: {', '.join(map(str, paths))}", sys.stderr)


# Options about a state of a robot


def add_state(
    parser: argparse.ArgumentParser, *, drives: str = "locked", choices: Sequence[str] = tuple(_DRIVES)
) -> None:
    """Options that say about which state a robot is looked at, and --json."""
    add_pose(parser)
    about = f"actuated joints: {', '.join(_DRIVES[name] for name in choices)} ({drives})"
    parser.add_argument("--drives", choices=choices, default=drives, help=about)
    parser.add_argument("--kp", nargs="+", metavar="K", help="proportional gains of pd: one number, or NAME=VALUE")
    parser.add_argument("--kd", nargs="+", metavar="K", help="derivative gains of pd: one number, or NAME=VALUE (0)")
    about = "coordinates that are fixed, in the place of principal ones"
    fixed = parser.add_argument("--fixed-coordinates", dest="held", nargs="*", metavar="NAME", help=about)
    add_old_name(parser, "--held", fixed)
    about = "constant force and moment at a frame or link, base frame, N and N m; more than once"
    add_rows(parser, "--load", "FRAME FX FY FZ MX MY MZ", about)
    parser.add_argument("--frame", help="frame or link to look at (tcp, or the end of the robot)")
    add_names(parser, "--set", "NAME=VALUE", "parameters, such as gravity.z=0", dest="parameters")
    add_json(parser)


def state_options(options: argparse.Namespace, report: StageReport) -> dict[str, Any]:
    """Keywords that all analyses about a state take, but for the pose.

    Raises:
        InputError: a value is no number.
    """
    return {
        "drives": options.drives,
        "kp": gains("kp", options.kp),
        "kd": gains("kd", options.kd),
        "held": options.held,
        "loads": {row[0]: [_number("load", value) for value in row[1:]] for row in options.load} or None,
        "frame": options.frame,
        "parameters": _by_name("set", options.parameters) or None,
        "progress": report,
    }


def add_pose(parser: argparse.ArgumentParser | argparse._ArgumentGroup) -> None:
    """Add the option --pose, which ``coordinate_values`` reads."""
    parser.add_argument(
        "--pose", nargs="+", metavar="Q", help="principal coordinates, rad or m: all in order, or NAME=VALUE"
    )


def add_seed(parser: argparse.ArgumentParser) -> None:
    """Add the option --seed of commands that draw random numbers."""
    parser.add_argument("--seed", type=as_seed, default=0, metavar="N", help="of random numbers (0)")


def add_confidence(parser: argparse.ArgumentParser) -> None:
    """Add the option --confidence of commands that estimate uncertainty."""
    about = "probability of coverage by intervals and regions (0.95)"
    parser.add_argument("--confidence", type=real, default=0.95, metavar="P", help=about)


def add_sample_time(parser: argparse.ArgumentParser, default: float | None, about: str) -> None:
    """Add the option --sample-time, which was --step; ``about`` says what it is by default."""
    about = f"between samples, s ({about})"
    time = parser.add_argument("--sample-time", dest="step", type=real, default=default, metavar="S", help=about)
    add_old_name(parser, "--step", time)


def real(text: str) -> float:
    """Read a number of an option, as ``type`` of an argument: one that can be computed with (``is_usable``)."""
    value = _finite(text)
    if value is None:
        raise argparse.ArgumentTypeError(f"{show(text)}; allowed: {_NUMBERS}")
    return value


def whole(text: str) -> int:
    """Read a whole number of an option, as ``type`` of an argument: how many, or which, up to MOST_COUNTED."""
    digits = text.removeprefix("-")
    if not (digits.isascii() and digits.isdecimal() and len(digits) <= _DIGITS and int(digits) <= MOST_COUNTED):
        raise argparse.ArgumentTypeError(f"{show(text)}; allowed: a whole number, up to {MOST_COUNTED}")
    return int(text)


def as_seed(text: str) -> int:
    """Read the seed of random numbers, as ``type`` of an argument."""
    if not (text.isascii() and text.isdecimal() and len(text) <= _DIGITS):
        raise argparse.ArgumentTypeError(f"{show(text)}; allowed: a whole number of up to {_DIGITS} digits")
    return int(text)


def reals(label: str, texts: Sequence[str]) -> list[float]:
    """Read numbers of an option that are behind a name; InputError, which begins with the label, of what is none."""
    return [_number(label, text) for text in texts]


def coordinate_values(label: str, texts: Sequence[str] | None) -> list[float] | dict[str, float] | None:
    """Numbers in order, numbers by name if a text is NAME=VALUE, or None where no texts are given.

    Raises:
        InputError: a value is no number, or has no name where others have one; it begins with the label.
    """
    if texts is None:
        return None
    if any("=" in text for text in texts):
        return _by_name(label, texts)
    return [_number(label, text) for text in texts]


def gains(label: str, texts: Sequence[str] | None) -> float | dict[str, float] | None:
    """One number for all, numbers by name, or None where no texts are given; errors as of ``coordinate_values``."""
    values = coordinate_values(label, texts)
    if isinstance(values, list):
        if len(values) != 1:
            raise InputError(f"{label}: {len(values)} numbers; allowed: one number, or NAME=VALUE for each")
        return values[0]
    return values


def _by_name(label: str, texts: Sequence[str]) -> dict[str, float]:
    values = {}
    for text in texts:
        name, sign, value = text.partition("=")
        if not sign:
            raise InputError(f"{label}: {text!r}; allowed: NAME=VALUE")
        values[name.strip()] = _number(f"{label}: {name}", value)
    return values


def _number(label: str, text: str) -> float:
    value = _finite(text)
    if value is None:
        raise InputError(f"{label}: {show(text)} is not a number; allowed: {_NUMBERS}")
    return value


def _finite(text: str) -> float | None:
    """The number that a text says, if it can be computed with."""
    try:
        value = float(text)
    except ValueError:
        return None
    return value if is_usable(value) else None
