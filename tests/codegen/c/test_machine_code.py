"""The compiled code: the same bits from every compiler, sanitizers, no allocation, no state, no trace in the FPU."""

from __future__ import annotations

import functools
import json
import math
import os
import platform
import re
import resource
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen.codegen.c.source import Source
from eomgen.codegen.c.sources import render
from eomgen.codegen.kernels.equations import derive_equations
from eomgen.codegen.kernels.signatures import KERNELS
from eomgen.codegen.package.compile import FLAGS, carried_contents, compile_flags, find_compiler, write_package
from eomgen.description.builtin import builtin_robots
from eomgen.pipeline.cache import write_files
from eomgen.pipeline.generating import generate
from eomgen.pipeline.options import Options
from eomgen.robot.model import Model, build_model
from eomgen.robot.value import PRINCIPAL, Coordinate, Friction, Robot
from eomgen.runtime.levels import supported
from tests.oracles.force_laws import with_laws
from tests.oracles.journals import random_journals
from tests.support import watched_calls
from tests.support.c_driver import (
    DT,
    EVERY,
    STEPS,
    Array,
    compile_driver,
    inputs_of,
    objects_of,
    results_by_call,
    run_driver,
    write_driver,
)
from tests.support.c_project import check_symbols
from tests.support.makers import MAKERS
from tests.support.random_robots import random_robot, with_random_loops
from tests.support.refusals import refused
from tests.support.small_robots import free_body
from tests.support.soak import WHOLE, soaked

COMPILERS = ("gcc", "clang")
LEVELS = ("-O0", "-O2", "-O3")
PLAIN = tuple(flag for flag in FLAGS if not flag.startswith("-O"))  # with -ffp-contract=off
FUSED = (*(flag for flag in PLAIN if "contract" not in flag), "-ffp-contract=fast")
SANITIZERS = {
    "memory": ("-O1", "-g1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all", "-fno-omit-frame-pointer"),
    "threads": ("-O1", "-g1", "-fsanitize=thread"),
}
EPS = float(np.finfo(np.float64).eps)
INVERTING = ("forward_dynamics", "forward_dynamics_jacobian", "rollout")
SOLVING = {"constrained_drives", "constrained_dynamics", "settling"}  # for multipliers


def small_tree() -> Robot:
    """Forces of every kind."""
    robot = random_robot(7, joints=(3, 3), tree=True, types=("revolute", "prismatic", "fixed"), max_coordinates=3)
    return replace(with_laws(robot, 7), name="small_tree")


def small_arm() -> Robot:
    robot = random_robot(7, joints=(2, 2), types=("revolute", "prismatic"), max_coordinates=2)
    return replace(with_laws(robot, 7), name="small_arm")


def looped_tree() -> Robot:
    robot = random_robot(11, joints=(3, 3), tree=True, max_coordinates=2, types=("revolute", "prismatic"))
    return replace(with_random_loops(robot, 11, ("revolute", "spherical")), name="looped_tree")


def free_tree() -> Robot:
    return random_robot(5, joints=(3, 3), tree=True, types=("revolute", "free"), max_coordinates=3, name="free_tree")


CORPUS: dict[str, Callable[[], Robot]] = {
    **{name: functools.partial(eomgen.load_robot, name) for name in builtin_robots() if name not in MAKERS},
    "small_arm": small_arm,
    "small_tree": small_tree,
    "looped_tree": looped_tree,
    "free_tree": free_tree,
}
QUICK = (("one_link", "float64"), ("small_arm", "float32"))
SHORT = (QUICK[0], pytest.param(*QUICK[1], marks=pytest.mark.soak))
LARGE = ("puma560_elastic", "two_arms")
SINGLE = ("small_tree", "four_bar", "puma560", "worn_arm")  # in float, too
FEW = ("small_tree", "looped_tree", "balanced_arm")  # a share of the soak's
SOAK = [(name, "float64") for name in CORPUS if name != "one_link" and (WHOLE or name in FEW)]
SOAK += [(name, "float32") for name in SINGLE if WHOLE or name in FEW[:1]]
corpus = pytest.mark.parametrize(
    ("name", "dtype"), [*SHORT, *(pytest.param(*case, marks=pytest.mark.soak) for case in SOAK)]
)


@functools.cache
def source_of(name: str, dtype: str) -> Source:
    return render(equations_of(name, dtype))


