"""Constraints of cut joints: their zero sets, Pinocchio's kinematics, complex steps, and what is refused."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen.codegen.kernels.equations import derive, derive_equations
from eomgen.codegen.kernels.signatures import CLOSURE_KERNELS, KERNELS, OWN_KERNELS
from eomgen.description.load import robot_from_toml
from eomgen.errors import DescriptionError, InputError, LoopError
from eomgen.integration.solve import integrate
from eomgen.pipeline.options import Options
from eomgen.pipeline.stages import make_source
from eomgen.robot.geometry import IDENTITY
from eomgen.robot.joint_types import CUTS
from eomgen.robot.model import build_model
from eomgen.robot.value import COORDINATES, Coordinate, Frame, Joint, Link, Loop, Placement, Robot
from tests.oracles.complex_step import complex_jacobian
from tests.support.builds import Build
from tests.support.linkages import FREE
from tests.support.optional import needs
from tests.support.random_robots import Array, random_robot, random_state, seeds, with_random_loops
from tests.support.refusals import refused
from tests.support.soak import soaked

pytestmark = pytest.mark.usefixtures("unoptimised")

TYPES = tuple(CUTS)


def looped(seed: int, **options: Any) -> Robot:
    """A random robot with a loop of every type, and its cut frames as frames too."""
    options = {"joints": (2, 5), "tree": seed % 2 == 0, "types": ("revolute", "prismatic", "fixed", "free")} | options
    robot = with_random_loops(random_robot(seed, **options), seed, TYPES)
    frames = [
        Frame(f"{loop.name}_{side}", link, placement)
        for loop in robot.loops
        for side, link, placement in zip("ab", loop.links, loop.placements, strict=True)
    ]
    return replace(robot, frames=tuple(frames))


@pytest.mark.parametrize("kind", soaked(TYPES, list(TYPES)[::2]))
def test_a_cut_joint_leaves_its_freedoms_and_no_other(kind: str, built: Build) -> None:
    """A free body, cut to the ground: g vanishes exactly on the joint's own motions, where J has full rank."""
    joint = Joint("free", "base", "body", "free", coordinates={name: Coordinate() for name in COORDINATES})
    link = Link("body", 1.0, (0.0, 0.0, 0.0), (1.0, 1.0, 1.0, 0.0, 0.0, 0.0))
    robot = Robot(f"free_{kind}", (0.0, 0.0, 0.0), (link,), (joint,), loops=(Loop("cut", ("base", "body"), kind),))
    kernel = built(robot, *CLOSURE_KERNELS)
    assert kernel.constraints == tuple(f"cut.{part.name}" for part in CUTS[kind])
    assert kernel.loops == {"cut": kind}
    free = [COORDINATES.index(name) for name in FREE[kind]]
    rng = np.random.default_rng(1)
    for _ in range(50):
        q = np.zeros(6)
        q[free] = rng.uniform(-1, 1, len(free)) * np.array([2.0, 2.0, 2.0, 3.1, 1.5, 3.1])[free]
        assert np.abs(kernel.functions.constraint(q)).max() <= 1e-15
        J = kernel.functions.constraint_jacobian(q)
        assert np.linalg.svd(J, compute_uv=False)[-1] >= 0.07  # as far as beta = +-pi/2, where Euler angles are not
        assert np.abs(J[:, free]).max(initial=0.0) <= 1e-15
        assert len(CUTS[kind]) + len(free) == 6
        for blocked in set(range(6)) - set(free):
            away = q.copy()
            away[blocked] += 0.1
            assert np.abs(kernel.functions.constraint(away)).max() >= 0.09 * abs(np.cos(q[4])) or kind == "universal"
            assert np.abs(kernel.functions.constraint(away)).max() > 1e-4


@pytest.mark.parametrize("seed", seeds(300, 1, 8))
def test_constraints_equal_pinocchios_kinematics(seed: int, built: Build) -> None:
    needs("pinocchio")
    from tests.oracles.pinocchio_models import PinocchioOracle

    robot = looped(seed)
    kernel, oracle, rng = built(robot, *CLOSURE_KERNELS), PinocchioOracle(robot), np.random.default_rng(seed)
    for _ in range(3):
        q = random_state(robot, rng).q
        g, J, row = kernel.functions.constraint(q), kernel.functions.constraint_jacobian(q), 0
        for number, loop in enumerate(robot.loops):
            A, B = (oracle.frame_pose(q, f"{loop.name}_{side}") for side in "ab")
            X = np.linalg.inv(A) @ B
            assert np.abs(kernel.functions.cut_poses(q)[number] - X).max() <= 1e-13
            J_a, J_b = (oracle.frame_jacobian(q, f"{loop.name}_{side}") for side in "ab")
            w = A[:3, :3].T @ (J_b[3:] - J_a[3:])
            d = B[:3, 3] - A[:3, 3]
            slide = A[:3, :3].T @ (J_b[:3] - J_a[:3] - np.cross(J_a[3:], d, axisa=0, axisc=0))
            for part in CUTS[loop.type]:
                value, rates = 0.0, np.zeros(kernel.n)
                if part.axis is not None:
                    value, rates = X[part.axis, 3], slide[part.axis]
                for factor, i, j in part.products:
                    value += factor * X[i, j]
                    rates = rates + factor * np.cross(w, X[:3, j], axisa=0, axisc=0)[i]
                assert abs(g[row] - value) <= 1e-13
                assert np.abs(J[row] - rates).max() <= 1e-13 * max(1.0, np.abs(rates).max())
                row += 1
        assert row == len(kernel.constraints)


