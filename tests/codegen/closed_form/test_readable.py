"""Equations for a reader: what is printed is parsed again and compared with the paper, Pinocchio and kernels."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sympy as sp
from matplotlib.mathtext import MathTextParser

import eomgen
from eomgen.cli import entry as cli
from eomgen.codegen.closed_form.readable import ReadableClosedForm, readable_closed_form, simplified
from eomgen.codegen.closed_form.trace import closed_form
from eomgen.codegen.kernels.constraint_rows import Rank
from eomgen.description.load import load_robot, robot_from_toml
from eomgen.errors import InputError
from eomgen.robot import JointDamping, JointStiffness
from eomgen.robot.model import build_model
from eomgen.robot.value import Coordinate, Joint, Link, LinkModes, Node, Robot, made_of
from tests.loops.test_elastic_cuts import coupled, linkages
from tests.oracles.paper_example import equal
from tests.oracles.pinocchio_models import PinocchioOracle
from tests.support.bending_robots import bent
from tests.support.bristled import bristled_arm
from tests.support.builds import Build
from tests.support.drive_reference import AXIS, DAMPING, DRIVES, INERTIA, drive, numbers_of
from tests.support.joint_table import joint_table, link_table
from tests.support.random_robots import Array, random_robot, random_state, seeds, with_random_loops
from tests.support.soak import soaked

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
    ("seed", "numbers"), soaked([(0, False), (1, True), (4, True), (1, False), (5, False), (2, True)], {(0, False)})
)
def test_printed_equations_of_random_robots_are_those_of_pinocchio(seed: int, numbers: bool) -> None:
    robot = random_robot(seed, max_size=3)
    form, s = readable_closed_form(build_model(robot), numbers=numbers), random_state(robot, seed)
    assert any(letter.value is not None for letter in form.letters) != numbers
    expected = PinocchioOracle(robot).inverse_dynamics(s.q, s.v, s.a)
    found = balance(form, values_of(form, q=s.q, v=s.v, a=s.a))
    assert np.abs(np.array(found) - expected).max() < 1e-9 * max(np.abs(expected).max(), 1.0)


@pytest.mark.parametrize("numbers", [False, True])
def test_matrices_are_in_the_printed_equations(numbers: bool, built: Build) -> None:
    """Entries have symbols of their own; the equations are the kernel's residual, the preload among the forces."""
    robot = eomgen.load_robot("one_link")
    stiffness = JointStiffness({"x.x": 9.0, "x.gamma": 2.0, "gamma.gamma": 4.0}, {"gamma": 0.5})
    damping = JointDamping(entries={"x.x": 0.9, "x.gamma": -0.2, "gamma.gamma": 0.3})
    robot = replace(robot, joints=(replace(robot.joints[0], stiffness=stiffness, damping=damping),))
    form, kernel = readable_closed_form(build_model(robot), numbers=numbers), built(robot, "residual")
    q, v, a, u = np.random.default_rng(2).uniform(-0.5, 0.5, (4, kernel.n))
    u[0] = 0.0  # printed drives are those of joints
    letters = {letter.value for letter in form.letters if letter.value is not None}
    assert letters >= ({2.0, -0.2} if not numbers else set())
    assert bool(letters) != numbers
    found = balance(form, values_of(form, q=q, v=v, a=a, u=u))
    assert found == pytest.approx(kernel.residual(q, v, a, u), rel=1e-12, abs=1e-12)


@pytest.mark.soak
def test_latex_is_mathematics() -> None:
    check_latex(readable_closed_form(build_model(random_robot(1, max_size=3)), numbers=True))


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
    q, v, a, multipliers = np.random.default_rng(3).uniform(-1.0, 1.0, (4, 5))
    q, v, a = q[:3], v[:3], a[:3]
    values = values_of(form, q=q, v=v, a=a, multipliers=multipliers)
    lines, names = form.lines(), {str(symbol): symbol for symbol in values}
    printed: dict[str, float] = {}
    for line in lines[lines.index(TITLE) + 1 :]:
        label, _, text = line.strip().partition(" = ")
        if label.startswith(("g[", "J[")):
            printed[label] = float(sp.parse_expr(text.split(" in every")[0], local_dict=names).evalf(subs=values))
    keys = [[f"J[{component}, {symbol}]" for symbol in form.form.q] for component in kernel.constraints]
    J = np.array([[printed.pop(key, 0.0) for key in row] for row in keys])
    assert [printed.pop(f"g[{x}]") for x in kernel.constraints] == pytest.approx(kernel.functions.constraint(q))
    assert not printed
    assert np.allclose(J, kernel.functions.constraint_jacobian(q), rtol=1e-12, atol=1e-12)
    assert balance(form, values) == pytest.approx(kernel.inverse_dynamics(q, v, a, cut=True) - J.T @ multipliers)
    assert form.rank == Rank(1, ())
    assert sum("D_gamma" in line for line in lines) == 1  # the crank alone has a drive
    assert [x.name for x in form.constraint if not x.jacobian_row] == ["joint4.z", "joint4.alpha", "joint4.beta"]


