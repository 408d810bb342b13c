"""Laws that every family of forces obeys, by itself and beside all others."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from eomgen.codegen.forces.coordinates import CoordinateLaws, ModalCouplings
from eomgen.codegen.forces.element import ForceElement, ImplicitShare, Slopes, StateSite, StateSlopes, add_to
from eomgen.codegen.forces.elements import ELEMENTS
from eomgen.codegen.forces.joint_damping import JointDampers
from eomgen.codegen.forces.laws import Effect
from eomgen.codegen.kernels.accelerations import implicit_step
from eomgen.codegen.kernels.derivation import Derivation, Outputs, vector
from eomgen.codegen.program.ir import Program, evaluate, finish
from eomgen.codegen.solve.states import share
from eomgen.description.load import robot_from_toml
from eomgen.robot.model import build_model
from eomgen.robot.parameter_names import element_places
from eomgen.state.elements import damping_diagonal, damping_forces, joint_damping, joint_stiffness
from eomgen.state.journals import cut_contacts, journal_contacts
from tests.support.builds import Build
from tests.support.every_element import ROBOTS, drawn, robot_of, robot_with
from tests.support.random_robots import seeds

Array = NDArray[np.float64]
STEP = 1e-6
CASES = [*(((CoordinateLaws,) if x is ModalCouplings else ()) + (x,) for x in ELEMENTS), tuple(ELEMENTS)]
EVERY = pytest.mark.parametrize(
    "families", CASES, ids=["all" if len(x) > 2 else x[-1].__name__ for x in CASES]
)  # alone, and beside all others; what couples modes beside their diagonals, as it is not definite alone


class Forces:
    """Forces of families in a robot, as functions of q, v and the parameters; internal states stand behind v."""

    def __init__(self, families: Sequence[type[ForceElement]], seed: int) -> None:
        self.model, self.p = drawn(robot_of(*families), seed)
        rng = np.random.default_rng([seed, 1])
        self.n, self.first = self.model.size, len(self.model.coordinates)
        self.q, self.v = self.drawn(rng, 0.3)
        self.d = Derivation(self.model)
        self.elements = [self.d.elements[ELEMENTS.index(family)] for family in families]
        self.finished: dict[int, tuple[Outputs, Program]] = {}

    def drawn(self, rng: np.random.Generator, span: float) -> tuple[Array, Array]:
        """Positions within a span, and velocities with internal states."""
        return rng.uniform(-span, span, self.n)[: self.first], rng.uniform(-1.0, 1.0, self.n)

    def inputs(self, **given: Array) -> dict[str, list[float]]:
        """What programs read; v with internal states."""
        still = {"u": np.zeros(self.first), "forces": np.zeros(len(self.model.drives)), "added": np.zeros(self.first)}
        arrays = {"q": self.q, "v": self.v, "p": self.p} | still | given
        arrays["v"], arrays["z"] = np.split(arrays["v"], [self.first])
        return {name: list(x) for name, x in arrays.items()}

    def program(self, outputs: Outputs) -> Program:
        """The program of outputs, finished once."""
        if id(outputs) not in self.finished:
            self.finished[id(outputs)] = outputs, finish(self.d.graph, "law", outputs)
        return self.finished[id(outputs)][1]

    def run(self, outputs: Outputs, **given: Array) -> Array:
        found = evaluate(self.program(outputs), self.inputs(**given))
        return np.array([found["out", i] for i in range(len(outputs))], dtype=float)

    def resisting(self, **given: Array) -> Array:
        """What resists without inputs of drives."""
        return self.run(self.rows(passive=True), **given)

    def rows(self, *, passive: bool = False) -> Outputs:
        rows = [0.0] * self.n
        for element in self.elements:
            for i, force in element.passive(self.d.v) if passive else element.resist(self.d.v):
                rows[i] = rows[i] + force
        return vector(rows)

    def differences(self, name: str, x: Array, outputs: Outputs) -> Array:
        """Derivatives of outputs by an input, (outputs, inputs)."""
        columns = []
        for i in range(len(x)):
            step = STEP * np.eye(len(x))[i]
            ahead, behind = self.run(outputs, **{name: x + step}), self.run(outputs, **{name: x - step})
            columns.append((ahead - behind) / (2.0 * STEP))
        return np.array(columns).T


def test_every_element_has_a_robot() -> None:
    assert ROBOTS.keys() == set(ELEMENTS)
    assert len(set(ELEMENTS)) == len(ELEMENTS)


@EVERY
@pytest.mark.parametrize("seed", seeds(1, 1, 6))
def test_slopes_are_those_of_forces(families: Sequence[type[ForceElement]], seed: int) -> None:
    forces = Forces(families, seed)
    d, n = forces.d, forces.n
    laws = d.bound.laws if CoordinateLaws in families else ()  # straight lines are in the residual's derivatives
    by_q = {(i, i): law.stiffness for i, law in enumerate(laws)}
    by_v = {(i, i): law.damping for i, law in enumerate(laws)}
    slopes = Slopes(d.graph, by_q, by_v, d.q, d.v, list)
    for element in forces.elements:
        element.add_slopes(slopes)
    for name, x, rows in (("q", forces.q, by_q), ("v", forces.v, by_v)):
        found = forces.run(vector([rows.get((i, j), 0.0) for i in range(n) for j in range(n)])).reshape(n, n)
        expected = np.zeros((n, n))  # positions of internal states there are none
        expected[:, : len(x)] = forces.differences(name, x, forces.rows())
        assert np.abs(expected).max() > 0.0 or (name == "q" and not np.any(found))
        assert np.abs(found - expected).max() <= 1e-6 * max(1.0, np.abs(expected).max())


@EVERY
@pytest.mark.parametrize("seed", seeds(1, 1, 6))
def test_energys_gradient_is_the_force_at_rest(families: Sequence[type[ForceElement]], seed: int) -> None:
    forces = Forces(families, seed)
    total = 0.0
    for element in forces.elements:
        for energy in element.energies():
            total = total + energy
    found = np.zeros(forces.n)
    found[: forces.first] = forces.differences("q", forces.q, vector([total]))[0]
    expected = forces.resisting(v=np.zeros(forces.n))
    assert np.abs(found - expected).max() <= 1e-6 * max(1.0, np.abs(expected).max())


@EVERY
@pytest.mark.parametrize("seed", seeds(1, 1, 6))
def test_a_force_takes_energy_from_motions(families: Sequence[type[ForceElement]], seed: int) -> None:
    """What is not stored is lost: (r(q, v) - r(q, 0)) v is never negative, but where contacts let go."""
    forces = Forces(families, seed)
    power = (forces.resisting() - forces.resisting(v=np.zeros(forces.n))) @ forces.v
    assert power >= -1e-9


@EVERY
@pytest.mark.parametrize("seed", seeds(1, 1, 6))
def test_every_number_is_a_parameter(families: Sequence[type[ForceElement]], seed: int) -> None:
    """A force of the family, or its share in the inertia, changes with each of its numbers somewhere."""
    forces = Forces(families, seed)
    places, names = element_places(forces.model.robot, forces.model.parameters), list(forces.model.parameters)
    rows, rng = forces.rows(), np.random.default_rng([seed, 2])
    states = [forces.drawn(rng, 0.4) for _ in range(20)]
    before = [forces.run(rows, q=q, v=v) for q, v in states]
    for owner, numbers in ((x, y) for family in places.values() for x, y in family.items()):
        for key, place in numbers.items():
            other = forces.p.copy()
            other[place] = other[place] * 1.1 + 0.01
            changed = (forces.run(rows, q=q, v=v, p=other) for q, v in states)  # as far as it is needed
            moved = any(np.any(x != y) for x, y in zip(before, changed, strict=True))
            assert moved or key in ("armature", "inertia") or not acts(forces, owner, key), names[place]


def acts(forces: Forces, owner: str, key: str) -> bool:
    """Whether a number belongs to the families that are looked at: others have dampers of their own beside them."""
    places = element_places(forces.model.robot, forces.model.parameters)
    family = next(x for x, owners in places.items() if owner in owners)
    assert sum(x.has(family, owner) for x in ELEMENTS) == 1
    return any(element.has(family, owner) for element in forces.elements)


@EVERY
@pytest.mark.parametrize("seed", seeds(1, 1, 6))
def test_reactions_balance(families: Sequence[type[ForceElement]], seed: int) -> None:
    """What joints hold of forces between links has the rows of these forces along the joints' axes."""
    forces = Forces(families, seed)
    held: Mapping[int, list[object]] = {k: [0.0] * 3 for k in range(len(forces.model.bodies))}
    rows: list[object] = [0.0] * forces.n
    for element in forces.elements:
        wrenches = list(element.wrenches(forces.d.v))
        for k, wrench in wrenches:
            held[k][:] = [x + y for x, y in zip(held[k], wrench.moment, strict=True)]
        for i, force in element.resist(forces.d.v) if wrenches else ():
            rows[i] = rows[i] + force
    found = [k for k, body in enumerate(forces.model.bodies) if body.active == ("gamma",) and is_plain(forces, k)]
    given = forces.run(vector([held[k][2] for k in found]))
    expected = forces.run(vector([rows[forces.model.bodies[k].first] for k in found]))
    assert np.abs(given - expected).max(initial=0.0) <= 1e-9 * max(1.0, np.abs(expected).max(initial=0.0))


