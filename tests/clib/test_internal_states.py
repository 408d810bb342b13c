"""States of forces behind the velocities: motions and derivatives are those of flat arrays, to the bit."""

from __future__ import annotations

from itertools import product
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.clib.test_library import HERE, LIBRARY, SANITIZED, WHOLE, program, said
from tests.support.soak import soaked

LANES = (str(LIBRARY / "integrate_lanes.c"), "-DEOM_VECTOR_BYTES=16")
SEPARATE, FLAT = (2, 2), (3, 3)  # positions and inputs, of three rates
Array = NDArray[np.float64]


def built(folder: Path, sizes: tuple[int, int], kind: tuple[int, ...], *flags: str) -> Path:
    """Build two masses and a state of a kind: driven, prescribed, closed; a force beside a drive is an input more."""
    positions, inputs = sizes
    inputs += kind[0] and sizes == SEPARATE
    macros = zip(("POSITIONS", "INPUTS", "DRIVEN", "PRESCRIBED", "CLOSED"), (positions, inputs, *kind), strict=True)
    folder.mkdir()
    named = [f"-D{name}={number}" for name, number in macros]
    return program(HERE / "internal_state.c", folder, WHOLE, *LANES, *named, *flags, "-ffp-contract=off")


def rows(text: str, *, works: bool) -> tuple[Array, Array]:
    """Return numbers of lines: what steps are, and what is said at samples within them.

    Args:
        text: what the program writes.
        works: whether lines with works, which begin with a number of steps, are among them.
    """
    within, lines = False, ([], [])
    for line in text.splitlines():
        if line in ("dense", "end"):
            within = line == "dense"
        elif works or not line.split()[0].isdigit():
            lines[within].append([float(x) for x in line.split()])
    return np.array(lines[0]), np.array(lines[1])


KINDS = ((0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 1, 0), (0, 0, 1), (1, 0, 1))


@pytest.mark.parametrize(
    ("kind", "flags"),
    soaked(product(KINDS, ((), SANITIZED)), {((0, 0, 0), ()), ((1, 1, 0), ()), ((1, 0, 1), ())}),
    ids=str,
)
def test_states_need_no_positions(kind: tuple[int, ...], flags: tuple[str, ...], tmp_path: Path) -> None:
    """A number behind the positions changes no bit, but rounding of states within steps and of works along these."""
    separate, flat = (built(tmp_path / str(sizes[0]), sizes, kind, *flags) for sizes in (SEPARATE, FLAT))
    assert said(separate, "fixed") == said(flat, "fixed")
    text = said(separate, "differentiated")
    assert text == said(flat, "differentiated")
    rates = np.array([line.split()[1:] for line in text.splitlines() if line.startswith("rate")], dtype=np.float64)
    assert len(rates) == 24  # by tangents and by gradients, of four methods under three kinds of drives
    assert np.abs(rates[:, 0] - rates[:, 1]).max() <= 1e-12
    assert np.abs(rates[:, 0]).min() > 1e-3
    works = not (kind[0] and kind[1])  # in which what drives do on states belongs to what moves prescribed coordinates
    texts = (said(made, "adaptive") for made in (separate, flat))
    steps, samples = zip(*(rows(text, works=works) for text in texts), strict=True)
    for one, other in (steps, samples):
        assert len(one) > 200
        assert np.abs(one - other).max() <= 1e-13
    assert np.array_equal(samples[0][:, :4], samples[1][:, :4])
    assert np.count_nonzero((steps[0] != steps[1]).any(axis=1)) <= 10  # works alone
