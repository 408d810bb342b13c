"""Eqs. (4)-(16) in SymPy: the closed form of a small robot, term by term as traces of 4x4 matrices.

This is the paper's expanded form (10).  It costs O(n^3) traces, so it serves robots with a handful of coordinates: as
the reference that the recursion is tested against, and for equations that a person reads.  Nothing is simplified:
derivatives are built by the chain rule along the tree from the joint blocks of ``joint``, and second derivatives that
vanish by lemma (7) and its sharper form come out as zero matrices there and are dropped at once.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain
from typing import Any

import numpy as np
import sympy as sp

from eomgen.arrays import Array
from eomgen.errors import InputError
from eomgen.names import split_component
from eomgen.robot.coordinates import MODE
from eomgen.robot.elements import KINDS
from eomgen.robot.model import FIXED_BODY, Body, Model

from ..forces.element import ForceElement, Setting
from ..forces.elements import ELEMENTS
from ..forces.scalar_functions import Functions
from ..joint.lemmas import Matrix, joint_derivatives, joint_transform, step
from ..program.operations import CALLS
from ..tree.bound import Bound, bind
from ..tree.constraints import Closure, closures
from ..tree.frozen_joints import PosedTree, geometry
from ..tree.spatial import Pose, PseudoInertia
from . import bending
from .bending import exact

Expr = Any  # sympy.Expr
Row = tuple[Expr, ...]


def _expression(op: str, *x: Expr) -> Expr:
    """Return a function of expressions, by the name of its operation."""
    write = CALLS[op].sympy
    assert write is not None, op
    return write(sp, *x)


SYMBOLS = Functions(_expression)


def _sincos(angle: Expr) -> tuple[Expr, Expr]:
    return sp.sin(angle), sp.cos(angle)


@dataclass(frozen=True)
class ClosedForm:
    """The equations of motion M a + bias - Q - u = 0 of a robot with n coordinates, in SymPy.

    q, v, a, u: symbols of positions (m, rad), velocities, accelerations and drives (N, N m, or inputs of drives with
        states, whose forces are in Q), n each.
    z, rates: symbols of internal states, and their rates by v and z.
    wrench: symbols (F_x, F_y, F_z, M_x, M_y, M_z) per moving link, base frame, about its centre of mass; or ().
    parameters: symbols that stand for numbers of the description, by name.
    mass_matrix: (n, n), eq. (11) and armatures on the diagonal.
    christoffel: [s][v][w], the traces of eq. (12), symmetric in v and w: Christoffel symbols of the first kind.
    bias: sum over v, w of C_s,vw v_v v_w.  generalized_force: Q_P + Q_F + Q_G of eqs. (13)-(15).
    residual: M a + bias - Q - u, zero on a motion of the open tree.  kinetic: eq. (4) and rotors, J.  potential:
    gravity, springs, J.  constraint: of loops and couplings; its elastic parts act in Q and potential.
    """

    q: Row
    v: Row
    a: Row
    u: Row
    z: Row
    rates: Row
    wrench: tuple[Row, ...]
    parameters: Mapping[str, Expr]
    mass_matrix: Matrix
    christoffel: tuple[tuple[Row, ...], ...]
    bias: Row
    generalized_force: Row
    residual: Row
    kinetic: Expr
    potential: Expr
    constraint: ConstraintExpressions

    def function(self, *fields: str) -> Callable[..., Any]:
        """Return a function (q, v, a, u[, wrench, z]) -> the named fields as float arrays; parameters are numbers."""
        named = [getattr(self, name) for name in fields]
        flat = [list(_flat(value)) for value in named]
        arguments = [*self.q, *self.v, *self.a, *self.u, *self.z, *chain.from_iterable(self.wrench)]
        evaluate = sp.lambdify(arguments, flat, modules="math", cse=_share)
        n = len(self.q)
        shapes: dict[str, tuple[int, ...]] = {"mass_matrix": (n, n), "christoffel": (n, n, n)}
        shapes |= {"kinetic": (), "potential": (), "rates": (len(self.z),)}

        def call(
            q: Array, v: Array, a: Array, u: Array, wrench: Sequence[Sequence[float]] = (), z: Sequence[float] = ()
        ) -> Any:
            forces = wrench if len(wrench) else [[0.0] * 6 for _ in self.wrench]
            numbers = evaluate(*q, *v, *a, *u, *z, *chain.from_iterable(forces))
            arrays = [
                np.array(values, dtype=float).reshape(shapes.get(name, (n,)))
                for name, values in zip(fields, numbers, strict=True)
            ]
            return arrays[0] if len(arrays) == 1 else tuple(arrays)

        return call


@dataclass(frozen=True)
class ConstraintExpressions:
    """Components of a constraint g(q) = 0, those of ``tree.constraints`` on symbols.

    names: of the components, as in ``Model.constraints``.  values: of g, m or sines of angles.  jacobian: rows of J,
    derivatives by the coordinates, by index.
    """

    names: tuple[str, ...]
    values: tuple[Expr, ...]
    jacobian: tuple[Mapping[int, Expr], ...]


NO_CONSTRAINT = ConstraintExpressions((), (), ())


@dataclass
class _Derivatives:
    """A_0k (4x4) of one body, with its first derivatives by coordinate index and second by pair (v <= w)."""

    pose: Matrix
    first: dict[int, Matrix] = field(default_factory=dict)
    second: dict[tuple[int, int], Matrix] = field(default_factory=dict)


def closed_form(
    model: Model, symbolic_parameters: bool | Mapping[str, Expr] = False, external_forces: bool = False
) -> ClosedForm:
    """Derive the closed form of a model.

    Args:
        model: the tree; about six coordinates are a sensible limit.
        symbolic_parameters: True makes every number of the description that is not zero a symbol of its parameter
            name; a mapping gives the expressions of some parameters, the others stay numbers.
        external_forces: give every moving link a symbolic wrench, eq. (14).

    Raises:
        InputError: the robot has point-to-point springs, or an offset of an angle that is not active.
    """
    refuse_springs(model)
    whole, described, binder = model.tree, model if bends(model) else model.tree, _Values(symbolic_parameters)
    bound = bind(whole, binder, _sincos)
    q, v, a, u = _symbols(described)
    z, n = state_symbols(whole), len(q)
    moving = _moving_links(model, bound, q, binder) if bends(model) else _rigid_links(model.tree, bound, q)
    bodies, inertias, M, C = moving.bodies, moving.inertias, moving.mass_matrix, moving.christoffel
    wrench = _wrench_symbols(model) if external_forces else ()
    bias = tuple(sum(C[s][i][j] * v[i] * v[j] for i in range(n) for j in range(n)) for s in range(n))
    tree = PosedTree(whole, bound, geometry(whole, bound, moving.at, _sincos))
    loops = list(closures(tree, _sincos))
    placed = (*moving.at, *(sp.S.Zero for _ in z))  # nothing depends on positions of states
    inputs = {i: u[i] for i in whole.drives}
    setting = Setting(**vars(tree), q=placed, sincos=_sincos, functions=SYMBOLS, closures=lambda: loops, inputs=inputs)
    elements = [family(setting) for family in ELEMENTS]
    rates = (*(sum(share[i] * v[i] for i in share) for share in moving.shares), *z)
    Q, z_rates = _elastic_and_weight(bound, moving, q, elements, rates)
    for s, force in _external_force(model, bound, bodies, wrench):
        Q[s] += force
    constraint = NO_CONSTRAINT if bends(model) else _constraint(whole, bound, q, loops)
    Ma = M * sp.Matrix(a)
    residual = tuple(Ma[s] + bias[s] - Q[s] - (0 if s in inputs else u[s]) for s in range(n))
    kinetic = sum(M[i, j] * v[i] * v[j] for i in range(n) for j in range(n)) / 2
    potential = _potential(bound, bodies, inertias, elements, rates)
    return ClosedForm(
        q, v, a, u, z, z_rates, wrench, binder.symbols, M, C, bias, tuple(Q), residual, kinetic, potential, constraint
    )


def bends(model: Model) -> bool:
    """Whether a link of a robot bends."""
    return any(body.modes for body in model.bodies)


@dataclass(frozen=True)
class _Links:
    """Positions ``at`` of the tree's coordinates, their derivatives ``shares`` by q, and M and C of its links."""

    at: Sequence[Expr]
    shares: Sequence[Mapping[int, Expr]]
    bodies: Sequence[_Derivatives]
    inertias: Sequence[Matrix]
    mass_matrix: Matrix
    christoffel: tuple[tuple[Row, ...], ...]


