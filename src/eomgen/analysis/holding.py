"""Which coordinates stay where they are in an analysis about a state, and how drives hold them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..arrays import Array, Mask
from ..errors import ArrayError, InputError, UnknownNameError
from ..kernel.by_name import follower_matrix
from ..kernel.complete import Kernel
from ..motion.ends import default_motion
from ..names import joint_of, show
from ..robot.internal_states.branches import BRANCHES
from ..robot.internal_states.drives import DRIVE
from ..robot.laws import LAWS, has_springs
from ..robot.model import build_model, rigid_coordinates
from ..robot.value import Robot
from ..runtime.internal_states import split_state
from ..state.elements import cut_matrices, joint_stiffness
from ..state.internal_states import StatesLike, kept_note, state_values
from ..state.journals import cut_contacts, cut_deviations, journal_contacts
from ..state.motors import acting, deflections, turn_motors
from ..state.springs import clearances, cut_numbers, journals_in_play, law_numbers

PoseLike = Mapping[str, float] | Sequence[float] | Array
Gains = float | Mapping[str, float]

DRIVES = ("locked", "free", "pd")
SPRINGS = ("stiffness", *(law.first for law in LAWS.values() if law.is_spring))


@dataclass(frozen=True)
class Fixation:
    """Fixed coordinates of an analysis, and the gains of drives.

    Attributes:
        drives: "locked", "free" or "pd".
        still: coordinates that stay at the pose while the others come to rest, (n,).
        locked: those that do not move about the state either, (n,).
        driven: coordinates that drives move, (n,).
        kp, kd: gains that drives add to K and D, (n,), N/m, N m/rad and per rate; 0 where there is none.
        z: internal states at the state, (m,).
        notes: lines about what was assumed.
    """

    drives: str
    still: Mask
    locked: Mask
    driven: Mask
    kp: Array
    kd: Array
    z: Array
    notes: tuple[str, ...]


def fixation_of(
    robot: Robot,
    kernel: Kernel,
    drives: str = "locked",
    *,
    kp: Gains | None = None,
    kd: Gains | None = None,
    fixed: Iterable[str] | None = None,
    z: StatesLike | None = None,
) -> Fixation:
    """Return which coordinates an analysis holds fixed, and its drives' gains.

    Prescribed coordinates always do.  About the state driven coordinates are locked, or free under constant
    drives, or held by gains ("pd").  At the state itself they stay where they are put, and with them what nothing
    holds: coordinates of free joints, and deviations without a spring.  Coordinates in loops and couplings follow the
    others, or come to rest.

    Args:
        robot, kernel: whose coordinates they are.
        drives: "locked", "free" or "pd".
        kp, kd: gains of "pd": a number for all driven coordinates, or by their names; kd is 0 by default.
        fixed: names of the coordinates that stay at the state and, if drives are "locked", about it; instead of the
            above.
        z: internal states, (m,), or by name; 0 by default.

    Raises:
        InputError: an option is unknown, a gain missing or negative, or there is no law with internal states.
        UnknownNameError: a name is no coordinate, or no state.
    """
    if drives not in DRIVES:
        raise InputError(f"drives: {drives!r} is unknown; allowed: {', '.join(DRIVES)}")
    model, names = build_model(robot), kernel.coordinates
    driven, prescribed = _mask(names, model.driven), _mask(names, model.prescribed)
    notes: list[str] = []
    if fixed is not None:
        chosen = list(fixed)
        for name in chosen:
            if name not in kernel.coordinates:
                raise UnknownNameError(f"fixed: {show(str(name))} is unknown; known: {', '.join(kernel.coordinates)}")
        still = prescribed | np.array([name in chosen for name in names])
        locked = still.copy()
    else:
        loose = _loose(kernel) & ~driven & ~prescribed & ~_led(robot, names)
        still, locked = driven | prescribed | loose, driven | prescribed
        if loose.any():
            free = ", ".join(np.array(names)[loose])
            notes.append(f"nothing holds {free}: constant forces do at the state")
    if drives == "pd":
        for name in np.array(names)[driven].tolist():
            if not kernel.inputs[name].is_force:
                what = f"{name} takes a {kernel.inputs[name].meaning}"
                raise InputError(
                    f"drives: 'pd' are forces, and {what}; allowed: locked, or free with its own controller"
                )
        gains = _gains("kp", kp, kernel, driven), _gains("kd", 0.0 if kd is None else kd, kernel, driven)
    else:
        if kp is not None or kd is not None:
            raise InputError(f"kp and kd are gains of drives 'pd'; drives are {drives!r}")
        gains = np.zeros(kernel.n), np.zeros(kernel.n)
    if drives != "locked":
        locked = prescribed
    states = state_values(kernel, z)
    locked_names = set(np.array(names)[locked].tolist())
    parts = map(split_state, kernel.internal_states)
    places = [
        k for k, (owner, law, _) in enumerate(parts) if law not in (BRANCHES, DRIVE) and owner not in locked_names
    ]
    if places:
        notes.append(kept_note([kernel.internal_states[k] for k in places], states[places]))
    return Fixation(drives, still, locked, driven, *gains, states, tuple(notes))


def pose_of(robot: Robot, kernel: Kernel, pose: PoseLike | None) -> Array:
    """Return coordinates of a pose, (n,): deviations left out are at home, motors left out follow their joints.

    Args:
        robot, kernel: whose coordinates they are.
        pose: a number for each principal coordinate, or for each coordinate, in their order; or numbers by name
            ("joint2", "joint2.gamma").  By default where ``simulate`` would start.

    Raises:
        InputError: a wrong number of them, or one that is not finite.
        UnknownNameError: a name is no coordinate.
    """
    model, names = build_model(robot), kernel.coordinates
    q = np.array(model.home)
    if pose is None or isinstance(pose, Mapping):
        rigid = rigid_coordinates(robot)
        if rigid:
            q[[names.index(name) for name in rigid]] = default_motion(robot, 1.0, rigid).start
        places = {joint_of(names[i]): i for i in model.principal} | {name: i for i, name in enumerate(names)}
        for name, value in (pose or {}).items():
            if name not in places:
                raise UnknownNameError(f"pose: {show(str(name))} is unknown; known: {', '.join(names)}")
            q[places[name]] = _number(f"pose: {name}", value)
        turn_motors(kernel, q, robot.home if pose is None else pose)
        return q
    values = np.atleast_1d(np.asarray(pose, dtype=object))
    where = model.principal if values.shape == (len(model.principal),) else range(len(names))
    if values.shape != (len(where),):
        raise ArrayError(
            f"pose: expected {len(model.principal)} numbers ({', '.join(names[i] for i in model.principal)}) or one"
            f" for each of the {len(names)} coordinates, got {np.size(values)}"
        )
    for i, value in zip(where, values, strict=True):
        q[i] = _number(f"pose: {names[i]}", value)
    turn_motors(kernel, q, names if len(values) == len(names) else ())
    return q


def floating(kernel: Kernel, q: Array) -> tuple[str, ...]:
    """Return names of the coordinates that touch no end of their clearance at q, (n,), and of journals that do not."""
    ends, names = clearances(law_numbers(kernel)), acting(kernel)
    there = deflections(kernel) @ q
    there[kernel.n :] += follower_matrix(kernel)[1]
    inside = np.abs(there) <= [ends.get(name, -1.0) for name in names]
    inside[: kernel.n] &= np.diagonal(joint_stiffness(kernel)) == 0.0
    contacts = journal_contacts(kernel)
    touching = {i for contact in contacts if contact.penetration(q) > 0.0 for i in contact.index}
    for name in journals_in_play(kernel):
        place = kernel.coordinates.index(name)
        inside[place] |= place not in touching
    return tuple(name for name, floats in zip(names, inside, strict=True) if floats)


def floating_cuts(kernel: Kernel, q: Array) -> list[str]:
    """Return names of the loop joints' coordinates and couplings that touch no end of their clearance at q, (n,)."""
    ends = {name: law["clearance"] for name, law in cut_numbers(kernel).items() if law.get("clearance")}
    known = kernel.raw.has(
        kernel.functions.cut_forces, kernel.functions.cut_jacobian
    )  # a kernel that the caller built may lack them
    contacts = cut_contacts(kernel)
    if not (ends or contacts) or not known:
        return []
    deviations = cut_deviations(kernel, q)
    inside = {name for name, x in zip(kernel.cut_laws, deviations, strict=True) if abs(x) <= ends.get(name, -1.0)}
    touching = {i for contact in contacts if contact.penetration(deviations) > 0.0 for i in contact.index}
    for i in {i for contact in contacts for i in contact.index} - touching:
        name = kernel.cut_laws[i]
        if not has_springs(cut_numbers(kernel)[name], kernel.knots.get(name, ())):
            inside.add(name)
    springs = np.diagonal(cut_matrices(kernel)[0])
    return [name for name, k in zip(kernel.cut_laws, springs, strict=True) if name in inside and k == 0.0]


