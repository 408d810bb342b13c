"""Stages of a linearly implicit method of higher order: what solves for the change of the rates in each of them.

A Rosenbrock method with the matrix A = [[0, 1], [-M^-1 K, -M^-1 B]], which K and B of springs, dampers and the
controller alone make, needs for rates r and shifts s the u_q and u_v of

    u_q / c - u_v = s,    u_v / c + M^-1 (K u_q + B u_v) = r,    c = gamma h,

that is u_v = c (r + w) and u_q = c (u_v + s) with

    (M + c B + c^2 K) w = -((c B + c^2 K) r + c K s):

nothing is multiplied by M, and the matrix is that of a linearly implicit step, whose elimination does not depend on r
and s.  Of a W-method (T. Steihaug, A. Wolfbrandt, "An Attempt to Avoid Exact Jacobian and Nonlinear Equations in the
Numerical Solution of Stiff Differential Equations", Mathematics of Computation 33, 1979) the order does not depend on
A; so falling slopes, friction's too, and those of friction by its load are left out, and directions of loops and
springs are those of the step's beginning.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import chain

from ..forces.laws import Effect
from ..forces.rows import effects, stretches
from ..program.cutting import cut
from ..program.ir import Program, finish
from ..program.passes import PARAMETERS, run_passes
from ..solve.rows import Row, elastic_row
from ..tree.composite import Rows
from ..tree.spatial import Scalar, along
from .closed import eliminated, pivot_outputs, with_rows
from .constraint_rows import gaps, general_rank
from .derivation import Derivation, Outputs

LATE = ("rates", "shifts")
KEPT = "kept"
STAGES = ("stage_factors", "stage_solution")


@dataclass(frozen=True)
class _Slope:
    """A spring's and damper's share in the matrix, c B + c^2 K, and what a shift is multiplied by, c K."""

    whole: Scalar
    by_shift: Scalar

    def force(self, rate: Scalar, shift: Scalar) -> Scalar:
        """Force of a rate and a shift."""
        return self.whole * rate + self.by_shift * shift

    def __add__(self, other: _Slope) -> _Slope:
        return _Slope(self.whole + other.whole, self.by_shift + other.by_shift)


class _Stage:
    """The derivation with c and its square."""

    def __init__(self, d: Derivation) -> None:
        self.d = d
        self.c, self.square = d.graph.input("times", 0), d.graph.input("times", 1)
        self.rates = [d.graph.input("rates", place) for place in range(len(d.own))]
        self.shifts = [d.graph.input("shifts", place) for place in range(len(d.own))]

    def linear(self, stiffness: Scalar, damping: Scalar) -> _Slope:
        """Share of a spring and a damper."""
        return _Slope(self.c * damping + self.square * stiffness, self.c * stiffness)

    def rising(self, law: Effect) -> _Slope:
        """Share of a law; none where it falls, so that the matrix stays positive definite."""
        found, f = self.linear(law.by_s, law.by_v), self.d.functions
        rises = f.step(found.whole)
        return _Slope(f.max(found.whole, 0.0) + self.c * f.max(law.rubs, 0.0), rises * found.by_shift)


def stage(d: Derivation) -> Outputs:
    """w, (n,), and the pivots."""
    here = _Stage(d)
    given, v = frozenset(d.model.prescribed), d.v
    rates: list[Scalar] = [0.0] * d.model.size
    shifts: list[Scalar] = [0.0] * d.model.size
    for place, i in enumerate(d.own):
        rates[i], shifts[i] = here.rates[place], here.shifts[place]
    for x in (rates, shifts):
        d.followers.follow(x)
    own = _of_coordinates(here)
    forces: list[Scalar] = [slope.force(rates[i], shifts[i]) for i, slope in enumerate(own)]
    armature = [x + slope.whole for x, slope in zip(d.bound.armature, own, strict=True)]
    beside = _blocks(here, rates, shifts, armature, forces)
    slopes: dict[int, Scalar] = {}
    for motor, stretch in stretches(d.bound, d.q, v, d.functions).items():
        between = d.bound.transmissions[motor]
        slope = here.linear(stretch.linear.by_s, stretch.linear.by_v) + here.rising(stretch.nonlinear)
        rate, shift = (x[motor] * between.inverse_ratio - x[between.principal] for x in (rates, shifts))
        force = slope.force(rate, shift)
        forces[motor] = forces[motor] + force * between.inverse_ratio
        forces[between.principal] = forces[between.principal] - force
        slopes[motor] = slope.whole
    rows: list[Row] = [gap.row(0.0) for gap in (gaps(d, d.still) if d.described.constraints else [])]
    for arms, slope in _lines(here):
        force = slope.force(along(arms, rates), along(arms, shifts))
        for i, arm in arms.items():
            forces[i] = forces[i] + force * arm
        rows.append(elastic_row(arms, slope.whole))
    drives: list[Scalar] = [0.0 if i in given else -1.0 * force for i, force in enumerate(forces)]
    rest = replace(d.bound, gravity=(0.0, 0.0, 0.0))
    tree, pivots = eliminated(d, armature, drives, d.still, slopes, bound=rest, coupled=bool(rows), beside=beside)
    rank = general_rank(d.described) if d.described.constraints else None
    return {**d.motion(with_rows(d, tree, rows, rank)[0] if rows else tree.free), **pivot_outputs(d, pivots)}


def _blocks(
    here: _Stage, rates: list[Scalar], shifts: list[Scalar], armature: list[Scalar], forces: list[Scalar]
) -> Rows:
    """Slopes of journals and joints' damping beside the diagonal; those on it, and all their forces, are added."""
    beside: Rows = {}
    still: Rows = {}
    touching = ((x.slopes(here.c, here.square), x.slopes(0.0, here.c)) for x in here.d.touches(here.d.v))
    damped = ((x.slopes(here.c), still) for x in here.d.dampers)
    for whole, by_shift in chain(touching, damped):
        for (i, j), slope in whole.items():
            for row, column in [(i, j)] if i == j else [(i, j), (j, i)]:
                force = slope * rates[column] + by_shift.get((i, j), 0.0) * shifts[column]
                forces[row] = forces[row] + force
            if i == j:
                armature[i] = armature[i] + slope
            else:
                beside[i, j] = beside.get((i, j), 0.0) + slope
    return beside


