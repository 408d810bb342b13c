"""Wrenches, blocks of M and C and functions of frames by name, and what notebooks show of kernels and robots."""

from __future__ import annotations

import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest

import eomgen
from eomgen.codegen.joint.zeros import zero_map
from eomgen.errors import ArrayError, InputError, UnknownNameError
from eomgen.integration import integrate
from eomgen.loops import closed_equilibrium
from eomgen.pipeline.options import Options
from eomgen.robot.model import build_model
from eomgen.robot.value import Frame, Placement
from eomgen.runtime.bound import wrench_rows
from eomgen.runtime.levels import BASE
from eomgen.state import static_equilibrium
from tests.oracles.pinocchio_models import PinocchioOracle
from tests.oracles.unpruned import brute_force
from tests.support.builds import Build
from tests.support.random_mechanisms import mechanism
from tests.support.random_robots import Array, random_placement, random_robot, random_state, seeds
from tests.support.refusals import refused
from tests.support.small_robots import chain, generic

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
    forces = kernel.functions.external_force(q, wrench)
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
    assert np.array_equal(forces, kernel.functions.external_force(q, rows))
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
    at_rest, _ = static_equilibrium(kernel, q, fixed=["joint1.gamma"], wrench=wrench)
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
    tangent = np.linalg.svd(kernel.functions.constraint_jacobian(q))[2][-1]
    assert abs(tangent @ virtual) < 1e-7
    assert np.abs(q - closed_equilibrium(kernel, kernel.home)).max() > 1e-4


def test_parameters_move_the_centre_of_mass(built: Build) -> None:
    robot = replace(eomgen.load_robot("ur5"), tunable=tuple(f"links.link6.com.{axis}" for axis in "xyz"))
    kernel = built(robot)
    q, force = np.linspace(0.1, 0.6, 6), [1.0, 2.0, 3.0, 0.1, 0.2, 0.3]
    before = kernel.functions.external_force(q, {"tcp": force})
    assert np.abs(before - kernel.frame_jacobian(q, "tcp").T @ force).max() < 1e-12
    kernel.parameters["links.link6.com.x"] += 0.5
    assert np.abs(kernel.functions.external_force(q, {"tcp": force}) - before).max() < 1e-12
    at_link = kernel.functions.external_force(q, {"link6": force})
    kernel.parameters["links.link6.com.x"] -= 0.5
    assert np.abs(kernel.functions.external_force(q, {"link6": force}) - at_link).max() > 0.1


def test_float32_and_no_wrench(built: Build) -> None:
    kernel = built(eomgen.load_robot("ur5"), dtype="float32")
    q = np.linspace(0.1, 0.6, 6, dtype=np.float32)
    force = kernel.functions.external_force(q, {"tcp": [1.0, 2.0, 3.0, 0.1, 0.2, 0.3]})
    assert force.dtype == np.float32
    assert np.abs(force - kernel.frame_jacobian(q, "tcp").T @ [1.0, 2.0, 3.0, 0.1, 0.2, 0.3]).max() < 1e-5
    assert not kernel.functions.external_force(q, {}).any()


def test_what_cannot_be_given(built: Build) -> None:
    kernel = built(eomgen.load_robot("ur5"))
    q = np.zeros(6)
    for call, name, said in (
        (kernel.inverse_dynamics, "tpc", "wrench: 'tpc' is unknown; did you mean 'tcp'"),
        (kernel.forward_dynamics, "base", "wrench: 'base' does not move; allowed: 'tcp', 'link1'"),
        (kernel.reactions, 3, "wrench: 3 is unknown; known: tcp, link1"),
    ):
        refused(UnknownNameError, said, call, q, q, q, wrench={name: np.zeros(6)})
    for wrong in ([1.0, 2.0], "hard", None, [np.nan] * 6, 3.0, ["1"] * 6, [1j] * 6, np.ma.zeros(6)):
        with pytest.raises(ArrayError, match=r"wrench: tcp: .*allowed: six finite numbers"):
            kernel.reactions(q, q, q, wrench={"tcp": wrong})  # type: ignore[dict-item]
    with pytest.raises(ArrayError, match=r"wrench: tcp: leading axes|wrench: tcp: 3 states, but 2"):
        kernel.functions.external_force(np.zeros((2, 6)), {"tcp": np.zeros((3, 6))})
    with pytest.raises(ArrayError, match=r"wrench: tcp: got shape \(3, 6\); allowed: six finite numbers"):
        kernel.rollout(q, q, q, duration=0.1, loads={"wrench": {"tcp": np.zeros((3, 6))}})
    refused(UnknownNameError, "wrench: 'tpc' is unknown", integrate, kernel, q, q, 0.1, wrench={"tpc": np.zeros(6)})
    twice = replace(eomgen.load_robot("ur5"), frames=(Frame("link6", "link6", Placement((0.1, 0.0, 0.0))),))
    with pytest.raises(UnknownNameError, match="'link6' names a frame and a link"):
        built(twice).functions.external_force(q, {"link6": np.zeros(6)})