@functools.lru_cache(2)
def equations_of(name: str, dtype: str = "float64") -> Any:
    return derive_equations(build_model(CORPUS[name]()), dtype=dtype)


def spread_of(robot: Robot) -> Array:
    """How far coordinates may go so that no spring's force drowns the rest and nothing is near a singular state."""
    found = {}
    for joint in robot.joints:
        for name, given in joint.all_coordinates.items():
            wide = name == PRINCIPAL.get(joint.type) or joint.type == "free"
            reach = {"beta": 1.2}.get(name, 2.0) if wide else 0.3
            found[f"{joint.name}.{name}"] = min(reach, 100.0 / max(given.stiffness or 0.0, 1e-9))
    for link in robot.links:
        for k, name in enumerate(link.modes.names) if link.modes is not None else ():
            found[f"{link.name}.{name}"] = min(0.3, 100.0 / link.modes.K[k][k])
    return np.array([found[name] for name in build_model(robot).coordinates])


def compilers() -> list[str]:
    """Those that are here; a test without any of them is skipped."""
    found = [name for name in COMPILERS if shutil.which(name)]
    if not found:
        pytest.skip("there is neither gcc nor clang")
    return found


def prepared(name: str, dtype: str, folder: Path) -> Source:
    source = source_of(name, dtype)
    write_driver(source, inputs_of(source, spread_of(CORPUS[name]())), folder)
    return source


def prepared_alone(folder: Path) -> Source:
    """The mass matrix of ``one_link`` and nothing else: what a compiler makes of it in a moment."""
    robot = CORPUS["one_link"]()
    source = render(derive_equations(build_model(robot), ("mass_matrix",)))
    write_driver(source, inputs_of(source, spread_of(robot)), folder)
    return source


def worst_differences(source: Source, found: Array, expected: Array) -> dict[str, float]:
    """By kernel, relative to the largest number of each result (max-norm)."""
    worst: dict[str, float] = {}
    both = zip(results_by_call(source, found), results_by_call(source, expected), strict=True)
    for (call, status, x), (_, other, y) in both:
        assert status == other, call
        scale = float(np.abs(y).max(initial=0.0))
        difference = float(np.abs(x - y).max(initial=0.0)) / scale if scale > 0.0 else float(np.abs(x).max(initial=0.0))
        worst[call.name] = max(worst.get(call.name, 0.0), difference)
    return worst


# Bits


def levels_of(name: str, compiler: str) -> tuple[str, ...]:
    """All; of the second short form and of robots that take minutes to compile some."""
    if name in LARGE:
        return LEVELS[1:2]
    return LEVELS if name != QUICK[1][0] else LEVELS[:: 2 if compiler == "gcc" else 3]


@corpus
@pytest.mark.soak
def test_compilers_and_levels_give_the_same_bits(name: str, dtype: str, tmp_path: Path) -> None:
    """gcc and clang, -O0, -O2 and -O3, without contraction: single states, batches, rollouts."""
    source, results = prepared(name, dtype, tmp_path), {}
    for compiler in compilers():
        for level in levels_of(name, compiler):
            program = compile_driver(source, tmp_path, compiler, (level, *PLAIN), f"{compiler}{level}")
            for made in objects_of(source, program):
                check_symbols(made, source)
            results[compiler, level] = run_driver(program, source)
    (first, expected), *others = results.items()
    assert np.isfinite(expected).all()
    for which, found in others:
        different = [
            call
            for (call, s, x), (_, t, y) in zip(
                results_by_call(source, found), results_by_call(source, expected), strict=True
            )
            if s != t or x.tobytes() != y.tobytes()
        ]
        assert not different, (which, first, different[:3])
    print(f"{name} {dtype}: {expected.size} numbers, {len(results)} builds, no bit differs")


