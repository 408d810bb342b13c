"""Closing by the kernel: one state and many, several roots, rates, rank, rest; against singular values."""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np
import pytest

import eomgen
from eomgen.codegen.kernels.constraint_rows import general_rank
from eomgen.codegen.kernels.signatures import OWN_KERNELS
from eomgen.description.load import builtin_robots, robot_from_toml
from eomgen.errors import InputError, IntegrationError, IntegrationStopped, LoopError, SingularError, UnknownNameError
from eomgen.integration import integrate
from eomgen.loops import closed_equilibrium, redundancy
from eomgen.loops.chart import Chart
from eomgen.pipeline.mechanisms import BRANCHES, Mobility, assembly_kernels
from eomgen.robot.geometry import IDENTITY
from eomgen.robot.model import build_model
from eomgen.robot.parameter_names import expand_tunable
from eomgen.robot.value import Coordinate, Placement, Robot
from eomgen.simulation.segments import joined_info
from tests.loops.test_elastic_cuts import linkages
from tests.oracles.by_singular_values import ClosedLoops
from tests.support.builds import Build
from tests.support.linkages import KERNELS
from tests.support.methods import method_of
from tests.support.refusals import refused

pytestmark = [pytest.mark.usefixtures("unoptimised")]

GEARED = """
name = "geared"
gravity = [0.0, -9.81, 0.0]
driven = ["a.gamma"]
links = [
  { name = "one", mass = 1.0, com = [0.1, 0, 0], inertia = { xx = 0.1, yy = 0.1, zz = 0.1 } },
  { name = "two", mass = 1.0, com = [0.1, 0, 0], inertia = { xx = 0.1, yy = 0.1, zz = 0.1 } },
]
joints = [
  { name = "a", parent = "base", child = "one", type = "revolute" },
  { name = "b", parent = "base", child = "two", type = "revolute", placement = { xyz = [0.5, 0, 0] } },
]
[[couplings]]
name = "gear"
of = "b.gamma"
to = { "a.gamma" = -2.0 }
"""


@pytest.fixture
def four_bar(built: Build) -> eomgen.Kernel:
    return built(eomgen.load_robot("four_bar"), *KERNELS)


def test_many_guesses_close_as_each_alone_does(four_bar: eomgen.Kernel) -> None:
    guesses = np.array([[0.5, 0.2, 1.2], [1.0, -0.5, 1.0], [2.0, -0.3, 1.9], [-2.5, 2.0, 1.0]])
    found = four_bar.assemble(guesses, ["joint1.gamma"])
    assert found.shape == guesses.shape
    assert np.abs(four_bar.functions.constraint(found)).max() <= 1e-12
    assert (found[:, 0] == guesses[:, 0]).all()
    oracle = ClosedLoops(four_bar)
    for one, guess in zip(found, guesses, strict=True):
        assert np.array_equal(four_bar.assemble(guess, ["joint1.gamma"]), one)
        assert np.abs(oracle.consistent_positions(guess, held=["joint1.gamma"]) - one).max() <= 1e-10
    rates = four_bar.project_velocity(found, [1.0, 2.0, 3.0])
    for one, q in zip(rates, found, strict=True):
        assert np.abs(oracle.consistent_velocities(q, [1.0, 2.0, 3.0]) - one).max() <= 1e-12
        assert np.abs(four_bar.functions.constraint_jacobian(q) @ one).max() <= 1e-13


def test_both_ways_to_close_a_four_bar(four_bar: eomgen.Kernel) -> None:
    """Two circles meet in two points: rocker angles mirrored at the line from the crank's end to the rocker's pivot."""
    guess = [1.0, -0.5, 1.4]
    found = four_bar.assemble(guess, ["joint1.gamma"], roots=5)
    assert found.shape == (2, 3)
    assert np.abs(four_bar.functions.constraint(found)).max() <= 1e-12
    assert np.abs(found[0] - four_bar.assemble(guess, ["joint1.gamma"])).max() <= 1e-9
    end = 0.2 * np.array([np.cos(1.0), np.sin(1.0)])
    line = np.arctan2(*(end - [0.5, 0.0])[::-1])
    assert abs(np.remainder(found[:, 2].sum() - 2.0 * line + np.pi, 2.0 * np.pi) - np.pi) <= 1e-9
    assert four_bar.assemble(guess, ["joint1.gamma"], roots=1).shape == (1, 3)


