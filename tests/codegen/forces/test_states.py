"""Laws with several states that feel each other: rows, energies and implicit shares beside dense matrices of NumPy."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from eomgen.codegen.closed_form.readable import readable_closed_form
from eomgen.codegen.forces.element import StateSlopes
from eomgen.codegen.forces.internal_states import formulas
from eomgen.codegen.forces.internal_states.formula import LawArguments, StateEffect
from eomgen.codegen.kernels.accelerations import implicit_step
from eomgen.codegen.kernels.derivation import Derivation, Outputs
from eomgen.codegen.kernels.writers import WRITERS
from eomgen.codegen.program.ir import Program, finish
from eomgen.codegen.solve.states import share, state_rows
from eomgen.description.load import robot_from_toml
from eomgen.errors import DescriptionError
from eomgen.robot import laws
from eomgen.robot.internal_states.states import State
from eomgen.robot.model import Model, build_model
from eomgen.robot.parameter_names import leasts
from tests.support.bending_robots import Bending, bent, with_mode_follower
from tests.support.joint_table import joint_table, link_table
from tests.support.programs import dense_stage, run, staged
from tests.support.random_robots import random_robot, seeds

Array = NDArray[np.float64]
ROBOT = f"""
name = "spiral"
gravity = [0.0, 0.0, -9.81]
{link_table("body", 2.0, inertia=(0.1, 0.1, 0.1))}
{joint_table("slide", "base", "body", "prismatic")}
z = {{ friction = {{ model = "lugre", coulomb = 1.0, bristle_stiffness = 3.0 }} }}
"""
F_S, F_V, F_Z = 3.0, 0.5, np.array([2.0, -1.5])
G_S, G_V = np.array([0.3, -0.2]), np.array([1.0, 0.7])
G_Z = np.array([[-4.0, 2.0], [-3.0, 0.5]])  # its second diagonal entry alone would grow
INERTIAS = np.array([3.0, 1.0])


def spiral(x: LawArguments) -> StateEffect:
    """Return a linear law whose two states feel each other."""
    rates = [a * x.s + b * x.v + row @ np.array(x.z) for a, b, row in zip(G_S, G_V, G_Z, strict=True)]
    slopes = StateSlopes(
        F_V, [*F_Z], [*G_V], [*G_S], {(i, j): float(G_Z[i, j]) for i in (0, 1) for j in (0, 1)}, x.inertias, F_S
    )
    return StateEffect(F_S * x.s + F_V * x.v + F_Z @ np.array(x.z), rates, slopes, 0.5 * F_S * x.s * x.s)


@pytest.fixture
def model(monkeypatch: pytest.MonkeyPatch) -> Model:
    """A slide whose friction is such a law; its first state stores energy."""
    ones = State(
        name="a",
        unit=("m", "rad"),
        size=lambda n: 1.0,
        inertia=lambda n: n["friction.bristle_stiffness"],
        is_bounded=False,
    )
    both = (ones, State(name="b", unit=("1", "1"), size=lambda n: 2.0, is_bounded=False))
    changed = tuple(replace(law, states=lambda n: both) if law.name == "friction" else law for law in laws._LAWS)
    monkeypatch.setattr(laws, "_LAWS", changed)
    monkeypatch.setitem(formulas.STATE_FORMULAS, "friction", spiral)  # type: ignore[arg-type]
    return build_model(robot_from_toml(ROBOT))


def slopes() -> tuple[Array, Array, Array]:
    """M, B and K of the slide and its states."""
    M = np.diag([2.0, *INERTIAS])
    B, K = np.zeros((3, 3)), np.zeros((3, 3))
    B[0], K[0, 0] = [F_V, *F_Z], F_S
    B[1:, 0], B[1:, 1:], K[1:, 0] = -INERTIAS * G_V, -INERTIAS[:, None] * G_Z, -INERTIAS * G_S
    return M, B, K


def written(model: Model, name: str) -> Program:
    d = Derivation(model)
    outputs: Outputs = implicit_step(d) if name == "implicit_step" else WRITERS[name](d)
    return finish(d.graph, name, outputs)


STATE: dict[str, list[float]] = {"q": [0.4], "v": [0.3], "z": [-0.7, 1.2], "u": [0.6]}
MOVING = np.array([*STATE["v"], *STATE["z"]])
STATE["p"] = list(build_model(robot_from_toml(ROBOT)).parameters.values())


def test_rows_and_energies(model: Model) -> None:
    assert model.internal_states == ("slide.z.friction.a", "slide.z.friction.b")
    assert model.state_places == {("joints.slide.z", "friction"): (1, 2)}
    M, B, K = slopes()
    (q,), v, a = STATE["q"], MOVING, 0.2
    found = run(written(model, "inverse_dynamics"), STATE | {"a": [a]})
    assert found == pytest.approx([2.0 * a + B[0] @ v + F_S * q + 2.0 * 9.81], rel=1e-14)
    jacobian = run(written(model, "residual_jacobian"), STATE | {"a": [a]}).reshape(3, 3, 3)
    for matrix, expected in zip(jacobian, (K, B, M), strict=True):
        assert matrix == pytest.approx(expected, rel=1e-14, abs=0.0)
    kinetic, potential = run(written(model, "energy"), STATE)
    assert kinetic == pytest.approx(0.5 * 2.0 * v[0] ** 2, rel=1e-14)
    assert potential == pytest.approx(2.0 * 9.81 * q + 0.5 * F_S * q**2 + 0.5 * 3.0 * v[1] ** 2, rel=1e-14)


@pytest.mark.parametrize("dt", [1e-3, 0.3, 20.0])
def test_implicit_step_is_the_dense_one(model: Model, dt: float) -> None:
    M, B, K = slopes()
    forces = np.array([STATE["u"][0] - 2.0 * 9.81, 0.0, 0.0]) - B @ MOVING - K[:, 0] * (STATE["q"][0] + dt * MOVING[0])
    expected = np.linalg.solve(M + dt * B + dt * dt * K, forces)
    found = run(written(model, "implicit_step"), STATE | {"dt": [dt, dt * dt], "added": [0.0] * 3})
    assert found == pytest.approx(expected, rel=1e-11)


@pytest.mark.parametrize("c", [1e-3, 0.3, 20.0, 0.2 + 0.3j, 2.0 - 5.0j])
def test_stages_are_the_dense_ones(model: Model, c: complex) -> None:
    """Also of the complex c of Radau's method."""
    rng = np.random.default_rng(0)
    r, s = rng.normal(size=(2, 3)), rng.normal(size=(2, 3))
    assert staged(model, STATE, c, r, s) == pytest.approx(dense_stage(slopes(), c, r, s), rel=1e-11)


