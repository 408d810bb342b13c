"""Co-simulation of functional mock-up units by steps that the error controls, run by fmpy, against the kernel."""

from __future__ import annotations

import importlib.resources
import re
import subprocess
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import eomgen
from eomgen.codegen.kernels.steps.tolerances import rubbing_parameters
from eomgen.export.fmu.choices import ADAPTIVE, METHODS
from eomgen.integration import integrate
from eomgen.robot.model import build_model
from eomgen.robot.value import Friction
from eomgen.runtime.raw import Array
from tests.support.builds import Build
from tests.support.fmu_host import Host
from tests.support.fmu_units import VERSIONS, Export, fmpy, states
from tests.support.refusals import refused
from tests.support.sliders import mass_on_rail
from tests.support.small_robots import free_body
from tests.support.soak import soaked
from tests.support.turning_loops import INTEGRATED, held_at, held_pendulum

pytestmark = [pytest.mark.quick, pytest.mark.usefixtures("unoptimised")]

NAMES = ("adaptive_rollout", "forward_dynamics", "mass_matrix", "inverse_dynamics", "energy", "external_force")
CLOSED = (*NAMES, "constraint", "constraint_jacobian", "constrained_dynamics", "kinematics", "cut_poses")


def run(host: Host, steps: int, length: float, drives: Callable[[float], Array] | None = None, first: int = 0) -> Array:
    """The state after so many communication steps; drives are set at each."""
    for k in range(first, first + steps):
        if drives is not None:
            host.set(host.names("u."), drives(k * length))
        host.step(k * length, length)
    return host.get(states(host))


@pytest.mark.parametrize("version", VERSIONS)
def test_the_description_says_it(version: int, exported: Export) -> None:
    unit = exported(eomgen.load_robot("one_link"), version, method="auto")
    folder = unit.folder
    assert fmpy.validation.validate_fmu(str(unit.path)) == []
    (found,) = [x for x in Host(folder).description.modelVariables if x.name.startswith("solver.")]
    said = (
        found.name,
        found.causality,
        found.variability,
        found.unit,
        *map(float, (found.start, found.min, found.max)),
    )
    assert said == ("solver.tolerance", "parameter", "tunable", "1", 1e-6, 1e-13, 0.1)
    root = ElementTree.parse(folder / "modelDescription.xml").getroot()
    assert float(root.find("DefaultExperiment").attrib["tolerance"]) == 1e-6  # type: ignore[union-attr]


@pytest.mark.parametrize(
    ("version", "method"), soaked([(2, "rosenbrock"), (3, "tsit5"), (3, "radau")], {(2, "rosenbrock")})
)
def test_a_first_step_is_the_rollouts(version: int, method: str, exported: Export, built: Build) -> None:
    """Bit by bit, where all of it is one communication step."""
    robot = eomgen.load_robot("one_link")
    host, kernel = exported(robot, version, method=method).host(stepping=True), built(robot, *NAMES, "radau_rollout")
    q, v, u = np.array([1e-3, 0.3]), np.array([0.0, 0.5]), np.array([0.0, 0.4])
    host.start([*states(host), *host.names("u."), "solver.tolerance"], [*q, *v, *u, 1e-5])
    wanted = kernel.rollout(q, v, u, method=method, duration=0.05, samples=1, rtol=1e-5)
    np.testing.assert_array_equal(run(host, 1, 0.05), np.concatenate([wanted[0][-1], wanted[1][-1]]))