def test_closing_in_single_precision() -> None:
    kernel = eomgen.build(eomgen.load_robot("four_bar"), kernels=KERNELS, dtype="float32")
    q = kernel.assemble(np.float32([0.5, 0.25, 1.25]), ["joint1.gamma"])
    assert q.dtype == np.float32
    assert np.abs(kernel.functions.constraint(q)).max() <= 2e-6
    v = kernel.project_velocity(q, np.float32([1.0, 0.0, 0.0]), ["joint1.gamma"])
    assert np.abs(kernel.functions.constraint_jacobian(q) @ v).max() <= 1e-5
    assert redundancy(kernel, q).mobility == 1


def test_what_does_not_close_is_named_with_its_state(four_bar: eomgen.Kernel, built: Build) -> None:
    q = four_bar.assemble([0.5, 0.2, 1.2])
    with pytest.raises(LoopError, match=r"loop joint4 does not close near the guess in state 1: joint4\.[xy] is left"):
        four_bar.assemble([q, q + 0.3], four_bar.coordinates)
    with pytest.raises(LoopError, match=r"joint4 opens at the rates that are held: joint4\.[xy] .* m/s"):
        four_bar.project_velocity(q, [1.0, 0.0, 0.0], ["joint1.gamma", "joint3.gamma"])
    refused(UnknownNameError, "fixed: 'joint9' is unknown", four_bar.assemble, q, ["joint9"])
    refused(InputError, "roots of 0; allowed: a whole number from 1 to 1000", four_bar.assemble, q, roots=0)
    refused(InputError, r"roots of states of shape \(2, 3\)", four_bar.assemble, [q, q], roots=2)
    with pytest.raises(InputError, match="one_link has nothing to close"):
        built(eomgen.load_robot("one_link"), "mass_matrix").assemble([0.0, 0.0])
    refused(LoopError, "joint4 is opening", integrate, four_bar, q, [1.0, 0.0, 0.0], 0.1)
    v = four_bar.project_velocity(q, [40.0, 0.0, 0.0], ["joint1.gamma"])
    with pytest.raises(IntegrationStopped, match="four_bar, t = "):
        integrate(four_bar, q, v, 1.0, method="rk4", step=0.5, output_step=1.0)
    robot = eomgen.load_robot("four_bar")
    far = replace(robot.joints[2], placement=Placement((5.0, 0.0, 0.0), IDENTITY))
    apart = built(replace(robot, joints=(*robot.joints[:2], far)), *KERNELS)
    caught = refused(LoopError, r"joint4\.x is left with 3\.9 m", apart.assemble, [0.1, 0.2, 3.0], roots=2)
    assert (caught.loop, caught.gap) == ("joint4", pytest.approx(3.9, abs=1e-3))
    first, second = robot.loops[0].placements  # rods meet whose cut axes point to opposite sides
    turned = replace(robot.loops[0], placements=(first, Placement.from_rpy(second.xyz, (np.pi, 0.0, 0.0))))
    with pytest.raises(LoopError, match="joint4 closes near the guess only turned over"):
        built(replace(robot, loops=(turned,)), *KERNELS).assemble([0.5, 0.2, 1.2])


def test_names_of_before_go_on_without_a_warning(four_bar: eomgen.Kernel) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        q = four_bar.assemble([0.5, 0.2, 1.2], fixed=["joint1.gamma"])
        v = four_bar.project_velocity(q, [1.0, 0.0, 0.0], fixed=["joint1.gamma"])
    assert np.array_equal(q, four_bar.assemble([0.5, 0.2, 1.2], fixed=["joint1.gamma"]))
    assert np.array_equal(v, four_bar.project_velocity(q, [1.0, 0.0, 0.0], fixed=["joint1.gamma"]))