def is_plain(forces: Forces, k: int) -> bool:
    """Whether no coupling, whose force passes through drives and not through links, acts on a body's joint."""
    joint = forces.model.bodies[k].joint
    return not any(x.split(".")[0] == joint for c in forces.model.robot.couplings for x in (c.of, *c.to))


def stepped(
    forces: Forces, dt: float, prescribed: Mapping[int, float] = MappingProxyType({})
) -> tuple[Array, Array, Array]:
    """Accelerations of an implicit step, M and M a + bias at a = 0, of a robot without drives."""
    d, n = Derivation(forces.model), forces.n
    program = finish(d.graph, "step", implicit_step(d))
    rows = Derivation(forces.model)
    bias = finish(rows.graph, "bias", rows.motion(rows.dynamics_with_drives(rows.v, rows.still)))
    M = Derivation(forces.model)
    upper = finish(M.graph, "M", M.matrices(M.matrix(), states=True))
    inputs = forces.inputs(u=np.array([prescribed.get(i, 0.0) for i in range(forces.first)]))

    def numbers(found: Mapping[tuple[str, int], float], count: int) -> Array:
        return np.array([found["out", i] for i in range(count)])

    half = numbers(evaluate(upper, inputs), n * n).reshape(n, n)
    step = numbers(evaluate(program, inputs | {"dt": [dt, dt * dt]}), n)
    return step, half + np.triu(half, 1).T, numbers(evaluate(bias, inputs), n)


