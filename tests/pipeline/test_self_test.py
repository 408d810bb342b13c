"""Every fresh binary answers samples before it enters the cache; one whose arithmetic is another's is refused."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen.codegen.kernels.equations import Equations, derive_equations
from eomgen.codegen.kernels.signatures import KERNELS
from eomgen.codegen.package.compile import fuses, processor
from eomgen.codegen.program.ir import Graph, finish, select
from eomgen.codegen.samples.answers import samples
from eomgen.codegen.samples.arithmetic import Arithmetic, spread
from eomgen.codegen.samples.composed import COMPOSED, FRAMED
from eomgen.codegen.samples.rounding import telling_lanes
from eomgen.codegen.samples.sines import polynomials
from eomgen.codegen.samples.states import sample_inputs
from eomgen.codegen.samples.stored import MEASURED, ROUNDED, STATES, read_samples
from eomgen.description.load import robot_from_toml
from eomgen.errors import BuildError
from eomgen.pipeline.cache import clear
from eomgen.pipeline.generating import generate
from eomgen.pipeline.options import Options
from eomgen.pipeline.self_test import first_difference
from eomgen.robot.model import build_model
from eomgen.robot.value import Robot
from tests.support.builds import Build
from tests.support.joint_table import beam_table, joint_table, link_table
from tests.support.quick_builds import QUICK, Q, as_new_process, one_link, script, without_headers
from tests.support.refusals import refused
from tests.support.soak import soaked

Array = np.ndarray[Any, Any]
FUSED = Options(("forward_dynamics", "inverse_dynamics", "reactions", "residual_jacobian"), flags=("-O2",))
FORWARD = Options(("forward_dynamics",), flags=("-O0",))
CC = shutil.which("cc") or shutil.which("gcc") or "cc"


needs_fma = pytest.mark.skipif("fma" not in processor().split(), reason="this processor has no fused multiply-add")


def nothing_cached(cache: Path) -> bool:
    return not list((cache / "packages").iterdir()) and not list(cache.glob("making-*"))


def wrapper(folder: Path, text: str) -> str:
    """A compiler that is a script: ``text`` sets the arguments or changes what is compiled."""
    return script(folder / "cc-wrapper", f'{text}\nexec {CC} "$@"')


@pytest.mark.parametrize(
    ("added", "options"),
    [
        ("-ffast-math", FORWARD),
        pytest.param("-funsafe-math-optimizations", QUICK, marks=pytest.mark.soak),
        ("-fsingle-precision-constant", QUICK),
        pytest.param(
            "-fsingle-precision-constant",
            Options(("mass_matrix",), native=True, flags=("-O0",)),
            marks=pytest.mark.soak,
        ),
        pytest.param("-ffp-contract=fast -mfma", FUSED, marks=needs_fma),
    ],
    ids=lambda value: value if isinstance(value, str) else "native" if value.native else "portable",
)
def test_a_compiler_that_adds_flags_is_refused(
    added: str, options: Options, empty_cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    command = wrapper(tmp_path, f'set -- "$@" {added}')
    monkeypatch.setenv("CC", command)
    with pytest.raises(BuildError) as error:
        one_link(options=options)
    message = str(error.value)
    assert message.startswith("the compiled kernels of one_link compute something else than their equations: ")
    assert f"\n  {command} -O2 " in message
    assert "one_link.c\nallowed: a compiler and flags that keep IEEE arithmetic" in message
    assert nothing_cached(empty_cache)
    assert 5e-324 * float(np.ones(1)[0]) != 0.0, "denormal numbers of this thread"
    monkeypatch.delenv("CC")
    assert one_link(options=options).n == 2


def slides(count: int) -> Robot:
    """Sliding joints one behind the other with springs and dampers: no sines, and sums of a few terms."""
    text = 'name = "slides"\n'
    for i in range(count):
        text += f"""
{link_table(f"link{i}", 1.3 + 0.17 * i, (0.1, 0.2, 0.3), (0.1, 0.1, 0.1))}
{joint_table(f"joint{i}", f"link{i - 1}" if i else "base", f"link{i}", "prismatic")}
x = {{ stiffness = 1.7, damping = 0.3 }}
placement = {{ xyz = [0.1, 0.2, 0.3], rpy = [0.3, 0.4, {0.5 + i}] }}
"""
    return robot_from_toml(text)


REORDERS = "-fassociative-math -fno-signed-zeros -fno-trapping-math"


@pytest.mark.parametrize(
    "added",
    [
        pytest.param("-funsafe-math-optimizations", id="unsafe", marks=pytest.mark.soak),
        pytest.param(REORDERS, id="associative"),
    ],
)
@pytest.mark.parametrize(
    ("robot", "kernel"),
    [
        (lambda: eomgen.load_robot("one_link"), "energy"),
        pytest.param(lambda: eomgen.load_robot("four_bar"), "mass_matrix", marks=pytest.mark.soak),
        pytest.param(lambda: slides(1), "forward_dynamics", marks=pytest.mark.soak),
        (lambda: slides(1), "energy"),
        (lambda: slides(3), "forward_dynamics"),
        pytest.param(lambda: slides(3), "inverse_dynamics", marks=pytest.mark.soak),
    ],
    ids=["one_link", "four_bar", "a slide", "energy of a slide", "slides", "forces of slides"],
)
def test_another_order_of_sums_is_refused(
    robot: Callable[[], Robot],
    kernel: str,
    added: str,
    empty_cache: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """By the states that are made for it alone, where there are no angles."""
    monkeypatch.setattr("eomgen.pipeline.self_test.read_samples", lambda data: without_luck(read_samples(data)))
    monkeypatch.setenv("CC", wrapper(tmp_path, f'set -- "$@" {added}'))
    with pytest.raises(BuildError, match="compute something else than their equations"):
        eomgen.build(robot(), kernels=(kernel,), flags=("-O2",))


def without_luck(given: dict[str, Array]) -> dict[str, Array]:
    """Samples whose ordinary and small states are those that are made for rounding."""
    states, last = len(STATES), len(STATES) - ROUNDED
    order = [last, last + 1, *range(2, states)]
    return {name: x[order] if x.ndim and len(x) == states else x for name, x in given.items()}


def test_states_show_every_other_order() -> None:
    """Of sums and products of a slide's accelerations, and a quotient by its inverse."""
    graph = Graph()
    q, v, u = (graph.input(name, 0) for name in "qvu")
    outputs = {("out", 0): u - 1.7 * q - 0.3 * v, ("out", 1): q * v * u, ("out", 2): q / v, ("out", 3): q + u}
    program = finish(graph, "three", outputs)
    arithmetic, rng = Arithmetic("float64"), np.random.default_rng(3)
    inputs = {name: rng.uniform(0.25, 1.0, (1, 128)) for name in "qvu"}
    q, v, u = (inputs[name][0, telling_lanes([program], inputs, arithmetic, ROUNDED)] for name in "qvu")
    a, b = 1.7 * q, 0.3 * v
    assert ((u - a - b) != (u - (a + b))).any()
    assert ((u - a - b) != (u - b - a)).any()
    assert ((q * v * u) != (q * (v * u))).any()
    assert ((q * v * u) != (q * u * v)).any()
    assert (q / v != q * (1.0 / v)).any()


