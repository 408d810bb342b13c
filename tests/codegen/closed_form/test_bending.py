"""Closed forms of links that bend: against Lagrange's equations of their particles, and to be read."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from eomgen.codegen.closed_form.readable import readable_closed_form
from eomgen.codegen.closed_form.trace import closed_form
from eomgen.errors import InputError
from eomgen.robot.model import build_model
from eomgen.robot.value import Coordinate, Joint, Link, LinkModes, Node, Robot, made_of
from tests.support.bending_robots import bent
from tests.support.random_robots import random_robot, seeds, with_random_loops

NONE = (0.0, 0.0, 0.0)


@pytest.mark.parametrize("seed", [pytest.param(0, marks=pytest.mark.soak), *seeds(1, 1, 11)])
def test_random_robots_against_lagrange(seed: int) -> None:
    """One or two joints of up to two coordinates, links of one or two modes, in M, C, forces and energies."""
    bending = bent(random_robot(seed, (1, 2), 2, max_size=3), seed, (1, 2))
    form, oracle, s = closed_form(build_model(bending.robot)), bending.oracle(), bending.state(seed)
    names = ("mass_matrix", "bias", "residual", "christoffel", "kinetic", "potential")
    M, bias, residual, C, kinetic, potential = form.function(*names)(s.q, s.v, s.a, s.u)
    expected = oracle.residual(s.q, s.v, s.a, s.u)
    size = np.abs(expected).max()
    assert np.abs(M - oracle.mass_matrix(s.q)).max() < 1e-12 * np.abs(M).max()
    assert np.abs(residual - expected).max() < 1e-12 * size
    assert np.abs(bias - oracle.bias_force(s.q, s.v)).max() < 1e-12 * size
    assert np.abs(C - oracle.christoffel(s.q)).max() < 1e-12 * np.abs(M).max()
    assert [float(kinetic), float(potential)] == pytest.approx(oracle.energy(s.q, s.v), rel=1e-12)


def flexible_arm(load: float = 0.0) -> Robot:
    """A link on a revolute joint that bends in a plane by one mode and stiffens by rotation; a load on its tip."""
    Phi: Any = ((0.0,), (2.0,), (0.0,), (0.0,), (0.0,), (2.7,))
    tip = Node("tip", (1.0, 0.0, 0.0), Phi, (((-4.6,),), ((0.0,),), ((0.0,),)))
    H0: Any = (((0.0, 0.8, 0.0), NONE, NONE, (0.0, 1.5, 0.0)),)
    P: Any = (((NONE, (0.0, 1.1, 0.0), NONE),),)
    Q: Any = ((((-0.9, 0.0, 0.0), NONE, NONE, (-1.3, 0.0, 0.0)),),)
    modes = LinkModes(H0, P, ((200.0,),), ((0.5,),), (tip,), Q)
    arm = Link("arm", 3.0, (0.5, 0.0, 0.0), (0.0, 0.25, 0.25, 0.0, 0.0, 0.0), modes)
    ((node, joint, couplings),) = made_of(arm)
    links = [arm, node, *([Link("load", load, NONE, (0.0,) * 6)] if load else [])]
    joints = [Joint("shoulder", "base", "arm", "revolute", coordinates={"gamma": Coordinate()}), joint]
    joints += [Joint("weld", "arm_tip", "load", "fixed")] if load else []
    return Robot("flexible_arm", (0.0, -9.81, 0.0), tuple(links), tuple(joints), couplings=couplings)


def test_one_flexible_link_is_read_in_closed_form() -> None:
    """All of its equations: what a hand writes for a rod that bends by one shape, with Q as what stiffens it."""
    form = readable_closed_form(build_model(flexible_arm()))
    text = form.lines()
    assert [line.strip() for line in text if line.startswith(("  M[", "  C["))] == [
        "M[gamma_1, gamma_1] = I_zz_arm + P11_yy_arm*e1_1**2 + Q11_xx_arm*e1_1**2 + c_x_arm**2*m_arm",
        "M[gamma_1, e1_1] = N1_xy_arm",
        "M[e1_1, e1_1] = P11_yy_arm",
        "C[gamma_1; gamma_1, e1_1] = e1_1*(P11_yy_arm + Q11_xx_arm)",
        "C[e1_1; gamma_1, gamma_1] = -e1_1*(P11_yy_arm + Q11_xx_arm)",
    ]
    assert "  e1_1 = arm.mode1: 1" in text
    assert "  a_e1_arm = links.arm.modes.1.stiffness: 200.0 J" in text
    assert "  N1_xy_arm = links.arm.modes.N.1.x.y: 0.8 kg m^2" in text
    assert "  n1_y_arm = links.arm.modes.n.1.y: 1.5 kg m" in text
    assert r"\ddot{e}_{1,1}" in form.latex()
    assert r"M_{1,1}^{\gamma e_{1}}" in form.latex()


def test_a_load_on_the_tip_bends_and_draws_in() -> None:
    form = readable_closed_form(build_model(flexible_arm(1.5)), numbers=True)
    M = form.mass_matrix[0, 0].subs(dict(zip(form.form.q, (0.3, 0.02), strict=True)))
    place = np.array([1.0 - 2.3 * 0.02**2, 2.0 * 0.02])
    assert float(M) == pytest.approx(0.25 + 3.0 * 0.25 + (1.1 - 0.9) * 0.02**2 + 1.5 * place @ place, rel=1e-14)


def test_what_the_closed_form_does_not_know_is_refused() -> None:
    robot = with_random_loops(bent(random_robot(4, (2, 2), 2), 4, (1,)).robot, 4, ["revolute"])
    with pytest.raises(InputError, match="closed form of links that bend knows no loops and couplings"):
        closed_form(build_model(robot))
