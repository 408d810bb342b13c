"""Files of links that bend that are nearly right: constants of a beam and modes of nodes, some of it changed."""

from __future__ import annotations

import random
import warnings
from functools import cache
from typing import Any

import numpy as np

from eomgen.bending.beam import beam_inertia, beam_modes
from eomgen.bending.files import BendingBody
from eomgen.robot.value import BeamModes, Link, LinkBeam, deflection_range

BEAM = LinkBeam(0.5, 7e10, 2.6e10, 1e-4, 2e-9, 5e-9, 7e-9, (1.0, 1.0), 2700.0, BeamModes(1, 1, 0, 0))
VALUES = (0.0, -1.0, 1e-12, 1e12, 1e40, np.nan, np.inf)
NAMES = ("H00", "K", "Phi", "M", "Q", "D", "interface_Psi", "mode", "", "../K")
OTHERS = (
    np.array("tip"),
    np.array(["tip", "tip"]),
    np.zeros(0),
    np.zeros((4, 4), complex),
    np.array([b"tip"]),
    np.ones(3, "M8[s]"),
)


@cache
def files() -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the arrays of a file of constants, and of one of modes of nodes."""
    modes, count = beam_modes(BEAM, 0.01), 4
    (tip,) = modes.nodes
    constants = {
        "H00": beam_inertia(BEAM),
        **{key: np.array(getattr(modes, key)) for key in ("H0", "P", "Q", "K", "D")},
        "interface_names": np.array(["tip"]),
        "interface_places": np.array([tip.place]),
        "interface_Phi": np.array([tip.Phi]),
        "interface_Psi": np.array([tip.Psi]),
    }
    x = np.linspace(0.0, 0.5, count)
    Phi = np.zeros((count, 6, 2))
    Phi[:, 1, 0], Phi[:, 5, 0] = x**2, 2.0 * x
    Phi[:, 2, 1], Phi[:, 4, 1] = x**2, -2.0 * x
    nodal = {
        "nodes": np.stack([x, 0.0 * x, 0.0 * x], axis=1),
        "mass": np.array([0.1, 0.2, 0.2, 0.1]),
        "inertia": np.array([1e-4 * np.eye(3)] * count),
        "Phi": Phi,
        "K": np.diag([20.0, 50.0]),
        "interface_names": np.array(["tip", "middle"]),
        "interface_nodes": np.array([3, 1]),
    }
    return constants, nodal


def changed(chance: random.Random) -> dict[str, Any]:
    """Return the arrays of a file with a few changes: of numbers, shapes, types, names, or arrays that are left out."""
    arrays = {key: np.array(x) for key, x in chance.choice(files()).items()}
    with np.errstate(all="ignore"), warnings.catch_warnings(action="ignore"):  # of casts to smaller types
        for _ in range(chance.choice((0, 1, 1, 2))):
            _change(arrays, chance)
    return arrays


def _change(arrays: dict[str, Any], chance: random.Random) -> None:
    """Change one array."""
    key, kind = chance.choice(list(arrays)), chance.random()
    array = arrays[key]
    if kind < 0.45 and array.size and array.dtype.kind == "f":
        place = np.unravel_index(chance.randrange(array.size), array.shape)
        array[place] = chance.choice((*VALUES, 1.01 * array[place], -array[place], array.max()))
    elif kind < 0.55:
        arrays[key] = chance.choice(
            (
                array.T,
                array[:-1] if array.ndim else array,
                array[None],
                np.concatenate([array, array]) if array.ndim else array,
            )
        )
    elif kind < 0.65:
        arrays[key] = (
            array.astype(chance.choice(("f2", "f4", ">f8", "U9", "c16", "?"))) if array.dtype.kind != "U" else array
        )
    elif kind < 0.75:
        arrays[key] = chance.choice((*OTHERS, *arrays.values()))
    elif kind < 0.85:
        arrays[chance.choice(NAMES)] = array
    elif kind < 0.95:
        del arrays[key]
    else:
        arrays[key] = array * chance.choice((0, 2, -1)) if array.dtype.kind in "fi" else array
    if not arrays:
        arrays["K"] = np.eye(2)


def check_bending(body: BendingBody) -> BendingBody:
    """It is finite, a body with a mass, and its modes are those that a link can have; how far they reach is known."""
    modes = body.modes
    assert np.isfinite(body.H00).all()
    assert body.H00[3, 3] > 0.0
    assert modes.conflict() is None
    assert all(x > 0.0 for x in (modes.masses[k][k] for k in range(modes.count)))
    assert all(node.name.isidentifier() for node in modes.nodes)
    com = body.H00[:3, 3] / body.H00[3, 3]
    J = body.H00[:3, :3] - body.H00[3, 3] * np.outer(com, com)
    tensor = np.trace(J) * np.eye(3) - J
    inertia = [float(tensor[i, j]) for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
    link = Link("arm", float(body.H00[3, 3]), tuple(map(float, com)), tuple(inertia), modes)  # type: ignore[arg-type]
    assert all(x >= 0.0 for x in deflection_range(link))
    return body
