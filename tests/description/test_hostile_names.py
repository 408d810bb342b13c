"""A description is data: whatever its names are, they are refused, or nothing but an identifier is left of them."""

from __future__ import annotations

import os
import random
import re
import subprocess
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import pytest

import eomgen
from eomgen.cli import entry as cli
from eomgen.codegen.c.source import Source
from eomgen.description.load import robot_from_toml, robot_from_urdf
from eomgen.errors import InputError
from eomgen.identifiers import is_identifier, is_robot_name
from eomgen.pictures.shapes import mesh_path, urdf_shapes
from eomgen.pipeline.generating import generate
from eomgen.robot.value import Robot
from eomgen.scenario.load import scenario_from_toml
from eomgen.sweep.plan import plan_from_toml
from tests.support.builds import Build
from tests.support.c_project import WARNINGS, source_of, unwrapped, write_source
from tests.support.description_samples import ARM
from tests.support.fuzzing import check_message
from tests.support.good_files import PLAN, SCENARIO, WORN
from tests.support.mutations import toml_string
from tests.support.optional import needs
from tests.support.quick_builds import ONE_LEVEL
from tests.support.soak import WHOLE, soaked
from tests.support.surfaces import check_robot

NAMES = 10_000 if WHOLE else 2_000
PER_ROBOT = 50  # hostile names in one URDF
WORDS = (  # of C, its headers and its compilers; legal names here
    *("int", "double", "main", "NULL", "INFINITY", "NAN", "errno", "M_PI", "linux", "unix", "I", "complex", "restrict"),
    *("inline", "asm", "typeof", "assert", "signbit", "isnan", "sin", "cos", "stdin", "EOF", "environ", "register"),
    *("__FILE__", "__attribute__", "_Complex", "__linux__", "h", "q", "v", "a", "u", "out", "t0", "t1", "turn"),
    *("PADDED", "EOM_PADDED", "eom_sin_cos"),
    *("lambda", "None", "import", "self", "E", "pi", "S", "N", "oo", "zoo", "Symbol", "exec", "__import__"),
    *("name", "loop"),
)
PIECES = (
    *('"', "'", "\\", "\n", "\r", "\t", "\v", "\f", "\0", "\x07", "\x1b[31m", "\x7f", "\x85", "\u2028"),
    *("\u202e", "\ufeff"),
    *("*/", "/*", "//", "??/", "??/\n", "<%", "%:", "#include </etc/passwd>\n", "#define double int\n", "\\\n"),
    *("\\u002a/",),
    *("%s", "%n", "%1$*2$x", "{}", "{0.__class__}", "{{ 7*7 }}", "{% raw %}", "{# #}", "$(reboot)", "`reboot`"),
    *("; rm -rf /",),
    *("__attribute__((constructor)) void f(void){}", "system(0);", 'asm("hlt")', "#pragma GCC poison x\n"),
    *('_Pragma("x")',),
    *("/", "..", "../../", "/etc/passwd", "C:\\", "~", "|", "&", ">", "<", "!", "*", "?", "-o", "--version"),
    *("@file", " "),
    *("__import__('os').system('true')", "eval(1)", "lambda: 0", "1e400", "nan", "].pop(", "</robot>", "]]>"),
    *("&lt;", "'''"),
    *("\N{GREEK SMALL LETTER PHI}", "\N{FULLWIDTH LATIN SMALL LETTER A}", "\N{COMBINING DIAERESIS}"),
    *("\U0001f600", "\u0130"),
    *WORDS,
)
XML = frozenset("\0\x07\x1b\x0b\x0c\x7f\ud800")  # characters that XML does not have
Reader = Callable[[str, Path], Any]


def hostile_name(seed: int) -> str:
    """The name of that seed: one to five pieces."""
    chance = random.Random(f"hostile {seed}")
    return "".join(chance.choice(PIECES) for _ in range(chance.choice((1, 1, 2, 3, 5)))) * chance.choice(
        (1,) * 30 + (40,)
    )


def toml(text: str, folder: Path) -> Robot:
    return robot_from_toml(text, source="r.toml", folder=folder)


def scenario(text: str, folder: Path) -> object:
    return scenario_from_toml(text, source="s.toml", folder=folder)


def plan(text: str, _: Path) -> object:
    return plan_from_toml(text, source="p.toml")


def never(_: str) -> bool:
    return False


def always(_: str) -> bool:
    return True


def coordinate(name: str) -> bool:
    return all(map(is_identifier, name.split(".")))