def _of_coordinates(here: _Stage) -> list[_Slope]:
    """Slopes of the coordinates themselves and of the controller, (n,)."""
    d = here.d
    found = [here.linear(*pair) for pair in zip(d.bound.stiffness, d.bound.damping, strict=True)]
    for i, law in effects(d.bound, d.q, d.v, d.functions).items():
        found[i] = found[i] + here.rising(law)
    driven = frozenset(d.model.driven)
    for place, i in enumerate(d.own):
        if i in driven:
            found[i] = found[i] + here.linear(d.graph.input("kp", place), d.graph.input("kd", place))
    return found


def _lines(here: _Stage) -> list[tuple[Mapping[int, Scalar], _Slope]]:
    """Springs between points, and forces of cut joints, journals among them: their arms and slopes."""
    d, found = here.d, list[tuple[Mapping[int, Scalar], _Slope]]()
    for line in d.lines(d.v):
        pull = line.along(0.0)
        found.append((pull.arms, here.rising(Effect(by_s=pull.by_e, by_v=pull.by_rate))))
    for own in d.deviating:
        if own.has_force:
            found.append((own.arms, here.rising(own.resists(d.v, d.functions))))
    for touch in d.cut_touches(d.v):
        pairs = zip(touch.directions(here.c, here.square), touch.directions(0.0, here.c), strict=True)
        found += [(arms, _Slope(whole, by_shift)) for (arms, whole), (_, by_shift) in pairs]
    return found


def derive_stage(d: Derivation) -> dict[str, Program]:
    """Both programs of a stage, by their names: what one step computes once, and what each stage does with it."""
    whole = run_passes(finish(d.graph, "stage", stage(d)))
    pair = cut(whole, LATE, (PARAMETERS,), KEPT)
    return {name: replace(part, name=name) for name, part in zip(STAGES, pair, strict=True)}