@pytest.mark.parametrize("k", [1, 2, 4])
@pytest.mark.parametrize("seed", range(3))
def test_elimination_is_a_dense_solve(k: int, seed: int) -> None:
    """Of random blocks whose g_z is that of a stable system, beside the whole system of a coordinate and its states."""
    rng = np.random.default_rng(seed)
    g_z = rng.normal(size=(k, k)) - 3.0 * np.eye(k)
    f_z, g_v, g_s, right = (rng.normal(size=k) for _ in range(4))
    inertias, (f_v, f_s, r, c) = rng.uniform(0.1, 2.0, k), rng.uniform(0.5, 2.0, 4)
    entries = {(i, j): float(g_z[i, j]) for i in range(k) for j in range(k)}
    law = StateSlopes(f_v, f_z.tolist(), g_v.tolist(), g_s.tolist(), entries, inertias.tolist(), f_s)
    whole = np.zeros((k + 1, k + 1))
    whole[0] = [1.3 + c * f_v + c * c * f_s, *(c * f_z)]
    whole[1:, 0], whole[1:, 1:] = -inertias * c * (g_v + c * g_s), inertias[:, None] * (np.eye(k) - c * g_z)
    expected = np.linalg.solve(whole, [r, *right])
    rows = state_rows({0: 1.0}, range(1, k + 1), law, c, 1.0)
    given = [0.0, *right.tolist()]
    pivot, left = 1.3 + share(law, c, c * c), r - sum(row.coupling * row.free(given) for row in rows.values())
    first = left / pivot
    assert first == pytest.approx(expected[0], rel=1e-9)
    assert [row.free(given) + row.gained([first]) for row in rows.values()] == pytest.approx(expected[1:], rel=1e-9)