CHANGES = {
    "a constant": "s/0\\.3333333333333333\\b/0.3333333333333334/",
    "a constant of vectors": "/EOMGEN_SINGLES_ONLY/,$ s/0\\.3333333333333333\\b/0.3333333333333334/",
    "a sign": "s/out\\[1\\] = -0\\.5\\*/out[1] = 0.5*/",
    "a parameter": "s/h\\[3\\] = p\\[3\\]/h[3] = p[2]/",
    "a polynomial": "s/2\\.75573137070/2.75673137070/",
}


@pytest.mark.parametrize("change", soaked(CHANGES, list(CHANGES)[:2]))
def test_a_compiler_that_changes_the_source_is_refused(
    change: str, empty_cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    library = Path(eomgen.__file__).parent / "clib"  # a copy beside the source is taken first
    text = f"""
for word in "$@"; do case "$word" in */one_link.c)
if mkdir "${{word%/*}}/once" 2> /dev/null; then  # compilers of several levels go at once
cp -r '{library}' "${{word%/*}}"
sed -i '{CHANGES[change]}' "$word" "${{word%/*}}"/clib/lanes.h
mkdir "${{word%/*}}/once/changed"; fi
until [ -d "${{word%/*}}/once/changed" ]; do sleep 0.01; done;; esac; done"""
    monkeypatch.setenv("CC", wrapper(tmp_path, text))
    refused(BuildError, "compute something else than their equations", one_link)
    assert nothing_cached(empty_cache)


@pytest.mark.soak
def test_native_builds_are_compared_within_rounding() -> None:
    """Answers of fused multiply-adds may differ by their rounding and no more."""
    kernel = eomgen.build("one_link", kernels="all", native=True, flags=("-O1",))
    meta = json.loads(kernel.source("json"))
    given = read_samples(samples(derived(), "float64"))
    assert first_difference(lambda: kernel.raw.libraries.library(""), meta, given, bits=False) is None
    for name in ("inverse_dynamics", "forward_dynamics_jacobian", "frame_jacobian", "rollout", "setup"):
        wrong = {key: array.copy() for key, array in given.items()}
        at = np.unravel_index(
            np.argmax(np.abs(np.where(np.isfinite(wrong[name]), wrong[name], 0.0))), wrong[name].shape
        )
        first = (0, *at[1:]) if name != "rollout" else at
        wrong[name][first] = wrong[name][first] * (1.0 + 1e-11) + 1e-300
        found = first_difference(lambda: kernel.raw.libraries.library(""), meta, wrong, bits=False)
        assert found.function == name


@pytest.mark.parametrize("dtype", ["float64", "float32"])
@pytest.mark.parametrize(
    ("mass", "laws"),
    [
        (0.01, "stiffness = 1e7, damping = 5e5"),
        (0.01, "friction = { coulomb = 1.0 }"),
        pytest.param(1e-6, "stiffness = 1e9, damping = 5e6", marks=pytest.mark.soak),
    ],
)
def test_stiff_dampers_of_light_links_are_let_through(mass: float, laws: str, dtype: str) -> None:
    """A step of Radau is that of Euler's method it is compared with however fast a damper is, and nothing else."""
    text = f"""
name = "light"
{link_table("a", mass, (0.0, 0.0, 0.0), (1e-3, 1e-3, 1e-3))}
{joint_table("j", "base", "a", "prismatic")}
z = {{ {laws} }}
"""
    robot, names = robot_from_toml(text), ("forward_dynamics", "radau_rollout")
    kernel = eomgen.build(robot, kernels=names, dtype=dtype, flags=("-O0",))
    meta = json.loads(kernel.source("json"))
    given = read_samples(samples(derive_equations(build_model(robot), names, dtype), dtype))
    given["radau_rollout"][..., -1] *= 1.0 + (1e-9 if dtype == "float64" else 1e-2)
    found = first_difference(lambda: kernel.raw.libraries.library("radau_rollout"), meta, given, bits=True)
    assert found.function == "radau_rollout"


@pytest.mark.parametrize(("off", "refused"), [(100 * 5e-324, False), (9.3e-317, False), (1e-300, True)])
def test_rounding_of_denormal_numbers_is_let_through(off: float, refused: bool, built: Build) -> None:
    """A fused product is not rounded to a denormal number, and an inverse inertia makes that more."""
    name, state = "inverse_dynamics", STATES.index("denormal")
    library = built(eomgen.load_robot("one_link"), name).raw.libraries.library(name)
    wrong = read_samples(samples(derived("one_link", name), "float64"))
    wrong[name][state] += off
    found = first_difference(lambda: library, library.meta, wrong, bits=False)
    assert (found is not None) == refused


def derived(name: str = "one_link", *kernels: str, dtype: str = "float64") -> Equations:
    return derive_equations(build_model(eomgen.load_robot(name)), kernels, dtype)


@pytest.mark.soak
@pytest.mark.parametrize(
    ("name", "dtype"),
    [
        ("one_link", "float64"),
        pytest.param("four_bar", "float32", marks=pytest.mark.soak),
        pytest.param("one_link", "float32", marks=pytest.mark.soak),
        pytest.param("four_bar", "float64", marks=pytest.mark.soak),
    ],
)
def test_every_number_is_looked_at(name: str, dtype: str, built: Build) -> None:
    """Each sample that is changed by a unit in the last place is found, of every function and state."""
    kernel = built(eomgen.load_robot(name), "all", dtype=dtype)
    meta = json.loads(kernel.source("json"))
    given = read_samples(samples(derived(name, dtype=dtype), dtype))
    assert first_difference(lambda: kernel.raw.libraries.library(""), meta, given, bits=True) is None
    steps = (
        [] if kernel.constraints else ["rollout", "adaptive_rollout"]
    )  # loops are closed by steps that go far from here
    functions = [*kernel.raw.functions, *steps, "setup"]
    assert {name for name in given if f"{name} near" in given} == set(functions)
    rng = np.random.default_rng(0)
    for function in functions:
        if f"{function} right" in given:
            check_equations(kernel, meta, given, function)
        places = np.argwhere(np.isfinite(given[function]) & (given[function] != 0.0) & given[f"{function} bits"])
        for place in map(tuple, rng.permutation(places)[:3]):
            state = place[1] if function in steps else place[0]
            if function not in steps and given[f"{function} status"][state] != 0:
                continue
            wrong = {**given, function: given[function].copy()}
            wrong[function][place] = np.nextafter(given[function][place], wrong[function].dtype.type(np.inf))
            found = first_difference(lambda: kernel.raw.libraries.library(""), meta, wrong, bits=True)
            assert (found.function, found.state) == (function, STATES[state])


def check_equations(kernel: eomgen.Kernel, meta: dict[str, Any], given: dict[str, Array], function: str) -> None:
    """Each equation of a composed kernel's answer is looked at, by a few of its columns."""
    within, right = given[f"{function} within"], given[f"{function} right"]
    for place in map(tuple, np.argwhere(np.isfinite(within))[::7]):
        wrong = {**given, f"{function} right": right.copy()}
        wrong[f"{function} right"][place] += 1.0 + np.abs(right[place]) + 100.0 * within[place]
        found = first_difference(lambda: kernel.raw.libraries.library(""), meta, wrong, bits=True)
        assert (found.function, found.state) == (function, STATES[place[0]])


def test_a_status_is_looked_at(built: Build) -> None:
    kernel = built(eomgen.load_robot("one_link"), "all")
    given = read_samples(samples(derived(), "float64"))
    name, library = "forward_dynamics status", kernel.raw.libraries.library("")
    assert given[name].tolist() == [0, 0, 0, 0, 1, *[0] * ROUNDED]
    for state in range(len(STATES)):
        wrong = {**given, name: given[name].copy()}
        wrong[name][state] = 1 - given[name][state]
        found = first_difference(lambda: library, library.meta, wrong, bits=True)
        assert found.function.startswith("the status of forward_dynamics")


def test_without_headers_and_with_a_source_from_the_cache(
    empty_cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Samples lie beside the source, so nothing is derived again; generated packages have none of them."""
    one_link()
    as_new_process(monkeypatch)
    without_headers(monkeypatch)
    steps: list[str] = []
    assert one_link(steps).n == 2
    assert [step.split()[0] for step in steps] == ["compiling"]
    monkeypatch.setenv("CC", wrapper(tmp_path, 'set -- "$@" -fsingle-precision-constant'))
    refused(BuildError, "compute something else", one_link, steps)
    monkeypatch.delenv("CC")
    package = generate("one_link", tmp_path / "out", QUICK)
    assert not [path for path in package.rglob("*") if "sample" in path.name]


def test_a_binary_that_does_not_load_is_refused(
    empty_cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    broken = 'while [ "$1" != -o ]; do shift; done; echo broken > "$2"; exit 0'
    monkeypatch.setenv("CC", wrapper(tmp_path, f'case "$*" in *-shared*) {broken};; esac'))
    refused(BuildError, "does not load", one_link)
    assert nothing_cached(empty_cache)


def test_a_binary_is_examined_though_one_of_its_key_is_loaded(
    empty_cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A kernel that is loaded says nothing of what the same command compiles the next time."""
    switch = tmp_path / "bad"
    text = f'[ -e {switch} ] && set -- "$@" -fsingle-precision-constant'
    monkeypatch.setenv("CC", wrapper(tmp_path, text))
    kernel = one_link()
    clear()
    switch.touch()
    refused(BuildError, "compute something else", one_link)
    assert nothing_cached(empty_cache)
    switch.unlink()
    assert np.array_equal(one_link().mass_matrix(Q), kernel.mass_matrix(Q))


def test_flags_that_fuse() -> None:
    assert not fuses(("-O2", "-ffp-contract=off", "-O3"))
    assert fuses(("-ffp-contract=off", "-ffp-contract=fast"))
    assert fuses(("-ffp-contract=off", "-ffp-model=precise"))
    assert fuses(("-O2",))


def test_all_composed_kernels_have_answers() -> None:
    """A kernel that is a template of its own needs a function in ``codegen/samples/composed.py``."""
    ways = [
        (name, signature)
        for name, signature in KERNELS.items()
        if signature.kind not in ("rollout", "adaptive", "gradient")
    ]
    composed = {name for name, x in ways if x.kind == "composed" or x.columns_of or x.closed}
    assert composed == set(COMPOSED)
    assert {name for signature in KERNELS.values() for name in signature.functions} == set(FRAMED)
    assert [name for name, signature in KERNELS.items() if signature.kind == "rollout"] == ["rollout"]
    adaptive = [name for name, signature in KERNELS.items() if signature.kind == "adaptive"]
    assert adaptive == ["adaptive_rollout", "radau_rollout"]


@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_angles_of_samples_round_correctly(dtype: str) -> None:
    given = read_samples(samples(derived("one_link", "mass_matrix"), dtype))
    assert given["mass_matrix bits"]
    angles = given["q"][:4, 1]
    assert np.array_equal(np.stack(polynomials(angles)), np.stack(Arithmetic(dtype).turn(angles)))


@pytest.mark.soak
def test_fused_products_of_a_closed_mechanism_are_within_rounding() -> None:
    """Small numbers are compared by what rounding does to them, denormal ones too, where systems are solved."""
    kernel = eomgen.build("four_bar", kernels=("forward_dynamics", "inverse_dynamics"), native=True)
    assert kernel.constraints


def paired_slides() -> Robot:
    """Two fingers that a rigid coupling opens by the same width, on a slide: what they do to it cancels."""
    text = 'name = "paired"\n'
    for name, parent, turn in (("hand", "base", 0.7), ("left", "hand", 1.3), ("right", "hand", 1.3 - np.pi)):
        text += f"""
{link_table(name, 0.7, (0.0, 0.0, 0.0), (0.1, 0.1, 0.1))}
{joint_table(f"{name}_joint", parent, name, "prismatic")}
placement = {{ xyz = [0.0, 0.0, 0.0], rpy = [{turn}, 0.0, 0.0] }}
"""
    coupling = 'name = "fingers"\nof = "right_joint.z"\nto = { "left_joint.z" = 1.0 }'
    return robot_from_toml(f"{text}[[couplings]]\n{coupling}\n").with_constraints()


@pytest.mark.soak
def test_what_composed_kernels_compute_with_answers_is_rounded_too() -> None:
    """Differences that cancel leave what a fused product does not round off."""
    equations = derive_equations(build_model(paired_slides()), ("forward_dynamics_jacobian",))
    given = read_samples(samples(equations, "float64"))
    within = given["forward_dynamics_jacobian within"][0][:, 6:]
    assert (within > 1e-17).all(), "of sums that come out as 0, too"
    kernel = eomgen.build(paired_slides(), kernels=("forward_dynamics_jacobian",), native=True)
    assert kernel.constraints


@pytest.mark.soak
def test_what_rounding_makes_finite_is_not_held_against_a_binary() -> None:
    """Where rates are infinite the sign of a coefficient that vanishes but for rounding decides what comes out."""
    kernel = eomgen.build("hexapod_elastic", kernels=("cut_forces",), native=True)
    assert kernel.cut_laws


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ([1.0, 1.0, 1.0, 1.0 + 1e-15, 1.0], 1.1e-15),
        ([np.inf, np.inf, -np.inf, np.nan, np.inf], 0.0),
        ([np.inf, np.inf, 0.0, np.inf, np.inf], np.inf),
        ([0.0, 0.0, 0.0, 0.0, np.nan], np.inf),
    ],
    ids=["finite", "not finite", "finite in a copy", "not finite in a copy"],
)
def test_spread_of_copies(values: list[float], expected: float) -> None:
    state, *copies = values
    lanes = np.concatenate([np.full(len(STATES), state), np.tile(copies, MEASURED)])
    assert spread(lanes) == pytest.approx(np.full(MEASURED, expected), rel=0.1)