def _rigid_links(model: Model, bound: Bound, q: Row) -> _Links:
    """Write M and C as traces; all coordinates are free."""
    bodies, inertias = _chain_rule(model, bound, q), [_matrix(body.inertia) for body in bound.bodies]
    M = _mass_matrix(bodies, inertias, bound.armature[: len(q)])
    shares = [{i: sp.S.One} for i in range(len(q))]
    return _Links(q, shares, bodies, inertias, M, _christoffel(bodies, inertias, len(q)))


def _moving_links(model: Model, bound: Bound, q: Row, binder: _Values) -> _Links:
    """Differentiate poses of a robot whose links bend by the coordinates that follow no others."""
    if model.constraints or model.internal_states or model.drives:
        what = "loops and couplings" if model.constraints else "laws with internal states, nor servo drives"
        raise InputError(f"{model.name}: the closed form of links that bend knows no {what}; leave them out")
    whole = model.tree
    at = bending.placed(whole, model, q)
    inertias = [_matrix(body.inertia) for body in bound.bodies]
    links = bending.bend(whole, model, q, inertias, binder)
    poses = bending.poses(whole, bound, at, [_pose(body.placement) for body in bound.bodies])
    bodies = [_Derivatives(A, {i: D for i, s in enumerate(q) if not (D := A.diff(s)).is_zero_matrix}) for A in poses]
    shares = [{i: share for i, s in enumerate(q) if (share := x.diff(s)) != 0} for x in at]
    S = sp.Matrix(len(at), len(q), lambda i, j: shares[i].get(j, 0))
    armature = S.T * sp.diag(*bound.armature[: len(at)]) * S
    M = bending.mass_matrix([(body.pose, body.first) for body in bodies], inertias, links, armature)
    return _Links(at, shares, bodies, inertias, M, bending.christoffel(M, q))


