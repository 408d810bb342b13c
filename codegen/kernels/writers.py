"""Writers of the kernels: outputs of each from the quantities of a derivation."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np

from eomgen.errors import InputError
from eomgen.robot.value import AT_COORDINATES, Sensor, sensor_conflict

from ..forces.cuts import ElasticLoopCoordinates
from ..forces.element import Deflection, ForceElement
from ..forces.springs import PointSprings
from ..forces.transmissions import Transmissions
from ..joint.zeros import zero_map
from ..program.reverse_mode import gradient
from ..tree.composite import coriolis_matrix
from ..tree.frame_motion import frame_accelerations, frame_velocities, imu, imu_at
from ..tree.frozen_joints import no_note
from ..tree.kinematics import body_poses, center_of_mass, external_rows, frame_poses, total_momentum, weight_energy
from ..tree.recursion import Wrench, accelerations, inertial_rows, kinetic_energy, through_joint_back
from ..tree.regressor import INERTIAL, armatures, inertial_columns
from ..tree.spatial import ZERO, Scalar, cross, is_zero, subtract
from .acceleration_slopes import SLOPES, drive_slopes, residual_slopes
from .accelerations import CONSTRAINED, PROJECTION, SOLVERS, Variant, implicit_step
from .bodies import axes_of
from .closed_motion import closing_derivatives, closing_reactions, drives, loop_wrenches, wrench_outputs
from .constraint_rows import closure_residuals
from .derivation import Derivation, Outputs, vector
from .derivatives.modal_slopes import bends, modal_christoffel, modal_coriolis_matrix, modal_residual_jacobian
from .signatures import CLOSURE_KERNELS, element_rows

Family = TypeVar("Family", bound=ForceElement)

DESCRIPTION_FRAMES = (  # report, or are asked, in the description's frames
    *("reactions", "tree_reactions", "closing_reactions", "loop_reactions", "loop_wrenches", "kinematics"),
    *("external_force", "external_reactions", "external_coupling_forces", "regressor", *CLOSURE_KERNELS),
    *("center_of_mass", "centroidal_momentum", "frame_velocities", "frame_accelerations"),
    *("imu", "measurement"),
)


def _mass_matrix(d: Derivation) -> Outputs:
    upper = d.followers.symmetric(d.matrix()) if d.followers else d.matrix()
    whole = {**upper, **{(j, i): value for (i, j), value in upper.items()}}
    return vector([whole.get((i, j), 0.0) for i in d.active for j in d.active])


def _nonlinear_effects(d: Derivation, v: list[Scalar]) -> list[Scalar]:
    coasting = d.coasting if v is d.v else d.still
    return inertial_rows(d.tree, v, coasting, d.bound.gravity)[0]


def _generalized_force(d: Derivation) -> Outputs:
    weights = inertial_rows(replace(d.tree, note=no_note), d.still, d.still, d.bound.gravity)[0]
    springs = d.passive_forces(d.v)
    forces = [-(weight + spring) for weight, spring in zip(weights, springs, strict=True)]
    return d.motion(d.followers.gather(forces))


def _drive_forces(d: Derivation) -> Outputs:
    """Write forces on coordinates, and what a winding's voltage has more than its motion induces."""
    forces = list(d.u)
    for element in d.elements:
        for i, force in element.driving(d.v):
            forces[i] = forces[i] + force
    return d.motion(d.followers.gather(forces))


def _drive_jacobian(d: Derivation) -> Outputs:
    """Write derivatives of what drives make by q, v and their inputs."""
    by_q, by_v, by_u = drive_slopes(d)
    return d.matrices(*({key: -1.0 * x for key, x in rows.items()} for rows in (by_q, by_v, by_u)), states=True)


def _external(d: Derivation) -> tuple[list[Scalar], list[Wrench]]:
    wrenches = [[d.graph.input("wrench", 6 * k + i) for i in range(6)] for k in range(len(d.model.links))]
    return external_rows(d.tree, wrenches)


