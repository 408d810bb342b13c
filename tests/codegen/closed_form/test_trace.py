"""The closed form (11)-(16) against the paper's example and against LagrangesMethod."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest
import sympy as sp
from numpy.typing import NDArray
from sympy.physics.mechanics import (
    Inertia,
    LagrangesMethod,
    Lagrangian,
    Point,
    ReferenceFrame,
    RigidBody,
    dynamicsymbols,
)

from eomgen.codegen.closed_form.trace import closed_form
from eomgen.robot.model import build_model
from eomgen.robot.value import Robot
from tests.oracles.lagrange import LagrangeOracle
from tests.oracles.paper_example import equal, gravity, length, m, one_link, stiffness
from tests.support.programs import answer
from tests.support.random_robots import random_robot, random_state, seeds
from tests.support.soak import soaked

pytestmark = pytest.mark.quick

Array = NDArray[np.float64]
TOLERANCE = 1e-11  # relative, max-norm


def relative_error(found: Array, expected: Array) -> float:
    return float(np.abs(found - expected).max() / max(np.abs(expected).max(), 1e-300))


def test_left_sides_of_17_and_18() -> None:
    """All coefficients that the paper prints under eqs. (17) and (18)."""
    form = one_link()
    _, gamma = form.q
    x, g = 0, 1
    M, C = form.mass_matrix, form.christoffel
    assert equal(M[x, x], m)
    assert equal(M[x, g], -m * length / 2 * sp.sin(gamma))
    assert equal(M[g, x], -m * length / 2 * sp.sin(gamma))
    assert equal(M[g, g], m * length**2 / 3)
    assert equal(C[x][g][g], -m * length / 2 * sp.cos(gamma))
    for zero in (C[x][x][x], C[x][x][g], C[g][g][g], C[g][x][g], C[g][x][x]):
        assert zero == 0


def test_one_link_equals_a_lagrangian_for_gravity_along_any_axis() -> None:
    form = one_link()
    left = _one_link_by_mechanics()
    t = dynamicsymbols._t
    x, gamma = dynamicsymbols("x gamma")
    swap: dict[Any, Any] = {}
    for function, symbols in zip((x, gamma), zip(form.q, form.v, form.a, strict=True), strict=True):
        swap |= {function.diff(t, order): symbol for order, symbol in enumerate(symbols)}
    for found, expected, drive in zip(form.residual, left, form.u, strict=True):
        assert equal(found + drive, expected.doit().xreplace(swap))


def _one_link_by_mechanics() -> Any:
    """Section 6 with sympy.physics.mechanics: a rod on a slider along X0, no drive."""
    t = dynamicsymbols._t
    x, gamma = dynamicsymbols("x gamma")
    N, origin = ReferenceFrame("N"), Point("O")
    origin.set_vel(N, 0)
    B = N.orientnew("B", "Axis", (gamma, N.z))
    slider = origin.locatenew("P", x * N.x)
    slider.set_vel(N, x.diff(t) * N.x)
    com = slider.locatenew("C", length / 2 * B.x)
    com.v2pt_theory(slider, N, B)
    moment = m * length**2 / 12
    rod = RigidBody("rod", com, B, m, Inertia.from_inertia_scalars(com, B, 0, moment, moment))
    g = gravity[0] * N.x + gravity[1] * N.y + gravity[2] * N.z
    rod.potential_energy = -m * g.dot(com.pos_from(origin))
    return LagrangesMethod(Lagrangian(N, rod) - stiffness * x**2 / 2, [x, gamma]).form_lagranges_equations()


def compare(robot: Robot, seed: int, external_forces: bool = False, states: int = 3) -> None:
    """Closed form and LagrangesMethod on random states, all terms."""
    form = closed_form(build_model(robot), external_forces=external_forces)
    oracle = LagrangeOracle(robot, wrenches=external_forces)
    call = form.function("residual", "mass_matrix", "bias", "christoffel", "kinetic", "potential")
    rng = np.random.default_rng(seed)
    for _ in range(states):
        s = random_state(robot, rng)
        wrench = rng.uniform(-5.0, 5.0, (len(form.wrench), 6))
        by_name = dict(zip(build_model(robot).links, wrench.tolist(), strict=True)) if external_forces else {}
        residual, M, bias, C, kinetic, potential = call(s.q, s.v, s.a, s.u, wrench.tolist())
        terms = np.concatenate([M @ s.a, bias, s.u])
        scale = max(np.abs(terms).max(), np.abs(residual).max())
        assert np.abs(residual - oracle.residual(s.q, s.v, s.a, s.u, by_name)).max() <= TOLERANCE * scale
        assert relative_error(M, oracle.mass_matrix(s.q)) <= TOLERANCE
        assert np.abs(bias - oracle.bias_force(s.q, s.v)).max() <= TOLERANCE * scale
        assert np.allclose(np.einsum("svw,v,w", C, s.v, s.v), bias, rtol=0, atol=TOLERANCE * scale)
        assert (kinetic, potential) == pytest.approx(oracle.energy(s.q, s.v), rel=1e-11, abs=1e-11 * scale)
        assert kinetic == pytest.approx(s.v @ M @ s.v / 2, rel=1e-12)


def test_christoffel_symbols_of_the_first_kind() -> None:
    """C_s,vw of eq. (12) equals 1/2 (dM_sv/dw + dM_sw/dv - dM_vw/ds)."""
    robot = random_robot(21, joints=(2, 2), max_size=4)
    form = closed_form(build_model(robot))
    s = random_state(robot, 5)
    M, C = form.function("mass_matrix", "christoffel")(s.q, s.v, s.a, s.u)
    mass = form.function("mass_matrix")
    h = 1e-5
    dM = np.array([(mass(s.q + e, s.v, s.a, s.u) - mass(s.q - e, s.v, s.a, s.u)) / (2 * h) for e in h * np.eye(len(M))])
    expected = (np.einsum("wsv->svw", dM) + np.einsum("vsw->svw", dM) - dM) / 2
    assert np.allclose(C, expected, atol=1e-8 * np.abs(M).max())
    assert np.array_equal(C, np.swapaxes(C, 1, 2))


def test_symbols_for_every_parameter() -> None:
    robot = random_robot(3, joints=(1, 2), max_size=3)
    model = build_model(robot)
    general, plain = closed_form(model, symbolic_parameters=True), closed_form(model)
    numbers = dict(robot.numbers())
    assert f"links.{robot.links[0].name}.mass" in general.parameters
    swap = {symbol: numbers[name] for name, symbol in general.parameters.items()}
    s = random_state(robot, 3)
    at = dict(zip([*general.q, *general.v, *general.a, *general.u], [*s.q, *s.v, *s.a, *s.u], strict=True))
    found = _numbers(general.residual, {**swap, **at})
    assert relative_error(found, plain.function("residual")(s.q, s.v, s.a, s.u)) < 1e-12


def _numbers(row: Sequence[Any], values: dict[Any, Any]) -> Array:
    return np.array([float(entry.xreplace({k: sp.Float(t, 17) for k, t in values.items()})) for entry in row])


@pytest.mark.parametrize("seed", seeds(0, 2, 12))
def test_recursion_equals_closed_form(seed: int) -> None:
    """The generator's programs, evaluated on floats: another derivation of the same terms."""
    robot = random_robot(seed, max_size=4, tree=seed % 3 == 0)
    s, fields = random_state(robot, seed), ("residual", "mass_matrix", "bias", "christoffel")
    expected = closed_form(build_model(robot)).function(*fields)(s.q, s.v, s.a, s.u)
    scale = max(np.abs(expected[0]).max(), np.abs(expected[1] @ s.a).max())
    for field, terms in zip(fields, expected, strict=True):
        found = answer(robot, "bias_force" if field == "bias" else field, s)
        size = np.abs(terms).max() if field == "mass_matrix" else scale
        assert np.abs(found - terms.ravel()).max() <= TOLERANCE * size