@pytest.mark.soak
@pytest.mark.parametrize("method", ADAPTIVE)
def test_a_stiff_robot_against_tight_tolerances(method: str, exported: Export, built: Build) -> None:
    """Gears of 1e4 N m/rad with friction and backlash; drives change between steps, a wrench acts.  Smaller errors of
    smaller tolerances."""
    robot = eomgen.load_robot("geared_arm")
    kernel = built(robot, *NAMES)
    n, steps, length = kernel.n, 10, 5e-3
    motors = np.array([name.endswith("motor") for name in kernel.coordinates])
    drives = lambda t: 0.5 * motors * np.cos(40.0 * t)  # noqa: E731
    wrench = np.zeros((len(kernel.links), 6))
    wrench[-1] = [3.0, -2.0, 5.0, 0.1, 0.2, -0.1]
    wanted = np.zeros(2 * n)
    for k in range(steps):
        u = drives(k * length)
        options = {"drive": lambda t, q, v, u=u: u, "wrench": wrench, "method": "scipy:Radau", "rtol": 1e-11}
        found = integrate(kernel, wanted[:n], wanted[n:], length, output_step=length, **options)  # type: ignore[arg-type]
        wanted = np.concatenate([found.q[-1], found.v[-1]])
    errors = []
    for tolerance in (1e-3, 1e-5, 1e-7):
        host = exported(robot, method=method).host(stepping=True)
        names = [f"wrench.{kernel.links[-1]}.{part}" for part in ("fx", "fy", "fz", "mx", "my", "mz")]
        host.start([*names, "solver.tolerance"], [*wrench[-1], tolerance])
        errors.append(float(np.abs(run(host, steps, length, drives) - wanted).max() / np.abs(wanted).max()))
    print(f"{method}: errors {errors}")
    assert np.abs(wanted[n:]).max() > 10.0
    assert errors[0] < 2e-2
    assert errors[1] < max(0.2 * errors[0], 1e-5)  # of Radau IIA the first one is as small
    assert errors[2] < min(0.1 * errors[1], 1e-6)


@pytest.mark.soak
def test_prescribed_coordinates_and_wrenches(exported: Export, built: Build) -> None:
    """A wrench on a shaken platform does not change how that is shaken."""
    robot = eomgen.load_robot("shaken_arm")
    kernel, host = built(robot, *NAMES), exported(robot, method="auto").host(stepping=True)
    rng = np.random.default_rng(1)
    u, wrench = rng.uniform(-1.0, 1.0, kernel.n), rng.uniform(-3.0, 3.0, (len(kernel.links), 6))
    host.start([*host.names("u."), *host.names("wrench."), "solver.tolerance"], [*u, *wrench.ravel(), 1e-9])
    given = [i for i, name in enumerate(kernel.coordinates) if name in kernel.prescribed]
    motion = lambda t: (0.5 * u[given] * t**2, u[given] * t, u[given])  # noqa: E731
    zero = np.zeros(kernel.n)
    options = {
        "drive": lambda t, q, v: u,
        "wrench": wrench,
        "prescribed": motion,
        "method": "scipy:DOP853",
        "rtol": 1e-11,
    }
    wanted = integrate(kernel, zero, zero, 0.1, output_step=0.1, **options)  # type: ignore[arg-type]
    found = run(host, 10, 0.01)
    np.testing.assert_allclose(found, np.concatenate([wanted.q[-1], wanted.v[-1]]), atol=1e-7)


@pytest.mark.parametrize(("name", "rate"), [("four_bar", 3.0), ("bennett", 2.0)])
@pytest.mark.soak
def test_closed_mechanisms(name: str, rate: float, exported: Export, built: Build) -> None:
    """They stay closed, keep their energy, and move as an integration with tight tolerances says."""
    robot = eomgen.load_robot(name)
    kernel, folder = built(robot, *CLOSED), exported(robot, method="auto").folder
    home = kernel.assemble([robot.home[x] for x in kernel.coordinates])
    v = kernel.project_velocity(home, [rate, 0.0, 0.0], [kernel.coordinates[0]])
    wanted = integrate(kernel, home, v, 0.5, method="tsit5", rtol=1e-11, output_step=0.5)
    errors = []
    for tolerance in (1e-5, 1e-8):
        host = Host(folder, stepping=True)
        host.start([*states(host), "solver.tolerance"], [*home, *v, tolerance])
        begin = host.get(host.names("energy."))
        found = run(host, 50, 0.01)
        errors.append(float(np.abs(found - np.concatenate([wanted.q[-1], wanted.v[-1]])).max()))
        energy = host.get(host.names("energy."))
        assert abs(energy.sum() - begin.sum()) <= 100.0 * tolerance * max(energy[0], begin[0])
        assert np.abs(kernel.functions.constraint(found[:3])).max() <= 1e-10
        assert np.abs(kernel.functions.constraint_jacobian(found[:3]) @ found[3:]).max() <= 1e-9
    print(f"{name}: errors {errors}")
    assert np.abs(wanted.q[-1] - home).max() > 0.3
    assert errors[1] <= min(0.1 * errors[0], 1e-6)