@pytest.mark.soak
@pytest.mark.skipif("x86" not in platform.machine(), reason="the flags of fused multiply-add are those of x86")
@corpus
def test_fused_multiply_add_changes_the_last_digits_alone(name: str, dtype: str, tmp_path: Path) -> None:
    """1e-13 of the largest number of each result in double precision, as many units of float in single.

    Where a mass matrix is inverted, its condition number multiplies round-off: there as many times more are allowed.
    What solves for multipliers is left out: in states that are not closed redundant constraints contradict each other,
    and what is left of that is not determined by the states.
    """
    if " fma" not in Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace"):
        pytest.skip("this processor has no fused multiply-add")
    source = prepared(name, dtype, tmp_path)
    constrained = bool(json.loads(source.meta).get("constraints"))
    undetermined = {k for k, own in KERNELS.compiled.items() if constrained and SOLVING & {k, *own.calls, *own.closed}}
    first = compilers()[0]
    expected = run_driver(compile_driver(source, tmp_path, first, ("-O2", *PLAIN), "plain"), source)
    levels = LEVELS[1:2] if (name, dtype) in QUICK or name in LARGE else LEVELS[1:]
    for compiler in compilers():
        for level in levels:
            flags = (level, *FUSED, "-mfma", "-mavx2")
            program = compile_driver(source, tmp_path, compiler, flags, f"{compiler}{level}-fused")
            for made in objects_of(source, program):
                code = subprocess.run(["objdump", "-d", made], capture_output=True, text=True).stdout
                assert "vfmadd" in code, "nothing was fused, so that nothing was compared"
            found = run_driver(program, source)
            worst = worst_differences(source, found, expected)
            text = ", ".join(f"{kernel} {worst[kernel]:.1e}" for kernel in sorted(worst, key=lambda k: -worst[k])[:4])
            print(f"{name} {dtype} {compiler} {level} fused: {text}")
            unit = 1e-13 if dtype == "float64" else 1e-13 / EPS * float(np.finfo(np.float32).eps)
            for kernel in worst.keys() - undetermined:
                difference = worst[kernel]
                allowed = unit * max(1.0, condition(source, expected) if kernel in INVERTING else 1.0)
                assert difference <= allowed, (kernel, difference, allowed)


def condition(source: Source, found: Array) -> float:
    """Greatest condition number of the mass matrix, scaled to a unit diagonal, over the states."""
    worst = 1.0
    for call, _, x in results_by_call(source, found):
        if call.name == "mass_matrix" and call.count is None:
            n = math.isqrt(x.size)
            M = x.reshape(n, n).astype(np.float64)
            scale = np.sqrt(np.maximum(M.diagonal(), 1e-300))
            worst = max(worst, float(np.linalg.cond(M / np.outer(scale, scale))))
    return worst


@pytest.mark.soak
@pytest.mark.parametrize(("name", "dtype"), SHORT)
def test_the_driver_finds_what_the_kernel_finds(name: str, dtype: str, tmp_path: Path) -> None:
    """To the bit: singles, batches and rollouts of the C program against those through NumPy."""
    source, robot = prepared(name, dtype, tmp_path), CORPUS[name]()
    x = inputs_of(source, spread_of(robot))
    found = run_driver(compile_driver(source, tmp_path, compilers()[0], ("-O1", *PLAIN), "program"), source)
    kernel, seen = eomgen.build(robot, kernels="all", dtype=dtype, flags=("-O0",)), set()
    for call, status, result in results_by_call(source, found):
        if call.how:
            controlled, method = call.how
            q, v, z = (x[k][call.state] if call.count is None else x[k][: call.count] for k in "qvz")
            u = x["u"].ravel()[: (call.count or 1) * STEPS * kernel.n]
            how = {"kp": x["kp"], "kd": x["kd"], "target": x["path"]} if controlled else {}
            if call.count is not None:
                u = u.reshape(call.count, STEPS, kernel.n)
                how = {**how, "target": how["target"][np.newaxis]} if how else {}
            else:
                u = u.reshape(STEPS, kernel.n)
            options: dict[str, Any] = {"method": ("rk4", "implicit")[method], "every": EVERY, **how}
            found_q, found_v = states = kernel.rollout(q, v, u, DT, STEPS, **options, z=z)
            rates = np.concatenate([found_v, states.z], axis=-1) if z.size else found_v
            expected = np.concatenate([found_q.ravel(), rates.ravel()])
        else:
            last = len(call.reads) - 1
            arrays = []
            for i, label in enumerate(call.reads):
                rows = x[label].reshape(-1, *kernel.raw.shapes[label])
                one = call.count is None or (call.shared and i == last)
                arrays.append(np.ascontiguousarray(rows[call.state] if one else rows[: call.count]))
            frames = () if call.frame is None else (call.frame,)
            expected = kernel.calls.run(call.name, None, arrays, frames, whole=True)
        assert status in (0, -1)
        assert result.tobytes() == expected.tobytes(), call
        seen.add(call.name)
    assert len(seen) >= 16