SAMPLED = 'duration = 1\nmotion = { type = "sampled", file = "x" }'
# where a TOML file takes a name: reader, text, what stands in its place, and which names are right there
PLACES: dict[str, tuple[Reader, str, str, Callable[[str], bool]]] = {
    "robot": (toml, ARM, '"arm"', is_robot_name),
    "link": (toml, ARM.replace("links.link2.mass", "gravity"), '"link2"', is_identifier),  # and what refers to it
    "joint": (toml, ARM, '"joint2"', is_identifier),
    "frame": (toml, ARM, '"tcp"', is_identifier),
    "loop": (toml, WORN, '"cut"', is_identifier),
    "spring": (toml, WORN, '"rope"', is_identifier),
    "coupling": (toml, WORN, '"gear"', is_identifier),
    "coupled coordinate": (toml, WORN, '"j2.z"', never),
    "driven coordinate": (toml, WORN, '"j1.gamma"', never),
    "parent": (toml, ARM, '"base"', never),
    "key": (toml, ARM, "armature", never),
    "top key": (toml, ARM, "gravity", never),
    "type": (toml, ARM, '"prismatic"', never),
    "tunable": (toml, ARM, '"links.link2.mass"', lambda name: name == "*"),
    "urdf": (toml, 'urdf = "x"\n' + ARM, '"x"', never),
    "curve": (toml, ARM.replace("stiffness = 1e6", 'curve = "x"'), '"x"', never),
    "coordinate of a start": (scenario, SCENARIO, "joint1.x", coordinate),
    "link of a wrench": (scenario, SCENARIO, '"link2"', always),
    "file of a motion": (scenario, SAMPLED, '"x"', never),
    "parameter of a sweep": (plan, PLAN, '"joints.*.x.stiffness"', always),
    "number of a scenario": (plan, PLAN, '"control.kd"', always),
    "record of a sweep": (plan, PLAN, '"drive_max"', never),
}
TAKEN = {"base", "world", "link1", "joint1", "a", "b", "x", "q", "v", "h", "coordinate_end"}  # names of another meaning


def named(place: str, name: str, folder: Path) -> object:
    """What comes of a name in that place; None where it is refused, as it must be unless it is right."""
    read, text, old, right = PLACES[place]
    try:
        made = read(text.replace(old, toml_string(name)), folder)
    except InputError as error:
        check_message(error)
        made = None
    if made is None:
        assert not right(name) or name in TAKEN or len(name) > 128, (place, name)
        return None
    assert right(name), (place, name)
    if isinstance(made, Robot):
        check_robot(made)
    return made


