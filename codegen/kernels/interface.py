"""Model -> what users see of its kernels: names, shapes, parameters, functions; without SymPy."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from eomgen._version import __version__
from eomgen.identifiers import parameter_path
from eomgen.names import component_name, joint_of
from eomgen.robot.coordinates import is_mode
from eomgen.robot.internal_states.drives import input_of
from eomgen.robot.joint_types import JOINT_TYPES
from eomgen.robot.mechanism import coordinate_of, effort_of, leading_home
from eomgen.robot.model import Model, movable_limits
from eomgen.robot.parameter_names import conditions, element_places, leasts, matrices
from eomgen.robot.value import MOTOR, Coupling, Loop

from ..tree.regressor import described_values, regressor_names
from .entries import Signature
from .signatures import (
    EXTERNAL,
    KERNELS,
    OWN_KERNELS,
    closes_loops,
    element_rows,
    functions,
    reading_names,
    shapes,
    signatures_of,
)

IF_ANY = (  # entries of the metadata that are there only where there is something to tell
    *("motors", "efforts", "ranges", "home", "frame_links", "turning", "loops", "upright", "constraints", "couplings"),
    *("internal_states", "internal_state_units", "inputs", "followers", "cut_laws", "regressor", "springs"),
    *("element_rows", "matrices", "conditions", "flexible_links", "modal_couplings", "readings", "stateful"),
)


def describe_kernels(model: Model, kernels: Sequence[str], dtype: str) -> dict[str, Any]:
    """Return plain values for JSON: what a package says of its kernels before anything is derived.

    "kernels" and "functions" say what each reads and writes; users call the functions, which are the kernels but for
    those of the kind "frames", and ``RawFunction`` says what a kind means.
    """
    robot, known = model.robot, signatures_of(model)
    free = [name for i, name in enumerate(model.coordinates) if i not in model.prescribed]
    motors = {model.coordinates[index]: model.coordinates[principal] for index, principal in model.motors.items()}
    described = {
        "generator": f"eomgen {__version__}",
        "name": model.name,
        "dtype": dtype,
        "coordinates": model.coordinates,
        "internal_states": model.internal_states,
        "internal_state_units": tuple(state.unit for state in model.states),
        "inputs": drive_inputs(model),
        "joints": [body.joint for body in model.bodies],
        "links": model.links,
        "frames": model.frames,
        "driven": model.driven,
        "prescribed": [model.coordinates[i] for i in model.prescribed],
        "motors": {name: [driven, _ratio(model, name)] for name, driven in motors.items()},
        "efforts": {name: effort for name in free if (effort := effort_of(robot, name)) is not None},
        "ranges": {name: [_finite(x) for x in ends] for name, ends in movable_limits(robot).items()},
        "frame_links": {frame.name: frame.link for frame in robot.frames},
        "coms": {link: list(robot.link(link).com) for link in model.links},
        "home": {name: value for name, value in leading_home(robot).items() if name in model.coordinates},
        "parameters": dict(model.parameters),
        "least": leasts(robot, model.parameters),
        "shapes": {key: list(shape) for key, shape in shapes(model, kernels).items()},
        "kernels": {
            name: {"reads": known[name].reads, "writes": known[name].writes}
            for name in KERNELS.compiled
            if name in kernels
        },
        "functions": {
            function.name: {
                "kernel": function.kernel,
                "kind": function.kind,
                "reads": function.signature.reads,
                "writes": function.signature.writes,
                **_method(function.signature, closed=bool(model.constraints)),
                **({"closes": True} if model.constraints and closes_loops(function.kernel) else {}),
            }
            for function in functions(kernels, known)
        },
        "knots": knots(model),
        "elements": {x: owners for x, owners in element_places(robot, model.parameters).items() if owners},
        "turning": turning_joints(model) if model.turning else {},
        **_closed(model),
        "cut_laws": [component_name(owner, name) if name else owner for owner, name, _ in model.cut_laws],
        "regressor": regressor_names(model) if "regressor" in kernels else (),
        "springs": [spring.name for spring in robot.springs],
        "element_rows": element_rows(model),
        "matrices": matrices(model.parameters),
        "conditions": conditions(robot, model.parameters),
        "flexible_links": list(dict.fromkeys(joint_of(name) for name in model.coordinates if is_mode(name))),
        "modal_couplings": modal_couplings(model),
        "readings": reading_names(model),
        "stateful": [name for name, x in OWN_KERNELS.items() if x.states] if model.internal_states else (),
    }
    return {key: value for key, value in described.items() if value or key not in IF_ANY}


def _method(signature: Signature, *, closed: bool) -> dict[str, Any]:
    """Return what calls need to know of a function beside its arrays, as far as there is something."""
    wrench, loaded = signature.wrench, signature.loaded
    known = {
        "takes": signature.takes,
        "wrench": wrench and [wrench.kernel, wrench.sign, wrench.into],
        "loaded": loaded and [loaded, EXTERNAL.kernel],
        "diagnosis": "" if closed and signature.tree else signature.diagnosis,
    }
    return {key: value for key, value in known.items() if value}


def _closed(model: Model) -> dict[str, Any]:
    """Return what closes a mechanism: loops, constraints, couplings and followers."""
    robot = model.robot
    return {
        "loops": {loop.name: loop.type for loop in robot.loops},
        "upright": {loop.name: _upright(loop) for loop in robot.loops},
        "constraints": model.constraints,
        "couplings": {coupling.name: coupling.of for coupling in robot.couplings if coupling.law is None},
        "followers": {
            name: {"coupling": x.name, "to": dict(x.to), "offset": x.offset or 0.0, **_bends(x)}
            for name, x in model.followers.items()
        },
    }


def _bends(coupling: Coupling) -> dict[str, Any]:
    """Return what a coupling adds of products of coordinates and of a place on a beam, and its pitch's name, if any."""
    added: dict[str, Any] = {"bends": [list(bend) for bend in coupling.bends]} if coupling.bends else {}
    if coupling.pitch is not None:
        added["pitch"] = coupling.pitch_name
    if coupling.sliding is not None:
        shapes = coupling.sliding
        first, second = [list(x) for x in shapes.first], [list(x) for x in shapes.second]
        added["sliding"] = {"by": shapes.by, "length": shapes.length, "first": first, "second": second}
    return added