def constrained(text: str) -> Robot:
    """The robot of a text, whose couplings are rows of the constraint."""
    robot = robot_from_toml(text)
    return replace(robot, couplings=tuple(replace(x, is_constraint=True) for x in robot.couplings))


def test_couplings_close_and_are_counted(built: Build) -> None:
    """The gap of a rack is a length."""
    rack = GEARED.replace('"b.gamma"', '"b.z"').replace('"two", type = "revolute"', '"two", type = "prismatic"')
    for text, unit in ((rack, "m"), (GEARED, "rad")):
        kernel = built(constrained(text), "constraint", "constraint_jacobian", "mass_matrix")
        with pytest.raises(LoopError, match=rf"gear does not close near the guess: gear is left with 0\.7 {unit};"):
            kernel.assemble([0.3, 0.1], kernel.coordinates)
    q = kernel.assemble([0.3, 0.1], ["a.gamma"])
    assert q == pytest.approx([0.3, -0.6], abs=1e-12)
    assert kernel.project_velocity(q, [1.0, 0.0], ["a.gamma"]) == pytest.approx([1.0, -2.0], abs=1e-12)
    assert redundancy(kernel, q).mobility == 1


@pytest.mark.parametrize(
    ("name", "mobility", "redundant"),
    [("four_bar", 1, 3), ("bennett", 1, 3), pytest.param("gough", 6, 0, marks=pytest.mark.soak)],
)
def test_redundancy_is_that_of_the_singular_values(name: str, mobility: int, redundant: int, built: Build) -> None:
    robot = eomgen.load_robot(name)
    kernel = built(robot, *KERNELS)
    q = np.array([robot.home.get(x, 0.0) for x in kernel.coordinates])
    found = redundancy(kernel, q)
    assert (found.mobility, len(found.redundant)) == (mobility, redundant)
    assert found == ClosedLoops(kernel).redundancy(q)


@pytest.mark.parametrize(
    ("found", "lines"),
    [
        (Mobility(note="no compiler"), ["mobility: not known: no compiler"]),
        (
            Mobility(1, 2, ("joint4.z", "joint4.beta"), (), 0),
            [
                "mobility at home: 1; 2 independent constraints, 2 redundant (joint4.z, joint4.beta)",
                "branch: its drives do not hold it",
            ],
        ),
        (
            Mobility(1, 5, branches=1),
            [
                "mobility at home: 1; 5 independent constraints",
                "branch: with its drives held it closes in one way, home is the nearest",
            ],
        ),
        (
            Mobility(6, 18, branches=BRANCHES),
            [
                "mobility at home: 6; 18 independent constraints",
                f"branch: with its drives held it closes in {BRANCHES} ways or more, home is the nearest",
            ],
        ),
    ],
)
def test_mobility_in_words(found: Mobility, lines: list[str]) -> None:
    assert found.lines() == lines


def test_a_hanging_mechanism_rests_at_its_lowest_point(four_bar: eomgen.Kernel) -> None:
    q = closed_equilibrium(four_bar, [-1.5, 0.8, -0.9])
    assert np.abs(four_bar.functions.constraint(q)).max() <= 1e-12
    chart, zero = Chart(four_bar, q), np.zeros(3)
    slope = four_bar.residual(q, zero, zero, zero) @ chart.tangent_basis(chart.assemble(q[np.newaxis])[1])[0]
    assert np.abs(slope).max() <= 1e-8  # of potential energy along the mechanism's way, N m
    around = [four_bar.energy(chart.assemble(q + d * np.eye(3)[chart.free])[0][0], zero)[1] for d in (-1e-2, 0.0, 1e-2)]
    assert around[1] < min(around[0], around[2])
    held = closed_equilibrium(four_bar, q + [0.3, 0.0, 0.0], fixed=["joint1.gamma"])
    assert held[0] == q[0] + 0.3