TURNED = [("free", method) for method in METHODS] + [("held", method) for method in ("rk4", "implicit", "auto")]


@pytest.mark.soak
@pytest.mark.parametrize(("name", "method"), TURNED)
def test_free_joints_turn(name: str, method: str, exported: Export, built: Build) -> None:
    """Over the poles of their angles, by equal steps too: a body under a wrench and a force, and one that a cut holds
    at a point; a state kept there goes on to the same bits."""
    robot, kernels = (held_pendulum(), INTEGRATED) if name == "held" else (free_body(), NAMES)
    host, kernel = exported(robot, method=method).host(stepping=True), built(robot, *kernels)
    if name == "held":
        q, v = held_at(np.array([0.3, 1.2, 0.1]), np.array([2.0, 3.0, 1.0]))
    else:
        q, v = np.array([[0.0, 0.0, 0.0, 0.3, 1.2, 0.1], [0.1, 0.2, 0.3, 2.0, 3.0, 1.0]])
    given = {"u.free.x": 0.5 * (name == "free"), "wrench.body.mz": 0.02}
    given |= {"solver.tolerance": 1e-9} if method in ADAPTIVE else {}
    host.start([*states(host), *given], [*q, *v, *given.values()])
    run(host, 4, 0.05)
    kept, beta = host.unit.getFMUState(), host.get(["q.free.beta"])[0]
    found = run(host, 16, 0.05, first=4)
    u, wrench = np.array([given["u.free.x"], *np.zeros(5)]), np.array([[0.0, 0.0, 0.0, 0.0, 0.0, 0.02]])
    options = {"drive": lambda t, q, v: u, "wrench": wrench, "rtol": 1e-11, "output_step": 0.01}
    expected = integrate(kernel, q, v, 1.0, **options)  # type: ignore[arg-type]
    assert np.abs(np.cos(expected.q[:, 4])).min() < 0.3
    assert abs(np.cos(beta)) < 0.5  # kept in other angles
    limit = {"rk4": 1e-7, "implicit": 5e-2 if name == "held" else 2e-2}.get(method, 1e-6)
    turned = [Rotation.from_euler("XYZ", q[3:6]) for q in (found, expected.q[-1])]
    assert (turned[0] * turned[1].inv()).magnitude() < limit
    assert np.abs(found[:3] - expected.q[-1, :3]).max() < limit
    if name == "held":
        assert np.abs(kernel.functions.constraint(found[:6])).max() < 1e-11
    host.unit.setFMUState(kept)
    np.testing.assert_array_equal(run(host, 16, 0.05, first=4), found)