CROSSED = f"""
name = "crossed"
{beam_table("bridge", 2.0, "{ tube = [0.06, 0.05] }", "{ y = 2, z = 1 }")}
{link_table("trolley", 1.5)}
{joint_table("rail", "base", "bridge", "prismatic")}
{joint_table("cross", "bridge", "trolley", "prismatic")}
along = "beam"
"""


@pytest.mark.parametrize("dtype", ["float32", pytest.param("float64", marks=pytest.mark.soak)])
def test_angles_of_several_coordinates(dtype: str) -> None:
    """A trolley turns by a product of where it is and how a beam bends: polynomials have the library's bits there."""
    equations = derive_equations(build_model(robot_from_toml(CROSSED)), ("kinematics",), dtype)
    arithmetic = Arithmetic(dtype)
    inputs, exact = sample_inputs(equations, arithmetic)
    assert exact
    [program] = equations.programs.values()
    angles = sorted({x.args[0] for x in program.instructions if x.op in ("sin", "cos")})
    chosen = [select("angle", program.instructions, {("out", 0): index}, {}) for index in angles]
    shared = [x for x in chosen if len({i.leaf for i in x.instructions if i.op == "input"}) > 1]
    assert shared
    for angle in shared:
        out = arithmetic.run(angle, {"q": inputs["q"][:, :3]}, rounding=False)["out"][0]
        for found, wanted in zip(polynomials(out), arithmetic.turn(out), strict=True):
            assert found.tobytes() == wanted.tobytes()
    assert eomgen.build(robot_from_toml(CROSSED), kernels=("kinematics",), dtype=dtype, flags=("-O0",)).n == 5