@EVERY
@pytest.mark.parametrize("seed", seeds(1, 1, 6))
def test_an_implicit_step_is_its_linear_system(families: Sequence[type[ForceElement]], seed: int) -> None:
    """Of a step dt that tends to 0 what is left is the acceleration under the forces of its beginning.

    With dt = h its change is h times that by M^-1 (D v + ...): two steps tell whether slopes take part.
    """
    forces = Forces(families, seed)
    found, with_slopes, mass, bias = (*stepped(forces, 1e-9)[:1], *stepped(forces, 1e-3))
    explicit = np.linalg.solve(mass, -bias)
    assert np.abs(found - explicit).max() <= 1e-4 * max(1.0, np.abs(explicit).max())
    assert np.abs(with_slopes - explicit).max() > 1e-6


class Dense(ImplicitShare):
    """Shares of elements in a dense matrix, c D + c^2 K with c = dt, and in a vector of forces."""

    def __init__(self, d: Derivation) -> None:
        self.d, self.dt, self.square = d, d.graph.input("dt", 0), d.graph.input("dt", 1)
        super().__init__([q + self.dt * v for q, v in zip(d.q, d.v, strict=True)], d.v, self.dt, d.drive_inputs)
        self.forces: list[Any] = [0.0] * d.model.size
        self.matrix: dict[tuple[int, int], Any] = {}

    def push(self, i: int, force: Any) -> None:
        self.forces[i] = self.forces[i] + force

    def rank_one(self, arms: Mapping[int, Any], slope: Any) -> None:
        for i, one in arms.items():
            for j, other in arms.items():
                add_to(self.matrix, (i, j), slope * (one * other))

    def on_coordinate(self, i: int, stiffness: Any, damping: Any) -> None:
        self.rank_one({i: 1.0}, self.dt * damping + self.square * stiffness)

    def bend(self, i: int, law: Effect) -> None:
        self.rank_one({i: 1.0}, law.ahead(self.dt, self.square, self.d.functions))

    def in_internal_states(self, site: StateSite, law: StateSlopes) -> None:
        row, states = site.row, site.states
        acts = self.d.functions.step(share(law, self.dt, self.square))
        self.rank_one(row, acts * (self.dt * law.f_v + self.square * law.f_s))
        for k, w, f_z, g_v, g_s in zip(states, law.inertias, law.f_z, law.g_v, law.g_s, strict=True):
            for i, arm in row.items():
                add_to(self.matrix, (i, k), acts * (self.dt * f_z * arm))
                add_to(self.matrix, (k, i), -1.0 * (w * (self.dt * g_v + self.square * g_s)) * arm)
        for (row, column), slope in law.g_z.items():
            add_to(self.matrix, (states[row], states[column]), -1.0 * (self.dt * (law.inertias[row] * slope)))

    def in_joint(self, slopes: Callable[[Any, Any], Mapping[tuple[int, int], Any]]) -> None:
        for (i, j), slope in slopes(self.dt, self.square).items():
            for key in {(i, j), (j, i)}:
                add_to(self.matrix, key, slope)

    def in_transmission(self, motor: int, linear: Effect, law: Effect) -> None:
        between = self.d.bound.transmissions[motor]
        slope = self.dt * linear.by_v + self.square * linear.by_s + law.ahead(self.dt, self.square, self.d.functions)
        self.rank_one({motor: between.inverse_ratio, between.principal: -1.0}, slope)

    def along(self, arms: Mapping[int, Any], law: Effect, *, turns: bool = False) -> None:
        self.along_all(
            {i: law.force * arm for i, arm in arms.items()}, lambda *c: [(arms, law.ahead(*c, self.d.functions))]
        )

    def along_all(self, rows: Mapping[int, Any], directions: Callable[[Any, Any], Sequence[Any]]) -> None:
        for i, force in rows.items():
            self.push(i, force)
        for arms, slope in directions(self.dt, self.square):
            self.rank_one(arms, slope)

    def among(
        self,
        rows: Mapping[int, Any],
        members: Sequence[Mapping[int, Any]],
        slopes: Callable[..., Any],
        *,
        turns: bool = False,
    ) -> None:
        self.along_all(rows, lambda *c: [])
        for (one, other), slope in slopes(self.dt, self.square).items():
            for i, arm in members[one].items():
                for j, other_arm in members[other].items():
                    for key in [(i, j)] if one == other else [(i, j), (j, i)]:
                        add_to(self.matrix, key, slope * (arm * other_arm))


