"""Numbers with prefixes, intervals with digits enough, micro signs where a terminal has them."""

from __future__ import annotations

import io
import math
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eomgen.cli.shared.output import say, with_micro_signs
from eomgen.shown import PREFIXED, interval, interval_ends, prefixed, scale_of

FACTORS = {"": 1.0, "m": 1e-3, "u": 1e-6, "n": 1e-9, "p": 1e-12}


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (0.0312, "m", "31.2 mm"),
        (31.2e-6, "m", "31.2 um"),
        (999.9e-6, "m", "1 mm"),
        (-2.5e-3, "rad", "-2.5 mrad"),
        (0.0, "m", "0 m"),
        (1234.0, "m", "1230 m"),
        (4.2e-17, "m", "4.2e-05 pm"),
        (3.3e-7, "m/N", "330 nm/N"),
        (math.nan, "m", "nan m"),
        (math.inf, "rad", "inf rad"),
    ],
)
def test_prefixes(value: float, unit: str, text: str) -> None:
    assert prefixed(value, unit) == text


@given(st.floats(1e-11, 900.0), st.booleans(), st.integers(2, 6))
def test_prefixed_numbers_are_what_they_were(value: float, negative: bool, digits: int) -> None:
    """To the digits asked for, between 1 and 1000 of the unit; with a sign where one is asked for."""
    value = -value if negative else value
    text = prefixed(value, "rad", digits, sign=True)
    found = re.fullmatch(r"([+-])([0-9.]+) ([munp]?)rad", text)
    assert found is not None, text
    assert (found[1] == "-") == negative
    assert 1.0 <= float(found[2]) < 1000.0
    again = float(found[1] + found[2]) * FACTORS[found[3]]
    assert again == pytest.approx(value, rel=0.51 * 10.0 ** (1 - digits))
    assert scale_of(np.array([value, 0.0]), "m")[1] in ("m", "mm", "um", "nm", "pm")


@given(st.floats(-1e6, 1e6), st.floats(1e-9, 1e3))
def test_ends_of_intervals_differ_in_two_digits(low: float, width: float) -> None:
    """Ten steps of the last digit and more lie between them, as far as floats have so many digits."""
    high = low + width
    step = 10.0 ** math.floor(math.log10(width)) / 10.0 if width else 0.0
    if high - low < 1e-12 * max(abs(low), abs(high)) or abs(high - low - width) > 1e-3 * width:
        return  # as good as the same number
    first, last = map(float, interval_ends(low, high))
    assert abs(first - low) <= 0.51 * step
    assert abs(last - high) <= 0.51 * step
    assert last - first >= 8.9 * step


def test_intervals() -> None:
    assert interval(1.0, 2.0) == "1 .. 2"
    assert interval(2.000012e5, 2.000034e5) == "200001.2 .. 200003.4"
    assert interval(1.000012, 1.000034, 5) == "1.000012 .. 1.000034"
    assert interval(3.0, 3.0) == "3 .. 3"
    assert interval(-math.inf, 1.0) == "-inf .. 1"


class Terminal(io.TextIOWrapper):
    """A stream that says it is a terminal, or not."""

    def __init__(self, encoding: str, terminal: bool) -> None:
        super().__init__(io.BytesIO(), encoding=encoding, newline="\n")
        self.terminal = terminal

    def isatty(self) -> bool:
        return self.terminal

    def text(self) -> str:
        self.flush()
        assert isinstance(self.buffer, io.BytesIO)
        return self.buffer.getvalue().decode(self.encoding)


@pytest.mark.parametrize(
    ("encoding", "terminal", "sign"),
    [
        ("utf-8", True, "\N{MICRO SIGN}"),
        ("latin-1", True, "\N{MICRO SIGN}"),
        ("ascii", True, "u"),
        ("utf-8", False, "u"),
        ("cp866", True, "u"),
    ],
)
def test_micro_signs_where_the_terminal_has_them(encoding: str, terminal: bool, sign: str) -> None:
    """And in no word that is none of a quantity."""
    stream = Terminal(encoding, terminal)
    say("off by 31.2 um and 5 urad, 3 um/N [urad]; joint um, 5 ums, umbra 5um", stream)
    wanted = f"off by 31.2 {sign}m and 5 {sign}rad, 3 {sign}m/N [{sign}rad]; joint um, 5 ums, umbra 5um\n"
    assert stream.text() == wanted
    for unit in PREFIXED:  # the command line has a list of its own, without NumPy
        assert with_micro_signs(f"1 u{unit}", stream) == f"1 {sign}{unit}"
