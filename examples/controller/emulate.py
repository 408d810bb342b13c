"""Run the firmware on an emulated Cortex-M7: by QEMU's board, or by unicorn, which lets every instruction be seen."""

from __future__ import annotations

import bisect
import struct
import subprocess
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from image import Image, Symbol

TICK = 40  # instructions per count of the board's clock: 1e9 a second under -icount shift=0, 25 MHz
LONGEST = 120  # s, of a run
WRITE, EXIT = 0x04, 0x18  # operations of semihosting


@dataclass
class Run:
    """What a run said, and what was seen of it.

    drives: (steps, coordinates), float32.  stack: bytes that were written.  ticks: counts of the board's clock in all
    steps, less those of reading it.  instructions: executed, step by step; by_function: of all steps.  deepest: bytes
    between the stack's top and the lowest stack pointer of a step.
    """

    drives: np.ndarray
    stack: int
    ticks: int
    instructions: list[int] = field(default_factory=list)
    by_function: Counter[str] = field(default_factory=Counter)
    deepest: int = 0


def heard(text: str) -> Run:
    """The lines that main.c prints."""
    lines = [line.split() for line in text.splitlines()]
    words = {kind: [[int(word, 16) for word in rest] for first, *rest in lines if first == kind] for kind in "ucs"}
    ((steps, reading),), ((stack,),) = words["c"], words["s"]
    return Run(np.array(words["u"], dtype="<u4").view("<f4"), stack, steps - reading)


def by_qemu(firmware: Path) -> Run:
    """On QEMU's board mps2-an500, one nanosecond of its time per instruction."""
    found = subprocess.run(
        ["qemu-system-arm", "-M", "mps2-an500", "-icount", "shift=0", "-nographic", "-monitor", "none"]
        + ["-serial", "none", "-semihosting-config", "enable=on,target=native", "-kernel", str(firmware)],
        capture_output=True,
        text=True,
        stdin=subprocess.DEVNULL,
        timeout=LONGEST,
        check=True,
    )
    return heard(found.stdout + found.stderr)


def by_unicorn(firmware: Path) -> Run:
    """Instruction by instruction; it has no clock."""
    import unicorn
    from unicorn import arm_const

    image = Image(firmware)
    machine = unicorn.Uc(unicorn.UC_ARCH_ARM, unicorn.UC_MODE_THUMB | unicorn.UC_MODE_MCLASS)
    machine.ctl_set_cpu_model(arm_const.UC_CPU_ARM_CORTEX_M7)
    for address, size in ((0, 4 << 20), (0x20000000, 1 << 20), (0xE0000000, 1 << 20)):
        machine.mem_map(address, size)
    for address, data in image.segments():
        machine.mem_write(address, data)
    stack, entry = struct.unpack("<II", machine.mem_read(0, 8))
    machine.reg_write(arm_const.UC_ARM_REG_SP, stack)
    watch = _Watch(image, stack, arm_const)
    machine.hook_add(unicorn.UC_HOOK_CODE, watch.seen)
    machine.hook_add(unicorn.UC_HOOK_INTR, lambda engine, number, _: engine.emu_stop())
    said = ""
    while True:
        machine.emu_start(entry | 1, 0xFFFFFFFE, timeout=LONGEST * 1_000_000)
        entry, operation, argument = (
            machine.reg_read(r) for r in (arm_const.UC_ARM_REG_PC, arm_const.UC_ARM_REG_R0, arm_const.UC_ARM_REG_R1)
        )
        if bytes(machine.mem_read(entry, 2)) == b"\xab\xbe":
            entry += 2
        if operation != WRITE:
            break
        said += bytes(machine.mem_read(argument, 256)).split(b"\0")[0].decode("ascii")
    if operation != EXIT:
        raise RuntimeError(f"the firmware asks for operation {operation:#x} of semihosting at {entry:#x}")
    run = heard(said)
    run.instructions, run.deepest = watch.steps, stack - watch.lowest
    run.by_function = watch.by_function()
    return run


class _Watch:
    """Counts the instructions of controller_step, and of what it calls."""

    def __init__(self, image: Image, stack: int, registers: Any) -> None:
        self.functions = sorted((s for s in image.symbols() if s.function), key=lambda s: s.address)
        self.begin = next(s.address for s in self.functions if s.name == "controller_step")
        self.lowest, self.registers = stack, registers
        self.end: int | None = None  # where the step returns to, while one is running
        self.addresses: list[int] = []
        self.counts: Counter[int] = Counter()
        self.steps: list[int] = []

    def seen(self, engine: Any, address: int, size: int, _: Any) -> None:
        """An instruction is about to be executed."""
        if address == self.begin:
            self.end = engine.reg_read(self.registers.UC_ARM_REG_LR) & ~1
            self.addresses = []
        elif address == self.end:
            self.end = None
            self.steps.append(len(self.addresses))
            self.counts.update(self.addresses)
        if self.end is not None:
            self.addresses.append(address)
            self.lowest = min(self.lowest, engine.reg_read(self.registers.UC_ARM_REG_SP))

    def by_function(self) -> Counter[str]:
        """Executed instructions by the function that they are of."""
        found: Counter[str] = Counter()
        begins = [symbol.address for symbol in self.functions]
        for address, count in self.counts.items():
            symbol: Symbol = self.functions[bisect.bisect_right(begins, address) - 1]
            found[symbol.name] += count
        return found
