"""A fast oracle of the derivation: programs of small robots, interpreted without a compiler, against known numbers.

Modules of the generator are looked up when a check runs, so that checks see a module that has been changed
(``mutant.mutated``).  A check that finds something wrong raises.
"""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable, Collection
from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen.errors import InputError
from eomgen.robot.model import build_model
from eomgen.robot.value import COORDINATES
from tests.support.bending_robots import bent
from tests.support.bristled import bristled_arm
from tests.support.mutant import full_name
from tests.support.mutation_cases import Case, cases, flexible_cases, small_cases
from tests.support.random_robots import Array
from tests.support.refusals import refused

Check = Callable[[], None]
CLOSE, BY_DIFFERENCES = 1e-9, 2e-6  # of the greatest entry; of what central differences say


def codegen(module: str) -> Any:
    """A module of the generator as it is now."""
    return importlib.import_module(full_name(module))


def close(found: Array, expected: Array, allowed: float, what: str) -> None:
    size = max(float(np.abs(expected).max(initial=0.0)), 1e-3)
    assert found.shape == expected.shape, what
    assert np.abs(found - expected).max(initial=0.0) <= allowed * size, what


def run(program: Any, inputs: Any) -> tuple[Array, Array]:
    """Outputs of a program, and the pivots beside them."""
    values = codegen("program.ir").evaluate(program, inputs)
    out = np.array([values["out", i] for i in range(sum(key == "out" for key, _ in values))], dtype=float)
    pivots = [float(value) for (key, _), value in sorted(values.items()) if key == "pivot"]
    return out, np.array(pivots).reshape(-1, 2)


def check_kernels(case: Case, kernels: Collection[str]) -> None:
    """Kernels of a robot against what is expected."""
    for kernel, expected in case.expected.items():
        if kernel not in kernels:
            continue
        allowed = BY_DIFFERENCES if kernel in ("implicit_step", "residual_jacobian") else CLOSE
        if kernel == "forward_dynamics":
            for solver in codegen("kernels.accelerations").SOLVERS:
                check_forward_dynamics(case, solver, expected)
        else:
            found, _ = run(codegen("kernels.equations").derive(case.model, kernel), case.inputs)
            if kernel == "regressor":  # forces without springs, of all columns together
                found = found.reshape(case.model.size, -1) @ codegen("tree.regressor").described_values(case.model)
            close(found, expected, allowed, f"{case.name}: {kernel}")


def check_forward_dynamics(case: Case, solver: str, expected: Array) -> None:
    """Accelerations of one solver, and its pivots: positive, of the size they are compared to, with M's determinant."""
    equations = codegen("kernels.equations")
    factorised = solver == codegen("kernels.accelerations").FACTORISED
    if factorised and codegen("kernels.derivation").Derivation(case.model).model.prescribed:
        return  # that one knows no prescribed coordinates
    if factorised and any(body.modes for body in case.model.bodies):
        return  # nor flexible links
    program, name = equations.derive_cheapest(case.model, "forward_dynamics", solver)
    assert name == solver
    found, pivots = run(program, case.inputs)
    close(found, expected, CLOSE, f"{case.name}: forward_dynamics, {solver}")
    value, scale = pivots.T
    assert len(value) == len(expected)
    assert np.all(value > 0.0)
    assert np.all((scale == 0.0) | ((value < 30.0 * scale) & (value > 1e-5 * scale))), f"{case.name}: pivots"
    if case.determinant is not None:
        whole = factorised or solver == codegen("kernels.accelerations").REDUCED
        product = float(np.prod(value)) * (1.0 if whole else case.left_out)
        assert abs(product / case.determinant - 1.0) < 1e-6, f"{case.name}: pivots"


def again(tests: str) -> Any:
    """A module of the tests of the generator, imported anew, so that it tests the generator as it is now."""
    name = f"tests.codegen.{tests}"
    before = sys.modules.pop(name, None)
    try:
        return importlib.import_module(name)
    finally:
        sys.modules.pop(name, None)
        parent, _, last = name.rpartition(".")
        vars(sys.modules[parent]).pop(last, None)
        if before is not None:
            sys.modules[name] = before
            setattr(sys.modules[parent], last, before)


