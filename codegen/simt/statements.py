"""Schedule -> statements of one thread: what it reads, computes, writes and checks, one value per line."""

from __future__ import annotations

from collections.abc import Container, Iterator, Mapping

from ..c.scalar_types import Scalar
from ..program.ir import Program
from .registers import CHECKS, TURN, Schedule, Statement

SHARED = ("h", "dt")  # arrays with one number for all states
PIVOTS = 28  # bits of a status for pivots, the first of coordinate 0; then those of STATUS
STATUS: Mapping[str, int] = {"violation": 28, "violation_rate": 29, "far": 30}


class Writer:
    """Writes the statements of one program in the order of a schedule.

    constraints: of a closed mechanism; checks of more are of their rates.
    local: arrays whose numbers are variables of the thread, q_0 and so on, and not in memory.
    """

    def __init__(
        self,
        program: Program,
        schedule: Schedule,
        scalar: Scalar,
        *,
        constraints: int = 0,
        local: Container[str] = (),
    ) -> None:
        self.program, self.schedule, self.scalar = program, schedule, scalar
        self.constraints, self.local = constraints, local
        self.size = len(program.instructions)
        self.loaded: set[int] = set()
        self.turned: set[int] = set()
        self.stores: dict[int, list[tuple[str, int]]] = {}
        for (array, place), index in program.outputs.items():
            if array not in CHECKS:
                self.stores.setdefault(index, []).append((array, place))

    def lines(self) -> Iterator[str]:
        """Write statements: inputs where they are used first, outputs as soon as they are there."""
        for index in self.stores:
            if self.program.instructions[index].op in ("const", "input"):
                yield from self._load(index)
                yield from self._store(index)
        for statement in self.schedule.statements:
            for use in statement.uses:
                yield from self._load(use)
            yield from self._written(statement)

    def _written(self, statement: Statement) -> Iterator[str]:
        args = [self._text(use) for use in statement.uses]
        if statement.op in CHECKS:
            yield self._check(statement, *args)
        elif statement.op == TURN:
            yield from self._turn(statement, args[0])
        else:
            yield f"const real {self._text(statement.index)} = {self._expression(statement.op, args)};"
            yield from self._store(statement.index)

    def _turn(self, statement: Statement, angle: str) -> Iterator[str]:
        """Write sine and cosine of an angle; again only where a compiler does not see that they are known."""
        ops = {self.program.instructions[name % self.size].op: name for name in statement.defines}
        sine = self._text(ops["sin"]) if "sin" in ops else f"s{statement.index}_{statement.defines[0]}"
        cosine = self._text(ops["cos"]) if "cos" in ops else f"c{statement.index}_{statement.defines[0]}"
        is_again = statement.index in self.turned
        self.turned.add(statement.index)
        yield f"real {sine}, {cosine};"
        yield f"EOM_TURN({f'EOM_AGAIN({angle})' if is_again else angle}, {sine}, {cosine});"
        if not is_again:
            for name in statement.defines:
                yield from self._store(name)

    def _check(self, statement: Statement, number: str, scale: str) -> str:
        if statement.op == "pivot":
            return f"EOM_CHECK({number} > EOM_VANISHED*{scale}, {statement.index % PIVOTS});"
        bit = STATUS["violation" if statement.index < self.constraints else "violation_rate"]
        return f"EOM_CHECK({number} <= {scale}*EOM_OPEN, {bit});"

    def _load(self, index: int) -> Iterator[str]:
        """Read an input into a value, once."""
        if index < self.size and self.program.instructions[index].op == "input" and index not in self.loaded:
            self.loaded.add(index)
            array, place = self.program.instructions[index].leaf
            if array not in SHARED and array not in self.local:
                yield f"const real {array}_{place} = AT({array}, {place});"

    def _store(self, index: int) -> Iterator[str]:
        for array, place in self.stores.get(index, ()):
            target = f"{array}_{place}" if array in self.local else f"AT({array}, {place})"
            yield f"{target} = {self._text(index)};"

    def _text(self, name: int) -> str:
        """Name a value; a number is itself."""
        op, _, leaf = self.program.instructions[name % self.size]
        if op == "const":
            text = self.scalar.literal(leaf)
            return f"({text})" if text.startswith("-") else text
        if op == "input":
            return f"{leaf[0]}[{leaf[1]}]" if leaf[0] in SHARED else f"{leaf[0]}_{leaf[1]}"
        again = name // self.size
        return f"t{name % self.size}{f'_{again}' if again else ''}"

    def _expression(self, op: str, args: list[str]) -> str:
        operation = self.program.operations[op]
        return f"{operation.function}({', '.join(args)})" if operation.function else operation.form.format(*args)
