"""Notes on inertia in descriptions: whether M is regular at all, before anything is generated."""

from __future__ import annotations

import math

import numpy as np

from ..arrays import Array
from ..names import listed
from ..pipeline.derivations import derived_model
from ..robot.model import Model, with_offset_angles
from ..robot.value import Robot
from ..runtime.singular import ADVICE, VANISHED, null_coordinates, scaled_eigenvalues

MOST = 300  # coordinates: mass matrices of more are not looked at, so that a check stays quick
STATES = 3  # at random, which are singular by chance never all
BENT = 0.01  # amplitudes of modes, as parts of other coordinates: of links that bend far, no M is positive definite


def inertia_notes(robot: Robot) -> tuple[str, ...]:
    """Return lines about missing inertia: nothing that moves has any, or M is singular in every state."""
    if not any(joint.coordinates for joint in robot.joints):
        return ()
    model = derived_model(robot)
    moving = [robot.link(name) for name in model.links]
    if not any(link.mass or any(link.inertia) for link in moving):
        return (f"0 kg: no link that moves has mass or inertia, so that there are no accelerations; {ADVICE}",)
    if model.size > MOST:
        return ()
    free = [i for i in range(len(model.coordinates)) if i not in model.prescribed]
    names = [model.coordinates[i] for i in free]
    singular: list[str] = list(names)
    rng, modes = np.random.default_rng(0), set(robot.modal_coordinates)
    size = np.array([BENT if name in modes else 1.0 for name in model.coordinates])
    for _ in range(STATES if free else 0):
        M = mass_matrix(model, size * rng.uniform(0.2, 0.9, len(size)))[np.ix_(free, free)]
        if scaled_eigenvalues(M)[0][0] > VANISHED:
            return ()
        null = null_coordinates(M, names)
        singular = [name for name in singular if name in null]
    if not singular:
        return ()
    massless = [link.name for link in moving if not link.mass and not any(link.inertia)]
    without = f"; without mass and inertia: {listed(massless)}" if massless else ""
    return (f"the mass matrix is singular in every state: {listed(singular)} moves no inertia{without}; {ADVICE}",)


def mass_matrix(model: Model, q: Array) -> Array:
    """Return M of the tree in one state, (n, n), by the generator's recursion on floats; q of coordinates."""
    from ..codegen.tree.bending import bent
    from ..codegen.tree.bound import bind
    from ..codegen.tree.composite import mass_matrix as entries
    from ..codegen.tree.followers import Followers
    from ..codegen.tree.frozen_joints import PosedTree, geometry

    whole, indices = with_offset_angles(model)
    at = dict(zip(model.coordinates, q.tolist(), strict=True))
    bound = bind(whole, lambda _, number: number, _sincos)
    followers = Followers(whole, model, bound)
    placed = followers.place([at.get(name, 0.0) for name in whole.coordinates])
    bound = bent(whole, bound, placed, followers)
    n = len(model.coordinates)
    M, places = np.zeros((n, n)), {place: i for i, place in enumerate(indices)}
    upper = entries(PosedTree(whole, bound, geometry(whole, bound, placed, _sincos)))
    for (i, j), value in followers.symmetric(upper).items() if followers else upper.items():
        if i in places and j in places:
            row, column = places[i], places[j]
            M[row, column] = M[column, row] = value
    return M


def _sincos(angle: float) -> tuple[float, float]:
    return math.sin(angle), math.cos(angle)
