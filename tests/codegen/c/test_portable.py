"""Generated C elsewhere: other systems, a processor without one, and a machine that has no compiler but zig's."""

from __future__ import annotations

import importlib.util
import json
import math
import shlex
import shutil
import struct
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen.codegen.c.source import Source
from eomgen.codegen.package.compile import FLAGS, WARNINGS, find_compiler
from eomgen.errors import BuildError
from eomgen.pipeline.options import Options
from eomgen.pipeline.stages import make_source
from tests.support.c_project import write_source
from tests.support.optional import needs
from tests.support.quick_builds import Q, one_link, script, without_headers

needs_zig = pytest.mark.skipif(importlib.util.find_spec("ziglang") is None, reason="pip install eomgen[compiler]")
ZIG = [sys.executable, "-m", "ziglang", "cc"]
ZIG_FPU = {"cortex-m7": "+fp_armv8d16sp", "cortex-m4": "+vfp4d16sp"}  # zig uses none that is not named
STATES = 20


def run(command: list[str], **options: Any) -> str:
    found = subprocess.run(command, capture_output=True, text=True, check=False, **options)
    assert found.returncode == 0, (command, found.stdout[-2000:], found.stderr[-4000:])
    return found.stdout + found.stderr


def without_compilers(monkeypatch: pytest.MonkeyPatch, folder: Path) -> None:
    folder.mkdir()
    monkeypatch.setenv("PATH", str(folder))
    monkeypatch.delenv("CC", raising=False)


