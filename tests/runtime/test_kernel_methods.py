"""Methods of kernels that are written from the table of kernels, and the names that a kernel has."""

from __future__ import annotations

import inspect

import numpy as np
import pytest

import eomgen
from eomgen.codegen.kernels.signatures import OWN_KERNELS
from eomgen.kernel import Kernel, kernel_methods
from eomgen.kernel.functions import Functions
from release.kernel_methods import PATH, documented, module, public
from tests.support.builds import Build

pytestmark = [pytest.mark.quick, pytest.mark.usefixtures("unoptimised")]

MOST_FURTHER = 16  # names of methods and properties in addition to those of the contract
CONTRACT = frozenset(
    (
        *("mass_matrix", "bias_force", "generalized_force", "residual", "inverse_dynamics", "forward_dynamics"),
        *("coriolis_matrix", "christoffel", "frame_pose", "frame_jacobian", "energy", "reactions", "gravity"),
        *("nonlinear_effects", "frame_velocity", "frame_acceleration", "center_of_mass", "centroidal_momentum"),
        *("constraint_forces", "loop_reactions", "loop_coordinates", "assemble", "project_velocity", "rollout"),
        *("jvp", "vjp", "hessian", "parameter_jacobian", "rollout_gradient", "jet", "followers", "device"),
        *("inverse_kinematics", "internal_state_derivatives"),
    )
)


def test_the_module_is_what_the_table_makes() -> None:
    """``python -m release.kernel_methods`` writes it."""
    now = PATH.read_text(encoding="utf-8")
    assert module(now) == now


def test_a_new_kernel_has_the_text_of_the_table_at_first() -> None:
    signature = OWN_KERNELS["mass_matrix"]
    assert module("").count("    def ") == len([*public()])
    assert documented(signature, "") == signature.text
    assert "def mass_matrix(self, q: ArrayLike, *, out: Array | None = None) -> Array:" in module("")


def test_methods_are_those_of_the_class(built: Build) -> None:
    """A kernel keeps functions of the extension module under the names of the class; a copy has none of them."""
    kernel = built(eomgen.load_robot("one_link"), "mass_matrix")
    kernel.mass_matrix(np.zeros(2))
    own = {name for name, value in vars(kernel).items() if callable(value) and not name.startswith("_")}
    assert own <= {"mass_matrix"}
    for name in own:
        assert vars(kernel)[name].__wrapped__.__func__ is getattr(Kernel, name).__func__
    assert not own & vars(kernel.replaced()).keys()
    for name, _ in public():
        assert getattr(Functions, name).__module__ == kernel_methods.__name__
        assert "out" in inspect.signature(getattr(Functions, name)).parameters


def test_names_of_kernels_stay_few() -> None:
    names = {name for name in dir(Kernel) if not name.startswith("_")}
    assert names >= CONTRACT
    assert len(names - CONTRACT) <= MOST_FURTHER
    said = inspect.getdoc(Kernel) or ""
    assert [name for name in sorted(names - CONTRACT) if f"``{name}``" not in said] == []
