"""Base parameters: which combinations of inertial parameters, rotors and friction forces can show, by name.

Forces are linear in all of them, u = Y(q, v, a) theta.  Columns of Y that depend on others at every motion belong to
parameters that depend linearly on those: they are regrouped (M. Gautier, W. Khalil 1990).
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..arrays import Array, Index, Mask
from ..codegen.kernels.groups import BASE_PARAMETERS
from ..description import RobotLike, as_robot
from ..errors import InputError
from ..kernel.complete import Kernel
from ..names import component_name, show
from ..pipeline.building import build
from ..results.contents import Contents
from ..robot.coordinates import is_mode
from ..shown import Shown
from .relations import Relations, refuse_followers, refuse_internal_states, relations_of, tree_relations

TERMS = ("links", "rotors", "viscous", "dry", "offset")
LINKS, ROTORS, FRICTION, TRANSMISSIONS, MODES = TERMS[0], TERMS[1], TERMS[2:], "transmissions", "modes"
LINEAR = (*TERMS, TRANSMISSIONS, MODES)  # what forces are linear in
ZERO = 1e-9  # of the longest column: one that is shorter is round-off, or of no effect
DEPENDENT = 1e-8  # of a column's length: what is left of one that depends on those before it
ROUND_OFF = 1e-8  # of coefficients that are meant to be whole numbers
SEED = 1  # of the random motions
WIDTH = 3.0  # m and rad: random coordinates are so far from 0 at most; velocities and accelerations too, per s and s^2
_TEXTS: Mapping[str, Any] = {
    "robot": str,
    **dict.fromkeys(("terms", "parameters", "names", "without_effect"), tuple[str, ...]),
}


@dataclass(frozen=True)
class BaseParameters(Shown):
    """Combinations of parameters that forces can show, and how they come from the parameters.

    Attributes:
        robot: the robot's name.
        terms: of TERMS, what parameters there are of.
        parameters: names of theta, p of them: "link1.m", "joint1.gamma.armature", "joint1.gamma.viscous".
        chosen: places of the parameters that begin a combination, (b,), in their order.
        matrix: (b, p), base values are ``matrix @ theta``.
        names: formulas of the combinations, such as "link2.mx + 0.4318 link3.m".
        without_effect: names of the parameters that no force depends on.
        relations: of the robot's coordinates; None where none follows from others.
    """

    robot: str
    terms: tuple[str, ...]
    parameters: tuple[str, ...]
    chosen: Index
    matrix: Array
    names: tuple[str, ...]
    without_effect: tuple[str, ...]
    relations: Relations | None = None

    def __len__(self) -> int:
        return len(self.names)

    def regressor(self, kernel: Kernel, q: ArrayLike, v: ArrayLike, a: ArrayLike) -> Array:
        """Return columns of the regressor that belong to the combinations, (..., n, b), N or N m per unit of each.

        With rigid couplings rows are those of the coordinates that follow from no others.

        Args:
            kernel: of that robot, with its regressor.
            q, v, a: (..., n), as of ``kernel.functions.regressor``.
        """
        return columns(kernel, q, v, a, self.terms, self.relations)[1][..., self.chosen]

    def values(self, theta: ArrayLike) -> Array:
        """Return values of the combinations, (b,), from those of the parameters, (p,).

        Raises:
            InputError: another number of parameters.
        """
        values = np.asarray(theta, dtype=np.float64)
        if values.shape != (len(self.parameters),):
            raise InputError(
                f"theta: shape {values.shape}; allowed: ({len(self.parameters)},), in the order of parameters"
            )
        return np.asarray(self.matrix @ values)

    def texts(self) -> dict[str, Any]:
        """Return the fields of a file that are texts; ``from_texts`` reads them."""
        return {name: getattr(self, name) for name in _TEXTS}

    @staticmethod
    def from_texts(table: Contents, chosen: Index, matrix: Array) -> BaseParameters:
        """Return base parameters from a file's table of texts, and numbers as of the attributes.

        Raises:
            InputError: a text is missing, or numbers and texts are not of the same combinations.
        """
        texts: dict[str, Any] = {name: table.value(kind, name) for name, kind in _TEXTS.items()}
        many, whole = len(texts["names"]), len(texts["parameters"])
        if chosen.shape != (many,) or matrix.shape != (many, whole):
            raise InputError(
                f"{table.path}: matrix and chosen are of other sizes; allowed: {many} names of {whole} parameters"
            )
        if many and not 0 <= chosen.min() <= chosen.max() < whole:
            raise InputError(f"{table.path}: chosen: got {chosen.max()}; allowed: 0 to {whole - 1}")
        return BaseParameters(**texts, chosen=chosen, matrix=matrix)

    def as_dict(self) -> dict[str, Any]:
        """Return plain values, for JSON: per combination its parameters with their coefficients."""
        plain = {
            name: {self.parameters[j]: float(row[j]) for j in np.flatnonzero(row).tolist()}
            for name, row in zip(self.names, self.matrix, strict=True)
        }
        return {
            "robot": self.robot,
            "terms": list(self.terms),
            "base_parameters": plain,
            "without_effect": list(self.without_effect),
        }

    def lines(self) -> list[str]:
        """Return a list for people."""
        head = f"{self.robot}: {len(self)} base parameters of {len(self.parameters)} ({', '.join(self.terms)})"
        lines = [head, "", *self.names]
        return [*lines, "", f"without effect: {', '.join(self.without_effect)}"] if self.without_effect else lines


def base_parameters(
    robot: RobotLike,
    *,
    terms: Sequence[str] = (LINKS, ROTORS),
    static: bool = False,
    kernel: Kernel | None = None,
    known: Collection[str] = (),
) -> BaseParameters:
    """Return which combinations of parameters forces can show, on random motions of the robot.

    A parameter that depends linearly on others goes to those that stand before it: from a link to the one that it
    hangs on, from an armature to links.  Gravity is the robot's, and so are lengths: special ones, such as axes that
    meet, leave fewer combinations.  Of a robot with loops: of its open tree, with forces known at every coordinate.  Of
    one with rigid couplings: along the coordinates that follow from no others, so that a motor that turns with two
    joints acts in the rows of both.

    Args:
        robot: a Robot, the name of a built-in one, or the path of a description.
        terms: what parameters there are of, among LINEAR: "links" (m, m c and inertia about the origin of the link's
            frame), "rotors" (armatures); of each coordinate with a drive or in a rigid coupling "viscous" (times its
            rate), "dry" (times the sign of its rate) and "offset" (a constant force); "transmissions" (stiffness and
            damping between motors and their joints); "modes" (stiffness and damping of modes of links that bend).
        static: whether the robot stands still in every sample.
        kernel: of that robot, ``without_states``, with its regressor; built if None.  Its parameters count, gravity
            among them.
        known: names of links whose parameters are known, and not among those of "links".  Those of links that bend
            are, as the constants of their modes are; what stands on their nodes is sought.

    Raises:
        InputError: terms that there are not, or whose effect no motion shows.
    """
    robot = as_robot(robot).with_constraints()
    kernel = kernel or build(robot.without_states(), kernels=BASE_PARAMETERS)
    refuse_followers(robot, kernel)
    refuse_internal_states(kernel, "a kernel of robot.without_states()")
    is_tree = bool(robot.loops) or any(coupling.law is not None for coupling in robot.own_couplings)
    relations = (tree_relations if is_tree else relations_of)(robot, known)
    everything = np.ones(len(relations.free), dtype=np.bool_)
    return combinations(kernel, terms, everything, everything, relations, static=static)


def combinations(
    kernel: Kernel,
    terms: Sequence[str],
    moving: Mask,
    known: Mask,
    relations: Relations,
    *,
    static: bool = False,
) -> BaseParameters:
    """Return ``base_parameters`` where some coordinates stand at 0, and forces are known at some.

    Args:
        kernel: with its regressor.
        terms: among LINEAR.
        moving: whether a coordinate moves, (f,), of those that follow from no others.
        known: whether the force there is known, (f,).
        relations: of the robot's coordinates.
        static: as of ``base_parameters``.

    Raises:
        InputError: as of ``base_parameters``.
    """
    names = parameter_names(kernel, terms, relations)
    count = 10 + 3 * len(names) // max(int(known.sum()), 1)
    rng = np.random.default_rng(SEED)
    free = rng.uniform(-WIDTH, WIDTH, (3, count, len(moving))) * moving
    q, v, a = (x @ relations.matrix.T for x in free)
    still = 0.0 if static else 1.0
    W = columns(kernel, q + relations.offset, v * still, a * still, terms, relations)[1][:, known]
    W = W.reshape(-1, len(names))
    chosen, matrix = regrouped(W)
    if not chosen.size:
        raise InputError(f"terms: {', '.join(terms)}: no force of {kernel.name} depends on them; allowed: other terms")
    return with_formulas(kernel.name, terms, names, chosen, matrix, relations)


def with_formulas(
    robot: str,
    terms: Sequence[str],
    names: tuple[str, ...],
    chosen: Index,
    matrix: Array,
    relations: Relations | None,
) -> BaseParameters:
    """Return combinations with their names, from ``regrouped`` of the parameters of these names."""
    formulas = tuple(_formula(names, int(first), row) for first, row in zip(chosen, matrix, strict=True))
    idle = tuple(name for name, column in zip(names, matrix.T, strict=True) if not column.any())
    return BaseParameters(robot, tuple(terms), names, chosen, matrix, formulas, idle, relations)


def parameter_names(kernel: Kernel, terms: Collection[str], relations: Relations | None = None) -> tuple[str, ...]:
    """Return names of the columns of ``columns``.

    Raises:
        InputError: no terms, or unknown ones, transmissions of a robot without motors, or modes of rigid links.
    """
    _check_terms(terms)
    names = kernel.regressor_names
    parameters = [names[i] for i in inertial_places(kernel, terms, relations)]
    for term in FRICTION:
        parameters += [
            component_name(kernel.coordinates[i], term) for i in _rubbing(kernel, relations) if term in terms
        ]
    if TRANSMISSIONS in terms:
        motors = relations.motors if relations else ()
        if not motors:
            raise InputError(f"terms: transmissions: no joint of {kernel.name} has a motor; allowed: other terms")
        for i, _, _ in motors:
            parameters += [component_name(kernel.coordinates[i], key) for key in ("stiffness", "damping")]
    if MODES in terms:
        modes = modal_places(kernel)
        if not modes:
            raise InputError(f"terms: modes: no link of {kernel.name} bends; allowed: other terms")
        parameters += [component_name(kernel.coordinates[i], key) for i in modes for key in ("stiffness", "damping")]
    return tuple(parameters)


def modal_places(kernel: Kernel) -> list[int]:
    """Return indices of the coordinates that are modes of links that bend."""
    return [i for i, name in enumerate(kernel.coordinates) if is_mode(name)]


def inertial_places(kernel: Kernel, terms: Collection[str], relations: Relations | None) -> Index:
    """Return the index of the kernel's columns that are sought: of links that are not known, and of armatures."""
    names, links = kernel.regressor_names, 10 * len(kernel.joints)
    known = relations.known if relations else frozenset()
    of_links = [i for i in range(links) if LINKS in terms and names[i].rpartition(".")[0] not in known]
    return np.array([*of_links, *(range(links, len(names)) if ROTORS in terms else ())], dtype=np.intp)


