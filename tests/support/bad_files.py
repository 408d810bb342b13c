"""Hand-made bad files: content, and what the message must say of place, reason and remedy."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from eomgen.description.load import load_robot
from eomgen.scenario.load import load_scenario
from eomgen.sweep.plan import load_plan
from tests.support.description_samples import ARM, URDF

SCENARIO = 'duration = 1.0\n[motion]\ntype = "point_to_point"\ngoal = [1.0]\n'
PLAN = '[[vary]]\nscenario = "control.kd"\ngrid = { values = [1, 2] }\n'
MATRIX = ARM.replace("limits = [-1, 2]", "stiffness = { matrix = 'K.mtx' }")
CSV = ARM.replace("stiffness = 1e6", 'curve = "spring.csv"')


@dataclass(frozen=True)
class BadFile:
    """suffix: of robot.toml, robot.urdf, scenario.toml or plan.toml; place, reason, remedy: parts of the message.

    place: and in brackets the line.
    """

    name: str
    content: bytes
    place: str
    reason: str
    remedy: str

    @property
    def kind(self) -> str:
        """robot, scenario or plan."""
        return self.name.partition(".")[0]

    @property
    def spot(self) -> tuple[str, int | None]:
        """The place without its line, and the line."""
        found = re.fullmatch(r"(.*?) ?\(?line ([0-9]+)\)?", self.place)
        return (found[1], int(found[2])) if found else (self.place, None)


def bad(name: str, content: str | bytes, place: str, reason: str, remedy: str) -> BadFile:
    return BadFile(name, content if isinstance(content, bytes) else content.encode(), place, reason, remedy)


def changed(text: str, old: str, new: str) -> str:
    assert old in text
    return text.replace(old, new, 1)


def urdf_chain(count: int, mistake: str = "") -> str:
    """URDF of so many links in a chain whose last joint may have another child."""
    lines = ['<robot name="many">', *(f'<link name="l{k}"/>' for k in range(count))]
    for k in range(1, count):
        child = mistake if mistake and k == count - 1 else f"l{k}"
        lines.append(f'<joint name="j{k}" type="fixed"><parent link="l{k - 1}"/><child link="{child}"/></joint>')
    return "\n".join([*lines, "</robot>"])


def toml_chain(count: int) -> str:
    """The same as TOML."""
    lines = ["name = 'many'"]
    for k in range(count):
        parent = f"l{k - 1}" if k else "base"
        lines.append(f"[[links]]\nname = 'l{k}'\nmass = 1\n[[joints]]\nname = 'j{k}'")
        lines.append(f"parent = '{parent}'\nchild = 'l{k}'\ntype = 'fixed'")
    return "\n".join(lines)


def mjcf_chain(count: int) -> str:
    """The same as MJCF."""
    return "\n".join(["<mujoco><worldbody>", *count * ["<body>"], *count * ["</body>"], "</worldbody></mujoco>"])


def many_deep_tables(count: int) -> str:
    """So many tables, each as deep as one may be; the largest file has room for 43,000."""
    return "name = 'r'\n" + "".join(f"[x{k}.a.a.a.a.a.a.a]\n" for k in range(count))


def tunable_names(count: int) -> str:
    """So many different patterns of a chain's ``tunable``; some mean all links."""
    every = ["*.*.*", "links.*.*", "links.*.com", "links.*.inertia.*", "gravity.*"]
    single = [f"links.l{k % 1000}.{what}" for what in ("*", "com.*", "inertia", "com", "*.x") for k in range(1000)]
    return ", ".join(f"'{name}'" for name in [*every, *single][:count])


def many_attributes(count: int, first: int = 0) -> str:
    return " ".join(f"a{k}=''" for k in range(first, first + count))


def nested_classes(count: int) -> str:
    """Default classes, each inside of the one before, with 100 further attributes each."""
    inside = "".join(f"<default class='c{k}'><joint {many_attributes(100, 100 * k)}/>\n" for k in range(count))
    return f"<mujoco><default>{inside}{'</default>' * count}</default></mujoco>"


BOMB = "".join(f'<!ENTITY {chr(98 + k)} "{f"&{chr(97 + k)};" * 10}">\n' for k in range(9))

