"""The keys of robot descriptions: what each takes, its unit, and a line about it."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any, ClassVar

from ..bending.units import UNITS as FILE_UNITS
from ..bending.units import WORDS
from ..forms.keys import (
    ByName,
    Choice,
    Either,
    FileName,
    Flag,
    Key,
    Listed,
    Name,
    Number,
    Numbers,
    Place,
    RobotName,
    Strings,
    Text,
    Whole,
)
from ..forms.plain import field_types
from ..forms.tables import Entries, Few, Form, Pair, Sub, angle_keys
from ..identifiers import IDENTIFIER_RULE, ROBOT_RULE
from ..limits import MOST_BEAM_MODES, MOST_MODES, MOST_SEGMENTS
from ..robot import laws, numbers
from ..robot.coordinates import UNITS
from ..robot.elements import JOINT_ELEMENTS, KINDS, JointElement, LinkElement
from ..robot.elements.joint_damping import MOVED
from ..robot.elements.joint_element import MatrixElement
from ..robot.elements.matrices import ABOUT
from ..robot.geometry import Placement, Vector
from ..robot.inertia_policy import POLICIES
from ..robot.internal_states import bouc_wen, branches, bristles
from ..robot.internal_states.drives import DRIVE, LOOPS
from ..robot.joint_types import CUTS, JOINT_TYPES, OWN_COORDINATES, SYNONYMS
from ..robot.laws import POINTS
from ..robot.sections import SHAPES
from ..robot.value import AXES, COORDINATES, INERTIA_KEYS, LINEAR, MOTOR, BeamModes
from .matrix_files import ENDINGS

MODES_FILE = ".npz"
ROLES = ("free", "locked", "prescribed")
_LINKS = "two names, each 'base' or a link"
_NODE = "where it stands, as the tip of a beam; default root, the link's frame"
_NODES = Strings("of both links, where these bend; root: the link's frame", count=2, rule="two names of nodes, or root")
_MOMENTS = {
    **{key: f"moment of inertia about the axis {key[0]}" for key in INERTIA_KEYS[:3]},
    **{key: f"product of inertia, the entry {key} of the tensor" for key in INERTIA_KEYS[3:]},
}


def vector(about: str, unit: str, needed: str = "") -> Numbers:
    """Return the key of three numbers."""
    return Numbers(about, unit, needed, count=3)


def inertia(needed: str) -> Form:
    """Return the keys of an inertia tensor; ``needed``: message where one of the first three is missing."""
    return Form(
        {key: Number(about, "kg m^2", needed if key in INERTIA_KEYS[:3] else "") for key, about in _MOMENTS.items()}
    )


def _number(number: numbers.Number) -> Number:
    """Return the key of a law's number."""
    return Number(number.about, " or ".join(number.unit), number.needed, minimum=number.least)


def _curve(number: numbers.Number, what: str, unit: str) -> Either:
    """Return the key of a curve: force over ``what``, in ``unit``."""
    return Either(
        number.about,
        options=(
            Listed(
                f"{POINTS[0]} to {POINTS[1]} points, {what} rising",
                f"{unit}, {' or '.join(number.unit)}",
                item=Numbers("", count=2),
                fewest=POINTS[0],
                most=POINTS[1],
                rule=f"an array of {POINTS[0]} to {POINTS[1]} points [{what}, force]",
            ),
            FileName("path of a CSV file beside this one", suffixes=(".csv",)),
        ),
    )


def _numbers(law: laws.Law) -> dict[str, Key]:
    """Return the keys of a law's numbers, without the name of its table."""
    keys: dict[str, Key] = {
        number.key.removeprefix(f"{law.name}."): _number(number)
        for number in law.numbers
        if number.key not in laws.SHAPED
    }
    if law.name == "friction":
        keys["model"] = Choice(
            "lugre: friction with an internal state; without it a function of the velocity", words=bristles.MODELS
        )
        keys["shape"] = Choice("of Stribeck's curve: lorentzian (as it is without) or gaussian", words=laws.SHAPES)
    if law.name == bouc_wen.WOUND:
        keys["model"] = Choice("bouc_wen, as it is without", words=bouc_wen.MODELS)
    return keys