@pytest.mark.parametrize("version", VERSIONS)
def test_kept_states_go_on_to_the_same_bits(version: int, exported: Export) -> None:
    """Restored in the same instance and, from bytes, in another one, in the midst of what the methods are tried for."""
    folder = exported(eomgen.load_robot("one_link"), version, method="auto").folder
    host, other = Host(folder, stepping=True), Host(folder, stepping=True).start()
    drives = lambda t: np.array([3.0 * np.sin(300.0 * t), 0.4])  # noqa: E731
    host.start([*states(host)], [1e-3, 0.3, 0.0, 0.5])
    reached = run(host, 7, 2e-3, drives)
    kept = host.unit.getFMUState()
    saved = host.unit.serializeFMUState(kept)
    wanted = run(host, 30, 2e-3, drives, first=7)
    host.unit.setFMUState(kept)
    np.testing.assert_array_equal(run(host, 30, 2e-3, drives, first=7), wanted)
    read = getattr(other.unit, "deSerializeFMUstate" if version == 2 else "deserializeFMUState")
    other.unit.setFMUState(read(saved))
    np.testing.assert_array_equal(run(other, 30, 2e-3, drives, first=7), wanted)
    anew = Host(folder, stepping=True).start(states(host), reached, begin=7 * 2e-3)  # of the values alone
    found = run(anew, 30, 2e-3, drives, first=7)
    assert not np.array_equal(found, wanted)
    np.testing.assert_allclose(found, wanted, atol=1e-4)


NOT_KEPT = (  # of progress: what every call sets where it begins, statistics that no step reads, and pointers
    *("t", "largest", "smallest", "looked", "work[0]", "work[1]", "work[2]", "work[3]", "works"),
    *("steps", "rejected", "counted", "sample", "reason", "kept"),
)


def struct_fields(text: str, name: str) -> dict[str, str]:
    """Types of the fields of a struct by their names; of short arrays one by one."""
    body = re.findall(r"typedef struct \{((?:(?!typedef).)*?)\} " + re.escape(name) + ";", text, re.DOTALL)[-1]
    body = re.sub(r"/\*.*?\*/|\{%.*?%\}", "", body, flags=re.DOTALL)
    fields: dict[str, str] = {}
    for declaration in body.split(";")[:-1]:
        kind, field = re.fullmatch(r"\s*(.+?)[ *]+(\w+(?:\[.+\])?)\s*", declaration, re.DOTALL).groups()  # type: ignore[union-attr]
        length = re.fullmatch(r"(\w+)\[(\d+)\]", field)
        names = [f"{length[1]}[{i}]" for i in range(int(length[2]))] if length else [field.partition("[")[0]]
        fields |= dict.fromkeys(names, kind)
    return fields


def test_bytes_of_a_state_hold_all_its_fields() -> None:
    """Except for NOT_KEPT: a field that is added to a struct needs a place in states.c, or a reason there."""
    templates = importlib.resources.files("eomgen.templates").joinpath("fmu")
    unit, states_c = (templates.joinpath(f"{x}.jinja").read_text(encoding="ascii") for x in ("unit.h", "states.c"))
    library = importlib.resources.files("eomgen").joinpath("clib", "eom.h").read_text(encoding="ascii")
    fields = struct_fields(unit, "{{ name }}_state")
    nested = {"progress": "eom_progress", "switching": "eom_switching"}
    assert fields.keys() >= nested.keys() | {"value", "suggested", "turned", "mode"}
    kinds = {name: kind for name, kind in fields.items() if name not in nested}
    for part, struct in nested.items():
        kinds |= {f"{part}.{name}": kind for name, kind in struct_fields(library, struct).items()}
    listed = dict(re.findall(r'\("([\w.\[\]]+)", "([\w ]+)",', states_c))
    for name in listed:
        assert kinds[name] == listed[name]
    copied = set(re.findall(r"memcpy\(out, state->(\w+),", states_c))
    assert copied == set(re.findall(r"memcpy\(state->(\w+), in,", states_c))
    left_out = {f"progress.{name}" for name in NOT_KEPT}
    assert kinds.keys() == listed.keys() | copied | left_out
    assert not left_out & listed.keys()


WRONG = (  # place among the numbers of a state, a value, and the message
    (0, 2.0, "a state of format 2 with"),
    (1, 7.0, "a state of format 1 with 7 numbers is not allowed; allowed: format 1 with"),
    (-16, 3.0, "a state with mode = 3 is not allowed; allowed: one mode"),
    (-13, 2.0, "a state with progress.excess = 2 is not allowed; allowed: numbers from 0 to 1"),
    (-12, 0.5, "a state with progress.refused = 0.5 is not allowed; allowed: whole numbers from 0 to 1"),
    (-7, 0.0, "a state with switching.left = 0 is not allowed"),
    (-6, 1e9, "a state with switching.method = 1000000000 is not allowed"),
)