KERNELS = ("mass_matrix", "christoffel")


@pytest.mark.soak
@pytest.mark.parametrize("seed", range(6))
def test_blocks_of_random_robots(seed: int, built: Build) -> None:
    """Every block equals the traces of eqs. (11) and (12) on floats; absent are those that the geometry cannot help."""
    rng = np.random.default_rng(seed)
    robot = generic(random_robot(rng, joints=(2, 4), tree=seed % 2 == 1, armature=False), rng)
    kernel, model = built(robot, *KERNELS), build_model(robot)
    q = rng.uniform(0.2, 1.2, kernel.n)
    M, C = brute_force(model, q)
    blocks = kernel.blocks(q)
    where = {body.joint: list(body.indices) for body in model.bodies}
    for key in product(where, repeat=2):
        expected = M[np.ix_(*(where[name] for name in key))]
        assert (key in blocks.mass) == bool(np.abs(expected).max() > 1e-12)
        assert np.abs(blocks.mass.get(key, np.zeros_like(expected)) - expected).max() < 1e-12
    for key in product(where, repeat=3):
        expected = C[np.ix_(*(where[name] for name in key))]
        assert (key in blocks.christoffel) == bool(np.abs(expected).max() > 1e-12)
        assert np.abs(blocks.christoffel.get(key, np.zeros_like(expected)) - expected).max() < 1e-12
    for s, v in product(range(kernel.n), repeat=2):
        names = kernel.coordinates[s], kernel.coordinates[v]
        assert blocks.mass.get(names, 0.0) == pytest.approx(M[s, v], abs=1e-12)
        assert (names in blocks.mass) == zero_map(model).mass_matrix.mask[s, v]


def test_sum_over_the_papers_matrices_is_the_inertial_force_of_pinocchio(built: Build) -> None:
    """Eq. (10) term by term, with the kinds of coordinates as in the paper."""
    kinds = ("x", "y", "z", "alpha", "beta", "gamma")
    for seed in range(4):
        robot = random_robot(seed, joints=(2, 3), tree=seed == 2, armature=False)
        state, kernel, oracle = random_state(robot, seed), built(robot, *KERNELS), PinocchioOracle(robot)
        expected = oracle.mass_matrix(state.q) @ state.a + oracle.bias_force(state.q, state.v)
        blocks = kernel.blocks(state.q)

        def of(kind: str, values: np.ndarray, kernel: eomgen.Kernel = kernel) -> np.ndarray:
            by_name = dict(zip(kernel.coordinates, values, strict=True))
            return np.array([by_name.get(f"{joint}.{kind}", 0.0) for joint in kernel.joints])

        for i, s in enumerate(kernel.coordinates):
            total = sum(blocks.row(s, kind) @ of(kind, state.a) for kind in kinds)
            for v, w in product(kinds, repeat=2):
                total += of(v, state.v) @ blocks.matrix(s, v, w) @ of(w, state.v)
            assert total == pytest.approx(expected[i], abs=1e-10 * np.abs(expected).max())


def test_the_papers_robot(built: Build) -> None:
    """The coefficients under eqs. (17) and (18), m = l = 1; two states at once."""
    gamma = np.array([0.3, -1.1])
    blocks = built(eomgen.load_robot("one_link"), *KERNELS).blocks(np.stack([np.zeros(2), gamma], axis=1))
    assert np.allclose(blocks.mass["joint1.x", "joint1.gamma"], -np.sin(gamma) / 2)
    assert np.allclose(blocks.mass["joint1.gamma", "joint1.gamma"], 1 / 3)
    assert np.allclose(blocks.christoffel["joint1.x", "joint1.gamma", "joint1.gamma"], -np.cos(gamma) / 2)
    assert blocks.mass["joint1", "joint1"].shape == (2, 2, 2)
    assert blocks.mass["joint1.x", "joint1"].shape == (2, 2)
    assert blocks.row("joint1.x", "gamma").shape == (2, 1)
    assert np.allclose(blocks.matrix("joint1.x", "gamma", "gamma")[:, 0, 0], -np.cos(gamma) / 2)
    assert ("joint1.x", "joint1.x", "joint1.gamma") not in blocks.christoffel
    assert list(blocks.mass) == [("joint1", "joint1")]
    assert len(blocks.christoffel) == 1


