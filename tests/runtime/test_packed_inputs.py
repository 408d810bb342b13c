"""Input signals as structures of C: the table names every field, and what is packed reads back."""

from __future__ import annotations

import re

import numpy as np
import pytest

import eomgen
from eomgen.codegen.c.library import library_types
from eomgen.export.wasm.layout import layouts, of_c
from eomgen.runtime.stepping.input_signals import DriveData, Gains, InputSignals, LinkWrench, Signal, Track, jump_times
from eomgen.runtime.stepping.packed_inputs import STRUCTS, PackedInputs

pytestmark = pytest.mark.usefixtures("unoptimised")

FUNCTIONS = re.compile(r"\(\*(\w+)\)\(")
OWN = {"mechanism", "work", "h", "batch_h", "force_turned"}  # of functions, or filled by themselves


@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_every_field_of_the_structures_is_in_the_table(dtype: str) -> None:
    """A new field of eom.h is packed, or is a function, its h, or what OWN names."""
    functions = set(FUNCTIONS.findall(library_types(dtype)))
    beside = OWN | functions | {f"{name}_h" for name in functions} | {"frame_h", "force_h"}
    for struct, fields in STRUCTS.items():
        _, places = layouts(dtype)[of_c(struct, dtype)]
        assert set(fields) <= set(places), struct
        left = {name for name in places if name not in fields and name not in beside}
        assert not {name for name in left if not re.fullmatch(r"(force|pose)_(back|along|by)_h|(back|along)_h", name)}


def test_what_is_packed_reads_back() -> None:
    kernel = eomgen.build("one_link")
    inner = Signal(np.array([0.0, 2.0]), np.array([[[0.1], [0.4]]]))
    signal = Signal(np.array([0.0, 1.0, 3.0]), np.arange(6.0).reshape(2, 3, 1), profile=inner)
    gains = Gains(np.array([30.0]), np.array([2.0]))
    drive = DriveData(None, Track(signal, np.array([1])), np.array([5.0]), gains, effort=np.array([np.inf, 7.0]))
    push = LinkWrench(0, Signal.constant(np.arange(6.0)), np.array([0.1, 0.2, 0.3]), 0.25, np.inf, True)
    library = kernel.raw.function("adaptive_rollout").library
    loads = InputSignals(drive, [push], first=-2.0)
    packed, stops = PackedInputs(library, kernel.calls, loads), jump_times(loads).tolist()
    inputs = packed.pointer
    control, wrench, null = inputs.control, inputs.wrench[0], library.ffi.NULL
    assert (inputs.torque, inputs.model, inputs.given, inputs.work) == (null, null, null, null)
    assert (inputs.first, inputs.last, inputs.wrenches, inputs.stops) == (-2.0, np.inf, 1, len(stops))
    assert [inputs.stop[i] for i in range(len(stops))] == stops
    assert {-2.0, 0.25} <= set(stops)
    assert [inputs.effort[i] for i in range(2)] == [np.inf, 7.0]
    assert (control.ratio[0], control.kp[0], control.kd[0], control.program.place[0]) == (5.0, 30.0, 2.0, 1)
    spline = control.program.signal
    assert (spline.pieces, spline.degree, spline.columns) == (2, 2, 1)
    assert [spline.coefficient[i] for i in range(6)] == [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]
    assert [spline.knot[i] for i in range(3)] == [0.0, 1.0, 3.0]
    assert (spline.profile.pieces, spline.profile.degree, spline.profile.profile) == (1, 1, null)
    assert (wrench.t0, wrench.t1, wrench.link, wrench.turns) == (0.25, np.inf, 0, 1)
    assert list(wrench.arm) == [0.1, 0.2, 0.3]
    assert wrench.frame == list(kernel.frames).index(kernel.links[0])
    assert wrench.signal.columns == 6
