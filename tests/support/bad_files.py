"""Hand-made bad files of all formats, each with parts of the message that refuses it: the table ``BAD``."""

from __future__ import annotations

import io
import re
import struct
import zipfile
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

from eomgen.description.load import load_robot
from eomgen.motion.csv_columns import read_csv
from eomgen.npz import read_npz
from eomgen.scenario.load import load_scenario
from eomgen.sweep.plan import load_plan
from tests.support import bad_texts
from tests.support.description_samples import ARM, URDF
from tests.support.sliders import STIFF

READERS: Mapping[str, Callable[[Path], Any]] = {  # by the names of files
    "robot.toml": load_robot,
    "robot.urdf": partial(load_robot, inertia="error"),
    "robot.xml": load_robot,
    "scenario.toml": load_scenario,
    "plan.toml": load_plan,
    "motion.csv": read_csv,
    "arrays.npz": read_npz,
}
COMMANDS: Mapping[str, list[str]] = {  # that read them, too
    "robot.toml": ["info", "robot.toml"],
    "robot.urdf": ["info", "robot.urdf", "--inertia", "error"],
    "robot.xml": ["info", "robot.xml"],
    "scenario.toml": ["simulate", "one_link", "--scenario", "scenario.toml", "-o", "out"],
    "plan.toml": ["sweep", "one_link", "--scenario", "puma560_circle", "--plan", "plan.toml", "-o", "out"],
}
Content = str | bytes | Callable[[], str]


@dataclass(frozen=True)
class Bad:
    """A file that is refused.

    Attributes:
        name: of the file, and of its reader.
        content: text or bytes, or a function that makes a long text.
        parts: of the message; the first one begins it behind the name of the file.
        line: number in the message; 0 where there is none, None where any is right.
        title: of the test.
        is_valid: whether a JSON schema cannot see what is wrong.
        beside: further files.
    """

    name: str
    content: Content
    parts: tuple[str, ...] = ("",)
    line: int | None = None
    title: str = ""
    is_valid: bool = False
    beside: Mapping[str, str] = field(default_factory=dict)

    @property
    def data(self) -> bytes:
        """The content as bytes."""
        content = self.content() if callable(self.content) else self.content
        return content.encode() if isinstance(content, str) else content

    def write(self, folder: Path) -> Path:
        """Write the files into a folder, and return the path of the bad one."""
        for name, text in self.beside.items():
            (folder / name).write_text(text, encoding="utf-8")
        (folder / self.name).write_bytes(self.data)
        return folder / self.name


def cases(name: str, table: str, build: Callable[[str, str], str]) -> Iterator[Bad]:
    """Return the cases of a table of ``bad_texts``, whose contents are made of ``OLD`` and ``NEW``."""
    heading = place = ""
    for line in table.replace("\n    ", " ").strip("\n").split("\n"):
        given, _, said = line.partition(" => ")
        if line.startswith("@"):
            heading, place = given[1:].strip(), said
            continue
        old, arrow, new = f"{given.removeprefix('~ ')} ".partition(" -> ")
        body = new if arrow else old
        number = re.match(r"(\d+):", said)
        parts = [part.strip() for part in said[number.end() if number else 0 :].split("|")]
        if place and parts[0].startswith("."):
            parts[0] = place + parts[0].removesuffix(".")
        yield Bad(
            name,
            build(_plain(old if arrow else heading), _plain(body)),
            tuple(parts),
            int(number[1]) if number else None,
            f"{heading[:20]} {given.removeprefix('~ ')[:60]}".strip(),
            given.startswith("~ "),
        )


def _plain(text: str) -> str:
    text = re.sub(r"<([^<>]+)\*(\d+)>", lambda found: found[1] * int(found[2]), text.strip())
    return re.sub(r" *;; *", "\n", text)


def changed(sample: str, old: str, new: str) -> str:
    """Return the sample with one part of it replaced."""
    assert old in sample, old
    return sample.replace(old, new, 1)