@EVERY
@pytest.mark.parametrize("seed", seeds(1, 2, 6))
def test_an_implicit_step_is_a_dense_system(families: Sequence[type[ForceElement]], seed: int) -> None:
    """(M + dt D + dt^2 K) a = -inertial terms - forces, assembled as a dense matrix and solved by NumPy."""
    forces, dt = Forces(families, seed), 0.05
    found, mass, bias = stepped(forces, dt)
    share, n = Dense(forces.d), forces.n
    for element in forces.d.elements:
        for add in (element.advance, element.add_diagonal, element.add_blocks, element.add_rows):
            add(share)
    entries = [share.matrix.get((i, j), 0.0) for i in range(n) for j in range(n)]
    numbers = forces.run(vector([*entries, *share.forces, *forces.d.forces(forces.d.v)]), dt=np.array([dt, dt * dt]))
    slopes, ahead, here = numbers[: n * n].reshape(n, n), numbers[n * n : -n], numbers[-n:]
    states = slice(forces.first, n)  # eliminated, they leave a matrix of the coordinates
    size = np.r_[np.ones(states.start), np.diagonal(mass)[states]]  # pivots differ
    inner = np.linalg.solve(
        *(x[states] / size[states, np.newaxis] for x in ((mass + slopes)[:, states], slopes[:, : states.start]))
    )
    left = slopes[: states.start, : states.start] - slopes[: states.start, states] @ inner
    assert np.abs(left - left.T).max() <= 1e-12 * np.abs(left).max()
    assert np.linalg.eigvalsh(left).min() >= -1e-12 * np.abs(left).max()
    expected = np.linalg.solve((mass + slopes) / size[:, np.newaxis], (here - bias - ahead) / size)
    assert np.abs(found - expected).max() <= 1e-9 * np.abs(expected).max()


@pytest.mark.parametrize("seed", seeds(3, 2, 6))
def test_an_implicit_step_with_dampers_of_whole_joints(seed: int) -> None:
    """These are linear in the rates, and taken in the directions of the beginning: (M + dt D) a = -bias - D v."""
    forces, dt = Forces((JointDampers,), seed), 0.05
    found, mass, bias = stepped(forces, dt)
    D = forces.differences("v", forces.v, forces.rows())
    expected = np.linalg.solve(mass + dt * D, -bias)
    assert np.abs(D - np.diag(np.diagonal(D))).max() > 1e-3
    assert np.abs(found - expected).max() <= 1e-6 * np.abs(expected).max()