# Memory, threads, allocations, the environment


def cpu_of_children() -> float:
    """Seconds of compilers and programs until now."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


@pytest.mark.soak
@pytest.mark.parametrize("sanitizer", SANITIZERS)
@corpus
def test_sanitizers_have_nothing_to_say(name: str, dtype: str, sanitizer: str, tmp_path: Path) -> None:
    """ASan and UBSan over arrays of the exact sizes; TSan over eight threads, which find the same bits as one."""
    source, flags = prepared(name, dtype, tmp_path), SANITIZERS[sanitizer]
    compiler = compilers()[0]
    macros = ("THREADS=8",) if sanitizer == "threads" else ()
    began = cpu_of_children()
    program = compile_driver(source, tmp_path, compiler, (*flags, *PLAIN), sanitizer, macros)
    found = run_driver(program, source, environment={**os.environ, "ASAN_OPTIONS": "detect_leaks=0"})
    assert np.isfinite(found).all()
    print(f"{name} {dtype} {sanitizer}: {found.size} numbers, {cpu_of_children() - began:.1f} s of one core")


def test_a_sanitizer_sees_what_is_too_short(tmp_path: Path) -> None:
    """The driver's arrays are of the exact sizes: a kernel that writes one number more is caught."""
    source = prepared_alone(tmp_path)
    wrong = source.code.replace("out[3] = EOM_C0;", "out[4] = out[3] = EOM_C0;", 1)
    assert wrong != source.code
    (tmp_path / "one_link.c").write_text(wrong, encoding="ascii")
    program = compile_driver(source, tmp_path, compilers()[0], (*SANITIZERS["memory"], *PLAIN), "wrong")
    with pytest.raises(AssertionError, match="heap-buffer-overflow"):
        run_driver(program, source, environment={**os.environ, "ASAN_OPTIONS": "detect_leaks=0"})
    begin = "restrict out)\n{\n"
    racing = source.code.replace(begin, f"{begin}    static volatile int state;\n    ++state;\n", 1)
    (tmp_path / "one_link.c").write_text(racing, encoding="ascii")
    program = compile_driver(
        source, tmp_path, compilers()[0], (*SANITIZERS["threads"], *PLAIN), "racing", ("THREADS=8",)
    )
    refused(AssertionError, "data race", run_driver, program, source)
    refused(AssertionError, "", check_symbols, objects_of(source, program)[0], source)


@pytest.mark.soak
@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="malloc is replaced by names of glibc")
@corpus
def test_no_call_allocates_or_touches_the_environment(name: str, dtype: str, tmp_path: Path) -> None:
    """Rounding, exception masks, flushing of denormals stay the caller's after every call, in all rounding modes."""
    source = prepared(name, dtype, tmp_path)
    for compiler in compilers() if (name, dtype) in QUICK else compilers()[:1]:
        program = compile_driver(source, tmp_path, compiler, FLAGS, compiler, ("GUARDED", "WATCHED"))
        assert np.isfinite(run_driver(program, source)).all()
        refused(AssertionError, "allocation during a call", run_driver, program, source, "allocate")


def test_the_driver_sees_an_environment_that_changes(tmp_path: Path) -> None:
    source = prepared_alone(tmp_path)
    code = "#include <fenv.h>\n" + source.code
    code = code.replace("(void)h;", "(void)h;\n    fesetround(FE_UPWARD);", 2)
    assert "fesetround" in code
    (tmp_path / "one_link.c").write_text(code, encoding="ascii")
    program = compile_driver(source, tmp_path, compilers()[0], FLAGS, "wrong", ("WATCHED",))
    refused(AssertionError, "floating-point environment changed by", run_driver, program, source)


