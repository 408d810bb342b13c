"""Functional mock-up units run by fmpy, against the kernel and SciPy."""

from __future__ import annotations

import zipfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from xml.etree import ElementTree

import fmpy
import numpy as np
import pytest
from fmpy.validation import validate_fmu
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

import eomgen
from eomgen.export.fmu.pack import KERNELS, export_fmu
from eomgen.integration import integrate
from eomgen.robot import JointStiffness
from eomgen.robot.record import robot_hash
from eomgen.robot.value import COORDINATES, Robot
from eomgen.runtime.kernel import Array, Kernel
from tests.oracles.force_laws import with_drives, with_laws
from tests.support.bending_exports import BENDING
from tests.support.builds import Build
from tests.support.fmu_host import Host
from tests.support.random_motors import geared_robot, motor_state
from tests.support.random_robots import random_robot, seeds
from tests.support.random_springs import with_springs
from tests.support.small_robots import free_body, held_body
from tests.support.soak import soaked

ROBOTS = ("one_link", "worn_arm", "geared_arm", "shaken_arm")
QUICK = soaked(ROBOTS, ("one_link", "worn_arm"))
VERSIONS = soaked((2, 3), (3,))  # what differs between both is little
PLAIN = tuple(name for name in KERNELS if not name.endswith("_tangent"))


@dataclass(frozen=True)
class Unit:
    """An exported unit, unpacked, and the robot's kernel; ``host`` instantiates it."""

    path: Path
    folder: Path
    kernel: Kernel

    def host(self, **options: object) -> Host:
        return Host(self.folder, **options)  # type: ignore[arg-type]


Export = Callable[..., Unit]


@pytest.fixture(scope="module")
def exported(tmp_path_factory: pytest.TempPathFactory, built: Build) -> Export:
    """``exported(robot, version, options)``: a unit that is compiled once, without optimisation."""
    known: dict[object, Unit] = {}

    def export(robot: Robot, version: int = 3, **options: object) -> Unit:
        key = (robot_hash(robot), version, *sorted(options.items()))
        if key not in known:
            folder = tmp_path_factory.mktemp("unit")
            options = {"method": "rk4", "step": 1e-3, "flags": ("-O0", "-Werror"), **options}
            path = export_fmu(robot, folder / f"{robot.name}.fmu", version, **options)  # type: ignore[arg-type]
            fmpy.extract(str(path), str(folder / "unpacked"))
            known[key] = Unit(path, folder / "unpacked", built(robot, *PLAIN, "rollout"))
        return known[key]

    return export


def robot_of(seed: int) -> Robot:
    """In turns a plain tree, one with force laws, springs between points and often drives, and one with motors."""
    if seed % 3 == 2:
        return geared_robot(seed, joints=(2, 3), prescribed=0.3)
    robot = random_robot(seed, joints=(2, 3), max_size=8, tree=True)
    if seed % 3 == 0:
        return robot
    robot = with_springs(with_laws(robot, seed), seed)
    return with_drives(robot, seed) if seed % 2 == 0 else robot


@dataclass(frozen=True)
class Point:
    """A state, drives and wrenches; n coordinates stand before states of laws."""

    q: Array
    v: Array
    u: Array
    wrench: Array
    n: int

    @property
    def states(self) -> Array:
        return np.concatenate([self.q[: self.n], self.v])

    @property
    def all(self) -> Array:
        return np.concatenate([self.states, self.u[: self.n], self.wrench.ravel()])


def point_of(robot: Robot, kernel: Kernel, seed: int, size: float = 1.0) -> Point:
    state, rng = motor_state(robot, seed), np.random.default_rng(seed + 9)
    wrench = rng.uniform(-5.0, 5.0, (len(kernel.links), 6))
    n = len(kernel.coordinates)
    drives = np.concatenate([state.u[:n], np.zeros(kernel.n - n)])
    return Point(size * state.q, size * state.v, drives, wrench, n)


def knowns(host: Host) -> list[str]:
    """States and inputs, in their order."""
    return [name for kind in ("q.", "v.", "z.", "u.", "wrench.") for name in host.names(kind)]


COMPUTED = ("der(q.", "a.", "der(z.", "pose.", "reaction.", "energy.")


