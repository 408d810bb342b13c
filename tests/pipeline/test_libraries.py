"""Objects of the C library, compiled once for all robots, and builds for several levels of processors."""

from __future__ import annotations

import pickle
import shutil
import subprocess
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen.codegen.c.library import FOLDER, LINKED
from eomgen.codegen.kernels.signatures import BATCHES, SINGLES, library_objects
from eomgen.codegen.package.compile import compile_flags, find_compiler, write_package
from eomgen.codegen.package.library import (
    OBJECT,
    PARTS,
    library_command,
    library_flags,
    library_key,
    write_library,
)
from eomgen.codegen.package.running import Compiler
from eomgen.errors import BuildError, InputError, SingularError
from eomgen.pipeline import cache, on_demand
from eomgen.pipeline.building import load_kernel
from eomgen.pipeline.generating import generate
from eomgen.pipeline.library_objects import KIND, LibraryObjects
from eomgen.pipeline.options import Options
from eomgen.pipeline.stages import make_source
from eomgen.runtime.bound import frame_number
from eomgen.runtime.levels import LEVELS, VARIABLE, supported
from tests.support.c_project import write_source
from tests.support.processors import needs_levels, pretend
from tests.support.quick_builds import (
    QUICK,
    Q,
    answer,
    as_new_process,
    flip,
    logging_compiler,
    one_link,
    python,
    without_headers,
)
from tests.support.random_robots import random_robot
from tests.support.refusals import refused

ROLLS = ("rollout", "adaptive_rollout")
PLAIN = ("-O0", "-ffp-contract=off", "-fno-math-errno", "-fno-trapping-math")
CC = shutil.which("cc") or shutil.which("gcc") or "cc"
QS, V, U = np.array([0.01, 0.5]), np.array([0.1, -0.2]), np.array([0.3, 0.4])


def motions(kernel: eomgen.Kernel) -> list[bytes]:
    """Motions by all methods, alone and of two states, to the bit."""
    found = []
    for q, v, u in ((QS, V, U), (np.array([QS, -QS]), np.array([V, V]), np.array([U, -U]))):
        found += [
            kernel.rollout(q, v, u, 1e-3, 20, method=method, kp=2.0, kd=0.1, target=QS)
            for method in ("rk4", "implicit")
        ]
        for method in ("rosenbrock", "tsit5"):
            found.append(kernel.rollout(q, v, u, duration=0.3, samples=7, method=method, rtol=1e-5))
    return [x.tobytes() for motion in found for x in motion]


def compiles(log: Path) -> list[str]:
    """Parts of the library that a compiler was asked for since the last time, sorted."""
    lines, _ = log.read_text().splitlines(), log.write_text("")
    return sorted(part for line in lines for part, file in PARTS.items() if f"/{FOLDER}/{file} " in line)