RAILS = f"""
name = "rails"
gravity = [0.0, 0.0, 0.0]
{link_table("sled", 2.0, inertia=(0.1, 0.1, 0.1))}
{link_table("tray", 1.0, inertia=(0.1, 0.1, 0.1))}
{joint_table("first", "base", "sled", "prismatic")}
z = {{ stiffness = 4.0, maxwell = [{{ stiffness = 3.0, damping = 0.7 }}, {{ stiffness = 2.0, damping = 5.0 }}] }}
[joints.motor]
inertia = 0.02
ratio = 5.0
stiffness = 9.0
damping = 0.3
maxwell = [{{ stiffness = 6.0, damping = 0.5 }}]
{joint_table("second", "sled", "tray", "prismatic")}
placement = {{ rpy = [0.4, 0.3, 0.0] }}
[[couplings]]
name = "belt"
of = "second.z"
to = {{ "first.z" = -1.5 }}
stiffness = 2.0
maxwell = [{{ stiffness = 5.0, damping = 0.4 }}, {{ stiffness = 1.0, damping = 3.0 }}]
"""


@pytest.mark.parametrize("c", [0.01, 3.0, 2.0 - 5.0j])
def test_transmissions_and_couplings_have_internal_states(c: complex) -> None:
    """Of linear laws along rows that do not change, steps and stages are those of M, B and K."""
    rails = build_model(robot_from_toml(RAILS))
    names = ("first.z.maxwell.0.z", "first.z.maxwell.1.z", "first.motor.maxwell.0.z", "belt.maxwell.0.z")
    assert rails.internal_states == (*names, "belt.maxwell.1.z")
    rng, is_pair = np.random.default_rng(1), isinstance(c, complex)
    n, rates = len(rails.coordinates), rails.size
    q, (v, z) = rng.normal(size=n), np.split(rng.normal(size=rates), [n])
    state: dict[str, Any] = {"q": q.tolist(), "v": v.tolist(), "z": z.tolist(), "p": [*rails.parameters.values()]}
    state |= {x: [0.0] * n for x in ("u", "a", "kp", "kd")} | {"added": [0.0] * rates}
    K, B, M = run(written(rails, "residual_jacobian"), state).reshape(3, rates, rates)
    if not is_pair:
        h = K @ np.r_[q + c * v, 0.0 * z] + B @ np.r_[v, z]
        ahead = run(written(rails, "inverse_dynamics"), state | {"q": (q + c * v).tolist()})
        assert h[:n] == pytest.approx(ahead, rel=1e-12, abs=1e-12)
        expected = np.linalg.solve(M + c * B + c * c * K, -h)
        found = run(written(rails, "implicit_step"), state | {"dt": [c, c * c]})
        assert found == pytest.approx(expected, rel=1e-10, abs=1e-12)
    r, s = rng.normal(size=(2, 2, rates))
    assert staged(rails, state, c, r, s) == pytest.approx(dense_stage((M, B, K), c, r, s), rel=1e-10, abs=1e-12)


TYPES = ("revolute", "prismatic", "fixed", "free")


def draw(seed: int) -> Bending:
    """A tree whose links bend by modes that K and D couple; a joint follows one of them with every third seed."""
    for number in range(seed, seed + 1000, 50):
        robot = random_robot(number, (2, 3), 2, tree=True, types=TYPES, name="coupled")
        bending = bent(robot, number, (2, 3))
        modes = [x.modes for x in bending.plain.links if x.modes is not None]
        if all(x.couplings("K") and x.couplings("D") for x in modes):
            return with_mode_follower(bending, number) if number % 3 == 2 else bending
    raise AssertionError("no robot among twenty is coupled")


@pytest.mark.parametrize("seed", seeds(0, 3, 24))
@pytest.mark.parametrize("dt", [1e-3, 0.3, 20.0])
def test_implicit_step_of_coupled_modes_is_the_dense_one(seed: int, dt: float) -> None:
    bending = draw(seed)
    model, oracle, s = build_model(bending.robot), bending.oracle(), bending.state(seed)
    d = Derivation(model)
    program, n = finish(d.graph, "step", implicit_step(d)), len(s.q)
    inputs = {"q": [*s.q], "v": [*s.v], "u": [*s.u], "p": list(model.parameters.values())}
    found = run(program, inputs | {"dt": [dt, dt * dt], "added": [0.0] * n})
    M, B, K = oracle.mass_matrix(s.q), oracle.dampers, oracle.springs
    expected = -oracle.residual(s.q, s.v, np.zeros(n), s.u) - dt * K @ s.v
    off = (M + dt * B + dt * dt * K) @ found - expected
    assert np.abs(off).max() < 1e-11 * np.abs(expected).max()


