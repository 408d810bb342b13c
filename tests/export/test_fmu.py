"""Functional mock-up units run by fmpy, against the kernel and SciPy."""

from __future__ import annotations

import zipfile
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import eomgen
from eomgen.export.fmu.pack import export_fmu
from eomgen.robot import JointStiffness
from eomgen.robot.value import Robot
from tests.support.bending_exports import BENDING
from tests.support.bristles import SIZE, law_changes
from tests.support.fmu_units import (
    BUILTIN,
    FIXED,
    VERSIONS,
    WITH_STATES,
    Export,
    Point,
    Unit,
    check_dependencies,
    check_derivatives,
    check_steps,
    close,
    direct,
    exchanged,
    expected,
    fmpy,
    knowns,
    outputs,
    point_of,
    robot_of,
    rolled,
    states,
)
from tests.support.optional import needs
from tests.support.random_motors import geared_robot
from tests.support.random_robots import random_robot, seeds
from tests.support.random_springs import with_springs
from tests.support.refusals import refused
from tests.support.small_robots import held_body
from tests.support.soak import soaked

QUICK = soaked(BUILTIN, ("one_link", "worn_arm"))
OPEN = ("arm", "laws", "servo", "axis")  # without loops and couplings
SECOND = {"laws", "linkage", "axis"}  # of WITH_STATES, which are not left to the soak


def random_kind(seed: int) -> Robot:
    """In turns a plain tree, one with force laws, springs between points and often drives, and one with motors."""
    if seed % 3 == 2:
        return geared_robot(seed, joints=(2, 3), prescribed=0.3)
    robot = random_robot(seed, joints=(2, 3), max_size=8, tree=True)
    if seed % 3 == 0:
        return robot
    from tests.oracles.force_laws import with_drives, with_laws  # with the oracle of Pinocchio

    robot = with_springs(with_laws(robot, seed), seed)
    return with_drives(robot, seed) if seed % 2 == 0 else robot


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("name", soaked(BUILTIN, ("worn_arm",)))
def test_validation_has_no_message(name: str, version: int, exported: Export) -> None:
    unit = exported(eomgen.load_robot(name), version)
    assert fmpy.validation.validate_fmu(str(unit.path)) == []
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
@pytest.mark.parametrize("name", [*QUICK, *soaked(OPEN, ("arm", "axis"))])
def test_outputs_are_the_kernels(name: str, version: int, exported: Export) -> None:
    """Of robots whose laws have internal states, too."""
    unit = exported(robot_of(name), version)
    host = unit.host()
    for seed in range(3):
        p = point_of(unit, seed, size=0.1)
        host.set(knowns(host), p.all)
        close(host.get(outputs(host)), expected(unit.kernel, p), 1e-13 if name in BUILTIN else 1e-12)
    host.unit.freeInstance()


