"""Laws of mechanics that one of the many robots keeps: of its compiled kernel, and of the generator's programs."""

from __future__ import annotations

import numpy as np

from eomgen.codegen.joint.zeros import zero_map
from eomgen.codegen.kernels.equations import STRAIGHT_COLUMNS
from eomgen.robot.value import INERTIA_KEYS, LINEAR
from tests.oracles.unpruned import brute_force
from tests.support.figures import Figures
from tests.support.many_motion import Places, momenta
from tests.support.many_robots import Array, Subject, derived, differences, run, size_of, times

LIMIT = 1e-12  # relative to the max-norm of the state's result, or of the terms that it is the sum of
BALANCE = 1e-11
PRUNED = 1e-13
EPSILON = float(np.finfo(float).eps)
STEP = 1e-30  # of complex steps: its square is nothing beside a number
FEW = 4  # states for derivatives by every coordinate


def check_mass_matrix(s: Subject, figures: Figures) -> None:
    """Symmetric to the bit, and positive."""
    assert np.array_equal(s.M, np.swapaxes(s.M, 1, 2)), "M is not symmetric"
    values = np.linalg.eigvalsh(s.M)
    figures.at_most("least / greatest eigenvalue of M, negative", float((-values[:, 0] / values[:, -1]).max()), LIMIT)


def check_rates(s: Subject, figures: Figures) -> None:
    """M_dot = C + C^T and v^T (M_dot - 2 C) v = 0, M_dot by a complex step: exact to round-off.

    C is compared with what M changes by per rate, whose terms may cancel: with max |M| max |v|, too.
    """
    shape = (len(s.q), s.model.size, s.model.size)
    compiled = "christoffel" in s.form
    C = s.kernel.coriolis_matrix(s.q, s.v) if compiled else s.run("coriolis_matrix", q=s.q, v=s.v).reshape(shape)
    M_dot = np.imag(s.run("mass_matrix", q=s.q + 1j * STEP * s.v)).reshape(shape) / STEP
    size = np.maximum(size_of(M_dot), size_of(s.M) * size_of(s.v))
    figures.at_most("M_dot - C - C^T", differences(C + np.swapaxes(C, 1, 2), M_dot, size), LIMIT)
    v = np.abs(s.v)
    power = np.einsum("ni,nij,nj->n", s.v, M_dot - 2 * C, s.v)
    terms = np.einsum("ni,nij,nj->n", v, np.abs(M_dot) + 2 * np.abs(C), v)
    terms = np.maximum(terms, size * size_of(s.v) ** 2)
    figures.at_most("v^T (M_dot - 2 C) v", float((np.abs(power) / terms).max()), LIMIT)
    bias = s.kernel.bias_force(s.q, s.v) if "energy" in s.form else s.run("bias_force", q=s.q, v=s.v)
    figures.at_most("C v - bias", differences(times(C, s.v), bias, size * size_of(s.v)), LIMIT)


def check_round_trip(s: Subject, figures: Figures) -> None:
    """Forward after inverse dynamics within 100 cond eps, times how much larger than M a what cancels is."""
    found = s.kernel.forward_dynamics(s.q, s.v, s.drives)
    cancelling = np.maximum(1.0, s.forces / size_of(times(s.M, s.a)))
    error = size_of(found - s.a) / size_of(s.a) / (np.linalg.cond(s.M) * EPSILON * cancelling)
    figures.at_most("forward after inverse dynamics / (cond eps)", float(error.max()), 100.0)


def check_energy(s: Subject, figures: Figures) -> None:
    """v^T M v / 2, and the power of all forces is the rate of the energy (by a complex step)."""
    energy = s.kernel.energy(s.q, s.v) if "energy" in s.form else s.run("energy", q=s.q, v=s.v)
    kinetic = np.einsum("ni,nij,nj->n", s.v, s.M, s.v) / 2
    size = np.einsum("ni,nij,nj->n", np.abs(s.v), np.abs(s.M), np.abs(s.v)) / 2
    figures.at_most("kinetic energy - v^T M v / 2", differences(energy[:, :1], kinetic[:, None], size), LIMIT)
    h = 1j * STEP
    rate = np.imag(s.run("energy", q=s.q + h * s.v, v=s.v + h * s.a)).sum(axis=1) / STEP
    given = [c for joint in s.robot.joints for c in joint.coordinates.values()]
    damping = np.array([c.damping or 0.0 for c in given])
    power = np.einsum("ni,ni->n", s.v, s.drives - damping * s.v)
    size = s.forces * np.abs(s.v).sum(axis=1)
    figures.at_most("rate of energy - power", differences(rate[:, None], power[:, None], size), LIMIT)