BAD_FILES = {
    "deep arrays": bad(
        "robot.toml", "name = 'a[['\ngravity = " + "[" * 50_000, "line 2", "nested too deeply", "a few levels deep"
    ),
    "deep inline tables": bad(
        "robot.toml", "links = " + "{ a = " * 20_000, "line 1", "nested too deeply", "a few levels"
    ),
    "deep dotted key": bad("robot.toml", "name = 'a'\n" + "a." * 50_000 + "a = 1", "line 2", "8 parts", "few"),
    "many deep tables": bad("robot.toml", many_deep_tables(20_000), "line 2", "unknown key 'x0'", "allowed: name"),
    "too many tables": bad("robot.toml", many_deep_tables(43_000), "line 20002", "20000 tables", "up to 20000"),
    "deep elements": bad("robot.urdf", '<robot name="r">' + "<a>" * 100_000, "line 1", "no element found", "</robot>"),
    "100,000 links": bad("robot.urdf", urdf_chain(100_000), "", "the file has", "up to 4194304"),
    "100,000 links, TOML": bad("robot.toml", toml_chain(100_000), "", "the file has", "up to 1048576"),
    "100,000 links, MJCF": bad("robot.xml", mjcf_chain(100_000), "line 5002", "100000 <body>", "up to 5000"),
    "30,000 links": bad("robot.urdf", urdf_chain(30_000), "line 5002", "there are 30000 links", "up to 5000"),
    "8,000 links, TOML": bad("robot.toml", toml_chain(8_000), "links[5000] (line 40002)", "8000 [[links]]", "5000"),
    "5,000 links, TOML": bad(
        "robot.toml", toml_chain(5000), "joints (line 5)", "no joint has a coordinate", "one joint that moves"
    ),
    "5,000 links, MJCF": bad(
        "robot.xml", mjcf_chain(5000), "joints (line 1)", "no joint has a coordinate", "one joint that moves"
    ),
    "5,000 links and a wrong one": bad(
        "robot.urdf", urdf_chain(5000, "l499x"), "joint 'j4999', <child> (line 10000)", "no link 'l499x'", "'l499'"
    ),
    "5,000 names of tunable, one wrong": bad(
        "robot.toml",
        toml_chain(1000)
        .replace("fixed", "revolute")
        .replace("\n", f"\ntunable = [{tunable_names(4999)}, 'links.l0.kom']\n", 1),
        "tunable (line 2)",
        "'links.l0.kom': no parameter has this name; did you mean 'links.l0.com'?",
        "joints.JOINT.offset",
    ),
    "one name of tunable again and again": bad(
        "robot.toml",
        toml_chain(1000).replace("\n", "\ntunable = [" + "'links.*.mass', " * 8000 + "]\n", 1),
        "tunable (line 2)",
        "got an array of 8000 values",
        "up to 5000 strings",
    ),
    "coordinates prescribed again and again": bad(
        "robot.toml",
        toml_chain(200) + "\nprescribed = ['y']".replace("'y'", "'y', " * 150_000),
        "joints.j199.prescribed (line 1602)",
        "got an array of 150000 values",
        "up to 5000 strings",
    ),
    "default classes of 100,000 attributes": bad(
        "robot.xml",
        f"<mujoco><default>\n<geom {many_attributes(100_000)}/></default>{mjcf_chain(4000)[8:]}",
        "default, <geom> (line 2)",
        "its class has 100000 attributes of <geom>",
        "up to 128",
    ),
    "nested default classes of many attributes": bad(
        "robot.xml", nested_classes(1500), "default, <joint> (line 2)", "its class has 200 attributes", "up to 128"
    ),
    "number of 5,000 digits": bad(
        "robot.toml", changed(ARM, "3.0", "3" * 5000), "line 8", "more than 4300 digits", "up to 1e+30"
    ),
    "fraction of 5,000 digits": bad(
        "robot.toml", changed(ARM, "3.0", "0." + "3" * 5000), "line 8", "more than 4300 digits", "up to 1e+30"
    ),
    "5,000 digits in a URDF": bad(
        "robot.urdf", changed(URDF, '"2.0"', f'"{"2" * 5000}"'), "<mass> (line 7)", "'2222", "a finite number"
    ),
    "NaN": bad("robot.toml", changed(ARM, "3.0", "nan"), "links.link1.mass (line 8)", "got nan", "a number"),
    "infinity": bad("robot.toml", changed(ARM, "-9.81", "+inf"), "gravity.2 (line 3)", "got inf", "a finite number"),
    "NaN in a URDF": bad("robot.urdf", changed(URDF, '"0.7"', '"NaN"'), "<dynamics> (line 19)", "'NaN'", "a finite"),
    "entity bomb": bad(
        "robot.urdf",
        f'<?xml version="1.0"?>\n<!DOCTYPE r [\n<!ENTITY a "aaaaaaaaaa">\n{BOMB}]>\n<robot name="&j;"/>',
        "line 2",
        "a document type or an entity",
        "plain elements",
    ),
    "entity of a file": bad(
        "robot.urdf",
        '<!DOCTYPE r [<!ENTITY e SYSTEM "file:///etc/passwd">]>\n<robot name="&e;"/>',
        "line 1",
        "an entity",
        "plain elements",
    ),
    "namespace bomb": bad(
        "robot.urdf",
        f'<robot name="r"\n xmlns:a="{"u" * 100_000}">' + "".join(f"<a:b{k}/>" for k in range(50_000)) + "</robot>",
        "line 1",
        "there is no <link>",
        "at least one link",
    ),
    "prefixes bomb": bad(
        "robot.urdf",
        '<robot name="r">' + "".join(f"<a{k}:b{k} c:d=''>" for k in range(80_000)) + "</robot>",
        "line 1",
        "mismatched tag",
        "closed first",
    ),
    "300,000 prefixes": bad(
        "robot.urdf",
        '<robot name="r">' + "".join(f"<a{k}:b/>" for k in range(300_000)) + "</robot>",
        "line 1",
        "there is no <link>",
        "at least one link",
    ),
    "200,000 declarations": bad("robot.urdf", "\n<?xml ?>" * 200_000, "line 200001", "no element found", "</robot>"),
    "truncated TOML": bad(
        "robot.toml", ARM[: ARM.index("0.2 }") + 3], "line 10", "end of document", "}, the table's end"
    ),
    "truncated string": bad("robot.toml", ARM[: ARM.index('tcp"') + 2], "line 35", "string", "the closing quotes"),
    "truncated URDF": bad("robot.urdf", URDF[: URDF.index("</joint>")], "line 20", "no element found", "</robot>"),
    "truncated tag": bad("robot.urdf", URDF[: URDF.index("velocity")], "line 18", "unclosed token", "inside of a tag"),
    "duplicate key": bad("robot.toml", changed(ARM, "mass = 3", "mass = 4\nmass = 3"), "line 9", "overwrite", "once"),
    "duplicate table": bad("robot.toml", ARM + "\n[a]\n[a]\n", "line 40", "twice", "each [table] once"),
    "duplicate attribute": bad(
        "robot.urdf",
        changed(URDF, 'xyz="0 1 0"', 'xyz="0 1 0" xyz="1 0 0"'),
        "line 17",
        "duplicate",
        "each attribute once",
    ),
    "duplicate link": bad(
        "robot.toml", changed(ARM, '"link2"', '"link1"'), "links.link1 (line 12)", "is taken", "unique names"
    ),
    "cycle": bad("robot.toml", changed(ARM, '"base"', '"link2"'), "joints.joint", "form a cycle", "a tree"),
    "cycle in a URDF": bad(
        "robot.urdf",
        changed(URDF, 'link="ground"/><c', 'link="lower"/><c'),
        "joints.elbow (line 21)",
        "cycle",
        "a tree",
    ),
    "Latin-1": bad(
        "robot.toml", "# länge\n".encode("latin-1") + ARM.encode(), "byte 3 (line 1)", "no UTF-8", "UTF-8 text"
    ),
    "UTF-16": bad("robot.urdf", URDF.encode("utf-16"), "byte 0 (line 1)", "no UTF-8", "UTF-8 text"),
    "a picture": bad(
        "robot.urdf", b"\x89PNG\r\n\x1a\n" + bytes(range(256)), "byte 0 (line 1)", "no UTF-8", "UTF-8 text"
    ),
    "nothing": bad("robot.toml", b"", "", "'name' is missing", "a lower-case letter"),
    "nothing in a URDF": bad("robot.urdf", b"", "line 1", "no element found", "<robot name='...'>"),
    "NUL": bad("robot.toml", b'name = "a\0"\n', "line 1", "Illegal character", "without control characters"),
    "another format": bad("robot.urdf", '<sdf version="1.6"/>', "line 1", "root element is 'sdf'", "'robot'"),
    "xacro": bad(
        "robot.urdf",
        '<robot name="r" xmlns:xacro="http://ros.org/wiki/xacro">\n<xacro:include filename="a"/></robot>',
        "robot (line 1)",
        "xacro macro",
        "that xacro has expanded",
    ),
    "misspelt key": bad(
        "robot.toml", changed(ARM, "stiffness", "stifness"), "joints.joint1.x (line 23)", "'stifness'", "'stiffness'"
    ),
    "unit in a number": bad(
        "robot.toml", changed(ARM, "3.0", '"3 kg"'), "links.link1.mass (line 8)", "got '3 kg'", "a number"
    ),
    "decimal comma": bad("robot.toml", changed(ARM, "3.0", "3,0"), "line 8", "Expected newline", "one key = value"),
    "impossible inertia": bad(
        "robot.toml",
        changed(ARM, "zz = 0.2", "zz = 2"),
        "links.link1.inertia (line 10)",
        "no body",
        'inertia = "project"',
    ),
    "curve without its file": bad("robot.toml", CSV, "spring.csv", "there is no such file", "deviation,force lines"),
    "curve of a folder above": bad(
        "robot.toml",
        CSV.replace("spring.csv", "../../etc/passwd"),
        "joints.joint1.x.curve (line 23)",
        "got",
        ".csv file",
    ),
    "matrix without its file": bad("robot.toml", MATRIX, "K.mtx", "there is no such file", "of one to six rows"),
    "matrix of a folder above": bad(
        "robot.toml",
        MATRIX.replace("K.mtx", "../../etc/passwd"),
        "joints.joint1.stiffness.matrix (line 25)",
        "got",
        ".mtx or .npz or .csv file",
    ),
    "scenario of infinity": bad("scenario.toml", "duration = inf\n", "duration (line 1)", "got inf", "at least 1e-09"),
    "scenario of a wrong type": bad(
        "scenario.toml",
        changed(SCENARIO, "point_to", "pint_to"),
        "motion.type (line 3)",
        "'pint_to_point'",
        "line, circle",
    ),
    "scenario cut short": bad("scenario.toml", SCENARIO[:-3], "line 4", "Unclosed array", "], the array's end"),
    "scenario with a deep goal": bad(
        "scenario.toml", changed(SCENARIO, "[1.0]", "[[1.0]]"), "motion.goal.0 (line 4)", "[1.0]", "a finite number"
    ),
    "scenario in Latin-1": bad("scenario.toml", b"# l\xe4nge\n", "byte 3 (line 1)", "no UTF-8", "UTF-8 text"),
    "scenario with a key twice": bad("scenario.toml", "duration = 1\n" * 2, "line 2", "overwrite", "each key once"),
    "scenario with a file that is none": bad(
        "scenario.toml",
        'duration = 1\n[motion]\ntype = "sampled"\nfile = "' + "a" * 5000 + '.csv"\n',
        "motion.file (line 4)",
        "does not exist",
        "an existing file",
    ),
    "plan of NaN": bad(
        "plan.toml", changed(PLAN, "[1, 2]", "[nan]"), "vary[0].grid.values.0 (line 3)", "nan", "finite"
    ),
    "plan of very many points": bad(
        "plan.toml",
        "".join(
            f"[[vary]]\nparameter = 'p{k}'\ngrid = {{ low = 0, high = 1, count = 1_000_000 }}\n" for k in range(40)
        ),
        "vary[1] (line 4)",
        "the grids have 1000000000000 points together",
        "up to 100000000",
    ),
    "plan of two grids": bad("plan.toml", PLAN * 2, "vary[1] (line 4)", "varies already", "once"),
}


READERS = {"robot": load_robot, "scenario": load_scenario, "plan": load_plan}


def written(case: BadFile, folder: Path) -> Path:
    path = folder / case.name
    path.write_bytes(case.content)
    return path