@pytest.mark.soak
def test_redundant_rows_are_said() -> None:
    """Bennett's linkage in space has three rows too many."""
    form = readable_closed_form(build_model(eomgen.load_robot("bennett")), numbers=True)
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
    found = balance(form, values_of(form, q=q, v=v, a=a))
    assert found == pytest.approx(kernel.inverse_dynamics(q, v, a, cut=True), rel=1e-9)


def test_a_coupling_has_its_equation() -> None:
    form = readable_closed_form(build_model(coupled("")))
    assert "  g[gear] = 2*gamma_1 + gamma_2 - 0.1" in form.lines()
    assert form.rank == Rank(1, ())
    check_latex(form)


def test_equations_of_trees_have_no_constraint() -> None:
    plain = readable_closed_form(build_model(eomgen.load_robot("one_link")))
    assert plain.rank is None
    assert "constraint" not in "".join(plain.lines()) + plain.latex()


def values_of(form: ReadableClosedForm, **arrays: Array) -> dict[Any, float]:
    """Values of letters, and of q, v, a, u and multipliers, zeros without."""
    values = {letter.symbol: letter.value for letter in form.letters if letter.value is not None}
    symbols = {name: getattr(form.form, name) for name in "qvau"}
    symbols["multipliers"] = tuple(part.multiplier for part in form.constraint)
    for name, row in symbols.items():
        values |= dict(zip(row, arrays.get(name, np.zeros(len(row))).tolist(), strict=True))
    return values


def balance(form: ReadableClosedForm, values: dict[Any, float]) -> list[float]:
    """Left sides of the printed equations less right ones."""
    return [float((left - right).evalf(subs=values)) for left, right in parsed(form)]


def check_latex(form: ReadableClosedForm) -> None:
    """Every formula is read by another program."""
    parser = MathTextParser("path")
    rows = [row for row in form.latex().splitlines() if not row.startswith(("%", "\\begin", "\\end"))]
    assert len(rows) > 5
    for row in rows:
        parser.parse(f"${row.removesuffix(chr(92) * 2).replace('&', '')}$")


EXAMPLE = Path(__file__).parents[3] / "examples" / "servo_axis.toml"


@pytest.mark.parametrize("name", DRIVES)
def test_residuals_and_rates_are_those_of_the_equations(name: str) -> None:
    table, _ = DRIVES[name]
    model = build_model(
        robot_from_toml(f"{AXIS}gamma = {{ damping = {DAMPING}, armature = 0.02, drive = {{ {table} }} }}\n")
    )
    function, rng = closed_form(model).function("residual", "rates"), np.random.default_rng(3)
    names = [state.state.name for state in model.states]
    for size in (0.1, 1.0, 10.0):
        s, v, a, u = rng.normal(size=4)
        z = size * rng.normal(size=len(names))
        force, rates, _ = drive(numbers_of(table), s, v, dict(zip(names, z, strict=True)), size * u)
        residual, found = function([s], [v], [a], [size * u], z=z)
        assert residual == pytest.approx([INERTIA * a + DAMPING * v - force], rel=1e-12, abs=1e-12)
        assert found == pytest.approx(
            [rates.get(name, -x) for name, x in zip(names, z, strict=True)], rel=1e-9, abs=1e-9
        )


def test_inputs_and_limits_are_said() -> None:
    form = readable_closed_form(build_model(load_robot(EXAMPLE)))
    text = "\n".join(form.lines())
    assert "D_gamma_1 = reference of position of axis.gamma: rad" in text
    assert "+ 6.0*current_gamma_1" in text
    assert "Max(-3.0, Min(3.0, 15.0*(D_gamma_1 - gamma_1)))" in text
    assert "- D_gamma_1" not in text
    assert any(r"\max" in right and r"\min" in right for block in form.equations() for _, right in block)


