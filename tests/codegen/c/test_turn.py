"""The sines and cosines of the kernels' C, against as many digits as it takes."""

from __future__ import annotations

import subprocess
from pathlib import Path

import cffi
import mpmath
import numpy as np
import pytest
from numpy.typing import NDArray

import eomgen
from eomgen.codegen.c.functions import COEFFICIENTS
from eomgen.codegen.package.compile import FLAGS
from tests.oracles.sines import polynomials
from tests.support.processors import skip_without
from tests.support.soak import soaked

VECTORS = [("-DEOM_VECTOR_BYTES=0",), (), ("-DEOM_LIBM",), ("-mavx2", "-mfma", "-ffp-contract=fast"), ("-mavx512f",)]
SOME = [*VECTORS[:3], *(pytest.param(flags, marks=pytest.mark.soak) for flags in VECTORS[3:4]), *VECTORS[4:]]
LIBRARY = Path(eomgen.__path__[0], "clib")
CTYPES = {"float64": "double", "float32": "float"}


def turn(dtype: str, flags: tuple[str, ...], angles: NDArray[np.floating], folder: Path) -> NDArray[np.floating]:
    """(2, count): sines, cosines."""
    real = CTYPES[dtype]
    head = f"void test_turn(const {real} *angle, size_t count, {real} *sine, {real} *cosine)"
    single = "#define EOM_SINGLE\n" if dtype == "float32" else ""
    text = f'{single}#include "lanes.h"\n{head};\n{head}\n{{\n    eom_sin_cos(angle, count, sine, cosine);\n}}\n'
    (folder / "turn.c").write_text(text, encoding="ascii")
    library = folder / "turn.so"
    command = ["cc", "-shared", "-fPIC", *FLAGS, *flags, f"-I{LIBRARY}", str(folder / "turn.c"), "-o", str(library)]
    subprocess.run([*command, "-lm"], check=True)
    ffi = cffi.FFI()
    ffi.cdef(f"{head};")
    out = np.zeros((2, len(angles)), dtype)
    pointers = [ffi.from_buffer(f"{real}[]", array) for array in (angles, out[0], out[1])]
    ffi.dlopen(str(library)).test_turn(pointers[0], len(angles), *pointers[1:])
    return out


def angles_of(dtype: str) -> NDArray[np.floating]:
    """Small and large ones, near multiples of pi/2, beyond the limit; a multiple of 16."""
    rng = np.random.default_rng(0)
    limit = COEFFICIENTS[dtype].farthest
    quarters = np.arange(-300, 300) * (np.pi / 2)
    parts = [rng.uniform(-size, size, 400) for size in (1e-300 if dtype == "float64" else 1e-30, 1.0, 10.0, limit)]
    special = [0.0, -0.0, limit, -limit, np.nextafter(limit, np.inf), 1e7, -1e22 if dtype == "float64" else -1e10]
    found = np.concatenate([*parts, quarters, np.nextafter(quarters, np.inf), special])
    return np.resize(found, -(-len(found) // 16) * 16).astype(dtype)


@pytest.mark.parametrize("dtype", soaked(["float64", "float32"], ["float64"]))
@pytest.mark.parametrize("flags", SOME, ids=lambda flags: " ".join(flags) or "default")
def test_within_units_in_the_last_place(dtype: str, flags: tuple[str, ...], tmp_path: Path) -> None:
    skip_without(flags)
    angles, allowed = angles_of(dtype), COEFFICIENTS[dtype].error
    found = turn(dtype, flags, angles, tmp_path)
    with mpmath.workprec(1200):
        for values, function in zip(found, (mpmath.sin, mpmath.cos), strict=True):
            for value, angle in zip(values, angles, strict=True):
                exact = function(mpmath.mpf(float(angle)))
                unit = float(np.spacing(np.abs(np.array(float(exact), dtype))))
                assert abs(mpmath.mpf(float(value)) - exact) <= allowed * unit, (float(angle), float(value))


def test_of_what_is_no_angle(tmp_path: Path) -> None:
    """NaN and infinity give NaN, and their neighbours are what they are without them."""
    angles = np.linspace(-3.0, 3.0, 16)
    alone = turn("float64", (), angles, tmp_path)
    angles[3], angles[8] = np.nan, np.inf
    found = turn("float64", (), angles, tmp_path)
    assert np.isnan(found[:, [3, 8]]).all()
    others = np.setdiff1d(np.arange(16), [3, 8])
    assert np.array_equal(found[:, others], alone[:, others])


@pytest.mark.parametrize("flags", VECTORS[:2], ids=["plain", "vectors"])
@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_every_bit_is_that_of_the_polynomials(dtype: str, flags: tuple[str, ...], tmp_path: Path) -> None:
    """Coefficients and order of operations are those of NumPy's arithmetic, step by step."""
    angles = angles_of(dtype)
    angles = np.resize(angles[np.abs(angles) <= COEFFICIENTS[dtype].farthest], angles.size)
    assert np.array_equal(turn(dtype, flags, angles, tmp_path), np.stack(polynomials(angles)))