@pytest.mark.parametrize("seed", seeds(310, 1, 8))
def test_derivatives_equal_complex_steps(seed: int, built: Build) -> None:
    """J is dg/dq and the bias J_dot v, to the last digits: complex steps have no round-off."""
    robot = looped(seed)
    kernel, s = built(robot, *CLOSURE_KERNELS), random_state(robot, seed)
    J = complex_jacobian(robot, "constraint", {"q": s.q}, "q")
    assert np.abs(kernel.functions.constraint_jacobian(s.q) - J).max() <= 1e-14 * max(1.0, np.abs(J).max())
    turning = complex_jacobian(robot, "constraint_jacobian", {"q": s.q}, "q").reshape(*J.shape, kernel.n)
    bias = turning @ s.v @ s.v
    assert np.abs(kernel.functions.constraint_bias(s.q, s.v) - bias).max() <= 1e-13 * max(1.0, np.abs(bias).max())


def test_rates_of_change_along_a_motion(built: Build) -> None:
    """J v and J a + J_dot v are the derivatives of g along q(t), by finite differences of g alone."""
    robot = looped(321)
    kernel, s, h = built(robot, *CLOSURE_KERNELS), random_state(robot, 321), 1e-4

    def g(t: float) -> Array:
        return np.asarray(kernel.functions.constraint(s.q + s.v * t + s.a * t * t / 2))

    rate = kernel.functions.constraint_jacobian(s.q) @ s.v
    second = kernel.functions.constraint_jacobian(s.q) @ s.a + kernel.functions.constraint_bias(s.q, s.v)
    assert np.abs((g(h) - g(-h)) / (2 * h) - rate).max() <= 1e-6 * np.abs(rate).max()
    assert np.abs((g(h) - 2 * g(0.0) + g(-h)) / h**2 - second).max() <= 1e-5 * np.abs(second).max()


@pytest.mark.soak
@pytest.mark.parametrize("dtype", ["float64", pytest.param("float32", marks=pytest.mark.soak)])
def test_batches_and_threads(dtype: str) -> None:
    """C without warnings; a batch gives what single states give, in one thread and in two."""
    robot = looped(330, joints=(2, 2))
    kernel = eomgen.build(robot, kernels=CLOSURE_KERNELS, dtype=dtype, flags=("-Werror", "-O1"))
    rng = np.random.default_rng(3)
    q, v = (rng.uniform(-1, 1, (600, kernel.n)).astype(dtype) for _ in "qv")
    calls = [
        (kernel.functions.constraint, (q,)),
        (kernel.functions.constraint_jacobian, (q,)),
        (kernel.functions.cut_poses, (q,)),
    ]
    limit = 1e-13 if dtype == "float64" else 1e-4
    for call, arrays in [*calls, (kernel.functions.constraint_bias, (q, v))]:
        batch = call(*arrays)
        single = np.array([call(*(x[i] for x in arrays)) for i in range(21)])
        assert np.abs(batch[:21] - single).max() <= limit * max(1.0, np.abs(single).max())
        kernel.threads = 2
        assert np.array_equal(call(*arrays), batch)
        kernel.threads = 1


def test_what_moves_both_sides_is_not_in_the_constraint() -> None:
    """Coordinates behind which both links hang have columns of zeros that cost nothing."""
    robot = random_robot(5, joints=(4, 4), rigid=True, types=("revolute",))
    loop = Loop("loop", ("link2", "link4"), "revolute", (Placement(), Placement((0.1, 0.2, 0.3), IDENTITY)))
    model = build_model(replace(robot, loops=(loop,)))
    read = {i.leaf for kernel in CLOSURE_KERNELS for i in derive(model, kernel).instructions if i.op == "input"}
    assert {index for array, index in read if array in "qv"} == {2, 3}


@pytest.mark.soak
def test_loops_do_not_change_the_tree(built: Build) -> None:
    """Kernels of the tree are the same programs with and without loops, and without loops there is nothing of them."""
    robot = random_robot(9, joints=(2, 2))
    with_loops = with_random_loops(robot, 9, TYPES)
    one, other = (derive_equations(build_model(r)) for r in (robot, with_loops))
    of_loops = {name for name, x in OWN_KERNELS.items() if x.needs in ("loops", "constraints", "cuts")}
    assert not set(one.programs) & of_loops
    assert set(other.kernels) - set(one.kernels) == of_loops
    of_tree = {name: f"tree_{name}" if KERNELS[name].closed else name for name in one.programs if name in KERNELS}
    for name, same in of_tree.items():
        p, q = one.programs[name], other.programs[same]
        assert (p.instructions, p.outputs) == (q.instructions, q.outputs), name
    assert {name for name, same in of_tree.items() if same != name} == {
        *("inverse_dynamics", "forward_dynamics", "forward_dynamics_jacobian", "reactions"),
    }
    assert built(robot, "mass_matrix").constraints == ()