def _constraint(model: Model, bound: Bound, q: Row, loops: Sequence[Closure]) -> ConstraintExpressions:
    """Write g and J of loops and rigid couplings."""
    values = [value for loop in loops for value in loop.values()]
    rows: list[Mapping[int, Expr]] = [row for loop in loops for row in loop.jacobian()]
    for coupling in bound.couplings:
        if coupling.law is None:
            values.append(coupling.residual(q))
            rows.append(coupling.jacobian_row)
    return ConstraintExpressions(model.constraints, tuple(values), tuple(rows))


def refuse_springs(model: Model) -> None:
    """Refuse a robot with force elements between links, or journals in cut joints."""
    for kind in KINDS.values():
        names = ", ".join(element.name for element in model.robot.link_elements if element.TABLE == kind.TABLE)
        if names:
            raise InputError(f"{model.name}: the closed form knows no {kind.SHORT} ({names}); leave them out")
    journals = ", ".join(loop.name for loop in model.robot.loops if loop.radial is not None)
    if journals:
        raise InputError(f"{model.name}: the closed form knows no journals of cut joints ({journals}); leave them out")


class _Values:
    """Turns a named number into an expression: exact 0, 1 and -1 stay exact, so that they prune."""

    def __init__(self, chosen: bool | Mapping[str, Expr]) -> None:
        self.chosen = chosen
        self.symbols: dict[str, Expr] = {}

    def __call__(self, name: str, number: float) -> Expr:
        if isinstance(self.chosen, Mapping):
            expression = self.chosen.get(name)
            if expression is not None:
                self.symbols[name] = expression
                return expression
        elif self.chosen and number != 0.0:
            return self.symbols.setdefault(name, sp.Symbol(name, real=True))
        return exact(number)


def _symbols(model: Model) -> tuple[Row, Row, Row, Row]:
    """Return symbols like the paper's: x_1, its derivatives xdot_1 and xddot_1, and the drive D_x_1."""
    number = {body.joint: k + 1 for k, body in enumerate(model.bodies)}
    number |= {body.name: k + 1 for k, body in enumerate(model.bodies) if body.modes}
    kinds = [(kind.replace(MODE, "e"), owner) for owner, kind in map(split_component, model.coordinates)]
    names = [(kind, number[owner]) for kind, owner in kinds]
    patterns = ("{}_{}", "{}dot_{}", "{}ddot_{}", "D_{}_{}")
    q, v, a, u = (tuple(sp.Symbol(p.format(*name), real=True) for name in names) for p in patterns)
    return q, v, a, u


def state_symbols(model: Model) -> Row:
    """Return a symbol for every internal state: z_gamma_1 of the friction of gamma_1, z_loop1_x of a loop joint's."""
    number = {body.joint: k + 1 for k, body in enumerate(model.bodies)}
    alike, names = Counter((state.owner, state.state.name) for state in model.states), list[str]()
    for state in model.states:
        joint, coordinate = split_component(state.owner)
        place = f"{coordinate}_{number[joint]}" if joint in number else state.owner.replace(".", "_")
        letter = _letter(state.state.name)
        letter = letter if alike[state.owner, state.state.name] == 1 else f"{letter}_{state.law}"
        names.append(f"{letter}_{place}")
    return tuple(sp.Symbol(name, real=True) for name in names)