def outputs(host: Host) -> list[str]:
    """What is computed."""
    return [name for kind in COMPUTED for name in host.names(kind)]


def expected(kernel: Kernel, p: Point) -> Array:
    """What the kernel says of ``outputs``."""
    a = kernel.forward_dynamics(p.q, p.v, p.u, wrench=p.wrench)
    found = [p.v[: p.n], a]
    for frame in kernel.frames:
        if frame != "base":
            pose = kernel.frame_pose(p.q, frame)
            found += [pose[:3, 3], pose[:3, :3].ravel()]
    return np.concatenate([*found, kernel.reactions(p.q, p.v, a, wrench=p.wrench).ravel(), kernel.energy(p.q, p.v)])


def close(found: Array, wanted: Array, tolerance: float) -> None:
    scale = max(1.0, float(np.abs(wanted).max()))
    assert float(np.abs(found - wanted).max()) <= tolerance * scale


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("name", soaked(ROBOTS, ("worn_arm",)))
def test_validation_has_no_message(name: str, version: int, exported: Export) -> None:
    unit = exported(eomgen.load_robot(name), version)
    assert validate_fmu(str(unit.path)) == []
    description = unit.host().description
    root = ElementTree.parse(unit.folder / "modelDescription.xml").getroot()
    for interface in ("ModelExchange", "CoSimulation"):
        said = root.find(interface).attrib
        assert said["providesDirectionalDerivative" if version == 2 else "providesDirectionalDerivatives"] == "true"
        assert said["canSerializeFMUstate" if version == 2 else "canSerializeFMUState"] == "true"
    assert {x.name: float(x.start) for x in description.modelVariables if x.causality == "parameter"} == {
        **unit.kernel.parameters,
        "solver.step": 1e-3,
    }
    assert all(x.variability == "tunable" for x in description.modelVariables if x.causality == "parameter")
    assert all(x.unit for x in description.modelVariables)


@pytest.mark.soak
def test_the_same_robot_gives_the_same_bytes(exported: Export, tmp_path: Path) -> None:
    unit = exported(eomgen.load_robot("one_link"), 3)
    fixed = {"method": "rk4", "flags": ("-O0", "-Werror")}
    again = export_fmu(eomgen.load_robot("one_link"), tmp_path / "a.fmu", 3, step=1e-3, **fixed)  # type: ignore[arg-type]
    assert again.read_bytes() == unit.path.read_bytes()
    other = export_fmu(eomgen.load_robot("one_link"), tmp_path / "b.fmu", 3, step=2e-3, **fixed)  # type: ignore[arg-type]
    guids = [fmpy.read_model_description(str(path)).guid for path in (again, other)]
    assert guids[0] != guids[1]
    assert all(".so" not in name or name.startswith("binaries/") for name in zipfile.ZipFile(again).namelist())


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("name", QUICK)
def test_outputs_are_the_kernels(name: str, version: int, exported: Export) -> None:
    robot = eomgen.load_robot(name)
    unit = exported(robot, version)
    host = unit.host()
    for seed in range(3):
        p = point_of(robot, unit.kernel, seed, size=0.1)
        host.set(knowns(host), p.all)
        close(host.get(outputs(host)), expected(unit.kernel, p), 1e-13)
    host.unit.freeInstance()