@pytest.mark.soak
def test_36_coordinates_have_as_many_entries_as_the_map_says(built: Build) -> None:
    robot = chain(6)
    kernel = built(robot, *KERNELS)
    blocks = kernel.blocks(np.random.default_rng(0).uniform(0.2, 1.2, kernel.n))
    upper = np.triu(np.ones((36, 36), dtype=bool))
    assert int((blocks.christoffel.mask & upper).sum()) == 10_602
    assert np.array_equal(np.abs(blocks.christoffel.whole) > 1e-13, blocks.christoffel.mask)


def test_what_is_asked_wrongly_is_said(built: Build) -> None:
    blocks = built(chain(2), *KERNELS).blocks(np.zeros(12))
    for ask, words in (
        (lambda: blocks.mass["joint1", "jiont2"], ("jiont2", "joint2")),
        (lambda: blocks.mass.get(("joint1", "jiont2")), ("jiont2",)),
        (lambda: blocks.mass["joint1.x", "joint1.y"], ("vanishes identically", "joint1.x, joint1.y")),
        (lambda: blocks.mass["joint1"], ("tuple of 2",)),  # type: ignore[index]
        (lambda: blocks.row("joint1.x", "delta"), ("delta", "gamma")),
        (lambda: blocks.row("joint1", "x"), ("joint1", "coordinates")),
        (lambda: blocks.matrix("joint9.x", "x", "x"), ("joint9.x",)),
    ):
        raised = refused(UnknownNameError, "", ask)
        assert all(word in str(raised) for word in words)
    refused(UnknownNameError, "without the kernel christoffel", built(chain(2), "mass_matrix").blocks, np.zeros(12))


@pytest.mark.soak
def test_a_generated_package_has_them_too(tmp_path: Path) -> None:
    eomgen.generate(eomgen.load_robot("one_link"), tmp_path, Options(("all",), flags=("-O0",), levels=(BASE,)))
    code = (
        "import sys, one_link; assert 'eomgen' not in sys.modules;"
        "one_link.parameters['gravity.y'] = -1.0; one_link.rollout([0.0, 0.0], [0.0, 0.0], [0.0, 0.0], 1e-3, 2);"
        "import eomgen; b = eomgen.Kernel(one_link.kernel.raw.libraries).blocks([0.0, 0.3]);"
        "print(float(b.mass['joint1.x', 'joint1.x']), sorted(b.christoffel))"
    )
    found = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True)
    assert found.stdout == "1.0 [('joint1', 'joint1', 'joint1')]\n", found.stderr


def cells(html: str) -> dict[str, str]:
    table = ElementTree.fromstring(html)
    return {str(row[0].text): str(row[1].text) for row in table.iter("tr")}


def test_a_kernel(built: Build) -> None:
    kernel = built(eomgen.load_robot("one_link"), "mass_matrix", "rollout")
    assert repr(kernel) == "<Kernel one_link: 2 coordinates, float64>"
    found = cells(kernel._repr_html_())
    assert (found["coordinates"], found["functions"], found["threads"], found["checks"]) == ("2", "2", "1", "True")
    assert "<caption>Kernel one_link</caption>" in kernel._repr_html_()
    assert kernel.parameters._ipython_key_completions_() == list(kernel.parameters)
    assert len(kernel.parameters._ipython_key_completions_()) > 0


def test_a_robot() -> None:
    robot = eomgen.load_robot("one_link")
    found = cells(robot._repr_html_())
    assert (found["links"], found["joints"], found["coordinates"], found["frames"]) == ("1", "1", "2", "tcp")
    odd = replace(robot, source="<b>&\"'.toml")
    assert cells(odd._repr_html_())["source"] == "<b>&\"'.toml"


def test_functions_of_frames_may_be_asked_for_by_their_names(built: Build) -> None:
    robot = eomgen.load_robot("one_link")
    kernel = built(robot, "frame_pose")
    assert kernel.frame_pose([0.2, 0.5], "tcp").shape == (4, 4)
    other = built(robot, "kinematics", "frame_jacobian", "frame_pose")
    assert set(other.raw.functions) == set(kernel.raw.functions) == {"frame_pose", "frame_jacobian"}
    refused(InputError, r"^kernels: 'pose' is unknown; allowed: mass_matrix, .*frame_pose", built, robot, "pose")
