"""Eq. (3): elementary transforms, derivatives, and proofs that are neither too weak nor too strong."""

from __future__ import annotations

import importlib
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import combinations, product
from typing import Any

import numpy as np
import pytest
import sympy as sp

from eomgen.codegen.joint import lemmas as joint
from eomgen.codegen.joint.kept import KEPT
from eomgen.codegen.joint.lemmas import joint_derivatives, joint_transform, step
from eomgen.errors import InternalError
from eomgen.robot.geometry import rotation_from_rpy
from eomgen.robot.value import ANGULAR, COORDINATES, LINEAR
from tests.support.mutant import mutated

pytestmark = pytest.mark.quick

SUBSETS = [active for size in range(7) for active in combinations(COORDINATES, size)]


@pytest.mark.parametrize("coordinate", COORDINATES)
def test_step_moves_along_or_about_its_own_axis(coordinate: str) -> None:
    found, t = step(coordinate), 0.7
    A = np.array(found.transform.subs(found.symbol, t), dtype=float)
    expected = np.eye(4)
    axis = (LINEAR + ANGULAR).index(coordinate) % 3
    if coordinate in LINEAR:
        expected[axis, 3] = t
    else:  # roll, pitch and yaw of a URDF are right-handed rotations about x, y, z
        expected[:3, :3] = rotation_from_rpy(tuple(t if i == axis else 0.0 for i in range(3)))  # type: ignore[arg-type]
    assert np.allclose(A, expected, atol=1e-15)
    assert (found.is_rotation, found.axis) == (coordinate in ANGULAR, axis)
    assert found.rotation == found.transform[:3, :3]


@pytest.mark.parametrize("coordinate", COORDINATES)
def test_generator_is_constant_and_gives_the_derivative(coordinate: str) -> None:
    found = step(coordinate)
    assert not found.generator.free_symbols
    assert found.transform.diff(found.symbol) == found.transform * found.generator
    assert found.generator.row(3).is_zero_matrix


@pytest.mark.parametrize("active", SUBSETS, ids="-".join)
def test_inactive_coordinates_vanish_from_the_transform(active: tuple[str, ...]) -> None:
    A = joint_transform(active)
    assert {symbol.name for symbol in A.free_symbols} == set(active)
    inactive = {step(name).symbol: 0 for name in COORDINATES if name not in active}
    assert joint_transform(COORDINATES).subs(inactive) == A


def test_order_of_eq_3() -> None:
    """Translation, then rotations about x, the turned y and the turned z."""
    numbers = dict(zip(COORDINATES, (0.1, 0.2, 0.3, 0.4, 0.5, 0.6), strict=True))
    A = np.array(joint_transform(COORDINATES).subs({step(k).symbol: t for k, t in numbers.items()}), dtype=float)
    Rx, Ry, Rz = (rotation_from_rpy(rpy) for rpy in ((0.4, 0.0, 0.0), (0.0, 0.5, 0.0), (0.0, 0.0, 0.6)))
    assert np.allclose(A[:3, :3], np.array(Rx) @ np.array(Ry) @ np.array(Rz), atol=1e-15)
    assert np.allclose(A[:, 3], (0.1, 0.2, 0.3, 1.0), atol=1e-15)


def test_derivatives_against_finite_differences() -> None:
    symbols = [step(name).symbol for name in COORDINATES]
    at = np.array([0.1, -0.2, 0.3, 0.4, -0.5, 0.6])
    derivatives = joint_derivatives(COORDINATES)
    A = sp.lambdify([symbols], joint_transform(COORDINATES), "numpy")
    h = 1e-5
    for i, s in enumerate(COORDINATES):
        up, down = at + h * np.eye(6)[i], at - h * np.eye(6)[i]
        first = sp.lambdify([symbols], derivatives.first[s], "numpy")
        assert np.allclose((A(up) - A(down)) / (2 * h), first(at), atol=1e-9)
        for w in COORDINATES:
            by_w = sp.lambdify([symbols], derivatives.first[w], "numpy")
            second = sp.lambdify([symbols], derivatives.second[s, w], "numpy")
            assert np.allclose((by_w(up) - by_w(down)) / (2 * h), second(at), atol=1e-9)


def test_lemmas_name_exactly_the_zero_second_derivatives() -> None:
    """Two 6-DOF joints with numbers in them: every pair that is not proved zero is not zero."""
    derivatives = joint_derivatives(COORDINATES)
    at = {step(name).symbol: 0.1 + 0.2 * i for i, name in enumerate(COORDINATES)}
    first, second = (
        {key: np.array(D.subs(at), dtype=float) for key, D in table.items()}
        for table in (derivatives.first, derivatives.second)
    )
    between = np.eye(4)
    between[:3] = np.random.default_rng(1).uniform(-1.0, 1.0, (3, 4))
    proved = {(pair.first, pair.second, pair.same_joint) for pair in joint.prove_second_derivative_zeros()}
    for s, w in product(COORDINATES, repeat=2):
        assert ((s, w, False) in proved) == (not np.any(first[s] @ between @ first[w]))
        if COORDINATES.index(s) <= COORDINATES.index(w):
            assert ((s, w, True) in proved) == (not np.any(second[s, w]))


