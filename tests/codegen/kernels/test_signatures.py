"""The table of kernels: kinds that agree with what an entry says, and functions that follow from it."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import eomgen.templates
from eomgen.codegen.c import lanes
from eomgen.codegen.c.sources import render
from eomgen.codegen.forces.bushings import Bushings
from eomgen.codegen.kernels.derived import BACKWARDS, GRADIENTS, ORDERS
from eomgen.codegen.kernels.entries import KINDS, Signature
from eomgen.codegen.kernels.equations import derive_equations
from eomgen.codegen.kernels.signatures import DERIVATIVES, KERNELS, SIGNATURES, by_kind, functions, shapes
from eomgen.codegen.kernels.stages import PAIR_STAGES, STAGES
from eomgen.codegen.kernels.writers import VARIANTS, WRITERS
from eomgen.description.load import robot_from_toml
from eomgen.robot.model import build_model
from eomgen.robot.value import Sensor
from tests.support.builds import Build
from tests.support.every_element import robot_with
from tests.support.random_followers import with_followers

MOST_NAMES = 350
TEMPLATES = Path(eomgen.templates.__path__[0], "composed")
OF_A_KIND: dict[str, Callable[[str, Signature], bool]] = {
    "program": lambda name, _: name in {**WRITERS, **VARIANTS} or name in (*STAGES, *PAIR_STAGES),
    "tangent": lambda name, entry: is_derivative(name, entry),
    "adjoint": lambda name, entry: is_derivative(name, entry),
    "hessian": lambda name, entry: is_derivative(name, entry),
    "jet": lambda name, entry: is_derivative(name, entry) and name.endswith(f"_jet{entry.order}"),
    "frames": lambda name, entry: name in WRITERS and bool(entry.functions) and is_written(name),
    "composed": lambda name, entry: entry.calls and set(entry.calls) >= set(entry.counts) and is_written(name),
    "rollout": lambda name, entry: entry.calls and set(entry.calls) >= set(entry.counts),
    "adaptive": lambda name, entry: entry.calls and set(entry.calls) >= set(entry.counts),
    "gradient": lambda name, entry: entry.calls and set(entry.calls) >= set(entry.counts),
}


def is_written(name: str) -> bool:
    return (TEMPLATES / f"{name}.c.jinja").is_file()


def is_derivative(name: str, entry: Signature) -> bool:
    functions = {*SIGNATURES.compiled, *KERNELS["kinematics"].functions}
    return entry.derivative_of in functions and name not in WRITERS and name.startswith(f"{entry.derivative_of}_")


@pytest.mark.parametrize("name", SIGNATURES.compiled)
def test_an_entry_has_what_its_kind_needs(name: str) -> None:
    entry = SIGNATURES.compiled[name]
    assert entry.kind in KINDS
    assert OF_A_KIND[entry.kind](name, entry)
    derived = ("tangent", "adjoint", "hessian", "jet", "gradient")
    assert (entry.derivative_of != "") == (entry.kind in derived)
    assert (entry.order > 0) == (entry.kind == "jet")
    assert (entry.functions != {}) == (entry.kind == "frames")
    assert (entry.calls != ()) == (entry.kind in ("composed", "rollout", "adaptive", "gradient"))
    assert set(entry.calls) <= {*WRITERS, *VARIANTS, *STAGES, *PAIR_STAGES, *DERIVATIVES.compiled, *BACKWARDS}
    assert entry.columns_of == "" or (entry.columns_of in WRITERS and is_written(name))


def test_names_of_kernels_stay_few() -> None:
    """Orders of time derivatives, and what derivatives are by, are arguments of one kernel, no further kernels."""
    names = {*SIGNATURES, *(function for entry in SIGNATURES.values() for function in entry.functions)}
    assert len(names) <= MOST_NAMES
    assert {*SIGNATURES["energy_jet"].variants} == {f"energy_jet{order}" for order in ORDERS}
    assert {*SIGNATURES["energy_adjoint"].variants} == {"energy_adjoint", "energy_parameter_adjoint", "energy_hessian"}
    assert "energy_jet" not in SIGNATURES.compiled
    assert "energy_jet2" not in set(SIGNATURES)
    assert SIGNATURES["energy_jet2"].order == 2


def test_derivatives_are_those_that_a_kernel_names() -> None:
    for name, entry in DERIVATIVES.compiled.items():
        owner = KERNELS["kinematics"].functions.get(entry.derivative_of) or KERNELS[entry.derivative_of]
        assert entry.kind in owner.derivatives, name


def test_every_array_has_a_shape() -> None:
    robots = [eomgen.load_robot(name) for name in ("one_link", "four_bar", "balanced_arm", "hexapod_elastic")]
    robots.append(with_followers(eomgen.load_robot("puma560"), 1))
    robots.append(robot_from_toml(robot_with(Bushings)))
    robots.append(replace(robots[0], sensors=(Sensor("imu", "link1"),)))
    known = {key for robot in robots for key in shapes(build_model(robot))} | {
        "kept",
        "pair_kept",
    }  # which programs are cut by
    parts = [part for entry in KERNELS.compiled.values() for part in entry.functions.values()]
    public = [entry for name, entry in SIGNATURES.compiled.items() if name not in BACKWARDS]
    for entry in (*public, *parts):
        assert {*entry.reads, entry.writes} <= known


def test_functions_are_in_the_order_of_packages() -> None:
    """Frames behind all others, rollouts last."""
    found = functions(reversed(tuple(KERNELS.compiled)))
    assert found == functions(iter(KERNELS.compiled))
    last = ("kinematics", "rollout", "adaptive_rollout", "radau_rollout", *GRADIENTS)
    count = len(last) + 1
    assert [function.name for function in found[-count:]] == ["frame_pose", "frame_jacobian", *last[1:]]
    assert [function.name for function in found[:-count]] == [x for x in KERNELS.compiled if x not in last]
    assert [function.kernel for function in found[-count:]] == ["kinematics", *last]
    assert functions([]) == []
    assert by_kind(["rollout", "forward_dynamics_jacobian", "kinematics", "mass_matrix"]) == [
        "mass_matrix",
        "kinematics",
        "forward_dynamics_jacobian",
        "rollout",
    ]


@pytest.mark.soak
def test_kernels_too_large_for_vectors(built: Build, empty_cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Their batches, of every kind, are loops over single states and give the same numbers."""
    robot = eomgen.load_robot("one_link")
    kernels = []
    for name, limit in (("in_lanes", lanes.LANE_VALUES), ("in_loops", 0)):  # the cache does not know of the limit
        monkeypatch.setattr(lanes, "LANE_VALUES", limit)
        kernels.append(built(replace(robot, name=name)))
    fast, slow = kernels
    code = slow.raw.source("c")
    assert "_lanes(" not in slow.raw.libraries.source("in_loops_batch.c")
    assert "in_loops_frame_pose_batch" in code
    assert "in_loops_kinematics_batch" not in code
    rng = np.random.default_rng(5)
    q, v, u = rng.uniform(-1.0, 1.0, (3, 9, 2))
    for frame in fast.frames:
        assert np.array_equal(slow.frame_pose(q, frame), fast.frame_pose(q, frame))
        assert np.array_equal(slow.frame_jacobian(q, frame), fast.frame_jacobian(q, frame))
    assert np.array_equal(slow.inverse_dynamics(q, v, u), fast.inverse_dynamics(q, v, u))
    assert np.array_equal(slow.forward_dynamics_jacobian(q, v, u), fast.forward_dynamics_jacobian(q, v, u))
    for method in ("rk4", "implicit"):
        ends = [kernel.rollout(q, v, u, 1e-4, 8, method=method) for kernel in kernels]
        assert np.array_equal(*ends)


def test_metadata_keeps_what_older_readers_know() -> None:
    """The key "kernels" holds what each reads and writes and nothing else; kinds are in "functions"."""
    meta = json.loads(render(derive_equations(build_model(eomgen.load_robot("one_link")))).meta)
    assert meta["kernels"]["mass_matrix"] == {"reads": ["q"], "writes": "matrix"}
    assert {"kinematics", "rollout"} <= set(meta["kernels"])
    assert meta["functions"]["frame_pose"] == {
        "kernel": "kinematics",
        "kind": "frames",
        "reads": ["q"],
        "writes": "pose",
    }
    assert set(meta["functions"]) - set(meta["kernels"]) == {"frame_pose", "frame_jacobian"}
