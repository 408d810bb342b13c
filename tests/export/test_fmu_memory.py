"""Functional mock-up units of robots whose laws have states, run by fmpy, against the kernel and SciPy."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import fmpy
import numpy as np
import pytest
from fmpy.validation import validate_fmu
from scipy.integrate import solve_ivp

from eomgen.export.fmu.pack import export_fmu
from eomgen.robot.value import Robot
from eomgen.runtime.kernel import Array, Kernel
from tests.support.bristles import (
    SIZE,
    bent,
    bristle_arm,
    bristle_gear,
    bristle_linkage,
    remembering_arm,
    remembering_linkage,
    servo_arm,
    wide,
)
from tests.support.builds import Build
from tests.support.fmu_host import Host
from tests.support.soak import soaked

VERSIONS = soaked((2, 3), (3,))
KERNELS = (
    *("forward_dynamics", "external_force", "kinematics", "energy", "reactions", "external_reactions"),
    *("rollout", "adaptive_rollout", "radau_rollout"),
)
ROBOTS = {
    "arm": bristle_arm,
    "linkage": bristle_linkage,
    "gear": bristle_gear,
    "laws": remembering_arm,
    "loop": remembering_linkage,
    "servo": servo_arm,
}
NAMES = ["laws", "linkage", *(pytest.param(name, marks=pytest.mark.soak) for name in ("arm", "gear", "loop", "servo"))]
STATES = {"arm": ("j1.gamma.friction.z", "j2.motor.friction.z")}

Unit = Callable[..., Host]


@pytest.fixture(scope="module")
def unit(tmp_path_factory: pytest.TempPathFactory) -> Unit:
    """``unit(name, version, method, stepping)``: an instance of a robot's unit, compiled once."""
    known: dict[tuple[str, int, str], Path] = {}

    def instance(name: str, version: int, method: str = "rk4", *, stepping: bool = False) -> Host:
        key = name, version, method
        if key not in known:
            folder, step = tmp_path_factory.mktemp("unit"), {"step": 1e-4} if method in ("rk4", "implicit") else {}
            options = {"method": method, "flags": ("-O0", "-Werror"), **step}
            path = export_fmu(ROBOTS[name](), folder / "a.fmu", version, **options)  # type: ignore[arg-type]
            fmpy.extract(str(path), str(folder / "unpacked"))
            known[key] = folder / "unpacked"
        return Host(known[key], stepping=stepping)

    return instance


@pytest.fixture(scope="module")
def kernels(built: Build) -> Callable[[str], Kernel]:
    def kernel(name: str) -> Kernel:
        robot: Robot = ROBOTS[name]()
        left_out = ("reactions", "external_reactions") if robot.is_closed else ()
        return built(robot, *(x for x in KERNELS if x not in left_out))

    return kernel


def state(kernel: Kernel) -> tuple[Array, Array, Array, Array]:
    """Return q, v, u and z; of the linkage a closed state at rest."""
    q, v, u, z = bent(kernel)
    if kernel.raw.libraries.meta.get("constraints"):
        return kernel.home[: q.size], 0.0 * v, 10.0 * u, z
    return q, v, u, z


def knowns(host: Host) -> list[str]:
    """States and inputs, in their order."""
    return [name for kind in ("q.", "v.", "z.", "u.", "wrench.") for name in host.names(kind)]


def outputs(host: Host) -> list[str]:
    """What is computed."""
    kinds = ("der(q", "a.", "der(z", "pose.", "reaction.", "energy.")
    return [name for kind in kinds for name in host.names(kind)]


