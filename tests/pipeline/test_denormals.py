"""Kernels that are asked for first in a thread that rounds denormal numbers to zero, as JAX's do."""

from __future__ import annotations

import threading

import numpy as np
import pytest

import eomgen
from eomgen.errors import BuildError
from eomgen.pipeline import denormals
from tests.support.optional import OptionalModule

jax = OptionalModule("jax")

Q = np.array([0.2, 0.5])
pytestmark = pytest.mark.usefixtures("unoptimised")


def of_jax(kernel: eomgen.Kernel) -> tuple[bool, np.ndarray]:
    """Whether JAX's thread keeps denormal numbers, and the mass matrix as it is computed there."""
    kept: list[bool] = []

    def host(q: np.ndarray) -> np.ndarray:
        kept.append(denormals.keeps_denormals())
        return kernel.mass_matrix(np.asarray(q, np.float64)).astype(np.float32)

    shape = jax.ShapeDtypeStruct((kernel.n, kernel.n), np.float32)
    found = np.asarray(jax.jit(lambda q: jax.pure_callback(host, shape, q))(Q.astype(np.float32)))
    return kept[0], found


@pytest.mark.usefixtures("empty_cache")
def test_a_kernel_is_built_within_a_callback_of_jax() -> None:
    """Its samples are those of a build elsewhere: they stay in the cache."""
    kept, found = of_jax(eomgen.build("one_link"))
    if kept:
        pytest.skip("this JAX keeps denormal numbers")
    expected = eomgen.build("one_link", kernels=("mass_matrix",)).mass_matrix(Q.astype(np.float32).astype(float))
    assert np.array_equal(found, expected.astype(np.float32))


@pytest.mark.usefixtures("empty_cache")
def test_without_another_thread_it_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(denormals, "_kept", [])
    kernel = eomgen.build("one_link", kernels=("energy",))
    monkeypatch.setattr(denormals, "keeps_denormals", lambda: False)
    with pytest.raises(BuildError, match="rounds denormal numbers to zero"):
        eomgen.build("one_link", kernels=("mass_matrix",))
    assert kernel.energy(Q, Q).shape == (2,)


def test_work_goes_to_the_thread_that_was_prepared(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(denormals, "_kept", [])
    denormals.prepare()
    denormals.prepare()
    assert len(denormals._kept) == 1
    here = threading.get_ident()
    assert denormals.with_denormals(threading.get_ident) == here
    monkeypatch.setattr(denormals, "keeps_denormals", lambda: False)
    assert denormals.with_denormals(threading.get_ident) != here
    denormals._kept[0].shutdown()