@pytest.mark.soak
@pytest.mark.parametrize("seed", seeds(0, 1, 45))
def test_outputs_and_derivatives_of_random_robots(seed: int, exported: Export) -> None:
    """Derivatives against central differences of the unit's own outputs, of fourth order."""
    unit = exported(random_kind(seed), 2 + seed % 2)
    p = point_of(unit, seed)
    host = unit.host()
    host.set(knowns(host), p.all)
    close(host.get(outputs(host)), expected(unit.kernel, p), 1e-12)
    check_derivatives(unit, p.all, step_of(p), seed)
    if seed % 3 == 0:  # without kinks, at which the order of fixed steps drops
        check_steps(unit, replace(p, v=0.1 * p.v, z=None if p.z is None else 0.1 * p.z), 2e-5, 2e-3)


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("name", soaked(BENDING, ()))
def test_links_that_bend(name: str, version: int, exported: Export) -> None:
    """Modes are coordinates without a unit, their forces in J; stiffness and damping of each are parameters."""
    robot = BENDING[name]()
    unit = exported(robot, version)
    assert fmpy.validation.validate_fmu(str(unit.path)) == []
    kernel, rng, host = unit.kernel, np.random.default_rng(5), unit.host()
    units = {x.name: x.unit for x in host.description.modelVariables}
    for mode in robot.modal_coordinates:
        said = [units[f"{kind}.{mode}"] for kind in "qvau"]
        assert said == ["1", "1/s", "1/s2", "J"]
        link, number = mode.split(".mode")
        assert units[f"links.{link}.modes.{number}.stiffness"] == "J"
        assert units[f"links.{link}.modes.{number}.damping"] == "J.s"
    q, v, u = rng.uniform(-0.1, 0.1, (3, kernel.n))
    p = Point(q, v, u, rng.uniform(-1.0, 1.0, (len(kernel.links), 6)))
    host.set(knowns(host), p.all)
    close(host.get(outputs(host)), expected(kernel, p), 1e-12)
    softer = {x: 1.5 * value for x, value in kernel.parameters.items() if ".modes." in x}
    host.set(list(softer), list(softer.values()))
    close(host.get(outputs(host)), expected(kernel.replaced(parameters=softer), p), 1e-12)
    host.unit.freeInstance()
    if version == 3:
        assert check_dependencies(unit, p) > 20
        check_derivatives(unit, p.all, step_of(p), 1)
        check_steps(unit, replace(p, v=0.1 * p.v), 2e-5, 2e-3)


@pytest.mark.soak
@pytest.mark.parametrize("version", VERSIONS)
def test_the_elastic_puma(version: int, exported: Export) -> None:
    """36 coordinates: no message, outputs, derivatives, steps."""
    robot = eomgen.load_robot("puma560_elastic")
    unit = exported(robot, version, step=5e-5)
    assert fmpy.validation.validate_fmu(str(unit.path)) == []
    p = point_of(unit, 1, size=1e-3)
    host = unit.host()
    host.set(knowns(host), p.all)
    close(host.get(outputs(host)), expected(unit.kernel, p), 1e-12)
    check_derivatives(unit, p.all, step_of(p), 1)
    check_steps(unit, point_of(unit, 2, size=1e-5), 5e-7, 2e-4)


def step_of(p: Point) -> float:
    return 1e-4 * min(1.0, 10.0 * float(np.abs(p.q).max()))


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("name", [*QUICK, *soaked(OPEN, ("arm", "axis"))])
def test_derivatives(name: str, version: int, exported: Export) -> None:
    unit = exported(robot_of(name), version)
    p = point_of(unit, 3, size=1e-3 if name == "worn_arm" else 0.1)
    sizes: Any = step_of(p)
    if name in WITH_STATES:
        sizes = np.full(p.all.size, 1e-3)
        sizes[2 * p.q.size : p.states.size] *= SIZE
    check_derivatives(unit, p.all, sizes, 3, 1e-5 if name in WITH_STATES else 2e-7)


@pytest.mark.parametrize("version", VERSIONS)
def test_derivatives_by_one_are_the_kernels_columns(version: int, exported: Export) -> None:
    unit = exported(eomgen.load_robot("shaken_arm"), version)
    kernel, p = unit.kernel, point_of(unit, 7, size=0.3)
    host = unit.host().start(knowns(unit.host()), p.all)
    names = knowns(host)
    n, a = kernel.n, host.names("a.")
    external = kernel.functions.external_force(p.q, p.wrench)
    external[[i for i, name in enumerate(kernel.coordinates) if name in kernel.prescribed]] = 0.0
    _, by_v, by_u = kernel.forward_dynamics_jacobian(p.q, p.v, p.u + external)
    found = np.array([host.derivative(a, [name], [1.0]) for name in names[n : 3 * n]]).T
    close(found[:, :n], by_v, 1e-13)
    close(found[:, n:], by_u, 1e-13)
    assert host.derivative(["q.elbow.gamma", "v.elbow.gamma"], ["q.elbow.gamma", "time"], [2.0, 5.0]).tolist() == [2, 0]


