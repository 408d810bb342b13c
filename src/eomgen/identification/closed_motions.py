"""A measured motion of a closed mechanism: what was not measured follows, and noise does not open its loops."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..arrays import RANK, Array, Mask, rank_of
from ..errors import InputError
from ..kernel.complete import Kernel
from ..names import listed
from ..robot.model import Model
from ..state.springs import stiffnesses
from ..state.vectors import prescribed_mask

STRIDE = 16  # samples between those that are closed one after the other; the others are closed at once, from them


def closed_motion(
    kernel: Kernel, model: Model, measured: Sequence[str], q: Array, v: Array, a: Array
) -> tuple[Array, Array, Array, tuple[str, ...]]:
    """Return motion with loops closed and couplings kept, (T, n) each, and the names of the coordinates that follow.

    Where what was measured leaves a mechanism no freedom, the others follow from it.  Where more was measured than it
    has freedoms, all of it changes by the least that closes the loops: rates by their kinetic energy, accelerations by
    the sum of squares.

    Args:
        kernel: with the kernels that close loops.
        model: of its robot.
        measured: names of the measured coordinates; deviations that were not are held at zero.
        q, v, a: the motion, (T, n) each.

    Raises:
        InputError: what was measured does not say where a coordinate is.
        LoopError: loops do not close near a sample.
    """
    names = kernel.coordinates
    known = np.isin(names, measured) | (stiffnesses(kernel) > 0.0) | prescribed_mask(kernel)
    q = np.where(known, q, np.array(model.home))
    q[0] = kernel.assemble(q[0], _names(kernel, known & _may_stay(kernel, q[0], known)))
    J = kernel.functions.constraint_jacobian(q[0])
    _refuse_unknown(kernel, J, known)
    held = known if rank_of(J[:, ~known]) == rank_of(J) else prescribed_mask(kernel)
    stays = _names(kernel, held)
    for k in range(STRIDE, len(q), STRIDE):
        q[k] = kernel.assemble(np.where(known, q[k], q[k - STRIDE]), stays)
    near = np.arange(len(q)) // STRIDE * STRIDE
    q = kernel.assemble(np.where(known, q, q[near]), stays)
    v = kernel.project_velocity(q, np.where(known, v, 0.0), stays)
    J, bias = kernel.functions.constraint_jacobian(q), kernel.functions.constraint_bias(q, v)
    a = np.where(known, a, 0.0)
    missing = np.einsum("tmn,tn->tm", J, a) + bias
    a[:, ~held] -= np.einsum("tnm,tm->tn", np.linalg.pinv(J[:, :, ~held], rcond=RANK), missing)
    return q, v, a, tuple(name for name, is_known in zip(names, known, strict=True) if not is_known)


def _may_stay(kernel: Kernel, q: Array, known: Mask) -> Mask:
    """Choose what stays while the first sample is closed: all that is known, if the others can close it, or nothing."""
    J = kernel.functions.constraint_jacobian(q)
    return np.full(known.size, rank_of(J[:, ~known]) == rank_of(J))


def _names(kernel: Kernel, mask: Mask) -> list[str]:
    return [name for name, stays in zip(kernel.coordinates, mask, strict=True) if stays]


def _refuse_unknown(kernel: Kernel, J: Array, known: Mask) -> None:
    """Raise InputError if coordinates that were not measured can move while the others do not."""
    others = np.flatnonzero(~known)
    if rank_of(J[:, others]) == others.size:
        return
    free = np.linalg.svd(J[:, others])[2][rank_of(J[:, others]) :]
    loose = [kernel.coordinates[i] for i in others[np.abs(free).max(axis=0) > 1e-6]]
    raise InputError(
        f"{kernel.name}: {listed(loose)} move while what was measured does not; allowed: motions that hold the"
        " mechanism"
    )
