"""Scenarios that the reader refuses, whatever the robot."""

from __future__ import annotations

DURATION = "duration = 0.1\n"
MOTION = "[motion]\ntype = 'point_to_point'\n"
LINE = "[motion]\ntype = 'line'\nfrom = [0, 0, 1]\nto = [0, 0, 2]\n"
CIRCLE = "[motion]\ntype = 'circle'\ncenter = [0, 0, 0]\nnormal = [0, 0, 1]\nfrom = [1, 0, 0]\n"
SHAKEN = "[[prescribed]]\ntype = 'harmonic'\ncoordinate = 'a'\namplitude = 1\nfrequency = 1\n"
SPLINE = "[motion]\ntype = 'spline'\nspeed = 1\n"

READING = [  # what the reader refuses, whatever the robot: text, place, reason
    ("", "the key 'duration' is missing", "a time in s"),
    ("duration = 0", "duration", "got 0; allowed: a number that is at least 1e-09"),
    ("duration = 'long'", "duration", "got 'long'; allowed: a number that is at least 1e-09"),
    ("duration = nan", "duration", "got nan; allowed: a number that is at least 1e-09"),
    ("duration = 1\ndurations = 2", "", "unknown key 'durations'; did you mean 'duration'?"),
    ("duration = = 1", "", "not valid TOML"),
    (DURATION + "output_step = -1", "output_step", "got -1"),
    (DURATION + "frame = 3", "frame", "got 3; allowed: a string"),
    (DURATION + "initial = 3", "initial", "got 3; allowed: a table"),
    (DURATION + "[initial]\nq = [1.0]", "initial.q", "a table of numbers"),
    (DURATION + "[initial]\nq = { a = 'x' }", "initial.q.a", "got 'x'; allowed: a finite number"),
    (DURATION + "[initial]\nq = { 'a b' = 1 }", "initial.q", "got the name 'a b'"),
    (DURATION + "[initial]\nz = 1.0", "initial.z", "a table of numbers by state"),
    (
        DURATION + "[initial]\nz = { a.x.friction.z = 'x' }",
        "initial.z.a.x.friction.z",
        "got 'x'; allowed: a finite number",
    ),
    (DURATION + "[initial]\nz = { 'a b' = 1 }", "initial.z", "got the name 'a b'; allowed: names of states"),
    (DURATION + "[initial]\nequilibrium = 1", "initial.equilibrium", "got 1; allowed: true or false"),
    (DURATION + "[initial]\nequilibrium = true\nv = { a = 1 }", "initial.v", "static equilibrium"),
    (DURATION + "[initial]\nheld = ['a']", "initial.held", "with equilibrium = true only"),
    (DURATION + "[motion]\ngoal = [1]", "motion", "the key 'type' is missing; allowed: point_to_point"),
    (DURATION + "[motion]\ntype = 'spiral'", "motion.type", "got 'spiral'"),
    (DURATION + MOTION + "points = [[1]]", "motion", "unknown key 'points'"),
    (DURATION + MOTION + "goal = ['x']", "motion.goal.0", "got 'x'"),
    (DURATION + MOTION + "duration = 0", "motion.duration", "got 0"),
    (DURATION + "[motion]\ntype = 'via'\npoints = [[1]]\nspeed = 1", "motion.points", "two or more"),
    (DURATION + "[motion]\ntype = 'via'\npoints = [[1], [2]]", "motion", "times or speed"),
    (DURATION + "[motion]\ntype = 'via'\npoints = [[1], [2]]\ntimes = [1, 1]", "motion.times", "increasing"),
    (DURATION + "[motion]\ntype = 'via'\npoints = [[1], [2]]\ntimes = [1]", "motion.times", "an array of 2 numbers"),
    (DURATION + "[motion]\ntype = 'via'\npoints = [[1], [2]]\nspeed = 0", "motion.speed", "greater than 0"),
    (
        DURATION + "[motion]\ntype = 'sampled'\nfile = 'm.txt'",
        "motion.file",
        "got 'm.txt'; allowed: the path of a .csv",
    ),
    (DURATION + "[motion]\ntype = 'sampled'\nfile = 'm.csv'", "motion.file", "does not exist"),
    (DURATION + "[motion]\ntype = 'line'\nfrom = [0, 0, 1]", "motion", "the key 'to' is missing"),
    (DURATION + "[motion]\ntype = 'line'\nfrom = [0, 0, 1]\nto = [0, 0, 1]", "motion.to", "another point"),
    (
        DURATION + "[motion]\ntype = 'circle'\ncenter = [0, 0, 0]\nnormal = [0, 0, 1]\nfrom = [1, 0, 1]",
        "motion.from",
        "in the plane",
    ),
    (
        DURATION + "[motion]\ntype = 'circle'\ncenter = [0, 0, 0]\nnormal = [0, 0, 0]\nfrom = [1, 0, 1]",
        "motion.normal",
        "not zero",
    ),
    (DURATION + CIRCLE + "angle = 0", "motion.angle", "got 0; allowed: an angle in rad other than 0"),
    (DURATION + CIRCLE + "angle_deg = 0.0", "motion.angle_deg", "got 0.0; allowed: an angle in deg other than 0"),
    (DURATION + CIRCLE + "angle_deg = 5e-324", "motion.angle_deg", "an angle in deg other than 0"),
    (DURATION + CIRCLE + "angle = 1\nangle_deg = 9", "motion.angle_deg", "angle (rad) is given, too"),
    (DURATION + CIRCLE + "angle_deg = 'x'", "motion.angle_deg", "got 'x'"),
    (DURATION + LINE + "orientation = 3", "motion.orientation", "'keep', or a table with from and to"),
    (DURATION + LINE + "orientation = 'kept'", "motion.orientation", "did you mean 'keep'"),
    (DURATION + LINE + "orientation = {}", "motion.orientation", "from, to, or both"),
    (
        DURATION + LINE + "orientation = { to = [1, 2, 3], to_deg = [1, 2, 3] }",
        "motion.orientation.to_deg",
        "to (rad) is given, too",
    ),
    (
        DURATION + SPLINE + "points = [{ xyz = [0, 0, 1], rpy_deg = [9, 0, 0] },"
        " { xyz = [0, 0, 2], rpy = [0, 0, 1], rpy_deg = [9, 0, 0] }]",
        "motion.points[1].rpy_deg",
        "rpy (rad) is given, too",
    ),
    (DURATION + LINE + "orientation = { to = [1, 2] }", "motion.orientation.to", "an array of 3 numbers"),
    (DURATION + SPLINE + "points = [{ xyz = [0, 0, 1] }]", "motion.points", "two or more"),
    (DURATION + SPLINE + "points = [{ xyz = [0, 0, 1] }, { rpy = [0, 0, 1] }]", "motion.points[1]", "'xyz' is missing"),
    (DURATION + SPLINE + "points = [{ xyz = [0, 0, 1] }, { xyz = [0, 0, 1] }]", "motion.points[1]", "another point"),
    (
        DURATION + SPLINE + "points = [{ xyz = [0, 0, 1], rpy = [0, 0, 1] }, { xyz = [0, 0, 2] }]",
        "motion.points[1]",
        "'rpy' is missing, which other points have",
    ),
    (
        DURATION + SPLINE + "orientation = 'keep'\npoints = [{ xyz = [0, 0, 1], rpy = [0, 0, 1] },"
        " { xyz = [0, 0, 2], rpy = [0, 0, 1] }]",
        "motion.orientation",
        "where they have none",
    ),
    (DURATION + "[control]\ntype = 'lqr'", "control.type", "allowed: none, torque, pd, reference, computed_torque"),
    (DURATION + "[control]\ntype = 'pd'\nkp = 1", "control", "the key 'kd' is missing"),
    (DURATION + "[control]\ntype = 'pd'\nkp = -1\nkd = 1", "control.kp", "at least 0"),
    (DURATION + "[control]\ntype = 'pd'\nkp = { a = -1 }\nkd = 1", "control.kp.a", "at least 0"),
    (DURATION + "[control]\ntype = 'computed_torque'\nbandwidth = 0", "control.bandwidth", "greater than 0"),
    (DURATION + "[control]\ntype = 'torque'\nrows = [[0, 1]]", "control", "coordinates with rows"),
    (DURATION + "[control]\ntype = 'torque'\ncoordinates = ['a']\nrows = [[0]]", "control.rows.0", "array of 2"),
    (DURATION + "[control]\ntype = 'torque'\ncoordinates = ['a']\nrows = []", "control.rows", "no rows"),
    (
        DURATION + "[control]\ntype = 'torque'\ncoordinates = ['a']\nrows = [[1, 1], [0, 1]]",
        "control.rows.1",
        "got the time 0 after 1",
    ),
    (DURATION + "[prescribed]\na = 1", "prescribed", "written [[prescribed]]"),
    (DURATION + "[[prescribed]]\ntype = 'harmonic'\ncoordinate = 'a'", "prescribed[0]", "'amplitude' is missing"),
    (DURATION + SHAKEN + "phase = 1\nphase_deg = 9", "prescribed[0].phase_deg", "phase (rad) is given, too"),
    (DURATION + "[[wrenches]]\nlink = 'a'", "wrenches[0]", "needs force and/or moment"),
    (DURATION + "[[wrenches]]\nforce = [1, 2, 3]", "wrenches[0]", "'link' is missing"),
    (DURATION + "[[wrenches]]\nlink = 'a'\nforce = [1, 2]", "wrenches[0].force", "array of 3"),
    (DURATION + "[[wrenches]]\nlink = 'a'\nforce = [1, 2, 3]\naxes = 'tool'", "wrenches[0].axes", "base, link"),
    (DURATION + "[[wrenches]]\nlink = 'a'\nforce = [1, 2, 3]\nt0 = 2\nt1 = 1", "wrenches[0].t1", "after t0"),
    (DURATION + "[[payloads]]\nlink = 'a'\npoint = [0, 0, 0]\nmass = 0", "payloads[0].mass", "greater than 0"),
    (DURATION + "[[payloads]]\nlink = 'a'\nmass = 1", "payloads[0]", "'point' is missing"),
    (
        DURATION + "[[payloads]]\nlink = 'a'\nmass = 1\npoint = [0, 0, 0]\ninertia = { xx = 1, yy = 1, zz = 5 }",
        "payloads[0].inertia",
        "no body can have",
    ),
    (DURATION + "[integrator]\nmethod = 'euler'", "integrator.method", "got 'euler'"),
    (DURATION + "[integrator]\nrtol = 2", "integrator.rtol", "from 1e-13"),
]