def _residual_jacobian(d: Derivation) -> Outputs:
    if bends(d):
        return modal_residual_jacobian(d)
    slopes = residual_slopes(d, d.a)
    return d.matrices(slopes.by_q, slopes.by_v, slopes.by_a, states=True)


def _coriolis_matrix(d: Derivation) -> Outputs:
    if bends(d):
        return modal_coriolis_matrix(d)
    return d.matrices(coriolis_matrix(d.tree, d.v))


def _euler_cosines(d: Derivation) -> Outputs:
    angles = ("alpha", "beta", "gamma")
    return vector(
        [
            joint.rotations[1].cos if set(angles) <= set(body.active) else 1.0
            for body, joint in zip(d.model.bodies, d.joints, strict=True)
        ]
    )


def _christoffel(d: Derivation) -> Outputs:
    """Write C column by column, at unit velocities, so that zeros fold and the rest is shared.

    What vanishes only by an identity (C_i,ji = 0, say) would be left as round-off; the zero map knows it.
    """
    n = len(d.active)
    if bends(d):
        return modal_christoffel(d)
    survives = zero_map(d.described if d.followers else d.model).christoffel.mask
    survives = (survives if d.followers else survives[np.ix_(d.active, d.active, d.active)]).reshape(n * n, n)
    outputs: Outputs = {}
    for k, index in enumerate(d.active):
        velocity = d.followers.follow([float(i == index) for i in range(d.model.size)])
        column = d.matrices(coriolis_matrix(d.tree, velocity))
        for (_, ij), value in column.items():
            outputs["out", ij * n + k] = value if survives[ij, k] else 0.0
    return dict(sorted(outputs.items()))


def _kinematics(d: Derivation) -> Outputs:
    """Write frames as rows of [R ¦ X], then the bodies' origins, then the coordinates' axes."""
    bodies, axes = body_poses(d.tree)
    values: list[Scalar] = []
    for pose in frame_poses(d.model, d.bound, bodies):
        for row, x in zip(pose.rotation, pose.origin, strict=True):
            values.extend((*row, x))
    for pose in bodies:
        values.extend(pose.origin)
    for axis in axes_of(d.described):
        index = d.model.coordinates.index(axis.name)
        share = d.followers.shares.get(index, {}).get(d.active[axis.column], 1.0)
        values.extend(axes[index] if index in d.active else [0.0 if is_zero(x) else share * x for x in axes[index]])
    return vector(values)


def _energy(d: Derivation) -> Outputs:
    kinetic = kinetic_energy(d.tree, d.v)
    potential = weight_energy(d.tree)
    for element in d.elements:
        for energy in element.energies():
            potential = potential + energy
        for energy in element.state_energies(d.v):
            potential = potential + energy
    return vector([kinetic, potential])


def _centroidal_momentum(d: Derivation) -> Outputs:
    linear, angular = total_momentum(d.tree, d.v)
    center = center_of_mass(d.tree)
    return vector([*linear, *subtract(angular, cross(center, linear))])


def _generalized_momentum(d: Derivation) -> Outputs:
    """Write derivatives of the kinetic energy by velocities, then by coordinates: one reverse sweep has both."""
    slopes = gradient(d.graph, kinetic_energy(d.tree, d.v))
    return vector([slopes.get((array, i), 0.0) for array in "vq" for i in range(len(d.active))])


def _reactions(d: Derivation) -> list[Wrench]:
    """Return what each joint carries, at its body's origin in its axes."""
    _, total = inertial_rows(d.tree, d.v, d.a, d.bound.gravity)
    for element in d.elements:
        for k, held in element.wrenches(d.v):
            total[k] = total[k] + held
    return total