def _branches(law: laws.Law) -> dict[str, Key]:
    """Return the key of Maxwell branches: an array of them, or what they are fitted to."""
    first = {number.key.split(".")[2]: _number(number) for number in law.numbers[:2]}
    branch = {key: replace(kind, needed=f"a {key} in {kind.unit}, greater than 0") for key, kind in first.items()}
    fitted: dict[str, Key] = {
        "loss_factor": Number(
            "ratio of the imaginary to the real part of the complex stiffness over the band, with the stiffness there",
            "1",
            "a loss factor greater than 0",
            above=0.0,
        ),
        "band_hz": Numbers("lower and upper frequency of the band", "Hz", "two frequencies [lower, upper]", count=2),
        "branches": Whole("how many branches; default 4", least=1, most=branches.MOST_BRANCHES),
    }
    options = (Few(law.about, inner=Form(branch), most=branches.MOST_BRANCHES), Sub(law.about, inner=Form(fitted)))
    rule = "an array of branches { stiffness, damping }, or a table { loss_factor, band_hz, branches }"
    return {law.name: Either(law.about, options=options, rule=rule)}


def _drive() -> dict[str, Key]:
    """Return the keys of a drive: numbers, the winding, and the loops of a controller, of which one may stand alone."""
    keys: dict[str, Key] = {}
    inner: dict[str, dict[str, Key]] = {"winding": {}, **{loop: {} for loop in LOOPS}}
    for number in laws.LAWS[DRIVE].numbers:
        *tables, name = number.key.split(".")[1:]
        (inner[tables[-1]] if tables else keys)[name] = _number(number)
    loops: dict[str, Key] = {
        loop: Sub(f"loop that controls the {loop}: kp, ki, kd, filter, limit, tracking_time", inner=Form(inner[loop]))
        for loop in LOOPS
    }
    controller = Form(loops | inner[LOOPS[0]])
    about = "loops in cascade: position, velocity, current; or the numbers of one that controls the position"
    return {
        "lag": keys.pop("lag"),
        "winding": Sub("of its motor: resistance, inductance, torque_constant", inner=Form(inner["winding"])),
        **keys,
        "controller": Sub(about, inner=controller),
    }


def _law(law: laws.Law) -> dict[str, Key]:
    """Return the keys of a law in the table of its coordinate."""
    if law.name == branches.BRANCHES:
        return _branches(law)
    if law.has_points:
        return {law.name: _curve(law.numbers[0], "deviation", " or ".join(numbers.LENGTH))}
    keys = _drive() if law.name == DRIVE else _numbers(law)
    return {law.name: Sub(law.about, inner=Form(keys))} if law.has_table else {**keys}


_LAW: dict[str, Key] = {number.key: _number(number) for number in laws.BASIC}
for _entry in laws.LAWS.values():
    _LAW |= _law(_entry)
STOPS = Form(  # of a joint, whose limits say where they are
    {key: kind for key, kind in _numbers(laws.LAWS["stops"]).items() if key not in ("lower", "upper")}
)
LIMITS = Form(
    {
        "lower": Number("least value of the coordinate", "m or rad"),
        "upper": Number("greatest value of the coordinate", "m or rad"),
        "velocity": Number("greatest speed in both directions", "m/s or rad/s", above=0.0),
        "effort": Number("greatest force of its drive in both directions", "N or N m", above=0.0),
    }
)
_LIMITS = Sub("limits of its motion and of its drive: lower, upper, velocity, effort", inner=LIMITS)
COORDINATE = Form(
    {
        **_LAW,
        "limits": _LIMITS,
        "role": Choice("free (moves), locked (does not), prescribed (moves by itself)", words=ROLES),
    }
)
MOTOR_FORM = Form(
    {
        "inertia": Number(
            "of the rotor about its axis",
            "kg m^2",
            "the rotor's moment of inertia about its axis in kg m^2, greater than 0",
            above=0.0,
        ),
        "ratio": Number(
            "rotations of the motor per rotation of the joint, negative where the sense is reversed; not 0",
            "1, or rad/m",
            "the gear's ratio, rad of the motor per rad or m of the joint, not 0",
        ),
        **{key: kind for key, kind in _LAW.items() if key != "armature"},
        "limits": _LIMITS,
        "role": Choice("free, or prescribed: a motor that keeps to its angle", words=ROLES),
    }
)