@pytest.mark.parametrize("version", [2, 3])
def test_the_description_has_the_states_and_nothing_beside_them(version: int, unit: Unit) -> None:
    host = unit("arm", version)
    assert validate_fmu(str(Path(host.unit.unzipDirectory).parent / "a.fmu")) == []
    assert host.names("z.") == [f"z.{name}" for name in STATES["arm"]]
    assert not [name for name in host.references if "friction.z" in name and not name.startswith(("z.", "der(z."))]
    variables = {x.name: x for x in host.description.modelVariables}
    for name in STATES["arm"]:
        z, rate = variables[f"z.{name}"], variables[f"der(z.{name})"]
        assert (z.unit, rate.unit, float(z.start), z.initial) == ("rad", "rad/s", 0.0, "exact")
        assert float(z.nominal) == pytest.approx(SIZE)
        assert rate.derivative is z
    owned = [x.variable.derivative.name for x in host.description.derivatives]
    assert owned == [name for kind in ("q.", "v.", "z.") for name in host.names(kind)]
    (energy,) = (x for x in host.description.outputs if x.variable.name == "energy.potential")
    assert [x.name for x in energy.dependencies] == [*host.names("q."), *host.names("z.")]


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("name", ["arm", *(pytest.param(name, marks=pytest.mark.soak) for name in ("laws", "servo"))])
def test_outputs_and_derivatives(name: str, version: int, unit: Unit, kernels: Callable[[str], Kernel]) -> None:
    """What is computed is the kernel's; directional derivatives are differences of fourth order."""
    host, twin, kernel, rng = unit(name, version), unit(name, version), kernels(name), np.random.default_rng(4)
    q, v, u, z = state(kernel)
    wrench = rng.uniform(-5.0, 5.0, (len(kernel.links), 6))
    point, names, unknown = np.concatenate([q, v, z, u, wrench.ravel()]), knowns(host), outputs(host)
    host.set(names, point)
    Q, V, U = wide(kernel, q, v, u, z)
    A = kernel.forward_dynamics(Q, V, U, wrench=wrench)
    poses = [kernel.frame_pose(Q, frame) for frame in kernel.frames if frame != "base"]
    placed = np.concatenate([np.r_[pose[:3, 3], pose[:3, :3].ravel()] for pose in poses])
    reactions = kernel.reactions(Q, V, A, wrench=wrench).ravel()
    wanted = np.concatenate([v, A, placed, reactions, kernel.energy(Q, V)])
    np.testing.assert_allclose(host.get(unknown), wanted, rtol=1e-12, atol=1e-12)
    sizes = np.r_[np.full(8, 1e-3), np.full(z.size, 1e-3 * SIZE), np.full(point.size - 8 - z.size, 1e-3)]

    def at(x: Array) -> Array:
        twin.set(names, x)
        return twin.get(unknown)

    host.start(names, point)
    host.to_continuous_time()
    host.set_states(point[: host.states])
    host.set(names[host.states :], point[host.states :])
    for _ in range(3):
        h = sizes * rng.uniform(-1.0, 1.0, point.size)
        differences = (8.0 * (at(point + h) - at(point - h)) - (at(point + 2.0 * h) - at(point - 2.0 * h))) / 12.0
        found = host.derivative(unknown, names, h)
        np.testing.assert_allclose(found, differences, rtol=1e-5, atol=1e-7 * np.abs(differences).max())
        assert np.abs(found[8 : 8 + z.size]).min() > 0.0


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("method", soaked(["rk4", "implicit", "rosenbrock", "radau"], ["implicit", "rosenbrock"]))
def test_co_simulation_is_the_rollout(
    method: str, name: str, version: int, unit: Unit, kernels: Callable[[str], Kernel]
) -> None:
    kernel, host = kernels(name), unit(name, version, method, stepping=True)
    q, v, u, z = state(kernel)
    begin, duration = np.concatenate([q, v, z]), 0.02
    host.start(knowns(host)[: begin.size + u.size], [*begin, *u])
    fixed = {"dt": 1e-4, "steps": 200} if method in ("rk4", "implicit") else {"duration": duration, "rtol": 1e-6}
    motion = kernel.rollout(q, v, u, method=method, z=z, **fixed)  # type: ignore[arg-type]
    for k in range(4 if "dt" in fixed else 1):
        host.step(k * 5e-3, 5e-3 if "dt" in fixed else duration)
    found, wanted = host.get(knowns(host)[: begin.size]), np.concatenate([motion[0][-1], motion[1][-1], motion.z[-1]])
    assert (np.abs(found - begin) > 1e-6).all()
    np.testing.assert_allclose(found, wanted, rtol=1e-11, atol=1e-14)


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("name", NAMES)
def test_model_exchange_is_the_direct_simulation(
    name: str, version: int, unit: Unit, kernels: Callable[[str], Kernel]
) -> None:
    kernel, host = kernels(name), unit(name, version)
    q, v, u, z = state(kernel)
    n, x0 = q.size, np.concatenate([q, v, z])
    host.start(knowns(host)[: x0.size + n], [*x0, *u])
    host.to_continuous_time()

    def rates(t: float, x: Array) -> Array:
        host.unit.setTime(t)
        host.set_states(x)
        return host.rates()

    duration = 0.02
    end = solve_ivp(rates, (0.0, duration), x0, method="DOP853", rtol=1e-10, atol=1e-13).y[:, -1]
    motion = kernel.rollout(q, v, u, duration=duration, method="radau", rtol=1e-11, z=z)
    wanted = np.concatenate([motion[0][-1], motion[1][-1], motion.z[-1]])
    assert (np.abs(end - x0) > 1e-6).all()
    np.testing.assert_allclose(end, wanted, rtol=1e-7, atol=1e-10)


