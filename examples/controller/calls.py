"""Functions without arguments for a Cortex-M7, compiled by zig, and instructions that each call of them executes."""

from __future__ import annotations

import importlib.util
import struct
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from image import Image

TARGET = ("-target", "thumb-freestanding-eabihf", "-mcpu=cortex_m7+fp_armv8d16sp")
FLAGS = ("-O2", "-fno-math-errno", "-fno-trapping-math", "-ffp-contract=off", "-ffreestanding", "-fbuiltin")
LINK = """SECTIONS
{
    .text 0x1000 : { KEEP(*(.text*)) *(.rodata*) }
    /DISCARD/ : { *(.ARM.ex*) }
    .data 0x20000000 : { *(.data*) *(.bss*) *(COMMON) }
}
"""


def is_here() -> bool:
    """Whether compiler and emulator are there: zig and unicorn."""
    return all(importlib.util.find_spec(name) for name in ("unicorn", "ziglang"))


def linked(files: Mapping[str, str], entry: str, folder: Path, *, dtype: str = "float32") -> Path:
    """Write texts by their places and entry.c, with a function reset that calls all others; return what they make.

    ``dtype`` is that of the numbers; double precision is computed in software.
    """
    for name, text in {**files, "entry.c": entry, "link.ld": LINK}.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text, encoding="ascii")
    headers = Path(str(importlib.util.find_spec("ziglang").origin)).parent / "lib/libc/include"  # type: ignore[union-attr]
    include = [x for kind in ("arm-linux-musl", "generic-musl") for x in ("-isystem", str(headers / kind))]
    sources = [name for name in (*files, "entry.c") if name.endswith(".c") and "/" not in name]
    vector = 4 if dtype == "float32" else 8  # sines of generated polynomials
    macros = (f"-DEOM_VECTOR_BYTES={vector}",)
    tool = [sys.executable, "-m", "ziglang", "cc", *TARGET, *FLAGS, *include, *macros]
    words = [*tool, "-Wl,-T,link.ld", "-Wl,-e,reset", *sources, "-o", "calls.elf"]
    done = subprocess.run(words, cwd=folder, capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"{' '.join(words)}\n{done.stdout}{done.stderr}")
    return folder / "calls.elf"


def instructions(path: Path, names: Sequence[str]) -> list[int]:
    """Return how many instructions each call of a function executes, one call after the other."""
    import unicorn
    from unicorn import arm_const

    image = Image(path)
    machine = unicorn.Uc(unicorn.UC_ARCH_ARM, unicorn.UC_MODE_THUMB | unicorn.UC_MODE_MCLASS)
    machine.ctl_set_cpu_model(arm_const.UC_CPU_ARM_CORTEX_M7)
    for address, size in ((0, 4 << 20), (0x20000000, 4 << 20), (0xE0000000, 1 << 20)):
        machine.mem_map(address, size)
    for address, data in image.segments():
        machine.mem_write(address, data)
    machine.mem_write(0xE000ED88, struct.pack("<I", 0xF << 20))  # the FPU is on
    addresses = {symbol.name: symbol.address for symbol in image.symbols() if symbol.function}
    count, back = [0], 0x200

    def seen(_engine: Any, _address: int, _size: int, _data: Any) -> None:
        count[0] += 1

    machine.hook_add(unicorn.UC_HOOK_CODE, seen)
    counts = []
    for name in names:
        count[0] = 0
        machine.reg_write(arm_const.UC_ARM_REG_SP, 0x20000000 + (4 << 20))
        machine.reg_write(arm_const.UC_ARM_REG_LR, back | 1)
        machine.emu_start(addresses[name] | 1, back)
        counts.append(count[0])
    return counts