@pytest.mark.parametrize("seed", seeds(10, 3, 24))
@pytest.mark.parametrize("c", [0.2, 0.2 + 0.3j])
def test_stages_of_coupled_modes_are_the_dense_ones(seed: int, c: complex) -> None:
    """Those of real and of complex c: rates and shifts of modes push each other."""
    bending = draw(seed)
    model, oracle, s = build_model(bending.robot), bending.oracle(), bending.state(seed)
    rates, shifts = np.random.default_rng(seed).normal(size=(2, 2, len(s.q)))
    state = {"q": [*s.q], "v": [*s.v], "p": list(model.parameters.values())}
    found = staged(model, state, c, rates, shifts)
    expected = dense_stage((oracle.mass_matrix(s.q), oracle.dampers, oracle.springs), c, rates, shifts)
    assert np.abs(found - expected).max() < 1e-10 * np.abs(expected).max()


@pytest.mark.parametrize("seed", seeds(20, 5, 50))
def test_diagonals_within_their_ranges_leave_matrices_semidefinite(seed: int) -> None:
    """Whatever others are; at the ends of all ranges together the least eigenvalue is 0."""
    robot, rng = draw(seed).robot, np.random.default_rng(seed)
    names = [name for name, _ in robot.numbers() if ".modes." in name]
    least = leasts(robot, names)
    assert set(least) == set(names)
    for link in robot.links:
        for key, word in (("K", "stiffness"), ("D", "damping")) if link.modes is not None else ():
            matrix = np.array(getattr(link.modes, key))
            ends = np.array([least[f"links.{link.name}.modes.{k + 1}.{word}"] for k in range(len(matrix))])
            beside, size = matrix - np.diag(np.diag(matrix)), np.diag(matrix).max()
            assert (ends < np.diag(matrix)).all()
            assert np.linalg.eigvalsh(beside + np.diag(ends))[0] == pytest.approx(0.0, abs=1e-8 * size)
            drawn = beside + np.diag(ends + rng.exponential(size=len(ends)) * ends)
            assert np.linalg.eigvalsh(drawn)[0] >= -1e-8 * size


def test_a_described_diagonal_changes_alone() -> None:
    """The rest of K stays; a motion that would give energy is refused with its eigenvalue."""
    robot = draw(3).robot
    name, value = next((name, x) for name, x in robot.numbers() if name.endswith(".modes.1.stiffness"))
    link = name.split(".")[1]
    old, new = (x.link(link).modes for x in (robot, robot.with_value(name, 1.2 * (value or 0.0))))
    change = np.array(new.K) - np.array(old.K)
    assert change[0, 0] == pytest.approx(0.2 * (value or 0.0))
    assert np.count_nonzero(change) == 1
    with pytest.raises(DescriptionError, match=rf"links\.{link}\.modes\.K: .* the eigenvalue -\d"):
        robot.with_value(name, 0.01 * (value or 0.0))


@pytest.mark.soak
def test_closed_forms_have_letters_for_what_couples_modes() -> None:
    bending = bent(random_robot(1, (1, 1), 1), 3, (2,))
    (link,) = bending.plain.links
    assert link.modes is not None
    modes = replace(link.modes, K=((20.0, 7.0), (7.0, 30.0)), D=((0.3, -0.1), (-0.1, 0.7)))
    plain = replace(bending.plain, links=(replace(link, modes=modes),))
    lines = readable_closed_form(build_model(replace(bending, plain=plain).robot)).lines()
    assert "  K12_link1 = links.link1.modes.K.1.2: 7.0 J" in lines
    assert "  D12_link1 = links.link1.modes.D.1.2: -0.1 J s" in lines
    assert sum("K12_link1*e2_1" in line and "D12_link1*e2dot_1" in line for line in lines) == 1