def _letter(state: str) -> str:
    """Return a state's name as a letter: "z0" of the branch "0.z"."""
    number, _, name = state.rpartition(".")
    return f"{name}{number}" if number.isdigit() else state.replace(".", "_")


def _wrench_symbols(model: Model) -> tuple[Row, ...]:
    keys = [f"{letter}_{axis}" for letter in "FR" for axis in "xyz"]
    return tuple(tuple(sp.Symbol(f"{key}_{link}", real=True) for key in keys) for link in model.links)


def _chain_rule(model: Model, bound: Bound, q: Row) -> list[_Derivatives]:
    """Differentiate A_0k of every body, by the product rule on A_0k = A_0p . (B_k A_(k-1)k)."""
    done: list[_Derivatives] = []
    for body, numbers in zip(model.bodies, bound.bodies, strict=True):
        parent = done[body.parent] if body.parent != FIXED_BODY else _Derivatives(sp.eye(4))
        B = _pose(numbers.placement)
        A, first, second = _joint_blocks(body, tuple(s + c for s, c in zip(q, bound.angle_offsets, strict=True)))
        across = B * A
        before = parent.pose * B
        derivatives = _Derivatives(parent.pose * across)
        derivatives.first = {i: D * across for i, D in parent.first.items()} | {i: before * D for i, D in first.items()}
        derivatives.second = {pair: D * across for pair, D in parent.second.items()}
        derivatives.second |= {(i, j): Di * B * Dj for i, Di in parent.first.items() for j, Dj in first.items()}
        derivatives.second |= {pair: before * D for pair, D in second.items()}
        # lemma (7) and the sharper one
        done.append(
            replace(derivatives, second={pair: D for pair, D in derivatives.second.items() if not D.is_zero_matrix})
        )
    return done


def _joint_blocks(body: Body, q: Row) -> tuple[Matrix, dict[int, Matrix], dict[tuple[int, int], Matrix]]:
    """Return A_(i-1)i and its derivatives in the symbols of q, by index in q."""
    index = dict(zip(body.active, body.indices, strict=True))
    swap = {step(name).symbol: q[i] for name, i in index.items()}
    derivatives = joint_derivatives(body.active)
    first = {index[name]: D.xreplace(swap) for name, D in derivatives.first.items()}
    second = {
        (index[v], index[w]): D.xreplace(swap) for (v, w), D in derivatives.second.items() if index[v] <= index[w]
    }
    return joint_transform(body.active).xreplace(swap), first, second


def _mass_matrix(bodies: Sequence[_Derivatives], inertias: Sequence[Matrix], armature: Sequence[Expr]) -> Matrix:
    """Compute eq. (11): M_sv = sum over k of tr(dA_0k/ds H_k (dA_0k/dv)^T)."""
    n = len(armature)
    M = sp.diag(*armature)
    for body, H in zip(bodies, inertias, strict=True):
        for s, D in body.first.items():
            for v in (v for v in body.first if v <= s):
                M[s, v] += _dot(D * H, body.first[v])
    return sp.ImmutableMatrix(n, n, lambda s, v: M[max(s, v), min(s, v)])


def _christoffel(bodies: Sequence[_Derivatives], inertias: Sequence[Matrix], n: int) -> tuple[tuple[Row, ...], ...]:
    """Compute eq. (12): C_s,vw = sum over k of tr(dA_0k/ds H_k (d2A_0k/dv dw)^T)."""
    C = [[[sp.S.Zero] * n for _ in range(n)] for _ in range(n)]
    for body, H in zip(bodies, inertias, strict=True):
        for s, D in body.first.items():
            DH = D * H
            for (v, w), D2 in body.second.items():
                C[s][v][w] += _dot(DH, D2)
    return tuple(tuple(tuple(C[s][min(v, w)][max(v, w)] for w in range(n)) for v in range(n)) for s in range(n))


def _elastic_and_weight(
    bound: Bound, links: _Links, q: Row, elements: Sequence[ForceElement], v: Sequence[Expr]
) -> tuple[list[Expr], Row]:
    """Compute Q_P of eq. (13), and Q_G: eq. (14) with weights; the last column of H is (m r_C, m).

    Also the rates of internal states, which stand behind the rates in v: what resists them is minus their inertia times
    their rate.
    """
    n, states = len(q), len(v) - len(links.at)
    Q = [sp.S.Zero] * (n + states)
    shares = [*links.shares, *({n + k: sp.S.One} for k in range(states))]
    for element in elements:
        for index, force in element.resist(v):
            for i, share in shares[index].items():
                Q[i] -= share * exact(_with_sizes(force))
    g = sp.Matrix([*bound.gravity, 0])
    for body, H in zip(links.bodies, links.inertias, strict=True):
        for i, s in enumerate(q):
            Q[i] += _dot(g, body.first[i] * H[:, 3]) if i in body.first else 0
            Q[i] += _dot(g, body.pose * H[:, 3].diff(s))
    inertias = bound.armature[len(links.at) :]
    return Q[:n], tuple(exact(sp.expand(rate / w)) for rate, w in zip(Q[n:], inertias, strict=True))


