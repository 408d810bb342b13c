"""Equations for a reader: what is printed is parsed again and compared with the paper and with Pinocchio."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import sympy as sp
from matplotlib.mathtext import MathTextParser

import eomgen
from eomgen.cli import entry as cli
from eomgen.codegen.closed_form.readable import ReadableClosedForm, readable_closed_form, simplified
from eomgen.codegen.kernels.constraint_rows import Rank
from eomgen.robot import JointDamping, JointStiffness
from eomgen.robot.model import build_model
from tests.loops.test_elastic_cuts import coupled, linkages
from tests.oracles.paper_example import equal
from tests.oracles.pinocchio_models import PinocchioOracle
from tests.support.builds import Build
from tests.support.random_robots import random_robot, random_state

TITLE = "constraint g(q) = 0 of loops and couplings, and its derivatives J; others are zero"


def parsed(form: ReadableClosedForm) -> list[tuple[sp.Expr, sp.Expr]]:
    """Both sides of the printed equations."""
    form_lines = form.lines()
    equations = form_lines[form_lines.index("equations of motion, eq. (10)") + 1 :]
    letters = [*(x.symbol for x in form.letters), *form.form.v, *form.form.a, *form.form.u]
    names = {str(symbol): symbol for symbol in letters}
    return [tuple(sp.parse_expr(side, local_dict=names) for side in line.split(" = ")) for line in equations]  # type: ignore[misc]


def test_the_papers_example_reads_as_in_the_paper() -> None:
    """Eqs. (17) to (19) with c = l/2 and I = m l^2 / 12; gravity along -Y0, see the errata."""
    form = readable_closed_form(build_model(eomgen.load_robot("one_link")))
    m, length, a, g, x, gamma, xd, gd, xdd, gdd, D = sp.symbols("m l a g x gamma xd gd xdd gdd D")
    letters = {
        "m_link1": m,
        "c_x_link1": length / 2,
        "I_zz_link1": m * length**2 / 12,
        "a_x_joint1": a,
        "g_y": -g,
        "x_1": x,
        "gamma_1": gamma,
        "xdot_1": xd,
        "gammadot_1": gd,
        "xddot_1": xdd,
        "gammaddot_1": gdd,
        "D_gamma_1": D,
    }
    (left_x, right_x), (left_g, right_g) = (
        tuple(side.subs({s: letters[str(s)] for s in side.free_symbols}) for side in sides) for sides in parsed(form)
    )
    half = m * length / 2
    assert equal(left_x, m * xdd - half * sp.sin(gamma) * gdd - half * sp.cos(gamma) * gd**2)
    assert equal(right_x, -a * x)
    assert equal(left_g, m * length**2 / 3 * gdd - half * sp.sin(gamma) * xdd)
    assert equal(right_g, D - half * g * sp.cos(gamma))
    text = "\n".join(form.lines())
    assert "M[x_1, x_1] = m_link1\n" in text
    assert "C[x_1; gamma_1, gamma_1] = -c_x_link1*m_link1*cos(gamma_1)" in text
    assert "m_link1 = links.link1.mass: 1.0 kg" in text
    latex = form.latex()
    assert r"M_{1}^{x x} &= m_{link1} \\" in latex
    assert r"C_{1}^{x \gamma \gamma} &= - c_{x,link1} m_{link1} \cos{\left(\gamma_{1} \right)}" in latex
    assert r"&= - a_{x,joint1} x_{1}" in latex


@pytest.mark.parametrize(
    ("seed", "numbers"),
    [
        (0, False),
        pytest.param(1, True, marks=pytest.mark.soak),
        *(pytest.param(*case, marks=pytest.mark.soak) for case in ((4, True), (1, False), (5, False), (2, True))),
    ],
)
def test_printed_equations_of_random_robots_are_those_of_pinocchio(seed: int, numbers: bool) -> None:
    robot = random_robot(seed, max_size=3)
    form, oracle, state = (
        readable_closed_form(build_model(robot), numbers=numbers),
        PinocchioOracle(robot),
        random_state(robot, seed),
    )
    values = {letter.symbol: letter.value for letter in form.letters if letter.value is not None}
    assert bool(values) != numbers
    rows = (form.form.q, form.form.v, form.form.a)
    for symbols, numbers_of in zip(rows, (state.q, state.v, state.a), strict=True):
        values |= dict(zip(symbols, numbers_of.tolist(), strict=True))
    values |= dict.fromkeys(form.form.u, 0.0)
    found = [float((left - right).evalf(subs=values)) for left, right in parsed(form)]
    expected = oracle.inverse_dynamics(state.q, state.v, state.a)
    assert np.abs(np.array(found) - expected).max() < 1e-9 * max(np.abs(expected).max(), 1.0)


@pytest.mark.parametrize("numbers", [False, True])
def test_matrices_are_in_the_printed_equations(numbers: bool, built: Build) -> None:
    """Entries have symbols of their own; the equations are the kernel's residual, the preload among the forces."""
    robot = eomgen.load_robot("one_link")
    stiffness = JointStiffness({"x.x": 9.0, "x.gamma": 2.0, "gamma.gamma": 4.0}, {"gamma": 0.5})
    damping = JointDamping(entries={"x.x": 0.9, "x.gamma": -0.2, "gamma.gamma": 0.3})
    robot = replace(robot, joints=(replace(robot.joints[0], stiffness=stiffness, damping=damping),))
    form, kernel = readable_closed_form(build_model(robot), numbers=numbers), built(robot, "residual")
    rng = np.random.default_rng(2)
    q, v, a, u = rng.uniform(-0.5, 0.5, (4, kernel.n))
    u[0] = 0.0  # printed drives are those of joints
    values = {letter.symbol: letter.value for letter in form.letters if letter.value is not None}
    assert bool(values) != numbers
    assert numbers or {2.0, -0.2} <= set(values.values())
    for symbols, row in zip((form.form.q, form.form.v, form.form.a, form.form.u), (q, v, a, u), strict=True):
        values |= dict(zip(symbols, row.tolist(), strict=True))
    found = [float((left - right).evalf(subs=values)) for left, right in parsed(form)]
    assert found == pytest.approx(kernel.residual(q, v, a, u), rel=1e-12, abs=1e-12)