@pytest.mark.parametrize("version", VERSIONS)
def test_declared_dependencies_are_all_that_there_are(version: int, exported: Export) -> None:
    unit = exported(eomgen.load_robot("shaken_arm"), version)
    assert check_dependencies(unit, point_of(unit, 5, size=0.3)) > 40


def motion_of(name: str, unit: Unit) -> Point:
    """Return start and inputs of a short motion in which much moves."""
    kernel, rng = unit.kernel, np.random.default_rng(11)
    if name in WITH_STATES:
        p = point_of(unit, 3)
        if kernel.raw.libraries.meta.get("constraints"):  # a closed state at rest
            p = replace(p, q=np.array(kernel.home), v=0.0 * p.v, u=10.0 * p.u)
        return replace(p, wrench=0.0 * p.wrench)
    driven = np.array([x.endswith(("gamma", "motor")) and "gear" not in x for x in kernel.coordinates])
    x = np.concatenate([0.3 * driven, 0.5 * driven]) * rng.uniform(-1.0, 1.0, 2 * kernel.n)
    if name == "geared_arm":
        x[:] = 0.0  # motors and joints together
    u, wrench = rng.uniform(-1.0, 1.0, kernel.n), rng.uniform(-3.0, 3.0, (len(kernel.links), 6))
    return Point(x[: kernel.n], x[kernel.n :], u, wrench)


EXCHANGED = soaked([(name, 2 + i % 2) for i, name in enumerate(BUILTIN)], {("one_link", 2), ("worn_arm", 3)})


@pytest.mark.parametrize(("name", "version"), EXCHANGED)
def test_model_exchange_is_the_direct_simulation(name: str, version: int, exported: Export) -> None:
    unit = exported(eomgen.load_robot(name), version)
    p, duration = motion_of(name, unit), 0.05
    end = exchanged(unit, p.states, p.all[p.states.size :], duration, rtol=1e-12, atol=1e-13)[:, -1]
    assert np.abs(end - p.states).max() > 1e-2
    worst = float(np.abs(end - direct(unit.kernel, p, duration)).max())
    print(f"{name}: model exchange within {worst:.1e} of a direct simulation")
    assert worst < 1e-9


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("name", soaked(WITH_STATES, SECOND))
def test_model_exchange_with_internal_states_is_the_rollout(name: str, version: int, exported: Export) -> None:
    unit = exported(robot_of(name), version)
    p = motion_of(name, unit)
    end = exchanged(unit, p.states, p.u, 0.02, rtol=1e-10, atol=1e-13)[:, -1]
    assert (np.abs(end - p.states) > 1e-6).all()
    np.testing.assert_allclose(
        end, rolled(unit.kernel, p, duration=0.02, method="radau", rtol=1e-11), rtol=1e-7, atol=1e-10
    )


STEPS = {"one_link": (1e-4, 0.02), "shaken_arm": (2e-5, 0.02), "geared_arm": (2.5e-6, 0.005), "worn_arm": (1e-6, 0.004)}


