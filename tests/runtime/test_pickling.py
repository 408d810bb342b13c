"""Kernels and parameters travel by content: to copies, to processes with and without the cache, and as packages."""

from __future__ import annotations

import copy
import pickle
import sys
from concurrent.futures import ProcessPoolExecutor
from itertools import product
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import pytest

import eomgen
from eomgen.errors import InputError, UnknownNameError
from eomgen.kernel.complete import Kernel
from eomgen.pipeline import cache
from eomgen.pipeline.building import load_kernel
from eomgen.pipeline.generating import generate
from eomgen.pipeline.options import Options
from tests.support.quick_builds import ONE_LEVEL, Q, answer, as_new_process, one_link, python
from tests.support.refusals import refused
from tests.support.soak import soaked

pytestmark = pytest.mark.quick

LOADS = """
    import json, pickle, sys
    from pathlib import Path
    kernel = pickle.loads(Path({file!r}).read_bytes())
    print(json.dumps([kernel.mass_matrix([0.2, 0.5]).tolist(), kernel.threads, kernel.checks, dict(kernel.parameters)]))
"""


def changed(kernel: Kernel) -> Kernel:
    """A kernel with other parameters, threads and checks than it was built with."""
    kernel = kernel.replaced(threads=3).replaced(checks=False)
    for name in kernel.parameters:
        kernel.parameters[name] = 1.25 * kernel.parameters[name] + 0.125
    return kernel


def same(found: Kernel, expected: Kernel) -> None:
    assert dict(found.parameters) == dict(expected.parameters)
    assert (found.threads, found.checks, found.dtype) == (expected.threads, expected.checks, expected.dtype)
    q = np.array(Q, expected.dtype)
    assert np.array_equal(found.mass_matrix(q), expected.mass_matrix(q))


@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_a_pickle_has_what_may_be_set(dtype: str, filled_cache: Path) -> None:
    kernel = changed(one_link(options=Options(("mass_matrix",), dtype, flags=("-O0",))))
    data = pickle.dumps(kernel)
    assert len(data) < 20_000  # a description, not the code
    found = pickle.loads(data)
    same(found, kernel)
    same(pickle.loads(pickle.dumps(found)), kernel)
    for name in found.parameters:
        found.parameters[name] += 1.0
    assert dict(found.parameters) != dict(kernel.parameters) or not kernel.parameters


def test_copies_have_parameters_of_their_own(filled_cache: Path) -> None:
    kernel = changed(one_link())
    for found in (copy.copy(kernel), copy.deepcopy(kernel), copy.deepcopy({"kernel": kernel})["kernel"]):
        same(found, kernel)
        assert found.raw is kernel.raw
        assert found.parameters is not kernel.parameters
        found.threads = 5
    assert kernel.threads == 3