def check_joint() -> None:
    """Elementary transforms, their derivatives and every proof."""
    tests = again("joint.test_joint")
    for name in COORDINATES:
        tests.test_step_moves_along_or_about_its_own_axis(name)
        tests.test_generator_is_constant_and_gives_the_derivative(name)
    for active in tests.SUBSETS[::5]:
        tests.test_inactive_coordinates_vanish_from_the_transform(active)
    tests.test_order_of_eq_3()
    tests.test_lemmas_name_exactly_the_zero_second_derivatives()
    tests.test_lemma_7_and_the_sharper_lemma_are_told_apart()
    tests.test_relations_inside_a_joint()
    for active in tests.SUBSETS[::7]:
        tests.test_facts_of_few_coordinates_are_those_of_all(active)
    tests.test_facts_are_written_and_read(COORDINATES)
    for name in COORDINATES:
        tests.test_steps_have_the_values_of_symbolic_ones(name)
    text = tests.text_now()
    for wrong in tests.WRONG:
        if text.count(wrong[0]) == 1:  # else a mutant has changed that very piece
            tests.test_every_proof_fails_where_its_claim_is_wrong(*wrong)
    tests.test_derivatives_against_finite_differences()


def check_elements() -> None:
    """Forces of all families together: their slopes, and the implicit step with dampers of whole joints."""
    support = "tests.support.every_element"  # which has a robot for each family as it is now
    before = sys.modules.pop(support, None)
    try:
        tests = again("forces.test_elements")
    finally:
        sys.modules.pop(support, None)
        if before is not None:
            sys.modules[support] = before
    tests.test_slopes_are_those_of_forces(tests.CASES[-1], 1)
    tests.test_energys_gradient_is_the_force_at_rest(tests.CASES[-1], 1)
    tests.test_every_number_is_a_parameter(tests.CASES[-1], 1)
    tests.test_an_implicit_step_is_its_linear_system(tests.CASES[-1], 1)
    tests.test_an_implicit_step_with_dampers_of_whole_joints(3)
    tests.test_dampers_of_whole_joints_with_a_prescribed_rotation()


def check_zeros() -> None:
    """The zero map: masks, counts, reasons and reports."""
    tests = again("joint.test_zeros")
    tests.test_report()
    tests.test_counts_of_six_joints_with_six_coordinates()
    tests.test_reasons_stand_where_entries_vanish()
    for seed in range(30):
        tests.test_map_equals_the_pattern_of_numbers(seed)
    for leaders in ({"joint1.alpha": 2.0}, {"joint1.y": 0.5, "joint2.gamma": -1.5}):
        tests.test_what_leaders_move_is_the_pattern_of_sums(leaders)
    tests.test_internal_states_have_no_rows()
    again("tree.test_offsets").test_an_offset_ends_a_coaxial_zero()
    tests = again("joint.test_zeros_of_modes")
    for seed in range(4):
        for second in (False, True):
            tests.test_map_of_links_alone_equals_the_pattern_of_numbers(seed, second)
    for seed in range(50, 58):
        tests.test_no_zero_is_invented_where_nodes_follow_modes(seed)


def check_closed_form() -> None:
    """Traces in SymPy: every term of small robots, symbols, and what they refuse."""
    tests = again("closed_form.test_trace")
    tests.test_left_sides_of_17_and_18()
    for case in small_cases():
        check_closed_form_of(case)
    tests.test_symbols_for_every_parameter()
    tests.test_names_of_symbols()
    tests.test_angles_of_a_placement_as_symbols()
    check_closed_form_of_flexible_links()
    check_closed_form_with_states()
    (springs,) = (case.model for case in cases() if case.name == "springs")
    refused(InputError, "springs between points", codegen("closed_form.trace").closed_form, springs)


def check_closed_form_of(case: Case) -> None:
    form = codegen("closed_form.trace").closed_form(case.model, external_forces=True)
    fields = ("residual", "mass_matrix", "bias", "christoffel", "generalized_force", "kinetic", "potential")
    state = [case.inputs[letter] for letter in "qvau"]
    wrench = case.inputs["wrench"].reshape(-1, 6)
    unloaded = dict(zip(fields, form.function(*fields)(*state), strict=True))
    loaded = form.function("residual", "generalized_force")(*state, wrench.tolist())
    names = {"bias": "bias_force"}
    for field in fields[:5]:
        close(np.ravel(unloaded[field]), case.expected[names.get(field, field)], CLOSE, f"{case.name}: {field}")
    Q = case.expected["external_force"]
    close(loaded[0], case.expected["residual"] - Q, CLOSE, f"{case.name}: residual under forces")
    close(loaded[1], case.expected["generalized_force"] + Q, CLOSE, f"{case.name}: Q under forces")
    energy = np.array([unloaded["kinetic"], unloaded["potential"]])
    close(energy, case.expected["energy"], CLOSE, f"{case.name}: energy")
    assert np.shape(unloaded["christoffel"]) == (case.model.size,) * 3