@pytest.mark.parametrize("name", soaked(STEPS, ("shaken_arm", "worn_arm")))
@pytest.mark.parametrize("version", VERSIONS)
def test_co_simulation_is_the_direct_simulation(name: str, version: int, exported: Export) -> None:
    unit = exported(eomgen.load_robot(name), version)
    check_steps(unit, motion_of(name, unit), *STEPS[name], calls=10)


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("name", [*soaked(WITH_STATES, SECOND), pytest.param("worn_arm", marks=pytest.mark.soak)])
@pytest.mark.parametrize("method", soaked([*FIXED, "rosenbrock", "radau"], ["implicit", "rosenbrock"]))
def test_co_simulation_is_the_rollout(method: str, name: str, version: int, exported: Export) -> None:
    """Of internal states, too; by steps with error control all of it is one communication step."""
    calls, options = (4, {"step": 1e-4}) if method in FIXED else (1, {})
    unit = exported(robot_of(name), version, method=method, **options)
    host, p = unit.host(stepping=True), motion_of(name, unit)
    host.start(knowns(host)[: p.states.size + p.u.size], [*p.states, *p.u])
    for k in range(calls):
        host.step(k * 0.02 / calls, 0.02 / calls)
    how: dict[str, Any] = {"dt": 1e-4, "steps": 200} if method in FIXED else {"duration": 0.02, "rtol": 1e-6}
    found = host.get(states(host))
    assert name == "worn_arm" or (np.abs(found - p.states) > 1e-6).all()
    np.testing.assert_allclose(found, rolled(unit.kernel, p, method=method, **how), rtol=1e-11, atol=1e-12)


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
    tuned = kernel.replaced(parameters={"joints.joint1.x.stiffness": 900.0})
    p = Point(np.array([0.0, 0.3]), np.zeros(2), np.array([0.0, 0.4]), np.zeros((1, 6)))
    end = direct(tuned, p, duration)
    worst = float(np.abs(np.array([result[name][-1] for name in result.dtype.names[1:]]) - end).max())
    print(f"one_link by fmpy, FMI {version}.0 {kind}: within {worst:.1e} of DOP853")
    assert result["time"][-1] == pytest.approx(duration)
    assert worst < 1e-9


@pytest.mark.parametrize("kind", ["ModelExchange", "CoSimulation"])
@pytest.mark.parametrize("version", VERSIONS)
def test_fmpy_simulates_internal_states(version: int, kind: str, exported: Export) -> None:
    """By CVODE, and by steps; from a start value of z on."""
    unit = exported(robot_of("arm"), version, method="rosenbrock")
    p, names = motion_of("arm", unit), states(unit.host())
    result = fmpy.simulate_fmu(
        str(unit.folder),
        fmi_type=kind,
        stop_time=0.02,
        output_interval=0.02,
        relative_tolerance=1e-9,
        start_values=dict(zip(names, p.states, strict=True)),
        output=names,
    )
    found = np.array([result[name][-1] for name in names])
    wanted = rolled(unit.kernel, replace(p, u=0.0 * p.u), duration=0.02, method="radau", rtol=1e-11)
    np.testing.assert_allclose(found, wanted, rtol=1e-4, atol=1e-7)


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize(("name", "of"), [("shaken_arm", "elbow"), ("arm", "j2")])
def test_states_are_kept_restored_and_serialized(name: str, of: str, version: int, exported: Export) -> None:
    """Internal ones, too."""
    unit = exported(robot_of(name), version)
    p = motion_of(name, unit)
    host, other = unit.host(stepping=True), unit.host(stepping=True)
    names = knowns(host)
    host.start(names, p.all)
    other.start()
    host.step(0.0, 2e-3)
    kept = host.unit.getFMUState()
    saved = host.unit.serializeFMUState(kept)
    everything = list(host.references)
    before = host.get(everything)
    host.step(2e-3, 2e-3)
    after = host.get(everything)
    host.set([f"u.{of}.gamma", f"joints.{of}.gamma.damping"], [9.0, 0.9])
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
    refused(Exception, "erializeFMU", read, saved[:-1])
    assert "are no state of this unit" in other.messages[-1]
    refused(Exception, "erializeFMU", read, b"x" + saved[1:])
    host.unit.reset()
    fresh = unit.host(stepping=True)
    np.testing.assert_array_equal(host.get(everything), fresh.get(everything))
    host.start(names, p.all)
    host.step(0.0, 2e-3)
    np.testing.assert_array_equal(host.get(everything), before)