def test_a_generated_header_has_the_constraints() -> None:
    header = make_source(eomgen.load_robot("bennett"), Options(kernels=CLOSURE_KERNELS)).header
    assert "joint4.alpha" in header
    assert "int bennett_constraint_bias(const double *h, const double *q, const double *v, double *out);" in header


URDF = """<robot name="chain">
<link name="ground"/>
<link name="arm"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="turn" type="continuous"><parent link="ground"/><child link="arm"/><axis xyz="0 1 0"/></joint></robot>"""


def test_a_loop_of_an_urdf(tmp_path: Any) -> None:
    """'base' is the URDF's root link there, too."""
    (tmp_path / "chain.urdf").write_text(URDF)
    text = 'urdf = "chain.urdf"\n[[loops]]\nname = "close"\nlinks = ["base", "arm"]\ntype = "spherical"\n'
    assert robot_from_toml(text, folder=tmp_path).loops[0].links == ("ground", "arm")


def test_refusals(built: Build) -> None:
    robot = eomgen.load_robot("four_bar")
    weld = replace(robot.joints[1], type="fixed", coordinates={})
    stiff = replace(robot, joints=(robot.joints[0], weld, robot.joints[2]))
    with pytest.raises(DescriptionError, match=r"loops\.joint4\.links.*'crank'.*'coupler' do not move against"):
        build_model(replace(stiff, loops=(replace(robot.loops[0], links=("crank", "coupler")),)))
    for change, said in (
        ({"links": ("base", "arm")}, "links.*'arm'.*rocker"),
        ({"type": "hinge"}, "type.*'hinge'.*revolute"),
    ):
        with pytest.raises(DescriptionError, match=rf"loops\.joint4\.{said}"):  # made by hand, not read
            build_model(replace(robot, loops=(replace(robot.loops[0], **change),)))
    with pytest.raises(
        InputError, match=r"'constraint' is for robots with rigid \[\[loops\]\] or \[\[couplings\]\], and ur5 has none"
    ):
        eomgen.build(eomgen.load_robot("ur5"), kernels=("constraint",))


@pytest.mark.soak
def test_dynamics_of_the_open_tree_are_not_taken_for_those_of_the_robot(built: Build) -> None:
    needs("pinocchio")
    from eomgen.state.equilibrium import static_equilibrium
    from tests.oracles.pinocchio_models import PinocchioOracle

    robot = with_random_loops(random_robot(11, joints=(3, 3)), 11, ("revolute",))
    kernel, oracle, s = built(robot), PinocchioOracle(robot), random_state(robot, 1)
    found = kernel.forward_dynamics(s.q, s.v, s.u, cut=True)
    assert np.abs(found - oracle.forward_dynamics(s.q, s.v, s.u)).max() <= 1e-9 * np.abs(found).max()
    assert kernel.forward_dynamics_jacobian(s.q, s.v, s.u, cut=True)[2].shape == (kernel.n, kernel.n)
    expected = oracle.reactions(s.q, s.v, s.a)
    assert np.abs(kernel.reactions(s.q, s.v, s.a, cut=True) - expected).max() <= 1e-11 * np.abs(expected).max()
    with pytest.raises(InputError, match=rf"{robot.name} is to be closed; see eomgen\.loops\.closed_equilibrium"):
        static_equilibrium(kernel, s.q)
    for method, last in (
        (kernel.forward_dynamics, s.u),
        (kernel.forward_dynamics_jacobian, s.u),
        (kernel.inverse_dynamics, s.a),
        (kernel.reactions, s.a),
    ):
        refused(LoopError, rf"^{method.__name__}: {robot.name}: loop loop1 is open: ", method, s.q, s.v, last)
    refused(LoopError, "loop1 is open", integrate, kernel, s.q, s.v, 0.1)
    refused(LoopError, "loop1 is open", integrate, kernel, s.q, s.v, 0.1, method="scipy:Radau")


def test_placements_default_to_the_links_frames() -> None:
    loop = '[[loops]]\nname = "loop"\nlinks = ["base", "a"]\ntype = "fixed"\n'
    joint = '[[joints]]\nname = "j"\nparent = "base"\nchild = "a"\ntype = "revolute"\n'
    text = f'name = "r"\n[[links]]\nname = "a"\nmass = 1\n{joint}{loop}'
    assert robot_from_toml(text).loops == (Loop("loop", ("base", "a"), "fixed"),)
    placed = robot_from_toml(text + "placements = [{ xyz = [1, 2, 3] }, { rpy = [0, 0, 0.5] }]")
    first, second = placed.loops[0].placements
    assert first.xyz == (1.0, 2.0, 3.0)
    assert second.rpy == (0.0, 0.0, 0.5)