def columns(
    kernel: Kernel,
    q: ArrayLike,
    v: ArrayLike,
    a: ArrayLike,
    terms: Collection[str],
    relations: Relations | None = None,
) -> tuple[tuple[str, ...], Array]:
    """Return names of the parameters of the terms, and their columns (..., n, parameters).

    Args:
        kernel: with its regressor.
        q, v, a: (..., n).
        terms: among LINEAR.
        relations: of the robot's coordinates; with couplings rows are those of the f that follow from no others.

    Raises:
        InputError: no terms, or unknown ones, or transmissions of a robot without motors.
    """
    names = parameter_names(kernel, terms, relations)
    Y = kernel.functions.regressor(q, v, a)
    rates = np.broadcast_to(np.asarray(v, dtype=np.float64), Y.shape[:-1])
    parts = [Y[..., inertial_places(kernel, terms, relations)]]
    unit_rows = np.eye(kernel.n)[:, _rubbing(kernel, relations)]
    factors = {"viscous": rates, "dry": np.sign(rates), "offset": np.ones_like(rates)}
    parts += [factors[term][..., None] * unit_rows for term in FRICTION if term in terms]
    if TRANSMISSIONS in terms and relations:
        angles = np.broadcast_to(np.asarray(q, dtype=np.float64), Y.shape[:-1])
        parts += [_transmission(x, motor) for motor in relations.motors for x in (angles, rates)]
    if MODES in terms:
        places = np.broadcast_to(np.asarray(q, dtype=np.float64), Y.shape[:-1])
        units = np.eye(kernel.n)
        parts += [x[..., i, None, None] * units[:, [i]] for i in modal_places(kernel) for x in (places, rates)]
    stacked = np.concatenate(parts, axis=-1)
    return names, relations.columns(stacked) if relations else stacked