CONTROL = """
#include <fenv.h>
unsigned control(void)
{
    unsigned short word;
    __asm__ volatile("fnstcw %0" : "=m"(word));
    return (__builtin_ia32_stmxcsr() & 0xffc0U) << 16 | word;
}
int set_rounding(int upward) { return fesetround(upward ? FE_UPWARD : FE_TONEAREST); }
"""
IMPORTED = """
import ctypes, importlib, sys, threading
import numpy as np
fpu = ctypes.CDLL(sys.argv[1])
before = fpu.control()
sys.path.insert(0, sys.argv[2])
import one_link
tiny = np.array([5e-324])

def check(what, expected=before):
    assert fpu.control() == expected, (what, hex(fpu.control()), hex(expected))
    assert (tiny * 1.0 != 0.0).all() and 5e-324 * 1.0 != 0.0, what

check("import")
kernel = one_link.kernel
states, functions = np.full((600, 2), 0.1), kernel.raw.functions
def call_all():
    expected = fpu.control()
    for name, function in functions.items():
        extra = (0,) if function.is_framed else ()
        for one in (True, False):
            arrays = [np.full(kernel.raw.shapes[r], 0.1) for r in function.reads]
            arrays[0] = arrays[0] if one else np.full((600, 2), 0.1)
            kernel.calls.run(name, None, arrays, extra)
            check(name, expected)
    kernel.rollout(states, states[0], states[0], 1e-3, 5)
    check("rollout", expected)
call_all()
kernel.threads = 4
call_all()
kernel.threads = 1
threads = [threading.Thread(target=call_all) for _ in range(4)]
[t.start() for t in threads]; [t.join() for t in threads]
kernel.checks = False
with np.errstate(all="ignore"):
    kernel.energy(np.full(2, np.nan), np.full(2, np.inf))
    kernel.energy(np.full(2, 1e300), np.full(2, 1e300))
check("NaN and overflow")
fpu.set_rounding(1)
upward = fpu.control()
assert upward != before
call_all()
check("rounding upward", upward)
print("kept", len(functions))
"""


@pytest.mark.soak
@pytest.mark.skipif("x86" not in platform.machine(), reason="reads control registers of x86")
@pytest.mark.parametrize("native", [False, pytest.param(True, marks=pytest.mark.soak)])
def test_import_and_calls_leave_the_environment_as_it_is(native: bool, tmp_path: Path) -> None:
    """Of the process that imports a generated package, of its threads, and of one that rounds upward."""
    (tmp_path / "control.c").write_text(CONTROL, encoding="ascii")
    library, compiler = tmp_path / "control.so", compilers()[0]
    subprocess.run([compiler, "-shared", "-fPIC", tmp_path / "control.c", "-o", library, "-lm"], check=True)
    options = Options(("all",), native=native, flags=("-O1",), levels=() if native else (supported()[-1],))
    generate(eomgen.load_robot("one_link"), tmp_path, options)
    command = [sys.executable, "-c", IMPORTED, str(library), str(tmp_path)]
    result = subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert int(result.stdout.split()[1]) >= 16


FILLED = "-ftrivial-auto-var-init"
MEMORY = ("-g1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all", "-fno-omit-frame-pointer")
MOVING = ("forward_dynamics", "rollout", "adaptive_rollout", "radau_rollout")
SLOPES = (
    "forward_dynamics_jacobian",
    "explicit_gradient",
    "implicit_gradient",
    "rosenbrock_gradient",
    "explicit_sensitivity",
    "implicit_sensitivity",
    "rosenbrock_sensitivity",
)


def rubbing_loop() -> Robot:
    robot = eomgen.load_robot("four_bar")
    rubbing = Coordinate(friction=Friction(coulomb=0.1, smoothing=1e-3))
    crank, *others = robot.joints
    return replace(robot, name="rubbing_loop", joints=(replace(crank, coordinates={"gamma": rubbing}), *others))


def free_joint() -> Robot:
    return random_robot(5, joints=(1, 1), types=("free",), max_coordinates=3, name="free_joint")


def contacts() -> Robot:
    robot = random_robot(3, joints=(1, 1), types=("revolute",), max_coordinates=6, name="contacts")
    return replace(random_journals(robot, 3), name="contacts")


WATCHED_QUICK: dict[str, Callable[[], Robot]] = {
    "tree": small_arm,
    "bennett": partial(eomgen.load_robot, "bennett"),
    "rubbing_loop": rubbing_loop,
    "free_joint": free_joint,
    "free_body": free_body,
    "contacts": contacts,
}
WATCHED_SLOW = (  # minutes to hours with sanitizers: many coordinates, or stiff where steps are explicit
    "andrews",
    "delta",
    "gough",
    "hexapod_elastic",
    "puma560_elastic",
    "two_arms",
    "worn_arm",
    "balanced_arm",
)
WATCHED_SOAK: dict[str, tuple[Callable[[], Robot], tuple[str, ...]]] = {
    f"{name}, as built in": (partial(eomgen.load_robot, name), ())
    for name in builtin_robots()
    if name not in MAKERS and (WHOLE or name not in WATCHED_SLOW)
}
WATCHED_SOAK |= {
    f"{name}, differentiated": (make, SLOPES) for name, make in WATCHED_QUICK.items() if not name.startswith("free")
}