@pytest.mark.parametrize("version", VERSIONS)
def test_bytes_that_no_state_has_are_refused(version: int, exported: Export) -> None:
    """They hold numbers alone, each of which is checked, so that none becomes an address or an index."""
    host = Host(exported(eomgen.load_robot("one_link"), version, method="auto").folder, stepping=True).start()
    run(host, 3, 2e-3)
    read = getattr(host.unit, "deSerializeFMUstate" if version == 2 else "deserializeFMUState")
    saved, head = host.unit.serializeFMUState(host.unit.getFMUState()), len(host.description.guid) + 1
    numbers = np.frombuffer(saved[head:])
    stiffness = (2 + host.references["joints.joint1.x.stiffness"], -1.0, "joint1.x.stiffness = -1 is not allowed")
    for place, value, message in (*WRONG, stiffness, *((i, np.nan, "nan") for i in range(numbers.size))):
        changed = numbers.copy()
        changed[place] = value
        refused(Exception, "erializeFMU", read, saved[:head] + changed.tobytes())
        assert message in host.messages[-1]
    rng, fits = np.random.default_rng(5), 0
    for _ in range(300):
        changed = np.frombuffer(saved, np.uint8).copy()
        changed[rng.integers(changed.size - 8 * 16, changed.size, 2)] = rng.integers(0, 256, 2)  # how steps go on
        try:
            state = read(changed.tobytes())
        except Exception:
            continue
        fits += 1
        again = np.frombuffer(host.unit.serializeFMUState(state)[head:])
        np.testing.assert_array_equal(again, changed[head:].view(float))
        host.unit.setFMUState(state)
        with suppress(Exception):  # another mode
            host.step(6e-3, 1e-4)
    assert 50 < fits < 290


def begun(host: Host, tolerance: float | None, own: float | None = None) -> Host:
    """Through initialization with an experiment's tolerance, and that of the parameter set before."""
    if own is not None:
        host.set(["solver.tolerance"], [own])
    if host.version == 2:
        host.unit.setupExperiment(tolerance=tolerance, startTime=0.0)
        host.unit.enterInitializationMode()
    else:
        host.unit.enterInitializationMode(tolerance=tolerance, startTime=0.0)
    host.set(["v.joint1.gamma"], [2.0])
    host.unit.exitInitializationMode()
    return host


@pytest.mark.parametrize("version", VERSIONS)
def test_the_experiments_tolerance(version: int, exported: Export) -> None:
    """It takes the place of the parameter's start value, up to what round-off allows, and of no other one."""
    folder = exported(eomgen.load_robot("one_link"), version, method="auto").folder

    def end(tolerance: float | None, own: float | None = None) -> Array:
        return run(begun(Host(folder, stepping=True), tolerance, own), 5, 0.01)

    tight, loose = end(None, 1e-9), end(None, 1e-3)
    assert 1e-9 < np.abs(tight - loose).max() < 1e-2
    np.testing.assert_array_equal(end(1e-9), tight)
    np.testing.assert_array_equal(end(1e-9, 1e-3), loose)
    np.testing.assert_array_equal(end(1e-30), end(None, 1e-13))
    np.testing.assert_array_equal(end(7.0), end(None, 0.1))
    for bad in (-1.0, np.nan):
        host = Host(folder, stepping=True)
        host.refuses(f"the tolerance of the experiment is {bad:g}; allowed: a finite number above 0", begun, host, bad)


