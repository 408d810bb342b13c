"""Eq. (3): elementary transforms, derivatives, and proofs that are neither too weak nor too strong."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import combinations, combinations_with_replacement, product
from typing import Any

import numpy as np
import pytest
import sympy as sp

from eomgen.codegen.joint.deriving import derive_joint
from eomgen.codegen.joint.facts import LEMMA_7, SHARPER, lemma_of
from eomgen.codegen.joint.lemmas import joint_derivatives, joint_transform, step
from eomgen.errors import InternalError
from eomgen.robot.geometry import JointFacts, Term, rotation_from_rpy
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
    facts = derive_joint(COORDINATES)
    for s, w in product(COORDINATES, repeat=2):
        assert (s in facts.constant) == (not np.any(first[s] @ between @ first[w]))
        if COORDINATES.index(s) <= COORDINATES.index(w):
            assert ((s, w) in facts.zero_pairs) == (not np.any(second[s, w]))


def test_lemma_7_and_the_sharper_lemma_are_told_apart() -> None:
    facts = derive_joint(COORDINATES)
    inside, between = list(facts.zero_pairs), list(product(facts.constant, COORDINATES))
    for pairs, count in ((inside, 6), (between, 9)):
        assert sum(lemma_of(*pair) == LEMMA_7 for pair in pairs) == count
        assert sum(lemma_of(*pair) == SHARPER for pair in pairs) == 9


def test_relations_inside_a_joint() -> None:
    facts = derive_joint(COORDINATES)
    assert facts.orthogonal == (("x", "y"), ("x", "z"), ("y", "z"))
    assert facts.coaxial == (("x", "alpha"), ("y", "beta"), ("z", "gamma"))


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


ALL = (COORDINATES,)
WRONG: list[tuple[str, str, str, tuple[Any, ...]]] = [  # what replaces which text, and the proof that must fail then
    ("3] = s\n", "3] = s**2\n", "step", ("y",)),
    ("A[j, j] = sp.cos(s)", "A[j, j] = sp.cosh(s)", "step", ("beta",)),
    ("first = {name: A.diff(step(name).symbol)", "first = {name: A", "prove_translation_columns", ALL),
    (
        "upper = {(s, w): first[s].diff(step(w).symbol)",
        "upper = {(s, w): first[s]",
        "prove_second_derivative_zeros",
        ALL,
    ),
    ("first[s].diff(step(w).symbol)", "first[s]", "prove_second_derivative_zeros", ALL),
    ("first[s].diff(step(w).symbol)", "0 * A", "prove_second_derivative_zeros", ALL),
    ("A, sp.ImmutableMatrix(D))", "A, sp.ones(4, 4))", "prove_antisymmetry", ALL),
    ("[[0, -a[2], a[1]]", "[[0, a[2], a[1]]", "prove_coaxial_swap", ()),
]


@pytest.mark.parametrize(("old", "new", "proof", "arguments"), WRONG)
def test_every_proof_fails_where_its_claim_is_wrong(old: str, new: str, proof: str, arguments: tuple[Any, ...]) -> None:
    """With a matrix in the place of another for which the claim does not hold."""
    with changed(old, new) as other, pytest.raises(InternalError, match="the proof failed"):
        getattr(other, proof)(*arguments)


def restricted(pairs: tuple[tuple[str, str], ...], active: tuple[str, ...]) -> tuple[tuple[str, str], ...]:
    return tuple(pair for pair in pairs if {*pair} <= {*active})


@pytest.mark.parametrize("active", SUBSETS[::7], ids="-".join)
def test_facts_of_few_coordinates_are_those_of_all(active: tuple[str, ...]) -> None:
    """Inactive coordinates are zero, so identities of a joint with all coordinates hold; there are no others."""
    whole, facts = derive_joint(COORDINATES), derive_joint(active)
    assert facts.steps == tuple(whole.steps[COORDINATES.index(name)] for name in active)
    for pairs in ("zero_pairs", "orthogonal", "coaxial"):
        assert getattr(facts, pairs) == restricted(getattr(whole, pairs), active)
    assert facts.constant == tuple(name for name in active if name in whole.constant)
    assert (facts.active, facts.sympy) == (active, sp.__version__)


@pytest.mark.parametrize("active", [(), ("x", "gamma"), COORDINATES], ids="-".join)
def test_facts_are_written_and_read(active: tuple[str, ...]) -> None:
    facts = derive_joint(active)
    assert JointFacts.from_json(facts.to_json()) == facts
    symbols, derivatives = {name: step(name).symbol for name in COORDINATES}, joint_derivatives(active)
    functions: dict[str, Callable[[Any], Any]] = {"": lambda x: x, "sin": sp.sin, "cos": sp.cos}

    def entry(terms: tuple[Term, ...]) -> Any:
        return sum(c * sp.prod(functions[kind](symbols[name]) for kind, name in factors) for c, factors in terms)

    found = [sp.Matrix([[entry(x) for x in row] for row in D]) for D in (facts.transform, *facts.first, *facts.second)]
    pairs = combinations_with_replacement(active, 2)
    wanted = [derivatives.first[name] for name in active] + [derivatives.second[pair] for pair in pairs]
    assert found == [joint_transform(active), *wanted]


def test_a_rotation_of_another_form_is_refused() -> None:
    with changed("A[j, j] = sp.cos(s)", "A[j, j] = sp.cosh(s)"):
        deriving = importlib.import_module("eomgen.codegen.joint.deriving")
        with pytest.raises(InternalError, match=r"the proof failed|of another form"):
            deriving.joint_step("beta")


@pytest.mark.parametrize("coordinate", COORDINATES)
def test_steps_have_the_values_of_symbolic_ones(coordinate: str) -> None:
    found, t = step(coordinate), 0.7
    expected = np.array(found.rotation.subs(found.symbol, t), dtype=float)
    (numbers,) = derive_joint((coordinate,)).steps
    assert np.allclose(np.array(numbers.rotation) @ (1.0, np.sin(t), np.cos(t)), expected, atol=1e-15)
    assert (numbers.is_rotation, numbers.axis) == (found.is_rotation, found.axis)