def _with_sizes(force: Any) -> Expr:
    """Return a force with |x| where it has the larger of x and -x, and smaller ones where it has -max(-x, -y)."""
    expression = sp.sympify(force)
    larger = {x: sp.Abs(exact(x.args[0])) for x in expression.atoms(sp.Max) if sp.Add(*x.args) == 0}
    expression = expression.xreplace(larger)
    return expression.replace(
        lambda e: isinstance(e, sp.Max) and all(x.could_extract_minus_sign() for x in e.args),
        lambda e: -sp.Min(*(-x for x in e.args)),
    )


def _external_force(
    model: Model, bound: Bound, bodies: Sequence[_Derivatives], wrench: Sequence[Row]
) -> Iterator[tuple[int, Expr]]:
    """Compute Q_F of eq. (14), with each angle's axis in the moment term: (index, addend) pairs."""
    for link, symbols in zip(model.links, wrench, strict=False):  # no wrenches unless they were asked for
        k, com = bound.coms[link]
        F, R = sp.Matrix([*symbols[:3], 0]), sp.Matrix(symbols[3:])
        for s, D in bodies[k].first.items():
            yield s, _dot(F, D * sp.Matrix([*com, 1])) + _dot(R, _axis(D, bodies[k].pose))


def _axis(derivative: Matrix, pose: Matrix) -> Matrix:
    """Return the base-frame axis that a coordinate turns a body about (zero for translations): of dR/ds R^T."""
    W = derivative[:3, :3] * pose[:3, :3].T
    return sp.Matrix([W[2, 1], W[0, 2], W[1, 0]])


def _potential(
    bound: Bound,
    bodies: Sequence[_Derivatives],
    inertias: Sequence[Matrix],
    elements: Sequence[ForceElement],
    v: Sequence[Expr],
) -> Expr:
    """Compute energies of springs, of internal states, and of weights with respect to the base's origin."""
    g = sp.Matrix([*bound.gravity, 0])
    springs = sum(exact(energy) for element in elements for energy in element.energies())
    springs += sum(exact(energy) for element in elements for energy in element.state_energies(v))
    return springs - sum(_dot(g, body.pose * H[:, 3]) for body, H in zip(bodies, inertias, strict=True))


def _pose(pose: Pose) -> Matrix:
    rows = [[*map(exact, row), exact(p)] for row, p in zip(pose.rotation, pose.origin, strict=True)]
    return sp.ImmutableMatrix([*rows, [0, 0, 0, 1]])


def _matrix(inertia: PseudoInertia) -> Matrix:
    """Return H = [[J, mc], [mc^T, m]], 4x4."""
    rows = [[*map(exact, row), exact(h)] for row, h in zip(inertia.second, inertia.first, strict=True)]
    return sp.ImmutableMatrix([*rows, [*map(exact, inertia.first), exact(inertia.mass)]])


def _dot(left: Matrix, right: Matrix) -> Expr:
    """Compute tr(left right^T), without forming the product; of columns their product."""
    return sp.Add(*(a * b for a, b in zip(left, right, strict=True)))


def _share(expressions: Sequence[Any]) -> tuple[list[tuple[Expr, Expr]], list[Any]]:
    """Name what occurs more than once; SymPy's cse also looks for common factors, which takes it minutes here."""
    uses: Counter[Expr] = Counter()
    flat = list(_flat(expressions))
    stack = list(flat)
    while stack:
        node = stack.pop()
        uses[node] += 1
        if uses[node] == 1:
            stack.extend(node.args)
    named: list[tuple[Expr, Expr]] = []
    done: dict[Expr, Expr] = {}

    def rebuild(node: Expr) -> Expr:
        if not node.args:
            return node
        if node not in done:
            made = node.func(*map(rebuild, node.args), evaluate=False)
            if uses[node] > 1:
                named.append((sp.Dummy(), made))
                made = named[-1][0]
            done[node] = made
        return done[node]

    parts = [[rebuild(node) for node in group] for group in expressions]
    return named, parts


def _flat(nested: Any) -> Iterator[Expr]:
    if isinstance(nested, sp.Expr) and not isinstance(nested, sp.MatrixBase):
        yield nested
    else:
        for item in nested:
            yield from _flat(item)
