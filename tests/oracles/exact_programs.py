"""Programs that are rendered, compared with eqs. (5), (11) and (12) of derived joint blocks, in rational arithmetic.

Coordinates, velocities and accelerations are random rational numbers, sines and cosines rational points of the circle.
Both sides begin with the same floats of the description, so they differ by the rounding of folded constants.
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

from eomgen.codegen.joint.facts import facts_of
from eomgen.codegen.joint.zeros import Tally
from eomgen.codegen.kernels.equations import Equations
from eomgen.codegen.kernels.signatures import OWN_KERNELS
from eomgen.codegen.program.ir import Program, evaluate
from eomgen.codegen.program.passes import PARAMETERS
from eomgen.codegen.tree.bound import bind
from eomgen.codegen.tree.followers import Followers
from eomgen.robot.model import FIXED_BODY, Model, with_offset_angles
from eomgen.robot.value import ANGULAR
from tests.oracles.generic_terms import blocks_at

Matrix = list[list[Fraction]]
Row = list[Fraction]

CHECKED = (
    "mass_matrix",
    "bias_force",
    "coriolis_matrix",
    "christoffel",
    "generalized_force",
    "inverse_dynamics",
    "residual",
    "forward_dynamics",
)
ROUNDING = 1e-11  # of the sum of the terms' magnitudes: rounded constants make less than 1e-14


@dataclass(frozen=True)
class _Rows:
    """sum_k tr(dA_0k/ds H_k A_ddot_0k^T) per coordinate, and the sums of the magnitudes of the products in them."""

    values: Row
    sizes: Row


class _Point:
    """A robot with its numbers at a random point, and eq. (5) there."""

    def __init__(self, model: Model, seed: int) -> None:
        self.model, rng = model, random.Random(seed)
        self.whole, self.active = with_offset_angles(model)
        bound = bind(self.whole, lambda _, number: number, lambda x: (math.sin(x), math.cos(x)))
        self.followers = Followers(self.whole, model, bound)
        self.armature = [Fraction(x) for x in bound.armature]
        self.circle: dict[Fraction, tuple[Fraction, Fraction]] = {}
        q, self.v, self.a = ([Fraction(0)] * self.whole.size for _ in range(3))
        for index in self.active:
            q[index], self.v[index], self.a[index] = (Fraction(2 * rng.randint(-9, 9) + 1, 7) for _ in range(3))
            if self.whole.velocities[index].endswith(ANGULAR):
                t = Fraction(rng.choice((-1, 1)) * rng.randint(1, 9), 11)
                angle = Fraction(2.0 * math.atan(t))
                q[index] = angle - Fraction(bound.angle_offsets[index])
                self.circle[angle] = _circle(t)
        states = (Fraction(2 * rng.randint(-9, 9) + 1, 7) for _ in model.internal_states)
        windings = model.states_of_drives  # without currents they exert no forces
        self.z = [Fraction(0) if k in windings else z for k, z in enumerate(states, len(model.coordinates))]
        self.q = list(map(Fraction, self.followers.place(list(q))))
        self.placements = [_matrix(x.placement.rotation, x.placement.origin, 1.0) for x in bound.bodies]
        self.inertias = [_matrix(x.inertia.second, x.inertia.first, x.inertia.mass) for x in bound.bodies]
        for H in self.inertias:
            H[3][:3] = [H[i][3] for i in range(3)]
        self.joints = []
        for body in self.whole.bodies:
            at = []
            for index, name in zip(body.indices, body.active, strict=True):
                x = self.q[index] + Fraction(bound.angle_offsets[index])
                at.append(self.sincos(x) if name in ANGULAR else (Fraction(0), x))
            A, first, second = blocks_at(facts_of(model, body.active), at)
            self.joints.append((_square(A), [_square(x) for x in first], [_square(x) for x in second]))

    def sincos(self, x: Fraction) -> tuple[Fraction, Fraction]:
        """Return sine and cosine of an angle, exact where it was drawn, else within rounding."""
        return self.circle.get(x) or _circle(Fraction(math.tan(float(x) / 2.0)))

    def _moved(self, x: Row) -> Row:
        """Move followers after their leaders."""
        return list(map(Fraction, self.followers.follow(list(x))))

    def rows(self, v: Row, a: Row) -> _Rows:
        """Compute rows of the model's coordinates for velocities and accelerations of the whole's."""
        v, a = self._moved(v), self._moved(a)
        poses: list[Matrix] = []
        moving: list[tuple[Matrix, Matrix]] = []  # first and second time derivatives of A_0k
        before, across = [], []
        for body, B, (A, first, second) in zip(self.whole.bodies, self.placements, self.joints, strict=True):
            root = body.parent == FIXED_BODY
            pose, (dot, ddot) = (_UNIT, (_NOTHING, _NOTHING)) if root else (poses[body.parent], moving[body.parent])
            indices = list(body.indices)
            A_dot = _combined(first, [v[i] for i in indices])
            products = [v[i] * v[j] * (1 if i == j else 2) for k, i in enumerate(indices) for j in indices[k:]]
            A_ddot = _combined([*first, *second], [*(a[i] for i in indices), *products])
            before.append(_times(pose, B))
            across.append(_times(B, A))
            poses.append(_times(pose, across[-1]))
            turning = _times(_times(dot, B), A_dot)
            moving.append(
                (
                    _combined([_times(dot, across[-1]), _times(before[-1], A_dot)], [1, 1]),
                    _combined([_times(ddot, across[-1]), turning, _times(before[-1], A_ddot)], [1, 2, 1]),
                )
            )
        collected = [_times(H, _transposed(ddot)) for H, (_, ddot) in zip(self.inertias, moving, strict=True)]
        values = [x * y for x, y in zip(self.armature, a, strict=True)]
        sizes = list(map(abs, values))
        for k in range(len(collected) - 1, -1, -1):  # from the tips to the base
            body = self.whole.bodies[k]
            for index, D in zip(body.indices, self.joints[k][1], strict=True):
                pairs = zip(_times(before[k], D), _transposed(collected[k]), strict=True)
                terms = [x * y for row, column in pairs for x, y in zip(row, column, strict=True)]
                values[index] += sum(terms)
                sizes[index] += sum(map(abs, terms))
            if body.parent != FIXED_BODY:
                passed = _times(across[k], collected[k])
                collected[body.parent] = _combined([collected[body.parent], passed], [1, 1])
        gathered = [list(map(Fraction, self.followers.gather(row))) for row in (values, sizes)]
        return _Rows([gathered[0][i] for i in self.active], [max(abs(gathered[1][i]), sizes[i]) for i in self.active])

    def crossed(self, x: Row, y: Row) -> _Rows:
        """Compute sum over v, w of C_s,vw x_v y_w, by polarization of the terms of velocities."""
        still = [Fraction(0)] * self.whole.size
        plus, minus = (self.rows([a + sign * b for a, b in zip(x, y, strict=True)], still) for sign in (1, -1))
        values = [(a - b) / 4 for a, b in zip(plus.values, minus.values, strict=True)]
        return _Rows(values, [(a + b) / 4 for a, b in zip(plus.sizes, minus.sizes, strict=True)])


class _Programs:
    """Programs of a model, run at a point."""

    def __init__(self, equations: Equations, point: _Point) -> None:
        self.programs, self.point, model = equations.programs, point, equations.model
        parameters = [*map(Fraction, model.parameters.values()), *(Fraction(0) for _ in model.turning)]
        self.inputs = {"q": [point.q[i] for i in point.active], PARAMETERS: parameters}
        self.inputs["h"] = self._run(equations.setup, {}, "h")
        self.inputs |= {"z": point.z, "forces": [Fraction(0)] * len(model.drives)}

    def run(self, kernel: str, **arrays: Row) -> Row:
        """Return results of a kernel; arrays are of the whole's coordinates."""
        inputs = {name: [values[i] for i in self.point.active] for name, values in arrays.items()}
        found = self._run(self.programs[kernel], inputs, "out")
        return found[: len(self.point.active)] if OWN_KERNELS[kernel].writes == "rate_vector" else found

    def _run(self, program: Program, arrays: Mapping[str, Row], wanted: str) -> Row:
        exact = tuple(x._replace(leaf=Fraction(x.leaf)) if x.op == "const" else x for x in program.instructions)
        outputs = evaluate(
            replace(program, instructions=exact), {**self.inputs, **arrays}, self.point.sincos, _FUNCTIONS
        )
        return [value for (array, _), value in sorted(outputs.items()) if array == wanted]


