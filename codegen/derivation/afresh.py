"""A robot's derivation afresh: SymPy's blocks, the zeros that they prove, the programs that agree with them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from textwrap import wrap

import sympy

from eomgen.errors import InputError
from eomgen.robot.model import Model, with_offset_angles
from eomgen.robot.value import Robot

from ..joint.facts import Facts
from ..joint.kept import KEPT
from ..joint.zeros import ZeroMap, zero_map
from ..kernels.equations import Equations, derive_equations
from ..kernels.signatures import available
from .fresh import Blocks, derive_blocks
from .generic_terms import check_zeros
from .programs import CHECKED, check_programs

MOST_COUNTED = 256  # coordinates of robots whose terms of C are counted and looked at one by one
WIDTH = 110  # of lines in a header


@dataclass(frozen=True)
class Derived:
    """Result of a derivation: what was derived and compared.

    model: the tree, with followers as coordinates.  blocks: of its kinds of joints, by their active coordinates.
    zeros: of its M and C; None of more than MOST_COUNTED coordinates.  vanishing: terms that survive and were zero.
    compared: kernels whose programs agree.  sympy: the version.
    """

    model: Model
    blocks: Mapping[tuple[str, ...], Blocks]
    zeros: ZeroMap | None
    vanishing: int
    compared: tuple[str, ...]
    sympy: str

    def lines(self) -> Iterator[str]:
        """Say what was derived, by what, and which terms vanish by which lemma."""
        yield f"Derived afresh by SymPy {self.sympy}, joint by joint; terms tr(dA/ds H dA^T) and tr(dA/ds H d2A^T):"
        if self.zeros is None:
            yield f"zeros of more than {MOST_COUNTED} coordinates are not counted"
        else:
            yield from self.zeros.lines()
        names = ", ".join(self.compared) or "none of those that were asked for"
        yield from wrap(f"Programs that agree with them at a random rational point: {names}", WIDTH)

    def in_header(self, header: str) -> str:
        """Write the lines into the first comment of a C header."""
        end = header.index("\n */\n")
        return (
            header[:end]
            + "".join(f"\n * {line}" for line in ("", *self.lines())).replace(" * \n", " *\n")
            + header[end:]
        )


def check_derivable(robot: Robot) -> None:
    """Refuse robots that cannot be derived afresh.

    Raises:
        InputError: a link bends; names it.
    """
    for link in robot.links:
        if link.modes is not None:
            raise InputError(
                f"links.{link.name}.modes: SymPy derives joints afresh, and no link that bends; allowed: robots whose"
                " links are rigid"
            )


def derive_afresh(
    model: Model,
    kernels: Sequence[str] = (),
    dtype: str = "float64",
    *,
    kept: Facts = KEPT,
    equations: Equations | None = None,
) -> Derived:
    """Derive a robot's joint blocks with SymPy, and compare what is kept, dropped and rendered with them.

    Args:
        model, kernels, dtype: as of ``derive_equations``.
        kept: facts to compare with.
        equations: programs to compare with; those of the kernels that can be compared if None.

    Raises:
        DerivationError: something differs.
        InputError: a link bends.
    """
    check_derivable(model.robot)
    tree, (whole, _) = model.tree, with_offset_angles(model)
    blocks = derive_blocks(tree, whole, kept=kept)
    zeros = zero_map(tree) if tree.size <= MOST_COUNTED else None
    vanishing = check_zeros(tree, whole, blocks, zeros) if zeros is not None else 0
    if equations is None:
        names = [name for name in CHECKED if name in available(model) and (not kernels or name in kernels)]
        equations = derive_equations(model, names or ("mass_matrix",), dtype)
    christoffel = zeros.christoffel if zeros is not None and model is tree else None
    compared = check_programs(equations, blocks, christoffel)
    return Derived(tree, blocks, zeros, vanishing, compared, sympy.__version__)
