"""The C of functional mock-up units: the standard's own headers, other platforms' way to build it, memory, sizes."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

import eomgen
from eomgen.cli.entry import main
from eomgen.codegen.package.compile import WARNINGS
from eomgen.export.fmu.pack import binary_path, export_fmu
from eomgen.export.fmu.variables import UNITS, parameter_unit
from eomgen.export.step import PART, default_step
from eomgen.robot.model import build_model
from tests.support.optional import needs

fmpy, etree = needs("fmpy"), needs("lxml.etree")

HEADERS = Path(fmpy.__file__).parent / "c-code"
COMPILERS = [name for name in ("gcc", "clang") if shutil.which(name)]


@pytest.fixture(scope="module", params=[pytest.param(2, marks=pytest.mark.soak), 3])
def unpacked(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of an unpacked unit, named by its version."""
    folder = tmp_path_factory.mktemp("unit")
    robot = eomgen.load_robot("worn_arm")
    options = {"method": "implicit", "step": 1e-4} if request.param == 3 else {"method": "auto"}
    path = export_fmu(robot, folder / "a.fmu", request.param, flags=("-O0",), **options)  # type: ignore[arg-type]
    fmpy.extract(str(path), str(folder / f"fmi{request.param}"))
    return folder / f"fmi{request.param}"


def listed_sources(folder: Path) -> list[str]:
    """Sources that the description names for those who build the unit."""
    if folder.name == "fmi3":
        root = ElementTree.parse(folder / "sources" / "buildDescription.xml").getroot()
        return [str(folder / "sources" / file.attrib["name"]) for file in root.iter("SourceFile")]
    root = ElementTree.parse(folder / "modelDescription.xml").getroot()
    names = {file.attrib["name"] for file in root.iter("File")}
    return [str(folder / "sources" / name) for name in sorted(names)]


def compile_c(command: str, *arguments: str) -> None:
    found = subprocess.run([command, *WARNINGS, "-Werror", *arguments], capture_output=True, text=True, check=False)
    assert found.returncode == 0, found.stderr


@pytest.mark.parametrize("compiler", COMPILERS)
def test_signatures_are_the_standards(compiler: str, unpacked: Path) -> None:
    """Prototypes of the standard's headers and our definitions have to agree, and every function has to be there."""
    ours = str(unpacked / "sources" / f"worn_arm_{unpacked.name}.c")
    compile_c(compiler, "-fsyntax-only", "-DEOMGEN_STANDARD_HEADERS", "-isystem", str(HEADERS), ours)
    text = (HEADERS / f"{unpacked.name}Functions.h").read_text(encoding="utf-8")
    names = {word for word in text.replace("(", " ").replace(";", " ").split() if word.startswith(f"{unpacked.name}")}
    functions = {name for name in names if f"{name}TYPE" in names}
    assert len(functions) > 40
    library = ctypes.CDLL(str(next(unpacked.glob("binaries/*/worn_arm.so"))))
    assert [name for name in sorted(functions) if not hasattr(library, name)] == []
    assert not hasattr(library, "worn_arm_setup")  # what is not the interface's is hidden


@pytest.mark.parametrize("compiler", COMPILERS)
def test_listed_sources_build_by_themselves(compiler: str, unpacked: Path, tmp_path: Path) -> None:
    if unpacked.name == "fmi3":
        schema = etree.XMLSchema(file=str(HEADERS.parent / "schema" / "fmi3" / "fmi3BuildDescription.xsd"))
        schema.assertValid(etree.parse(str(unpacked / "sources" / "buildDescription.xml")))
    prefix = "-DFMI2_FUNCTION_PREFIX=worn_arm_" if unpacked.name == "fmi2" else "-DANYTHING"
    library = str(tmp_path / "unit.so")
    compile_c(compiler, "-O0", "-shared", "-fPIC", prefix, *listed_sources(unpacked), "-o", library, "-lm")
    assert hasattr(ctypes.CDLL(library), f"worn_arm_{unpacked.name}GetVersion")  # several units in one program