def entry(defaults: str, body: str) -> str:
    """Return the lines of a table: those of ``body`` instead of defaults; a key alone leaves it out."""
    lines = {line.partition(" =")[0]: line for line in defaults.split("\n")}
    lines |= {line.partition(" =")[0]: line if "=" in line else "" for line in body.split("\n")}
    return "\n".join(filter(None, lines.values()))


LINK = '[[links]]\nname = "{}"\nmass = 1\ninertia = {{ xx = 1, yy = 1, zz = 1 }}\n'
BOOM = """[[links]]
name = "boom"
beam.length = 0.5
beam.E = 7e10
beam.G = 2.6e10
beam.density = 2700
beam.section = { rod = 0.02 }
beam.modes = { y = 2 }"""
HINGE = '\n[[joints]]\nname = "hinge"\nparent = "link2"\nchild = "boom"\ntype = "revolute"\n'
SLIDES = """[[joints]]
name = "slides"
parent = "boom"
child = "trolley"
type = "prismatic"
along = "beam\""""
BEAM = """[[beams]]
name = "boom"
parent = "link2"
child = "tip"
length = 0.5
segments = 2
E = 7e10
G = 2.6e10
density = 2700
section = { rod = 0.02 }"""
LOOP = '[[loops]]\nname = "loop"\nlinks = ["link2", "base"]\ntype = "fixed"'
SPRING = '[[springs]]\nname = "rope"\nlinks = ["link2", "base"]'
ENTRIES: Mapping[str, Callable[[str], str]] = {  # entries of ARM that tables change
    "loop": lambda body: entry(LOOP, body),
    "spring": lambda body: entry(SPRING, body),
    "beam": lambda body: LINK.format("tip") + entry(BEAM, body),
    "bent": lambda body: entry(BOOM, body) + HINGE,
    "along": lambda body: BOOM + HINGE + LINK.format("trolley") + entry(SLIDES, body),
}


def _robot(old: str, new: str) -> str:
    if old not in ENTRIES:
        return changed(ARM, old, new)
    body, *further = re.split(r"(?m)^(?=\[\[)", new)
    return changed(ARM, "[[frames]]", f"{ENTRIES[old](body.strip())}\n{''.join(further)}\n[[frames]]")


SCENARIO = 'duration = 1.0\n[motion]\ntype = "point_to_point"\ngoal = [1.0]\n'
DURATION = "duration = 0.1\n"
MOTION = "[motion]\ntype = 'point_to_point'\n"
LINE = "[motion]\ntype = 'line'\nfrom = [0, 0, 1]\nto = [0, 0, 2]\n"
CIRCLE = "[motion]\ntype = 'circle'\ncenter = [0, 0, 0]\nnormal = [0, 0, 1]\nfrom = [1, 0, 0]\n"
SHAKEN = "[[prescribed]]\ntype = 'harmonic'\ncoordinate = 'a'\namplitude = 1\nfrequency = 1\n"
SPLINE = "[motion]\ntype = 'spline'\nspeed = 1\n"
PLAN = '[[vary]]\nscenario = "control.kd"\ngrid = { values = [1, 2] }\n'
GRID = "grid = { values = [1.0, 2.0] }\n"
UNIFORM = "uniform = { low = 1.0, high = 2.0 }\n"
WORDS = {"MOTION": MOTION, "LINE": LINE, "CIRCLE": CIRCLE, "SHAKEN": SHAKEN, "SPLINE": SPLINE}
WORDS |= {"STIFF": STIFF, "GRID": GRID, "UNIFORM": UNIFORM}


def _joined(heading: str, body: str) -> str:
    """Return the lines of both, with texts instead of their names."""
    return "\n".join(WORDS.get(line, line) for line in f"{heading}\n{body}".strip().split("\n"))


def urdf_chain(count: int, mistake: str = "") -> str:
    """Return a chain of so many links, whose last joint may have another child."""
    lines = ['<robot name="many">', *(f'<link name="l{k}"/>' for k in range(count))]
    for k in range(1, count):
        child = mistake if mistake and k == count - 1 else f"l{k}"
        lines.append(f'<joint name="j{k}" type="fixed"><parent link="l{k - 1}"/><child link="{child}"/></joint>')
    return "\n".join([*lines, "</robot>"])


