"""The UR5 with elastic gears of this example, what it is to do, and both as a header of C."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

import eomgen
from eomgen.control import Measurement, Observer, Uncertainty, observer
from eomgen.motion import PointToPoint
from eomgen.robot import build_model

DT, SUBSTEPS = 1e-3, 10  # s of a sample, and the plant's steps in it
JOINTS = 6
# Published are the UR5's links (ur5.toml) and its largest torques, 150 and 28 N m; numbers of motors and gears are
# assumed, of the sizes that harmonic drives with 100 : 1 and motors for such torques have.
RATIO = 100.0
TORQUE = (1.5, 1.5, 1.5, 0.28, 0.28, 0.28)  # N m, at the motors' shafts, as all that follows but for the gears
INERTIA = (1.5e-4, 1.5e-4, 1.5e-4, 3e-5, 3e-5, 3e-5)  # kg m^2
COULOMB, VISCOUS = (0.03, 0.03, 0.03, 0.006, 0.006, 0.006), (2e-4, 2e-4, 2e-4, 5e-5, 5e-5, 5e-5)  # N m, N m s/rad
SMOOTHING = 2.0  # rad/s
TICK = 2.0 * np.pi / 2**14  # rad, of the encoders
STIFFNESS = (2e4, 2e4, 1.5e4, 5e3, 5e3, 3e3)  # N m/rad, of the gears at the joints
STICKY, LAG = 1.1, 5e-4  # what the controller's model leaves out: more friction, and damping of gears by stiffness, s

FROM, TO = (0.0, -1.2, 1.4, -0.5, 1.1, 0.2), (0.8, -0.7, 0.9, 0.2, 0.6, 0.7)  # rad, and back again
MOVE, REST = 0.9, 0.2  # s
OFF = 0.03  # rad: what every joint is off at first
BANDWIDTH = 40.0  # rad/s, of the feedback
SETTLED = 0.4  # s, from which on errors count
ALLOWED = {"tracking": 6e-4, "estimation": 1e-4, "velocity": 2e-2}  # rad, rad, rad/s
SEED, FACTOR, SUMMAND = 1, 6364136223846793005, 1442695040888963407  # of the noise, a congruential generator


def model() -> eomgen.Robot:
    """Return the UR5 with a motor behind an elastic gear at every joint, as the controller knows it."""
    return _arm("ur5_model", 0.0, 1.0)


def plant() -> eomgen.Robot:
    """Return the simulated arm."""
    return _arm("ur5_plant", LAG, STICKY)


def _arm(name: str, lag: float, sticky: float) -> eomgen.Robot:
    motors = {}
    for i, stiffness in enumerate(STIFFNESS):
        friction = {"coulomb": sticky * COULOMB[i], "viscous": sticky * VISCOUS[i], "smoothing": SMOOTHING}
        gear = {"ratio": RATIO, "stiffness": stiffness, "damping": lag * stiffness}
        motors[f"joints.joint{i + 1}.motor"] = {"inertia": INERTIA[i], "friction": friction, **gear}
    return replace(eomgen.load_robot("ur5").with_values(motors), name=name)


def kalman_filter() -> Observer:
    """Return the filter of all 24 states from the encoders of the six motors."""
    sensors = [f"encoder:joint{i + 1}.motor" for i in range(JOINTS)]
    links_and_motors = {"position": (1e-2, 1.0), "velocity": (0.1, 10.0), "acceleration": (0.03, 3.0)}
    uncertain = {key: list(pair) * JOINTS for key, pair in links_and_motors.items()}
    measurement = Measurement.of(model(), sensors, noise={"encoder": TICK / 2.0})
    return observer(model(), measurement, dt=DT, uncertainty=Uncertainty(**uncertain))


def moves() -> tuple[PointToPoint, PointToPoint]:
    """Return the motions of the joints there and back: polynomials of degree nine, from rest to rest."""
    there, back = np.array(FROM), np.array(TO)
    return PointToPoint(there, back, MOVE, smooth=4), PointToPoint(back, there, MOVE, smooth=4)


def header() -> str:
    """Return task.h, with numbers to the bit."""
    coordinates = build_model(plant()).coordinates
    whole = {"JOINTS": JOINTS, "STATES": len(coordinates), "SUBSTEPS": SUBSTEPS}
    real = {"dt": DT, "substep": DT / SUBSTEPS, "ratio": RATIO, "tick": TICK, "torque": TORQUE}
    real |= {"from": FROM, "to": TO, "move": MOVE, "rest": REST, "off": OFF, "settled": SETTLED}
    real |= {"kp": BANDWIDTH**2, "kd": 2.0 * BANDWIDTH} | {f"allowed_{key}": x for key, x in ALLOWED.items()}
    places = {"links": "gamma", "motors": "motor"}  # of the coordinates of both sides of the gears
    lines = ["/* Written by build.py. */", "#ifndef TASK_H", "#define TASK_H", "", "#include <stdint.h>", ""]
    lines.append(f"enum {{ {', '.join(f'{name} = {x}' for name, x in whole.items())} }};")
    for name, x in real.items():
        lines.append(f"static const double {name}{'[]' if np.ndim(x) else ''} = {_literal(x)};")
    for name, kind in places.items():
        at = [str(coordinates.index(f"joint{i + 1}.{kind}")) for i in range(JOINTS)]
        lines.append(f"static const int {name}[] = {{ {', '.join(at)} }};")
    for name, x in {"seed": SEED, "factor": FACTOR, "summand": SUMMAND}.items():
        lines.append(f"static const uint64_t {name} = {x}u;")
    return "\n".join([*lines, "", "#endif", ""])


def _literal(values: Any) -> str:
    return "{ " + ", ".join(map(_literal, values)) + " }" if np.ndim(values) else float(values).hex()