pytestmark = [pytest.mark.usefixtures("unoptimised")]


def test_they_are_printed_by_name() -> None:
    form = readable_closed_form(build_model(bristled_arm()))
    lines = form.lines()
    assert "  z_gamma_1 = j1.gamma.friction.z: rad" in lines
    assert lines[-3] == "rates of internal states"
    assert lines[-1] == "  d/dt z_beta_2 = betadot_2 - 20000.0*z_beta_2*Abs(betadot_2)"
    assert len(form.equations()) == 3
    latex = form.latex()
    assert "% $z_{2}^{\\beta}$ = j2.beta.friction.z: rad" in latex
    assert r"\dot{z_{2}^{\beta}} &= \dot{\beta}_{2} - 20000.0 z_{2}^{\beta} \left|{\dot{\beta}_{2}}\right|" in latex


WOUND = f"""
name = "wound"
gravity = [0.0, -9.81, 0.0]
{link_table("arm", 1.0, (0.2, 0.0, 0.0), (0.01, 0.02, 0.02))}
{joint_table("elbow", "base", "arm", "revolute")}
gamma = {{ stiffness = 3.0, stops = {{ stiffness = 50.0, damping = 2.0, lower = -0.1 }} }}
[joints.motor]
inertia = 1e-2
ratio = 5.0
stiffness = 200.0
damping = 0.1
hysteresis = {{ stiffness = 300.0, beta = 2.0, gamma = -1.0, n = 1.5, share = 0.4 }}
maxwell = [{{ stiffness = 100.0, damping = 2.0 }}]
"""


def check_states(robot: Robot, n: int, size: tuple[float, float], built: Build) -> None:
    """Residuals, rates of states and energies by z are the kernel's."""
    model, rng = build_model(robot), np.random.default_rng(3)
    form, kernel = closed_form(model), built(robot)
    function = form.function("residual", "rates", "kinetic", "potential", "mass_matrix")
    for _ in range(5):
        q, v, a, u = size[0] * rng.normal(size=(4, n))
        z = size[1] * rng.normal(size=len(form.z))
        residual, rates, kinetic, potential, M = function(q, v, a, u, z=z)
        assert residual == pytest.approx(kernel.residual(q, v, a, u, z=z), rel=1e-9, abs=1e-9)
        assert rates == pytest.approx(kernel.internal_state_derivatives(q, v, z, u), rel=1e-9, abs=1e-12)
        assert (kinetic, potential) == pytest.approx(tuple(kernel.energy(q, v, z=z)), rel=1e-9)
        assert pytest.approx(kernel.mass_matrix(q), rel=1e-9, abs=1e-12) == M


def test_internal_states_are_the_kernels(built: Build) -> None:
    """Those of laws beside the spring stay numbers, and do not take its symbols."""
    arm, wound = bristled_arm(), robot_from_toml(WOUND)
    for robot, names in ((arm, ["z_gamma_1", "z_beta_2"]), (wound, ["z_motor_1", "z0_motor_1"])):
        assert list(map(str, closed_form(build_model(robot)).z)) == names
    lines = readable_closed_form(build_model(wound)).lines()
    symbols = [line.split(" = ")[0].strip() for line in lines if " = joints." in line]
    assert len(symbols) == len(set(symbols)) == 5
    check_states(arm, 4, (0.3, 1e-4), built)
    check_states(wound, 2, (1.0, 1.0), built)


NONE = (0.0, 0.0, 0.0)


@pytest.mark.parametrize("seed", [pytest.param(0, marks=pytest.mark.soak), *seeds(1, 1, 11)])
def test_random_robots_against_lagrange(seed: int) -> None:
    """One or two joints of up to two coordinates, links of one or two modes, in M, C, forces and energies."""
    bending = bent(random_robot(seed, (1, 2), 2, max_size=3), seed, (1, 2))
    form, oracle, s = closed_form(build_model(bending.robot)), bending.oracle(), bending.state(seed)
    names = ("mass_matrix", "bias", "residual", "christoffel", "kinetic", "potential")
    M, bias, residual, C, kinetic, potential = form.function(*names)(s.q, s.v, s.a, s.u)
    expected = oracle.residual(s.q, s.v, s.a, s.u)
    size = np.abs(expected).max()
    assert np.abs(M - oracle.mass_matrix(s.q)).max() < 1e-12 * np.abs(M).max()
    assert np.abs(residual - expected).max() < 1e-12 * size
    assert np.abs(bias - oracle.bias_force(s.q, s.v)).max() < 1e-12 * size
    assert np.abs(C - oracle.christoffel(s.q)).max() < 1e-12 * np.abs(M).max()
    assert [float(kinetic), float(potential)] == pytest.approx(oracle.energy(s.q, s.v), rel=1e-12)