def check_jacobians(s: Subject, figures: Figures) -> None:
    """Those of frames and of the residual, and of forward dynamics where it is compiled, against complex steps."""
    few = s.part(FEW)
    poses = Places.of(few.model, _stepped(few, "kinematics", "q", q=few.q))
    for frame in few.kernel.frames:
        R, x = poses.frame(frame)
        turned = np.einsum("...ij,...kj->...ik", np.imag(R) / STEP, np.real(R))
        rows = [np.imag(x) / STEP, np.stack([turned[..., 2, 1], turned[..., 0, 2], turned[..., 1, 0]], axis=-1)]
        expected = np.swapaxes(np.concatenate(rows, axis=-1), 1, 2)
        size = np.maximum(size_of(expected), 1.0)  # of a frame that nothing moves
        found = few.kernel.frame_jacobian(few.q, frame)
        figures.at_most("frame jacobian", differences(found, expected, size), LIMIT)
    arrays = {"q": few.q, "v": few.v, "a": few.a}
    blocks: tuple[Array, ...]
    if "jacobians" in s.form:
        blocks = few.kernel.residual_jacobian(*arrays.values())
    else:
        n = few.model.size
        blocks = tuple(np.moveaxis(few.run("residual_jacobian", **arrays).reshape(FEW, 3, n, n), 1, 0))
    for label, block in zip("qva", blocks, strict=True):
        steps = np.swapaxes(np.imag(_stepped(few, "inverse_dynamics", label, **arrays)) / STEP, 1, 2)
        size = np.maximum(size_of(steps), size_of(few.M) if label != "q" else few.forces)
        figures.at_most(f"residual by {label}", differences(block, steps, size), LIMIT)
    if s.form == "folded, jacobians":
        arrays = {"q": few.q, "v": few.v, "u": few.u}
        round_off = np.linalg.cond(few.M) * EPSILON
        solved = few.kernel.forward_dynamics(few.q, few.v, few.u)
        blocks = (*few.kernel.residual_jacobian(few.q, few.v, solved)[:2], np.eye(few.model.size))
        found = few.kernel.forward_dynamics_jacobian(few.q, few.v, few.u)
        for label, block, right in zip("qvu", found, blocks, strict=True):
            steps = np.swapaxes(np.imag(_stepped(few, "forward_dynamics", label, **arrays)) / STEP, 1, 2)
            terms = size_of(np.abs(np.linalg.inv(few.M)) @ np.abs(right))
            error = differences(block, steps, np.maximum(terms, 1e-300) * round_off)
            figures.at_most(f"accelerations by {label} / (cond eps)", error, 100.0)


def _stepped(s: Subject, kernel: str, label: str, **arrays: Array) -> Array:
    """The program's outputs with a complex step of each entry of one input in turn, (states, n, outputs)."""
    n = s.model.size
    wide = {name: np.broadcast_to(x[:, None], (len(x), n, n)) for name, x in arrays.items()}
    return s.run(kernel, **{**wide, label: wide[label] + 1j * STEP * np.eye(n)})


def check_balance(s: Subject, figures: Figures) -> None:
    """The base carries weights and what changes the momentum; along its coordinates a joint carries drives."""
    places = Places.of(s.model, s.run("kinematics", q=s.q))
    reactions = s.kernel.reactions(s.q, s.v, s.a)
    h = 1j * STEP
    rate = np.imag(momenta(s.model, s.run, s.q + h * s.v, s.v + h * s.a)).sum(axis=-2) / STEP
    expected = rate - places.weights()
    found, terms = places.carried_by_base(reactions)
    size = np.maximum(size_of(terms), size_of(places.weights()))
    figures.at_most("reactions of the base - momentum balance", differences(found, expected, size), BALANCE)
    given = [c for joint in s.robot.joints for c in joint.coordinates.values()]
    k, d, armature = (np.array([getattr(c, x) or 0.0 for c in given]) for x in ("stiffness", "damping", "armature"))
    drives = s.drives - k * s.q - d * s.v - armature * s.a
    error = differences(places.along_coordinates(reactions), drives, np.maximum(s.forces, size_of(reactions)))
    figures.at_most("reactions along coordinates - drives", error, BALANCE)


