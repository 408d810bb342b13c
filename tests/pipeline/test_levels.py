"""Builds and packages for several levels of processors: one equation, one answer, whatever runs it."""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen.errors import BuildError, InputError, SingularError
from eomgen.pipeline import stages
from eomgen.pipeline.stages import Options, generate
from eomgen.runtime.levels import LEVELS, VARIABLE, supported
from tests.support.processors import needs_levels, pretend
from tests.support.quick_builds import QUICK, Q, answer, as_new_process, one_link, python, without_headers
from tests.support.random_robots import random_robot
from tests.support.refusals import refused

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
        extra = (kernel.frame_index(kernel.frames[-1]),) if function.is_framed else ()
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
        pytest.param(700, "float32", "all", marks=pytest.mark.soak),
        *(pytest.param(seed, "float64", "all", marks=pytest.mark.soak) for seed in (700, 701, 702, 703, 704)),
    ],
)
def test_all_levels_give_the_same_bits(seed: int, dtype: str, kernels: Any) -> None:
    """Functions of a random robot, one state and several; vectors that are wider or narrower change nothing."""
    robot = random_robot(seed, joints=(1, 3), tree=seed % 2 == 0)
    ways: list[dict[str, Any]] = [{"level": level} for level in supported()]
    ways += [{"flags": ("-O1", "-DEOMGEN_VECTOR=64")}, {"level": "v1", "flags": ("-O1", "-DEOMGEN_VECTOR=32")}]
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
    refused(InputError, r"level: 'v3' beside native; allowed: one of them$", Options, level="v3", native=True)
    with pytest.raises(BuildError, match=r"level: 'v3' is not what the compiler makes code for .*; allowed: v1$"):
        eomgen.build("one_link", level="v3", flags=("-march=x86-64",))


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
    package = generate("one_link", tmp_path, QUICK)
    file = "_one_link.py" if not headers else next(x.name for x in package.glob("_one_link.*.so"))
    assert [len(list((package / level).glob("*.so"))) for level in ("", "v3", "v4")] == [1, 1, 1]
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
    steps: list[str] = []
    with monkeypatch.context() as patch:
        pretend(patch, "old")
        package = generate("one_link", tmp_path, QUICK, progress=steps.append)
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
    package = generate("one_link", tmp_path, Options(QUICK.kernels, flags=QUICK.flags, level=supported()[-1]))
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
    own = stages.make_package
    monkeypatch.setattr(stages, "make_package", lambda *args: asked.append(args[1].level) or own(*args))
    monkeypatch.setenv(VARIABLE, "v1")
    kernel = eomgen.build("one_link", flags=QUICK.flags)
    monkeypatch.delenv(VARIABLE)
    kernel.mass_matrix(Q)
    kernel.energy(Q, Q)
    assert asked == ["v1", "v1"]