def _joint_torques(d: Derivation) -> dict[int, Scalar]:
    """Return what joints carry along their coordinates, by these, and what elastic gears carry, by their motors."""
    rows: list[Scalar] = [0.0] * d.model.size
    for wrench, joint in zip(_reactions(d), d.joints, strict=True):
        through_joint_back(wrench, joint, rows)
    return {**dict(enumerate(rows)), **_family(d, Transmissions).carried(d.v)}


def _measurement(d: Derivation) -> Outputs:
    """Write readings of sensors, in their order; what none of them reads is left out by the passes."""
    robot = d.described.robot
    for sensor in robot.sensors:
        conflict = sensor_conflict(robot, sensor)
        if conflict is not None:
            raise InputError(f"sensors of {d.described.name}: {conflict}")
    torques = _joint_torques(d) if any(x.kind == "torque" for x in robot.sensors) else {}
    bodies, _ = body_poses(d.tree)
    poses = dict(zip(d.model.frames, frame_poses(d.model, d.bound, bodies), strict=True))
    moving = accelerations(d.tree, d.v, d.a)
    places = {name: i for i, name in enumerate(d.model.coordinates)}

    def read(sensor: Sensor) -> list[Scalar]:
        if sensor.kind in AT_COORDINATES:
            at: dict[str, Any] = {"encoder": d.q, "tachometer": d.v, "torque": torques}
            return [at[sensor.kind][places[sensor.of]]]
        if sensor.kind in ("position", "pose"):
            R, X = poses[sensor.of].rotation, poses[sensor.of].origin
            return list(X) if sensor.kind == "position" else [x for i in range(3) for x in (*R[i], X[i])]
        force, rate = imu_at(d.bound, moving, *d.bound.frames[sensor.of])
        return [*(force if sensor.kind != "gyroscope" else ()), *(rate if sensor.kind != "accelerometer" else ())]

    return vector([x for sensor in robot.sensors for x in read(sensor)])


def _regressor(d: Derivation) -> Outputs:
    """Write columns of the bodies' inertial parameters, then of armatures; rows are coordinates."""
    columns = inertial_columns(d.tree, d.v, d.a)
    none, driven = [0.0] * len(INERTIAL), [d.model.coordinates.index(name) for name in armatures(d.described)]
    values: list[Scalar] = []
    for row in d.active:
        led = {i: share[row] for i, share in d.followers.shares.items() if row in share}
        for body in columns:
            here = body.get(row, none)
            for i, ratio in led.items():
                here = [x + ratio * y for x, y in zip(here, body.get(i, none), strict=True)]
            values.extend(here)
        values.extend(d.a[i] if i == row else led.get(i, 0.0) * d.a[i] for i in driven)
    return vector(values)


def _coupled(d: Derivation, needed: Sequence[Scalar]) -> Outputs:
    """Write forces of couplings on followers: what these need, and what their followers take from them."""
    forces = d.followers.holding(needed)
    return vector([forces[d.model.coordinates.index(coupling.of)] for coupling in d.described.leading_couplings])


def _cut_poses(d: Derivation) -> Outputs:
    values: list[Scalar] = []
    for pose in (closure.pose() for closure in d.closures):
        for row, x in zip(pose.rotation, pose.origin, strict=True):
            values.extend((*row, x))
        values.extend((0.0, 0.0, 0.0, 1.0))
    return vector(values)


def _family(d: Derivation, kind: type[Family]) -> Family:
    """Return all forces of one family."""
    return next(x for x in d.elements if isinstance(x, kind))


def _cut_forces(d: Derivation) -> Outputs:
    loops = _family(d, ElasticLoopCoordinates)
    return vector([x for one in loops.members for x in (one.s, loops.force_on(one, d.v))])


def _deflections(d: Derivation) -> list[Deflection]:
    """Return coordinates of all force elements, in the order of ``element_rows``."""
    by_name = {one.name: one for element in d.elements for one in element.deflections(d.v)}
    return [by_name[name] for name in element_rows(d.described)]