def test_it_is_compiled_once_for_all_robots(empty_cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    command, log = logging_compiler(tmp_path)
    monkeypatch.setenv("CC", command)
    for robot, wanted in (("one_link", ["adaptive", "adaptive_lanes"]), ("four_bar", [])):
        eomgen.build(robot, kernels=("adaptive_rollout",), flags=("-O0",))
        assert compiles(log) == wanted


@pytest.mark.soak
def test_each_of_its_parts_is_compiled_once_for_flags_and_precision(
    empty_cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    command, log = logging_compiler(tmp_path)
    monkeypatch.setenv("CC", command)
    flags, adaptive = ("-O0",), {"duration": 0.1, "samples": 2, "rtol": 1e-4}
    eomgen.build("one_link", kernels=("mass_matrix", "rollout"), flags=flags)
    assert compiles(log) == []
    eomgen.build("one_link", kernels=ROLLS, flags=flags)
    assert compiles(log) == ["adaptive", "adaptive_lanes"]
    eomgen.build("four_bar", kernels=ROLLS, flags=flags)
    eomgen.build("one_link", flags=flags).rollout(QS, V, U, **adaptive)
    assert compiles(log) == []
    eomgen.build("one_link", kernels=ROLLS, flags=("-O0", "-g"))
    assert compiles(log) == ["adaptive", "adaptive_lanes"]
    eomgen.build("one_link", flags=flags, dtype="float32").rollout(*(x.astype("f") for x in (QS, V, U)), **adaptive)
    assert compiles(log) == ["adaptive"]
    kinds = [kind for kind, _, _ in cache.contents()]
    assert kinds.count(KIND) == 5


@pytest.mark.soak
def test_both_ways_give_the_same_bits(tmp_path: Path) -> None:
    """Compiled for the robot or for all, quickly or not."""
    compiler = find_compiler()
    source = make_source(eomgen.load_robot("one_link"), Options(ROLLS))
    flags = compile_flags(compiler, False, ())
    folder = tmp_path / "own"
    folder.mkdir()
    write_package(source, compiler, flags, folder)
    own = load_kernel(cache.unfinished("packages", "0" * 64, folder), "one_link")
    assert motions(own) == motions(eomgen.build("one_link", kernels=ROLLS, level="v1"))
    assert motions(own) == motions(eomgen.build("one_link"))


def test_a_robots_file_declares_it_and_holds_none_of_it(tmp_path: Path) -> None:
    """Linked, a robot's object asks for the library's adaptive steps; those are seen by no other library."""
    source = make_source(eomgen.load_robot("one_link"), Options(ROLLS))
    write_source(source, tmp_path)
    made = str(tmp_path / "robot.o")
    command = [CC, "-O2", "-c", f"-D{LINKED}", str(tmp_path / "one_link.c"), "-o", made]
    subprocess.run(command, check=True)
    said = subprocess.run(["nm", made], capture_output=True, text=True, check=True).stdout
    asked = {line.split()[-1] for line in said.splitlines() if line.split()[-2] == "U" and "eom_" in line}
    assert asked == {"eom_integrate_adaptive", "eom_inputs_over_time"}
    assert not [line for line in said.splitlines() if "adapt" in line and line.split()[-2] in "tT" and "eom_" in line]
    package = generate("one_link", tmp_path / "out", Options(ROLLS, levels=("v1",), flags=("-O0",)))
    binary = next(path for path in package.iterdir() if path.name.startswith("_one_link."))
    said = subprocess.run(["nm", "-D", str(binary)], capture_output=True, text=True, check=True).stdout
    assert "one_link" in said
    assert "eom_" not in said


@pytest.mark.soak
def test_without_headers(empty_cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    expected = motions(eomgen.build("one_link", kernels=ROLLS))
    cache.clear()
    without_headers(monkeypatch)
    assert motions(eomgen.build("one_link", kernels=ROLLS, flags=("-O1",))) == expected


def test_parts_of_halves() -> None:
    """Gradients' C includes the library."""
    assert library_objects(("mass_matrix", "energy"), "") == ()
    assert library_objects(("rollout", "energy"), "") == ()
    assert library_objects(ROLLS, "") == tuple(PARTS)
    assert library_objects(ROLLS, SINGLES) == ("adaptive",)
    assert library_objects(ROLLS, BATCHES) == ("adaptive_lanes",)
    assert library_objects((*ROLLS, "explicit_gradient"), "") == ("adaptive_lanes",)


def test_keys_and_flags() -> None:
    """A kernel that is compiled quickly is linked with what others are; all else that changes code changes the key."""
    compiler = Compiler(("cc",), "1")
    quick, full = (compile_flags(compiler, False, (), quick=quick) for quick in (True, False))
    assert library_flags(quick) == library_flags(full)
    key = library_key(compiler, full, "float64", "adaptive")
    assert key == library_key(compiler, quick, "float64", "adaptive")
    others = [
        library_key(Compiler(("cc",), "2"), full, "float64", "adaptive"),
        library_key(compiler, (*full, "-O0"), "float64", "adaptive"),
        library_key(compiler, full, "float32", "adaptive"),
        library_key(compiler, full, "float64", "adaptive_lanes"),
    ]
    assert len({key, *others}) == 5


def objects_of(part: str) -> LibraryObjects:
    return LibraryObjects(find_compiler(), PLAIN, "float64", {"singles": (part,)})


@pytest.mark.soak
def test_a_damaged_object_is_made_again(empty_cache: Path) -> None:
    (first,) = objects_of("adaptive").begin().result()
    made = next((empty_cache / KIND).iterdir())
    flip(made / OBJECT)
    assert objects_of("adaptive").begin().result() == [first]
    assert (made / OBJECT).read_bytes() == first


@pytest.mark.soak
@pytest.mark.parametrize(("dtype", "part"), list(product(["float64", "float32"], PARTS)))
def test_no_compiler_warns(dtype: str, part: str, tmp_path: Path) -> None:
    for name in ("gcc", "clang"):
        if shutil.which(name) is not None:
            (tmp_path / name).mkdir()
            write_library(Compiler((name,), ""), (*PLAIN, "-O2", "-Werror"), dtype, part, tmp_path / name)
    assert "-DEOM_SINGLE" in library_command(find_compiler(), (), "float32", part, tmp_path)


STATES = 11  # no multiple of any number of lanes
IMPORT = """
    import json, sys
    sys.path.insert(0, {folder!r})
    import one_link
    places = [sys.modules[f"one_link.{{name}}"].__file__ for name in ("_one_link", "runtime")]
    print(json.dumps([places, one_link.mass_matrix([0.2, 0.5]).tolist()]))
"""


def answers(kernel: eomgen.Kernel, seed: int) -> dict[str, Any]:
    """What every function says of some states, alone and together."""
    rng = np.random.default_rng(seed)
    raw, found = kernel.raw, {}
    given = {name: rng.uniform(-1.0, 1.0, (STATES, *shape)).astype(raw.dtype) for name, shape in raw.shapes.items()}
    given["q"][0] *= 1e6  # an angle beyond the polynomials
    for name, function in raw.functions.items():
        extra = (frame_number(kernel.frames, kernel.frames[-1]),) if function.is_framed else ()
        arrays = [given[x] for x in function.reads]
        for what, given_here in ((f"{name} batch", arrays), (name, [array[1] for array in arrays])):
            try:
                found[what] = kernel.calls.run(name, None, given_here, extra).tobytes()
            except SingularError as error:  # some trees cannot be put in motion
                found[what] = str(error)
    return found


SOME = ("inverse_dynamics", "forward_dynamics", "frame_pose")


@pytest.mark.soak
@pytest.mark.parametrize(
    ("seed", "dtype", "kernels"),
    [
        (700, "float64", SOME),
        (700, "float32", "all"),
        *((seed, "float64", "all") for seed in (700, 701, 702, 703, 704)),
    ],
)
def test_all_levels_give_the_same_bits(seed: int, dtype: str, kernels: Any) -> None:
    """Functions of a random robot, one state and several; vectors that are wider or narrower change nothing."""
    robot = random_robot(seed, joints=(1, 3), tree=seed % 2 == 0)
    ways: list[dict[str, Any]] = [{"level": level} for level in supported()]
    ways += [{"flags": ("-O1", "-DEOM_VECTOR_BYTES=64")}, {"level": "v1", "flags": ("-O1", "-DEOM_VECTOR_BYTES=32")}]
    builds = [eomgen.build(robot, kernels=kernels, dtype=dtype, **{"flags": ("-O1",), **way}) for way in ways]
    expected, *others = (answers(kernel, seed) for kernel in builds)
    for found in others:
        assert [name for name in expected if expected[name] != found[name]] == []


@needs_levels
def test_the_cache_holds_each_level_once(empty_cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A processor finds what was compiled for its level, never what is beyond it; a kernel that travels likewise."""
    monkeypatch.delenv(VARIABLE, raising=False)
    for processor, entries in (("old", 1), ("old", 1), ("avx2", 2)):
        if processor == "avx2" and "v3" not in supported():
            continue
        with monkeypatch.context() as patch:
            pretend(patch, processor)
            kernel = one_link()
            sent = pickle.dumps(kernel)
            assert len(list((empty_cache / "packages").iterdir())) == entries
    pretend(monkeypatch, "old")
    steps: list[str] = []
    assert np.array_equal(one_link(steps).mass_matrix(Q), kernel.mass_matrix(Q))
    assert steps == []
    back = pickle.loads(sent)  # of a level that is not here
    assert pickle.dumps(back) != sent or "v3" not in supported()
    assert np.array_equal(back.mass_matrix(Q), kernel.mass_matrix(Q))


@needs_levels
def test_a_level_that_does_not_run_here_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    pretend(monkeypatch, "avx2")
    monkeypatch.delenv(VARIABLE, raising=False)
    allowed = "; allowed: v1, v3$"
    with pytest.raises(InputError, match=r"level: 'v4' is beyond this processor, which lacks .*" + allowed):
        eomgen.build("one_link", level="v4")
    monkeypatch.setenv(VARIABLE, "v5")
    refused(InputError, r"\$EOMGEN_LEVEL: 'v5' is unknown" + allowed, eomgen.build, "one_link")
    refused(InputError, r"level: 'v2' is unknown; allowed: v1, v3, v4$", eomgen.build, "one_link", level="v2")
    refused(InputError, r"levels: v3 beside native; allowed: one of them$", Options, levels=("v3",), native=True)
    refused(InputError, r"levels: 'v2' is unknown; allowed: v1, v3, v4, all$", Options, levels=("v1", "v2"))
    refused(InputError, r"levels: 'all'; allowed: a sequence of names, \('all',\)$", Options, levels="all")
    assert Options(levels=("v4", "v1", "v4")).levels == ("v1", "v4")
    assert Options(levels=("v3", "all")).levels == ("all",)
    with pytest.raises(BuildError, match=r"level: 'v3' is not what the compiler makes code for .*; allowed: v1$"):
        eomgen.build("one_link", level="v3", flags=("-march=x86-64",))


EVERY_LEVEL = replace(QUICK, levels=("all",))


def binaries(package: Path) -> list[int]:
    """How many binaries a package has of each level."""
    return [len(list((package / level).glob("*.so"))) for level in ("", *LEVELS[1:])]


@needs_levels
def test_a_package_has_the_first_level_and_the_best_one_here(
    empty_cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv(VARIABLE, raising=False)
    for best in range(len(supported())):
        pretend(monkeypatch, ("old", "avx2", "avx512")[best])
        assert binaries(generate("one_link", tmp_path, QUICK)) == [1, *(int(k == best) for k in (1, 2))]
    monkeypatch.setenv(VARIABLE, "v1")
    assert binaries(generate("one_link", tmp_path, QUICK)) == [1, 0, 0]


@needs_levels
@pytest.mark.parametrize(
    "headers", [pytest.param(True, id="api"), pytest.param(False, id="abi", marks=pytest.mark.soak)]
)
def test_a_package_has_binaries_of_all_levels(
    headers: bool, empty_cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The best one that runs where it is imported is taken, up to the one that the environment names."""
    monkeypatch.delenv(VARIABLE, raising=False)
    if not headers:
        without_headers(monkeypatch)
    package = generate("one_link", tmp_path, EVERY_LEVEL)
    file = "_one_link.py" if not headers else next(x.name for x in package.glob("_one_link.*.so"))
    assert binaries(package) == [1, 1, 1]
    assert not [path for level in LEVELS for path in package.glob(f"{level}/*/*")]
    found = []
    for level in supported():
        variables = {} if level == supported()[-1] else {VARIABLE: level}
        places, matrix = answer(python(IMPORT.format(folder=str(tmp_path)), **variables))
        assert places[0] == str(package / ("" if level == "v1" else level) / file)
        assert places[1] == str(package / "runtime" / "__init__.py")
        found.append(matrix)
    assert all(matrix == found[0] for matrix in found)


@pytest.mark.soak
@needs_levels
def test_levels_beyond_this_processor_are_compiled_and_not_tried(
    empty_cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nor is what nobody tried taken from the cache by a processor that could."""
    monkeypatch.delenv(VARIABLE, raising=False)
    begun, steps = list[tuple[float, str]](), list[str]()
    with monkeypatch.context() as patch:
        pretend(patch, "old")
        package = generate("one_link", tmp_path, EVERY_LEVEL, progress=lambda *stage: begun.append(stage))
    fractions, steps[:] = zip(*begun, strict=True)
    assert list(fractions) == [k / len(steps) for k in range(len(steps))]
    told = [step.partition(" of C")[2] for step in steps if step.startswith("compiling")]
    assert told == ["", *(f" for {level}, which this processor cannot try" for level in LEVELS[1:])]
    assert sorted(path.name for path in package.iterdir() if path.is_dir() and path.name[0] == "v") == ["v3", "v4"]
    as_new_process(monkeypatch)
    steps.clear()
    one_link(steps)
    assert [step.split()[0] for step in steps] == ["compiling"] * (supported()[-1] != "v1")


@pytest.mark.soak
@needs_levels
def test_a_package_of_one_level(empty_cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its binary lies in the package itself; on a processor that does not run it the import says so."""
    package = generate("one_link", tmp_path, Options(QUICK.kernels, flags=QUICK.flags, levels=(supported()[-1],)))
    assert [path.parent for path in package.rglob("*one_link*.so")] == [package]
    assert answer(python(IMPORT.format(folder=str(tmp_path))))[1] == one_link().mass_matrix(Q).tolist()
    if supported()[-1] != "v1":
        process = python(IMPORT.format(folder=str(tmp_path)), **{VARIABLE: "v1"})
        said = process.communicate()[1]
        assert f"BuildError: the compiled code is for processors of level {supported()[-1]}; allowed here: v1" in said


@pytest.mark.soak
def test_native_packages_have_one_binary(empty_cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    package = generate("one_link", tmp_path, Options(QUICK.kernels, flags=QUICK.flags, native=True))
    assert [path.parent for path in package.rglob("*one_link*.so")] == [package]
    monkeypatch.setenv(VARIABLE, "v1")
    places, _ = answer(python(IMPORT.format(folder=str(tmp_path))))
    assert Path(places[0]).parent == package


@needs_levels
def test_on_demand_kernels_keep_the_level_of_their_build(empty_cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[str] = []
    own = on_demand.make_package
    monkeypatch.setattr(on_demand, "make_package", lambda *args: asked.append(args[1].level) or own(*args))
    monkeypatch.setenv(VARIABLE, "v1")
    kernel = eomgen.build("one_link", flags=QUICK.flags)
    monkeypatch.delenv(VARIABLE)
    kernel.mass_matrix(Q)
    kernel.energy(Q, Q)
    assert asked == ["v1", "v1"]
