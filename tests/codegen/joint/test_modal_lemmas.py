"""Links that bend in SymPy: proofs that fail where their claims are wrong, formulas against particles in numbers."""

from __future__ import annotations

import sys
from itertools import product
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
import sympy as sp

from eomgen.errors import InternalError
from tests.oracles import modal_lemmas as modal
from tests.support.soak import soaked

pytestmark = pytest.mark.quick


@pytest.mark.soak
def test_what_the_proofs_say() -> None:
    assert list(modal.proofs()) == [
        "T = 1/2 tr(A' H A'^T) + e'_k tr(A' G_k A^T) + 1/2 m_kl e'_k e'_l",
        "f, n and r_k are those of eq. (5)",
        "m_kl is constant: no terms e' e' in rows of modes",
        "lemma (7) for modes: without Q no own terms e' e' in f and n",
        "sharper lemma for modes: no mode turns a translation at or in front of its link",
        "C_k,jk = 0 for a mode k and j in front of it",
        "mean axes: no coupling with the frame at e = 0",
        "bending in a plane: one entry of n_k and of axial N_k, P_kl diagonal, no Coriolis force",
        "modes of two kinds of a beam: m_kl = 0; no Coriolis force between torsion and axial",
    ]


WRONG = [  # a piece of text, what it is replaced by, and the proof that must fail then
    ("- across * slope * ex", "- across**2 * slope * ez", "prove_plane_bending"),
    ("half = [(self.H0[k] + self.slope(k)) / 2", "half = [self.slope(k)", "prove_trace_form"),
    ("e_dot[k] * (W * constants.slope(k))", "e_dot[k] * (W * constants.H0[k])", "prove_trace_form"),
    ("own = sum(constants.mass(k, j)", "own = 2 * sum(constants.mass(k, j)", "prove_trace_form"),
    ("2 * w.cross(_sum(", "w.cross(_sum(", "prove_recursion"),
    ("S.trace() * sp.eye(3) - S.T", "S.trace() * sp.eye(3) - S", "prove_recursion"),
    ("+ c.cross(a)", "- c.cross(a)", "prove_recursion"),
    ("w.dot(axial(constants.P[k][j]))", "w.dot(axial(constants.P[j][k]))", "prove_recursion"),
    ("self._second(j, k) for j in MODES", "self._second(k, j) for j in MODES", "prove_trace_form"),
    ("step(name).generator * rho - step", "step(name).transform * rho - step", "prove_sharper_lemma_for_modes"),
    ("entry - generic().mass(k, j)", "entry - e[k] * generic().mass(k, j)", "prove_modal_mass_constant"),
    (
        "recursion(generic().without_stiffening())\n    for k, j",
        "recursion(generic())\n    for k, j",
        "prove_lemma_7_for_modes",
    ),
    (
        "rows[k].expand().diff(e_dot[k], coordinate)",
        "rows[k].expand().diff(e_dot[1 - k], coordinate)",
        "prove_own_rate",
    ),
    ("home = dict.fromkeys(e, 0)", "home: dict[Any, Any] = {}", "prove_mean_axes"),
    ("replace(constants, H0=symmetric).without_stiffening())", "constants)", "prove_mean_axes"),
    ("y * ez - z * ey)", "y * ez - ey)", "prove_kinds_of_beams_apart"),
]


@pytest.mark.parametrize(("old", "new", "proof"), soaked(WRONG, WRONG[9:]))
def test_every_proof_fails_where_its_claim_is_wrong(
    old: str, new: str, proof: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    text, other = Path(modal.__file__).read_text(encoding="utf-8"), ModuleType("wrong_lemmas")
    assert text.count(old) == 1, old
    monkeypatch.setitem(sys.modules, other.__name__, other)  # where its dataclasses look
    exec(text.replace(old, new), vars(other))
    with pytest.raises(InternalError, match="the proof failed"):
        getattr(other, proof)()


def test_what_is_left_is_there() -> None:
    """What no proof takes away does not vanish: Q's own terms, Coriolis forces of two planes, rates of other modes."""
    written = modal.recursion(modal.generic())
    for k, j in product(modal.MODES, repeat=2):
        assert not written.force.diff(modal.e_dot[k], modal.e_dot[j]).is_zero_matrix
        assert not written.moment.diff(modal.e_dot[k], modal.e_dot[j]).is_zero_matrix
    assert modal.prove_kinds_of_beams_apart() == (("torsion", "axial"),)
    for axis in modal.w:
        assert written.rows[0].expand().diff(modal.e_dot[1], axis) != 0
    bent = modal.beam_constants("y", "y")
    assert bent.H0[0][3, 1] != 0
    assert bent.H0[0][0, 1] != 0  # moment about z
    assert bent.H0[0][1, 0] != 0  # of the section's own turning


def test_equations_are_those_of_particles() -> None:
    """A cloud with deflections linear in e: sums of m (drho/ds) . acceleration, by numbers."""
    rng = np.random.default_rng(5)
    mass, place, phi = rng.uniform(0.2, 1.0, 9), rng.normal(size=(9, 3)), rng.normal(size=(2, 9, 3))
    e, e_dot, e_ddot = rng.normal(size=(3, 2))
    w, v, w_dot, v_dot = rng.normal(size=(4, 3))
    at, moving, shaken = place + np.tensordot(e, phi, 1), np.tensordot(e_dot, phi, 1), np.tensordot(e_ddot, phi, 1)
    a = v_dot + np.cross(w, v) + np.cross(w_dot, at) + np.cross(w, np.cross(w, at)) + 2 * np.cross(w, moving) + shaken
    rho0 = np.hstack([place, np.ones((9, 1))])
    constants = modal.Constants(
        _exact(np.einsum("i,ia,ib->ab", mass, rho0, rho0)),
        [_exact(np.einsum("i,ia,ib->ab", mass, rho0, one)) for one in phi],
        [[_exact(np.einsum("i,ia,ib->ab", mass, one, other)) for other in phi] for one in phi],
        [[sp.zeros(4, 3)] * 2] * 2,
    )
    given = [(modal.e, e), (modal.e_dot, e_dot), (modal.e_ddot, e_ddot)]
    given += [(modal.w, w), (modal.v, v), (modal.w_dot, w_dot), (modal.v_dot, v_dot)]
    numbers = {x: value for names, values in given for x, value in zip(names, values.tolist(), strict=True)}
    written = modal.recursion(constants)
    for symbols, expected in (
        (written.force, mass @ a),
        (written.moment, mass @ np.cross(at, a)),
        (written.rows, np.einsum("i,kia,ia->k", mass, phi, a)),
    ):
        found = [float(sp.sympify(x).subs(numbers)) for x in symbols]
        assert np.allclose(found, expected, rtol=1e-12, atol=1e-12)


def _exact(X: Any) -> Any:
    return sp.ImmutableMatrix(X.tolist())