@pytest.mark.parametrize("version", VERSIONS)
def test_ends_are_honest(version: int, exported: Export) -> None:
    """A step that leads nowhere is an error with the coordinate, and changes nothing: what follows is as without it."""
    folder = exported(mass_on_rail(), version, method="auto").folder
    host, other = Host(folder, stepping=True).start(), Host(folder, stepping=True).start()
    for one in (host, other):
        one.set(["u.rail.z"], [3.0])
        one.step(0.0, 0.01)
    host.set(["u.rail.z"], [1e300])
    before = host.get(list(host.references))
    host.refuses(
        "the error of q.rail.z is too great in steps of any length that leads on after time", host.step, 0.01, 1e9
    )
    np.testing.assert_array_equal(host.get(list(host.references)), before)
    for one in (host, other):
        one.set(["u.rail.z"], [-1.0])
        one.step(0.01, 0.02)
    np.testing.assert_array_equal(host.get(states(host)), other.get(states(other)))
    for value, message in ((0.2, "is too large; at most 0.1 is allowed"), (0.0, "is too small; at least 1e-13")):
        host.refuses(message, host.set, ["solver.tolerance"], [value])


@pytest.mark.soak
def test_frictions_that_turn_round_fast(exported: Export, built: Build) -> None:
    """A block slides to rest; tolerances know the rates in which its friction turns round, also after these are set."""
    friction = Friction(coulomb=4.0, smoothing=1e-2)
    robot = replace(mass_on_rail(friction=friction), name="sledge")
    assert rubbing_parameters(build_model(robot)) == [(0, "joints.rail.z.friction.smoothing")]
    host, kernel = exported(robot, method="auto").host(stepping=True), built(robot, *NAMES)
    for smoothing in (1e-2, 1e-4):
        host.unit.reset()
        names = ["v.rail.z", "u.rail.z", "joints.rail.z.friction.smoothing", "solver.tolerance"]
        host.start(names, [0.1, 1.0, smoothing, 1e-3])
        tuned = kernel.replaced(parameters={"joints.rail.z.friction.smoothing": smoothing})
        drive = lambda t, q, v: np.array([1.0])  # noqa: E731
        wanted = integrate(tuned, [0.0], [0.1], 0.5, drive=drive, method="scipy:Radau", rtol=1e-9, output_step=0.5)
        found = run(host, 50, 0.01)
        assert found == pytest.approx([wanted.q[-1, 0], wanted.v[-1, 0]], rel=2e-2, abs=1e-5)


COUNT = r"""
#include <stdio.h>
#include "slider_unit.h"
int main(void)
{
    static slider_unit x;
    long long taken = 0;
    slider_unit_reset(&x);
    x.now.mode = UNIT_STEPPING;
    x.now.value[UNIT_U] = 5.0;
    for (int k = 0; k < 100; ++k) {
        if (slider_unit_step(&x, x.now.value[0], 5e-3)) return 1;
        taken += x.now.progress.steps + x.now.progress.rejected;
    }
    printf("%lld %.17g\n", taken, x.now.value[UNIT_Q]);
    return 0;
}
"""


@pytest.mark.soak
def test_the_choice_between_both_is_the_implicit_one_where_it_is_stiff(exported: Export, tmp_path: Path) -> None:
    """A damped spring of 1e9 N/m, in steps: what each method takes, and both in turn."""
    taken = {}
    for method in ADAPTIVE:
        sources = exported(mass_on_rail(stiffness=1e9, damping=1e5), method=method).folder / "sources"
        code = tmp_path / f"{method}.c"
        code.write_text(COUNT, encoding="ascii")
        unit, binary = str(sources / "slider_unit.c"), str(tmp_path / method)
        subprocess.run(["cc", "-std=c99", "-iquote", str(sources), str(code), unit, "-o", binary, "-lm"], check=True)
        steps, place = subprocess.run([binary], capture_output=True, text=True, check=True).stdout.split()
        assert float(place) == pytest.approx(5e-9, rel=1e-3)
        taken[method] = int(steps)
    print(taken)
    assert taken["rosenbrock"] < 400
    assert taken["tsit5"] > 5000
    assert taken["auto"] < 1500
