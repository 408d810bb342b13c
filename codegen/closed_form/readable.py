"""Closed-form equations of a small robot for a reader: eqs. (10)-(16), simplified, as text or LaTeX.

The terms are those of ``trace``.  Of a robot with loops and couplings the tree's equations have J^T lambda on their
right, and g(q) = 0 and its Jacobian J come with them.  Coordinates have the paper's letters with the joint's number
(x_1, gamma_1), numbers of the description those of ``SYMBOLS`` with the name of their link or joint.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import sympy as sp
from sympy.simplify.fu import TR10i

from eomgen.errors import InputError
from eomgen.identifiers import parameter_path
from eomgen.names import parameter_name, split_component
from eomgen.robot.coordinates import MODE, force_unit_of, unit_of
from eomgen.robot.elements import MATRICES
from eomgen.robot.elements.joint_damping import MOVED
from eomgen.robot.laws import LAWS
from eomgen.robot.model import Model
from eomgen.robot.parameter_names import number_of
from eomgen.robot.value import ANGULAR, COORDINATES, MOTOR, LinkModes
from eomgen.robot.value.modes import coupling_name

from ..kernels.constraint_rows import Rank, rank_at_home
from ..kernels.interface import drive_inputs
from . import bending
from .bending import exact
from .trace import ClosedForm, bends, closed_form, refuse_springs

Expr = Any  # sympy.Expr

MOST_COORDINATES = 6
MOST_OPERATIONS = 20_000  # of M and C as derived; simplifying more takes minutes, and nobody reads it
COMBINED = 500  # operations up to which products of sines and cosines are looked at for sums of angles
ROUND_OFF = 1e-14

SYMBOLS = {  # what a parameter's name ends with: letter, unit
    "mass": ("m", "kg"),
    "com": ("c", "m"),
    "inertia": ("I", "kg m^2"),
    "stiffness": ("a", "N/m"),
    "damping": ("b", "N s/m"),
    "armature": ("J", "kg"),
    "ratio": ("N", "1"),
    "xyz": ("p", "m"),
    "rpy": ("r", "rad"),
    "gravity": ("g", "m/s^2"),
}
ANGULAR_UNITS = {"stiffness": "N m/rad", "damping": "N m s/rad", "armature": "kg m^2"}
LINEAR_RATIO = "1/m"  # of a gear in front of a prismatic joint
DROPS_OUT = "in every state: nothing moves the loop along it, and it drops out"


@dataclass(frozen=True)
class Letter:
    """A symbol of a formula: its LaTeX, what it stands for, and the value (None for coordinates) and unit."""

    symbol: Expr
    latex: str
    meaning: str
    value: float | None
    unit: str

    @property
    def said(self) -> str:
        """Say what it stands for, its value and its unit."""
        return f"{self.meaning}: {'' if self.value is None else f'{self.value!r} '}{self.unit}"


@dataclass(frozen=True)
class Component:
    """A component of g(q) = 0, simplified: its name, multiplier, value, derivatives but zeros by index."""

    name: str
    multiplier: Expr
    value: Expr
    jacobian_row: Mapping[int, Expr]


@dataclass(frozen=True)
class ReadableClosedForm:
    """Simplified M, C and Q of a robot with their symbols; ``lines`` is text, ``latex`` a LaTeX fragment.

    mass_matrix: {(s, v): entry}, s <= v; christoffel: {(s, v, w): entry}, v <= w; by index, zeros left out.
    force: Q_P + Q_G of every coordinate, the drive where there is one, and J^T lambda of what closes the robot.
    constraint: of loops and rigid couplings.  rank: of it at the description's home, if that closes.
    rates: of internal states, in the order of ``form.z``.
    """

    model: Model
    letters: tuple[Letter, ...]
    form: ClosedForm
    mass_matrix: Mapping[tuple[int, int], Expr]
    christoffel: Mapping[tuple[int, int, int], Expr]
    force: tuple[Expr, ...]
    constraint: tuple[Component, ...] = ()
    rank: Rank | None = None
    rates: tuple[Expr, ...] = ()

    @property
    def left(self) -> tuple[Expr, ...]:
        """Left sides of eq. (10): M a + the terms of C."""
        form, sides = self.form, []
        for s in range(len(form.q)):
            terms = [self.mass_matrix.get((min(s, v), max(s, v)), 0) * a for v, a in enumerate(form.a)]
            for (i, v, w), entry in self.christoffel.items():
                if i == s:
                    terms.append((1 if v == w else 2) * entry * form.v[v] * form.v[w])
            sides.append(sp.Add(*terms))
        return tuple(sides)

    def lines(self) -> list[str]:
        """Write text: symbols, coefficients, equations."""
        lines = [f"{self.model.name}: closed form of the equations of motion", "", "symbols"]
        lines += [f"  {letter.symbol} = {letter.said}" for letter in self.letters]
        q = [str(symbol) for symbol in self.form.q]
        lines += ["", "coefficients of eqs. (11) and (12), M symmetric, C symmetric in the last two; others are zero"]
        lines += [f"  M[{q[s]}, {q[v]}] = {entry}" for (s, v), entry in self.mass_matrix.items()]
        lines += [f"  C[{q[s]}; {q[v]}, {q[w]}] = {entry}" for (s, v, w), entry in self.christoffel.items()]
        if self.constraint:
            lines += ["", "constraint g(q) = 0 of loops and couplings, and its derivatives J; others are zero"]
            lines += [f"  g[{component.name}] = {self._said(component)}" for component in self.constraint]
            lines += [
                f"  J[{component.name}, {q[i]}] = {arm}"
                for component in self.constraint
                for i, arm in component.jacobian_row.items()
            ]
            lines += [f"  {note}" for note in self._rank_notes()]
        lines += ["", "equations of motion, eq. (10)"]
        lines += [f"  {left} = {right}" for left, right in zip(self.left, self.force, strict=True)]
        if self.rates:
            lines += ["", "rates of internal states"]
            lines += [f"  d/dt {z} = {rate}" for z, rate in zip(self.form.z, self.rates, strict=True)]
        return lines

    def latex(self) -> str:
        """Write LaTeX for amsmath: the symbols as comments, then align* environments as of ``equations``."""
        text = [f"% {self.model.name}: closed form of the equations of motion, eqs. (10)-(12)"]
        text += [f"% ${letter.latex}$ = {letter.said}" for letter in self.letters]
        text += [f"% {note}" for note in self.notes()]
        for block in self.equations():
            rows = (f"{left} &= {right}" for left, right in block)
            text += ["\\begin{align*}", " \\\\\n".join(rows), "\\end{align*}"]
        return "\n".join(text)

    def equations(self, **printing: Any) -> list[list[tuple[str, str]]]:
        """Return sides of all equations in LaTeX: coefficients, any constraint, motion, internal states.

        Args:
            **printing: further settings of SymPy's printer.
        """
        names = {letter.symbol: letter.latex for letter in self.letters}
        names |= {symbol: _latex_of(str(symbol)) for row in (self.form.v, self.form.a, self.form.u) for symbol in row}

        def show(expression: Expr) -> str:
            return str(sp.latex(expression, symbol_names=names, **printing))

        rows = [(f"M_{{{self._place(key)}}}", show(entry)) for key, entry in self.mass_matrix.items()]
        rows += [(f"C_{{{self._place(key)}}}", show(entry)) for key, entry in self.christoffel.items()]
        sides = [(show(left), show(right)) for left, right in zip(self.left, self.force, strict=True)]
        closing = [
            (f"g_{{{_owner(component.name)}}}", f"{show(component.value)} = 0")
            for component in self.constraint
            if component.jacobian_row
        ]
        for component in self.constraint:
            for i, arm in component.jacobian_row.items():
                slope = f"\\frac{{\\partial g_{{{_owner(component.name)}}}}}{{\\partial {names[self.form.q[i]]}}}"
                closing.append((slope, show(arm)))
        changing = [(f"\\dot{{{names[z]}}}", show(rate)) for z, rate in zip(self.form.z, self.rates, strict=True)]
        return [block for block in (rows, closing, sides, changing) if block or block is rows]

    def notes(self) -> list[str]:
        """Return lines about components of g that nothing moves, and about what is redundant at home."""
        still = [
            f"g of {component.name} = {component.value} {DROPS_OUT}"
            for component in self.constraint
            if not component.jacobian_row
        ]
        return still + self._rank_notes()

    def _said(self, component: Component) -> str:
        """Print a component's value, and that it drops out if nothing moves it."""
        return str(component.value) if component.jacobian_row else f"{component.value} {DROPS_OUT}"

    def _rank_notes(self) -> list[str]:
        """Return lines about what is redundant at home."""
        if self.rank is None:
            return []
        freedoms = f"at home: {self.rank.freedoms} degrees of freedom"
        return [f"{freedoms}; redundant there: {', '.join(self.rank.redundant) or 'none'}"]

    def _motor_place(self, index: int) -> int:
        joint = split_component(self.model.coordinates[index])[0]
        return next((k for k, body in enumerate(self.model.bodies) if body.joint == joint), 0)

    def _place(self, key: Sequence[int]) -> str:
        """Write sub- and superscript of eq. (11) or (12): joints, then coordinates; one joint is named once."""
        names, joints = [], []
        for i in key:
            name = split_component(self.model.coordinates[i])[1]
            places = (k for k, body in enumerate(self.model.bodies) if i in body.indices or i in body.modes)
            joints.append(str(1 + next(places, self._motor_place(i))))
            names.append(_greek(name))
        below = joints[0] if len(self.model.bodies) == 1 else ",".join(joints)
        return f"{below}}}^{{{' '.join(names)}"


