"""Programs cut by what their values depend on: what can be computed early, and what has to wait."""

from __future__ import annotations

from collections.abc import Collection

from .ir import Instruction, Program, select, verify

EARLY, LATE = 1, 2


def cut(program: Program, late: Collection[str], shared: Collection[str], kept: str) -> tuple[Program, Program]:
    """Cut a program into one that keeps what does not depend on some inputs, and one that goes on from there.

    Args:
        program: writes "out", and maybe other arrays that do not depend on ``late``.
        late: input arrays that are not known to the first program.
        shared: input arrays that both programs read; what depends on them alone is computed in both.
        kept: input array of the second program, which is "out" of the first one.
    """
    depends: list[int] = []
    for op, args, leaf in program.instructions:
        when = 0
        if op == "input" and leaf[0] not in shared:
            when = LATE if leaf[0] in late else EARLY
        for arg in args:
            when |= depends[arg]
        depends.append(when)
    results = {index for (array, _), index in program.outputs.items() if array == "out"}
    needed = {arg for i, x in enumerate(program.instructions) if depends[i] & LATE for arg in x.args}
    places = {index: place for place, index in enumerate(sorted(i for i in needed | results if depends[i] == EARLY))}
    others = {key: index for key, index in program.outputs.items() if key[0] != "out"}
    assert all(not depends[index] & LATE for index in others.values())
    first = {**others, **{("out", place): index for index, place in places.items()}}
    instructions = list(program.instructions)
    for index, place in places.items():
        instructions[index] = Instruction("input", (), (kept, place))
    second = {key: index for key, index in program.outputs.items() if key[0] == "out"}
    return (
        verify(select(program.name, program.instructions, first, program.notes, program.operations)),
        verify(select(program.name, instructions, second, program.notes, program.operations)),
    )