@pytest.mark.soak
@pytest.mark.parametrize("seed", seeds(0, 1, 45))
def test_outputs_and_derivatives_of_random_robots(seed: int, exported: Export) -> None:
    """Derivatives against central differences of the unit's own outputs, of fourth order."""
    robot = robot_of(seed)
    unit = exported(robot, 2 + seed % 2)
    p = point_of(robot, unit.kernel, seed)
    host = unit.host()
    host.set(knowns(host), p.all)
    close(host.get(outputs(host)), expected(unit.kernel, p), 1e-12)
    check_derivatives(unit, p, seed)
    if seed % 3 == 0:  # without kinks, at which the order of fixed steps drops
        check_steps(unit, replace(p, v=0.1 * p.v), 2e-5, 2e-3)


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("name", soaked(BENDING, ()))
def test_links_that_bend(name: str, version: int, exported: Export) -> None:
    """Modes are coordinates without a unit, their forces in J; stiffness and damping of each are parameters."""
    robot = BENDING[name]()
    unit = exported(robot, version)
    assert validate_fmu(str(unit.path)) == []
    kernel, rng, host = unit.kernel, np.random.default_rng(5), unit.host()
    units = {x.name: x.unit for x in host.description.modelVariables}
    for mode in robot.modal_coordinates:
        said = [units[f"{kind}.{mode}"] for kind in "qvau"]
        assert said == ["1", "1/s", "1/s2", "J"]
        link, number = mode.split(".mode")
        assert units[f"links.{link}.modes.{number}.stiffness"] == "J"
        assert units[f"links.{link}.modes.{number}.damping"] == "J.s"
    q, v, u = rng.uniform(-0.1, 0.1, (3, kernel.n))
    p = Point(q, v, u, rng.uniform(-1.0, 1.0, (len(kernel.links), 6)), kernel.n)
    host.set(knowns(host), p.all)
    close(host.get(outputs(host)), expected(kernel, p), 1e-12)
    softer = {x: 1.5 * value for x, value in kernel.parameters.items() if ".modes." in x}
    host.set(list(softer), list(softer.values()))
    close(host.get(outputs(host)), expected(kernel.with_parameters(softer), p), 1e-12)
    host.unit.freeInstance()
    if version == 3:
        assert check_dependencies(unit, p) > 20
        check_derivatives(unit, p, 1)
        check_steps(unit, replace(p, v=0.1 * p.v), 2e-5, 2e-3)


def check_steps(unit: Unit, p: Point, step: float, duration: float) -> None:
    """Co-simulation in five calls, beside the rollout without wrenches and beside DOP853 with them."""
    kernel, n = unit.kernel, unit.kernel.n
    for wrench, tolerance in ((0.0 * p.wrench, 1e-13), (p.wrench, 1e-9)):
        host = unit.host(stepping=True)
        host.start([*knowns(host), "solver.step"], [*replace(p, wrench=wrench).all, step])
        for k in range(5):
            host.step(k * duration / 5, duration / 5)
        if wrench.any():
            wanted = direct(kernel, np.concatenate([p.q, p.v]), p.u, wrench, duration)
        else:
            q, v = kernel.rollout(p.q, p.v, p.u, step, round(duration / step))
            wanted = np.concatenate([q[-1], v[-1]])
        found = host.get(knowns(host)[: 2 * n])
        print(f"{kernel.name}: {np.abs(found - wanted).max():.1e} from {'DOP853' if wrench.any() else 'the rollout'}")
        close(found, wanted, tolerance)
        host.unit.freeInstance()


@pytest.mark.soak
@pytest.mark.parametrize("version", VERSIONS)
def test_the_elastic_puma(version: int, exported: Export) -> None:
    """36 coordinates: no message, outputs, derivatives, steps."""
    robot = eomgen.load_robot("puma560_elastic")
    unit = exported(robot, version, step=5e-5)
    assert validate_fmu(str(unit.path)) == []
    p = point_of(robot, unit.kernel, 1, size=1e-3)
    host = unit.host()
    host.set(knowns(host), p.all)
    close(host.get(outputs(host)), expected(unit.kernel, p), 1e-12)
    check_derivatives(unit, p, 1)
    check_steps(unit, point_of(robot, unit.kernel, 2, size=1e-5), 5e-7, 2e-4)


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("name", QUICK)
def test_derivatives(name: str, version: int, exported: Export) -> None:
    robot = eomgen.load_robot(name)
    unit = exported(robot, version)
    check_derivatives(unit, point_of(robot, unit.kernel, 3, size=1e-3 if name == "worn_arm" else 0.1), 3)