def readable_closed_form(model: Model, *, numbers: bool = False) -> ReadableClosedForm:
    """Derive and simplify the closed form.

    Args:
        numbers: keep the description's numbers instead of symbols.

    Raises:
        InputError: too many coordinates or operations to be simplified and read, or what ``closed_form`` refuses.
    """
    model = model if bends(model) else model.tree
    n = len(model.coordinates)
    if n > MOST_COORDINATES:
        raise InputError(
            f"{model.name} has {n} coordinates; a closed form is derived for at most {MOST_COORDINATES},"
            " larger robots are what `eomgen generate` is for"
        )
    refuse_springs(model)
    letters = {} if numbers else dict(_parameters(model))
    form = closed_form(model, {name: letter.symbol for name, letter in letters.items()})
    entries = [form.mass_matrix[s, v] for s in range(n) for v in range(s, n)]
    entries += [form.christoffel[s][v][w] for s in range(n) for v in range(n) for w in range(v, n)]
    entries += [*form.constraint.values, *(arm for row in form.constraint.jacobian for arm in row.values())]
    operations = int(sum(sp.count_ops(entry) for entry in entries))
    if operations > MOST_OPERATIONS:
        advice = "lock coordinates" if numbers else "keep the numbers (--numbers), or lock coordinates"
        raise InputError(
            f"{model.name}: its closed form has {operations} operations; at most {MOST_OPERATIONS} are simplified and"
            f" printed: {advice}"
        )
    mass = {(s, v): simplified(form.mass_matrix[s, v]) for s in range(n) for v in range(s, n)}
    keys = [(s, v, w) for s in range(n) for v in range(n) for w in range(v, n)]
    christoffel = {key: simplified(form.christoffel[key[0]][key[1]][key[2]]) for key in keys}
    constraint = tuple(_components(form))
    rank = rank_at_home(model) if constraint else None
    driven, drives = _driven(model) - set(model.drives), zip(form.generalized_force, form.u, strict=True)
    force = tuple(
        simplified(Q)
        + (u if i in driven else 0)
        + sum(component.jacobian_row.get(i, 0) * component.multiplier for component in constraint)
        for i, (Q, u) in enumerate(drives)
    )
    mass = {key: entry for key, entry in mass.items() if entry != 0}
    christoffel = {key: entry for key, entry in christoffel.items() if entry != 0}
    rates = tuple(map(simplified, form.rates))
    shown = (*mass.values(), *christoffel.values(), *force, *rates, *(component.value for component in constraint))
    used = set().union(*(expr.free_symbols for expr in shown))
    named = [letter for letter in letters.values() if letter.symbol in used]
    named += [letter for letter in _multipliers(model, constraint) if letter.symbol in used]
    symbols = (*_coordinates(model, form), *_states(model, form), *_inputs(model, form), *named)
    return ReadableClosedForm(model, symbols, form, mass, christoffel, force, constraint, rank, rates)


