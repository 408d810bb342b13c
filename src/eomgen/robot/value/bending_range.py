"""How far a link may bend: deflections up to which its kinetic energy is positive.

The energy of a link whose deflections are of second order is kept up to squares of e and e' (``codegen.tree.modal``).
Beyond some deflection it is negative for some motion, and no mass matrix with it can be inverted.  Linear modes have
no such limit: theirs is the energy of particles.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from .link import Link

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

STEPS, LEAST, MOST = 240, 1e-3, 1e3  # amplitudes that are tried, by that whose modal energy has the link's inertia
HALVINGS = 40
ROUND_OFF = 1e-10  # of scaled eigenvalues that are zero: of a thin rod about itself


def deflection_range(link: Link) -> tuple[float, ...]:
    """Return for each mode the amplitude, m or as its shape has it, up to which no motion has a negative energy.

    Each is that of the mode alone, for either sign; infinite for links with linear modes.
    """
    if link.modes is None or link.modes.Q is None:
        return () if link.modes is None else (math.inf,) * link.modes.count
    signs = (1.0, -1.0)
    every = range(link.modes.count)
    return tuple(min(_first_negative(*_along(link, k, sign), _size(link, k)) for sign in signs) for k in every)


def range_line(link: Link) -> str | None:
    """Return on one line up to which amplitudes the energy of a link is positive; None where it always is."""
    ends = deflection_range(link)
    if not any(map(math.isfinite, ends)):
        return None
    shown = ", ".join(f"{x:.3g}" if math.isfinite(x) else "any" for x in ends)
    return (
        f"  modes of {link.name}, each by itself, have positive inertia up to {shown} (m, or as their shapes have it)"
    )


def _size(link: Link, k: int) -> float:
    """Return the amplitude of a mode that has as much inertia as the link."""
    assert link.modes is not None
    xx, yy, zz, *_ = link.inertia
    inertia = 0.5 * (xx + yy + zz) + link.mass * math.fsum(x * x for x in link.com)
    return math.sqrt(inertia / link.modes.masses[k][k])


def _along(link: Link, k: int, sign: float) -> tuple[Array, Array, Array]:
    """Return R0, R1 and R2, (6, 6): R0 + t R1 + t^2 R2 is the inertia of the link's frame while mode k is at sign t.

    What the modes themselves move is taken out of it: it is that of a body whose modes are free.
    """
    import numpy as np

    modes = link.modes
    assert modes is not None
    assert modes.Q is not None
    H0, P, Q = np.array(modes.H0), np.array(modes.P), np.array(modes.Q)
    slopes = Q[:, k].copy()  # of G_j by e_k, [P_kj; 0] + Q_jk
    slopes[:, :3] += P[k]
    C0, C1 = sign * H0[k], 0.5 * slopes[k]
    J, c = _moments(link)
    rigid = [_inertia(J, c, link.mass)]
    for block, row in ((C0[:3], C0[3]), (C1[:3], C1[3])):
        rigid.append(_inertia(block + block.T, row, 0.0))
    coupled = [np.array([_column(G) for G in x]).T for x in (H0, sign * slopes)]
    inverse = np.linalg.pinv(np.array(modes.masses))
    left, right = coupled
    both = left @ inverse @ right.T
    return rigid[0] - left @ inverse @ left.T, rigid[1] - both - both.T, rigid[2] - right @ inverse @ right.T


def _moments(link: Link) -> tuple[Array, Array]:
    """Return integrals of r r^T and of r over the mass, in the link's frame."""
    import numpy as np

    xx, yy, zz, xy, xz, yz = link.inertia
    tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    com = np.array(link.com)
    return 0.5 * np.trace(tensor) * np.eye(3) - tensor + link.mass * np.outer(com, com), link.mass * com


def _inertia(J: Array, c: Array, mass: float) -> Array:
    """Return the 6 x 6 inertia of translations and rotations, of integrals of r r^T, r and 1."""
    import numpy as np

    found = np.zeros((6, 6))
    x, y, z = c
    found[:3, :3] = mass * np.eye(3)
    found[3:, 3:] = np.trace(J) * np.eye(3) - J
    found[3:, :3] = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    found[:3, 3:] = found[3:, :3].T
    return found


def _column(G: Array) -> Array:
    """Return what a rate of a mode is to momentum and angular momentum, (6,), of its integral of rho x^T, 4 x 3."""
    import numpy as np

    return np.array([*G[3], G[1, 2] - G[2, 1], G[2, 0] - G[0, 2], G[0, 1] - G[1, 0]])


def _first_negative(R0: Array, R1: Array, R2: Array, size: float) -> float:
    """Return the first t at which R0 + t R1 + t^2 R2 has a negative eigenvalue; infinity where there is none."""
    import numpy as np

    diagonal = np.diag(R0)
    scale = np.sqrt(np.maximum(diagonal, 1e-6 * np.repeat([diagonal[:3].max(), diagonal[3:].max()], 3)))

    def least(t: Array) -> Array:
        t = t[:, np.newaxis, np.newaxis]
        values = np.linalg.eigvalsh((R0 + t * R1 + t * t * R2) / np.outer(scale, scale))[:, 0]
        return np.asarray(values, dtype=np.float64)

    tried = size * np.geomspace(LEAST, MOST, STEPS)
    negative = np.flatnonzero(least(tried) < -ROUND_OFF)
    if not negative.size:
        return math.inf
    low, high = (0.0 if not negative[0] else float(tried[negative[0] - 1])), float(tried[negative[0]])
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if least(np.array([middle]))[0] < -ROUND_OFF else (middle, high)
    return low