def flexible_arm(load: float = 0.0) -> Robot:
    """A link on a revolute joint that bends in a plane by one mode and stiffens by rotation; a load on its tip."""
    Phi: Any = ((0.0,), (2.0,), (0.0,), (0.0,), (0.0,), (2.7,))
    tip = Node("tip", (1.0, 0.0, 0.0), Phi, (((-4.6,),), ((0.0,),), ((0.0,),)))
    H0: Any = (((0.0, 0.8, 0.0), NONE, NONE, (0.0, 1.5, 0.0)),)
    P: Any = (((NONE, (0.0, 1.1, 0.0), NONE),),)
    Q: Any = ((((-0.9, 0.0, 0.0), NONE, NONE, (-1.3, 0.0, 0.0)),),)
    modes = LinkModes(H0, P, ((200.0,),), ((0.5,),), (tip,), Q)
    arm = Link("arm", 3.0, (0.5, 0.0, 0.0), (0.0, 0.25, 0.25, 0.0, 0.0, 0.0), modes)
    ((node, joint, couplings),) = made_of(arm)
    links = [arm, node, *([Link("load", load, NONE, (0.0,) * 6)] if load else [])]
    joints = [Joint("shoulder", "base", "arm", "revolute", coordinates={"gamma": Coordinate()}), joint]
    joints += [Joint("weld", "arm_tip", "load", "fixed")] if load else []
    return Robot("flexible_arm", (0.0, -9.81, 0.0), tuple(links), tuple(joints), couplings=couplings)


def test_one_flexible_link_is_read_in_closed_form() -> None:
    """All of its equations: what a hand writes for a rod that bends by one shape, with Q as what stiffens it."""
    form = readable_closed_form(build_model(flexible_arm()))
    text = form.lines()
    assert [line.strip() for line in text if line.startswith(("  M[", "  C["))] == [
        "M[gamma_1, gamma_1] = I_zz_arm + P11_yy_arm*e1_1**2 + Q11_xx_arm*e1_1**2 + c_x_arm**2*m_arm",
        "M[gamma_1, e1_1] = N1_xy_arm",
        "M[e1_1, e1_1] = P11_yy_arm",
        "C[gamma_1; gamma_1, e1_1] = e1_1*(P11_yy_arm + Q11_xx_arm)",
        "C[e1_1; gamma_1, gamma_1] = -e1_1*(P11_yy_arm + Q11_xx_arm)",
    ]
    assert "  e1_1 = arm.mode1: 1" in text
    assert "  a_e1_arm = links.arm.modes.1.stiffness: 200.0 J" in text
    assert "  N1_xy_arm = links.arm.modes.N.1.x.y: 0.8 kg m^2" in text
    assert "  n1_y_arm = links.arm.modes.n.1.y: 1.5 kg m" in text
    assert r"\ddot{e}_{1,1}" in form.latex()
    assert "% $P_{11,yy,arm}$ = links.arm.modes.P.1.1.y.y: 1.1 kg m^2" in form.latex()
    assert r"M_{1,1}^{\gamma e_{1}}" in form.latex()


def test_a_load_on_the_tip_bends_and_draws_in() -> None:
    form = readable_closed_form(build_model(flexible_arm(1.5)), numbers=True)
    M = form.mass_matrix[0, 0].subs(dict(zip(form.form.q, (0.3, 0.02), strict=True)))
    place = np.array([1.0 - 2.3 * 0.02**2, 2.0 * 0.02])
    assert float(M) == pytest.approx(0.25 + 3.0 * 0.25 + (1.1 - 0.9) * 0.02**2 + 1.5 * place @ place, rel=1e-14)


def test_what_the_closed_form_does_not_know_is_refused() -> None:
    robot = with_random_loops(bent(random_robot(4, (2, 2), 2), 4, (1,)).robot, 4, ["revolute"])
    with pytest.raises(InputError, match="closed form of links that bend knows no loops and couplings"):
        closed_form(build_model(robot))