def _components(form: ClosedForm) -> Iterator[Component]:
    """Yield the components of the constraint, simplified."""
    g = form.constraint
    for r, (name, value, row) in enumerate(zip(g.names, g.values, g.jacobian, strict=True)):
        jacobian_row = {i: simplified(exact(arm)) for i, arm in sorted(row.items())}
        left = {i: arm for i, arm in jacobian_row.items() if arm != 0}
        yield Component(name, sp.Symbol(f"lambda_{r + 1}", real=True), simplified(exact(value)), left)


def _multipliers(model: Model, constraint: Sequence[Component]) -> Iterator[Letter]:
    """Yield the components' multipliers: forces and moments of cut joints; a coupling's as of its follower."""
    following = {coupling.name: coupling.of for coupling in model.robot.couplings}
    for component in constraint:
        unit = force_unit_of(following.get(component.name, component.name))
        number = str(component.multiplier).removeprefix("lambda_")
        yield Letter(component.multiplier, f"\\lambda_{{{number}}}", f"multiplier of {component.name}", None, unit)


def simplified(expression: Expr) -> Expr:
    """Return an equal expression, a polynomial in sines and cosines without sin^2 + cos^2, with few operations."""
    expanded = sp.expand(expression)
    forms = [sp.factor_terms(_without_round_off(_without_squares(expanded, kept))) for kept in (sp.sin, sp.cos)]
    forms += [sp.factor_terms(TR10i(e)) for e in forms if sp.count_ops(e) <= COMBINED]
    return min(forms, key=lambda e: int(sp.count_ops(e)))