@pytest.mark.parametrize("kind", ["ModelExchange", "CoSimulation"])
@pytest.mark.parametrize("version", VERSIONS)
def test_fmpy_simulates_it(version: int, kind: str, unit: Unit, kernels: Callable[[str], Kernel]) -> None:
    """By CVODE, and by steps; from a start value of z on."""
    kernel, host = kernels("arm"), unit("arm", version, "rosenbrock")
    q, v, u, z = state(kernel)
    names = knowns(host)[: 2 * q.size + z.size]
    result = fmpy.simulate_fmu(
        str(host.unit.unzipDirectory),
        fmi_type=kind,
        stop_time=0.02,
        output_interval=0.02,
        relative_tolerance=1e-9,
        start_values=dict(zip(names, [*q, *v, *z], strict=True)),
        output=names,
    )
    motion = kernel.rollout(q, v, 0.0 * u, duration=0.02, method="radau", rtol=1e-11, z=z)
    found = np.array([result[name][-1] for name in names])
    wanted = np.concatenate([motion[0][-1], motion[1][-1], motion.z[-1]])
    np.testing.assert_allclose(found, wanted, rtol=1e-4, atol=1e-7)


@pytest.mark.parametrize("version", VERSIONS)
def test_states_are_kept_reset_and_refused(version: int, unit: Unit, kernels: Callable[[str], Kernel]) -> None:
    kernel, host = kernels("arm"), unit("arm", version, stepping=True)
    q, v, u, z = state(kernel)
    everything, names = list(host.references), knowns(host)[: 3 * q.size + z.size]
    fresh = host.get(everything)
    host.start(names, [*q, *v, *z, *u])
    kept = host.unit.getFMUState()
    host.step(0.0, 1e-3)
    after = host.get(everything)
    host.unit.setFMUState(kept)
    np.testing.assert_array_equal(host.get(names), [*q, *v, *z, *u])
    host.step(0.0, 1e-3)
    np.testing.assert_array_equal(host.get(everything), after)
    host.unit.freeFMUState(kept)
    state_name = host.names("z.")[0]
    listed = set(host.references.values())
    beside = [i for i in range(max(listed)) if i not in listed]
    assert len(beside) == 3 * z.size
    host.references |= {f"beside.{i}": i for i in beside}
    for call, message in (
        (lambda: host.set([state_name], [1e-4]), f"{state_name} is a state; allowed"),
        *((lambda i=i: host.get([f"beside.{i}"]), f"value reference {i} is unknown") for i in beside),
        *((lambda i=i: host.set([f"beside.{i}"], [0.0]), f"value reference {i} is unknown") for i in beside),
        *((lambda i=i: host.derivative(["a.j1.gamma"], [f"beside.{i}"], [1.0]), "is unknown") for i in beside),
        *((lambda i=i: host.derivative([f"beside.{i}"], ["q.j1.gamma"], [1.0]), "is unknown") for i in beside),
    ):
        with pytest.raises(Exception, match="fmi"):
            call()
        assert message in host.messages[-1]
    host.unit.reset()
    np.testing.assert_array_equal(host.get(everything), fresh)
    with pytest.raises(Exception, match="fmi"):
        host.start([state_name], [np.nan])
    assert f"{state_name} = nan is not finite" in host.messages[-1]


def test_a_state_that_is_not_finite_is_named(unit: Unit) -> None:
    host = unit("arm", 3).start()
    host.to_continuous_time()
    for place, name in ((3, "q.j2.motor"), (4, "v.j1.gamma"), (9, "z.j2.motor.friction.z")):
        x = np.zeros(host.states)
        x[place] = np.nan
        with pytest.raises(Exception, match="fmi"):
            host.set_states(x)
        assert f"{name} = nan" in host.messages[-1]