@pytest.mark.soak  # zig compiles its own libraries the first time: minutes on a busy machine
@needs_zig
def test_a_machine_without_a_compiler(empty_cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The one of the package ziglang is found, says what it is, and gives the same numbers in both of cffi's modes."""
    robot, q = eomgen.load_robot("puma560"), np.linspace(-1.0, 1.0, 60).reshape(10, 6)
    expected = eomgen.build(robot, kernels=("inverse_dynamics",)).inverse_dynamics(q, q, q)
    without_compilers(monkeypatch, tmp_path / "nothing")
    compiler = find_compiler()
    assert compiler.command == (*ZIG, "-mcpu=baseline")
    assert "clang" in compiler.version
    kernel = eomgen.build(robot, kernels=("inverse_dynamics",))
    assert np.allclose(kernel.inverse_dynamics(q, q, q), expected, rtol=1e-13, atol=1e-13)
    assert len(list((empty_cache / "packages").iterdir())) == 2
    without_headers(monkeypatch)
    plain = eomgen.build(robot, kernels=("inverse_dynamics",))
    assert np.array_equal(plain.inverse_dynamics(q, q, q), kernel.inverse_dynamics(q, q, q))


@pytest.mark.soak
@needs_zig
def test_zig_by_name(empty_cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    expected = one_link().mass_matrix(Q)
    monkeypatch.setenv("CC", " ".join(ZIG))
    assert np.allclose(one_link().mass_matrix(Q), expected, rtol=1e-15)


@pytest.mark.parametrize("command", ["zig cc", "python -m ziglang cc"])
def test_zig_does_not_tune_for_this_processor_unasked(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def words(text: str) -> tuple[str, ...]:
        monkeypatch.setenv("CC", text)
        return find_compiler().command

    program, *rest = command.split()
    (tmp_path / "zig").mkdir()
    for name in (program, "gcc"):
        script(tmp_path / "zig" / name, "echo 1")
    own = shlex.join([str(tmp_path / "zig" / program), *rest])
    assert words(own) == (*own.split(), "-mcpu=baseline")
    for chosen in ("-mcpu=native", "-march=znver4", "-target", "--target=aarch64-linux-gnu"):
        assert words(f"{own} {chosen}") == (*own.split(), chosen)
    assert words(str(tmp_path / "zig" / "gcc")) == (str(tmp_path / "zig" / "gcc"),)


def test_no_compiler_at_all(empty_cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    without_compilers(monkeypatch, tmp_path / "nothing")
    monkeypatch.setitem(sys.modules, "ziglang", None)
    with pytest.raises(BuildError, match=r"no C compiler found: .*pip install ziglang, as eomgen\[compiler\]"):
        one_link()


@pytest.fixture(scope="module")
def single() -> Source:
    """The C of a 6-DOF arm's inverse dynamics in float32."""
    return make_source("puma560", Options(("inverse_dynamics",), "float32"))


TARGETS = {
    "aarch64-linux-gnu": ("-fPIC", b"\x7fELF\x02\x01", 18, b"\xb7\x00"),
    "x86_64-windows-gnu": ("", b"MZ", None, b""),
}


@pytest.mark.soak
@needs_zig
@pytest.mark.parametrize("target", TARGETS)
@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_other_systems(target: str, dtype: str, tmp_path: Path) -> None:
    """A shared library for it, without a warning."""
    codes = write_source(make_source("one_link", Options((), dtype)), tmp_path)
    special, magic, at, machine = TARGETS[target]
    out = tmp_path / "library"
    flags = [*WARNINGS, "-Werror", *FLAGS, *([special] if special else []), "-shared"]
    run([*ZIG, "-target", target, *flags, *map(str, codes), "-o", str(out), "-lm"])
    found = out.read_bytes()
    assert found.startswith(magic)
    if at is None:
        (at,) = struct.unpack_from("<I", found, 0x3C)
        magic, machine = found[at : at + 4], found[at + 4 : at + 6]
        assert (magic, machine) == (b"PE\0\0", b"\x64\x86")
    else:
        assert found[at : at + 2] == machine
    assert b"one_link_mass_matrix" in found


def literal(values: Any) -> str:
    """Numbers in C, to the bit."""
    if np.ndim(values):
        return "{ " + ", ".join(map(literal, values)) + " }"
    return f"{float(values).hex()}f"


@pytest.fixture(scope="module")
def motion(single: Source) -> tuple[str, np.ndarray, np.ndarray]:
    """states.h for the firmware; the generalized forces of the kernel here; what round-off may change in them."""
    kernel = eomgen.build(eomgen.load_robot("puma560"), kernels=("inverse_dynamics",), dtype="float32")
    exact = eomgen.build(eomgen.load_robot("puma560"), kernels=("inverse_dynamics",))
    rng = np.random.default_rng(7)
    q, v, a = (rng.uniform(-size, size, (STATES, 6)).astype(np.float32) for size in (math.pi, 2.0, 5.0))
    meta = json.loads(single.meta)
    values = [kernel.parameters[name] for name in kernel.parameters]
    lines = [
        '#include "puma560.h"',
        f"enum {{ STATES = {STATES}, N = 6, HOISTED = {max(1, int(meta['hoisted']))} }};",
        "#define SETUP puma560_setup",
        "#define INVERSE_DYNAMICS puma560_inverse_dynamics",
        f"static const float parameters[] = {literal(values)};",
        *(f"static const float {name}[STATES][N] = {literal(x)};" for name, x in (("q", q), ("v", v), ("a", a))),
    ]
    expected = kernel.inverse_dynamics(q, v, a)
    double = exact.inverse_dynamics(q.astype(float), v.astype(float), a.astype(float))
    scale = np.abs(double).max(axis=0)
    assert np.abs(expected - double).max() < 1e-5 * scale.max()
    return "\n".join(lines) + "\n", np.asarray(expected), 50.0 * np.finfo(np.float32).eps * scale


def firmware(compiler: str, processor: str, single: Source, states: str, folder: Path) -> Path:
    """An image for a bare board: the kernel freestanding but for libm, C's start, and nothing else."""
    here = Path(__file__).parent / "cortex_m"
    (folder / "states.h").write_text(states)
    kernel, out = write_source(single, folder)[0], folder / "firmware.elf"
    if compiler == "zig":  # whose own library has sinf and cosf for any target; declarations of musl
        spec = importlib.util.find_spec("ziglang")
        assert spec.origin is not None
        headers = Path(spec.origin).parent / "lib" / "libc" / "include"
        include = [x for name in ("arm-linux-musl", "generic-musl") for x in ("-isystem", str(headers / name))]
        name = processor.replace("-", "_") + ZIG_FPU[processor]
        command = [*ZIG, "-target", "thumb-freestanding-eabihf", f"-mcpu={name}", *include]
    else:
        command = ["arm-none-eabi-gcc", f"-mcpu={processor}", "-mthumb", "-mfloat-abi=hard", "-mfpu=auto"]
    command += [*FLAGS, "-ffreestanding", f"-I{folder}"]
    objects = []
    for source, warnings in ((kernel, [*WARNINGS, "-Werror"]), (here / "firmware.c", ["-Wall", "-Werror"])):
        objects.append(str(folder / f"{source.stem}.o"))
        run([*command, *warnings, "-c", str(source), "-o", objects[-1]])
    assert b"__aeabi_fmul" not in Path(objects[0]).read_bytes()  # the FPU does it
    libm = [] if compiler == "zig" else ["-lm", "-lc", "-lgcc"]
    bare = [] if compiler == "zig" else ["-nostdlib"]
    run([*command, *bare, f"-Wl,-T,{here / 'mps2.ld'}", *objects, *libm, "-o", str(out)])
    return out


def segments(image: bytes) -> list[tuple[int, bytes]]:
    """What an ELF file of 32 bits loads: addresses and bytes."""
    start, size, count = (*struct.unpack_from("<I", image, 28), *struct.unpack_from("<HH", image, 42))
    headers = [struct.unpack_from("<8I", image, start + i * size) for i in range(count)]
    return [(address, image[at : at + length]) for kind, at, address, _, length, *_ in headers if kind == 1 and length]


def in_unicorn(image: Path) -> np.ndarray:
    """Run it on an emulated processor until it asks the host for something for the first time."""
    unicorn = needs("unicorn")
    from unicorn import arm_const

    machine = unicorn.Uc(unicorn.UC_ARCH_ARM, unicorn.UC_MODE_THUMB | unicorn.UC_MODE_MCLASS)
    machine.ctl_set_cpu_model(arm_const.UC_CPU_ARM_CORTEX_M7)
    for address, size in ((0, 4 << 20), (0x20000000, 1 << 20), (0xE0000000, 1 << 20)):
        machine.mem_map(address, size)
    for address, data in segments(image.read_bytes()):
        machine.mem_write(address, data)
    stack, entry = struct.unpack("<II", machine.mem_read(0, 8))
    machine.reg_write(arm_const.UC_ARM_REG_SP, stack)
    asked = []

    def interrupt(engine: Any, number: int, _: Any) -> None:
        asked.append(number)
        engine.emu_stop()

    machine.hook_add(unicorn.UC_HOOK_INTR, interrupt)
    machine.emu_start(entry | 1, 0xFFFFFFFE, count=20_000_000)
    assert asked == [7]  # a breakpoint: it is done
    return np.frombuffer(bytes(machine.mem_read(0x20000000, 4 * 6 * STATES)), dtype="<f4").reshape(STATES, 6)


def in_qemu(image: Path, board: str) -> np.ndarray:
    """Run it on an emulated board, which prints its results through the debugger's channel."""
    said = run(
        ["qemu-system-arm", "-M", board, "-nographic", "-monitor", "none", "-serial", "none"]
        + ["-semihosting-config", "enable=on,target=native", "-kernel", str(image)],
        stdin=subprocess.DEVNULL,
    )
    words = [int(line, 16) for line in said.split()]
    return np.array(words, dtype="<u4").view("<f4").reshape(STATES, 6)


def check(found: np.ndarray, motion: tuple[str, np.ndarray, np.ndarray]) -> None:
    _, expected, allowed = motion
    assert np.abs(expected).max() > 10.0  # N m: it moves
    worst = (np.abs(found - expected) / allowed).max()
    assert worst < 1.0, worst


@pytest.mark.soak
@needs_zig
def test_cortex_m7(single: Source, motion: tuple[str, np.ndarray, np.ndarray], tmp_path: Path) -> None:
    """Float32 inverse dynamics of a 6-DOF arm on an emulated Cortex-M7: the same numbers but for round-off."""
    needs("unicorn")
    check(in_unicorn(firmware("zig", "cortex-m7", single, motion[0], tmp_path)), motion)


BOARDS = [("mps2-an500", "cortex-m7"), ("mps2-an386", "cortex-m4")]


@pytest.mark.parametrize(("board", "processor"), BOARDS)
@pytest.mark.parametrize("compiler", ["zig", "arm-none-eabi-gcc"])
def test_boards(
    board: str,
    processor: str,
    compiler: str,
    single: Source,
    motion: tuple[str, np.ndarray, np.ndarray],
    tmp_path: Path,
) -> None:
    if shutil.which("qemu-system-arm") is None:
        pytest.skip("QEMU is not here: apt install qemu-system-arm")
    if compiler == "zig" and importlib.util.find_spec("ziglang") is None:
        pytest.skip("pip install eomgen[compiler]")
    if compiler != "zig" and shutil.which(compiler) is None:
        pytest.skip("apt install gcc-arm-none-eabi libnewlib-arm-none-eabi")
    check(in_qemu(firmware(compiler, processor, single, motion[0], tmp_path), board), motion)