def toml_chain(count: int, top: str = "", joint: str = "fixed") -> str:
    """Return the same as TOML, with a further line at its top."""
    lines = ["name = 'many'"] + [top] * bool(top)
    for k in range(count):
        lines.append(f"[[links]]\nname = 'l{k}'\nmass = 1\n[[joints]]\nname = 'j{k}'")
        lines.append(f"parent = '{f'l{k - 1}' if k else 'base'}'\nchild = 'l{k}'\ntype = '{joint}'")
    return "\n".join(lines)


def many_deep_tables(count: int) -> str:
    """Return so many tables, each as deep as one may be; the largest file has room for 43,000."""
    return "name = 'r'\n" + "".join(f"[x{k}.a.a.a.a.a.a.a]\n" for k in range(count))


def tunable_names(count: int) -> str:
    """Return so many different patterns of a chain's ``tunable``; some mean all links."""
    every = ["*.*.*", "links.*.*", "links.*.com", "links.*.inertia.*", "gravity.*"]
    single = [f"links.l{k % 1000}.{what}" for what in ("*", "com.*", "inertia", "com", "*.x") for k in range(1000)]
    return ", ".join(f"'{name}'" for name in [*every, *single][:count])


def elements(line: str, count: int, attribute: str = "") -> str:
    """Return a URDF of so many elements with a number in each."""
    return f'<robot name="r"{attribute}>' + "".join(line.format(k) for k in range(count)) + "</robot>"


def bomb() -> str:
    """Return entities that stand for ten of the one before each."""
    entities = "".join(f'<!ENTITY {chr(98 + k)} "{f"&{chr(97 + k)};" * 10}">\n' for k in range(9))
    return f'<?xml version="1.0"?>\n<!DOCTYPE r [\n<!ENTITY a "aaaaaaaaaa">\n{entities}]>\n<robot name="&j;"/>'


def bad(name: str, line: int | None, content: Content, *parts: str) -> Bad:
    return Bad(name, content, parts or ("",), line)