def test_lemma_7_and_the_sharper_lemma_are_told_apart() -> None:
    pairs = joint.prove_second_derivative_zeros()
    for pair in pairs:
        both_linear = pair.first in LINEAR and pair.second in LINEAR
        assert pair.reason == (joint.LEMMA_7 if both_linear else joint.SHARPER)
    assert sum(pair.reason == joint.LEMMA_7 for pair in pairs) == 6 + 9  # in one joint, and in two
    assert sum(pair.reason == joint.SHARPER for pair in pairs) == 9 + 9


def test_relations_inside_a_joint() -> None:
    assert joint.prove_translations_orthogonal() == (("x", "y"), ("x", "z"), ("y", "z"))
    assert joint.prove_coaxial() == (("x", "alpha"), ("y", "beta"), ("z", "gamma"))
    joint.prove_antisymmetry()
    joint.prove_translation_column()
    joint.prove_coaxial_swap()


def text_now(module: str = "joint.lemmas") -> str:
    """The text of a module of the generator as it is imported now."""
    name = f"eomgen.codegen.{module}"
    found: str = importlib.import_module(name).__loader__.get_source(name)
    return found


@contextmanager
def changed(old: str, new: str, module: str = "joint.lemmas") -> Iterator[Any]:
    """A module of proofs, which may be a mutant, with another piece of text."""
    text = text_now(module)
    assert text.count(old) == 1, old
    with mutated(module, text.replace(old, new)):
        yield importlib.import_module(f"eomgen.codegen.{module}")


WRONG = [  # a piece of text, what it is replaced by, and the proof that must fail then, with its arguments
    ("3] = s\n", "3] = s**2\n", "step", ("y",)),
    ("A[j, j] = sp.cos(s)", "A[j, j] = sp.cosh(s)", "step", ("beta",)),
    ("first = {name: A.diff(step(name).symbol)", "first = {name: A", "prove_translation_column", ()),
    ("A, sp.ImmutableMatrix(D))", "A, sp.ones(4, 4))", "prove_antisymmetry", ()),
    ("[[0, -a[2], a[1]]", "[[0, a[2], a[1]]", "prove_coaxial_swap", ()),
]
PAIRS = ["zero_pairs[1:]", "zero_pairs[:-1]"]  # a lemma too few, and too many
PAIRS += [f'[*zero_pairs, ZeroPair("alpha", "beta", {same_joint}, SHARPER)]' for same_joint in (True, False)]


@pytest.mark.parametrize(("old", "new", "proof", "arguments"), WRONG)
def test_every_proof_fails_where_its_claim_is_wrong(old: str, new: str, proof: str, arguments: tuple[str, ...]) -> None:
    """With a matrix in the place of another for which the claim does not hold."""
    with changed(old, new) as other, pytest.raises(InternalError, match="the proof failed"):
        getattr(other, proof)(*arguments)


@pytest.mark.parametrize("pairs", PAIRS)
def test_a_lemma_too_many_or_too_few_is_noticed(pairs: str) -> None:
    other_pairs = f"pairs = tuple({pairs})"
    with changed("pairs = tuple(zero_pairs)", other_pairs) as other, pytest.raises(InternalError, match="lemma"):
        other.prove_second_derivative_zeros()


def test_what_is_kept_is_what_is_derived() -> None:
    """The plain values that builds use against all of them derived and proved anew."""
    name = "eomgen.codegen.joint.freezing"
    freezing = importlib.import_module(name)
    derived = freezing.derived_facts()
    assert (derived.steps, derived.zero_pairs) == (dict(KEPT.steps), KEPT.zero_pairs)
    assert (derived.orthogonal, derived.coaxial) == (KEPT.orthogonal, KEPT.coaxial)


def test_a_rotation_of_another_form_is_not_frozen() -> None:
    with changed("A[j, j] = sp.cos(s)", "A[j, j] = sp.cosh(s)"):
        freezing = importlib.import_module("eomgen.codegen.joint.freezing")
        with pytest.raises(InternalError, match=r"the proof failed|of another form"):
            freezing.frozen_step("beta")


@pytest.mark.parametrize("coordinate", COORDINATES)
def test_frozen_steps_have_the_values_of_symbolic_ones(coordinate: str) -> None:
    found, t = step(coordinate), 0.7
    expected = np.array(found.rotation.subs(found.symbol, t), dtype=float)
    frozen = KEPT.steps[coordinate]
    assert np.allclose(np.array(frozen.rotation) @ (1.0, np.sin(t), np.cos(t)), expected, atol=1e-15)
    assert (frozen.is_rotation, frozen.axis) == (found.is_rotation, found.axis)


def test_what_the_proofs_say() -> None:
    assert list(joint.proofs()) == [
        "dA_0k/dx = L [0 | e_x]",
        f"{joint.LEMMA_7} (15 pairs)",
        f"{joint.SHARPER} (18 pairs)",
        "translations of one joint are orthogonal (3 pairs)",
        "coaxial translation and rotation (3 pairs)",
        "C_i,jk = -C_k,ij for j <= min(i, k)",
        "C_i,jk = -C_l,mk for coaxial (i, m) and (l, j)",
    ]