def _transmission(x: Array, motor: tuple[int, int, float]) -> Array:
    """Return the column, (..., n, 1), of a force in the deflection of a transmission, or in its rate."""
    rotor, joint, ratio = motor
    deflection, rows = x[..., rotor] / ratio - x[..., joint], np.zeros((*x.shape, 1))
    rows[..., rotor, 0], rows[..., joint, 0] = deflection / ratio, -deflection
    return rows


def _rubbing(kernel: Kernel, relations: Relations | None) -> list[int]:
    """Return numbers of the coordinates whose friction counts: with a drive, or in a coupling."""
    return list(relations.rubbing) if relations else list(kernel.raw.libraries.meta["driven"])


def _check_terms(terms: Collection[str]) -> None:
    for term in terms:
        if term not in LINEAR:
            raise InputError(f"terms: {show(term)}; allowed: {', '.join(LINEAR)}")
    if not terms:
        raise InputError(f"terms: none; allowed: one or more of {', '.join(LINEAR)}")


def regrouped(W: Array) -> tuple[Index, Array]:
    """Return columns that depend on no columns before them, and what the others are of these.

    Args:
        W: (samples, p), the columns of all parameters, stacked.

    Returns:
        Index of b independent columns, and (b, p): W is W[:, places] times it, but for round-off.  Whole numbers
        are meant to be so.
    """
    lengths = np.linalg.norm(W, axis=0)
    chosen: list[int] = []
    Q, R = np.zeros((W.shape[0], 0)), np.zeros((0, W.shape[1]))
    for j in np.flatnonzero(lengths > ZERO * lengths.max(initial=0.0)):
        left, row = W[:, j] / lengths[j], np.zeros(len(chosen))
        for _ in range(2):  # once more for round-off
            projection = Q.T @ left
            left, row = left - Q @ projection, row + projection
        R[:, j] = row * lengths[j]
        length = float(np.linalg.norm(left))
        if length > DEPENDENT:
            Q = np.column_stack([Q, left / length])
            R = np.vstack([R, np.zeros(W.shape[1])])
            R[-1, j] = length * lengths[j]
            chosen.append(int(j))
    places = np.array(chosen, dtype=np.intp)
    return places, _cleaned(np.linalg.solve(R[:, places], R)) if chosen else R


def _cleaned(matrix: NDArray[Any]) -> Array:
    """Return coefficients without round-off, where they are meant to be whole numbers."""
    whole = np.round(matrix)
    return np.asarray(np.where(np.abs(matrix - whole) < ROUND_OFF, whole, matrix) + 0.0, dtype=np.float64)


def _formula(names: Sequence[str], first: int, row: Array) -> str:
    """Return a combination as a sum: the parameter that begins it, then what goes to it, in their order."""
    text = names[first]
    for j in np.flatnonzero(row).tolist():
        if j != first:
            size = f"{abs(row[j]):.6g} " if abs(row[j]) != 1.0 else ""
            text += f" {'+' if row[j] > 0.0 else '-'} {size}{names[j]}"
    return text
