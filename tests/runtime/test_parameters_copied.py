"""Parameters are copied and pickled without their kernel: with values of their own, for the same code."""

from __future__ import annotations

import copy
import pickle
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from eomgen.errors import InputError, UnknownNameError
from eomgen.pipeline import cache
from eomgen.pipeline.stages import Options, load_kernel
from tests.support.quick_builds import Q, one_link
from tests.support.soak import soaked

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
    state, bound = [np.array(x, dtype) for x in (Q, Q, Q)], kernel.with_parameters(other)
    found = bound.inverse_dynamics(*state)
    assert not np.array_equal(found, kernel.inverse_dynamics(*state))
    assert np.array_equal(found, kernel.with_parameters({name: before + 1.0}).inverse_dynamics(*state))


def test_what_has_no_kernel_to_be_made_of_is_refused(filled_cache: Path) -> None:
    kernel = one_link()
    found = cache.find("packages", next(entry for entry in cache.contents() if entry[0] == "packages")[1])
    assert found is not None
    bare = load_kernel(found, kernel.name)
    with pytest.raises(InputError, match=r"^parameters: those of one_link, .* cannot be pickled; allowed: "):
        pickle.dumps(bare.parameters)
    assert copy.deepcopy(bare.parameters) == bare.parameters
    with pytest.raises(InputError, match=r"^raw: compiled code of one_link cannot be pickled; allowed: "):
        pickle.dumps(kernel.raw)
    assert copy.deepcopy(kernel.raw) is kernel.raw