DRIVER = r"""
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "worn_arm_unit.h"
#include "worn_arm_%(version)s.h"
#define CHECK(call) do { if ((call) != 0) { fprintf(stderr, "line %%d: %%s\n", __LINE__, #call); return 1; } } while (0)
#define FAILS(call) CHECK((call) - %(version)sError)
#define INPUTS (UNIT_RATES - UNIT_Q)
#define OUTPUTS (UNIT_END - UNIT_RATES)
static int said;
%(logger)s
static int run(void *a, void *b)
{
    unsigned all[UNIT_END], inputs[INPUTS];
    double values[UNIT_END], seed[INPUTS];
    void *state = NULL, *copy = NULL;
    char *bytes;
    size_t size = 0;
    for (unsigned i = 0; i < UNIT_END; ++i) all[i] = i;
    for (unsigned i = 0; i < INPUTS; ++i) {
        inputs[i] = UNIT_Q + i;
        seed[i] = 1e-5 / (1.0 + i);
    }
    (void)b;
%(body)s
    return 0;
}
int main(void)
{
%(main)s
    printf("fine, %%d messages\n", said);
    return 0;
}
"""
COMMON = r"""
    CHECK(X(GetS)(a, &state));
    CHECK(X(SerializedSize)(a, state, &size));
    bytes = malloc(size);
    if (bytes == NULL) return 1;
    CHECK(X(Serialize)(a, state, BYTES bytes, size));
    FAILS(X(Serialize)(a, state, BYTES bytes, size - 1));
    CHECK(X(Deserialize)(b, BYTES bytes, size, &copy));
    FAILS(X(Deserialize)(b, BYTES bytes, size - 1, &copy));
    FAILS(X(Serialize)(a, NULL, BYTES bytes, size));
    CHECK(X(SetS)(b, copy));
    CHECK(X(FreeS)(b, &copy));
    CHECK(X(FreeS)(a, &state));
    CHECK(X(FreeS)(a, &state));
    memset(bytes + size - sizeof(double), 0xff, sizeof(double));
    FAILS(X(Deserialize)(b, BYTES bytes, size, &copy));
    free(bytes);
    CHECK(X(Reset)(a));
    CHECK(X(GetAll)(a, all, UNIT_END, values));
"""
VERSION_2 = {
    "logger": """
static void logger(void *x, const char *name, fmi2Status status, const char *category, const char *text, ...)
{
    said += x == NULL && strlen(name) > 0 && status == fmi2Error && strlen(category) > 0 && strlen(text) > 0;
}
#define BYTES
#define GetS fmi2GetFMUstate
#define SetS fmi2SetFMUstate
#define FreeS fmi2FreeFMUstate
#define SerializedSize fmi2SerializedFMUstateSize
#define Serialize fmi2SerializeFMUstate
#define Deserialize fmi2DeSerializeFMUstate
#define Reset fmi2Reset
#define GetAll fmi2GetReal
#define X(name) name
""",
    "body": """
    FAILS(fmi2SetupExperiment(a, 1, -1.0, 0.0, 0, 0.0));
    CHECK(fmi2SetupExperiment(a, 1, 1e-4, 0.0, 0, 0.0));
    CHECK(fmi2EnterInitializationMode(a));
    CHECK(fmi2SetReal(a, inputs, INPUTS, seed));
    FAILS(fmi2SetReal(a, all, UNIT_END, values));
    CHECK(fmi2ExitInitializationMode(a));
    for (int i = 0; i < 5; ++i) CHECK(fmi2DoStep(a, 1e-4 * i, 1e-4, 1));
    CHECK(fmi2GetReal(a, all, UNIT_END, values));
    CHECK(fmi2GetDirectionalDerivative(a, all + UNIT_RATES, OUTPUTS, inputs, INPUTS, seed, values));
    FAILS(fmi2GetDerivatives(a, values, 2 * UNIT_DOF));
""",
    "main": """
    fmi2CallbackFunctions callbacks = { logger, NULL, NULL, NULL, NULL };
    void *a = fmi2Instantiate("a", fmi2CoSimulation, UNIT_TOKEN, NULL, &callbacks, 0, 0);
    void *b = fmi2Instantiate("b", fmi2ModelExchange, UNIT_TOKEN, NULL, &callbacks, 0, 0);
    if (a == NULL || b == NULL || run(a, b)) return 1;
    if (fmi2Instantiate("c", fmi2CoSimulation, "", NULL, &callbacks, 0, 0) != NULL) return 1;
    fmi2FreeInstance(a);
    fmi2FreeInstance(b);
    fmi2FreeInstance(NULL);
""",
}
VERSION_3 = {
    "logger": """
static void logger(void *x, fmi3Status status, const char *category, const char *text)
{
    said += x == NULL && status == fmi3Error && strlen(category) > 0 && strlen(text) > 0;
}
#define BYTES (fmi3Byte *)
#define GetS fmi3GetFMUState
#define SetS fmi3SetFMUState
#define FreeS fmi3FreeFMUState
#define SerializedSize fmi3SerializedFMUStateSize
#define Serialize fmi3SerializeFMUState
#define Deserialize fmi3DeserializeFMUState
#define Reset fmi3Reset
#define GetAll(x, all, count, values) fmi3GetFloat64(x, all, count, values, count)
#define X(name) name
""",
    "body": """
    bool event, over, early;
    double last;
    CHECK(fmi3EnterInitializationMode(a, 0, 0.0, 0.0, 0, 0.0));
    CHECK(fmi3SetFloat64(a, inputs, INPUTS, seed, INPUTS));
    FAILS(fmi3SetFloat64(a, inputs, INPUTS, seed, 1));
    FAILS(fmi3SetFloat64(a, all, UNIT_END, values, UNIT_END));
    CHECK(fmi3ExitInitializationMode(a));
    for (int i = 0; i < 5; ++i) CHECK(fmi3DoStep(a, 1e-4 * i, 1e-4, 1, &event, &over, &early, &last));
    CHECK(fmi3GetFloat64(a, all, UNIT_END, values, UNIT_END));
    CHECK(fmi3GetDirectionalDerivative(
        a, all + UNIT_RATES, OUTPUTS, inputs, INPUTS, seed, INPUTS, values, OUTPUTS));
    FAILS(fmi3GetContinuousStateDerivatives(a, values, 2 * UNIT_DOF));
    FAILS(fmi3GetInt32(a, all, 1, NULL, 1));
""",
    "main": """
    void *a = fmi3InstantiateCoSimulation("a", UNIT_TOKEN, NULL, 0, 0, 0, 0, NULL, 0, NULL, logger, NULL);
    void *b = fmi3InstantiateModelExchange("b", UNIT_TOKEN, NULL, 0, 0, NULL, logger);
    if (a == NULL || b == NULL || run(a, b)) return 1;
    if (fmi3InstantiateModelExchange("c", "", NULL, 0, 0, NULL, logger) != NULL) return 1;
    fmi3FreeInstance(a);
    fmi3FreeInstance(b);
    fmi3FreeInstance(NULL);
""",
}


