"""What an ELF file of 32 bits holds: sizes, symbols, bytes to load."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path

APART = (
    ".states",
    ".stack",
    ".ARM.ex",
)  # measured states, reserved room, tables of unwinding: no code of the controller
NOBITS, SYMBOLS, FUNCTION = 8, 2, 2
WRITTEN, LOADED = 1, 2  # flags of a section


@dataclass(frozen=True)
class Sizes:
    """Bytes of code and constants, of variables with a first value, of variables that begin at zero."""

    text: int
    data: int
    bss: int


@dataclass(frozen=True)
class Symbol:
    """A name with its address (a function's lowest bit, which says Thumb, cleared) and size in bytes."""

    name: str
    address: int
    size: int
    function: bool


class Image:
    """An executable or object file for Arm.

    Raises:
        ValueError: it is no ELF file of 32 bits, lowest byte first.
    """

    def __init__(self, path: Path) -> None:
        self.bytes = path.read_bytes()
        if self.bytes[:6] != b"\x7fELF\x01\x01":
            raise ValueError(f"{path}: no ELF file of 32 bits, lowest byte first")
        (self._segments, start), (size, count, names) = (
            struct.unpack_from("<II", self.bytes, 28),
            struct.unpack_from("<HHH", self.bytes, 46),
        )
        self._sections = [struct.unpack_from("<10I", self.bytes, start + i * size) for i in range(count)]
        self._names = [self._text(self._sections[names][4] + section[0]) for section in self._sections]

    def _text(self, at: int) -> str:
        return self.bytes[at : self.bytes.index(0, at)].decode("ascii")

    def sizes(self) -> Sizes:
        """What is in memory while it runs, but for what stands APART."""
        text = data = bss = 0
        for name, (_, kind, flags, _, _, size, *_) in zip(self._names, self._sections, strict=True):
            if not flags & LOADED or name.startswith(APART):
                continue
            if not flags & WRITTEN:
                text += size
            elif kind == NOBITS:
                bss += size
            else:
                data += size
        return Sizes(text, data, bss)

    def symbols(self) -> list[Symbol]:
        """All that have a name."""
        found = []
        for _, kind, _, _, at, size, link, _, _, entry in self._sections:
            for place in range(at, at + size, entry) if kind == SYMBOLS else ():
                name, value, length, info = struct.unpack_from("<IIIB", self.bytes, place)
                text = self._text(self._sections[link][4] + name)
                if text:
                    function = info & 15 == FUNCTION
                    found.append(Symbol(text, value & ~1 if function else value, length, function))
        return found

    def frames(self) -> dict[str, int]:
        """Bytes of stack of functions, as clang's -fstack-size-section says them."""
        names = {symbol.address: symbol.name for symbol in self.symbols() if symbol.function}
        found = {}
        for name, (_, _, _, _, at, size, *_) in zip(self._names, self._sections, strict=True):
            end = at + size
            while name == ".stack_sizes" and at < end:
                (address,) = struct.unpack_from("<I", self.bytes, at)
                frame, at = self._unsigned(at + 4)
                found[names[address & ~1]] = frame
        return found

    def _unsigned(self, at: int) -> tuple[int, int]:
        """A number in seven bits a byte, the lowest first, and where the next one begins."""
        number = shift = 0
        while True:
            byte = self.bytes[at]
            number |= (byte & 127) << shift
            shift, at = shift + 7, at + 1
            if byte < 128:
                return number, at

    def segments(self) -> list[tuple[int, bytes]]:
        """Addresses and the bytes that are loaded there."""
        size, count = struct.unpack_from("<HH", self.bytes, 42)
        headers = [struct.unpack_from("<8I", self.bytes, self._segments + i * size) for i in range(count)]
        return [
            (physical, self.bytes[at : at + length])
            for kind, at, _, physical, length, *_ in headers
            if kind == 1 and length
        ]
