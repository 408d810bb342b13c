"""Wrenches by the names of frames and links: rows of links by J^T w, from Pinocchio's Jacobians, in every call."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

import eomgen
from eomgen.errors import ArrayError, UnknownNameError
from eomgen.integration import integrate
from eomgen.loops import closed_equilibrium
from eomgen.robot.value import Frame, Placement
from eomgen.runtime.by_name import wrench_rows
from eomgen.state import static_equilibrium
from tests.oracles.pinocchio_models import PinocchioOracle
from tests.support.builds import Build
from tests.support.random_mechanisms import mechanism
from tests.support.random_robots import Array, random_placement, random_robot, seeds

pytestmark = [pytest.mark.quick, pytest.mark.usefixtures("unoptimised")]


def framed(robot: eomgen.Robot, rng: np.random.Generator) -> eomgen.Robot:
    """The robot with a frame on every link."""
    frames = tuple(Frame(f"at_{link.name}", link.name, random_placement(rng)) for link in robot.links)
    return replace(robot, frames=(*robot.frames, *frames))


def drawn(kernel: eomgen.Kernel, rng: np.random.Generator, lead: tuple[int, ...] = ()) -> dict[str, Array]:
    """Wrenches at frames and links that move, some of them for one state that stands for all."""
    names = [*kernel.links, *(name for name in kernel.frames if name.removeprefix("at_") in kernel.links)]
    return {
        name: rng.uniform(-5.0, 5.0, (*(lead if rng.random() < 0.5 else ()), 6))
        for name in dict.fromkeys(names)
        if rng.random() < 0.7 or name == names[-1]
    }


@pytest.mark.parametrize("seed", seeds(40, 1, 20))
def test_frames_and_links_as_jacobians_have_them(seed: int, built: Build) -> None:
    rng = np.random.default_rng(seed)
    robot = framed(random_robot(seed, tree=seed % 2 == 0, joints=(2, 4)), rng)
    kernel, oracle = built(robot), PinocchioOracle(robot)
    q, v, a = rng.uniform(-1.0, 1.0, (3, 5, kernel.n))
    wrench = drawn(kernel, rng, (5,))
    forces = kernel.external_force(q, wrench)
    for i, state in enumerate(q):
        expected = np.zeros(kernel.n)
        rows = np.zeros((len(kernel.links), 6))
        for name, w in wrench.items():
            one = w[i] if w.ndim > 1 else w
            if name in kernel.links:
                rows[kernel.links.index(name)] = one
            else:
                expected += oracle.frame_jacobian(state, name).T @ one
        expected += oracle.external_force(state, rows)
        assert np.abs(forces[i] - expected).max() <= 1e-11 * max(1.0, float(np.abs(expected).max()))
    rows = wrench_rows(kernel.calls, q, wrench)
    assert np.array_equal(forces, kernel.external_force(q, rows))
    u = kernel.inverse_dynamics(q, v, a, wrench=wrench)
    assert np.array_equal(u, kernel.inverse_dynamics(q, v, a, wrench=rows))
    assert np.abs(kernel.forward_dynamics(q, v, u, wrench=wrench) - a).max() < 1e-7
    for name, arguments in (("generalized_force", (q, v)), ("residual", (q, v, a, u)), ("reactions", (q, v, a))):
        call = getattr(kernel, name)
        assert np.array_equal(call(*arguments, wrench=wrench), call(*arguments, wrench=rows))
        one = {key: w[2] if w.ndim > 1 else w for key, w in wrench.items()}
        assert np.allclose(call(*(x[2] for x in arguments), wrench=one), call(*arguments, wrench=rows)[2], atol=1e-11)


@pytest.mark.soak
@pytest.mark.parametrize("number", seeds(0, 1, 20))
def test_closed_mechanisms(number: int, built: Build) -> None:
    m, rng = mechanism(number), np.random.default_rng(number)
    kernel = built(framed(m.robot, rng))
    wrench = drawn(kernel, rng)
    rows = wrench_rows(kernel.calls, m.q, wrench)
    for name in ("forward_dynamics", "constraint_forces"):
        call = getattr(kernel, name)
        assert np.array_equal(call(m.q, m.v, m.u, wrench=wrench), call(m.q, m.v, m.u, wrench=rows))
    a = kernel.forward_dynamics(m.q, m.v, m.u, wrench=wrench)
    cut = kernel.inverse_dynamics(m.q, m.v, a, wrench=wrench, cut=True)
    assert np.array_equal(cut, kernel.inverse_dynamics(m.q, m.v, a, wrench=rows, cut=True))


@pytest.mark.soak
def test_motions_rollouts_and_equilibria() -> None:
    robot = eomgen.load_robot("one_link")
    kernel = eomgen.build(replace(robot, frames=(Frame("tip", "link1", Placement((1.0, 0.1, 0.0))),)))
    q, v = np.array([0.0, -0.3]), np.zeros(2)
    wrench: Mapping[str, list[float]] = {"tip": [0.0, 5.0, 0.0, 0.0, 0.0, 0.2], "link1": [1.0, 0.0, 0.0, 0.0, 0.0, 0.0]}
    ways = {
        "C": integrate(kernel, q, v, 0.5, wrench=wrench, rtol=1e-9),
        "function": integrate(kernel, q, v, 0.5, wrench=lambda t, q, v: wrench, rtol=1e-9),
        "rows": integrate(kernel, q, v, 0.5, wrench=lambda t, q, v: wrench_rows(kernel.calls, q, wrench), rtol=1e-9),
    }
    rolled = kernel.rollout(q, v, np.zeros(2), duration=0.5, rtol=1e-9, loads={"wrench": wrench})[0]
    for motion in ways.values():
        assert np.abs(motion.q[-1] - rolled[-1]).max() < 1e-6
    at_rest, _ = static_equilibrium(kernel, q, held=["joint1.gamma"], wrench=wrench)
    drive = kernel.inverse_dynamics(at_rest, v, v, wrench=wrench)
    assert abs(drive[0]) < 1e-8
    assert abs(kernel.inverse_dynamics(at_rest, v, v)[0]) > 0.1


@pytest.mark.soak
def test_gradients_by_named_wrenches_are_in_their_order() -> None:
    kernel = eomgen.build("one_link")
    q, zero = np.array([0.0, 0.3]), np.zeros(2)
    wrench: dict[str, Array] = {"tcp": np.array([1.0, 2.0, 0.5, 0.1, 0.2, 0.3]), "link1": np.array([0.5] + [0.0] * 5)}

    def last(t: Array, q: Array, v: Array) -> tuple[float, Array, Array]:
        by_q = np.zeros_like(q)
        by_q[-1] = 1.0
        return float(q[-1].sum()), by_q, np.zeros_like(v)

    def of(wrenches: dict[str, Array]) -> tuple[float, dict[str, Array]]:
        options = {"duration": 0.2, "rtol": 1e-10, "loads": {"wrench": wrenches}}
        value, slopes = kernel.rollout_gradient(q, zero, zero, loss=last, **options)  # type: ignore[arg-type]
        return value, slopes["loads"]

    slopes = of(wrench)[1]
    for k, (name, numbers) in enumerate(wrench.items()):
        for i, step in enumerate(1e-5 * np.eye(6)):
            ends = [of({**wrench, name: numbers + x})[0] for x in (step, -step)]
            assert slopes[f"wrench[{k}]"][0, 0, i] == pytest.approx((ends[0] - ends[1]) / 2e-5, rel=1e-6, abs=1e-9)


@pytest.mark.soak
def test_equilibria_of_loops() -> None:
    robot = eomgen.load_robot("four_bar")
    springs = [
        replace(x, coordinates={"gamma": replace(x.coordinates["gamma"], stiffness=200.0)}) for x in robot.joints
    ]
    kernel = eomgen.build(replace(robot, joints=tuple(springs)))
    force = {"tcp": [0.0, -3.0, 0.0, 0.0, 0.0, 0.0]}
    q = closed_equilibrium(kernel, kernel.home, wrench=force)
    virtual = kernel.residual(q, 0.0 * q, 0.0 * q, 0.0 * q, wrench=force)
    tangent = np.linalg.svd(kernel.constraint_jacobian(q))[2][-1]
    assert abs(tangent @ virtual) < 1e-7
    assert np.abs(q - closed_equilibrium(kernel, kernel.home)).max() > 1e-4


def test_parameters_move_the_centre_of_mass(built: Build) -> None:
    robot = replace(eomgen.load_robot("ur5"), tunable=tuple(f"links.link6.com.{axis}" for axis in "xyz"))
    kernel = built(robot)
    q, force = np.linspace(0.1, 0.6, 6), [1.0, 2.0, 3.0, 0.1, 0.2, 0.3]
    before = kernel.external_force(q, {"tcp": force})
    assert np.abs(before - kernel.frame_jacobian(q, "tcp").T @ force).max() < 1e-12
    kernel.parameters["links.link6.com.x"] += 0.5
    assert np.abs(kernel.external_force(q, {"tcp": force}) - before).max() < 1e-12
    at_link = kernel.external_force(q, {"link6": force})
    kernel.parameters["links.link6.com.x"] -= 0.5
    assert np.abs(kernel.external_force(q, {"link6": force}) - at_link).max() > 0.1


def test_float32_and_no_wrench(built: Build) -> None:
    kernel = built(eomgen.load_robot("ur5"), dtype="float32")
    q = np.linspace(0.1, 0.6, 6, dtype=np.float32)
    force = kernel.external_force(q, {"tcp": [1.0, 2.0, 3.0, 0.1, 0.2, 0.3]})
    assert force.dtype == np.float32
    assert np.abs(force - kernel.frame_jacobian(q, "tcp").T @ [1.0, 2.0, 3.0, 0.1, 0.2, 0.3]).max() < 1e-5
    assert not kernel.external_force(q, {}).any()


def test_what_cannot_be_given(built: Build) -> None:
    kernel = built(eomgen.load_robot("ur5"))
    q = np.zeros(6)
    with pytest.raises(UnknownNameError, match=r"wrench: 'tpc' is unknown; did you mean 'tcp'"):
        kernel.inverse_dynamics(q, q, q, wrench={"tpc": np.zeros(6)})
    with pytest.raises(UnknownNameError, match=r"wrench: 'base' does not move; allowed: 'tcp', 'link1'"):
        kernel.forward_dynamics(q, q, q, wrench={"base": np.zeros(6)})
    with pytest.raises(UnknownNameError, match=r"wrench: 3 is unknown; known: tcp, link1"):
        kernel.external_force(q, {3: np.zeros(6)})  # type: ignore[dict-item]
    for wrong in ([1.0, 2.0], "hard", None, [np.nan] * 6, 3.0, ["1"] * 6, [1j] * 6, np.ma.zeros(6)):
        with pytest.raises(ArrayError, match=r"wrench: tcp: .*allowed: six finite numbers"):
            kernel.reactions(q, q, q, wrench={"tcp": wrong})  # type: ignore[dict-item]
    with pytest.raises(ArrayError, match=r"wrench: tcp: leading axes|wrench: tcp: 3 states, but 2"):
        kernel.external_force(np.zeros((2, 6)), {"tcp": np.zeros((3, 6))})
    with pytest.raises(ArrayError, match=r"wrench: tcp: got shape \(3, 6\); allowed: six finite numbers"):
        kernel.rollout(q, q, q, duration=0.1, loads={"wrench": {"tcp": np.zeros((3, 6))}})
    with pytest.raises(UnknownNameError, match="wrench: 'tpc' is unknown"):
        integrate(kernel, q, q, 0.1, wrench={"tpc": np.zeros(6)})
    twice = replace(eomgen.load_robot("ur5"), frames=(Frame("link6", "link6", Placement((0.1, 0.0, 0.0))),))
    with pytest.raises(UnknownNameError, match="'link6' names a frame and a link"):
        built(twice).external_force(q, {"link6": np.zeros(6)})