def test_dampers_of_whole_joints_with_a_prescribed_rotation() -> None:
    """The rows of what is free: the prescribed acceleration, here 0.7, moves them through M + dt D."""
    forces, dt, given = Forces((JointDampers,), 4), 0.05, 0.7
    text = robot_with(JointDampers).replace("alpha = {}", "alpha = { role = 'prescribed' }", 1)
    model = build_model(robot_from_toml(text))
    _, mass, bias = stepped(forces, dt)
    D = forces.differences("v", forces.v, forces.rows())
    (k,) = model.prescribed
    free = [i for i in range(model.size) if i != k]
    A, right = mass + dt * D, -bias - given * (mass + dt * D)[:, k]
    expected = np.linalg.solve(A[np.ix_(free, free)], right[free])
    forces.model = model
    found, _, _ = stepped(forces, dt, {k: given})
    assert np.abs(D[free, k]).max() > 1e-3
    assert found[k] == given
    assert np.abs(found[free] - expected).max() <= 1e-6 * np.abs(expected).max()


@pytest.mark.soak
@pytest.mark.parametrize("seed", seeds(1, 1, 3))
def test_batches_and_float32(seed: int, built: Build) -> None:
    """The robot with all families: batches have the numbers of single states, and float32 nearly so."""
    robot = robot_of(*ELEMENTS)
    names = ("generalized_force", "energy")
    kernel, single = built(robot, *names), built(robot, *names, dtype="float32")
    rng = np.random.default_rng(seed)
    q, v = rng.uniform(-0.3, 0.3, (9, kernel.n)), rng.uniform(-1.0, 1.0, (9, kernel.n))
    z = rng.uniform(-1.0, 1.0, (9, len(kernel.internal_states)))
    for name in names:
        whole = getattr(kernel, name)(q, v, z=z)
        assert np.array_equal(whole, [getattr(kernel, name)(x, y, z=s) for x, y, s in zip(q, v, z, strict=True)])
        rough = getattr(single, name)(*(x.astype(np.float32) for x in (q, v)), z=z.astype(np.float32))
        assert np.abs(rough - whole).max() <= 1e-3 * np.abs(whole).max()


def test_places_of_numbers(built: Build) -> None:
    """A kernel tells its forces' numbers by family, owner and name."""
    kernel = built(robot_of(*ELEMENTS), "generalized_force", "energy")
    names = list(kernel.parameters)
    for family, owner, key, name in (
        ("coordinates", "hip.motor", "cubic", "joints.hip.motor.cubic"),
        ("cut_laws", "pin.y", "clearance", "loops.pin.y.clearance"),
        ("cut_laws", "belt", "stiffness", "couplings.belt.stiffness"),
        ("bearings", "hip", "friction.radius", "joints.hip.radial.friction.radius"),
        ("cut_bearings", "bush", "stiffness", "loops.bush.radial.stiffness"),
        ("joint_damping", "hip", "angular", "joints.hip.damping.angular"),
        ("joint_damping", "wrist", "z.alpha", "joints.wrist.damping.z.alpha"),
        ("joint_stiffness", "neck", "x.beta", "joints.neck.stiffness.x.beta"),
        ("cut_stiffness", "clamp", "preload.z", "loops.clamp.stiffness.preload.z"),
        ("cut_damping", "clamp", "at_hz", "loops.clamp.damping.at_hz"),
        ("bushings", "block", "stiffness.y.gamma", "bushings.block.stiffness.y.gamma"),
        ("springs", "coil", "free_length", "springs.coil.free_length"),
    ):
        assert names[kernel.elements[family][owner][key]] == name
    i, j = (kernel.calls.coordinates.index(f"rocker.mode{k}") for k in (1, 2))
    assert (joint_stiffness(kernel)[i, j], joint_damping(kernel)[j, i]) == (12.0, -0.15)
    assert damping_forces(kernel, np.zeros((1, kernel.n)), np.eye(kernel.n)[[i]])[0, j] == -0.15
    assert [contact.stiffness for contact in (*journal_contacts(kernel), *cut_contacts(kernel))] == [100.0] * 4
    hip = [name.startswith("hip.") and not name.endswith(".motor") for name in kernel.calls.coordinates]
    assert np.array_equal(damping_diagonal(kernel) > 0.0, hip)