WRITERS: Mapping[str, Callable[[Derivation], Outputs]] = {
    "mass_matrix": _mass_matrix,
    "bias_force": lambda d: d.vector(inertial_rows(d.tree, d.v, d.coasting, ZERO)[0]),
    "gravity": lambda d: d.vector(_nonlinear_effects(d, d.still)),
    "nonlinear_effects": lambda d: d.vector(_nonlinear_effects(d, d.v)),
    "center_of_mass": lambda d: vector([*center_of_mass(d.tree)]),
    "centroidal_momentum": _centroidal_momentum,
    "frame_velocities": lambda d: vector(frame_velocities(d.tree, d.v)),
    "frame_accelerations": lambda d: vector(frame_accelerations(d.tree, d.v, d.a)),
    "imu": lambda d: vector(imu(d.tree, d.v, d.a)),
    "measurement": _measurement,
    "generalized_momentum": _generalized_momentum,
    "generalized_force": _generalized_force,
    "external_force": lambda d: d.vector(_external(d)[0]),
    "external_reactions": lambda d: wrench_outputs([x.scaled(-1.0) for x in _external(d)[1]]),
    "residual": lambda d: d.vector(
        [row - drive for row, drive in zip(d.dynamics_with_drives(d.v, d.a), d.u, strict=True)]
    ),
    "drive_forces": _drive_forces,
    "drive_jacobian": _drive_jacobian,
    "inverse_dynamics": lambda d: d.vector(d.dynamics(d.v, d.a)),
    "tree_inverse_dynamics": lambda d: d.vector(d.dynamics(d.v, d.a)),
    "constrained_drives": drives,
    "residual_jacobian": _residual_jacobian,
    "coriolis_matrix": _coriolis_matrix,
    "christoffel": _christoffel,
    "kinematics": _kinematics,
    "energy": _energy,
    "reactions": lambda d: wrench_outputs(_reactions(d)),
    "tree_reactions": lambda d: wrench_outputs(_reactions(d)),
    "regressor": _regressor,
    "closing_derivatives": closing_derivatives,
    "closing_reactions": closing_reactions,
    "loop_reactions": lambda d: loop_wrenches(d, elastic=True),
    "loop_wrenches": loop_wrenches,
    "euler_cosines": _euler_cosines,
    "constraint": lambda d: vector([g.value for g in closure_residuals(d, d.still)]),
    "constraint_jacobian": lambda d: d.rows([g.jacobian_row for g in closure_residuals(d, d.still)]),
    "constraint_bias": lambda d: vector([g.bias for g in closure_residuals(d, d.v)]),
    "coupling_forces": lambda d: _coupled(d, d.dynamics(d.v, d.a)),
    "external_coupling_forces": lambda d: _coupled(d, [-1.0 * x for x in _external(d)[0]]),
    "cut_poses": _cut_poses,
    "implicit_step": implicit_step,
    "element_forces": lambda d: vector([x for one in _deflections(d) for x in (one.value, one.force)]),
    "element_jacobian": lambda d: d.rows([one.jacobian_row for one in _deflections(d)]),
    "spring_forces": lambda d: vector(_family(d, PointSprings).lengths_and_tensions(d.v)),
    "spring_jacobian": lambda d: d.rows(_family(d, PointSprings).length_rows()),
    "spring_stiffness": lambda d: d.matrices(_family(d, PointSprings).stiffness()),
    "cut_forces": _cut_forces,
    "cut_jacobian": lambda d: d.rows([one.jacobian_row for one in _family(d, ElasticLoopCoordinates).members]),
}

VARIANTS: Mapping[str, Mapping[str, Variant]] = {  # kernels with several variants
    "forward_dynamics": SOLVERS,
    "tree_forward_dynamics": SOLVERS,
    "constrained_dynamics": CONSTRAINED,
    "settling": PROJECTION,
    "forward_dynamics_jacobian": SLOPES,
    "tree_forward_dynamics_jacobian": SLOPES,
}