toml, urdf, xml = (partial(bad, f"robot.{ending}") for ending in ("toml", "urdf", "xml"))
scenario, plan, csv = (partial(bad, name) for name in ("scenario.toml", "plan.toml", "motion.csv"))
SOFT = ARM.replace('"revolute"', '"fixed"').replace('"prismatic"', '"fixed"')
STILL = re.sub("^(x|gamma|limits) = .*\n", "", SOFT, flags=re.MULTILINE)
CURVE, MATRIX = "joints.joint1.x.curve", "joints.joint1.stiffness.matrix"
BENT, STIFF_BASE = (partial(changed, ARM, old) for old in ("stiffness = 1e6", "limits = [-1, 2]"))
NAME, MOVES, BAD_TOML, BAD_XML = "name = 'r'\n", "no joint has a coordinate", "not valid TOML", "not well-formed XML"
DEEP, LARGE, UTF_8 = "not TOML that can be read: it is nested too deeply", "cannot be read: the file has", "is no UTF-8"
NO_LINK, NO_END = "there is no <link>", "no element found"
MADE = [  # contents that are long, or that are cut, or no text
    toml(2, "name = 'a[['\ngravity = " + "[" * 50_000, DEEP, "a few levels deep"),
    toml(1, "links = " + "{ a = " * 20_000, DEEP, "a few levels"),
    toml(2, "name = 'a'\n" + "a." * 50_000 + "a = 1", "", "8 parts", "few"),
    toml(None, "a." * 200 + "a = 1"),
    toml(None, "[" + "a . " * 30_000 + "a]"),
    toml(None, NAME + "links." * 500 + "a = 1"),
    toml(None, "[[links]]\n" * 1000),
    toml(0, NAME, "joints", MOVES),
    toml(
        None,
        "".join(f"[[links]]\nname = '{'a' * 120}{k}'\nmass = 1\n" for k in range(3_000))
        + f"[[joints]]\nname = 'j'\nparent = 'base'\ntype = 'free'\nchild = '{'a' * 128}'",
    ),
    toml(20002, lambda: many_deep_tables(43_000), "", "20000 tables", "up to 20000"),
    toml(0, lambda: toml_chain(100_000), LARGE, "up to 1048576"),
    toml(
        2,
        lambda: toml_chain(1000, "tunable = [" + "'links.*.mass', " * 8000 + "]"),
        *("tunable", "got an array of 8000 values", "up to 5000 strings"),
    ),
    toml(17, re.sub("(?m)^(limits|gamma|x) = ", "# ", SOFT), "joints", MOVES),
    toml(10, ARM[: ARM.index("0.2 }") + 3], BAD_TOML, "end of document", "}, the table's end"),
    toml(35, ARM[: ARM.index('tcp"') + 2], BAD_TOML, "string", "the closing quotes"),
    toml(40, ARM + "\n[a]\n[a]\n", BAD_TOML, "twice", "each [table] once"),
    toml(1, "# länge\n".encode("latin-1") + ARM.encode(), "byte 3", UTF_8, "UTF-8 text"),
    toml(None, b"", "the key 'name' is missing", "a lower-case letter"),
    toml(1, b'name = "a\0"\n', BAD_TOML, "Illegal character", "without control characters"),
    toml(0, BENT('curve = "s.csv"'), "s.csv: there is no such file", "deviation,force lines"),
    toml(23, BENT('curve = "../../etc/passwd"'), CURVE, "got", ".csv file"),
    toml(0, STIFF_BASE("stiffness = { matrix = 'K.mtx' }"), "K.mtx: there is no such file", "of one to six rows"),
    toml(25, STIFF_BASE("stiffness = { matrix = '../../etc/passwd' }"), MATRIX, "got", ".mtx or .npz or .csv file"),
    urdf(1, '<robot name="r">' + "<a>" * 100_000, BAD_XML, NO_END, "</robot>"),
    urdf(None, "<a>" * 50_000 + "</a>" * 50_000),
    urdf(None, elements("<link>", 30_000).replace("</robot>", "</link>" * 30_000 + "</robot>")),
    urdf(None, '<!DOCTYPE r [<!ENTITY % p SYSTEM "http://127.0.0.1:9/x"> %p;]><robot name="r"/>'),
    urdf(None, elements('<xi:include href="/etc/passwd"/>', 1, ' xmlns:xi="http://www.w3.org/2001/XInclude"')),
    urdf(
        1,
        elements('\n<xacro:include filename="a"/>', 1, ' xmlns:xacro="http://ros.org/wiki/xacro"'),
        *("robot", "xacro macro", "that xacro has expanded"),
    ),
    *(urdf(None, text) for text in ("\0", "<robot", elements("", 0), elements('<link name="a"/>', 1))),
    urdf(None, '<?xml version="1.0" encoding="klingon"?><robot name="r"/>'),
    urdf(1, b'<?xml version="1.0" encoding="latin-1"?><robot name="\xfc"/>', "byte 53", UTF_8, "UTF-8 text"),
    urdf(0, lambda: urdf_chain(100_000), LARGE, "up to 4194304"),
    urdf(10000, lambda: urdf_chain(5000, "l499x"), "joint 'j4999', <child>", "no link 'l499x'", "'l499'"),
    urdf(2, bomb(), "", "a document type or an entity", "plain elements"),
    urdf(1, '<!DOCTYPE r [<!ENTITY e SYSTEM "file:///etc/passwd">]>\n<robot name="&e;"/>', "", "an entity", "plain"),
    urdf(20, URDF[: URDF.index("</joint>")], BAD_XML, NO_END, "</robot>"),
    urdf(18, URDF[: URDF.index("velocity")], BAD_XML, "unclosed token", "inside of a tag"),
    urdf(2, re.sub('"(revolute|continuous)"', '"fixed"', URDF), "", MOVES),
    urdf(1, URDF.encode("utf-16"), "byte 0", UTF_8, "UTF-8 text"),
    urdf(1, b"\x89PNG\r\n\x1a\n" + bytes(range(256)), "byte 0", UTF_8, "UTF-8 text"),
    urdf(1, b"", BAD_XML, NO_END, "<robot name='...'>"),
    urdf(1, '<sdf version="1.6"/>', "", "root element is 'sdf'", "'robot'"),
    xml(1, "<robot/>", "robot", "no <link>"),
    scenario(1, "duration = inf\n", "duration", "got inf", "at least 1e-09"),
    scenario(3, changed(SCENARIO, "point_to", "pint_to"), "motion.type", "'pint_to_point'", "line, circle"),
    scenario(4, SCENARIO[:-3], BAD_TOML, "Unclosed array", "], the array's end"),
    scenario(4, changed(SCENARIO, "[1.0]", "[[1.0]]"), "motion.goal.0", "[1.0]", "a finite number"),
    scenario(1, b"# l\xe4nge\n", "byte 3", UTF_8, "UTF-8 text"),
    scenario(2, "duration = 1\n" * 2, BAD_TOML, "overwrite", "each key once"),
    scenario(
        4,
        'duration = 1\n[motion]\ntype = "sampled"\nfile = "' + "a" * 5000 + '.csv"\n',
        *("motion.file", "does not exist", "an existing file"),
    ),
    plan(3, changed(PLAN, "[1, 2]", "[nan]"), "vary[0].grid.values.0", "nan", "finite"),
    plan(4, PLAN * 2, "vary[1]", "varies already", "once"),
    csv(None, "t,joint1.x\n0,\N{ARABIC-INDIC DIGIT ONE}\n", "line 2:", "allowed: a finite number"),
    csv(None, "t,joint1.x\n0,1\0\n", "line 2:", "allowed: "),
    csv(None, "t;joint1.x,joint1.gamma\n0;1,2\n", "line 1: has , and ; between names", "allowed: one of commas, "),
    csv(None, "t;joint1.x\n0;1.5\n1;1,5\n", "line 3: decimal commas in a file with decimal points", "allowed: one"),
    csv(None, "t\tjoint1.x\n0\t1.234,5\n", "line 2: decimal points in a file with decimal commas", "allowed: one"),
    csv(None, "t;joint1.x\n0;1,234,567\n", "line 2: ", "'1,234,567'; allowed: a finite number"),
    csv(None, "t,joint1.x\n0,012,1,5\n", "line 2: 4 values; allowed: 2", "as in the header, and decimal points"),
    csv(None, "t;joint1.x\n0,1\n", "line 2: 1 values; allowed: 2", "with semicolons between them, as in the header"),
]
SLOW = [  # large ones, of whose kinds others are tried
    toml(None, lambda: NAME + "gravity = [" + "0, " * 100_000 + "]"),
    toml(None, lambda: BENT("curve = [" + "[0, 1], " * 30_000 + "]")),
    toml(2, lambda: many_deep_tables(20_000), "unknown key 'x0'", "allowed: name"),
    toml(40002, lambda: toml_chain(8_000), "links[5000]", "8000 [[links]]", "5000"),
    toml(5, lambda: toml_chain(5000), "joints", MOVES, "one joint that moves"),
    toml(
        2,
        lambda: toml_chain(1000, f"tunable = [{tunable_names(4999)}, 'links.l0.kom']", "revolute"),
        *("tunable", "'links.l0.kom': no parameter has this name; did you mean 'links.l0.com'?", "joints.JOINT.offset"),
    ),
    toml(
        1602,
        lambda: toml_chain(200) + "\nprescribed = [" + "'y', " * 150_000 + "]",
        *("joints.j199.prescribed", "got an array of 150000 values", "up to 5000 strings"),
    ),
    urdf(5002, lambda: urdf_chain(30_000), "", "there are 30000 links", "up to 5000"),
    urdf(1, lambda: elements("<a:b{}/>", 50_000, f'\n xmlns:a="{"u" * 100_000}"'), "", NO_LINK, "at least one link"),
    urdf(1, lambda: elements("<a{0}:b{0} c:d=''>", 80_000), BAD_XML, "mismatched tag", "closed first"),
    urdf(1, lambda: elements("<a{}:b/>", 300_000), "", NO_LINK, "at least one link"),
    urdf(200001, lambda: "\n<?xml ?>" * 200_000, "", NO_END, "</robot>"),
    plan(
        4,
        "".join(
            f"[[vary]]\nparameter = 'p{k}'\ngrid = {{ low = 0, high = 1, count = 1_000_000 }}\n" for k in range(40)
        ),
        *("vary[1]", "the grids have 1000000000000 points together", "up to 100000000"),
    ),
]