def _joint_elements(owner: str) -> dict[str, Key]:
    """Return the tables of force elements of joints as wholes, "joints" or "loops"."""
    return {
        table: Sub(kind.ABOUT[owner], kind.UNITS[0], inner=_element_numbers(kind, owner == "joints"))
        for table, kind in JOINT_ELEMENTS.items()
        if owner in kind.FAMILIES
    }


def _element_numbers(kind: type[JointElement], in_tree: bool) -> Form:
    """Return the keys of such a table: numbers, then tables of those whose names have a dot, or a matrix.

    Isotropic damping is that of joints of the tree alone.
    """
    keys: dict[str, Key] = {}
    inner: dict[str, dict[str, Key]] = {}
    if issubclass(kind, MatrixElement):
        left = () if in_tree else tuple(MOVED)
        plain: dict[str, Key] = {x: _number(y) for x, y in kind.NUMBERS.items() if "." not in x and x not in left}
        return Form(plain | {key: form for key, form in _MATRIX.items() if key in kind.ABOUT})
    for key, number in kind.NUMBERS.items():
        table, _, name = key.rpartition(".")
        (inner.setdefault(table, {}) if table else keys)[name] = _number(number)
    return Form(keys | {table: Sub(kind.ABOUT[table], inner=Form(entries)) for table, entries in inner.items()})


@dataclass(frozen=True, eq=False, repr=False)
class Matrix(Key):
    """A square matrix of numbers, one to six rows."""

    form = list
    rule: ClassVar[str] = (
        "rows of as many numbers as there are rows, one to six, [[...], ...], or the path of a file that ends in"
        f" {', '.join(ENDINGS)}"
    )
    row: ClassVar[Numbers] = Numbers("")

    def take(self, table: Place, key: str, value: Any) -> list[tuple[float, ...]]:
        if not isinstance(value, list) or not 1 <= len(value) <= len(COORDINATES):
            self.refuse(table, key, value, self.rule)
        if not all(isinstance(row, list) for row in value):
            self.refuse(table, key, value, self.rule)
        return [self.row.take(table, f"{key}.{i}", row, len(value)) for i, row in enumerate(value)]

    def json(self) -> dict[str, Any]:
        row = {"type": "array", "items": self.row.item.json(), "minItems": 1, "maxItems": len(COORDINATES)}
        return {"type": "array", "items": row, "minItems": 1, "maxItems": len(COORDINATES)}