@pytest.mark.soak
def test_latex_is_mathematics() -> None:
    """Every formula is read by another program."""
    latex = readable_closed_form(build_model(random_robot(1, max_size=3)), numbers=True).latex()
    parser = MathTextParser("path")
    rows = [row for row in latex.splitlines() if not row.startswith(("%", "\\begin", "\\end"))]
    assert len(rows) > 5
    for row in rows:
        parser.parse(f"${row.removesuffix(chr(92) * 2).replace('&', '')}$")


def test_simplification_finds_zeros_and_sums_of_angles() -> None:
    x, y, m = sp.symbols("x y m", real=True)
    assert simplified(m * sp.sin(x) ** 2 + m * sp.cos(x) ** 2 - m) == 0
    assert simplified(m * (sp.cos(x) * sp.cos(y) - sp.sin(x) * sp.sin(y))) == m * sp.cos(x + y)
    assert simplified(1.5 * sp.cos(x) + 6e-17 * sp.sin(x)) == 1.5 * sp.cos(x)


@pytest.mark.soak
def test_large_robots_are_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["derive", "puma560_elastic"]) == 1
    assert "36 coordinates; a closed form is derived for at most 6" in capsys.readouterr().err
    assert cli.main(["derive", "puma560"]) == 1
    assert "operations; at most 20000" in capsys.readouterr().err


def test_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["derive", "one_link"]) == 0
    assert "M[x_1, gamma_1] = -c_x_link1*m_link1*sin(gamma_1)" in capsys.readouterr().out
    target = tmp_path / "deep" / "one.tex"
    assert cli.main(["derive", "one_link", "--latex", "--numbers", "-o", str(target)]) == 0
    assert r"M_{1}^{x \gamma} &= - \frac{\sin{\left(\gamma_{1} \right)}}{2}" in target.read_text()
    assert cli.main(["derive", "one_link", "-o", "/dev/null/x"]) == 1
    assert "/dev/null/x" in capsys.readouterr().err