def check_programs(equations: Equations, christoffel: Tally | None = None, seed: int = 0) -> set[str]:
    """Assert that programs of CHECKED compute what the joint blocks make; the names of those that were compared.

    Args:
        christoffel: zeros of C, entry by entry, which a program of it must have.
    """
    model, point = equations.model, _Point(equations.model, seed)
    run, still = _Programs(equations, point), [Fraction(0)] * point.whole.size
    n, v, a = len(model.coordinates), point.v, point.a
    bias, inertial, both = point.rows(v, still), point.rows(still, a), point.rows(v, a)
    crossed = point.crossed(v, a)
    known = [name for name in CHECKED if name in equations.programs]
    active_v, active_a = ([x[i] for i in point.active] for x in (v, a))
    Q = run.run("generalized_force", v=v) if "generalized_force" in known else None
    compared = set[str]()
    for name in known:
        if name == "mass_matrix":
            _compare(model, name, _applied(run.run(name), active_a), inertial)
        elif name == "bias_force":
            _compare(model, name, run.run(name, v=v), bias)
        elif name == "coriolis_matrix":
            _compare(model, name, _applied(run.run(name, v=v), active_a), crossed)
        elif name == "christoffel":
            C = run.run(name)
            _compare(model, name, _applied(_applied(C, active_a), active_v), crossed)
            for place in () if christoffel is None else (~christoffel.mask.ravel()).nonzero()[0].tolist():
                assert C[place] == 0, f"christoffel: entry {place} vanishes"
        elif Q is None or name == "generalized_force":
            continue
        elif name == "inverse_dynamics":
            _compare(model, name, _sums(run.run(name, v=v, a=a), Q), both, Q)
        elif model.drives and "drive_forces" not in equations.programs:
            continue
        elif name == "residual":
            computed = run.run(name, v=v, a=a, u=still)
            exerted = run.run("drive_forces", v=v, u=still) if model.drives else [Fraction(0)] * n
            _compare(model, name, _sums(_sums(computed, exerted), Q), both, Q)
        elif not model.constraints and not model.prescribed:
            answer = list(still)
            for index, value in zip(point.active, run.run(name, v=v, u=a), strict=True):
                answer[index] = value
            rows = point.rows(v, answer)
            rows = replace(rows, sizes=[100 * max(rows.sizes)] * n)  # eliminations pass rounding on from row to row
            exerted = run.run("drive_forces", v=v, u=a) if model.drives else active_a
            _compare(model, name, _sums(exerted, Q), rows, Q)
        else:
            continue
        compared.add(name)
    return compared


