"""Modes of links that work on each other: steps, stages and ranges beside dense matrices of NumPy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from eomgen.codegen.closed_form.readable import readable_closed_form
from eomgen.codegen.kernels.accelerations import implicit_step
from eomgen.codegen.kernels.derivation import Derivation
from eomgen.codegen.program.ir import finish
from eomgen.errors import DescriptionError
from eomgen.robot.model import build_model
from eomgen.robot.parameter_names import leasts
from tests.support.bending_robots import Bending, bent, with_mode_follower
from tests.support.dense_stages import dense_stage, run, staged
from tests.support.random_robots import random_robot, seeds

Array = NDArray[np.float64]
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
def test_implicit_step_is_the_dense_one(seed: int, dt: float) -> None:
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
def test_stages_are_the_dense_ones(seed: int, c: complex) -> None:
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
    assert old is not None
    assert new is not None
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