def notes_of_play(kernel: Kernel, q: Array) -> list[str]:
    """Return lines about coordinates, also of loop joints and couplings, that touch no end of their clearance."""
    names = [*floating(kernel, q), *floating_cuts(kernel, q)]
    return [f"{name} floats in its clearance: no stiffness there" for name in names]


def _loose(kernel: Kernel) -> Mask:
    """Return coordinates that no spring, matrix, transmission, journal or spring between points holds, (n,)."""
    elastic = [
        name in kernel.knots or any(law.get(key) for key in SPRINGS) for name, law in law_numbers(kernel).items()
    ]
    held = np.array(elastic[: kernel.n]) | follower_matrix(kernel)[0][np.array(elastic[kernel.n :], bool)].any(axis=0)
    held |= _mask(kernel.coordinates, map(kernel.coordinates.index, kernel.motors.values()))
    held |= np.diagonal(joint_stiffness(kernel)) > 0.0
    if kernel.springs:
        anywhere = 0.3 + 0.1 * np.arange(kernel.n)
        held |= np.asarray(kernel.functions.spring_jacobian(anywhere)).any(axis=0)
    if kernel.element_rows:
        anywhere = 0.3 + 0.1 * np.arange(kernel.n)
        held |= np.asarray(kernel.functions.element_jacobian(anywhere)).any(axis=0)
    held[[i for contact in journal_contacts(kernel) for i in contact.index]] = True
    return np.asarray(~held)


