"""Closed mechanisms by singular values: the least drives, forces in cuts, and states that close loops."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eomgen.kernel.complete import Kernel
from eomgen.robot.joint_types import CUTS
from eomgen.robot.value import Robot

Array = NDArray[Any]

RANK = 1e-7  # singular values below this part of the greatest one belong to redundant constraints


def least_drives(J: Array, needed: Array, places: Sequence[int]) -> tuple[Array, Array, float]:
    """u + J^T lambda = needed with drives at some places alone: u, lambda, and the most that no drive can take."""
    U, S, Vt = np.linalg.svd(J)
    rank = int(np.count_nonzero(S / max(S.max(initial=0.0), 1e-300) > RANK))
    ways = Vt[rank:]  # rates that keep the loops closed: lambda does no work on them
    u = np.zeros(needed.size)
    if places:
        u[list(places)] = np.linalg.lstsq(ways[:, list(places)], ways @ needed, rcond=RANK)[0]
    left = float(np.abs(ways @ (needed - u)).max(initial=0.0))
    return u, U[:, :rank] @ ((Vt[:rank] @ (needed - u)) / S[:rank]), left


def cut_wrenches(kernel: Kernel, q: Array, multipliers: Array) -> Array:
    """Wrenches of the cut joints on their second links, (loops, 6), in the cut frames there."""
    values = iter(multipliers)
    result = np.zeros((len(kernel.loops), 6))
    for row, kind, pose in zip(result, kernel.loops.values(), kernel.functions.cut_poses(q), strict=True):
        R = pose[:3, :3]
        for part in CUTS[kind]:
            value = next(values)
            if part.axis is not None:
                row[:3] += value * R[part.axis]
            for factor, i, j in part.products:
                row[3:] += value * factor * (R.T @ np.cross(R[:, j], np.eye(3)[i]))
    return result


def as_link_wrenches(kernel: Kernel, robot: Robot, q: Array, reactions: Array) -> Array:
    """Wrenches of the cut joints on both links, (links, 6), base axes, about their centres of mass, as ``wrench=``."""
    total = np.zeros((len(kernel.links), 6))
    for loop, reaction in zip(robot.loops, reactions, strict=True):
        placed = np.eye(4)
        placed[:3, :3], placed[:3, 3] = loop.placements[1].rotation, loop.placements[1].xyz
        cut = kernel.frame_pose(q, loop.links[1]) @ placed
        force, moment = cut[:3, :3] @ reaction[:3], cut[:3, :3] @ reaction[3:]
        for link, sign in zip(loop.links, (-1.0, 1.0), strict=True):
            if link not in kernel.links:
                continue
            own = next(x for x in robot.links if x.name == link)
            centre = (kernel.frame_pose(q, link) @ [*own.com, 1.0])[:3]
            row = total[kernel.links.index(link)]
            row[:3] += sign * force
            row[3:] += sign * (moment + np.cross(cut[:3, 3] - centre, force))
    return total


def closed_state(kernel: Kernel, guess: Array, held: Sequence[int], rng: np.random.Generator) -> tuple[Array, Array]:
    """Coordinates near a guess, of which some stay, and random rates that keep the loops closed."""
    q, free = np.array(guess, float), [i for i in range(kernel.n) if i not in held]
    for _ in range(100):
        g = kernel.functions.constraint(q)
        if np.abs(g).max() <= 1e-13:
            break
        q[free] -= np.linalg.lstsq(kernel.functions.constraint_jacobian(q)[:, free], g, rcond=RANK)[0]
    assert np.abs(kernel.functions.constraint(q)).max() <= 1e-11
    return q, onto_closed(kernel, q, rng.normal(size=kernel.n))


def onto_closed(kernel: Kernel, q: Array, v: Array) -> Array:
    """The rates next to others that keep the loops closed."""
    J = kernel.functions.constraint_jacobian(q)
    found: Array = v - np.linalg.lstsq(J, J @ v, rcond=RANK)[0]
    return found
