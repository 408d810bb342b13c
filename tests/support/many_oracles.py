"""Checks of one of the many robots against Pinocchio, MuJoCo, and the generator's other forms."""

from __future__ import annotations

import numpy as np

from eomgen.codegen.kernels import equations
from eomgen.codegen.kernels.accelerations import FACTORISED, SOLVERS, STRAIGHT_SOLVE
from eomgen.codegen.program.passes import run_passes
from tests.oracles.mujoco_models import MujocoRobot
from tests.oracles.pinocchio_models import PinocchioOracle
from tests.support.figures import Figures
from tests.support.many_robots import Array, Subject, derived, differences, run, size_of, times

LIMIT = 1e-12  # relative to the max-norm of the state's result
EPSILON = float(np.finfo(float).eps)


def check_oracles(s: Subject, figures: Figures) -> None:
    """M, inverse dynamics and reactions of all states; a batch, and the first states one by one."""
    pinocchio, mujoco = PinocchioOracle(s.robot), MujocoRobot(s.robot)
    reactions = s.kernel.reactions(s.q, s.v, s.a)
    for name, oracle in (("Pinocchio", pinocchio), ("MuJoCo", mujoco)):
        M = np.array([oracle.mass_matrix(q) for q in s.q])
        figures.at_most(f"mass matrix, {name}", differences(s.M, M), LIMIT)
        drives = np.array([oracle.inverse_dynamics(*state) for state in zip(s.q, s.v, s.a, strict=True)])
        figures.at_most(f"inverse dynamics, {name}", differences(s.drives, drives, s.forces), LIMIT)
        wrenches = np.array([oracle.reactions(*state) for state in zip(s.q, s.v, s.a, strict=True)])
        figures.at_most(f"reactions, {name}", differences(reactions, wrenches), LIMIT)
    a = np.array([pinocchio.forward_dynamics(*state) for state in zip(s.q, s.v, s.u, strict=True)])
    check_accelerations(s, s.kernel.forward_dynamics(s.q, s.v, s.u), a, "forward dynamics, Pinocchio", figures)
    check_singles(s, figures, reactions)


def check_singles(s: Subject, figures: Figures, reactions: Array) -> None:
    """States one by one: the same bits, but where the compiler may fuse."""
    for i in (0, len(s.q) // 2, len(s.q) - 1):
        q, v, a = s.q[i], s.v[i], s.a[i]
        pairs = (
            (s.kernel.mass_matrix(q), s.M[i], None),
            (s.kernel.inverse_dynamics(q, v, a), s.drives[i], s.forces[i : i + 1]),
            (s.kernel.reactions(q, v, a), reactions[i], None),
        )
        for one, many, size in pairs:
            if s.form == "fused":
                figures.at_most("single states, fused", differences(one[None], many[None], size), LIMIT)
            else:
                assert np.array_equal(one, many), "a state alone has other bits than in a batch"


def check_forms(s: Subject, figures: Figures) -> None:
    """Folded and run-time parameters, frames as described and as they cost least: what is not compiled."""
    kept = s.kept
    n = len(s.q), s.model.size, s.model.size
    for label, model in (("folded", s.model), ("parameters", kept)):
        for frames, regrouped in (("described", False), ("cheapest", True)):
            if regrouped and label in s.form:
                continue  # this is what was compiled
            name = f"{label}, {frames} frames"
            M = run(derived(model, "mass_matrix", regrouped), model, {"q": s.q}).reshape(n)
            figures.at_most(f"mass matrix, {name}", differences(M, s.M), LIMIT)
            program = derived(model, "inverse_dynamics", regrouped)
            drives = run(program, model, {"q": s.q, "v": s.v, "a": s.a})
            figures.at_most(f"inverse dynamics, {name}", differences(drives, s.drives, s.forces), LIMIT)
        program = derived(model, "reactions", False)
        found = run(program, model, {"q": s.q, "v": s.v, "a": s.a})
        figures.at_most(f"reactions, {label}", differences(found, flat(s.kernel.reactions(s.q, s.v, s.a))), LIMIT)
        for solver in SOLVERS:
            if solver == FACTORISED and (model is kept or model.size > STRAIGHT_SOLVE):
                continue  # n^3 operations, which the generator does not write out
            if label in s.form and s.model.size > STRAIGHT_SOLVE:
                continue  # this is what was compiled
            program = run_passes(equations.derive_cheapest(model, "forward_dynamics", solver)[0])
            a = run(program, model, {"q": s.q, "v": s.v, "u": s.u})
            expected = s.kernel.forward_dynamics(s.q, s.v, s.u)
            check_accelerations(s, a, expected, f"forward dynamics, {label}, {solver}", figures)


def check_accelerations(s: Subject, found: Array, expected: Array, label: str, figures: Figures) -> None:
    """Within 100 cond(M) eps, times how much larger than M a the forces are that cancel on the right side."""
    cond = np.linalg.cond(s.M)
    cancelling = np.maximum(1.0, np.maximum(s.forces, size_of(s.u)) / size_of(times(s.M, expected)))
    error = size_of(found - expected) / size_of(expected)
    figures.at_most(f"{label} / (cond eps)", float((error / (cond * EPSILON * cancelling)).max()), 100.0)


def flat(values: Array) -> Array:
    return values.reshape(len(values), -1)