def _led(robot: Robot, names: tuple[str, ...]) -> Mask:
    """Return coordinates on which loops and couplings act, (n,).

    What moves both sides of a loop alike is not among them.
    """
    before = {joint.child: joint for joint in robot.joints}
    joints: set[str] = set()
    for loop in robot.loops:
        sides: list[set[str]] = []
        for link in loop.links:
            sides.append(set())
            while link in before:
                sides[-1].add(before[link].name)
                link = before[link].parent
        joints |= sides[0] ^ sides[1]
    followers = robot.followers
    coupled = {name for x in robot.couplings if x.of not in followers for name in (x.of, *x.to)}
    return np.array([joint_of(name) in joints or name in coupled for name in names])


def _mask(names: tuple[str, ...], places: Iterable[int]) -> Mask:
    mask = np.zeros(len(names), dtype=bool)
    mask[list(places)] = True
    return mask


def _gains(label: str, value: Gains | None, kernel: Kernel, driven: Mask) -> Array:
    """Return a gain for every driven coordinate, 0 for the others."""
    names = [name for name, drives in zip(kernel.coordinates, driven, strict=True) if drives]
    if value is None:
        raise InputError(f"{label}: drives 'pd' need it; allowed: a number, or numbers by names of {', '.join(names)}")
    table = value if isinstance(value, Mapping) else dict.fromkeys(names, value)
    result = np.zeros(kernel.n)
    for name, entry in table.items():
        if name not in names:
            raise UnknownNameError(f"{label}: {show(str(name))} has no drive; known: {', '.join(names)}")
        gain = _number(f"{label}: {name}", entry)
        if gain < 0.0:
            raise InputError(f"{label}: {name} = {gain:g}; allowed: at least 0")
        result[kernel.coordinates.index(name)] = gain
    return result


def _number(label: str, value: object) -> float:
    try:
        number = float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        raise InputError(f"{label} = {value!r} is not a number") from None
    if not np.isfinite(number):
        raise InputError(f"{label} = {number} is not finite")
    return number