def snapshot(folder: Path) -> set[Path]:
    return set(folder.rglob("*"))


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize(("first", "count"), [(0, 60), pytest.param(60, NAMES // 8, marks=pytest.mark.soak)])
def test_names_in_toml(place: str, first: int, count: int, tmp_path: Path) -> None:
    inside = tmp_path / "a" / "b"
    inside.mkdir(parents=True)
    before = snapshot(tmp_path)
    right = sum(named(place, hostile_name(seed), inside) is not None for seed in range(first, first + count))
    assert snapshot(tmp_path) == before
    assert right < count or PLACES[place][3] is always  # a name that is looked up later may be anything


def urdf_of(names: list[str]) -> str:
    """Three moving joints and many fixed links, all with these names; a robot with the first of them."""
    quoted = [quoteattr("".join(letter for letter in name if letter not in XML) or "x") for name in names]
    unique = list(dict.fromkeys(quoted))
    inertial = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
    lines = [f"<robot name={quoted[0]}>", *(f"<link name={name}>{inertial}</link>" for name in unique)]
    for index, name in enumerate(unique[1:], 1):
        kind, parent = ("revolute", unique[index - 1]) if index <= 3 else ("fixed", unique[index % 3])
        ends = f"<parent link={parent}/><child link={name}/>"
        lines.append(f'<joint name={name} type="{kind}">{ends}<axis xyz="0 1 0"/></joint>')
    return "\n".join([*lines, "</robot>"])


def plain(robot: Robot) -> Robot:
    """The same robot with harmless names in the same places."""
    links = {robot.base: "ground", **{link.name: f"body{k}" for k, link in enumerate(robot.links)}}
    joints = tuple(
        replace(joint, name=f"joint{k}", parent=links[joint.parent], child=links[joint.child])
        for k, joint in enumerate(robot.joints)
    )
    bodies = tuple(replace(link, name=links[link.name]) for link in robot.links)
    return replace(robot, name="plain", base="ground", links=bodies, joints=joints)


def skeleton(source: Source) -> Iterator[str]:
    """What is left of the texts without words and blanks."""
    for text in (source.header, *source.codes.values(), source.cdef, source.meta):
        assert text.isascii()
        assert set(filter(lambda letter: not letter.isprintable(), text)) <= {"\n"}
        yield re.sub(r"\s+", "", re.sub(r"[A-Za-z0-9_]+", "w", unwrapped(text)))


def compiles(source: Source, folder: Path, *flags: str) -> None:
    for code in write_source(source, folder):
        command = ["cc", *(flags or ("-std=c99",)), *WARNINGS, "-O0", "-c", code.name, "-o", os.devnull]
        found = subprocess.run(command, cwd=folder, capture_output=True, text=True)
        assert (found.returncode, found.stderr) == (0, "")


@pytest.mark.parametrize("count", [PER_ROBOT, pytest.param(NAMES, marks=pytest.mark.soak)])
def test_names_in_urdf(count: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The source is that of a robot with plain names but for its words, which are identifiers; it compiles."""
    import sympy.parsing.sympy_parser as parser

    def fail(*_: object, **__: object) -> None:
        raise AssertionError("text went into SymPy's parser or a shell")

    monkeypatch.setattr(parser, "parse_expr", fail)
    monkeypatch.setattr(os, "system", fail)
    for first in range(0, count, PER_ROBOT):
        names = [hostile_name(seed) for seed in range(first, first + PER_ROBOT)]
        robot = robot_from_urdf(urdf_of(names), inertia="project")
        check_robot(robot)
        source, other = (source_of(made) for made in (robot, plain(robot)))
        assert list(skeleton(source)) == list(skeleton(other))
        if first % (10 * PER_ROBOT) == 0:
            compiles(source, tmp_path)


@pytest.mark.parametrize(
    "name",
    soaked(
        ("../../escape", "/tmp/../escape", "..", "a\0b", "-o x", "con/..\\x", "lambda"),
        ("../../escape", "a\0b", "-o x"),
    ),
)
def test_nothing_is_written_beside_the_output(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    work = tmp_path / "work"
    work.mkdir()
    monkeypatch.chdir(work)
    before = snapshot(tmp_path)
    robot = robot_from_urdf(urdf_of([name, "l", "m"]), inertia="project")
    folder = generate(robot, work / "out", ONE_LEVEL)
    new = snapshot(tmp_path) - before
    assert folder.parent == work / "out"
    assert folder.name == robot.name
    assert new
    assert all(path.is_relative_to(folder) or path == work / "out" for path in new)


@pytest.mark.parametrize("flags", [("-std=c99",), pytest.param(("-std=gnu17",), marks=pytest.mark.soak)], ids=str)
def test_words_of_c_as_names_of_everything(flags: tuple[str, ...], tmp_path: Path) -> None:
    """Keywords and macros: names stand in comments and behind prefixes only."""
    robot = robot_from_urdf(urdf_of(["arm", *WORDS]), inertia="project")
    assert {link.name for link in robot.links} == set(WORDS)
    compiles(source_of(robot), tmp_path, *flags)


@pytest.mark.parametrize("name", ["linux", "unix", "errno", "stdin", "environ"])
def test_macros_as_a_robots_name(name: str, built: Build) -> None:
    robot = replace(eomgen.load_robot("one_link"), name=name)
    assert built(robot, "mass_matrix", flags=("-O0", "-std=gnu17")).mass_matrix([0.0, 0.0]).shape == (2, 2)


@pytest.mark.parametrize("name", ["I", "E", "pi", "S", "lambda", "None", "__import__", "exec"])
def test_words_of_sympy_and_python_as_a_joint(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The closed form is that of any other name: names are symbols, never parsed."""
    printed = []
    for joint in (name, "other"):
        text = (Path(eomgen.__file__).parent / "robots" / "one_link.toml").read_text(encoding="utf-8")
        (tmp_path / "r.toml").write_text(
            text.replace('"joint1"', f'"{joint}"').replace("joints.joint1", f"joints.{joint}")
        )
        assert cli.main(["derive", str(tmp_path / "r.toml")]) == 0
        printed.append(re.sub(rf"(?<![A-Za-z0-9]){joint}\b|\s+", "", capsys.readouterr().out))
    assert printed[0] == printed[1]


@pytest.mark.parametrize(
    "name", ["../../etc/passwd", "package://../../../etc/passwd", "file:///etc/passwd", "a\0b", "\n"]
)
def test_file_names_of_meshes(name: str, tmp_path: Path) -> None:
    """What is no mesh is a note of one line; the link is drawn as a capsule."""
    needs("trimesh")
    mesh = f"<visual><geometry><mesh filename={quoteattr(name.replace(chr(0), ''))}/></geometry></visual>"
    text = urdf_of(["r", "l", "m"]).replace("</link>", mesh + "</link>")
    (tmp_path / "r.urdf").write_text(text)
    shapes, notes = urdf_shapes(eomgen.load_robot(tmp_path / "r.urdf"))
    assert shapes == []
    assert len(notes) == 3
    assert all(note.isascii() and note.isprintable() and "root:" not in note for note in notes)
    with pytest.raises(ValueError, match=r"there is no mesh|null"):
        mesh_path("nothing/" + name, tmp_path / "r.urdf")