def check_linearity(s: Subject, figures: Figures) -> None:
    """Inverse dynamics is linear in masses, first and second moments: links twice is both, once each."""
    model = s.kept
    values = dict(model.parameters)
    own, links = dict(values), [link.name for link in s.robot.links]
    passed_on = dict(zip(links, [*links[1:], links[0]], strict=True))
    for name in values:
        path = name.split(".")
        if path[0] == "links":
            values[name] = own[".".join(["links", passed_on[path[1]], *path[2:]])]
        elif path[-1] in ("stiffness", "damping", "armature"):
            values[name] = 0.0
    both = dict(own)
    for link in links:
        both |= _together(own, values, link)
    program = derived(model, "inverse_dynamics", True)
    arrays = {"q": s.q, "v": s.v, "a": s.a}
    first, second, together = (run(program, model, arrays, list(p.values())) for p in (own, values, both))
    size = s.forces + size_of(second)
    figures.at_most("linear in inertial parameters", differences(first + second, together, size), LIMIT)


def _together(one: dict[str, float], other: dict[str, float], link: str) -> dict[str, float]:
    """Mass, com and inertia of two bodies that are one."""
    masses, coms, tensors = [], [], []
    for values in (one, other):
        xx, yy, zz, xy, xz, yz = (values[f"links.{link}.inertia.{key}"] for key in INERTIA_KEYS)
        masses.append(values[f"links.{link}.mass"])
        coms.append(np.array([values[f"links.{link}.com.{axis}"] for axis in LINEAR]))
        tensors.append(np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]))
    com = (masses[0] * coms[0] + masses[1] * coms[1]) / sum(masses)
    total = sum(
        tensor + m * ((c - com) @ (c - com) * np.eye(3) - np.outer(c - com, c - com))
        for m, c, tensor in zip(masses, coms, tensors, strict=True)
    )
    places = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
    made = {f"links.{link}.inertia.{key}": float(total[i]) for key, i in zip(INERTIA_KEYS, places, strict=True)}
    made |= {f"links.{link}.com.{axis}": float(x) for axis, x in zip(LINEAR, com, strict=True)}
    return {**made, f"links.{link}.mass": sum(masses)}


def check_zeros(s: Subject, figures: Figures) -> None:
    """What pruning drops is zero where nothing is dropped, and what is left agrees."""
    M, C = brute_force(s.model, s.q)
    armature = [c.armature or 0.0 for joint in s.robot.joints for c in joint.coordinates.values()]
    found = zero_map(s.model)
    size_M = size_of(M)
    size_C = np.maximum(size_of(C), size_M)
    kept_M, kept_C = found.mass_matrix.mask, found.christoffel.mask
    figures.count("points of the unpruned derivation", len(s.q))
    figures.count("pruned entries of M and C", int((~kept_M).sum() + (~kept_C).sum()))
    figures.at_most("pruned entries of M, unpruned", float((size_of(M[:, ~kept_M]) / size_M).max()), PRUNED)
    figures.at_most("pruned entries of C, unpruned", float((size_of(C[:, ~kept_C]) / size_C).max()), PRUNED)
    assert not s.M[:, ~kept_M].any(), "a pruned entry of M is not zero"
    figures.at_most("M, pruned - unpruned", differences(s.M, M + np.diag(armature), size_M), PRUNED)
    n = s.model.size
    units = np.broadcast_to(np.eye(n), (len(s.q), n, n))
    columns = s.run("coriolis_matrix", q=np.broadcast_to(s.q[:, None], units.shape), v=units)
    columns = np.moveaxis(columns.reshape(len(s.q), n, n, n), 1, 3)
    figures.at_most("C, pruned - unpruned", differences(columns, C, size_C), PRUNED)
    if "christoffel" in s.form:
        T = s.kernel.christoffel(s.q)
        figures.at_most("christoffel - unpruned", differences(T, C, size_C), PRUNED)
        looped = n * sum(s.program("coriolis_matrix").count().values()) > STRAIGHT_COLUMNS
        figures.count("tensors in a loop of C" if looped else "tensors written out")
        if not looped:
            assert not T[:, ~kept_C].any(), "a pruned entry of C is not zero"


CHECKS = (
    check_mass_matrix,
    check_rates,
    check_round_trip,
    check_energy,
    check_jacobians,
    check_balance,
    check_linearity,
    check_zeros,
)