PLACEMENT = Form(
    {
        "xyz": vector("origin", "m"),
        **angle_keys("rpy", vector("roll, pitch, yaw: Rz(yaw) Ry(pitch) Rx(roll)", "rad")),
    }
)
_MATRIX: dict[str, Key] = {
    "matrix": Either(
        ABOUT["matrix"],
        options=(Matrix("rows"), FileName("path of a file with it beside this one", suffixes=ENDINGS)),
    ),
    "at": Sub(ABOUT["at"], "m, rad", inner=PLACEMENT),
    "preload": Numbers(ABOUT["preload"], "N, N m"),
}
DH = Form(
    {
        "a": Number("along x of the parent", "m"),
        **angle_keys("alpha", Number("about x of the parent", "rad")),
        "d": Number("along z of the joint", "m"),
        **angle_keys("theta", Number("about z of the joint", "rad")),
    }
)
_AXES = {
    key: f"along {key}" if key in LINEAR else f"about {axis}" for key, axis in zip(COORDINATES, "xyzxyz", strict=True)
}
_OFFSET = Sub(
    "constants that are added to the coordinates, whether they move or not",
    "m, rad",
    inner=Form({key: Number(axis, UNITS[key]) for key, axis in _AXES.items()}),
)
JOINT = Form(
    {
        "name": Name("of the joint, unique", needed=IDENTIFIER_RULE),
        "parent": Text("'base' or the link that carries the joint", needed="'base' or a link"),
        "node": Text(f"of the parent, where that bends: {_NODE}"),
        "along": Choice(
            "beam: a prismatic joint slides along the parent, a beam that bends; z is the distance from its root",
            words=("beam",),
        ),
        "child": Text("the link that the joint carries", needed="a link"),
        "type": Choice(
            ", ".join(f"{name} ({JOINT_TYPES[name].about})" for name in OWN_COORDINATES),
            needed=", ".join(OWN_COORDINATES),
            words=tuple(OWN_COORDINATES),
            synonyms=SYNONYMS,
        ),
        "pitch": Number("of a screw: z = pitch gamma / (2 pi); negative where the thread is left-handed", "m"),
        "dh": Sub("modified Denavit-Hartenberg: Rx(alpha) Tx(a) Rz(theta) Tz(d)", "m, rad", inner=DH),
        "placement": Sub("pose of the joint's frame in the parent link's", "m, rad", inner=PLACEMENT),
        **{
            key: Sub(
                f"coordinate {key}, {axis} of the joint: it moves where this table is, also an empty one",
                inner=COORDINATE,
            )
            for key, axis in _AXES.items()
        },
        MOTOR: Sub(
            "a motor behind an elastic gear (flexible joint, SEA) drives the principal coordinate", inner=MOTOR_FORM
        ),
        **_joint_elements("joints"),
        "limits": Numbers("lower and upper limit of the principal coordinate, in short", "m or rad", count=2),
        "stops": Sub("contacts at the limits: stiffness, damping, restitution_damping, smoothing", inner=STOPS),
        "prescribed": Strings("coordinates with prescribed motion", words=(*COORDINATES, MOTOR)),
        "offset": _OFFSET,
    },
    refines=True,
)
FRAME = Form(
    {
        "name": Name("of the frame, unique", needed=IDENTIFIER_RULE),
        "link": Text("'base' or the link that it stands on", needed="'base' or a link"),
        "node": Text(f"of the link, where that bends: {_NODE}"),
        "placement": Sub("pose in the link's frame", "m, rad", inner=PLACEMENT),
    }
)
CUT_COORDINATE = Form({key: kind for key, kind in _LAW.items() if key not in ("armature", DRIVE)})
SECTION = Form(
    {
        name: Number(shape.about, "m", above=0.0)
        if len(shape.names) == 1
        else Numbers(shape.about, "m", count=len(shape.names), item=Number("", above=0.0))
        for name, shape in SHAPES.items()
    }
)
_MATERIAL_AND_SECTION: dict[str, Key] = {
    "E": Number("Young's modulus", "N/m^2", "Young's modulus in N/m^2, greater than 0", above=0.0),
    "G": Number("shear modulus", "N/m^2", "the shear modulus in N/m^2, greater than 0", above=0.0),
    "density": Number("of its material", "kg/m^3", "a density in kg/m^3, greater than 0", above=0.0),
    "section": Sub(f"from which A, Iy, Iz, J and shear follow: {', '.join(SHAPES)}", inner=SECTION),
    "A": Number("area of the section", "m^2", above=0.0),
    "Iy": Number("second moment of area about y of the section", "m^4", above=0.0),
    "Iz": Number("second moment of area about z of the section", "m^4", above=0.0),
    "J": Number("torsion constant", "m^4", above=0.0),
    "shear": Numbers("shear coefficients along y and z of the section", "1", count=2, item=Number("", above=0.0)),
}
_LENGTH = Number("from the root to the tip", "m", "a length in m, greater than 0", above=0.0)
LINK_BEAM = Form(
    {
        "axis": Choice("of the link's frame along which it runs, from the origin on; default x", words=tuple(AXES)),
        "length": _LENGTH,
        **_MATERIAL_AND_SECTION,
        "modes": Sub(
            "how many: y and z bend it along these axes of the section, torsion, axial",
            needed="a table of whole numbers, { y = 2, z = 2, torsion = 1, axial = 1 }",
            inner=Form(
                {
                    item.name: Whole("number of modes; default 0", least=0, most=MOST_BEAM_MODES)
                    for item in fields(BeamModes)
                }
            ),
        ),
        "nodes": ByName(
            "places on its axis where something stands, by names; the tip is one without",
            "m",
            item=Number("distance from the root", above=0.0),
            named="nodes",
            by="node",
            depth=1,
        ),
    }
)
LINK_MODES = Form(
    {
        "file": FileName(
            "path of the file, beside this one",
            needed=f"the path of a {MODES_FILE} file, relative to this file",
            suffixes=(MODES_FILE,),
        ),
        "placement": Sub("pose of the file's axes in the link's frame", "m, rad", inner=PLACEMENT),
        "count": Whole(
            "of finite elements: modes beside six of each interface; default the file's", least=0, most=MOST_MODES
        ),
        "units": Choice(f"of finite elements: {WORDS}; default m", words=tuple(FILE_UNITS)),
    }
)
LINK = Form(
    {
        "name": Name("of the link, unique", needed=IDENTIFIER_RULE),
        "mass": Number("mass of the body; needed unless it bends", "kg", minimum=0.0),
        "com": vector("centre of mass in the link's frame; default its origin", "m"),
        "inertia": Sub(
            "inertia tensor about the centre of mass, link axes",
            "kg m^2",
            inner=inertia("a moment of inertia in kg m^2 about the centre of mass"),
        ),
        "beam": Sub("a straight beam, which bends: mass, com and inertia follow from it", inner=LINK_BEAM),
        "modes": Either(
            "of a link that bends: a file of its modes or finite elements, beside this one",
            options=(FileName("path of the file", suffixes=(MODES_FILE,)), Sub("the file, and how", inner=LINK_MODES)),
        ),
        "modal_damping": Number("of each mode, as a part of critical damping", "1", minimum=0.0),
    },
    refines=True,
)
BEAM = Form(
    {
        "name": Name("of the beam, unique: its links and joints are NAME0, NAME1, ...", needed=IDENTIFIER_RULE),
        "parent": Text("'base' or the link that its root is fixed to", needed="'base' or a link"),
        "child": Text("the link that its tip carries", needed="a link"),
        "placement": Sub("pose of its root in the parent link's frame", "m, rad", inner=PLACEMENT),
        "axis": Choice("of the root's frame along which it runs; default x", words=tuple(AXES)),
        "length": _LENGTH,
        "segments": Whole(
            "number of segments, each with an elastic joint in its middle",
            needed=f"a whole number from 1 to {MOST_SEGMENTS}",
            least=1,
            most=MOST_SEGMENTS,
        ),
        **_MATERIAL_AND_SECTION,
        "damping": Either(
            "of its material, proportional to the stiffness",
            options=(
                Sub(
                    "ratio or loss_factor, at the frequency at_hz",
                    inner=Form(
                        {
                            "ratio": Number("of critical damping", "1", minimum=0.0),
                            "loss_factor": Number("tangent of the loss angle", "1", minimum=0.0),
                            "at_hz": Number(
                                "frequency where that holds", "Hz", "a frequency in Hz, greater than 0", above=0.0
                            ),
                        }
                    ),
                ),
                Number("damping by stiffness", "s", minimum=0.0),
                Numbers(
                    f"the same for each of {', '.join(COORDINATES)}",
                    "s",
                    count=len(COORDINATES),
                    item=Number("", minimum=0.0),
                ),
            ),
            rule="a table with ratio or loss_factor and at_hz, a number in s, or six",
        ),
        "rigid": Strings(
            "coordinates of segments that do not move; x along the beam, alpha its twist",
            rule=f"some of {', '.join(COORDINATES)}, each once",
            words=COORDINATES,
            some=True,
        ),
    }
)
LOOP = Form(
    {
        "name": Name("of the loop joint, unique", needed=IDENTIFIER_RULE),
        "links": Strings("the two links that it joins, either may be 'base'", needed=_LINKS, count=2, rule=_LINKS),
        "nodes": _NODES,
        "type": Choice("of the loop joint", needed=", ".join(CUTS), words=tuple(CUTS), synonyms=SYNONYMS),
        "placements": Pair("the loop joint's frame on both links; default their frames", "m, rad", inner=PLACEMENT),
        **{
            key: Sub(
                f"coordinate {key}, {axis} of the loop joint: with this table it has these forces in the place of the"
                " type's constraint",
                inner=CUT_COORDINATE,
            )
            for key, axis in _AXES.items()
        },
        **_joint_elements("loops"),
        "offset": _OFFSET,
    }
)
COUPLING = Form(
    {
        "name": Name("of the coupling, unique", needed=IDENTIFIER_RULE),
        "of": Text("the coordinate that follows, such as 'finger2.gamma'", needed="the name of a coordinate"),
        "to": ByName(
            "ratios by the coordinates that it follows; { } where it keeps to the offset",
            "1, m/rad or rad/m",
            "a table of ratios by coordinate",
        ),
        "offset": Number("added to the sum of ratio * coordinate", "m or rad"),
        **CUT_COORDINATE.keys,
    }
)


