"""The keys of scenarios: what each takes, its unit, and a line about it."""

from __future__ import annotations

from ..description.keys import inertia, vector
from ..forms.keys import (
    ByName,
    Choice,
    Either,
    FileName,
    Flag,
    Key,
    Keys,
    Listed,
    Number,
    Numbers,
    Strings,
    Text,
    Whole,
)
from ..forms.tables import Entries, Form, Kinds, Sub, angle_keys
from ..identifiers import IDENTIFIER_RULE
from ..kernel.stepping.methods import METHODS
from ..motion.point_to_point import MINIMUM_SNAP, QUINTIC, SMOOTHEST
from ..motion.timetable import INTERPOLATIONS

LEAST_TIME = 1e-9  # s
_BY = "m or rad"
_FRAME = Text("frame or link whose origin moves; default that of the scenario")
_BEGIN = Number("when it sets in; default 0", "s", minimum=0.0)
_SMOOTH = Either(
    "k: how many time derivatives are continuous; polynomials have degree 2 k + 1; minimum_snap is 3; default 2",
    options=(Whole("that many", least=QUINTIC, most=SMOOTHEST), Choice("of degree 7", words=(MINIMUM_SNAP,))),
    rule=f"a whole number from {QUINTIC} to {SMOOTHEST}, or '{MINIMUM_SNAP}'",
)
_INTERPOLATION = Choice("of rows: linear, or hold until the next; default linear", words=INTERPOLATIONS)


def time(about: str, needed: str = "") -> Number:
    """Return the key of a time that is not 0."""
    return Number(about, "s", needed, minimum=LEAST_TIME)


def _sampled(about: str) -> FileName:
    return FileName(about, "", "the path of a .csv or .npz file, relative to this file", suffixes=(".csv", ".npz"))


def _point(about: str) -> Either:
    return Either(
        about,
        _BY,
        options=(
            ByName("by joint; what is left out stays where it was"),
            Numbers("of all principal coordinates"),
        ),
    )


def _rows(columns: str) -> Listed:
    return Listed(f"[[t, {columns}], ...], t rising", item=Numbers(""), fewest=1, rule="one or more rows of numbers")


def _gain(about: str, unit: str, *, needed: bool = True) -> Either:
    number = Number("of all joints", minimum=0.0)
    rule = "a number, or a table of numbers by joint"
    options = (number, ByName("by joint; others have none", item=number))
    return Either(about, unit, rule if needed else "", options=options)