def _compare(model: Model, kernel: str, computed: Row, expected: _Rows, forces: Sequence[Any] = ()) -> None:
    """Assert that rows differ by no more than rounding."""
    for s, (one, other, size) in enumerate(zip(computed, expected.values, expected.sizes, strict=True)):
        at_most = Fraction(ROUNDING) * (size + (abs(forces[s]) if forces else 0))
        said = f"{kernel}, {model.velocities[s]}: the terms make {float(other):.9g}, the program {float(one):.9g}"
        assert abs(one - other) <= at_most, said


def _applied(flat: Row, x: Row) -> Row:
    """Contract the last index of an array with a vector."""
    n = len(x)
    return [sum((a * b for a, b in zip(flat[i : i + n], x, strict=True)), Fraction(0)) for i in range(0, len(flat), n)]


def _sums(x: Row, y: Row) -> Row:
    return [a + b for a, b in zip(x, y, strict=True)]


def _circle(t: Fraction) -> tuple[Fraction, Fraction]:
    """Return sine and cosine of 2 atan(t)."""
    return 2 * t / (1 + t * t), (1 - t * t) / (1 + t * t)


def _matrix(block: Sequence[Sequence[float]], column: Sequence[float], corner: float) -> Matrix:
    """Return [[block, column], [0, corner]]."""
    rows = [[*row, x] for row, x in zip(block, column, strict=True)]
    return [list(map(Fraction, row)) for row in [*rows, [0.0, 0.0, 0.0, corner]]]


def _square(flat: Sequence[Any]) -> Matrix:
    return [list(map(Fraction, flat[i : i + 4])) for i in range(0, 16, 4)]


def _transposed(A: Matrix) -> Matrix:
    return list(map(list, zip(*A, strict=True)))


def _times(A: Matrix, B: Matrix) -> Matrix:
    columns = _transposed(B)
    return [[_dot(row, column) for column in columns] for row in A]


def _dot(a: Row, b: Row) -> Fraction:
    return sum((x * y for x, y in zip(a, b, strict=True) if x and y), Fraction(0))


def _combined(matrices: Sequence[Matrix], factors: Sequence[Any]) -> Matrix:
    """Sum matrices times factors."""
    flat = zip(*([x for row in A for x in row] for A in matrices), strict=True)
    sums = [sum((f * x for f, x in zip(factors, entries, strict=True) if x), Fraction(0)) for entries in flat]
    return [sums[i : i + 4] for i in range(0, 16, 4)] or _NOTHING


def _float(x: Fraction) -> float:
    """Return the nearest float, of what is too large the largest."""
    return float(min(max(x, -_LARGEST), _LARGEST))


def _root(x: Fraction) -> Fraction:
    return Fraction(math.isqrt((x.numerator << 240) // x.denominator), 1 << 120)


_LARGEST = Fraction(1e300)
_UNIT = [[Fraction(i == j) for j in range(4)] for i in range(4)]
_NOTHING = [[Fraction(0)] * 4 for _ in range(4)]
_FUNCTIONS: Mapping[str, Callable[..., Fraction]] = {  # of forces, the same on both sides; the rest is exact
    "sqrt": _root,
    "step": lambda x: Fraction(x > 0),
    "exp": lambda x: Fraction(math.exp(min(max(_float(x), -700.0), 700.0))),
    "log": lambda x: Fraction(math.log(_float(x)) if x > 0 else -700.0),
    "atan2": lambda y, x: Fraction(math.atan2(_float(y), _float(x))),
}