def states_of(model: Model) -> dict[str, np.ndarray]:
    """Seven states near home, ever faster and under ever greater drives: their steps end at different times."""
    rng, n = np.random.default_rng(6), len(model.coordinates)
    speeds, forces = np.logspace(-1.0, 1.0, 7)[:, np.newaxis], np.logspace(0.0, 3.0, 7)[:, np.newaxis]
    driven = np.isin(np.arange(n), model.driven)
    q = np.array(model.home) + 0.02 * rng.normal(size=(7, n))
    v = speeds * rng.normal(size=(7, n))
    z = 1e-3 * speeds * rng.normal(size=(7, len(model.internal_states)))  # bristles are short
    return {"q": q, "v": v, "z": z, "u": driven * forces * rng.normal(size=(7, 1))}


def moved(source: Source, model: Model, folder: Path, flags: tuple[str, ...]) -> dict[str, np.ndarray]:
    """What a package that is compiled with the flags makes of the states, in a process of its own."""
    (folder / source.name).mkdir(parents=True)
    compiler, level = replace(find_compiler(), flags=("-O0", *flags)), supported()[-1]
    try:
        subprocess.run([*compiler.command, *flags, "-E", "-x", "c", os.devnull], check=True, capture_output=True)
    except subprocess.CalledProcessError:
        pytest.skip("this compiler fills no locals")
    write_package(source, compiler, compile_flags(compiler, False, (), level), folder / source.name, level)
    write_files(folder / source.name, carried_contents(json.loads(source.meta)))
    np.savez(folder / watched_calls.STATES, **states_of(model))
    environment, results = {**os.environ, "ASAN_OPTIONS": "detect_leaks=0"}, folder / "results.npz"
    if MEMORY[1] in flags:
        which = [*compiler.command, "-print-file-name=libasan.so"]
        library = subprocess.run(which, check=True, capture_output=True, text=True).stdout.strip()
        environment |= {"LD_PRELOAD": library, "PYTHONMALLOC": "malloc"}
    command = [sys.executable, watched_calls.__file__, str(folder), source.name, str(results)]
    result = subprocess.run(command, capture_output=True, text=True, check=False, env=environment, cwd=folder)
    assert result.returncode == 0, result.stderr[-6000:]
    with np.load(results) as found:
        return dict(found)


def check_filled(source: Source, model: Model, folder: Path, flags: tuple[str, ...]) -> None:
    """Move the same states with locals filled by zeros and by a pattern, this with further flags, and compare bits."""
    expected = moved(source, model, folder / "zeros", (f"{FILLED}=zero", "-w"))
    found = moved(source, model, folder / "pattern", (f"{FILLED}=pattern", *flags))
    assert found.keys() == expected.keys()
    assert len(found) >= 9
    different = [key for key, x in found.items() if not np.array_equal(x, expected[key], equal_nan=True)]
    assert not different


@pytest.mark.skipif(sys.platform != "linux", reason="sanitizers are preloaded as Linux has it")
@pytest.mark.parametrize("name", soaked((*WATCHED_QUICK, *WATCHED_SOAK), ()))
def test_nothing_is_read_before_it_is_written(name: str, tmp_path: Path) -> None:
    """Steps, their derivatives and accelerations: no byte out of bounds, no undefined value, no lane by another."""
    make, further = (WATCHED_QUICK[name], ()) if name in WATCHED_QUICK else WATCHED_SOAK[name]
    model = build_model(make())
    source = render(derive_equations(model, (*MOVING, *further)))
    check_filled(source, model, tmp_path, MEMORY)


@pytest.mark.soak
def test_a_local_that_is_not_written_is_seen(tmp_path: Path) -> None:
    model = build_model(eomgen.load_robot("one_link"))
    source = render(derive_equations(model, MOVING))
    empty = r"    double sine[EOM_PADDED(\1)], cosine[EOM_PADDED(\1)];"  # of angles of which nobody takes the sine
    broken = replace(source, code=re.sub(r"^ *EOM_SIN_COS\((\d+), [^;]*\);$", empty, source.code, flags=re.M))
    assert broken.code != source.code
    refused(AssertionError, "", check_filled, broken, model, tmp_path, ("-w",))