@pytest.mark.parametrize("version", VERSIONS)
def test_parameters_are_tunable_and_each_instances_own(version: int, exported: Export) -> None:
    robot = replace(eomgen.load_robot("one_link"), tunable=("links.link1.mass", "gravity.x"))
    unit = exported(robot, version)
    one, other = unit.host().start(), unit.host().start()
    p = point_of(unit, 1)
    values = {"links.link1.mass": 2.5, "gravity.y": -3.7, "joints.joint1.x.stiffness": 80.0}
    for host in (one, other):
        host.to_continuous_time()
        host.set_states(np.concatenate([p.q, p.v]))
        host.set(host.names("u."), p.u)
        host.get(outputs(host))  # computed before the change
    one.refuses("event mode", one.set, list(values), list(values.values()))
    one.unit.enterEventMode()
    one.set(list(values), list(values.values()))
    still_air = replace(p, wrench=0.0 * p.wrench)
    close(one.get(outputs(one)), expected(unit.kernel.replaced(parameters=values), still_air), 1e-13)
    close(other.get(outputs(other)), expected(unit.kernel, still_air), 1e-13)


@pytest.mark.parametrize("version", VERSIONS)
def test_numbers_of_laws_go_together_as_in_python(version: int, exported: Export) -> None:
    unit = exported(robot_of("laws"), version)
    host, first = unit.host().start(), dict(unit.kernel.parameters)
    for values, taken in law_changes(unit.kernel):
        if taken:
            host.set(list(values), list(values.values()))
            host.set(list(first), list(first.values()))
            continue
        host.refuses("allowed", host.set, list(values), list(values.values()))
        assert host.get(list(first)).tolist() == list(first.values())


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
        host.refuses(
            f"{prefix} would have a negative energy",
            host.set,
            [f"{prefix}.{key}" for key in values],
            list(values.values()),
        )
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
        host.refuses(message, host.set, ["u.joint1.x", name], [5.0, value])
        np.testing.assert_array_equal(host.get(everything), before)
    host.references |= {"nothing": 10**6}
    for call in (lambda: host.get(["nothing"]), lambda: host.set(["nothing"], [0.0])):
        host.refuses("value reference 1000000 is unknown", call)
    for unknown, known, message in (
        ("a.joint1.x", "joints.joint1.x.stiffness", "no derivatives by joints.joint1.x.stiffness; allowed"),
        ("a.joint1.x", "energy.kinetic", "no derivatives by energy.kinetic"),
        ("u.joint1.x", "q.joint1.x", "u.joint1.x has no derivatives"),
    ):
        host.refuses(message, host.derivative, [unknown], [known], [1.0])
    for begin, length, message in ((0.5, 0.1, "the time here is 0 s"), (0.0, -0.1, "allowed: a finite number above 0")):
        host.refuses(message, host.step, begin, length)
    host.refuses("ExitInitializationMode is not allowed here: the mode is step", host.unit.exitInitializationMode)
    refused(Exception, "instantiate", exported(eomgen.load_robot("one_link"), version).host, guid="{other}")


@pytest.mark.soak
@pytest.mark.parametrize(("version", "method"), [*((version, "rk4") for version in (2, 3)), (3, "auto")])
def test_singular_states_are_named(version: int, method: str, exported: Export) -> None:
    unit = exported(held_body(), version, method=method)
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
        refused(Exception, "fmi", call)
        assert host.messages
        assert "the mass matrix cannot be inverted at free." in host.messages[-1]
    assert np.isfinite(host.get(host.names("pose."))).all()


@pytest.mark.parametrize("version", VERSIONS)
def test_a_step_that_is_too_long_fails_and_changes_nothing(version: int, exported: Export) -> None:
    unit = exported(eomgen.load_robot("worn_arm"), version)
    host = unit.host(stepping=True).start(["q.shoulder.x", "solver.step"], [3e-3, 0.05])
    before = host.get(list(host.references))
    host.refuses("set a shorter solver.step, or export with the method implicit", host.step, 0.0, 5.0)
    np.testing.assert_array_equal(host.get(list(host.references)), before)


