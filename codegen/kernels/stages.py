"""Stages of a linearly implicit method of higher order: what solves for the change of the rates in each of them.

A Rosenbrock method with the matrix A = [[0, 1], [-M^-1 K, -M^-1 B]], which K and B of springs, dampers and the
controller alone make, needs for rates r and shifts s the u_q and u_v of

    u_q / c - u_v = s,    u_v / c + M^-1 (K u_q + B u_v) = r,    c = gamma h,

that is u_v = c (r + w) and u_q = c (u_v + s) with

    (M + c B + c^2 K) w = -((c B + c^2 K) r + c K s):

nothing is multiplied by M, and the matrix is that of a linearly implicit step, whose elimination does not depend on r
and s.  Fully implicit Runge-Kutta methods ask for the same with a complex c, too (E. Hairer, G. Wanner, "Solving
Ordinary Differential Equations II", section IV.8): these programs are on pairs of real numbers.

Of a W-method (T. Steihaug, A. Wolfbrandt, "An Attempt to Avoid Exact Jacobian and Nonlinear Equations in the Numerical
Solution of Stiff Differential Equations", Mathematics of Computation 33, 1979) the order does not depend on A, nor does
what Newton's iterations converge to; so falling slopes, friction's too, and those of friction by its load are left out,
and directions of loops and springs are those of the step's beginning.  Directions of dampers between frames that turn
fast count, as a rate J v changes with them: J^T D d(J v)/dq is in K, which is no symmetric matrix then.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from ..forces.element import Blocks, Directions, SparseRow, StateSite, StateSlopes
from ..forces.joint_stiffness import ROUND_OFFS, CoordinateMatrix, combined, symmetric_product
from ..forces.laws import Effect
from ..program.complex_pairs import on_pairs
from ..program.cutting import cut
from ..program.forward_mode import gradients
from ..program.ir import Node, Program, finish
from ..program.passes import PARAMETERS, run_passes
from ..solve.rows import Row, elastic_row
from ..solve.states import share, state_rows
from ..tree.composite import Rows
from ..tree.spatial import ZERO, Scalar, add_row, along, is_zero
from .accelerations import MatrixShare
from .constraint_rows import closure_residuals
from .derivation import Derivation, Outputs

ARRAYS = ("times", "rates", "shifts", "kept")
PAIR_ARRAYS = ("pair_times", "pair_rates", "pair_shifts", "pair_kept")
STAGES = ("stage_factors", "stage_solution")
PAIR_STAGES = ("pair_factors", "pair_solution")


@dataclass(frozen=True)
class _Slope:
    """A spring's and damper's share in the matrix, c B + c^2 K, and what a shift is multiplied by, c K."""

    whole: Scalar
    by_shift: Scalar

    def force(self, rate: Scalar, shift: Scalar) -> Scalar:
        """Return the force of a rate and a shift."""
        return self.whole * rate + self.by_shift * shift

    def __add__(self, other: _Slope) -> _Slope:
        return _Slope(self.whole + other.whole, self.by_shift + other.by_shift)


class _Stage(MatrixShare):
    """Shares in the matrix of a stage, and the forces that its rates and shifts, (n,) each, make in it."""

    arrays = ARRAYS

    def __init__(self, d: Derivation) -> None:
        kp, kd = d.inputs("kp"), d.inputs("kd")
        inputs = {i: d.graph.input("kp", len(d.active) + place) for place, i in enumerate(d.drive_inputs)}
        super().__init__(d, d.q, d.v, 0.0, inputs)
        self.gains = {i: (kp[i], kd[i]) for i in d.drive_inputs}
        self.d, self.counts_turning = d, not d.described.constraints
        times, rates, shifts, _ = self.arrays
        self.c, self.square = d.graph.input(times, 0), d.graph.input(times, 1)
        self.rates, self.shifts = d.inputs(rates, states=True), d.inputs(shifts)
        for x in (self.rates, self.shifts):
            d.followers.follow(x)
        self.diagonal = [_Slope(0.0, 0.0)] * d.model.size
        self.laws: list[tuple[int, StateSite, StateSlopes]] = []
        self.directions: list[tuple[SparseRow, _Slope]] = []

    def push(self, i: int, force: Scalar) -> None:
        raise NotImplementedError("stages take no forces of elements")

    def on_coordinate(self, i: int, stiffness: Scalar, damping: Scalar) -> None:
        self.diagonal[i] = self.diagonal[i] + self._linear(stiffness, damping)

    def bend(self, i: int, law: Effect) -> None:
        self.diagonal[i] = self.diagonal[i] + self._rising(law)

    def in_internal_states(self, site: StateSite, law: StateSlopes) -> None:
        if site.coordinate is not None:
            self.laws.append((site.coordinate, site, law))
        elif site.motor is not None:
            self.slopes[site.motor] = self.slopes.get(site.motor, 0.0) + self._settle_states(site, law)
        else:
            self.rows.append(elastic_row(site.row, self._settle_states(site, law)))

    def settle(self) -> None:
        """Add the slopes of coordinates by themselves to their inertia, and what they make to the forces."""
        pairs = zip(self.diagonal, self.rates, self.shifts, strict=True)
        self.forces = [slope.force(rate, shift) for slope, rate, shift in pairs]
        self.armature = [x + slope.whole for x, slope in zip(self.d.bound.armature, self.diagonal, strict=True)]
        for i, site, law in self.laws:
            self.armature[i] = self.armature[i] + self._settle_states(site, law)

    def _settle_states(self, site: StateSite, law: StateSlopes) -> Scalar:
        """Add a law with internal states along a row, c (f_v r + f_z r_z) + c f_s (c r + s) and -w times the same of g;
        return its share in the matrix once the states are eliminated.
        """
        row, states = site.row, site.states
        acts, at_i, at = self._acts(law), along(row, self.rates), [self.rates[k] for k in states]
        led = self.c * at_i + along(row, self.shifts)
        force = law.f_v * at_i + law.f_s * led
        rates = [g_v * at_i + g_s * led for g_v, g_s in zip(law.g_v, law.g_s, strict=True)]
        for slope, z in zip(law.f_z, at, strict=True):
            force = force + slope * z
        for (k, j), slope in law.g_z.items():
            rates[k] = rates[k] + slope * at[j]
        self.pull(row, acts * (self.c * force))
        for k, w, rate in zip(states, law.inertias, rates, strict=True):
            self.forces[k] = self.forces[k] - w * (self.c * rate)
        self.states |= state_rows(row, states, law, self.c, acts)
        return acts * share(law, self.c, self.square)

    def _acts(self, law: StateSlopes) -> Scalar:
        """Return 1 where a force with a state counts in the matrix, 0 where it would fall."""
        return self.d.functions.step(share(law, self.c, self.square))

    def in_joint(self, slopes: Blocks) -> None:
        whole, by_shift = slopes(self.c, self.square), slopes(0.0, self.c)
        for (i, j), slope in whole.items():
            for row, column in [(i, j)] if i == j else [(i, j), (j, i)]:
                force = slope * self.rates[column] + by_shift.get((i, j), 0.0) * self.shifts[column]
                self.forces[row] = self.forces[row] + force
            if i == j:
                self.armature[i] = self.armature[i] + slope
            else:
                self.beside[i, j] = self.beside.get((i, j), 0.0) + slope

    def in_transmission(self, motor: int, linear: Effect, law: Effect) -> None:
        between = self.d.bound.transmissions[motor]
        slope = self._linear(linear.by_s, linear.by_v) + self._rising(law)
        rate, shift = (x[motor] * between.inverse_ratio - x[between.principal] for x in (self.rates, self.shifts))
        force = slope.force(rate, shift)
        self.forces[motor] = self.forces[motor] + force * between.inverse_ratio
        self.forces[between.principal] = self.forces[between.principal] - force
        self.slopes[motor] = self.slopes.get(motor, 0.0) + slope.whole

    def along(self, row: SparseRow, law: Effect, *, turns: bool = False) -> None:
        damping, f = law.by_v, self.d.functions
        turning = self._turning(row) if turns and not (is_zero(damping) and is_zero(law.friction_tangent)) else {}
        slope = self._rising(law)
        if not turning:
            self.directions.append((row, slope))
            return
        damping = self._rises(law) * damping + f.max(law.friction_tangent, 0.0)
        self._feel([row], [turning], {(0, 0): slope.whole}, {(0, 0): slope.by_shift}, {(0, 0): damping})

    def along_all(self, rows: SparseRow, directions: Directions) -> None:
        pairs = zip(directions(self.c, self.square), directions(0.0, self.c), strict=True)
        self.directions += [(row, _Slope(whole, by_shift)) for (row, whole), (_, by_shift) in pairs]

    def among(self, rows: SparseRow, members: Sequence[SparseRow], slopes: Blocks, *, turns: bool = False) -> None:
        whole, by_shift = slopes(self.c, self.square), slopes(0.0, self.c)
        turning = [self._turning(row) for row in members] if turns else []
        if any(turning):
            self._feel(members, turning, whole, by_shift, slopes(1.0, 0.0))
            return
        rates, shifts = ([along(row, x) for row in members] for x in (self.rates, self.shifts))
        pairs = zip(symmetric_product(whole, rates), symmetric_product(by_shift, shifts), strict=True)
        for row, (by_rate, more) in zip(members, pairs, strict=True):
            self.pull(row, by_rate + more)
        self.rows += [elastic_row(combined(x, members), slope) for x, slope in self._factored(whole, slopes)]

    def pull(self, row: SparseRow, force: Scalar) -> None:
        """Add a resisting force along a row."""
        for i, arm in row.items():
            self.forces[i] = self.forces[i] + force * arm

    def _turning(self, row: SparseRow) -> dict[int, Scalar]:
        """Return T = d(J v)/dq of a row J, by coordinates that follow no others; empty where rigid rows are solved."""
        if not self.counts_turning:
            return {}
        moving = [i for i in self.d.followers.leaders(row) if i in self.d.active]
        inputs = [x for x in (self.d.q[i] for i in moving) if isinstance(x, Node)]
        slopes = gradients(self.d.graph, [along(row, self.d.v)], inputs)[0]
        return {i: slope for i, slope in zip(moving, slopes, strict=True) if not is_zero(slope)}

    def _feel(
        self, members: Sequence[SparseRow], turning: Sequence[SparseRow], whole: Rows, by_shift: Rows, damping: Rows
    ) -> None:
        """Add forces and rows of values J whose rates are damped, R = (c D + c^2 K) J + c^2 D T.

        Args:
            members: J of each.
            turning: T of each.
            whole, by_shift, damping: c D + c^2 K, c K and D by their places, on and above the diagonal.
        """
        felt: list[dict[int, Scalar]] = [{} for _ in members]
        shifted: list[dict[int, Scalar]] = [{} for _ in members]
        for slopes, rows, into in (
            (whole, members, felt),
            ({at: self.square * d for at, d in damping.items()}, turning, felt),
            (by_shift, members, shifted),
            ({at: self.c * d for at, d in damping.items()}, turning, shifted),
        ):
            for (r, s), slope in slopes.items():
                for one, other in [(r, s)] if r == s else [(r, s), (s, r)]:
                    add_row(into[one], slope, rows[other])
        for row, by_rate, by_place in zip(members, felt, shifted, strict=True):
            force = along(by_rate, self.rates) + along(by_place, self.shifts)
            self.pull(row, force)
            self.rows.append(Row({i: arm for i, arm in row.items() if not is_zero(arm)}, slope=0.0, felt=by_rate))

    def _factored(self, whole: Rows, slopes: Blocks) -> list[tuple[dict[int, Scalar], Scalar]]:
        """Return directions with slopes that make a matrix of slopes at c and c^2."""
        return CoordinateMatrix(whole).directions(self.d.functions, ROUND_OFFS[self.d.dtype])

    def _linear(self, stiffness: Scalar, damping: Scalar) -> _Slope:
        """Return the share of a spring and a damper."""
        return _Slope(self.c * damping + self.square * stiffness, self.c * stiffness)

    def _rising(self, law: Effect) -> _Slope:
        """Return the share of a law; 0 where it falls, so that the matrix stays positive definite."""
        share, f, rises = self._linear(law.by_s, law.by_v), self.d.functions, self._rises(law)
        return _Slope(f.max(share.whole, 0.0) + self.c * f.max(law.friction_tangent, 0.0), rises * share.by_shift)

    def _rises(self, law: Effect) -> Scalar:
        """Return 1 where the share of a law counts, 0 where it would fall."""
        return self.d.functions.step(self._linear(law.by_s, law.by_v).whole)


class _PairStage(_Stage):
    """Stage with a complex c, whose size and its square are ``spans``.

    Slopes by directions that turn are left out: its factors serve all stages of a step, within which directions turn
    on, and iterations would not become fewer.

    A law rises or falls by these, as real numbers alone are more or less than 0; of slopes between coordinates those by
    positions and by velocities each alone are taken where they rise.  A matrix c D + c^2 K, of which c has a positive
    real part, has factors without pivoting, as D + c K is accretive, and pivots vanish where those of the sizes do.
    """

    arrays = PAIR_ARRAYS

    def __init__(self, d: Derivation) -> None:
        super().__init__(d)
        self.size, self.size_square = d.graph.input("spans", 0), d.graph.input("spans", 1)
        self.counts_turning = False

    def in_joint(self, slopes: Blocks) -> None:
        by_v, by_s = slopes(1.0, 0.0), slopes(0.0, 1.0)
        super().in_joint(lambda c, square: {at: c * slope + square * by_s.get(at, 0.0) for at, slope in by_v.items()})

    def along_all(self, rows: SparseRow, directions: Directions) -> None:
        pairs = list(zip(directions(1.0, 0.0), directions(0.0, 1.0), strict=True))
        super().along_all(rows, lambda c, square: [(row, c * v + square * s) for (row, v), (_, s) in pairs])

    def among(self, rows: SparseRow, members: Sequence[SparseRow], slopes: Blocks, *, turns: bool = False) -> None:
        by_v, by_s = slopes(1.0, 0.0), slopes(0.0, 1.0)
        pairs = sorted({*by_v, *by_s})

        def linear(c: Scalar, square: Scalar) -> Rows:
            return {at: c * by_v.get(at, 0.0) + square * by_s.get(at, 0.0) for at in pairs}

        super().among(rows, members, linear, turns=turns)

    def _factored(self, whole: Rows, slopes: Blocks) -> list[tuple[dict[int, Scalar], Scalar]]:
        f = self.d.functions
        kept = CoordinateMatrix(slopes(self.size, self.size_square)).pivots_kept(f, ROUND_OFFS[self.d.dtype])
        return CoordinateMatrix(whole).directions(f, kept=kept)

    def _rising(self, law: Effect) -> _Slope:
        share, f, rises = self._linear(law.by_s, law.by_v), self.d.functions, self._rises(law)
        return _Slope(rises * share.whole + self.c * f.max(law.friction_tangent, 0.0), rises * share.by_shift)

    def _rises(self, law: Effect) -> Scalar:
        return self.d.functions.step(self.size * law.by_v + self.size_square * law.by_s)

    def _acts(self, law: StateSlopes) -> Scalar:
        return self.d.functions.step(share(law, self.size, self.size_square))


def stage(d: Derivation, kind: type[_Stage] = _Stage, *, by_leaders: bool = False) -> Outputs:
    """Solve a stage: w, (n,), and the pivots; ``by_leaders``: as of ``MatrixShare.solve``."""
    here = _written_stage(d, kind)
    prescribed = frozenset(d.model.prescribed)
    drives: list[Scalar] = [0.0 if i in prescribed else -1.0 * force for i, force in enumerate(here.forces)]
    return here.solve(d, replace(d.bound, gravity=ZERO), drives, d.still, by_leaders=by_leaders)


def stage_has_rows(d: Derivation) -> bool:
    """Whether a stage solves for rows."""
    return bool(_written_stage(d, _Stage).rows)


def _written_stage(d: Derivation, kind: type[_Stage]) -> _Stage:
    """Return what all elements add to a stage."""
    here, driven = kind(d), frozenset(d.model.driven)
    for element in d.elements:
        element.add_diagonal(here)
    for place, i in enumerate(d.active):
        if i in driven and i not in d.drive_inputs:
            here.on_coordinate(i, d.graph.input("kp", place), d.graph.input("kd", place))
    here.settle()
    for element in d.elements:
        element.add_blocks(here)
    rows: list[Row] = [
        residual.row(0.0) for residual in (closure_residuals(d, d.still) if d.described.constraints else [])
    ]
    for element in d.elements:
        element.add_rows(here)
    for row, slope in here.directions:
        here.pull(row, slope.force(along(row, here.rates), along(row, here.shifts)))
        rows.append(elastic_row(row, slope.whole))
    here.rows = rows + here.rows
    return here


def derive_stage(d: Derivation, *, by_leaders: bool = False) -> dict[str, Program]:
    """Derive both programs of a stage, by their names: what a step computes once, and what each stage does with it."""
    return _parts(run_passes(finish(d.graph, "stage", stage(d, by_leaders=by_leaders))), STAGES, ARRAYS)


def derive_pair_stage(d: Derivation, *, by_leaders: bool = False) -> dict[str, Program]:
    """Derive the stage with a complex c, for complex rates and shifts, imaginary parts behind real ones."""
    whole = finish(d.graph, "stage", stage(d, _PairStage, by_leaders=by_leaders))
    times, rates, shifts, _ = PAIR_ARRAYS
    lengths = {times: 2, rates: len(d.rates), shifts: len(d.active)}
    pairs = on_pairs(whole, lengths, dropped=("pivot",), results=("out",))
    return _parts(run_passes(pairs), PAIR_STAGES, PAIR_ARRAYS)


def _parts(whole: Program, names: Sequence[str], arrays: Sequence[str]) -> dict[str, Program]:
    """Take a program apart by what depends on rates and shifts."""
    pair = cut(whole, arrays[1:3], (PARAMETERS,), arrays[3])
    return {name: replace(program, name=name) for name, program in zip(names, pair, strict=True)}