def npy(header: str, data: bytes = b"", version: tuple[int, int] = (1, 0)) -> bytes:
    """Return a file of an array with any header."""
    text = header.encode("latin1") + b"\n"
    return b"\x93NUMPY" + bytes(version) + struct.pack("<H", len(text)) + text + data


def header(shape: object = (1,), dtype: object = "'<f8'") -> str:
    return f"{{'descr': {dtype}, 'fortran_order': False, 'shape': {shape}, }}"


def archive(*entries: tuple[str, bytes]) -> bytes:
    """Return a ZIP file."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as made:
        for name, data in entries:
            made.writestr(name, data)
    return stream.getvalue()


ARRAYS = {
    "a petabyte": npy(header(f"({10**15},)")),
    "more than there is": npy(header(f"({10**30},)")),
    "a truth value as a length": npy(header("(True,)"), bytes(8)),
    "a negative length": npy(header("(-1,)"), bytes(8)),
    "a length that is text": npy(header("('1',)"), bytes(8)),
    "texts without characters": npy(header(f"({10**15},)", "'<U0'")),
    "no rows of many columns": npy(header(f"(0, {10**19})")),
    "objects": npy(header(dtype="'|O'"), bytes(8)),
    "a record with objects": npy(header(dtype="[('a', '|O')]"), bytes(8)),
    "dates": npy(header(dtype="'<M8[s]'"), bytes(8)),
    "complex numbers": npy(header(dtype="'<c16'"), bytes(16)),
    "fewer bytes": npy(header("(2,)"), bytes(8)),
    "further bytes": npy(header(), bytes(16)),
    "another version": npy(header(), bytes(8), (2, 0)),
    "no header": b"\x93NUMPY\1\0\xff\xff",
    "a header that is code": npy("__import__('os').abort()"),
    "a deep header": npy("(" * 5000 + ")" * 5000),
    "a long header": npy(" " * 60000 + header()),
    "no array": b"text",
    "nothing": b"",
    "many dimensions": npy(header((1,) * 100), bytes(8)),
}
ROBOTS = [
    *cases("robot.toml", bad_texts.ROBOTS, _robot),
    Bad("robot.toml", STILL, ("joints", MOVES, "allowed"), title="nothing moves", is_valid=True),
]
SCENARIOS = [*cases("scenario.toml", bad_texts.SCENARIOS, _joined)]
PLANS = [*cases("plan.toml", bad_texts.PLANS, _joined)]
BAD = [
    *(*ROBOTS, *SCENARIOS, *PLANS, *MADE),
    *cases("robot.urdf", bad_texts.URDFS, partial(changed, URDF)),
    *(
        replace(case, content=BENT('curve = "s.csv"'), beside={"s.csv": str(case.content)})
        for case in cases("robot.toml", bad_texts.CURVES, lambda _, body: body)
    ),
    *cases("motion.csv", bad_texts.MOTIONS, lambda _, body: f"t,joint1.x\n{body}\n"),
    *(Bad("arrays.npz", archive(("t.npy", data)), title=title) for title, data in ARRAYS.items()),
]