def build_driver(unpacked: Path, target: Path, flags: Sequence[str]) -> None:
    texts = VERSION_2 if unpacked.name == "fmi2" else VERSION_3
    code = DRIVER % {"version": unpacked.name, **texts, "body": texts["body"] + COMMON}
    driver = target.with_suffix(".c")
    driver.write_text(code, encoding="ascii")
    include = ("-iquote", str(unpacked / "sources"), "-std=c99", "-g", "-O0", "-Werror")
    include = (*include, "-DEOMGEN_STANDARD_HEADERS", "-isystem", str(HEADERS))
    command = ["gcc", *include, *flags, str(driver), *listed_sources(unpacked), "-o", str(target), "-lm"]
    found = subprocess.run(command, capture_output=True, text=True, check=False)
    assert found.returncode == 0, found.stderr


@pytest.mark.skipif("gcc" not in COMPILERS, reason="needs gcc and its sanitizers")
@pytest.mark.soak
def test_memory_is_used_as_it_should_be(unpacked: Path, tmp_path: Path) -> None:
    """Instances, steps, derivatives and states under the address, leak and undefined-behaviour sanitizers."""
    build_driver(unpacked, tmp_path / "driver", ("-fsanitize=address,undefined", "-fno-sanitize-recover=all"))
    found = subprocess.run([str(tmp_path / "driver")], capture_output=True, text=True, check=False)
    assert found.returncode == 0, found.stdout + found.stderr
    assert found.stdout.startswith("fine, "), found.stdout
    assert int(found.stdout.split()[1]) >= 4


@pytest.mark.soak
@pytest.mark.skipif(not shutil.which("valgrind"), reason="needs valgrind")
def test_memory_under_valgrind(unpacked: Path, tmp_path: Path) -> None:
    build_driver(unpacked, tmp_path / "driver", ())
    command = ["valgrind", "-q", "--leak-check=full", "--error-exitcode=9", str(tmp_path / "driver")]
    found = subprocess.run(command, capture_output=True, text=True, check=False)
    assert found.returncode == 0, found.stdout + found.stderr
    print(f"{unpacked.name} under valgrind: {found.stdout.strip()}")


