"""Stiffness and damping of closed mechanisms from motions and drives that their own kernels say belong together."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import eomgen
from eomgen.cli import entry as cli
from eomgen.errors import InputError
from eomgen.identification.stiffness.output_error import output_error_kernels
from eomgen.identification.stiffness.solve import fit, fitting_kernels
from eomgen.motion.files import MeasuredMotion, motion_from_columns
from eomgen.pipeline.mechanisms import mechanism_kernels
from eomgen.runtime.stepping.input_signals import DriveData, InputSignals, Signal, Track
from tests.loops.test_elastic_cuts import linkages
from tests.support.builds import Build
from tests.support.random_robots import Array

pytestmark = pytest.mark.usefixtures("unoptimised")

SPRINGS = {
    "joint1.gamma": (0.0, 0.4),
    "joint2.gamma": (3.0, 0.05),
    "joint3.gamma": (0.7, 0.2),
}
FAR = {f"joints.joint{i}.gamma.damping": c for i, c in ((1, 0.5), (2, 0.02), (3, 0.1))}


def sprung(name: str, springs: dict[str, tuple[float, float]], scale: float = 1.0) -> eomgen.Robot:
    """A built-in robot with stiffness and damping of these coordinates, times a factor."""
    robot = eomgen.load_robot(name)
    joints = []
    for joint in robot.joints:
        given = dict(joint.coordinates)
        for key, coordinate in joint.coordinates.items():
            if f"{joint.name}.{key}" in springs:
                k, c = springs[f"{joint.name}.{key}"]
                given[key] = replace(coordinate, stiffness=scale * k or None, damping=scale * c or None)
        joints.append(replace(joint, coordinates=given))
    return replace(robot, joints=tuple(joints))


@pytest.mark.soak
@pytest.mark.parametrize("seen", ["joint1.gamma", "joint2.gamma"], ids=["driven", "passive"])
def test_parameters_by_simulations(seen: str) -> None:
    """All dampers of a rigid loop from one coordinate and the drive; where it begins follows from that one, too."""
    true, far = (sprung("four_bar", {f"joint{i}.gamma": (0.0, c) for i, c in zip((1, 2, 3), all_c, strict=True)})
                 for all_c in ((0.2, 0.1, 0.3), (0.5, 0.02, 0.1)))  # fmt: skip
    names = (*output_error_kernels(), "radau_rollout", *mechanism_kernels(true))
    kernel = eomgen.build(true, kernels=tuple(dict.fromkeys(names)))
    q = kernel.assemble([0.8, 0.0, 0.0], held=["joint1.gamma"])
    v = kernel.project_velocity(q, [1.0, 0.0, 0.0], ["joint1.gamma"])
    t = np.linspace(0.0, 1.0, 301)
    u = 6.0 * np.sin(5.0 * t) + 3.0 * np.sin(17.0 * t)
    loads = InputSignals(DriveData(torque=Track(Signal.through(t, u[:, None]), np.array([0]))))
    span = {"duration": 1.0, "samples": 300, "rtol": 1e-11, "atol": 1e-13}
    found = kernel.rollout(q, v, loads=loads, method="radau", **span)[0][:, kernel.coordinates.index(seen)]
    motion = motion_from_columns({"t": t, seen: found, "joint1.gamma.drive": u}, kernel.coordinates)
    estimates = fit(far, motion, parameters=["joints.*.gamma.damping"], kernel=kernel.with_parameters(FAR)).estimates
    for i, c in ((1, 0.2), (2, 0.1), (3, 0.3)):
        assert estimates[f"joints.joint{i}.gamma.damping"].value == pytest.approx(c, rel=1e-6)


def closed_samples(kernel: eomgen.Kernel, guess: Array, free: list[str], t: Array, motions: Array) -> tuple[Array, ...]:
    """Times, and q, v, a, u of a closed motion: ``motions`` (3, T, f) are of the coordinates that move freely."""
    index = [kernel.coordinates.index(name) for name in free]
    q, v, a = (np.zeros((t.size, kernel.n)) for _ in range(3))
    place = guess
    for k in range(t.size):
        place = place.copy()
        place[index] = motions[0, k]
        q[k] = place = kernel.assemble(place, free)
    v[:, index] = motions[1]
    v = kernel.project_velocity(q, v, free)
    rest = [i for i in range(kernel.n) if i not in index]
    a[:, index] = motions[2]
    J = kernel.constraint_jacobian(q)
    missing = np.einsum("tmn,tn->tm", J, a) + kernel.constraint_bias(q, v)
    a[:, rest] -= np.einsum("tnm,tm->tn", np.linalg.pinv(J[:, :, rest], rcond=1e-10), missing)
    return q, v, a, np.asarray(kernel.inverse_dynamics(q, v, a))


def sines(t: Array, means: list[float], size: float, seed: int) -> Array:
    """Sums of sines with both derivatives, (3, T, f)."""
    rng = np.random.default_rng(seed)
    w, phase = rng.uniform(2.0, 9.0, (4, len(means))), rng.uniform(0.0, 6.0, (4, len(means)))
    angle = t[:, None, None] * w + phase
    parts = size * np.sin(angle), size * w * np.cos(angle), -size * w**2 * np.sin(angle)
    return np.stack([part.sum(axis=1) + (means if i == 0 else 0.0) for i, part in enumerate(parts)])


def recorded(kernel: eomgen.Kernel, t: Array, samples: tuple[Array, ...], *, rates: bool) -> MeasuredMotion:
    """The samples as a file has them, drives at the driven coordinates."""
    return motion_from_columns(columns_of(kernel, t, samples, rates=rates), kernel.coordinates)


def columns_of(kernel: eomgen.Kernel, t: Array, samples: tuple[Array, ...], *, rates: bool) -> dict[str, Array]:
    q, v, a, u = samples
    found = {"t": t}
    for i, name in enumerate(kernel.coordinates):
        found[name] = q[:, i]
        if rates:
            found |= {f"{name}.rate": v[:, i], f"{name}.acceleration": a[:, i]}
        if u[:, i].any():
            found[f"{name}.drive"] = u[:, i]
    return found


def four_bar_samples(built: Build, t: Array) -> tuple[eomgen.Robot, eomgen.Kernel, tuple[Array, ...]]:
    """A linkage whose springs are not those of its description, which comes with its kernel."""
    robot = sprung("four_bar", SPRINGS, 0.3)
    kernel = built(robot, *fitting_kernels(robot))
    other = sprung("four_bar", SPRINGS)
    true = built(other, *fitting_kernels(other))
    guess = true.assemble(np.array([1.0, -0.5, 1.0]))
    return robot, kernel, closed_samples(true, guess, ["joint1.gamma"], t, sines(t, [1.2], 0.25, 3))


@pytest.mark.soak
def test_a_linkage_from_exact_samples(built: Build) -> None:
    """Five parameters by one measured drive, to round-off; the loop's forces need not be known."""
    t = np.arange(1200) * 2e-3
    robot, kernel, samples = four_bar_samples(built, t)
    result = fit(robot, recorded(kernel, t, samples, rates=True), kernel=kernel)
    assert not result.warnings
    for name, (k, c) in SPRINGS.items():
        assert (result[name].stiffness is None) == (k == 0.0)
        if result[name].stiffness is not None:
            assert result[name].stiffness.value == pytest.approx(k, rel=1e-8)
            assert result[name].stiffness.described == pytest.approx(0.3 * k)
        assert result[name].damping is not None
        assert result[name].damping.value == pytest.approx(c, rel=1e-8)