def check_closed_form_of_flexible_links() -> None:
    """Two robots with one flexible link each, against Lagrange's equations of its particles; and what is refused."""
    for model, s, expected in flexible_cases():
        form = codegen("closed_form.trace").closed_form(model, external_forces=True)
        found = form.function(*expected)(s.q, s.v, s.a, s.u, np.zeros((len(model.links), 6)).tolist())
        for name, value in zip(expected, found, strict=True):
            close(np.asarray(value, float), np.asarray(expected[name]), CLOSE, f"{model.name}: {name}")
    (model,) = (case.model for case in cases() if case.name == "flexible links")
    symbols = [str(x) for x in codegen("closed_form.trace")._symbols(model)[0]]
    assert symbols == ["x_1", "y_1", "z_1", "e1_1", "e2_1", "gamma_4", "e1_4", "e2_4"]
    with pytest.raises(InputError, match="knows no laws with internal states, nor servo drives"):
        codegen("closed_form.trace").closed_form(build_model(bent(bristled_arm(), 0, (1,)).robot))


def check_closed_form_with_states() -> None:
    """Forces, rates of states and energies of laws with internal states, against interpreted kernels."""
    model = build_model(bristled_arm())
    rng = np.random.default_rng(3)
    inputs = {name: 0.3 * rng.normal(size=4) for name in "qvau"} | {"z": 1e-4 * rng.normal(size=2)}
    inputs["p"] = np.array([*model.parameters.values()])
    form = codegen("closed_form.trace").closed_form(model)
    assert [str(z) for z in form.z] == ["z_gamma_1", "z_beta_2"]
    residual, rates, *energy = form.function("residual", "rates", "kinetic", "potential")(
        *(inputs[name] for name in "qvau"), z=inputs["z"]
    )
    known = (("residual", residual, slice(4)), ("forward_dynamics", rates, slice(4, 6)), ("energy", energy, slice(2)))
    for kernel, found, part in known:
        expected, _ = run(codegen("kernels.equations").derive(model, kernel), inputs)
        close(np.array(found, float), expected[part], CLOSE, f"internal states: {kernel}")


def check_parameters() -> None:
    """Programs whose parameters are read where they run, and the one that prepares them."""
    (case,) = (case for case in cases() if case.name == "parameters")
    equations = codegen("kernels.equations")
    found = equations.derive_equations(case.model, ("mass_matrix", "inverse_dynamics", "forward_dynamics_jacobian"))
    assert found.kernels == ("mass_matrix", "inverse_dynamics", "forward_dynamics_jacobian")
    assert set(found.programs) == set(found.kernels)
    assert not found.calls
    name = "forward_dynamics_jacobian"
    assert found.choices == {name: equations.derive_cheapest(case.model, name)[1]}
    rolls = equations.derive_equations(case.model, ("rollout",))
    assert set(rolls.programs) == {"forward_dynamics", "implicit_step"}
    assert set(rolls.calls) == {"rollout"}
    assert rolls.choices == {"forward_dynamics": equations.derive_cheapest(case.model, "forward_dynamics")[1]}
    prepared = codegen("program.ir").evaluate(found.setup, case.inputs)
    inputs = {**case.inputs, "h": [prepared["h", i] for i in range(len(prepared))]}
    for kernel, program in found.programs.items():
        assert "p" not in program.inputs()
        if kernel in case.expected:
            close(run(program, inputs)[0], case.expected[kernel], CLOSE, f"prepared parameters: {kernel}")
    for kernel, what in (("spring_forces", "springs"), ("constraint", "loops")):
        refused(InputError, rf"{kernel}.*\[\[{what}\]\]", equations.derive_equations, case.model, (kernel,))


# Multiplications, sums and divisions of programs at most: what pruning and the choice of frames leave.
COUNTED = ("mass_matrix", "inverse_dynamics", "forward_dynamics", "coriolis_matrix", "energy", "kinematics")
COUNTS: dict[str, tuple[tuple[int, int, int], ...]] = {
    "chain": ((28, 27, 0), (119, 105, 0), (213, 169, 5), (170, 139, 0), (142, 95, 0), (90, 71, 0)),
    "tree": ((184, 139, 0), (282, 219, 0), (540, 407, 7), (628, 471, 0), (288, 198, 0), (197, 151, 0)),
    "free": ((368, 263, 0), (363, 287, 0), (380, 297, 3), (1301, 961, 0), (369, 242, 0), (261, 171, 0)),
    "rotors of free bodies": (
        (532, 406, 0),
        (367, 308, 0),
        (806, 630, 10),
        (1800, 1335, 0),
        (347, 239, 0),
        (183, 134, 0),
    ),
    "six rotors": ((106, 97, 0), (187, 149, 0), (456, 362, 7), (431, 340, 0), (169, 108, 0), (77, 60, 0)),
    "prescribed": ((107, 94, 0), (285, 232, 0), (413, 353, 5), (520, 404, 0), (311, 203, 0), (177, 122, 0)),
    # both ends of its clearance damp by the penetration's rate, d'(x) v: a product at each end, c v is shared
    # and penetrations within a smoothing are the smaller of two: changes of sign, which count as sums
    "motors": ((55, 43, 0), (158, 126, 5), (300, 216, 9), (232, 167, 0), (168, 112, 1), (102, 78, 0)),
    "springs": ((80, 73, 0), (506, 468, 15), (669, 595, 20), (335, 277, 0), (332, 316, 10), (126, 96, 0)),
    "puma560": ((89, 90, 0), (193, 169, 0), (327, 288, 4), (398, 327, 0), (155, 93, 0), (66, 52, 0)),
    "ur5": ((84, 84, 0), (179, 151, 0), (308, 269, 4), (378, 312, 0), (143, 84, 0), (64, 50, 0)),
    "puma560_elastic": ((2315, 1476, 0), (706, 591, 0), (879, 696, 12), (8253, 5622, 0), (643, 413, 0), (242, 162, 0)),
}