def test_the_package_is_loaded_where_it_is(filled_cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    data = pickle.dumps(one_link())
    as_new_process(monkeypatch)
    monkeypatch.setattr("eomgen.pipeline.building.make_package", lambda *_: pytest.fail("it is there"))
    assert pickle.loads(data).name == "one_link"


def test_the_package_is_built_where_it_is_not(
    filled_cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    kernel = changed(one_link())
    data = pickle.dumps(kernel)
    as_new_process(monkeypatch)
    monkeypatch.setenv(cache.VARIABLE, str(tmp_path / "other"))
    same(pickle.loads(data), kernel)
    assert {kind for kind, _, _ in cache.contents()} >= {"sources", "packages"}


def weights(kernel: Kernel, q: np.ndarray) -> np.ndarray:
    """Mass matrix of one state, in a process of its own."""
    return kernel.mass_matrix(q)


@pytest.mark.soak
def test_a_pool_of_fresh_processes(filled_cache: Path) -> None:
    kernel = changed(one_link())
    states = np.random.default_rng(0).uniform(-1.0, 1.0, (4, 2))
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        found = list(pool.map(weights, [kernel] * 4, states))
    assert np.array_equal(found, kernel.mass_matrix(states))


def test_a_generated_package_is_asked_for_by_its_name(
    filled_cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In a process that has the package, and of eomgen nothing."""
    generate(eomgen.load_robot("one_link"), tmp_path, ONE_LEVEL)
    monkeypatch.syspath_prepend(str(tmp_path))
    for name in [name for name in sys.modules if name.split(".")[0] == "one_link"]:
        monkeypatch.delitem(sys.modules, name)
    import one_link as package  # type: ignore[import-not-found]

    kernel = package.load().replaced(threads=3)
    file = tmp_path / "kernel.pickle"
    file.write_bytes(pickle.dumps(kernel))
    assert b"eomgen" not in file.read_bytes()
    alone = "import sys; sys.modules['eomgen'] = None\n" + f"sys.path.insert(0, {str(tmp_path)!r})"
    matrix, threads, checks, parameters = answer(python(alone + "\n" + _plain(LOADS.format(file=str(file)))))
    assert matrix == kernel.mass_matrix(Q).tolist()
    assert (threads, checks, parameters) == (3, True, dict(kernel.parameters))


def _plain(code: str) -> str:
    import textwrap

    return textwrap.dedent(code)


def test_what_cannot_be_made_again_is_refused(filled_cache: Path) -> None:
    kernel = one_link()
    package = next(entry for entry in cache.contents() if entry[0] == "packages")
    found = cache.find("packages", package[1])
    assert found is not None
    bare = load_kernel(found, kernel.name)
    refused(
        InputError, "one_link: a kernel that was put together by hand cannot be pickled; allowed:", pickle.dumps, bare
    )
    same(copy.deepcopy(bare), bare)


WAYS = {
    "pickle": lambda x: pickle.loads(pickle.dumps(x)),
    "deepcopy": copy.deepcopy,
    "copy": copy.copy,
    "in a list": lambda x: copy.deepcopy([x])[0],
}


@pytest.mark.parametrize(
    ("way", "dtype"), soaked(product(WAYS, ["float64", "float32"]), {("pickle", "float64"), ("deepcopy", "float32")})
)
def test_a_copy_has_equal_values_of_its_own(way: str, dtype: str, filled_cache: Path) -> None:
    kernel = one_link(options=Options(("inverse_dynamics",), dtype, flags=("-O0",)))
    name = next(iter(kernel.parameters))
    kernel.parameters[name] = 1.25 * kernel.parameters[name] + 0.125
    other = WAYS[way](kernel.parameters)
    assert type(other) is type(kernel.parameters)
    assert other == kernel.parameters
    assert list(other) == list(kernel.parameters)
    before = kernel.parameters[name]
    other[name] = before + 1.0
    assert (kernel.parameters[name], other[name]) == (before, before + 1.0)
    with pytest.raises(UnknownNameError):
        other["nothing"]
    state, bound = [np.array(x, dtype) for x in (Q, Q, Q)], kernel.replaced(parameters=other)
    found = bound.inverse_dynamics(*state)
    assert not np.array_equal(found, kernel.inverse_dynamics(*state))
    assert np.array_equal(found, kernel.replaced(parameters={name: before + 1.0}).inverse_dynamics(*state))


def test_what_has_no_kernel_to_be_made_of_is_refused(filled_cache: Path) -> None:
    kernel = one_link()
    found = cache.find("packages", next(entry for entry in cache.contents() if entry[0] == "packages")[1])
    assert found is not None
    bare = load_kernel(found, kernel.name)
    with pytest.raises(InputError, match=r"^parameters: those of one_link, .* cannot be pickled; allowed: "):
        pickle.dumps(bare.parameters)
    assert copy.deepcopy(bare.parameters) == bare.parameters
    refused(InputError, r"^raw: compiled code of one_link cannot be pickled; allowed: ", pickle.dumps, kernel.raw)
    assert copy.deepcopy(kernel.raw) is kernel.raw