def test_open_homes_and_wrong_options_are_refused(tmp_path: Path) -> None:
    one, four_bar = eomgen.load_robot("one_link"), eomgen.load_robot("four_bar")
    with pytest.raises(eomgen.LoopError, match=r"loop joint4 does not close near the guess: joint4\.x is left with"):
        export_fmu(replace(four_bar, home={}), tmp_path / "x.fmu")
    for options, message in (
        ({"version": 1}, "fmi: version 1 is unknown; allowed: 2, 3"),
        ({"step": 1e-3}, "step: 0.001 is given with method 'auto'; allowed: with the methods rk4, implicit"),
        ({"method": "rk4", "rtol": 1e-3}, "rtol: 0.001 is given with method 'rk4'; allowed: with the methods auto, "),
        ({"rtol": 1e-15}, "rtol: 1e-15 is no relative tolerance; allowed: a number from 1e-13 to 0.1"),
        ({"rtol": float("nan")}, "rtol: nan is no relative tolerance"),
        ({"rtol": True}, "rtol: true is no relative tolerance"),
        ({"method": "euler"}, "method: 'euler' is unknown; allowed: auto, rosenbrock, tsit5, radau, rk4, implicit"),
        ({"method": "rk4", "step": 0.0}, "step: 0.0 is no length"),
        ({"method": "rk4", "step": float("nan")}, "step: nan is no length"),
    ):
        refused(eomgen.InputError, message, export_fmu, one, tmp_path / "x.fmu", **options)
    (tmp_path / "file").write_text("")
    refused(eomgen.InputError, "cannot be written", export_fmu, one, tmp_path / "file" / "x.fmu", flags=("-O0",))


INTERNAL = ("j1.gamma.friction.z", "j2.motor.friction.z")  # states of the arm


@pytest.mark.parametrize("version", [2, 3])
def test_the_description_has_the_states_and_nothing_beside_them(version: int, exported: Export) -> None:
    unit = exported(robot_of("arm"), version)
    host = unit.host()
    assert fmpy.validation.validate_fmu(str(unit.path)) == []
    assert host.names("z.") == [f"z.{name}" for name in INTERNAL]
    assert not [name for name in host.references if "friction.z" in name and not name.startswith(("z.", "der(z."))]
    variables = {x.name: x for x in host.description.modelVariables}
    for name in INTERNAL:
        z, rate = variables[f"z.{name}"], variables[f"der(z.{name})"]
        assert (z.unit, rate.unit, float(z.start), z.initial) == ("rad", "rad/s", 0.0, "exact")
        assert float(z.nominal) == pytest.approx(SIZE)
        assert rate.derivative is z
    owned = [x.variable.derivative.name for x in host.description.derivatives]
    assert owned == states(host)
    (energy,) = (x for x in host.description.outputs if x.variable.name == "energy.potential")
    assert [x.name for x in energy.dependencies] == [*host.names("q."), *host.names("z.")]


@pytest.mark.parametrize("version", VERSIONS)
def test_states_are_set_before_steps_alone(version: int, exported: Export) -> None:
    """And value references count the variables, without gaps; others are refused."""
    host = exported(robot_of("arm"), version).host(stepping=True).start()
    state_name = host.names("z.")[0]
    end = len(host.references)
    assert sorted(host.references.values()) == list(range(end))
    host.references["other"] = end
    for call, message in (
        (lambda: host.set([state_name], [1e-4]), f"{state_name} is a state; allowed"),
        (lambda: host.get(["other"]), f"value reference {end} is unknown"),
        (lambda: host.set(["other"], [0.0]), f"value reference {end} is unknown"),
        (lambda: host.derivative(["a.j1.gamma"], ["other"], [1.0]), "is unknown"),
        (lambda: host.derivative(["other"], ["q.j1.gamma"], [1.0]), "is unknown"),
    ):
        host.refuses(message, call)
    host.unit.reset()
    host.refuses(f"{state_name} = nan is not finite", host.start, [state_name], [np.nan])