@dataclass(frozen=True, eq=False, repr=False)
class Diagonal(Numbers):
    """Six numbers, none of them negative, for the coordinates of a frame as seen from another."""

    count: int | None = len(COORDINATES)

    def take(self, table: Place, key: str, value: Any, count: int | None = None) -> tuple[float, ...]:
        if isinstance(value, list) and any(isinstance(x, list) for x in value):
            self.refuse(table, key, value, f"six numbers, for {', '.join(COORDINATES)}, or a table {{ matrix = ... }}")
        if not isinstance(value, list) or len(value) != self.count:
            self.refuse(table, key, value, f"six numbers, for {', '.join(COORDINATES)}")
        return super().take(table, key, value, count)


def _element_key(kind: type[LinkElement], name: str, hint: Any) -> Key:
    """Return the key of a field of a force element between links, by its type."""
    about = kind.ABOUT.get(name, "")
    if name == "curve":
        return _curve(kind.NUMBERS[name], "elongation", "m")
    if name in kind.NUMBERS:
        return _number(kind.NUMBERS[name])
    if hint is bool:
        return Flag(about)
    if hint == tuple[Placement, Placement]:
        return Pair(about, "m, rad", inner=PLACEMENT)
    if hint == tuple[Vector, Vector]:
        return Listed(about, "m", item=vector("", ""), fewest=2, most=2, rule="two points, one on each link")
    six = [kind.NUMBERS[f"{name}.{x}"] for x in COORDINATES]
    numbers = Diagonal(about, " and ".join(dict.fromkeys(x.unit[0] for x in six)), item=Number("", minimum=0.0))
    matrix = Sub(JOINT_ELEMENTS[name].ABOUT["frames"], inner=_element_numbers(JOINT_ELEMENTS[name], False))
    return Either(about, options=(numbers, matrix))