def check_derivatives(unit: Unit, p: Point, seed: int) -> None:
    host, twin, rng = unit.host().start(), unit.host(), np.random.default_rng(seed)
    names, unknown, states = knowns(host), outputs(host), p.states.size
    host.to_continuous_time()
    host.set_states(p.states)
    host.set(names[states:], p.all[states:])

    def at(x: Array) -> Array:
        twin.set(names, x)
        return twin.get(unknown)

    worst = 0.0
    for i in range(3):
        direction = rng.uniform(-1.0, 1.0, len(names))
        if i == 2:  # the wrenches' rotation with the links alone
            direction[p.n :] = 0.0
        h = 1e-4 * min(1.0, 10.0 * float(np.abs(p.q).max()))
        difference = (
            8.0 * (at(p.all + h * direction) - at(p.all - h * direction))
            - (at(p.all + 2 * h * direction) - at(p.all - 2 * h * direction))
        ) / (12.0 * h)
        found = host.derivative(unknown, names, direction)
        groups = [group for kind in COMPUTED if (group := host.names(kind))]
        first = 0
        for group in groups:
            part = slice(first, first + len(group))
            scale = max(1.0, float(np.abs(difference[part]).max()))
            worst = max(worst, float(np.abs(found[part] - difference[part]).max()) / scale)
            first += len(group)
    print(f"{unit.kernel.name}: derivatives within {worst:.1e} of differences")
    assert worst < 2e-7


@pytest.mark.parametrize("version", VERSIONS)
def test_derivatives_by_one_are_the_kernels_columns(version: int, exported: Export) -> None:
    robot = eomgen.load_robot("shaken_arm")
    unit = exported(robot, version)
    kernel, p = unit.kernel, point_of(robot, unit.kernel, 7, size=0.3)
    host = unit.host().start(knowns(unit.host()), p.all)
    names = knowns(host)
    n, a = kernel.n, host.names("a.")
    external = kernel.external_force(p.q, p.wrench)
    external[[i for i, name in enumerate(kernel.coordinates) if name in kernel.prescribed]] = 0.0
    _, by_v, by_u = kernel.forward_dynamics_jacobian(p.q, p.v, p.u + external)
    found = np.array([host.derivative(a, [name], [1.0]) for name in names[n : 3 * n]]).T
    close(found[:, :n], by_v, 1e-13)
    close(found[:, n:], by_u, 1e-13)
    assert host.derivative(["q.elbow.gamma", "v.elbow.gamma"], ["q.elbow.gamma", "time"], [2.0, 5.0]).tolist() == [2, 0]


@pytest.mark.parametrize("version", VERSIONS)
def test_declared_dependencies_are_all_that_there_are(version: int, exported: Export) -> None:
    robot = eomgen.load_robot("shaken_arm")
    unit = exported(robot, version)
    assert check_dependencies(unit, point_of(robot, unit.kernel, 5, size=0.3)) > 40


def check_dependencies(unit: Unit, p: Point) -> int:
    """Compare dependencies that are declared with derivatives that are not zero; how many there are."""
    names = knowns(unit.host())
    host = unit.host().start(names, p.all)
    structure = [*host.description.outputs, *host.description.derivatives]
    unknown = [x.variable.name for x in structure]
    columns = {name: host.derivative(unknown, [name], [1.0]) for name in names}
    declared = 0
    for row, entry in enumerate(structure):
        if entry.dependencies is not None:
            declared += 1
            named = {x.name for x in entry.dependencies}
            assert {name for name in names if columns[name][row] != 0.0} <= named, entry.variable.name
            if not entry.variable.name.startswith(("pose.", "energy.")):
                assert len(named) == 1
    return declared


def motion_of(name: str, kernel: Kernel) -> tuple[Array, Array, Array]:
    """Start and inputs of a short motion in which much moves: states, drives, wrenches."""
    rng = np.random.default_rng(11)
    driven = np.array([x.endswith(("gamma", "motor")) and "gear" not in x for x in kernel.coordinates])
    x = np.concatenate([0.3 * driven, 0.5 * driven]) * rng.uniform(-1.0, 1.0, 2 * kernel.n)
    if name == "geared_arm":
        x[:] = 0.0  # motors and joints together
    return x, rng.uniform(-1.0, 1.0, kernel.n), rng.uniform(-3.0, 3.0, (len(kernel.links), 6))


def direct(kernel: Kernel, x0: Array, u: Array, wrench: Array, duration: float) -> Array:
    """The end of the motion by DOP853 with tight tolerances, from the kernel."""
    n = kernel.n

    def rates(_: float, x: Array) -> Array:
        return np.concatenate([x[n:], kernel.forward_dynamics(x[:n], x[n:], u, wrench=wrench)])

    return np.asarray(solve_ivp(rates, (0.0, duration), x0, method="DOP853", rtol=1e-12, atol=1e-13).y[:, -1])