def test_a_state_that_is_not_finite_is_named(exported: Export) -> None:
    host = exported(robot_of("arm")).host().start()
    host.to_continuous_time()
    for place, name in ((3, "q.j2.motor"), (4, "v.j1.gamma"), (9, "z.j2.motor.friction.z")):
        x = np.zeros(host.states)
        x[place] = np.nan
        host.refuses(f"{name} = nan", host.set_states, x)


@pytest.mark.parametrize("version", VERSIONS)
def test_results_that_are_not_finite_are_refused(version: int, exported: Export) -> None:
    """In model exchange derivatives and outputs, each time that they are asked for; states and poses stay."""
    host = exported(eomgen.load_robot("one_link"), version).host().start()
    host.to_continuous_time()
    host.set_states(np.array([0.0, 0.3, 0.0, 1e200]))
    for name, call in (
        *(("a.joint1.x", host.rates) for _ in range(2)),
        ("a.joint1.x", lambda: host.get(["a.joint1.x"])),
        ("a.joint1.x", lambda: host.get(["reaction.joint1.fx"])),
        ("energy.kinetic", lambda: host.get(["energy.kinetic"])),
        ("energy.kinetic", lambda: host.derivative(["energy.kinetic"], ["v.joint1.gamma"], [1e200])),
    ):
        host.refuses(f"{name} = ", call)
        assert "is not allowed; allowed: states, inputs and" in host.messages[-1]
    assert host.get(["v.joint1.gamma"])[0] == 1e200
    assert np.isfinite(host.get(host.names("pose."))).all()
    host.set_states(np.zeros(4))
    assert np.isfinite(host.rates()).all()


def test_inputs_and_states_of_drives_have_their_units(exported: Export) -> None:
    unit = exported(robot_of("axis"), 3, method="rosenbrock")
    assert fmpy.validation.validate_fmu(str(unit.path)) == []
    variables = {x.name: x for x in unit.host().description.modelVariables}
    assert variables["u.axis.gamma"].unit == "rad"
    assert variables["z.axis.gamma.drive.current"].unit == "A"
    assert variables["z.axis.gamma.drive.integral_current"].unit == "A.s"
    assert "reference of position" in variables["u.axis.gamma"].description


@pytest.mark.soak
@pytest.mark.parametrize("name", ["one_link", "puma560"])
def test_units_move_under_a_master_of_fixed_steps(name: str, tmp_path: Path) -> None:
    """By a second importer, libcosim of the Open Simulation Platform."""
    needs("libcosimpy")
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimObserver import CosimObserver
    from libcosimpy.CosimSlave import CosimLocalSlave

    unit = export_fmu(name, tmp_path / f"{name}.fmu", 2)
    kernel = eomgen.build(name)
    execution = CosimExecution.from_step_size(round(0.01 * 1e9))
    place = execution.add_local_slave(CosimLocalSlave(fmu_path=str(unit), instance_name="arm"))
    observer = CosimObserver.create_last_value()
    execution.add_observer(observer)
    variables = execution.slave_variables(slave_index=place)
    known = {x.name.decode(): x.reference for x in variables}
    rng = np.random.default_rng(4)
    u = np.zeros(kernel.n)
    for i, coordinate in enumerate(kernel.coordinates):
        if f"u.{coordinate}" in known:
            u[i] = rng.uniform(-2.0, 2.0)
            assert execution.real_initial_value(place, known[f"u.{coordinate}"], float(u[i]))
    assert execution.step(100)
    found = observer.last_real_values(place, [known[f"q.{x}"] for x in kernel.coordinates])

    def slope(_: float, x: np.ndarray) -> np.ndarray:
        q, v = np.split(x, 2)
        return np.concatenate([v, kernel.forward_dynamics(q, v, u)])

    motion = solve_ivp(slope, (0.0, 0.01 * 100), np.zeros(2 * kernel.n), method="DOP853", rtol=1e-10, atol=1e-12)
    expected = motion.y[: kernel.n, -1]
    assert np.abs(expected).max() > 1e-2
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-7)