@pytest.mark.parametrize("numbers", [False, True])
def test_equations_of_a_mechanism_are_those_of_its_kernel(numbers: bool, built: Build) -> None:
    """What is printed of the constraint, its Jacobian and the balance of forces, with numbers put in."""
    robot = eomgen.load_robot("four_bar")
    kernel = built(robot, "constraint", "constraint_jacobian", "tree_inverse_dynamics")
    form = readable_closed_form(build_model(robot), numbers=numbers)
    rng = np.random.default_rng(3)
    q, v, a, multipliers = rng.uniform(-1.0, 1.0, (4, 5))
    q, v, a = q[:3], v[:3], a[:3]
    rows = (form.form.q, form.form.v, form.form.a, tuple(part.multiplier for part in form.constraint))
    values = {letter.symbol: letter.value for letter in form.letters if letter.value is not None}
    for symbols, found in zip(rows, (q, v, a, multipliers), strict=True):
        values |= dict(zip(symbols, found.tolist(), strict=True))
    values |= dict.fromkeys(form.form.u, 0.0)
    lines, names = form.lines(), {str(symbol): symbol for symbol in values}
    said: dict[str, float] = {}
    for line in lines[lines.index(TITLE) + 1 :]:
        label, _, text = line.strip().partition(" = ")
        if label.startswith(("g[", "J[")):
            said[label] = float(sp.parse_expr(text.split(" in every")[0], local_dict=names).evalf(subs=values))
    J, n = np.zeros((5, 3)), [str(symbol) for symbol in form.form.q]
    for r, component in enumerate(kernel.constraints):
        for i, symbol in enumerate(n):
            J[r, i] = said.pop(f"J[{component}, {symbol}]", 0.0)
    assert [said.pop(f"g[{component}]") for component in kernel.constraints] == pytest.approx(kernel.constraint(q))
    assert not said
    assert np.allclose(J, kernel.constraint_jacobian(q), rtol=1e-12, atol=1e-12)
    residual = [float((left - right).evalf(subs=values)) for left, right in parsed(form)]
    assert residual == pytest.approx(kernel.inverse_dynamics(q, v, a, cut=True) - J.T @ multipliers)
    assert form.rank == Rank(1, ())
    assert sum("D_gamma" in line for line in lines) == 1  # the crank alone has a drive
    assert [x.name for x in form.constraint if not x.jacobian_row] == ["joint4.z", "joint4.alpha", "joint4.beta"]


@pytest.mark.soak
def test_redundant_rows_are_said() -> None:
    """Bennett's linkage in space has three rows too many."""
    form = readable_closed_form(build_model(eomgen.load_robot("bennett")), numbers=True)
    assert form.rank is not None
    assert form.rank.freedoms == 1
    assert len(form.rank.redundant) == 3
    assert r"\lambda_{1}" in form.latex()


@pytest.mark.soak
def test_elastic_coordinates_of_a_cut_are_forces(built: Build) -> None:
    """As in the kernel of the tree."""
    robot = linkages("x = { stiffness = 1e4, damping = 3.0 }\ny = { stiffness = 2e4 }\n")[0]
    kernel, form = built(robot, "tree_inverse_dynamics"), readable_closed_form(build_model(robot))
    assert any(letter.meaning == "loops.cut.x.stiffness" for letter in form.letters)
    q, v, a = np.random.default_rng(2).uniform(-1.0, 1.0, (3, 3))
    values = {letter.symbol: letter.value for letter in form.letters if letter.value is not None}
    for symbols, found in zip((form.form.q, form.form.v, form.form.a), (q, v, a), strict=True):
        values |= dict(zip(symbols, found.tolist(), strict=True))
    values |= dict.fromkeys((*form.form.u, *(part.multiplier for part in form.constraint)), 0.0)
    residual = [float((left - right).evalf(subs=values)) for left, right in parsed(form)]
    assert residual == pytest.approx(kernel.inverse_dynamics(q, v, a, cut=True), rel=1e-9)


def test_a_coupling_has_its_equation() -> None:
    form = readable_closed_form(build_model(coupled("")))
    assert "  g[gear] = 2*gamma_1 + gamma_2 - 0.1" in form.lines()
    assert form.rank == Rank(1, ())
    parser = MathTextParser("path")
    for row in form.latex().splitlines():
        if not row.startswith(("%", "\\begin", "\\end")):
            parser.parse(f"${row.removesuffix(chr(92) * 2).replace('&', '')}$")


def test_equations_of_trees_have_no_constraint() -> None:
    plain = readable_closed_form(build_model(eomgen.load_robot("one_link")))
    assert plain.rank is None
    assert "constraint" not in "".join(plain.lines()) + plain.latex()