def _without_squares(expanded: Expr, kept: Any) -> Expr:
    """Replace even powers of the other function than ``kept`` by 1 - kept^2: zero comes out as zero."""
    other = sp.cos if kept is sp.sin else sp.sin

    def reduce(base: Expr, power: Expr) -> Expr:
        square = 1 - kept(base.args[0]) ** 2
        return square ** (power // 2) * base ** (power % 2)

    return sp.expand(
        expanded.replace(
            lambda e: e.is_Pow and isinstance(e.base, other) and e.exp.is_Integer and e.exp > 1,
            lambda e: reduce(e.base, e.exp),
        )
    )


def _without_round_off(expanded: Expr) -> Expr:
    """Drop terms of a sum whose decimal coefficient is round-off of the others: cosines of right angles, say."""
    terms = [term.as_coeff_Mul() for term in sp.Add.make_args(expanded)]
    limit = ROUND_OFF * max(abs(factor) for factor, _ in terms)
    kept = [factor * rest for factor, rest in terms if abs(factor) > limit or not factor.is_Float]
    return sp.Add(*kept)


def _driven(model: Model) -> set[int]:
    """Return indices of coordinates with a drive: principal ones, and all of a free joint; driven ones of loops."""
    if model.robot.is_closed:
        return set(model.driven)
    free = [i for body in model.bodies if model.robot.joint(body.joint).is_free for i in body.indices]
    return {*model.principal, *free, *model.motors}.difference(model.motors.values())


def _coordinates(model: Model, form: ClosedForm) -> Iterator[Letter]:
    for symbol, name in zip(form.q, model.coordinates, strict=True):
        yield Letter(symbol, _latex_of(str(symbol)), name, None, unit_of(name))


def _inputs(model: Model, form: ClosedForm) -> Iterator[Letter]:
    """Yield a letter for every input of a drive with states: what it means there."""
    for name, (meaning, unit, _) in drive_inputs(model).items():
        symbol = form.u[model.coordinates.index(name)]
        yield Letter(symbol, _latex_of(str(symbol)), f"{meaning} of {name}", None, unit)


def _states(model: Model, form: ClosedForm) -> Iterator[Letter]:
    """Yield a letter for every internal state: z with the coordinate above and the joint's number below."""
    joints = {body.joint for body in model.bodies}
    for symbol, state in zip(form.z, model.states, strict=True):
        if split_component(state.owner)[0] in joints:
            letter, coordinate, number = str(symbol).rsplit("_", 2)
            latex = f"{_upright(letter)}_{{{number}}}^{{{_greek(coordinate)}}}"
        else:
            latex = f"{_upright(state.state.name)}_{{{_upright(state.owner)}}}"
        yield Letter(symbol, latex, state.name, None, state.unit)


def _upright(name: str) -> str:
    """Write a name: one letter as it is, a word upright."""
    return name if len(name) == 1 else f"\\mathrm{{{name}}}".replace("_", "\\_")


def _parameters(model: Model) -> Iterator[tuple[str, Letter]]:
    """Yield a symbol for every number of the description that is not zero, by its parameter name.

    Numbers of forces beyond linear springs and dampers stay numbers, and so do those of couplings.
    """
    turning = {joint.name for joint in model.robot.joints if joint.principal in ANGULAR}
    yield from _modal_numbers(model)
    for name, value in model.robot.numbers():
        if value is None or value == 0.0:
            continue
        parts = parameter_path(name)
        if parts[0] == "links" and parts[2] == "modes":
            yield name, _of_mode(parts[1], parts[3], parts[4], value)
            continue
        kind = next((word for word in parts if word in SYMBOLS), "")
        if not kind or parts[0] == "couplings" or (parts[3:4] and parts[3] in LAWS):
            continue
        of_motor = parts[0] == "joints" and parts[2] == MOTOR
        letter, unit = SYMBOLS["armature" if of_motor and kind == "inertia" else kind]
        owner = parts[1] if parts[0] != "gravity" else ""
        detail = parts[2] if of_motor or kind in ANGULAR_UNITS else parts[-1] if kind != "mass" else ""
        if parts[0] == "loops" and kind in ("xyz", "rpy"):
            owner = f"{owner}_{'ab'[int(parts[3])]}"  # the cut frame on its first or second link
        if kind in ("xyz", "rpy"):
            detail = "xyz"[int(detail)]
        words: Sequence[str] = (detail,)
        if parts[0] in ("joints", "loops") and parts[2] in MATRICES:
            number, words = number_of(name), parts[3:]
            if number is None or not _is_linear(words):
                continue
            detail, unit = "_".join(words), number.unit[0]
        elif of_motor:
            unit = _motor_unit(kind, owner in turning)
        elif detail in ANGULAR:
            unit = ANGULAR_UNITS[kind]
        symbol = sp.Symbol("_".join(word for word in (letter, detail, owner) if word), real=True)
        below = ",".join(word for word in (" ".join(map(_greek, words)), owner.replace("_", "\\_")) if word)
        yield name, Letter(symbol, f"{letter}_{{{below}}}", name, value, unit)


def _of_mode(link: str, mode: str, kind: str, value: float) -> Letter:
    """Return the letter of a mode's stiffness or damping."""
    letter, unit = {"stiffness": ("a", "J"), "damping": ("b", "J s")}[kind]
    symbol = sp.Symbol(f"{letter}_e{mode}_{link}", real=True)
    return Letter(
        symbol, f"{letter}_{{e{mode},{_upright_owner(link)}}}", f"links.{link}.modes.{mode}.{kind}", value, unit
    )


def _modal_numbers(model: Model) -> Iterator[tuple[str, Letter]]:
    """Yield symbols for integrals over links that bend, N, n, P, Q and q, and what couples modes, by their names."""
    for body in model.bodies:
        modes = model.robot.link(body.name).modes
        for name, value in bending.numbers(body.name, modes).items() if modes is not None else ():
            if value == 0.0:
                continue
            letter, *places = name.split(".")[3:]
            which = "".join(x for x in places if x.isdigit())
            axes = "".join(x for x in places if not x.isdigit())
            unit = "kg m" if letter in "nq" else "kg m^2"
            symbol = sp.Symbol(f"{letter}{which}_{axes}_{body.name}", real=True)
            below = f"{which},{axes},{_upright_owner(body.name)}"
            yield name, Letter(symbol, f"{letter}_{{{below}}}", name, value, unit)
        if modes is not None:
            yield from _modal_couplings(body.name, modes)


def _modal_couplings(link: str, modes: LinkModes) -> Iterator[tuple[str, Letter]]:
    """Yield symbols for what K and D have beside the diagonal, by their names."""
    for key, unit in (("K", "J"), ("D", "J s")):
        for (k, j), value in modes.couplings(key).items():
            name, which = coupling_name(link, key, k, j), f"{k + 1}{j + 1}"
            symbol = sp.Symbol(f"{key}{which}_{link}", real=True)
            yield name, Letter(symbol, f"{key}_{{{which},{_upright_owner(link)}}}", name, value, unit)


def _upright_owner(name: str) -> str:
    return name.replace("_", "\\_")


def _is_linear(key: Sequence[str]) -> bool:
    """Whether a number of a joint's stiffness or damping as a whole is a slope: isotropic, or an entry of a matrix."""
    return set(key) <= set(COORDINATES) or parameter_name(*key) in MOVED


def _motor_unit(kind: str, turning: bool) -> str:
    """Return the unit of a number of a motor and its transmission, whose spring has the units of its joint."""
    if kind == "inertia":
        return ANGULAR_UNITS["armature"]
    if kind == "ratio":
        return SYMBOLS[kind][1] if turning else LINEAR_RATIO
    return ANGULAR_UNITS[kind] if turning else SYMBOLS[kind][1]


def _owner(component: str) -> str:
    """Write the subscript of a component of the constraint: its loop and direction, or its coupling."""
    loop, _, direction = component.rpartition(".")
    return ",".join(name for name in (loop.replace("_", "\\_"), _greek(direction).replace("_", "\\_")) if name)


def _greek(name: str) -> str:
    if name == MOTOR or name in MOVED:
        return f"\\mathrm{{{name}}}"
    if name.startswith(MODE):
        return f"e_{{{name.removeprefix(MODE)}}}"
    return f"\\{name}" if name in ANGULAR else name


def _latex_of(symbol: str) -> str:
    """Write LaTeX of a coordinate, rate, acceleration or drive as ``trace`` names it."""
    drive = symbol.startswith("D_")
    name, _, number = symbol.removeprefix("D_").rpartition("_")
    kind = name.removesuffix("dot").removesuffix("d")
    if kind[:1] == "e" and kind[1:].isdigit():  # a mode: e with the joint's number and its own
        name, number = name.replace(kind, "e"), f"{number},{kind[1:]}"
    if drive:
        return f"D_{{{number}}}^{{{_greek(name)}}}"
    for end, accent in (("ddot", "\\ddot"), ("dot", "\\dot")):
        if name.endswith(end):
            return f"{accent}{{{_greek(name.removesuffix(end))}}}_{{{number}}}"
    return f"{_greek(name)}_{{{number}}}"