def check_counts(kernels: Collection[str]) -> None:
    """No program does more operations than it did."""
    derive = codegen("kernels.equations").derive
    models = {case.name: case.model for case in cases()}
    for name, counts in COUNTS.items():
        model = models[name] if name in models else build_model(eomgen.load_robot(name))
        for kernel, most in zip(COUNTED, counts, strict=True):
            if kernel not in kernels:
                continue
            count = derive(model, kernel).count()
            assert all(count[key] <= n for key, n in zip(("mul", "add", "div"), most, strict=True)), (name, kernel)


KERNELS = (
    "inverse_dynamics",
    "mass_matrix",
    "forward_dynamics",
    "coriolis_matrix",
    "residual",
    "bias_force",
    "generalized_force",
    "energy",
    "kinematics",
    "external_force",
    "reactions",
    "external_reactions",
    "implicit_step",
    "christoffel",
    "residual_jacobian",
    "regressor",
)
SOLVERS = ("forward_dynamics", "implicit_step")
PART_OF: dict[str, tuple[str, ...]] = {  # kernels that a module takes part in, where it is not all
    "joint.facts": ("inverse_dynamics", "kinematics"),
    "tree.recursion": (
        "inverse_dynamics",
        "bias_force",
        "reactions",
        "energy",
        "external_force",
        "external_reactions",
        "mass_matrix",
        "forward_dynamics",
        "implicit_step",
        "coriolis_matrix",
        "regressor",
    ),
    "tree.composite": ("mass_matrix", "coriolis_matrix", "christoffel", *SOLVERS, "residual_jacobian"),
    "solve.articulated": SOLVERS,
    "solve.elimination": SOLVERS,
    "solve.free_bodies": SOLVERS,
    "kernels.accelerations": SOLVERS,
    "solve.factorised": ("forward_dynamics",),
    **dict.fromkeys(
        ("forces.coordinates", "forces.transmissions"),
        ("generalized_force", "inverse_dynamics", "implicit_step", "energy", "residual_jacobian", "residual"),
    ),
    "tree.regressor": ("regressor",),
    "tree.kinematics": ("kinematics", "energy", "external_force", "external_reactions"),
}


def kernel_checks(kernels: Collection[str]) -> list[Check]:
    """Robot by robot, then operation counts."""
    robots: list[Check] = [lambda case=case: check_kernels(case, kernels) for case in cases()]  # type: ignore[misc]
    return [*robots, lambda: check_counts(kernels)]


def checks(module: str) -> list[Check]:
    """The checks that look at a module, the most deadly ones first."""
    full_name(module)  # raises where there is none
    kernels = kernel_checks(PART_OF.get(module, KERNELS))
    if module in ("joint.lemmas", "joint.deriving"):
        return [check_joint]
    if module == "joint.facts":
        return [check_joint, *kernels[:3], check_zeros]
    if module == "joint.zeros":
        return [check_zeros]
    if module == "closed_form.trace":
        return [check_closed_form]
    if module in ("forces.coordinates", "forces.transmissions", "tree.bound", "tree.spatial"):
        return [*kernels, check_elements, check_closed_form]
    if module in ("solve.elimination", "solve.articulated"):
        return [*kernels, check_elements]
    return (
        [*kernels, check_parameters] if module in ("kernels.equations", "kernels.derivation", "tree.bound") else kernels
    )


def every_check() -> list[Check]:
    """All of them."""
    return [*kernel_checks(KERNELS), check_joint, check_zeros, check_closed_form, check_elements, check_parameters]