@pytest.mark.soak
def test_a_linkage_from_noisy_coordinates(built: Build, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Rates and accelerations are derived; on the command line, too."""
    t = np.arange(3000) * 1e-3
    robot, kernel, (q, v, a, u) = four_bar_samples(built, t)
    exact = fit(robot, recorded(kernel, t, (q, v, a, u), rates=False), kernel=kernel)
    for entry in exact.fitted:
        for estimate, value in zip((entry.stiffness, entry.damping), SPRINGS[entry.coordinate], strict=True):
            if estimate is not None:
                assert estimate.value == pytest.approx(value, rel=5e-3)
    rng = np.random.default_rng(0)
    noisy = (q + 2e-5 * rng.standard_normal(q.shape), v, a, u * (1.0 + 1e-3 * rng.standard_normal(u.shape)))
    columns = columns_of(kernel, t, noisy, rates=False)
    motion = tmp_path / "motion.csv"
    with motion.open("w", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(columns)
        writer.writerows(np.stack(list(columns.values()), axis=1).tolist())
    found = fit(robot, motion, kernel=kernel)
    for name, (k, c) in SPRINGS.items():
        if k:
            assert found[name].stiffness is not None
            assert found[name].stiffness.value == pytest.approx(k, rel=0.03, abs=0.02)
        assert found[name].damping is not None
        assert found[name].damping.value == pytest.approx(c, rel=0.1, abs=0.01)
    description = tmp_path / "four_bar.toml"
    text = (Path(eomgen.__file__).parent / "robots" / "four_bar.toml").read_text()
    table = "gamma = { stiffness = 1.0, damping = 0.1 }\n"
    description.write_text(text.replace('name = "joint2"\n', f'name = "joint2"\n{table}'))
    assert cli.main(["fit", str(description), str(motion), "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert [entry["coordinate"] for entry in facts["fitted"]] == ["joint2.gamma"]
    assert cli.main(["fit", str(description), str(motion)]) == 0
    assert "joint2.gamma.stiffness" in capsys.readouterr().out


def test_what_a_linkage_does_not_say(built: Build) -> None:
    """Without its drive nothing, and at rest only sums of springs; names that are none are refused."""
    t = np.arange(1200) * 2e-3
    robot, kernel, samples = four_bar_samples(built, t)
    columns = columns_of(kernel, t, samples, rates=True)
    del columns["joint1.gamma.drive"]
    with pytest.raises(InputError, match=r"drives of 'joint1\.gamma' are not known.*allowed: their drives"):
        fit(robot, motion_from_columns(columns, kernel.coordinates), kernel=kernel)
    kept = np.repeat(samples[0][:1], t.size, axis=0)
    zero = np.zeros_like(kept)
    still = fit(
        robot,
        recorded(kernel, t, (kept, zero, zero, kernel.inverse_dynamics(kept, zero, zero)), rates=True),
        kernel=kernel,
    )
    said = " ".join(still.warnings)
    assert "do not determine" in said
    assert not any(entry.damping for entry in still.fitted)
    with pytest.raises(InputError, match="joint9"):
        fit(robot, recorded(kernel, t, samples, rates=True), coordinates=["joint9.gamma"], kernel=kernel)


def test_springs_in_a_cut_joint(built: Build) -> None:
    """Springs and dampers of a cut joint's coordinates, where nothing rigid closes the loop."""
    law = "stiffness = {}, damping = {}"
    six = f"x = {{{{ {law} }}}}\ny = {{{{ {law} }}}}\ngamma = {{{{ damping = 0.02 }}}}\n"
    here = linkages(six.format(1e4, 3.0, 2e4, 3.0))[0]
    there = linkages(six.format(5e3, 1.0, 5e4, 1.0))[0]
    kernel, true = built(there, *fitting_kernels(there)), built(here, *fitting_kernels(here))
    t = np.arange(1500) * 2e-3
    angles = sines(t, [1.0], 0.2, 5)[:, :, 0]
    q = np.stack([angles[0], -0.5 + 0.05 * np.sin(7 * t), 1.44 + 0.05 * np.cos(5 * t)], axis=1)
    v = np.stack([angles[1], 0.35 * np.cos(7 * t), -0.25 * np.sin(5 * t)], axis=1)
    a = np.stack([angles[2], -2.45 * np.sin(7 * t), -1.25 * np.cos(5 * t)], axis=1)
    u = np.asarray(true.inverse_dynamics(q, v, a, cut=True))
    found = fit(there, recorded(kernel, t, (q, v, a, u), rates=True), kernel=kernel)
    for name, value in (("cut.x.stiffness", 1e4), ("cut.y.stiffness", 2e4), ("cut.x.damping", 3.0)):
        assert found.parameters[f"loops.{name}"] == pytest.approx(value, rel=1e-6)


@pytest.mark.soak
def test_a_platform_from_exact_samples(built: Build) -> None:
    """Gough's platform: springs and dampers in its legs and at its universal joints, by six measured drives."""
    springs = {
        "leg1.z": (40.0, 5.0),
        "leg4.z": (0.0, 9.0),
        "universal1.alpha": (8.0, 0.3),
        "universal5.beta": (0.0, 0.7),
    }
    robot, other = (sprung("gough", springs, scale) for scale in (0.5, 1.0))
    kernel, true = (built(each, *fitting_kernels(each)) for each in (robot, other))
    legs = [f"leg{i}.z" for i in range(1, 7)]
    home = true.assemble(np.array([robot.home.get(name, 0.0) for name in true.coordinates]))
    means = [home[true.coordinates.index(name)] for name in legs]
    t = np.arange(900) * 2e-3
    samples = closed_samples(true, home, legs, t, sines(t, means, 0.01, 2))
    result = fit(robot, recorded(kernel, t, samples, rates=True), kernel=kernel)
    assert not result.warnings
    assert {entry.coordinate for entry in result.fitted} == set(springs)
    for name, (k, c) in springs.items():
        assert result.parameters.get(f"joints.{name}.stiffness", 0.0) == pytest.approx(k, rel=1e-6)
        assert result.parameters[f"joints.{name}.damping"] == pytest.approx(c, rel=1e-6)
