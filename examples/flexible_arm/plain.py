"""The same arm in CasADi alone: the articulated-body algorithm (R. Featherstone) in SX, derivatives by CasADi."""

from __future__ import annotations

from typing import Any

import casadi
import numpy as np
from arm import COLUMN_INERTIA, COLUMN_MASS, COLUMN_PLACE, TWIST, Body, bodies

Array = Any
GRAVITY = casadi.DM([0.0, 0.0, 0.0, 0.0, 0.0, 9.81])  # the base accelerates upwards: turning first, then translation


def motion_transform(angle: Any, place: list[float], twist: float) -> Any:
    """Return the 6 x 6 transform of velocities from the parent's axes to those of a joint that turns about z."""
    about_x = casadi.DM([[1, 0, 0], [0, np.cos(twist), np.sin(twist)], [0, -np.sin(twist), np.cos(twist)]])
    cosine, sine = casadi.cos(angle), casadi.sin(angle)
    turn = casadi.blockcat([[cosine, sine, 0], [-sine, cosine, 0], [0, 0, 1]]) @ casadi.sparsify(about_x)
    return casadi.blockcat([[turn, casadi.SX(3, 3)], [-turn @ casadi.skew(casadi.DM(place)), turn]])


def cross_motion(v: Any) -> Any:
    """Return the 6 x 6 matrix of v x for velocities; less its transpose is that for forces."""
    turning, moving = casadi.skew(v[:3]), casadi.skew(v[3:])
    return casadi.blockcat([[turning, casadi.SX(3, 3)], [moving, turning]])


def spatial_inertia(mass: float, place: list[float], inertia: tuple[float, float, float]) -> Any:
    """Return the 6 x 6 inertia about the joint, of the inertia about the centre of mass."""
    arm = casadi.skew(casadi.DM(place))
    about = casadi.diag(casadi.DM(inertia)) + mass * arm @ arm.T
    return casadi.sparsify(casadi.blockcat([[about, mass * arm], [mass * arm.T, mass * casadi.DM.eye(3)]]))


def joints(chain: list[Body]) -> tuple[list[list[float]], list[float]]:
    """Return where each joint is on its parent, m, and how its axis is turned there, rad."""
    places = [[0.0, 0.0, 0.0], [0.0, 0.0, chain[0].before], *([body.before, 0.0, 0.0] for body in chain[1:])]
    return places, [0.0, TWIST, *[0.0] * (len(chain) - 1)]


def tip(segments: int) -> Any:
    """Return the function of CasADi, x -> place of the tip, (3,)."""
    chain = bodies(segments)
    x = casadi.SX.sym("x", 2 * (len(chain) + 1))
    turned, place = casadi.SX.eye(3), casadi.SX(3, 1)
    for i, (at, twist) in enumerate(zip(*joints(chain), strict=True)):
        place += turned @ casadi.DM(at)
        turned = turned @ motion_transform(x[i], at, twist)[:3, :3].T
    place += turned @ casadi.DM([chain[-1].length, 0.0, 0.0])
    return casadi.Function("tip", [x], [place])