def test_units_of_parameters() -> None:
    """Every parameter of every built-in robot has a unit, and forces divided by their arguments agree."""
    for name in eomgen.builtin_robots():
        robot = eomgen.load_robot(name)
        for parameter in build_model(robot).parameters:
            assert parameter_unit(robot, parameter) in UNITS, parameter
    worn, geared = eomgen.load_robot("worn_arm"), eomgen.load_robot("geared_arm")
    for robot, parameter, unit in (
        (worn, "joints.shoulder.x.stiffness", "N/m"),
        (worn, "joints.shoulder.x.clearance", "m"),
        (worn, "joints.shoulder.x.restitution_damping", "s/m"),
        (worn, "joints.elbow.beta.cubic", "N.m/rad3"),
        (worn, "joints.shoulder.gamma.friction.stribeck", "rad/s"),
        (worn, "joints.shoulder.gamma.friction.viscous", "N.m.s/rad"),
        (worn, "joints.gear.gamma.curve.0", "N.m"),
        (geared, "joints.waist.motor.stiffness", "N.m/rad"),
        (geared, "joints.waist.motor.ratio", "1"),
        (geared, "joints.waist.motor.friction.smoothing", "rad/s"),
        (geared, "links.upper.com.x", "m"),
        (geared, "links.upper.inertia.xx", "kg.m2"),
        (geared, "joints.waist.placement.rpy.0", "rad"),
        (geared, "frames.tcp.placement.xyz.1", "m"),
        (geared, "springs.s.damping", "N.s/m"),
        (geared, "springs.s.points.0.x", "m"),
    ):
        assert parameter_unit(robot, parameter) == unit, parameter


def test_the_default_step_is_short_enough() -> None:
    stiff = 2.0 * np.sqrt(1e4 / 0.25)  # rad/s, of one_link across its rod: k over the reduced mass
    step = default_step(eomgen.load_robot("one_link"), "rk4")
    assert step <= 1e-3
    assert 0.1 * PART / stiff < step
    assert default_step(eomgen.load_robot("ur5"), "rk4") == 1e-3
    assert default_step(eomgen.load_robot("puma560_elastic"), "implicit") == 1e-3


def test_places_of_binaries() -> None:
    for version, system, machine, place in (
        (2, "linux", "x86_64", "binaries/linux64/arm.so"),
        (3, "linux", "x86_64", "binaries/x86_64-linux/arm.so"),
        (2, "win32", "AMD64", "binaries/win64/arm.dll"),
        (3, "win32", "AMD64", "binaries/x86_64-windows/arm.dll"),
        (2, "darwin", "x86_64", "binaries/darwin64/arm.dylib"),
        (3, "darwin", "arm64", "binaries/aarch64-darwin/arm.dylib"),
        (2, "linux", "aarch64", "binaries/aarch64-linux/arm.so"),
    ):
        assert binary_path("arm", version, system, machine) == place


@pytest.mark.soak
@pytest.mark.usefixtures("unoptimised")
def test_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["export", "one_link", "--fmu", "-o", str(tmp_path)]) == 0
    written = [tmp_path / f"one_link.fmi{version}.fmu" for version in (2, 3)]
    assert capsys.readouterr().out.splitlines() == [f"wrote {path}" for path in written]
    for path, version in zip(written, ("2.0", "3.0"), strict=True):
        description = fmpy.read_model_description(str(path))
        assert description.fmiVersion == version
        assert [float(x.start) for x in description.modelVariables if x.name.startswith("solver.")] == [1e-6]
    one = ["export", "one_link", "--fmu", "--fmi", "3", "-o", str(tmp_path)]
    for options, name, start in (
        (["--method", "tsit5", "--rtol", "1e-8"], "solver.tolerance", 1e-8),
        (["--method", "rk4"], "solver.step", default_step(eomgen.load_robot("one_link"), "rk4")),
    ):
        assert main([*one, *options]) == 0
        description = fmpy.read_model_description(str(written[1]))
        assert {x.name: float(x.start) for x in description.modelVariables if x.name.startswith("solver.")} == {
            name: start
        }
    capsys.readouterr()
    for options, message in (
        (["--method", "rk4", "--step", "0"], "step: 0.0 is no length of a step"),
        (["--step", "1e-3"], "step: 0.001 is given with method 'auto'; allowed: with the methods rk4, implicit"),
        (["--rtol", "2"], "rtol: 2.0 is no relative tolerance; allowed: a number from 1e-13 to 0.1"),
    ):
        assert main([*one, *options]) == 1
        assert message in capsys.readouterr().err
    assert main(["export", "one_link", "-o", str(tmp_path)]) == 1
    assert "no format is given; allowed: --fmu" in capsys.readouterr().err