_RPY = "roll, pitch, yaw of the frame, base frame"
_AXES = Form(
    {
        **angle_keys("from", vector(f"{_RPY}, where the path begins; default as the joints let it", "rad")),
        **angle_keys("to", vector(f"{_RPY}, where it ends; default that of the beginning", "rad")),
    }
)
KEEP = "keep"
_KEEP = Choice("the orientation with which the path begins stays", words=(KEEP,))
_ORIENTATION = Either(
    "of the frame: 'keep', or turned about one axis from one to another; default as the joints let it",
    options=(_KEEP, Sub("turned from one to another", inner=_AXES)),
    rule="'keep', or a table with from and to, each roll, pitch, yaw in rad, or from_deg and to_deg",
)
_POSE = Form(
    {
        "xyz": vector("the frame's origin, base frame", "m", "a point, three numbers in m, base frame"),
        **angle_keys(
            "rpy",
            vector("roll, pitch, yaw: Rz(yaw) Ry(pitch) Rx(roll), base frame; of all points or of none", "rad"),
        ),
    }
)
_SPEED = Number("of all pieces", above=0.0)
MOTIONS: dict[str, Keys] = {
    "point_to_point": {
        "start": _point("where it begins; default the initial pose"),
        "goal": _point("where it ends"),
        "begin": _BEGIN,
        "smooth": _SMOOTH,
        "duration": time("how long it takes; default 80 percent of the scenario's"),
    },
    "via": {
        "points": Listed(
            "poses on the way",
            _BY,
            "an array of two or more points, each an array of numbers or a table by joint",
            item=_point(""),
            fewest=2,
            rule="an array of two or more points",
        ),
        "times": Numbers("of the points, rising; or speed", "s"),
        "speed": Either(
            "mean velocity of the fastest coordinate between two points, one or one for each piece; or times",
            "rad/s or m/s",
            options=(_SPEED, Numbers("of each piece", item=_SPEED)),
        ),
        "begin": _BEGIN,
        "smooth": _SMOOTH,
    },
    "sampled": {
        "file": _sampled("measured motion beside this file"),
        "wanted": FileName(
            "motion that this one corrects: results are compared with it; default the file's",
            suffixes=(".csv", ".npz"),
        ),
    },
    "line": {
        "frame": _FRAME,
        "from": vector("where the line begins, base frame", "m", "a point, three numbers in m, base frame"),
        "to": vector("where the line ends, base frame", "m", "a point, three numbers in m, base frame"),
        "orientation": _ORIENTATION,
        "begin": _BEGIN,
        "smooth": _SMOOTH,
        "duration": time("how long it takes; default 80 percent of the scenario's"),
    },
    "circle": {
        "frame": _FRAME,
        "center": vector("of the circle, base frame", "m", "three numbers, base frame"),
        "normal": vector("of its plane, base frame; any length but 0", "", "three numbers, base frame"),
        "from": vector("where it begins, base frame, in the plane", "m", "three numbers, base frame"),
        **angle_keys("angle", Number("right-handed about the normal, not 0; default 2 pi", "rad")),
        "orientation": _ORIENTATION,
        "begin": _BEGIN,
        "smooth": _SMOOTH,
        "duration": time("how long it takes; default 80 percent of the scenario's"),
    },
    "spline": {
        "frame": _FRAME,
        "points": Entries("in space on the way, two or more", "m, rad", "two or more points", inner=_POSE, fewest=2),
        "times": Numbers("of the points, rising; or speed", "s"),
        "speed": Either(
            "mean speed of the frame's origin between two points, one or one for each piece; or times",
            "m/s",
            options=(_SPEED, Numbers("of each piece", item=_SPEED)),
        ),
        "orientation": Choice(
            "'keep' holds that with which the path begins, where points have no rpy; default as the joints let it",
            words=(KEEP,),
        ),
        "begin": _BEGIN,
        "smooth": _SMOOTH,
    },
}
_SATURATE = Flag("true clips drives at +- the effort of the robot's limits; default false")
CONTROLS: dict[str, Keys] = {
    "none": {},
    "torque": {
        "file": FileName("CSV file with columns t and coordinates; or coordinates and rows", suffixes=(".csv",)),
        "coordinates": Strings("names of the columns behind the time", some=True, rule="one or more different names"),
        "rows": _rows("drives in N or N m, or what their inputs are"),
        "interpolation": _INTERPOLATION,
        "saturate": _SATURATE,
    },
    "pd": {
        "kp": _gain("drive per position error", "N/m or N m/rad"),
        "kd": _gain("drive per velocity error", "N s/m or N m s/rad"),
        "gravity": Flag("true adds gravity compensation of the rigid robot"),
        "saturate": _SATURATE,
    },
    "reference": {},
    "computed_torque": {
        "bandwidth": Number("w of the error's dynamics; default 30", "rad/s", above=0.0),
        "saturate": _SATURATE,
    },
    "feedforward": {
        "kp": _gain("drive per position error of drives; default 0", "N/m or N m/rad", needed=False),
        "kd": _gain("drive per velocity error of drives; default 0", "N s/m or N m s/rad", needed=False),
        "outputs": Strings(
            "what follows where deviations have no drive; default the tool's pose with six drives, else what is driven",
            some=True,
            rule="one or more names such as tcp.x and joint4.gamma, as many as drives",
        ),
        "tolerance": Number("of coordinates where deviations have no drive; default 1e-8", "m or rad", above=0.0),
        "saturate": _SATURATE,
    },
}
PRESCRIBED: dict[str, Keys] = {
    "harmonic": {
        "coordinate": Text("a prescribed coordinate", needed="a name such as joint1.x"),
        "amplitude": Number("of the sine", "m or rad", "m or rad"),
        "frequency": Number("of the sine", "Hz", "Hz", minimum=0.0),
        **angle_keys("phase", Number("at t = 0; default 0", "rad")),
        "offset": Number("what the sine is added to; default 0", "m or rad"),
    },
    "sampled": {"file": _sampled("measured motion beside this file, columns are prescribed coordinates")},
}
_SPAN: dict[str, Key] = {
    "t0": Number("acts from then on; default 0", "s", minimum=0.0),
    "t1": Number("acts until then; default the end", "s", minimum=0.0),
}
_LINK = Text("a link of the robot", needed="a link; " + IDENTIFIER_RULE)
WRENCH = Form(
    {
        "link": _LINK,
        "force": vector("constant force", "N"),
        "moment": vector("constant moment", "N m"),
        "axes": Choice(
            "of force and moment: base, or link, with which they turn; default base", words=("base", "link")
        ),
        "point": vector("where the force acts, link frame; default the centre of mass", "m"),
        **_SPAN,
        "file": FileName("CSV file with columns t, fx, fy, fz, mx, my, mz", suffixes=(".csv",)),
        "rows": _rows("fx, fy, fz, mx, my, mz"),
        "interpolation": _INTERPOLATION,
    }
)
PAYLOAD = Form(
    {
        "link": _LINK,
        "mass": Number("of the body", "kg", "a mass in kg greater than 0", above=0.0),
        "point": vector("its centre of mass, link frame", "m", "its centre of mass, link frame, m"),
        "inertia": Sub("about its centre of mass, link axes; default a point mass", "kg m^2", inner=inertia("")),
        **_SPAN,
    }
)
INITIAL = Form(
    {
        "q": ByName("coordinates at t = 0", "m or rad"),
        "v": ByName("velocities at t = 0", "m/s or rad/s"),
        "z": ByName("internal states at t = 0; default 0", "", named="states", by="state", depth=6, numbered=True),
        "equilibrium": Flag("true solves the static equilibrium near q"),
        "held": Strings("coordinates that are fixed where they are; with equilibrium = true"),
    }
)
INTEGRATOR = Form(
    {
        "method": Choice("of integration; default auto", words=METHODS),
        "rtol": Number("relative tolerance; default 1e-6", minimum=1e-13, below=1.0),
        "atol": Number("absolute tolerance; default by the sizes of coordinates", "m or rad", minimum=0.0),
        "step": time("of rk4; default by the fastest spring"),
    }
)
UNTIL = Form(
    {
        "coordinate": Text("a coordinate that reaches the value"),
        "value": Number("of the coordinate", "m or rad"),
        "frame": Text("frame or link that comes to the distance from the point"),
        "point": vector("base frame", "m"),
        "distance": Number("of the frame's origin from the point", "m", above=0.0),
    }
)
SCENARIO = Form(
    {
        "duration": time("of the simulation", "a time in s that is greater than 0"),
        "output_step": time("distance of the samples; default duration / 1000"),
        "frame": Text(
            "frame or link of poses and TCP errors; default tcp, the first frame, or the longest chain's end"
        ),
        "initial": Sub("state at t = 0", inner=INITIAL),
        "motion": Sub("reference trajectory", inner=Kinds("of the motion", MOTIONS)),
        "control": Sub("how joints are driven", inner=Kinds("of the control", CONTROLS)),
        "prescribed": Entries(
            "motions of the robot's prescribed coordinates", inner=Kinds("of the prescribed motion", PRESCRIBED)
        ),
        "wrenches": Entries("forces and moments on links", inner=WRENCH),
        "payloads": Entries("bodies that links pick up", inner=PAYLOAD),
        "until": Sub("where it ends before the duration does", inner=UNTIL),
        "integrator": Sub("how it is integrated", inner=INTEGRATOR),
    }
)