def accelerations(chain: list[Body], q: Any, v: Any, u: Any) -> Any:
    """Return the expression of the accelerations of column and segments."""
    places, twists = joints(chain)
    own = [spatial_inertia(COLUMN_MASS, COLUMN_PLACE, COLUMN_INERTIA)]
    own += [spatial_inertia(body.mass, [body.length / 2, 0.0, 0.0], body.inertia) for body in chain]
    laws = [(0.0, 0.0), *((body.stiffness, body.damping) for body in chain)]
    force = [u[i] - k * q[i] - d * v[i] for i, (k, d) in enumerate(laws)]
    axis, n = casadi.sparsify(casadi.DM([0, 0, 1, 0, 0, 0])), len(own)
    transforms, moved, bias, inertias, forces = [], casadi.SX(6, 1), [], list(own), []
    for i in range(n):
        transforms.append(motion_transform(q[i], places[i], twists[i]))
        moved = transforms[i] @ moved + axis * v[i]
        bias.append(cross_motion(moved) @ axis * v[i])
        forces.append(-cross_motion(moved).T @ (own[i] @ moved))
    columns, pivots, shorts = [None] * n, [None] * n, [None] * n
    for i in reversed(range(n)):
        columns[i] = inertias[i] @ axis
        pivots[i] = columns[i][2]
        shorts[i] = force[i] - forces[i][2]
        if i:
            rest = inertias[i] - columns[i] @ columns[i].T / pivots[i]
            passed = forces[i] + rest @ bias[i] + columns[i] * shorts[i] / pivots[i]
            inertias[i - 1] = inertias[i - 1] + transforms[i].T @ rest @ transforms[i]
            forces[i - 1] = forces[i - 1] + transforms[i].T @ passed
    carried, found = GRAVITY, []
    for i in range(n):
        carried = transforms[i] @ carried + bias[i]
        found.append((shorts[i] - casadi.dot(columns[i], carried)) / pivots[i])
        carried = carried + axis * found[i]
    return casadi.vertcat(*found)


def model(segments: int) -> tuple[Any, Any, Any, Any]:
    """Return the symbols q, v, u and the accelerations, SX."""
    chain = bodies(segments)
    q, v, u = (casadi.SX.sym(name, len(chain) + 1) for name in "qvu")
    return q, v, u, accelerations(chain, q, v, u)


class PlainDynamics:
    """Accelerations of the arm and their derivatives, of many states, by CasADi: interpreted, or compiled as C."""

    def __init__(self, segments: int, *, compiled: bool = False) -> None:
        q, v, u, a = model(segments)
        options = {"jit": True, "compiler": "shell", "jit_options": {"flags": ["-O2"]}} if compiled else {}
        slopes = [casadi.densify(casadi.jacobian(a, by)) for by in (q, v, u)]
        self.function = casadi.Function("plain", [q, v, u], [a, *slopes], options)

    def __call__(self, q: Array, v: Array, u: Array) -> tuple[Array, tuple[Array, Array, Array]]:
        """Return the accelerations, (N, n), and their derivatives by q, v and u, (N, n, n)."""
        count, n = q.shape
        a, *slopes = (result.full() for result in self.function.map(count)(q.T, v.T, u.T))
        by_q, by_v, by_u = (slope.reshape(n, count, n).transpose(1, 0, 2) for slope in slopes)
        return a.T, (by_q, by_v, by_u)


class PlainIntegrator:
    """Discrete steps by CasADi's own integrator: the same collocation, solved by its Newton's method."""

    def __init__(self, segments: int, select: Array, duration: float, steps: int) -> None:
        q, v, u, a = model(segments)
        drives = casadi.SX.sym("drives", select.shape[1])
        rate = casadi.vertcat(v, casadi.substitute(a, u, casadi.DM(select) @ drives))
        system = {"x": casadi.vertcat(q, v), "p": drives, "ode": rate}
        options = {"number_of_finite_elements": steps, "interpolation_order": 2, "collocation_scheme": "legendre"}
        step = casadi.integrator("step", "collocation", system, 0.0, duration, {**options, "simplify": True})
        x, p = casadi.MX.sym("x", system["x"].numel()), casadi.MX.sym("p", drives.numel())
        after = step(x0=x, p=p)["xf"]
        slopes = [casadi.densify(casadi.jacobian(after, by)) for by in (x, p)]
        self.function = casadi.Function("step", [x, p], [after, *slopes])

    def __call__(self, x: Array, u: Array) -> tuple[Array, Array, Array]:
        """Return the states after the duration, (N, 2n), and their derivatives by states before and drives."""
        count = len(x)
        after, *slopes = (result.full() for result in self.function.map(count)(x.T, u.T))
        by_x, by_u = (slope.reshape(len(slope), count, -1).transpose(1, 0, 2) for slope in slopes)
        return after.T, by_x, by_u
