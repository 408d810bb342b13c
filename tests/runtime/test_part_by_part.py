"""Several vectors of states that go through a long program part by part: the bits of states that go alone."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import eomgen
from eomgen.codegen.c import contexts, definitions, lanes, statements
from eomgen.description.load import robot_from_toml
from eomgen.errors import SingularError
from eomgen.robot.value import Robot
from eomgen.runtime.tiled import aligned
from tests.support.builds import Build
from tests.support.random_robots import random_robot
from tests.support.soak import soaked

Array = np.ndarray[Any, Any]
N = 37  # states, no multiple of what vectors hold
WIDTHS = {"-DEOMGEN_VECTOR=0": 1, "-mno-avx": 2, "-mavx2": 4, "-mavx512f": 8}
POINT = """
name = "point"
[[links]]
name = "post"
mass = 0.0
[[links]]
name = "arm"
mass = 2.0
com = [0.0, 1.0, 0.0]
[[joints]]
name = "turn"
type = "revolute"
parent = "base"
child = "post"
[[joints]]
name = "lift"
type = "revolute"
placement = { rpy = [0.0, 1.5707963267948966, 0.0] }
parent = "post"
child = "arm"
"""  # where the arm points upwards its mass is on the first axis


@pytest.fixture
def short_parts(monkeypatch: pytest.MonkeyPatch, empty_cache: Path) -> None:
    """Programs of any length go in short parts; the cache does not know of that."""
    monkeypatch.setattr(lanes, "MANY", 1)
    monkeypatch.setattr(definitions, "SHORT", 20)
    for module in (contexts, statements):
        monkeypatch.setattr(module, "CHUNK", 20)


def displaced(x: Array) -> Array:
    """Return tiles in memory that does not begin at a line."""
    room = aligned((x.size + 2,), x.dtype)[2:].reshape(x.shape)
    room[...] = x
    return room


def tree(seed: int) -> Robot:
    return random_robot(seed, joints=(5, 7), tree=True, max_coordinates=1, name="tree")


@pytest.mark.parametrize("flag", soaked(tuple(WIDTHS), ("-mavx512f", "-mno-avx")))
@pytest.mark.parametrize("seed", soaked((1, 2, 3), (1,)))
@pytest.mark.usefixtures("short_parts")
def test_states_have_the_bits_that_they_have_alone(flag: str, seed: int, empty_cache: Path) -> None:
    """In rows and in tiles, wherever these begin, whatever part of the last vector they fill."""
    kernel = eomgen.build(tree(seed), kernels=("forward_dynamics",), flags=("-O0", flag))
    (text,) = (path.read_text() for path in empty_cache.glob("packages/*/tree.c"))
    assert "tree_forward_dynamics_several(" in text
    assert "tree_forward_dynamics_lanes_part2(" in text
    rng = np.random.default_rng(seed)
    q, v, u = rows = rng.uniform(-2, 2, (3, N, kernel.n))
    alone = np.array([kernel.forward_dynamics(*(x[k] for x in rows)) for k in range(N)])
    for count in (1, 8, 9, 16, 17, N):
        some = [x[:count] for x in rows]
        tiles = [kernel.tiled.pack(x) for x in some]
        whole = kernel.tiled.pack(alone[:count])
        assert np.array_equal(kernel.forward_dynamics(*some), alone[:count])
        for given in (tiles, [displaced(x) for x in tiles], [tiles[0], displaced(tiles[1]), tiles[2]]):
            for out in (np.empty_like(whole), displaced(np.zeros_like(whole)), None):
                assert np.array_equal(kernel.tiled.forward_dynamics(*given, out=out), whole)
    expected = kernel.tiled.pack(kernel.forward_dynamics(q, v[0], u))
    assert np.array_equal(kernel.tiled.forward_dynamics(kernel.tiled.pack(q), v[0], kernel.tiled.pack(u)), expected)


@pytest.mark.parametrize("flag", soaked(tuple(WIDTHS), ("-mavx512f", "-mavx2")))
@pytest.mark.usefixtures("short_parts")
def test_the_first_singular_state_is_named(flag: str, empty_cache: Path) -> None:
    """Whichever vector and lane it is in."""
    kernel = eomgen.build(robot_from_toml(POINT), kernels=("forward_dynamics", "mass_matrix"), flags=("-O0", flag))
    assert "part1" in next(empty_cache.glob("packages/*/point.c")).read_text()
    for first in (0, 3, 7, 8, 15, 16, 30, N - 1):
        q, zero = np.full((N, 2), 0.3), np.zeros((N, 2))
        q[first:, 1] = np.pi / 2
        for call in (
            lambda q=q, zero=zero: kernel.forward_dynamics(q, zero, zero),
            lambda q=q, zero=zero: kernel.tiled.forward_dynamics(*map(kernel.tiled.pack, (q, zero, zero))),
        ):
            with pytest.raises(SingularError, match=rf"turn\.gamma in state {first};"):
                call()


def test_tiles_that_functions_make_begin_at_a_line(built: Build) -> None:
    """So that what computes on them next takes them as they lie."""
    kernel = built(robot_from_toml(POINT), "inverse_dynamics")
    kept = []
    for count in range(8, 200, 8):
        tiles = kernel.tiled.pack(np.zeros((count, 2)))
        kept.append(kernel.tiled.inverse_dynamics(tiles, tiles, tiles))
        assert kept[-1].ctypes.data % 64 == 0
        assert kept[-1].flags.c_contiguous
        assert kept[-1].flags.writeable