def drive_inputs(model: Model) -> dict[str, list[Any]]:
    """Return what u means at coordinates with a drive, its unit, and the place of a force beside it in ``forces``."""
    inputs = {}
    for place, i in enumerate(model.drives):
        name = model.coordinates[i]
        law = coordinate_of(model.robot, name).law()
        inputs[name] = [*input_of(law, name), place]
    return inputs


def places_of_forces(model: Model) -> list[int]:
    """Return where forces on each coordinate stand in u with ``forces`` behind it, beside drives with states there."""
    n, drives = len(model.coordinates), list(model.drives)
    return [n + drives.index(i) if i in drives else i for i in range(n)]


def modal_couplings(model: Model) -> list[list[Any]]:
    """Return pairs of modes that work on each other: both names, the entry of K and that of D beside the diagonal."""
    found = list[list[Any]]()
    for link in model.robot.links:
        if link.modes is not None:
            K, D, names = link.modes.couplings("K"), link.modes.couplings("D"), link.modes.names
            for k, j in sorted({*K, *D}):
                pair = [component_name(link.name, names[i]) for i in (k, j)]
                found.append([*pair, K.get((k, j), 0.0), D.get((k, j), 0.0)])
    return found


def inertial_parameters(model: Model) -> dict[str, Any]:
    """Return values of the regressor's parameters, and the run-time parameters of links that they come from."""
    fixed = {joint.name for joint in model.robot.joints if not joint.coordinates}
    paths = {name: parameter_path(name) for name in model.parameters}
    of_links = {name for name, path in paths.items() if path[0] == "links" and path[2] != "modes"}
    moving = [name for name, path in paths.items() if name in of_links or (path[0] == "joints" and path[1] in fixed)]
    return {"values": described_values(model), "come_from": moving}


def knots(model: Model) -> dict[str, list[float]]:
    """Return deviations of every measured curve, by its coordinate; of a transmission's by the motor's."""
    coordinates = {
        component_name(joint.name, name): c for joint in model.robot.joints for name, c in joint.coordinates.items()
    }
    coordinates |= {
        component_name(joint.name, MOTOR): joint.motor.transmission for joint in model.robot.joints if joint.motor
    }
    coordinates |= {component_name(owner, name) if name else owner: c for owner, name, c in model.cut_laws}
    return {name: [deviation for deviation, _ in c.curve] for name, c in coordinates.items() if c.curve is not None}


def turning_joints(model: Model) -> dict[str, Any]:
    """Return 3-DOF rotations, and the numbers per state by which a rollout goes on where another has ended.

    "joints" has, by name, the places of the first angle and of x among the coordinates, -1 where x does not move.
    """
    bodies = [model.bodies[k] for k in model.turning]
    places = {body.joint: (body.indices[-3], body.first if len(body.active) > 3 else -1) for body in bodies}
    joints = {name: {"angles": angles, "origin": origin} for name, (angles, origin) in places.items()}
    return {"joints": joints, "room": 1 + 4 * len(joints) + 2 * model.size}


def _finite(x: float) -> float | None:
    """A number for JSON, None for infinity."""
    return x if math.isfinite(x) else None


def _ratio(model: Model, motor: str) -> float:
    """Return the description's ratio of the gear behind a motor's coordinate."""
    table = model.robot.joint(joint_of(motor)).motor
    assert table is not None
    return table.ratio


def _upright(loop: Loop) -> tuple[tuple[float, int, int], ...]:
    """Return the ``upright`` products where a rigid angle could be half a turn off."""
    is_bent = any(loop.offset[3:]) or {"alpha", "beta", "gamma"} & loop.coordinates.keys()
    return () if is_bent else JOINT_TYPES[loop.type].upright