def test_names_of_symbols() -> None:
    """Like the paper's, numbered by joint; wrenches by link."""
    form = closed_form(build_model(random_robot(12, joints=(3, 3), max_size=3)), external_forces=True)
    names = [(str(q), str(v), str(a), str(u)) for q, v, a, u in zip(form.q, form.v, form.a, form.u, strict=True)]
    for k, (q, v, a, u) in enumerate(names, start=1):
        name = q.removesuffix(f"_{k}")
        assert (v, a, u) == (f"{name}dot_{k}", f"{name}ddot_{k}", f"D_{name}_{k}")
    assert [str(s) for s in form.wrench[0]] == [f"{key}_link1" for key in ("F_x", "F_y", "F_z", "R_x", "R_y", "R_z")]
    assert not form.parameters


def test_angles_of_a_placement_as_symbols() -> None:
    robot = next(
        robot
        for robot in (random_robot(seed, joints=(1, 1), max_size=2) for seed in range(100))
        if robot.joints[0].placement.rpy and all(robot.joints[0].placement.rpy)
    )
    names = [f"joints.joint1.placement.rpy.{i}" for i in range(3)]
    form = closed_form(build_model(replace(robot, tunable=tuple(names))), symbolic_parameters=True)
    assert {str(symbol) for symbol in form.potential.free_symbols} & set(names)
    assert all(symbol.is_real for symbol in form.parameters.values())
    s, numbers = random_state(robot, 1), dict(robot.numbers())
    at = dict(zip([*form.q, *form.v, *form.a, *form.u], [*s.q, *s.v, *s.a, *s.u], strict=True))
    found = _numbers(form.residual, {symbol: numbers[name] for name, symbol in form.parameters.items()} | at)
    assert relative_error(found, closed_form(build_model(robot)).function("residual")(s.q, s.v, s.a, s.u)) < 1e-12


def turning_joint() -> Robot:
    """A robot of one joint that turns about all axes."""
    robots = (random_robot(seed, joints=(1, 1), max_size=4) for seed in range(1000))
    return next(robot for robot in robots if set(robot.joints[0].coordinates) >= {"alpha", "beta", "gamma"})


COMPARED: dict[str, Callable[[], Robot]] = {
    "0": lambda: random_robot(0, max_size=3),
    "tree": lambda: random_robot(12, joints=(3, 3), max_size=3, tree=True),
    **{str(seed): partial(random_robot, seed, max_size=3) for seed in range(1, 10)},
    **{f"four coordinates, {seed}": partial(random_robot, seed, joints=(1, 2), max_size=4) for seed in (101, 104)},
    "free": lambda: random_robot(4, joints=(1, 1), types=("free",)),
}


PUSHED: dict[str, Callable[[], Robot]] = {
    **{str(seed): partial(random_robot, seed, max_size=3) for seed in (0, 4, 6)},
    "every rotation": turning_joint,
}


@pytest.mark.parametrize("name", soaked(COMPARED, ["0", "tree"]))
def test_robots_against_lagranges_method(name: str) -> None:
    compare(COMPARED[name](), 12)


@pytest.mark.parametrize("name", soaked(PUSHED, ["0"]))
def test_external_forces_of_eq_14(name: str) -> None:
    """Forces at the centres of mass and moments on the links, for all kinds of coordinates."""
    compare(PUSHED[name](), 1, external_forces=True, states=2)