def _element_form(kind: type[LinkElement]) -> Form:
    """Return the keys of an entry of force elements between links: a name, the links, and the fields behind them."""
    hints = field_types(kind)
    return Form(
        {
            "name": Name(f"of the {kind.KIND}, unique", needed=IDENTIFIER_RULE),
            "links": Strings("the two links that it joins, either may be 'base'", needed=_LINKS, count=2, rule=_LINKS),
            "nodes": _NODES,
            **{item.name: _element_key(kind, item.name, hints[item.name]) for item in fields(kind)[2:]},
        }
    )


ELEMENTS = {table: _element_form(kind) for table, kind in KINDS.items()}
ROBOT = Form(
    {
        "name": RobotName("of the robot: file, module and C prefix", needed=ROBOT_RULE),
        "gravity": vector("in the base frame; default [0, 0, -9.81]", "m/s^2"),
        "urdf": FileName("path of a URDF beside this file; entries refine it by name", suffixes=(".urdf",)),
        "inertia": Choice(
            "what to do with an inertia that no body can have; default error, for those of the URDF warn",
            words=POLICIES,
        ),
        "tunable": Strings("names of numbers that stay run-time parameters; * stands for one component"),
        "stops": Sub("contacts at the limits of all joints that have limits and no key stops", inner=STOPS),
        "driven": Strings("coordinates with a drive; default the principal ones"),
        "home": ByName("where simulations start and assembly begins, by coordinate; default 0", "m or rad"),
        "links": Entries("rigid bodies", inner=LINK),
        "joints": Entries("joints with one to six coordinates", inner=JOINT),
        "beams": Entries("elastic beams between two links, as chains of segments", inner=BEAM),
        "frames": Entries("points whose pose and Jacobian can be asked for", inner=FRAME),
        "loops": Entries("loop joints, cut so that the rest is a tree", inner=LOOP),
        "couplings": Entries(
            "coordinates that move together, as by a gear: rigid, or elastic with a stiffness", inner=COUPLING
        ),
        **{table: Entries(kind.TITLE, inner=ELEMENTS[table]) for table, kind in KINDS.items()},
    },
    refines=True,
)