def test_dependent_coordinates_that_do_not_follow_are_said_with_their_loop(four_bar: eomgen.Kernel) -> None:
    chart = Chart(four_bar, four_bar.assemble([0.5, 0.2, 1.2]))
    J = np.zeros((len(four_bar.constraints), four_bar.n))
    J[1, 2] = -0.25
    error = chart._singular(J)
    said = f"loop joint4 is in a singular position: {four_bar.constraints[1]} is left with 0.25"
    assert said in str(error)
    assert "allowed: a motion that does not pass it" in str(error)
    assert (error.loop, error.gap) == ("joint4", 0.25)


def test_what_nothing_holds_has_no_equilibrium(built: Build) -> None:
    robot = replace(eomgen.load_robot("four_bar"), gravity=(0.0, 0.0, 0.0), name="weightless")
    refused(IntegrationError, "nothing holds joint", closed_equilibrium, built(robot, *KERNELS), [0.5, 0.2, 1.2])


def test_elastic_loops_rest_where_their_springs_hold(built: Build) -> None:
    """A cut joint of which every direction is a stiff spring sags by microns from where the rigid one is."""
    robot = eomgen.load_robot("four_bar")
    springs = {name: Coordinate(stiffness=1e7) for name in ("x", "y", "z", "alpha", "beta")}
    soft = built(
        replace(robot, name="soft_bars", loops=(replace(robot.loops[0], coordinates=springs),)),
        *(name for name in KERNELS if OWN_KERNELS[name].needs not in ("loops", "constraints", "cuts")),
        "inverse_dynamics",
    )
    q = np.array([robot.home[name] for name in soft.coordinates])
    sagged = closed_equilibrium(soft, q, fixed=["joint1.gamma"])
    assert 1e-9 < np.abs(sagged - q).max() < 1e-5


DRIVES = {"delta": 3, "gough": 6}
CLOSED = [name for name in builtin_robots() if build_model(eomgen.load_robot(name)).constraints]


@pytest.mark.parametrize("name", CLOSED)
def test_home_closes(name: str, built: Build) -> None:
    robot = eomgen.load_robot(name)
    model = build_model(robot)
    kernel = built(robot, "constraint")
    q = np.array(model.home)
    assert np.abs(kernel.functions.constraint(q)).max() <= 1e-15
    assert robot.driven is not None
    assert len(model.driven) == DRIVES.get(name, 1)


def test_home_of_an_elastic_mechanism(built: Build) -> None:
    """Nothing is rigid there: at home its cut joints are where their springs are at rest."""
    robot = eomgen.load_robot("hexapod_elastic")
    model = build_model(robot)
    assert (model.constraints, len(model.cut_laws), len(model.driven)) == ((), 36, 6)
    kernel = built(robot, "cut_poses")
    found = kernel.functions.cut_forces(np.array(model.home), np.zeros(model.size)).reshape(6, 6, 2)
    assert np.abs(found[:, :3]).max() <= 1e-7


PLACED = ("constraint", "constraint_jacobian")


def test_placements_of_a_cut_joint_can_be_tuned(built: Build) -> None:
    robot = eomgen.load_robot("four_bar")
    first, second = robot.loops[0].placements
    turned = (Placement.from_rpy((0.3, 0.0, 0.1), (0.1, 0.2, 0.0)), Placement.from_rpy(second.xyz, (0.0, 0.0, 0.0)))
    start = replace(robot, loops=(replace(robot.loops[0], placements=(replace(turned[0], xyz=first.xyz), turned[1])),))
    tuned = replace(start, tunable=expand_tunable(start, ["loops.joint4.placements"]))
    moved = replace(robot, loops=(replace(robot.loops[0], placements=turned),))
    kernel, wanted = built(tuned, *PLACED), built(moved, *PLACED)
    q = np.array([0.7, -0.4, 1.2])
    assert np.abs(kernel.functions.constraint(q) - wanted.functions.constraint(q)).max() > 0.05
    kernel.parameters["loops.joint4.placements.0.xyz.0"] = 0.3
    kernel.parameters["loops.joint4.placements.0.xyz.2"] = 0.1
    for name in PLACED:
        assert method_of(kernel, name)(q) == pytest.approx(method_of(wanted, name)(q), abs=1e-14)