@pytest.mark.parametrize(
    ("name", "version"),
    soaked([(name, 2 + i % 2) for i, name in enumerate(ROBOTS)], {("one_link", 2), ("worn_arm", 3)}),
)
def test_model_exchange_is_the_direct_simulation(name: str, version: int, exported: Export) -> None:
    robot = eomgen.load_robot(name)
    unit = exported(robot, version)
    x0, u, wrench = motion_of(name, unit.kernel)
    host = unit.host()
    names = knowns(host)
    host.start(names, np.concatenate([x0, u, wrench.ravel()]))
    host.to_continuous_time()

    def rates(t: float, x: Array) -> Array:
        host.unit.setTime(t)
        host.set_states(x)
        return host.rates()

    duration = 0.05
    end = solve_ivp(rates, (0.0, duration), x0, method="DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
    assert np.abs(end - x0).max() > 1e-2
    worst = float(np.abs(end - direct(unit.kernel, x0, u, wrench, duration)).max())
    print(f"{name}: model exchange within {worst:.1e} of a direct simulation")
    assert worst < 1e-9
    host.unit.terminate()
    host.unit.freeInstance()


STEPS = {"one_link": (1e-4, 0.02), "shaken_arm": (2e-5, 0.02), "geared_arm": (2.5e-6, 0.005), "worn_arm": (1e-6, 0.004)}


@pytest.mark.parametrize("name", soaked(STEPS, ("shaken_arm", "worn_arm")))
@pytest.mark.parametrize("version", VERSIONS)
def test_co_simulation_is_the_direct_simulation(name: str, version: int, exported: Export) -> None:
    robot = eomgen.load_robot(name)
    unit = exported(robot, version)
    kernel, n = unit.kernel, unit.kernel.n
    x0, u, wrench = motion_of(name, kernel)
    (step, duration), calls = STEPS[name], 10
    for loads, tolerance in ((0.0 * wrench, 1e-12), (wrench, 1e-9)):
        host = unit.host(stepping=True)
        host.start([*knowns(host), "solver.step"], [*x0, *u, *loads.ravel(), step])
        for k in range(calls):
            host.step(k * duration / calls, duration / calls)
        found = host.get(knowns(host)[: 2 * n])
        if not loads.any():
            q, v = kernel.rollout(x0[:n], x0[n:], u, step, round(duration / step))
            wanted = np.concatenate([q[-1], v[-1]])
        else:
            wanted = direct(kernel, x0, u, loads, duration)
        worst = float(np.abs(found - wanted).max())
        print(f"{name}: co-simulation within {worst:.1e} of {'DOP853' if loads.any() else 'the rollout'}")
        assert worst < tolerance
        assert host.get(["time"])[0] == pytest.approx(duration, abs=1e-15)
        host.unit.terminate()
        host.unit.freeInstance()


@pytest.mark.soak
@pytest.mark.parametrize("version", VERSIONS)
def test_co_simulation_by_implicit_steps(version: int, exported: Export) -> None:
    unit = exported(eomgen.load_robot("worn_arm"), version, method="implicit")
    kernel, n = unit.kernel, unit.kernel.n
    x0, u, _ = motion_of("worn_arm", kernel)
    host = unit.host(stepping=True)
    host.start(knowns(host)[: 3 * n], [*x0, *u])
    for k in range(20):
        host.step(k * 5e-3, 5e-3)
    q, v = kernel.rollout(x0[:n], x0[n:], u, 1e-3, 100, method="implicit")
    assert np.abs(host.get(knowns(host)[: 2 * n]) - np.concatenate([q[-1], v[-1]])).max() < 1e-9


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("kind", ["ModelExchange", "CoSimulation"])
def test_fmpy_simulates_it(version: int, kind: str, exported: Export) -> None:
    """By CVODE, and by steps; with an input that changes."""
    unit = exported(eomgen.load_robot("one_link"), version, step=1e-4)
    kernel, duration = unit.kernel, 0.1
    inputs = np.array([(0.0, 0.4), (duration, 0.4)], dtype=[("time", float), ("u.joint1.gamma", float)])
    result = fmpy.simulate_fmu(
        str(unit.folder),
        fmi_type=kind,
        stop_time=duration,
        step_size=1e-3,
        output_interval=1e-3,
        relative_tolerance=1e-12,
        start_values={"q.joint1.gamma": 0.3, "joints.joint1.x.stiffness": 900.0},
        input=inputs,
        output=["q.joint1.x", "q.joint1.gamma", "v.joint1.x", "v.joint1.gamma"],
    )
    tuned = kernel.with_parameters({"joints.joint1.x.stiffness": 900.0})
    end = direct(tuned, np.array([0.0, 0.3, 0.0, 0.0]), np.array([0.0, 0.4]), np.zeros((1, 6)), duration)
    worst = float(np.abs(np.array([result[name][-1] for name in result.dtype.names[1:]]) - end).max())
    print(f"one_link by fmpy, FMI {version}.0 {kind}: within {worst:.1e} of DOP853")
    assert result["time"][-1] == pytest.approx(duration)
    assert worst < 1e-9


@pytest.mark.parametrize("version", VERSIONS)
def test_states_are_kept_restored_and_serialized(version: int, exported: Export) -> None:
    unit = exported(eomgen.load_robot("shaken_arm"), version)
    x0, u, wrench = motion_of("shaken_arm", unit.kernel)
    host, other = unit.host(stepping=True), unit.host(stepping=True)
    names = knowns(host)
    host.start(names, [*x0, *u, *wrench.ravel()])
    other.start()
    host.step(0.0, 2e-3)
    kept = host.unit.getFMUState()
    saved = host.unit.serializeFMUState(kept)
    everything = list(host.references)
    before = host.get(everything)
    host.step(2e-3, 2e-3)
    after = host.get(everything)
    host.set(["u.elbow.gamma", "joints.elbow.gamma.damping"], [9.0, 0.9])
    assert (host.get(everything) != after).any()
    host.unit.setFMUState(kept)
    np.testing.assert_array_equal(host.get(everything), before)
    host.step(2e-3, 2e-3)
    np.testing.assert_array_equal(host.get(everything), after)
    host.unit.freeFMUState(kept)
    read = getattr(other.unit, "deSerializeFMUstate" if version == 2 else "deserializeFMUState")
    state = read(saved)  # by another instance
    other.unit.setFMUState(state)
    other.unit.freeFMUState(state)
    np.testing.assert_array_equal(other.get(everything), before)
    with pytest.raises(Exception, match="erializeFMU"):
        read(saved[:-1])
    assert "are no state of this unit" in other.messages[-1]
    with pytest.raises(Exception, match="erializeFMU"):
        read(b"x" + saved[1:])
    host.unit.reset()
    fresh = unit.host(stepping=True)
    np.testing.assert_array_equal(host.get(everything), fresh.get(everything))
    host.start(names, [*x0, *u, *wrench.ravel()])
    host.step(0.0, 2e-3)
    np.testing.assert_array_equal(host.get(everything), before)


@pytest.mark.parametrize("version", VERSIONS)
def test_parameters_are_tunable_and_each_instances_own(version: int, exported: Export) -> None:
    robot = replace(eomgen.load_robot("one_link"), tunable=("links.link1.mass", "gravity.x"))
    unit = exported(robot, version)
    one, other = unit.host().start(), unit.host().start()
    p = point_of(robot, unit.kernel, 1)
    values = {"links.link1.mass": 2.5, "gravity.y": -3.7, "joints.joint1.x.stiffness": 80.0}
    for host in (one, other):
        host.to_continuous_time()
        host.set_states(np.concatenate([p.q, p.v]))
        host.set(host.names("u."), p.u)
        host.get(outputs(host))  # computed before the change
    with pytest.raises(Exception, match="fmi"):
        one.set(list(values), list(values.values()))
    assert "event mode" in one.messages[-1]
    one.unit.enterEventMode()
    one.set(list(values), list(values.values()))
    still_air = replace(p, wrench=0.0 * p.wrench)
    close(one.get(outputs(one)), expected(unit.kernel.with_parameters(values), still_air), 1e-13)
    close(other.get(outputs(other)), expected(unit.kernel, still_air), 1e-13)


BAD = [
    ("u.joint1.x", np.nan, "u.joint1.x = nan is not finite"),
    ("u.joint1.gamma", np.inf, "u.joint1.gamma = inf is not finite"),
    ("wrench.link1.mz", -np.inf, "wrench.link1.mz = -inf is not finite"),
    ("joints.joint1.x.stiffness", -1.0, "joints.joint1.x.stiffness = -1 is too small; at least 0"),
    ("solver.step", 0.0, "solver.step = 0 is too small; at least 1e-09"),
    ("q.joint1.gamma", 1.0, "q.joint1.gamma is a state; allowed"),
    ("a.joint1.gamma", 1.0, "a.joint1.gamma cannot be set; allowed"),
    ("time", 1.0, "time cannot be set"),
]


@pytest.mark.parametrize("version", VERSIONS)
def test_matrices_stay_positive_semidefinite(version: int, exported: Export) -> None:
    """Values that are set together are looked at together; what is refused changes nothing."""
    robot = eomgen.load_robot("one_link")
    joint = replace(robot.joints[0], stiffness=JointStiffness({"x.x": 9.0, "x.gamma": 2.0, "gamma.gamma": 4.0}))
    host = exported(replace(robot, joints=(joint,)), version).host(stepping=True).start()
    prefix, everything = "joints.joint1.stiffness", list(host.references)
    before = host.get(everything)
    for values in ({"x.gamma": 7.0}, {"x.x": 0.0}, {"gamma.gamma": 1.0, "x.x": 2.0}):
        with pytest.raises(Exception, match="fmi"):
            host.set([f"{prefix}.{key}" for key in values], list(values.values()))
        assert f"{prefix} would have a negative energy" in host.messages[-1]
        np.testing.assert_array_equal(host.get(everything), before)
    for values in ({"x.gamma": 7.0, "x.x": 13.0}, {"x.gamma": 0.0}, {"x.x": 0.0, "gamma.gamma": 0.0}):
        host.set([f"{prefix}.{key}" for key in values], list(values.values()))
        np.testing.assert_array_equal(host.get([f"{prefix}.{key}" for key in values]), list(values.values()))


@pytest.mark.parametrize("version", VERSIONS)
def test_bad_values_are_refused_with_a_message(version: int, exported: Export) -> None:
    host = exported(eomgen.load_robot("one_link"), version).host(stepping=True).start()
    everything = list(host.references)
    before = host.get(everything)
    for name, value, message in BAD:
        with pytest.raises(Exception, match="fmi"):
            host.set(["u.joint1.x", name], [5.0, value])
        assert message in host.messages[-1]
        np.testing.assert_array_equal(host.get(everything), before)
    host.references |= {"nothing": 10**6}
    for call in (lambda: host.get(["nothing"]), lambda: host.set(["nothing"], [0.0])):
        with pytest.raises(Exception, match="fmi"):
            call()
        assert "value reference 1000000 is unknown" in host.messages[-1]
    for unknown, known, message in (
        ("a.joint1.x", "joints.joint1.x.stiffness", "no derivatives by joints.joint1.x.stiffness; allowed"),
        ("a.joint1.x", "energy.kinetic", "no derivatives by energy.kinetic"),
        ("u.joint1.x", "q.joint1.x", "u.joint1.x has no derivatives"),
    ):
        with pytest.raises(Exception, match="fmi"):
            host.derivative([unknown], [known], [1.0])
        assert message in host.messages[-1]
    for begin, length, message in ((0.5, 0.1, "the time here is 0 s"), (0.0, -0.1, "allowed: a finite number above 0")):
        with pytest.raises(Exception, match="fmi"):
            host.step(begin, length)
        assert message in host.messages[-1]
    with pytest.raises(Exception, match="fmi"):
        host.unit.exitInitializationMode()
    assert "ExitInitializationMode is not allowed here: the mode is step" in host.messages[-1]
    with pytest.raises(Exception, match="instantiate"):
        exported(eomgen.load_robot("one_link"), version).host(guid="{other}")


@pytest.mark.soak
@pytest.mark.parametrize("version", VERSIONS)
def test_singular_states_are_named(version: int, exported: Export) -> None:
    unit = exported(held_body(), version)
    host = unit.host(stepping=True).start(["q.free.beta"], [np.pi / 2])
    q = host.get(host.names("q."))
    with pytest.raises(eomgen.SingularError, match=r"inverted at free\.alpha and free\.gamma; free\.beta is at"):
        unit.kernel.forward_dynamics(q, 0.0 * q, 0.0 * q)
    for call in (
        lambda: host.get(["a.free.gamma"]),
        lambda: host.step(0.0, 1e-3),
        lambda: host.derivative(["a.free.x"], ["q.free.x"], [1.0]),
    ):
        host.messages.clear()
        with pytest.raises(Exception, match="fmi"):
            call()
        assert host.messages
        assert "the mass matrix cannot be inverted at free." in host.messages[-1]
    assert np.isfinite(host.get(host.names("pose."))).all()


@pytest.mark.soak
@pytest.mark.parametrize("method", soaked(["rk4", "implicit"], ["implicit"]))
def test_steps_turn_free_joints(method: str, exported: Export, built: Build) -> None:
    """A body that tumbles over the poles of its angles; a wrench acts, and a force along x."""
    unit = exported(free_body(), method=method)
    names = [f"{label}.free.{axis}" for label in "qv" for axis in COORDINATES]
    begin = np.array([0.0, 0.0, 0.0, 0.3, 1.2, 0.1, 0.1, 0.2, 0.3, 2.0, 3.0, 1.0])
    host = unit.host(stepping=True).start([*names, "u.free.x", "wrench.body.mz"], [*begin, 0.5, 0.02])
    for step in range(20):
        host.step(0.05 * step, 0.05)
    kernel = built(free_body(), "forward_dynamics", "mass_matrix", "inverse_dynamics", "external_force", "energy")
    u, wrench = np.array([0.5, *np.zeros(5)]), np.array([[0.0, 0.0, 0.0, 0.0, 0.0, 0.02]])
    found = np.array(host.get(names))
    expected = integrate(kernel, begin[:6], begin[6:], 1.0, drive=lambda t, q, v: u, wrench=wrench, rtol=1e-9)
    assert np.abs(np.cos(expected.q[:, 4])).min() < 0.3
    limit = 1e-7 if method == "rk4" else 2e-2
    turned = [Rotation.from_euler("XYZ", q[3:6]) for q in (found, expected.q[-1])]
    assert (turned[0] * turned[1].inv()).magnitude() < limit
    assert np.abs(found[:3] - expected.q[-1, :3]).max() < limit


@pytest.mark.parametrize("version", VERSIONS)
def test_a_step_that_is_too_long_fails_and_changes_nothing(version: int, exported: Export) -> None:
    unit = exported(eomgen.load_robot("worn_arm"), version)
    host = unit.host(stepping=True).start(["q.shoulder.x", "solver.step"], [3e-3, 0.05])
    before = host.get(list(host.references))
    with pytest.raises(Exception, match="fmi"):
        host.step(0.0, 5.0)
    assert "set a shorter solver.step, or export with the method implicit" in host.messages[-1]
    np.testing.assert_array_equal(host.get(list(host.references)), before)


def test_open_homes_and_wrong_options_are_refused(tmp_path: Path) -> None:
    one, four_bar = eomgen.load_robot("one_link"), eomgen.load_robot("four_bar")
    with pytest.raises(eomgen.LoopError, match=r"loop joint4 does not close near the guess: joint4\.x is left with"):
        export_fmu(replace(four_bar, home={}), tmp_path / "x.fmu")
    for options, message in (
        ({"version": 1}, "fmi: version 1 is unknown; allowed: 2, 3"),
        ({"method": "euler"}, "method: 'euler' is unknown; allowed: auto, rosenbrock, tsit5, radau, rk4, implicit"),
        ({"method": "rk4", "step": 0.0}, "step: 0.0 is no length"),
        ({"method": "rk4", "step": float("nan")}, "step: nan is no length"),
    ):
        with pytest.raises(eomgen.InputError, match=message):
            export_fmu(one, tmp_path / "x.fmu", **options)  # type: ignore[arg-type]
    (tmp_path / "file").write_text("")
    with pytest.raises(eomgen.InputError, match="cannot be written"):
        export_fmu(one, tmp_path / "file" / "x.fmu", flags=("-O0",))
