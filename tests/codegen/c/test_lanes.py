"""Results of several states at a time: which numbers are kept, and where they stand."""

from __future__ import annotations

import re

import pytest

import eomgen
from eomgen.codegen.c.lanes import pack
from eomgen.codegen.c.sources import render
from eomgen.codegen.kernels import acceleration_slopes
from eomgen.codegen.kernels.equations import derive, derive_equations
from eomgen.codegen.program.ir import Graph, finish
from eomgen.robot.model import Model, build_model
from tests.support.random_robots import random_robot


def branches() -> Model:
    """Twelve joints on several branches: many zeros."""
    return build_model(random_robot(3, joints=(12, 12), tree=True, types=("revolute",), max_coordinates=1, name="tree"))


def test_what_repeats_is_kept_once() -> None:
    model = branches()
    program = derive(model, "mass_matrix")
    packing = pack(program)
    assert packing is not None
    assert len(packing.places) == model.size**2
    assert packing.size == len(set(program.outputs.values())) <= model.size * (model.size + 1) / 2
    for place, number in enumerate(packing.places):
        assert packing.program.outputs["out", number] == program.outputs["out", place]
    assert sorted(packing.program.outputs) == [("out", number) for number in range(packing.size)]
    assert packing.program.instructions == program.instructions


@pytest.mark.parametrize("kernel", ["inverse_dynamics", "mass_matrix"])
def test_few_or_different_results_stay_where_they_are(kernel: str) -> None:
    assert pack(derive(build_model(eomgen.load_robot("one_link")), kernel)) is None


def test_other_arrays_stay_as_they_are() -> None:
    graph = Graph()
    x = graph.input("q", 0)
    repeated = {("out", i): x for i in range(100)}
    packing = pack(finish(graph, "made_up", {**repeated, ("pivot", 0): x, ("pivot", 1): 2.0 * x}))
    assert packing is not None
    assert packing.places == (0,) * 100
    assert [key for key in packing.program.outputs if key[0] == "pivot"] == [("pivot", 0), ("pivot", 1)]


def test_composed_kernels_find_every_result_in_its_place(monkeypatch: pytest.MonkeyPatch) -> None:
    """A kernel that another one calls is there with all its places, and as what its batch writes from."""
    model = branches()
    monkeypatch.setattr(acceleration_slopes, "MOST_PRODUCTS", -1)  # a solution in loops, as of long ones
    alone = render(derive_equations(model, ("residual_jacobian",)), "float64").code
    assert "tree_residual_jacobian_packed(" in alone
    assert "tree_residual_jacobian_lanes(" not in alone
    called = render(derive_equations(model, ("residual_jacobian", "forward_dynamics_jacobian")), "float64").code
    assert re.search(r"static int tree_residual_jacobian_lanes\(.*\n\{\n    lanes packed\[\d+\];", called)
    only = render(derive_equations(model, ("forward_dynamics_jacobian",)), "float64").code
    assert "tree_residual_jacobian_packed(" not in only
    assert "tree_residual_jacobian_lanes(" in only