def parallelogram() -> Robot:
    """Opposite rods of the same length: folded flat, at angles of zero, it may go on as an antiparallelogram."""
    robot = linkages("")[0]
    (cut,) = robot.loops
    placements = (cut.placements[0], Placement((0.2, 0.0, 0.0)))
    return replace(robot, name="parallelogram", loops=(replace(cut, name="hinge", placements=placements),))


def test_a_folded_parallelogram_is_refused(built: Build) -> None:
    """Its loop is named; close to it accelerations are still those of the limit."""
    kernel = built(parallelogram(), "forward_dynamics", "constraint_jacobian", "mass_matrix", "constraint_forces")
    flat, still, u = np.zeros(3), np.zeros(3), np.array([1.0, 0.0, 0.0])
    for call in (kernel.forward_dynamics, kernel.constraint_forces):
        refused(SingularError, r"loop hinge is at a singular pose.*allowed: poses beside it", call, flat, still, u)
    near = [kernel.forward_dynamics(np.array([e, -e, e]), still, u)[0] for e in (1e-2, 1e-3, 1e-4)]
    assert near == pytest.approx([near[1]] * 3, rel=1e-2)
    states = np.array([[1.0, -1.0, 1.0], [0.0, 0.0, 0.0]])
    with pytest.raises(SingularError, match=r"loop hinge is at a singular pose.* in state 1"):
        kernel.forward_dynamics(states, np.zeros((2, 3)), u)
    assert np.isfinite(kernel.forward_dynamics(flat, still, u, cut=True)).all()


def test_what_is_redundant_everywhere_is_not_singular() -> None:
    """Rows that follow from others in every closed state are solved as before; home may itself be singular."""
    expected = {"four_bar": 2, "bennett": 2, "andrews": 6}
    assert {name: general_rank(build_model(eomgen.load_robot(name))) for name in expected} == expected
    assert general_rank(build_model(parallelogram())) == 2


def test_bennetts_linkage_goes_on(built: Build) -> None:
    robot = eomgen.load_robot("bennett")
    kernel = built(robot, "forward_dynamics", *assembly_kernels(robot))
    q = kernel.assemble(np.array(build_model(robot).home))
    assert np.isfinite(kernel.forward_dynamics(q, np.zeros(3), np.array([1.0, 0.0, 0.0]))).all()


def lighter(robot: Robot, share: float) -> Robot:
    """Return the robot with that share of its masses."""
    links = (replace(x, mass=share * x.mass, inertia=tuple(share * i for i in x.inertia)) for x in robot.links)
    return replace(robot, name="lighter", links=tuple(links))


def test_a_motion_says_how_near_it_came(built: Build) -> None:
    """The margin is least where the parallelogram is flattest, falls with the sine of its angle, and has no unit."""
    kernel = built(parallelogram(), *KERNELS)
    motion = integrate(kernel, np.array([0.6, -0.6, 0.6]), -np.array([1.0, -1.0, 1.0]), 0.1, method="rk4", step=2e-3)
    tiny = built(lighter(parallelogram(), 1e-18), *KERNELS)
    small = integrate(tiny, motion.q[0], motion.v[0], 0.1, method="rk4", step=2e-3)
    assert small.info["margin"] == pytest.approx(motion.info["margin"], rel=1e-9)
    flattest = int(np.abs(np.sin(motion.q[:, 0])).argmin())
    assert motion.info["margin_at"] == motion.t[flattest]
    assert flattest > 0
    later = integrate(kernel, motion.q[0], motion.v[0], 0.05, method="rk4", step=2e-3)
    assert 0.0 < motion.info["margin"] < later.info["margin"] < 1.0
    joined = joined_info(later.info, {**motion.info, "margin_at": 0.15})
    assert (joined["margin"], joined["margin_at"]) == (motion.info["margin"], 0.15)
